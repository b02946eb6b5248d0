"""PALM's 3-D output: u, v and w on the faces of a grid, fill values where there is no air.

After PALM's source (netcdf_interface_mod.f90): u(time, zu_3d, y, xu), v(time, zu_3d, yv, x), w(time, zw_3d, y, x). A
file of averages has the same names.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs_tools.wind_fields.grid import (
    FILLS,
    METRES,
    METRES_A_SECOND,
    SECONDS,
    Grid,
    Part,
    check_units,
    wrong,
)
from gcs_tools.wind_fields.netcdf import Contents

DIMENSIONS = {
    "u": ("time", "zu_3d", "y", "xu"), "v": ("time", "zu_3d", "yv", "x"), "w": ("time", "zw_3d", "y", "x"),
}  # fmt: skip
GEOREFERENCE = (
    "origin_x",
    "origin_y",
    "origin_z",
    "origin_lat",
    "origin_lon",
    "origin_time",
    "rotation_angle",
)


def fits(contents: Contents) -> bool:
    """Return true if a file names its axes as PALM does."""
    return "zu_3d" in contents.variables or "zw_3d" in contents.variables


def read(contents: Contents, source: str) -> Grid:
    """A field of PALM. Raises FieldError."""
    found, parts = contents.variables, {}
    for name, dimensions in DIMENSIONS.items():
        lacking = [each for each in (name, *dimensions) if each not in found]
        if lacking:
            raise wrong(
                source, f"{', '.join(lacking)} missing: expected PALM's DATA_3D with u, v and w"
            )
        if found[name].dimensions != dimensions:
            raise wrong(source, f"{name} is on {found[name].dimensions}: expected {dimensions}")
        check_units(source, name, found[name].attributes.get("units"), METRES_A_SECOND)
        for axis in dimensions[1:]:
            check_units(source, axis, found[axis].attributes.get("units"), METRES)
        v = found[name].values.astype(np.float32)
        v[np.isin(v, [np.float32(fill) for fill in FILLS])] = np.nan
        z, y, x = (found[axis].values.astype(np.float64) for axis in dimensions[1:])
        parts[name] = Part(x, y, z, v)
    check_units(source, "time", found["time"].attributes.get("units"), SECONDS)
    grid = Grid(source, "PALM", found["time"].values, parts, staggered=True)
    for name in ("u", "v"):
        of = parts[name]
        if len(of.z) > 1 and np.isnan(of.v[:, 0]).all():
            of.z, of.v = of.z[1:], of.v[:, 1:]
    u, north_of = parts["u"], parts["v"]
    if u.v.shape[1:] != north_of.v.shape[1:]:
        raise wrong(source, f"u has {u.v.shape} values and v {north_of.v.shape}: expected as many")
    # a cell is solid if no face of it has a value; the last face of a row is that of the cell before
    no_u, no_v = np.isnan(u.v[0]), np.isnan(north_of.v[0])
    east = np.concatenate((no_u[..., 1:], no_u[..., -1:]), axis=2)
    north = np.concatenate((no_v[:, 1:], no_v[:, -1:]), axis=1)
    grid.solid, grid.cells = no_u & east & no_v & north, (north_of.x, u.y, u.z)
    grid.notes.append(f"{100.0 * grid.solid.mean():.1f} % of the cells are buildings or terrain")
    grid.about = {
        key: _plain(contents.attributes[key]) for key in GEOREFERENCE if key in contents.attributes
    }
    if float(grid.about.get("rotation_angle") or 0.0) != 0.0:
        grid.notes.append(
            f"the grid is turned by {grid.about['rotation_angle']} deg against North: its x is flown as East"
        )
    return grid


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    return np.ravel(value).tolist()[0] if np.size(value) == 1 else str(value)
