"""A quantity sampled over time, in a CSV file whose first line names its columns."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface.files import input_file

Rows = np.ndarray[Any, np.dtype[np.float64]]

COUNTS = {4: "four"}  # columns in words
WIND = ("t_s", "x_m_s", "y_m_s", "z_m_s")  # time; velocity of the air to East, North, Up
WIND_MOST_S, WIND_MOST_M_S = 3600.0, 1e3  # of a file of wind
WIND_SAMPLES = 100_000
WIND_MIB = 16


class SamplesError(input_file.PlainError):
    """A file that does not hold such samples: which, where and why."""


def read(path: Path, columns: Sequence[str], samples: int, most: float, mib: int = 2) -> Rows:
    """Read float64[n, len(columns)]: the rows of a file, in the order of `columns`.

    Other columns are left aside.  samples : so many rows at most.  most : no value but the first of a
    row is larger.  mib : the largest file.  Raises SamplesError, with the line where one is at fault.
    """
    try:
        text = input_file.text(path, mib * input_file.MIB).removeprefix(input_file.MARK)
        lines = text.splitlines()
    except OSError as error:
        raise SamplesError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SamplesError(f"{path}: expected UTF-8 text ({error.reason})") from error
    try:
        table = list(csv.reader(lines[: samples + 2]))
    except csv.Error as error:
        raise SamplesError(f"{path}: {error}") from error
    names = [name.strip() for name in table[0]] if table else []
    if twice := [name for name in columns if names.count(name) > 1]:
        raise SamplesError(f"{path}:1: expected one column {twice[0]}, got {names.count(twice[0])}")
    lacking = [name for name in columns if name not in names]
    if lacking:
        raise SamplesError(
            f"{path}:1: expected a line that names the columns {', '.join(columns)}, with commas between; "
            f"{', '.join(lacking)} {'is' if len(lacking) == 1 else 'are'} missing"
        )
    if len(table) > samples + 1:
        raise SamplesError(f"{path}: more than {samples} samples")
    wanted = [names.index(name) for name in columns]
    rows = []
    for number, cells in enumerate(table[1:], start=2):
        if not cells:
            continue
        try:
            row = [float(cells[i]) for i in wanted]
        except (ValueError, IndexError):
            row = [math.nan]
        if not all(map(math.isfinite, row)) or any(abs(x) > most for x in row[1:]):
            count = COUNTS.get(len(columns), str(len(columns)))
            raise SamplesError(
                f"{path}:{number}: expected {count} finite numbers, {', '.join(columns)}"
            )
        rows.append(row)
    return np.array(rows).reshape(-1, len(columns))


def read_wind(path: Path) -> Rows:
    """Read float64[n, 4] of a file of wind: s, and m/s to East, North and Up, n at least 1.

    Raises SamplesError.
    """
    return checked_wind(read(path, WIND, WIND_SAMPLES, WIND_MOST_M_S, WIND_MIB), path)


def checked_wind(rows: Rows, path: Path) -> Rows:
    """Return float64[n, 4] of a file of wind. Raises SamplesError unless they are samples that rise in time."""
    if not len(rows):
        raise SamplesError(f"{path}: expected a sample or more")
    bad = np.flatnonzero(
        ~np.isfinite(rows).all(axis=1) | (np.abs(rows[:, 1:]) > WIND_MOST_M_S).any(axis=1)
    )
    if len(bad):
        raise SamplesError(
            f"{path}: expected finite numbers, up to {WIND_MOST_M_S:g} m/s, in sample {int(bad[0]) + 1}"
        )
    t = rows[:, 0]
    early = np.flatnonzero(np.diff(t) <= 0.0)
    if len(early):
        k = int(early[0])
        raise SamplesError(f"{path}: expected a time after {t[k]:g} s, got {t[k + 1]:g}")
    if t[0] < 0.0 or t[-1] > WIND_MOST_S:
        worst = t[0] if t[0] < 0.0 else t[-1]
        raise SamplesError(
            f"{path}: expected times from 0 to {WIND_MOST_S:g} s of the flight, got {worst:g}"
        )
    return rows


def wind_text(rows: Rows) -> str:
    """The text of float64[n, 4] as `read_wind` reads it again, to the bit."""
    lines = [",".join(WIND), *(",".join(map(repr, row)) for row in rows.tolist())]
    return "\n".join(lines) + "\n"


def write_wind(path: Path, rows: Rows) -> None:
    """Write the same to a file. Raises OSError."""
    path.write_text(wind_text(rows))
