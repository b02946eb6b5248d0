"""VTK files of OpenFOAM or ParaView as a field: cells of any shape are resampled onto a regular grid.

In a cell the wind is that of its centre, and changes by the least squares of the values at its corners: linear wind is met to
rounding. Where no cell is, is a building.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gcs_tools.wind_fields import mesh as meshes
from gcs_tools.wind_fields.grid import Grid, Part, check_places, reason, wrong
from gcs_tools.wind_fields.vtk_file import POLYHEDRON, Contents
from gcs_tools.wind_fields.vtk_file import read as contents_of
from sitl_plant.physics.wind.packed_field import FieldError

Array = np.ndarray[Any, Any]

NAMES = ("U", "velocity", "Velocity", "UMean", "u", "vectors")
VALID = "vtkValidPointMask"  # of ParaView's resampling: 0 where there was nothing
MOST, PLACES = 20_000_000, 5_000  # places of the grid, in all and for each cell
LEAST_FILLED = 0.05  # part of the box about the cells that they fill
FINE = 0.1  # part of the cells that are finer than the grid


def read(path: Path) -> Grid:
    """A field of a VTK file. Raises FieldError, OSError."""
    source, contents = str(path), contents_of(path)
    try:
        if contents.axes is not None:
            return _regular(contents, contents.axes, source)
        if contents.points is None or contents.cells is None:
            raise wrong(source, "it has no cells: expected those of a volume")
        return _resampled(contents, source)
    except FieldError:
        raise
    except (ValueError, LookupError, TypeError, OverflowError, MemoryError) as error:
        raise wrong(source, reason(error)) from error


def _vectors(of: dict[str, Array], n: int) -> tuple[str, Array] | None:
    """The wind among values, by its name or as the only vectors."""
    found = {name: v for name, v in of.items() if v.shape == (n, 3)}
    named = next((name for name in NAMES if name in found), None)
    if named is None and len(found) == 1:
        named = next(iter(found))
    return None if named is None else (named, found[named])


def _lacking(contents: Contents, source: str) -> Exception:
    names = ", ".join([*contents.of_points, *contents.of_cells]) or "no values"
    return wrong(source, f"no velocity: expected vectors named U or velocity, got {names}")


def _regular(contents: Contents, axes: tuple[Array, Array, Array], source: str) -> Grid:
    shape = tuple(len(axis) for axis in reversed(axes))
    at_points = _vectors(contents.of_points, int(np.prod(shape)))
    if at_points is None:
        inner = [0.5 * (axis[1:] + axis[:-1]) for axis in axes]
        shape = tuple(len(axis) for axis in reversed(inner))
        found = _vectors(contents.of_cells, int(np.prod(shape)))
        if found is None:
            raise _lacking(contents, source)
        axes, mask = (inner[0], inner[1], inner[2]), None
    else:
        found, mask = at_points, contents.of_points.get(VALID)
    name, v = found[0], found[1].astype(np.float32)
    if mask is not None:
        v[mask.ravel() == 0] = np.nan
    x, y, z = axes
    parts = {c: Part(x, y, z, v[:, k].reshape(shape)[None]) for k, c in enumerate("uvw")}
    return Grid(source, "VTK, regular", np.zeros(1), parts, notes=[_units(name)])


def _units(name: str) -> str:
    return f"{name} was taken in m/s, with the third axis up: VTK files do not say"


def _farthest(points: Array) -> int:
    """The number of the point that is the most distances of the middle half from the median, along an axis."""
    quarter, middle, last = np.quantile(points.astype(np.float64), (0.25, 0.5, 0.75), axis=0)
    spread = np.maximum(last - quarter, 1e-9)
    return int((np.abs(points - middle) / spread).max(axis=1).argmax())


def _resampled(contents: Contents, source: str) -> Grid:
    points, cells = contents.points, contents.cells
    assert points is not None and cells is not None
    check_places(source, "points", points)
    made = meshes.mesh(points, cells)
    at_points = _vectors(contents.of_points, len(points))
    of_cells = _vectors(contents.of_cells, len(cells.types))
    if at_points is None and of_cells is None:
        raise _lacking(contents, source)
    for each in (at_points, of_cells):
        if each is not None and np.isinf(each[1]).any():
            raise wrong(source, f"{each[0]} has values that are not finite")
    volumes = np.isin(cells.types, [*meshes.FACES, POLYHEDRON])
    if volumes.sum() != len(made.centre):
        raise wrong(source, "it has cells without a volume")
    if of_cells is not None:
        name, centre = of_cells[0], of_cells[1][volumes].astype(np.float64)
    else:
        assert at_points is not None
        name, corner = at_points[0], at_points[1][made.corner]
        count = np.bincount(made.corner_cell)
        centre = np.stack([np.bincount(made.corner_cell, corner[:, a]) / count for a in range(3)], axis=-1)  # fmt: skip
    slope = meshes.slopes(made, points, centre, None if at_points is None else at_points[1])
    low, high = points[made.corner].min(axis=0), points[made.corner].max(axis=0)
    low, high = low.astype(np.float64), high.astype(np.float64)
    filled = float(made.volume.sum() / np.prod(high - low))
    if not filled >= LEAST_FILLED:
        far = made.corner[_farthest(points[made.corner])]
        raise wrong(
            source,
            f"its cells fill {100.0 * filled:.2g} % of the box about them, expected {100.0 * LEAST_FILLED:g} % or more: "
            f"point {far} at ({', '.join(f'{a:g}' for a in points[far])}) m is the farthest from the others",
        )
    most = min(MOST, PLACES * len(made.centre))
    step = float(np.quantile(made.size, FINE))
    step = max(step, float(np.prod((high - low) / most ** (1 / 3)) ** (1 / 3)))
    along = np.maximum(np.rint((high - low) / step), 1)
    if not np.prod(along) <= 2 * most:
        raise wrong(source, f"cells of {step:.3g} m are too fine for its extent")
    axes = [
        a + (b - a) * (np.arange(n) + 0.5) / n
        for a, b, n in zip(low, high, along.astype(int), strict=True)
    ]
    x, y, z = axes
    places = np.stack([of.ravel() for of in np.meshgrid(z, y, x, indexing="ij")][::-1], axis=-1)
    cell = meshes.cells_at(made, points, (x, y, z)).ravel()
    v = np.full(places.shape, np.nan, dtype=np.float32)
    some = cell >= 0
    arm = places[some] - made.centre[cell[some]]
    v[some] = centre[cell[some]] + np.einsum("nij,nj->ni", slope[cell[some]], arm)
    shape = (1, len(z), len(y), len(x))
    parts = {c: Part(x, y, z, v[:, k].reshape(shape)) for k, c in enumerate("uvw")}
    sizes = " x ".join(f"{(b - a) / len(of):.3g}" for a, b, of in zip(low, high, axes, strict=True))
    notes = [
        f"{len(made.centre)} cells of {made.size.min():.3g} to {made.size.max():.3g} m were resampled onto a grid of {sizes} m",
        _units(name),
    ]
    if at_points is None:
        notes.append("there are no values at points: the wind is constant in each cell of the file")
    return Grid(source, "VTK", np.zeros(1), parts, notes=notes)
