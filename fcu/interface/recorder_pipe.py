"""Rows of float64 handed to whoever records the flight, a batch at a time, through a pipe.

A row is copied, not converted: ticks are written straight into the batch. In lockstep
the flight waits for its recorder, so a recording is complete. In real time it must not:
the pipe is then non-blocking, and a batch that does not fit is dropped and counted.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np

BATCH = 64  # rows; at 500 Hz an eighth of a second
FULL_SPEED_BATCH = 256  # rows, where nobody waits for the latest
PIPE_BYTES = 1 << 20

Row = np.ndarray[Any, np.dtype[np.float64]]


class Tape:
    """Rows, written in place and handed over a batch at a time."""

    def __init__(self, width: int, batch: int, take: Callable[[Row], None]) -> None:
        """`width`: float64 in a row. `take`: is handed a batch, (n, width), to be copied or used up."""
        self._batch = np.zeros((batch, width))
        self._rows = [self._batch[i] for i in range(batch)]
        self._next = 0
        self._take = take
        self.dropped = 0

    def row(self) -> Row:
        """The row to write next. It stays readable until rows are written over it."""
        row: Row = self._rows[self._next]
        return row

    def free(self) -> Row:
        """The rows to write next, (n, width): those of this batch that are left, one at least."""
        return self._batch[self._next :]

    def done(self, rows: int = 1) -> None:
        """So many rows have been written."""
        self._next += rows
        if self._next == len(self._batch):
            self.flush()

    def flush(self) -> None:
        """Hand over what there is. Raises what `take` raises."""
        rows, self._next = self._next, 0
        if rows:
            self._take(self._batch[:rows])


class RecorderPipe(Tape):
    """The writing end. Without a file descriptor rows are kept no longer than a batch.

    Handing over raises BrokenPipeError when nobody reads any more.
    """

    def __init__(
        self, width: int, fd: int | None = None, wait: bool = True, batch: int = BATCH
    ) -> None:
        """`width`: float64 in a row. `wait`: block while the pipe is full (lockstep).

        `batch`: rows that are handed over at once.
        """
        super().__init__(width, batch, self._write)
        self._fd = fd
        self._left = b""
        if fd is not None:
            os.set_blocking(fd, wait)
            _widen(fd)

    def _write(self, batch: Row) -> None:
        if self._fd is None:
            return
        data, rows = batch.data.cast("B"), len(batch)
        if self._left:  # the tail of a batch that half fitted: rows must stay whole
            try:
                self._left = self._left[os.write(self._fd, self._left) :]
            except BlockingIOError:
                pass
            if self._left:
                self.dropped += rows
                return
        left = data
        while left:
            try:
                left = left[os.write(self._fd, left) :]
            except BlockingIOError:
                if len(left) == len(data):
                    self.dropped += rows
                else:
                    self._left = bytes(left)
                return


def _widen(fd: int) -> None:
    """A pipe that holds a second or two, where the system lets us."""
    try:
        import fcntl

        fcntl.fcntl(fd, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
    except (ImportError, AttributeError, OSError):
        pass
