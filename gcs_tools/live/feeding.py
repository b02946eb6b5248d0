"""The publisher's end of the feed: rows and words of the flying processes, as they come."""

from __future__ import annotations

import json
import socket
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fcu.interface import feed
from fcu.kernel.buffers import columns
from fcu.settings import Settings
from gcs_tools.live.ticks import Numbers
from gcs_tools.recording.layout import Rows
from gcs_tools.recording.schema import FCU_COLUMNS, PLANT_COLUMNS

AT_ONCE = 1024  # datagrams taken in one go
SOURCES = 8  # connected at once; two fly
H_MIN = 1e-6  # s, of a control period
HELLO_S = 1.0  # wall: who says nothing for so long is hung up on

WIDTHS = {"fcu": len(FCU_COLUMNS), "plant": len(PLANT_COLUMNS)}
PARAMS = 1 + len(columns(Settings))

_H = 1 + columns(Settings).index("law.h")
_SEQUENCE = {
    "fcu": FCU_COLUMNS.index("timing.sequence"), "plant": PLANT_COLUMNS.index("timing.sequence")
}  # fmt: skip
_EXACT = 2.0**53  # numbers of ticks, and ns, below which a float64 is a whole number
_T_MAX = _EXACT * 1e-9  # s


class FeedError(ValueError):
    """What no flying process of this version sends: in words."""


@dataclass
class Taken:
    """What one process has sent since it was last asked."""

    rows: Rows  # (n, columns of its row)
    sequence: Numbers  # (n,), ascending
    time_ns: Numbers  # (n,)
    params: Rows | None = None  # the law's, with the time before them, if they were told anew
    said: list[dict[str, Any]] = field(default_factory=list)


class Source:
    """One flying process."""

    def __init__(self, connected: socket.socket) -> None:
        """`connected`: its end, non-blocking."""
        self._socket = connected
        self._since = time.monotonic()
        self.pid = feed.peer_pid(connected)
        self.who = ""  # fcu or plant, as it says
        self.ended = False
        self.next = -1  # number of the row that comes next
        self.lost = 0  # rows that did not reach us since it said hello
        self._dropped = 0  # rows for which it had no room before that
        self._buffer = np.zeros((AT_ONCE, max(WIDTHS.values())))
        self._bytes = bytearray(feed.GREATEST_BYTES)

    def take(self) -> Taken:
        """All that is there, at most AT_ONCE datagrams. Raises FeedError: then hang up."""
        n = 0
        said: list[dict[str, Any]] = []
        params: Rows | None = None
        for _ in range(AT_ONCE):
            try:
                size = self._socket.recv_into(self._bytes)
            except BlockingIOError:
                break
            except OSError:
                size = 0
            width = WIDTHS.get(self.who, 0)
            if size == 0:
                self.ended = True
                break
            if size % 8:
                said.append(self._word(bytes(self._bytes[:size])))
            elif size == 8 * width:
                self._buffer[n, :width] = np.frombuffer(self._bytes, "<f8", width)
                n += 1
            elif size == 8 * PARAMS:
                params = np.frombuffer(self._bytes, "<f8", PARAMS).copy()
                if not (
                    np.isfinite(params).all() and _T_MAX > params[0] >= 0.0 and params[_H] > H_MIN
                ):
                    raise FeedError("parameters that are none of a law")
            else:
                raise FeedError(f"rows of {size} bytes (of another version?)")
        if not self.who and time.monotonic() - self._since > HELLO_S:
            raise FeedError("no hello")
        rows = self._buffer[:n, : WIDTHS.get(self.who, 0)].copy()
        taken = Taken(rows, *self._numbers(rows), params, said)
        if said and "bye" in said[-1]:
            self._count_last(said[-1]["dropped"])
        return taken

    def _numbers(self, rows: Rows) -> tuple[Numbers, Numbers]:
        """Of rows their numbers and times, counting those that are missing."""
        n = len(rows)
        if n == 0:
            return np.zeros(0, np.uint64), np.zeros(0, np.uint64)
        sequence, t = rows[:, _SEQUENCE[self.who]], rows[:, 0]
        if not ((sequence >= 0.0) & (sequence < _EXACT) & (t >= 0.0) & (t < _T_MAX)).all():
            raise FeedError("rows without a number or a time")
        first, last = int(sequence[0]), int(sequence[-1])
        if first < self.next or (np.diff(sequence) < 1.0).any():
            raise FeedError("rows that go back")
        if self.next >= 0:
            self.lost += first - self.next
        self.lost += last + 1 - first - n
        self.next = last + 1
        return sequence.astype(np.uint64), np.rint(t * 1e9).astype(np.uint64)

    def _count_last(self, dropped: int) -> None:
        """Rows after the last that has come: by the count of who had no room for them."""
        missing = max(dropped - self._dropped - self.lost, 0)
        self.lost += missing
        if self.next >= 0:
            self.next += missing

    def _word(self, data: bytes) -> dict[str, Any]:
        """What is said, if it is one of the three things that are."""
        try:
            word: dict[str, Any] = json.loads(data)
            if "hello" in word:
                if self.who or word["hello"] not in WIDTHS:
                    raise FeedError("a hello of nobody known")
                self.who, self._dropped = word["hello"], _count(word["dropped"])
            elif "bye" in word:
                word["dropped"] = _count(word["dropped"])
            else:
                word["event"].encode()
                if not 0.0 <= word["t"] < _T_MAX:
                    raise FeedError("an event at no time")
        except FeedError:
            raise
        except (ValueError, AttributeError, KeyError, OverflowError, TypeError, RecursionError):
            raise FeedError("neither rows nor words of ours") from None
        return word

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


def _count(told: Any) -> int:
    """A number of rows. Raises ValueError."""
    if not 0 <= int(told) < _EXACT:
        raise ValueError(f"not a number of rows: {told}")
    return int(told)


class Feeds:
    """All flying processes of one instance."""

    def __init__(self, instance: int) -> None:
        """Raises PortBusy when another publisher listens."""
        self._listener = feed.listen(instance)
        self.sources: list[Source] = []

    def accept(self) -> None:
        """Take in who has come; only of our own user, and not too many."""
        for _ in range(SOURCES):
            try:
                connected, _ = self._listener.accept()
            except OSError:  # nobody, or no file descriptor to spare
                return
            if len(self.sources) >= SOURCES or not feed.is_ours(connected):
                connected.close()
                continue
            connected.setblocking(False)
            self.sources.append(Source(connected))

    def hang_up(self, source: Source) -> None:
        """One has ended, or is not to be heard any more."""
        self.sources.remove(source)
        source.close()

    def close(self) -> None:
        """Hang up on all."""
        self._listener.close()
        for source in self.sources:
            source.close()
