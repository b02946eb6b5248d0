"""Rows of float64 whose columns have names: what a flight flew, or what a recording says."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fcu.kernel.buffers import columns
from gcs_tools.recording.spilled_rows import read_whole

Rows = np.ndarray[Any, np.dtype[np.float64]]


class UnknownColumn(KeyError):
    """A name that no column has."""

    def __str__(self) -> str:
        return f"there is no column {self.args[0]}"


class Table:
    """Rows, and the names of their columns (dotted: `state.r_E.x`)."""

    def __init__(self, rows: Rows, names: Sequence[str]) -> None:
        """rows : (n, len(names))."""
        if rows.shape[1] != len(names):
            raise ValueError(f"{rows.shape[1]} columns and {len(names)} names")
        self.rows = rows
        self.names = tuple(names)
        self._at = {name: i for i, name in enumerate(self.names)}

    @classmethod
    def of(cls, kind: Any, rows: Rows) -> Table:
        """Rows of a NamedTuple class; of rows that go on behind it, its part of them."""
        names = columns(kind)
        return cls(rows[:, : len(names)], names)

    def __len__(self) -> int:
        return len(self.rows)

    def __contains__(self, name: str) -> bool:
        return name in self._at or bool(self._parts(name))

    def __getitem__(self, name: str) -> Rows:
        """One column, (n,), or all of a value, (n, k). Raises UnknownColumn."""
        if (at := self._at.get(name)) is not None:
            return read_whole(self.rows[:, at])
        parts = self._parts(name)
        if not parts:
            raise UnknownColumn(name)
        first, last = parts[0], parts[-1]
        if parts == list(range(first, last + 1)):
            return read_whole(self.rows[:, first : last + 1])
        value: Rows = self.rows[:, parts]
        return value

    def _parts(self, name: str) -> list[int]:
        return [i for other, i in self._at.items() if other.startswith(f"{name}.")]

    def rows_of(self, kind: Any) -> Rows:
        """Rows of a NamedTuple class, float64 (n, size(kind))."""
        return np.stack([self[name] for name in columns(kind)], axis=1)

    def take(self, which: Any) -> Table:
        """Some of the rows: a slice, indices or bool (n,). Consecutive ones are not copied."""
        if isinstance(which, np.ndarray):
            at = np.flatnonzero(which) if which.dtype == bool else which
            if len(at) and (np.diff(at) == 1).all():
                which = slice(int(at[0]), int(at[-1]) + 1)
        return Table(self.rows[which], self.names)

    def axes(self, name: str, of: str = "xyz") -> list[Rows]:
        """The components of a Vec3."""
        return [self[f"{name}.{axis}"] for axis in of]
