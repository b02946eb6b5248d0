"""The rows of a flight as they come, in one array: what was flown is in memory once, not twice."""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np

Rows = np.ndarray[Any, np.dtype[np.float64]]

ROOM = 1 << 18  # rows to begin with, at most: memory is taken when it is written to


def _room(rows: int, width: int) -> Rows:
    """An array of so many rows, whose memory comes page by page.

    NumPy asks for huge pages for what is large, and the kernel may stop a flight for as long again to
    find them.
    """
    pages = mmap.mmap(-1, rows * width * 8, access=mmap.ACCESS_COPY)
    return np.frombuffer(pages).reshape(rows, width)


class FlownRows:
    """Rows of one process; one thread appends them while others look."""

    def __init__(self, width: int, expected: int) -> None:
        """`width`: columns that are kept; the first of each row. `expected`: so many rows, or fewer."""
        self._all = _room(max(1, min(expected, ROOM)), width)
        self._n = 0

    def __len__(self) -> int:
        return self._n

    @property
    def rows(self) -> Rows:
        """All so far, (n, width): a view, which later ones do not change."""
        n = self._n  # before the array: a newer one holds as many, and more
        return self._all[:n]

    @property
    def last(self) -> Rows:
        """The last one, (1, width), if there is any."""
        return self.rows[-1:]

    def append(self, rows: Rows) -> None:
        """Keep the first columns of some more, (k, at least width)."""
        n, width = self._n + len(rows), self._all.shape[1]
        if n > len(self._all):
            larger = _room(max(n, 2 * len(self._all)), width)
            larger[: self._n] = self._all[: self._n]
            self._all = larger
        self._all[self._n : n] = rows[:, :width]
        self._n = n
