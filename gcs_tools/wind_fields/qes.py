"""QES-Winds' output, of both its files: values at the centres of cells, or on their faces.

After QES' source (WINDSOutputVisualization.cpp, WINDSOutputWorkspace.cpp). Both files name their velocities u, v and w.
In the Workspace file x_face and y_face are wrong, so faces are made of the centres.
"""

from __future__ import annotations

import numpy as np

from gcs_tools.wind_fields.grid import (
    METRES_A_SECOND,
    Grid,
    Part,
    check_units,
    check_values,
    edges,
    wrong,
)
from gcs_tools.wind_fields.netcdf import Contents

SOLID = (0, 2)  # icellflag: building, terrain
FLAGS = ("icellflag", "icell")


def fits(contents: Contents) -> bool:
    """Return true if a file has the flags of QES' cells."""
    return any(flag in contents.variables for flag in FLAGS)


def read(contents: Contents, source: str) -> Grid:
    """A field of QES-Winds. Raises FieldError."""
    found = contents.variables
    lacking = [each for each in ("u", "v", "w", "x", "y", "z") if each not in found]
    if lacking:
        raise wrong(
            source,
            f"{', '.join(lacking)} missing: expected QES-Winds' Visualization or Workspace file",
        )
    x, y, z = (found[axis].values.astype(np.float64) for axis in "xyz")
    flag = next(each for each in FLAGS if each in found)
    flags = found[flag].values
    if flags.ndim != 4 or flags.shape[1:] != (len(z), len(y), len(x)):
        raise wrong(
            source,
            f"{flag} has {flags.shape} values: expected (times, {len(z)}, {len(y)}, {len(x)})",
        )
    times = found["t"].values if "t" in found else np.arange(found["u"].values.shape[0])
    on_faces = found["u"].dimensions[-1] == "x_face"
    parts = {}
    for name, number in (("u", 3), ("v", 2), ("w", 1)):
        check_units(source, name, found[name].attributes.get("units"), METRES_A_SECOND)
        v, axes = found[name].values.astype(np.float32), {"x": x, "y": y, "z": z}
        shape = [len(z), len(y), len(x)]
        if on_faces:
            axes["xyz"[3 - number]] = edges(axes["xyz"[3 - number]])
            shape[number - 1] += 1
            if v.ndim != 4 or any(n < m for n, m in zip(v.shape[1:], shape, strict=True)):
                raise wrong(
                    source, f"{name} has {v.shape} values: expected (times, {shape}) or more"
                )
            v = v[:, : shape[0], : shape[1], : shape[2]]
        check_values(source, name, v)
        parts[name] = Part(**axes, v=v)
    grid = Grid(source, "QES-Winds", times, parts, staggered=on_faces)
    grid.solid, grid.cells = np.isin(flags[0], SOLID), (x, y, z)
    if on_faces:
        grid.notes.append("x_face and y_face of QES are not used: faces stand between the centres")
    return grid
