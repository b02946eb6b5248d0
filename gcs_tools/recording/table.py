"""Rows of float64 whose columns have names: what a flight flew, or what a recording says."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fcu.kernel.buffers import columns
from gcs_tools.recording.spilled_rows import read_whole

Rows = np.ndarray[Any, np.dtype[np.float64]]
Indices = np.ndarray[Any, np.dtype[np.int64]]


HALF_US = 0.5e-6  # s: ticks fall on whole microseconds, so a time is met by rounding


class UnknownColumn(KeyError):
    """A name that no column has."""

    def __str__(self) -> str:
        return f"there is no column {self.args[0]}"


class Table:
    """Rows, and the names of their columns (dotted: `state.r_E.x`)."""

    def __init__(self, rows: Rows, names: Sequence[str], which: Indices | None = None) -> None:
        """rows : (n, len(names)).  which : int (m,), those that are its rows (None: all)."""
        if rows.shape[1] != len(names):
            raise ValueError(f"{rows.shape[1]} columns and {len(names)} names")
        self._rows, self._which = rows, which
        self.names = tuple(names)
        self._at = {name: i for i, name in enumerate(self.names)}

    @classmethod
    def of(cls, kind: Any, rows: Rows) -> Table:
        """Rows of a NamedTuple class; of rows that go on behind it, its part of them."""
        names = columns(kind)
        return cls(rows[:, : len(names)], names)

    @property
    def rows(self) -> Rows:
        """All columns, (n, len(names))."""
        return self._rows if self._which is None else self._rows[self._which]

    def __len__(self) -> int:
        return len(self._rows if self._which is None else self._which)

    def __contains__(self, name: str) -> bool:
        return name in self._at or bool(self._parts(name))

    def __getitem__(self, name: str) -> Rows:
        """One column, (n,), or all of a value, (n, k). Raises UnknownColumn."""
        if (at := self._at.get(name)) is not None:
            return self._read(at)
        parts = self._parts(name)
        if not parts:
            raise UnknownColumn(name)
        first, last = parts[0], parts[-1]
        if parts == list(range(first, last + 1)):
            return self._read(slice(first, last + 1))
        return self._read(parts)

    def _read(self, at: Any) -> Rows:
        """Return columns in memory: of a long flight they are in a file."""
        which = self._which
        if which is None:
            return read_whole(self._rows[:, at])
        if not len(which):
            return self._rows[:0, at]
        first = int(which.min())
        return read_whole(self._rows[first : int(which.max()) + 1, at])[which - first]

    def _parts(self, name: str) -> list[int]:
        return [i for other, i in self._at.items() if other.startswith(f"{name}.")]

    def rows_of(self, kind: Any) -> Rows:
        """Rows of a NamedTuple class, float64 (n, size(kind))."""
        return np.stack([self[name] for name in columns(kind)], axis=1)

    def take(self, which: Any) -> Table:
        """Some of the rows: a slice, indices or bool (n,). None is copied before a column is read."""
        if not isinstance(which, slice):
            which = _consecutive(np.asarray(which), len(self))
        if self._which is not None:
            return Table(self._rows, self.names, self._which[which])
        if isinstance(which, slice):
            return Table(self._rows[which], self.names)
        return Table(self._rows, self.names, which)

    def axes(self, name: str, of: str = "xyz") -> list[Rows]:
        """The components of a Vec3."""
        return [self[f"{name}.{axis}"] for axis in of]


def _consecutive(which: np.ndarray[Any, Any], n: int) -> slice | Indices:
    """Return indices or flags of n rows as a slice where they are consecutive, and else as indices."""
    if which.dtype == bool:
        up = int(np.count_nonzero(which))
        first = int(np.argmax(which)) if up else 0
        whole = which[first : first + up].all()
        return slice(first, first + up) if whole else np.flatnonzero(which)
    which = np.where(which < 0, which + n, which)  # from the end
    steps_by_one = len(which) > 0 and bool((np.diff(which) == 1).all())
    return slice(int(which[0]), int(which[-1]) + 1) if steps_by_one else which.astype(np.int64)
