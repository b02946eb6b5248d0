"""Room for the rows of a long flight: in a file without a name, and in memory only while they are used.

The file holds column after column, and a column is read from the file as one piece. Pages that were
written leave memory as more rows come. The numbers stay in the file.
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
WRITTEN = 1 << 11  # rows of which pages may be in memory since they were written


class RowFile(mmap.mmap):
    """The pages of a file without a name, in the order in which the file holds them."""

    file: int  # descriptor

    def read(self, at: int, into: Rows) -> None:  # type: ignore[override]
        """Fill a contiguous array from byte `at` of the file on, without a page of it in memory."""
        left = memoryview(into.view(np.uint8))  # type: ignore[arg-type]  # a buffer, to Python 3.12
        while len(left):
            n = os.preadv(self.file, [left], at)
            if n == 0:
                raise EOFError("rows beyond the end of their file")
            at, left = at + n, left[n:]


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
        self._n, self._width, self._reserved, self._gone = rows, width, 0, 0
        with tempfile.TemporaryFile() as file:
            file.truncate(rows * width * 8)
            self._pages = RowFile(file.fileno(), rows * width * 8)
            self._file = self._pages.file = os.dup(file.fileno())
        weakref.finalize(self._pages, os.close, self._file)
        # a page at a time: reading ahead brings pages of rows to come, many at once, for each column
        self._pages.madvise(mmap.MADV_RANDOM)
        self.array: Rows = np.frombuffer(self._pages).reshape(width, rows).T

    def reserve(self, rows: int) -> None:
        """Have room on disk for so many rows. Raises OSError where the disk is full.

        Without it a write to the array would end the process there.
        """
        if rows - self._gone > WRITTEN:
            self._pages.madvise(mmap.MADV_DONTNEED)
            self._gone = rows
        if rows <= self._reserved:
            return
        to = min(self._n, -(-rows // STRETCH) * STRETCH)
        for column in range(self._width):
            begin = 8 * (column * self._n + self._reserved)
            os.posix_fallocate(self._file, begin, 8 * (to - self._reserved))
        self._reserved = to


def file_of(rows: Rows) -> tuple[RowFile, int] | None:
    """Return the file that an array, or what it is a view of, is in, and at which byte it begins.

    None: it is in memory.
    """
    base: Any = rows
    while isinstance(base, np.ndarray):
        base = base.base
    if isinstance(base, memoryview):
        base = base.obj
    if not isinstance(base, RowFile):
        return None
    return base, _address(rows) - _address(np.frombuffer(base))


def _address(array: Rows) -> int:
    begin: int = array.__array_interface__["data"][0]
    return begin


def read_whole(rows: Rows) -> Rows:
    """Return columns (n,) or (n, k) in memory as they are, and a copy of such that are in a file."""
    found = file_of(rows)
    if found is None:
        return rows
    file, at = found
    copied = np.empty(rows.shape)
    if rows.ndim == 1 and rows.strides == (8,):
        file.read(at, copied)
        return copied
    if rows.ndim == 1 or rows.strides[0] != 8:
        return rows.copy()
    column = np.empty(len(rows))
    for i in range(rows.shape[1]):
        file.read(at + i * rows.strides[1], column)
        copied[:, i] = column
    return copied
