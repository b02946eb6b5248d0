"""uDALES' field dumps: u, v and w on the faces of a grid, in a tile for each process that wrote.

After uDALES' source (modfielddump.f90): u(time, zt, yt, xm), v(time, zt, ym, xt), w(time, zm, yt, xt), each on the
lower face of its cell. In buildings mask_c is 0 where it was dumped, and solid_c.txt (of the folder that uDALES ran
in) lists their cells. The wind in them is small, but need not be 0.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fcu.interface.files import input_file
from gcs_tools.wind_fields import netcdf
from gcs_tools.wind_fields.grid import (
    METRES,
    METRES_A_SECOND,
    SECONDS,
    Array,
    Grid,
    Part,
    check_units,
    check_values,
    wrong,
)
from gcs_tools.wind_fields.netcdf import Contents, Variable

DIMENSIONS = {
    "u": ("time", "zt", "yt", "xm"), "v": ("time", "zt", "ym", "xt"), "w": ("time", "zm", "yt", "xt"),
    "mask_c": ("time", "zt", "yt", "xt"),
}  # fmt: skip
AXES = ("xt", "xm", "yt", "ym", "zt", "zm")
SOLIDS, MOST_MIB = "solid_c.txt", 256
JOINT = 0.1  # of half a cell, by which cells may overlap or lie apart
TILE = re.compile(r"(?P<what>\w+)\.(?P<x>\d{3})\.(?P<y>\d{3})\.(?P<experiment>\w+)\.nc")


class Tile(NamedTuple):
    """A file of a dump, read."""

    path: str
    of: dict[str, Variable]


def fits(contents: Contents) -> bool:
    """Return true if a file names its axes as uDALES does."""
    return {"xm", "ym", "zm", "zt"} <= contents.variables.keys()


def read(contents: Contents, path: Path) -> Grid:
    """A field of uDALES: of one file, or of all the tiles that lie beside it. Raises FieldError, OSError."""
    source = str(path)
    tiles = _tiles(contents, path)
    x_numbers, y_numbers = (sorted({place[axis] for place in tiles}) for axis in (0, 1))
    if len(tiles) != len(x_numbers) * len(y_numbers):
        raise wrong(
            source, f"{len(tiles)} tiles of {len(x_numbers)} x {len(y_numbers)}: some are missing"
        )
    for along, numbers in (("x", x_numbers), ("y", y_numbers)):
        if absent := sorted(set(range(numbers[-1] + 1)) - set(numbers)):
            raise wrong(source, f"the tiles of number {absent[0]:03d} along {along} are missing")
    first = tiles[0, 0]
    for tile in tiles.values():
        _check(tile)
    for (i, j), tile in tiles.items():
        _compare(tile, first, ("time", "zt", "zm"))
        _compare(tile, tiles[i, 0], ("xt", "xm"))
        _compare(tile, tiles[0, j], ("yt", "ym"))
    axes = {name: first.of[name].values.astype(np.float64) for name in AXES}
    for kind in "xy":
        row = [tiles[n, 0] for n in x_numbers] if kind == "x" else [tiles[0, n] for n in y_numbers]
        before: Tile | None = None
        for tile in row:
            _check_axis(tile, before, kind)
            before = tile
        for name in (f"{kind}t", f"{kind}m"):
            axes[name] = np.concatenate([tile.of[name].values for tile in row]).astype(np.float64)
    _check_axis(first, None, "z")

    def joined(name: str) -> Array:
        rows = [
            np.concatenate([tiles[x, y].of[name].values for x in x_numbers], axis=3)
            for y in y_numbers
        ]
        return np.concatenate(rows, axis=2)

    if not first.of["time"].values.size:
        raise wrong(source, "it has no times: did the run end before it wrote (tfielddump)?")
    parts = {}
    for name in ("u", "v", "w"):
        z, y, x = (axes[axis] for axis in DIMENSIONS[name][1:])
        parts[name] = Part(x, y, z, joined(name).astype(np.float32))
    grid = Grid(source, "uDALES", first.of["time"].values, parts, staggered=True)
    grid.cells = axes["xt"], axes["yt"], axes["zt"]
    without = [tile for tile in tiles.values() if "mask_c" not in tile.of]
    if not without:
        grid.solid = joined("mask_c")[-1] == 0
    elif len(without) < len(tiles):
        raise wrong(without[0].path, "mask_c is missing, and other tiles have it")
    elif (path.parent / SOLIDS).exists():
        grid.solid = _listed(path.parent / SOLIDS, parts["u"].v.shape[1:])
        grid.notes.append(f"buildings are the cells of {SOLIDS}, which lies beside it")
    else:
        grid.solid = _still(parts)
        grid.notes.append(
            "without mask_c (fieldvars mc) cells in which no air ever moves count as buildings"
        )
        if not grid.solid.any():
            grid.notes.append(f"no building was found: if there are some, put {SOLIDS} beside it")
    if _close(parts, grid.solid):
        grid.notes.append("wind through walls, and inside buildings, was taken out")
    for name, part in parts.items():
        check_values(source, name, part.v)
    count = f"{len(tiles)} tiles were joined" if len(tiles) > 1 else "one tile"
    grid.notes.append(f"{count}: no file says how many uDALES wrote, so compare the extent")
    grid.notes.append(f"{100.0 * grid.solid.mean():.1f} % of the cells are buildings")
    return grid


def _check(tile: Tile) -> None:
    """Raise FieldError for a tile that lacks something, or has it otherwise than uDALES writes it."""
    lacking = [name for name in ("time", *AXES) if name not in tile.of]
    if lacking:
        raise wrong(tile.path, f"{', '.join(lacking)} missing: expected uDALES' field dump")
    for name, dimensions in DIMENSIONS.items():
        if name == "mask_c" and name not in tile.of:
            continue
        if name not in tile.of or tile.of[name].dimensions != dimensions:
            raise wrong(tile.path, f"expected {name} on {dimensions} (fieldvars = 'u0,v0,w0,mc')")
        shape = tile.of[name].values.shape
        places = tuple(len(tile.of[axis].values) for axis in dimensions)
        if shape != places:
            raise wrong(tile.path, f"{name} has {shape} values: its axes have {places}")
        if name != "mask_c":
            check_units(tile.path, name, tile.of[name].attributes.get("units"), METRES_A_SECOND)
        elif not np.isfinite(tile.of[name].values).all():
            raise wrong(tile.path, "mask_c has values that are not finite: expected 0 in buildings")
    if len({tile.of[name].values.shape for name in "uvw"}) != 1:
        raise wrong(tile.path, "u, v and w have other shapes: expected as many values of each")
    check_units(tile.path, "time", tile.of["time"].attributes.get("units"), SECONDS)
    for axis in AXES:
        check_units(tile.path, axis, tile.of[axis].attributes.get("units"), METRES)


def _compare(tile: Tile, other: Tile, names: tuple[str, ...]) -> None:
    """Raise FieldError where a tile has other times or places than its neighbour."""
    for name in names:
        here, there = tile.of[name].values, other.of[name].values
        if not np.array_equal(here, there):
            raise wrong(
                tile.path, f"{name} is {_ends(here)}, and {_ends(there)} in {Path(other.path).name}"
            )


def _ends(values: Array) -> str:
    """The numbers of an axis in short."""
    if not len(values):
        return "empty"
    return f"{len(values)} values from {values[0]:g} to {values[-1]:g}"


def _check_axis(tile: Tile, before: Tile | None, kind: str) -> None:
    """Raise FieldError unless cells begin where the last ends, and have their centres in the middle.

    before : the tile before it along the axis.  kind : x, y or z.
    """
    centre, lower = (tile.of[f"{kind}{at}"].values.astype(np.float64) for at in "tm")
    half = centre - lower
    if not (half > 0.0).all():
        raise wrong(tile.path, f"{kind}t ({_ends(centre)}) is not above {kind}m ({_ends(lower)})")
    ends, begins = (centre + half)[:-1], lower[1:]
    apart = np.abs(ends - begins) > JOINT * half[1:]
    if kind != "z" and apart.any():
        i = int(np.argmax(apart))
        raise wrong(
            tile.path,
            f"{kind}t and {kind}m do not fit: a cell ends at {ends[i]:g} m, the next begins at {begins[i]:g} m",
        )
    if kind == "z" and not (centre[:-1] < begins).all():
        raise wrong(tile.path, "zt and zm do not fit: expected a centre in each cell")
    if before is not None:
        t, m = (before.of[f"{kind}{at}"].values.astype(np.float64)[-1] for at in "tm")
        if abs(2.0 * t - m - lower[0]) > JOINT * half[0]:
            raise wrong(
                tile.path,
                f"it begins at {kind} = {lower[0]:g} m: {Path(before.path).name}, the tile before it, ends at {2.0 * t - m:g} m",
            )


def _tiles(contents: Contents, path: Path) -> dict[tuple[int, int], Tile]:
    """The tiles of a dump by their place. A file whose name says no place is the only one."""
    named = TILE.fullmatch(path.name)
    if named is None:
        return {(0, 0): Tile(str(path), contents.variables)}
    found = {}
    for each in sorted(path.parent.iterdir()):
        other = TILE.fullmatch(each.name)
        if other and other["what"] == named["what"] and other["experiment"] == named["experiment"]:
            place = int(other["x"]), int(other["y"])
            read_ = contents if each.name == path.name else netcdf.read(each)
            found[place] = Tile(str(each), read_.variables)
    return found


def _listed(path: Path, shape: tuple[int, ...]) -> Array:
    """Cells that a file lists as numbers along x, y and z from 1: bool[z, y, x]. Raises FieldError, OSError."""
    lines = input_file.text(path, MOST_MIB * input_file.MIB).splitlines()
    numbers = [line.split() for line in lines if line.strip() and not line.lstrip().startswith("#")]
    try:
        cells = np.array(numbers, dtype=np.int64).reshape(-1, 3) - 1
    except (ValueError, OverflowError) as error:
        raise wrong(str(path), "expected lines of three whole numbers, of a cell") from error
    if (cells < 0).any() or (cells >= shape[::-1]).any():
        raise wrong(str(path), f"it has cells outside the {shape[::-1]} of the field")
    solid = np.zeros(shape, dtype=bool)
    solid[cells[:, 2], cells[:, 1], cells[:, 0]] = True
    return solid


def _close(parts: dict[str, Part], solid: Array) -> bool:
    """Take out the wind on faces of solid cells. Return true if there was some."""
    found = False
    for name, axis in (("u", 2), ("v", 1), ("w", 0)):
        before = np.roll(solid, 1, axis)
        np.moveaxis(before, axis, 0)[0] = False
        of = parts[name].v
        found |= bool(of[:, solid | before].any())
        of[:, solid | before] = 0.0
    return found


def _still(parts: dict[str, Part]) -> Array:
    """Cells none of whose faces has wind at any time: bool[z, y, x]."""
    still = np.ones(parts["u"].v.shape[1:], dtype=bool)
    for name, axis in (("u", 2), ("v", 1), ("w", 0)):
        face = (parts[name].v == 0.0).all(axis=0)
        after = np.concatenate((np.delete(face, 0, axis), np.take(face, [-1], axis)), axis)
        still &= face & after
    return still
