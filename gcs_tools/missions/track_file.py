"""A recorded track: a CSV file of positions over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface import samples_file
from gcs_tools.missions.paths import PathError

Rows = np.ndarray[Any, np.dtype[np.float64]]

COLUMNS = ("t_s", "x_m", "y_m", "z_m")  # time, and East, North, Up
MOST_SAMPLES = 5_000  # smoothing them takes seconds
MOST_M = 1e5


def read(path: Path) -> tuple[Rows, Rows]:
    """Times (n,), s, and positions (n, 3), m, E, of a file whose first line names its columns.

    Others than COLUMNS are left aside. Raises PathError, with the line where one is at fault.
    """
    try:
        found = samples_file.read(path, COLUMNS, MOST_SAMPLES, MOST_M)
    except samples_file.SamplesError as error:
        raise PathError(str(error)) from error
    return found[:, 0], found[:, 1:]
