"""Room for the rows of a long flight: in a file without a name, and in memory only while they are used.

The file holds column after column, so reading a column touches its own pages alone. Pages that were
written or read leave memory when `let_go` is called. The numbers stay in the file.
"""

from __future__ import annotations

import mmap
import os
import tempfile
import weakref
from typing import Any

import numpy as np

Rows = np.ndarray[Any, np.dtype[np.float64]]

LARGE = 128 << 20  # bytes: rows that take no more stay in memory
STRETCH = 1 << 13  # rows that the disk is asked for at a time


class RowFile(mmap.mmap):
    """The pages of a file without a name."""


def in_memory(rows: int, width: int) -> Rows:
    """Return an array of so many rows, whose memory comes page by page.

    NumPy asks for huge pages for a large array, and the kernel may stop a flight for as long again to
    find them.
    """
    pages = mmap.mmap(-1, rows * width * 8, access=mmap.ACCESS_COPY)
    return np.frombuffer(pages).reshape(rows, width)


class Spill:
    """A file that grows with its rows. Its array has room for all of them from the start."""

    def __init__(self, rows: int, width: int) -> None:
        """Make the file, without a byte on disk. Raises OSError."""
        self._n, self._width, self._reserved = rows, width, 0
        with tempfile.TemporaryFile() as file:
            file.truncate(rows * width * 8)
            self._pages = RowFile(file.fileno(), rows * width * 8)
            self._file = os.dup(file.fileno())
        weakref.finalize(self, os.close, self._file)
        self.array: Rows = np.frombuffer(self._pages).reshape(width, rows).T

    def reserve(self, rows: int) -> None:
        """Have room on disk for so many rows. Raises OSError where the disk is full.

        Without it a write to the array would end the process there.
        """
        if rows <= self._reserved:
            return
        to = min(self._n, -(-rows // STRETCH) * STRETCH)
        for column in range(self._width):
            begin = 8 * (column * self._n + self._reserved)
            os.posix_fallocate(self._file, begin, 8 * (to - self._reserved))
        self._reserved = to
        self._pages.madvise(mmap.MADV_DONTNEED)


def file_of(rows: Rows) -> RowFile | None:
    """Return the file that an array, or what it is a view of, is in. None: it is in memory."""
    base: Any = rows
    while isinstance(base, np.ndarray):
        base = base.base
    if isinstance(base, memoryview):
        base = base.obj
    return base if isinstance(base, RowFile) else None


def read_whole(rows: Rows) -> Rows:
    """Return an array in memory as it is, and a copy of one that is in a file, whose pages leave memory."""
    file = file_of(rows)
    if file is None:
        return rows
    copied = rows.copy()
    file.madvise(mmap.MADV_DONTNEED)
    return copied
