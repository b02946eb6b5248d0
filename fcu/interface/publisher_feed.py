"""Ticks handed to a publisher on this machine: one datagram each, never waited for.

The publisher listens; a flying process connects when it finds one, and goes on looking once in
a while when it does not. A datagram for which there is no room is dropped and counted. Who
listens, stalls or dies makes no difference to the flight.

A datagram that is a whole number of float64 is a row; any other is JSON, something said:
`hello` first, then what happened, `reset` where rows begin again, `bye` at the end.

The socket is a SOCK_SEQPACKET in Linux's abstract namespace: whole datagrams, in order, an end
that shows, no file to clean up, and like a port it belongs to a network namespace. A send costs
half of what UDP costs. Elsewhere there is none, and nothing is published.
"""

from __future__ import annotations

import json
import os
import socket
import struct
import sys
import time
from typing import Any

import numpy as np

from fcu.interface.event_log import Event, as_json
from fcu.interface.link import PortBusy

LOOK_S = (
    0.1  # wall: between two looks for a publisher, who waits so long for us: `publisher.KNOCK_S`
)
ROOM_BYTES = 1 << 20  # asked of the system for datagrams on their way; it grants twice that
FOR_WORDS = 8  # one part of so many is kept for what is said: it goes through when rows do not
GREATEST_BYTES = 1 << 16  # of one datagram
SUPPORTED = sys.platform == "linux"

_CREDENTIALS = struct.Struct("3i")  # pid, uid, gid


def address(instance: int) -> str:
    """Where the publisher of an instance listens."""
    return f"\0m-mrac/feed/{instance}"


def listen(instance: int) -> socket.socket:
    """The publisher's end, non-blocking. Raises PortBusy when there is one already."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        listener.bind(address(instance))
        listener.listen()
    except OSError as error:
        listener.close()
        raise PortBusy(instance, f"feed of instance {instance}") from error
    listener.setblocking(False)
    return listener


def is_ours(connected: socket.socket) -> bool:
    """Whether the process at the other end is of the same user."""
    return _credentials(connected)[1] == os.getuid()


def peer_pid(connected: socket.socket) -> int:
    """The process at the other end."""
    return _credentials(connected)[0]


def _credentials(connected: socket.socket) -> tuple[int, int, int]:
    raw = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    pid, uid, gid = _CREDENTIALS.unpack(raw)
    return pid, uid, gid


class PublisherFeed:
    """A flying process's end."""

    def __init__(self, instance: int | None, who: str, law: str = "") -> None:
        """`who`: "fcu" or "plant".  `law`: that the rows are of, if they are of one.

        `instance`: whose publisher is looked for; None: nothing is published.
        """
        self._address = None if instance is None else address(instance)
        self._hello = {"hello": who, "pid": os.getpid(), "law": law}
        self._socket: socket.socket | None = None
        self._room = 0  # what was granted, as it is asked for
        self._due = 0.0
        self.dropped = 0  # rows for which there was no room, while there was a publisher

    def find(self, now: float) -> bool:
        """Look for a publisher if it is time to (`now`: wall, s); whether one has just been found."""
        if self._address is None or self._socket is not None or now < self._due or not SUPPORTED:
            return False
        self._due = now + LOOK_S
        found = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        found.setblocking(False)
        try:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ROOM_BYTES)
            self._room = found.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) // 2
            found.connect(self._address)
            if not is_ours(found):
                raise PermissionError("the publisher is another user's")
        except OSError:
            found.close()
            return False
        self._socket = found
        self.say(self._hello | {"dropped": self.dropped})
        return True

    def fileno(self) -> int:
        """The descriptor of the publisher, to which compiled code may send rows; -1 without one.

        Of rows that it could not send it tells by `missed`.
        """
        return -1 if self._socket is None else self._socket.fileno()

    def send(self, row: np.ndarray[Any, Any]) -> None:
        """Hand on one row."""
        if self._socket is None:
            return
        try:
            self._socket.send(row)  # type: ignore[arg-type]  # a buffer, to Python 3.12
        except BlockingIOError:
            self.dropped += 1
        except OSError:
            self._lose()

    def send_rows(self, rows: np.ndarray[Any, Any], dropped_at: int) -> None:
        """Hand on many, (n, width); each tells in a column how many were dropped before it."""
        if self._socket is not None:
            for row in rows:
                row[dropped_at] = self.dropped
                self.send(row)

    def missed(self, rows: int, last: np.ndarray[Any, Any] | None) -> None:
        """So many rows did not go out from compiled code, which does not ask why.

        last : the last of them, if no row has gone out after it; it is tried once more. Only who
        is still there had no room.
        """
        if last is not None:
            self.send(last)
        if self._socket is not None:
            self.dropped += rows - (last is not None)

    def tell(self, data: bytes) -> None:
        """Hand on what is rare and matters, if need be through the room that rows are kept off."""
        if self._socket is None:
            return
        self._keep_for_words(0)
        try:
            self._socket.send(data)
        except BlockingIOError:
            pass  # as much has been told already that nobody has taken
        except OSError:
            self._lose()
            return
        self._keep_for_words(self._room // FOR_WORDS)

    def say(self, said: dict[str, Any]) -> None:
        """Hand on what is no row."""
        data = json.dumps(said).encode()
        self.tell(data if len(data) % 8 else data + b" ")

    def event(self, event: Event) -> None:
        """Hand on something that happened."""
        self.say(as_json(event._replace(t=max(event.t, 0.0))))

    def reset(self) -> None:
        """The rows that follow begin again, at time 0."""
        self.say({"reset": self._hello["hello"]})

    def _keep_for_words(self, size: int) -> None:
        assert self._socket is not None
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, self._room - size)

    def _lose(self) -> None:
        assert self._socket is not None
        self._socket.close()
        self._socket = None
        self._due = time.monotonic() + LOOK_S

    def close(self) -> None:
        """The publisher sees the end, and hears what has not reached it."""
        self.say({"bye": self._hello["hello"], "dropped": self.dropped})
        if self._socket is not None:
            self._lose()
