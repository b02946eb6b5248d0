"""A field of wind as a file has it, checked, repaired where that can be stated, and packed for the simulator."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

import numpy as np

from sitl_plant.physics.wind.field import NO_TOP, Field, component_on, frozen
from sitl_plant.physics.wind.packed_field import FASTEST_M_S, FieldError, save

Array = np.ndarray[Any, Any]

FILLS = (-999999.0, -9999.0)  # of PALM, new and old
MOST_GIB = 8  # of the values of a file, as it says itself: a small one may claim any number
FARTHEST_M = 1e8  # of a place: map projections with the number of their zone reach 6e7
CLOSEST_M, CLOSEST_S = 1e-6, 1e-6  # of two places, and of two times
METRES = {"m", "meter", "meters", "metre", "metres"}
METRES_A_SECOND = {"m/s", "m s-1", "m s^-1", "ms-1", "m s**-1", "meter second-1"}
SECONDS = {"s", "second", "seconds"}


@dataclass
class Part:
    """One component: its places, and float32[t, z, y, x] in m/s, NaN where a file has none."""

    x: Array
    y: Array
    z: Array
    v: Array


@dataclass
class Grid:
    """A field as it was read."""

    source: str
    kind: str  # of file, in words
    t: Array  # s
    parts: dict[str, Part]  # u, v, w
    solid: Array | None = None  # bool[z, y, x] of cells, whose centres are those of `cells`
    cells: tuple[Array, Array, Array] | None = None  # centres x, y, z
    staggered: bool = False  # components stand on the faces of the cells
    notes: list[str] = field(default_factory=list)  # what was repaired, and what is worth knowing
    about: dict[str, Any] = field(default_factory=dict)  # georeference and the like


def wrong(source: str, what: str) -> FieldError:
    """An error to raise of a file."""
    return FieldError(f"{source}: {what}")


def reason(error: Exception) -> str:
    """The text of an error of a reader, in words where it has none."""
    if isinstance(error, MemoryError):
        return (
            "there is not enough memory for its values: "
            "cut it to the place and the times of the flight"
        )
    return str(error)[:200] or type(error).__name__


def check_file(source: str, file: BinaryIO) -> None:
    """Raise FieldError for a file of more bytes than are read."""
    size = os.fstat(file.fileno()).st_size
    if size > MOST_GIB << 30:
        raise wrong(
            source,
            f"it has {size / (1 << 30):.3g} GiB: expected {MOST_GIB} GiB at most; cut it first",
        )


def check_values(source: str, name: str, values: Array) -> None:
    """Raise FieldError for values that are missing where there is air."""
    if np.isnan(values).any():
        raise wrong(source, f"{name} has no values at some places outside buildings")


def check_size(source: str, values: int) -> None:
    """Raise FieldError for more bytes of values than are read."""
    if values > MOST_GIB << 30:
        raise wrong(
            source,
            f"it says that it has {values / (1 << 30):.3g} GiB of values: expected {MOST_GIB} GiB at most; "
            "cut it to the place and the times of the flight (ncks -d)",
        )


def check_units(source: str, name: str, units: Any, known: set[str]) -> None:
    """Raise FieldError for a unit that is stated and is another than expected.

    Times may be counted from a date ("seconds since 2026-06-21 12:00:00 +00").
    """
    if isinstance(units, np.ndarray) and units.size == 1:
        units = units.ravel()[0]
    text = units.decode(errors="replace") if isinstance(units, bytes) else str(units)
    said = "" if units is None else text.strip()
    if known is SECONDS:
        said = said.partition(" since ")[0].strip()
    if said and said.lower() not in known:
        raise wrong(source, f"{name} is in {said!r}: expected {sorted(known)[0]}; convert it first")


def check_places(source: str, what: str, places: Array) -> None:
    """Raise FieldError for places that are not finite, or farther than any on Earth."""
    if not np.isfinite(places).all():
        raise wrong(source, f"{what}: expected finite places")
    if places.size and (farthest := float(np.abs(places).max())) > FARTHEST_M:
        raise wrong(
            source,
            f"{what}: expected places up to {FARTHEST_M:g} m, got {farthest:g}: are they in m?",
        )


def edges(centres: Array) -> Array:
    """Edges of cells between their centres, the outer ones as far out as the next is in."""
    if len(centres) == 1:
        return np.array([centres[0] - 0.5, centres[0] + 0.5])
    inner = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate(([2 * centres[0] - inner[0]], inner, [2 * centres[-1] - inner[-1]]))


def repaired(grid: Grid) -> Grid:
    """Check a grid, turn axes that fall, and begin time at 0. Raises FieldError."""
    t = np.asarray(grid.t, dtype=np.float64)
    if not len(t) or not np.isfinite(t).all() or (np.diff(t) < CLOSEST_S).any():
        raise wrong(
            grid.source,
            f"times are missing, or do not rise: expected one or more, {CLOSEST_S:g} s apart or farther",
        )
    if len(t) > 1 and t[0] != 0.0:
        grid.notes.append(f"time begins at {t[0]:g} s: counted from there")
    grid.t = t - t[0]
    turned = set()
    for name, part in grid.parts.items():
        for number, axis in ((3, "x"), (2, "y"), (1, "z")):
            places = np.asarray(getattr(part, axis), dtype=np.float64)
            if part.v.ndim != 4 or len(places) != part.v.shape[number]:
                raise wrong(
                    grid.source,
                    f"{name} has {part.v.shape} values, and {len(places)} places along {axis}",
                )
            check_places(grid.source, axis, places)
            steps = np.diff(places)
            if not ((steps > 0.0).all() or (steps < 0.0).all()):
                raise wrong(grid.source, f"the places along {axis} neither rise nor fall")
            if len(steps) and np.abs(steps).min() < CLOSEST_M:
                raise wrong(
                    grid.source, f"{axis}: expected places {CLOSEST_M:g} m apart, or farther"
                )
            if len(steps) and steps[0] < 0.0:
                part.v = np.flip(part.v, axis=number)
                places = places[::-1]
                turned.add(axis)
            setattr(part, axis, places)
        if part.v.shape[0] != len(t):
            raise wrong(grid.source, f"{name} has {part.v.shape[0]} times, and there are {len(t)}")
        gaps = np.isnan(part.v)
        if gaps.all():
            raise wrong(grid.source, f"{name} has no values")
        if np.isinf(part.v).any():
            raise wrong(grid.source, f"{name} has values that are not finite")
        if np.nanmax(np.abs(part.v)) > FASTEST_M_S:
            raise wrong(
                grid.source,
                f"{name} has values beyond {FASTEST_M_S:g} m/s: is it in m/s, and which number means none?",
            )
        if (gaps != gaps[:1]).any():
            raise wrong(
                grid.source,
                f"{name} has gaps that come and go: buildings stand still, so values are missing",
            )
    if turned and grid.cells is not None and grid.solid is not None:
        cells = dict(zip("xyz", grid.cells, strict=True))
        for axis in turned:
            if cells[axis][0] > cells[axis][-1]:
                grid.solid = np.flip(grid.solid, axis={"z": 0, "y": 1, "x": 2}[axis])
                cells[axis] = cells[axis][::-1]
        grid.cells = cells["x"], cells["y"], cells["z"]
    if turned:
        grid.notes.append(f"{', '.join(sorted(turned))} fell: turned round")
    return grid


def on_faces(grid: Grid) -> Grid:
    """Move components from the centres of cells to their faces: none flows through a wall."""
    assert grid.solid is not None and grid.cells is not None
    x, y, z = grid.cells
    open_cells = ~grid.solid
    for name, number in (("u", 3), ("v", 2), ("w", 1)):
        part = grid.parts[name]
        v = np.moveaxis(np.where(open_cells, part.v, 0.0), number, -1)
        is_open = np.moveaxis(np.broadcast_to(open_cells, part.v.shape), number, -1)
        both = is_open[..., 1:] & is_open[..., :-1]
        inner = np.where(both, 0.5 * (v[..., 1:] + v[..., :-1]), 0.0)
        faces = np.concatenate((v[..., :1], inner, v[..., -1:]), axis=-1)
        axes = {"x": x, "y": y, "z": z}
        along = "xyz"[3 - number]
        axes[along] = edges(axes[along])
        grid.parts[name] = Part(**axes, v=np.moveaxis(faces, -1, number).astype(np.float32))
    grid.staggered = True
    grid.notes.append(
        "values at centres of cells were averaged onto faces, so that walls are closed"
    )
    return grid


def solid_of_gaps(grid: Grid) -> None:
    """Take cells without values for buildings."""
    u = grid.parts["u"]
    gaps = np.isnan(u.v[0]) | np.isnan(grid.parts["v"].v[0]) | np.isnan(grid.parts["w"].v[0])
    if gaps.any():
        grid.solid, grid.cells = gaps, (u.x, u.y, u.z)


def heights(grid: Grid) -> tuple[Array, Array, Array]:
    """Edges along x and y, and the height of ground and buildings float32[y, x]: overhangs are filled."""
    if grid.solid is None or grid.cells is None:
        u = grid.parts["u"]
        return edges(u.x)[[0, -1]], edges(u.y)[[0, -1]], np.full((1, 1), NO_TOP, dtype=np.float32)
    x, y, z = grid.cells
    tops = edges(z)[1:]
    any_solid = grid.solid.any(axis=0)
    highest = grid.solid.shape[0] - 1 - np.argmax(grid.solid[::-1], axis=0)
    filled = highest + 1 != grid.solid.sum(axis=0)
    if (filled & any_solid & grid.solid[0]).any() or (any_solid & ~grid.solid[0]).any():
        grid.notes.append("cells under overhangs, or below the lowest building, count as building")
    ground = max(edges(z)[0], 0.0) if edges(z)[0] <= 0.0 else edges(z)[0]
    return edges(x), edges(y), np.where(any_solid, tops[highest], ground).astype(np.float32)


@np.errstate(all="ignore")  # values are checked, and told of in words
def packable(grid: Grid) -> Field:
    """The field as the simulator takes it. Raises FieldError."""
    grid = repaired(grid)
    if not grid.staggered:
        if grid.solid is None:
            solid_of_gaps(grid)
        if grid.solid is not None:
            grid = on_faces(grid)
    top_x, top_y, top = heights(grid)
    parts = {
        name: component_on(p.x, p.y, p.z, np.nan_to_num(p.v, nan=0.0).astype(np.float32))
        for name, p in grid.parts.items()
    }
    over = {axis: [getattr(p, axis) for p in parts.values()] for axis in "xyz"}
    bounds = [
        f(g(e) for e in over[axis]) for axis in "xyz" for f, g in ((min, np.min), (max, np.max))
    ]
    # the ground is below the lowest value: a vehicle that stands on it is in the field
    bounds[4] = min(bounds[4], float(top.min()) if top.min() > NO_TOP else bounds[4]) - 1.0
    return Field(
        t=frozen(grid.t), **parts, bounds=frozen(np.array(bounds)), top_x=frozen(top_x), top_y=frozen(top_y),
        top=frozen(top),
    )  # fmt: skip


def pack(grid: Grid, out: Path) -> Field:
    """Write a field for the simulator. Raises FieldError, OSError.

    It is written beside its place and moved there when it is whole: of two that are packed at once one is refused.
    """
    made = packable(grid)
    about = {"source": grid.source, "kind": grid.kind, "notes": grid.notes, **grid.about}
    out.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=out.parent, prefix=f".{out.name}-") as beside:
        save(Path(beside) / out.name, made, about)
        (Path(beside) / out.name).rename(out)
    return made
