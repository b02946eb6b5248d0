"""uDALES' field dumps: u, v and w on the faces of a grid, in a tile for each process that wrote.

After uDALES' source (modfielddump.f90): u(time, zt, yt, xm), v(time, zt, ym, xt), w(time, zm, yt, xt), each on the
lower face of its cell. In buildings mask_c is 0 where it was dumped, and solid_c.txt (of the folder that uDALES ran
in) lists their cells. The wind in them is small, but need not be 0.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from fcu.interface.files import input_file
from gcs_tools.wind_fields import netcdf
from gcs_tools.wind_fields.grid import (
    METRES_A_SECOND,
    SECONDS,
    Array,
    Grid,
    Part,
    check_units,
    wrong,
)
from gcs_tools.wind_fields.netcdf import Contents

DIMENSIONS = {
    "u": ("time", "zt", "yt", "xm"), "v": ("time", "zt", "ym", "xt"), "w": ("time", "zm", "yt", "xt"),
    "mask_c": ("time", "zt", "yt", "xt"),
}  # fmt: skip
AXES = ("xt", "xm", "yt", "ym", "zt", "zm")
SOLIDS, MOST_MIB = "solid_c.txt", 256
TILE = re.compile(r"(?P<what>\w+)\.(?P<x>\d{3})\.(?P<y>\d{3})\.(?P<experiment>\w+)\.nc")


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
    first = tiles[x_numbers[0], y_numbers[0]]
    for name in ("u", "v", "w"):
        for of in tiles.values():
            if name not in of.variables or of.variables[name].dimensions != DIMENSIONS[name]:
                raise wrong(
                    source, f"expected {name} on {DIMENSIONS[name]} (fieldvars = 'u0,v0,w0,mc')"
                )
    lacking = [axis for axis in ("time", *AXES) if axis not in first.variables]
    if lacking:
        raise wrong(source, f"{', '.join(lacking)} missing: expected uDALES' field dump")
    axes = {name: first.variables[name].values.astype(np.float64) for name in AXES}
    for kind, numbers, fixed in (("x", x_numbers, y_numbers[0]), ("y", y_numbers, x_numbers[0])):
        for name in (f"{kind}t", f"{kind}m"):
            row = [tiles[(n, fixed) if kind == "x" else (fixed, n)] for n in numbers]
            axes[name] = np.concatenate([of.variables[name].values for of in row]).astype(
                np.float64
            )

    def joined(name: str) -> Array:
        shapes = {of.variables[name].values.shape[:2] for of in tiles.values()}
        if len(shapes) != 1:
            raise wrong(source, f"{name} has other times or heights in other tiles")
        try:
            rows = [
                np.concatenate([tiles[x, y].variables[name].values for x in x_numbers], axis=3)
                for y in y_numbers
            ]
            return np.concatenate(rows, axis=2)
        except ValueError as error:
            raise wrong(source, f"{name} of its tiles does not fit together: {error}") from error

    if not first.variables["time"].values.size:
        raise wrong(source, "it has no times: did the run end before it wrote (tfielddump)?")
    parts = {}
    for name in ("u", "v", "w"):
        check_units(source, name, first.variables[name].attributes.get("units"), METRES_A_SECOND)
        z, y, x = (axes[axis] for axis in DIMENSIONS[name][1:])
        parts[name] = Part(x, y, z, joined(name).astype(np.float32))
    check_units(source, "time", first.variables["time"].attributes.get("units"), SECONDS)
    grid = Grid(source, "uDALES", first.variables["time"].values, parts, staggered=True)
    if len({part.v.shape for part in parts.values()}) != 1:
        raise wrong(source, "u, v and w have other shapes: expected as many values of each")
    grid.cells = axes["xt"], axes["yt"], axes["zt"]
    if all("mask_c" in of.variables for of in tiles.values()):
        grid.solid = joined("mask_c")[-1] == 0
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
    grid.notes.append(f"{len(tiles)} tiles were joined" if len(tiles) > 1 else "one tile")
    grid.notes.append(f"{100.0 * grid.solid.mean():.1f} % of the cells are buildings")
    return grid


def _tiles(contents: Contents, path: Path) -> dict[tuple[int, int], Contents]:
    """The tiles of a dump by their place. A file whose name says no place is the only one."""
    named = TILE.fullmatch(path.name)
    if named is None:
        return {(0, 0): contents}
    found = {}
    for each in sorted(path.parent.iterdir()):
        other = TILE.fullmatch(each.name)
        if other and other["what"] == named["what"] and other["experiment"] == named["experiment"]:
            place = int(other["x"]), int(other["y"])
            found[place] = contents if each.name == path.name else netcdf.read(each)
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
