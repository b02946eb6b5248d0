"""Rows of a process as they come, in one array: in memory once, or, of a long flight, in a file."""

from __future__ import annotations

from contextlib import suppress

from gcs_tools.recording.spilled_rows import LARGE, Rows, Spill, in_memory

ROOM = 1 << 18  # rows to begin with, at most: memory is taken when it is written to


class FlownRows:
    """Rows of one process; one thread appends them while others look."""

    def __init__(self, width: int, expected: int) -> None:
        """`width`: columns that are kept; the first of each row. `expected`: so many rows, or fewer."""
        self._spill: Spill | None = None
        if expected * width * 8 > LARGE:
            with suppress(OSError):
                self._spill = Spill(expected, width)
        room = max(1, min(expected, ROOM))
        self._all = in_memory(room, width) if self._spill is None else self._spill.array
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
        if n > len(self._all) or not self._has_disk(n):
            larger = in_memory(max(n, 2 * self._n), width)
            larger[: self._n] = self._all[: self._n]
            self._all, self._spill = larger, None
        self._all[self._n : n] = rows[:, :width]
        self._n = n

    def _has_disk(self, n: int) -> bool:
        """Return True if so many rows have room where they are kept."""
        if self._spill is None:
            return True
        try:
            self._spill.reserve(n)
        except OSError:
            return False
        return True
