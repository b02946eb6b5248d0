"""Samples of wind over time from a Parquet file: the columns of its CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface.files import input_file
from fcu.interface.samples_file import WIND, WIND_SAMPLES, SamplesError, checked_wind

Rows = np.ndarray[Any, np.dtype[np.float64]]

SUFFIXES = (".parquet", ".pq")


def read_wind(path: Path) -> Rows:
    """Read float64[n, 4] of a file of wind: s, and m/s to East, North and Up. Raises SamplesError."""
    try:
        from pyarrow import ArrowException, parquet
    except ImportError as error:
        raise SamplesError(f"{path}: Parquet needs pyarrow: pip install pyarrow") from error
    try:
        with input_file.opened(path) as file:
            of = parquet.ParquetFile(file)
            names = of.schema_arrow.names
            if lacking := [name for name in WIND if name not in names]:
                raise SamplesError(
                    f"{path}: expected columns {', '.join(WIND)}; {', '.join(lacking)} missing"
                )
            if twice := [name for name in WIND if names.count(name) > 1]:
                raise SamplesError(
                    f"{path}: expected one column {twice[0]}, got {names.count(twice[0])}"
                )
            if of.metadata.num_rows > WIND_SAMPLES:
                raise SamplesError(f"{path}: more than {WIND_SAMPLES} samples")
            table = of.read(columns=list(WIND))
            rows = np.stack([np.asarray(table[name].cast("double")) for name in WIND], axis=-1)
    except SamplesError:
        raise
    except (ArrowException, OSError, ValueError, LookupError) as error:
        if (
            isinstance(error, OSError) and error.strerror
        ):  # pyarrow's own, of damaged bytes, has none
            raise SamplesError(f"{path}: {error.strerror}") from error
        why = input_file.shortened(input_file.plain(str(error)))
        raise SamplesError(f"{path}: expected a Parquet file of numbers ({why})") from error
    return checked_wind(rows.astype(np.float64), path)
