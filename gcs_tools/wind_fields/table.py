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


def _bad_line(body: str, columns: int) -> str:
    """The fault of the first line that has something else than numbers."""
    for number, line in enumerate(body.splitlines(), start=2):
        told = line.partition("#")[0].strip()
        cells = told.split(",")
        if told and len(cells) != columns:
            return f"line {number} has {len(cells)} values: expected {columns}, one for each column"
        for cell in cells if told else ():
            try:
                float(cell)
            except ValueError:
                return f"line {number} has {cell.strip()[:40]!r}: expected a number"
    return f"expected lines of {columns} numbers with commas between"


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
    if not body.strip():
        raise wrong(source, "it has no line below its header")
    try:
        rows = np.loadtxt(io.StringIO(body), delimiter=",", ndmin=2)
    except ValueError as error:
        raise wrong(source, _bad_line(body, len(names))) from error
    if rows.shape[1] != len(names):
        raise wrong(source, _bad_line(body, len(names)))
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
    _, first = np.unique(place, return_index=True)
    if len(first) != len(place):
        again = int(np.setdiff1d(np.arange(len(place)), first)[0])
        where = ", ".join(f"{keys[i][again]:g}" for i in (3, 2, 1))
        raise wrong(source, f"the place {where} comes twice at one time")
    t, z, y, x = axes
    parts = {}
    for name, key in zip("uvw", COLUMNS[3:], strict=True):
        v = np.full(shape, np.nan, dtype=np.float32)
        v.ravel()[place] = column[key]
        parts[name] = Part(x, y, z, v)
    return Grid(source, "CSV", t, parts)
