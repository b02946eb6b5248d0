"""A recorded track: a CSV file of positions over time."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface import input_file
from gcs_tools.missions.paths import PathError

Rows = np.ndarray[Any, np.dtype[np.float64]]

COLUMNS = ("t_s", "x_m", "y_m", "z_m")  # time, and East, North, Up
MOST_SAMPLES = 5_000  # smoothing them takes seconds


def read(path: Path) -> tuple[Rows, Rows]:
    """Times (n,), s, and positions (n, 3), m, E, of a file whose first line names its columns.

    Others than COLUMNS are left aside. Raises PathError, with the line where one is at fault.
    """
    try:
        lines = input_file.text(path, 2 * input_file.MIB).splitlines()
    except OSError as error:
        raise PathError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise PathError(f"{path}: expected UTF-8 text ({error.reason})") from error
    try:
        table = list(csv.reader(lines[: MOST_SAMPLES + 2]))
    except csv.Error as error:
        raise PathError(f"{path}: {error}") from error
    names = [name.strip() for name in table[0]] if table else []
    lacking = [name for name in COLUMNS if name not in names]
    if lacking:
        raise PathError(
            f"{path}:1: expected a line that names the columns {', '.join(COLUMNS)}; "
            f"{', '.join(lacking)} {'is' if len(lacking) == 1 else 'are'} missing"
        )
    if len(table) > MOST_SAMPLES + 1:
        raise PathError(f"{path}: more than {MOST_SAMPLES} samples")
    wanted = [names.index(name) for name in COLUMNS]
    rows = []
    for number, cells in enumerate(table[1:], start=2):
        if not cells:
            continue
        try:
            row = [float(cells[i]) for i in wanted]
        except (ValueError, IndexError):
            row = [math.nan]
        if not all(map(math.isfinite, row)) or any(abs(x) > 1e5 for x in row[1:]):
            raise PathError(f"{path}:{number}: expected four finite numbers, {', '.join(COLUMNS)}")
        rows.append(row)
    found = np.array(rows).reshape(-1, len(COLUMNS))
    return found[:, 0], found[:, 1:]
