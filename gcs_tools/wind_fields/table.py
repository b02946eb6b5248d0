"""A field as CSV: a line for each place (and time) of a grid, with a header."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from gcs_tools.wind_fields.grid import Grid, Part, wrong

COLUMNS = ("x_m", "y_m", "z_m", "u_m_s", "v_m_s", "w_m_s")
TIME = "t_s"
MOST = 200_000_000  # values of a grid


def fits(text: str) -> bool:
    """Return true if the first line names a place."""
    return "x_m" in text.partition("\n")[0].split(",")


def read(text: str, source: str) -> Grid:
    """A field of a CSV file. Places without a line, or with nan, are solid. Raises FieldError."""
    header, _, body = text.partition("\n")
    names = [name.strip() for name in header.split(",")]
    lacking = [name for name in COLUMNS if names.count(name) != 1]
    if lacking:
        raise wrong(
            source,
            f"expected one column each of {', '.join(COLUMNS)} ({TIME} for times); not so: {', '.join(lacking)}",
        )
    try:
        rows = np.loadtxt(io.StringIO(body), delimiter=",", ndmin=2)
    except ValueError as error:
        raise wrong(source, f"expected numbers with commas between: {error}") from error
    if not len(rows) or rows.shape[1] != len(names):
        raise wrong(source, f"expected lines of {len(names)} numbers")
    column = dict(zip(names, rows.T, strict=True))
    keys = [column.get(TIME, np.zeros(len(rows))), column["z_m"], column["y_m"], column["x_m"]]
    if not all(np.isfinite(key).all() for key in keys):
        raise wrong(source, "places and times have to be finite")
    axes: Any
    at: Any
    axes, at = zip(*(np.unique(key, return_inverse=True) for key in keys), strict=True)
    shape = tuple(map(len, axes))
    if np.prod(shape, dtype=np.float64) > min(MOST, 20.0 * len(rows) + 1000):
        raise wrong(
            source, f"its places are no grid: {len(rows)} lines for {shape} times, z, y and x"
        )
    place = np.ravel_multi_index(at, shape)
    if len(np.unique(place)) != len(place):
        raise wrong(source, "a place comes twice at one time")
    t, z, y, x = axes
    parts = {}
    for name, key in zip("uvw", COLUMNS[3:], strict=True):
        v = np.full(shape, np.nan, dtype=np.float32)
        v.ravel()[place] = column[key]
        parts[name] = Part(x, y, z, v)
    return Grid(source, "CSV", t, parts)
