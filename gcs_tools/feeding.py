"""The publisher's end of the feed: rows and words of the flying processes, as they come."""

from __future__ import annotations

import json
import socket
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fcu.interface import feed
from fcu.kernel.buffers import columns
from fcu.law.types import LawParams
from gcs_tools.layout import Rows
from gcs_tools.schema import FCU_COLUMNS, PLANT_COLUMNS

AT_ONCE = 1024  # rows taken in one go

WIDTHS = {"fcu": len(FCU_COLUMNS), "plant": len(PLANT_COLUMNS)}
PARAMS = 1 + len(columns(LawParams))


@dataclass
class Taken:
    """What one process has sent since it was last asked."""

    rows: Rows  # (n, columns of its row)
    params: Rows | None = None  # the law's, with the time before them, if they were told anew
    said: list[dict[str, Any]] = field(default_factory=list)


class Source:
    """One flying process."""

    def __init__(self, connected: socket.socket) -> None:
        """`connected`: its end, non-blocking."""
        self._socket = connected
        self.who = ""  # fcu or plant, as it says
        self.ended = False
        self._buffer = np.zeros((AT_ONCE, max(WIDTHS.values())))
        self._bytes = bytearray(feed.GREATEST_BYTES)

    def take(self) -> Taken:
        """All that is there, at most AT_ONCE rows. What is neither row nor JSON is passed over."""
        n = 0
        said: list[dict[str, Any]] = []
        params: Rows | None = None
        width = WIDTHS.get(self.who, 0)
        while n < AT_ONCE:
            try:
                size = self._socket.recv_into(self._bytes)
            except BlockingIOError:
                break
            except OSError:
                size = 0
            if size == 0:
                self.ended = True
                break
            if size == 8 * width:
                self._buffer[n, :width] = np.frombuffer(self._bytes, "<f8", width)
                n += 1
            elif size == 8 * PARAMS:
                params = np.frombuffer(self._bytes, "<f8", PARAMS).copy()
            elif size % 8:
                word = _json(bytes(self._bytes[:size]))
                said.append(word)
                if word.get("hello") in WIDTHS and not self.who:
                    self.who = word["hello"]
                    width = WIDTHS[self.who]
        return Taken(self._buffer[:n, :width].copy(), params, said)

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


def _json(data: bytes) -> dict[str, Any]:
    try:
        said = json.loads(data)
    except ValueError:
        return {}
    return said if isinstance(said, dict) else {}


class Feeds:
    """All flying processes of one instance."""

    def __init__(self, instance: int) -> None:
        """Raises PortBusy when another publisher listens."""
        self._listener = feed.listen(instance)
        self.sources: list[Source] = []

    def accept(self) -> None:
        """Take in who has come; only of our own user."""
        while True:
            try:
                connected, _ = self._listener.accept()
            except BlockingIOError:
                return
            if not feed.is_ours(connected):
                connected.close()
                continue
            connected.setblocking(False)
            self.sources.append(Source(connected))

    def close(self) -> None:
        """Hang up on all."""
        self._listener.close()
        for source in self.sources:
            source.close()
