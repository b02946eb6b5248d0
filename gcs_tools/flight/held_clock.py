"""The clock of a script whose time is held: simulation time, told to the Python programs of a script.

A Python program finds the clock by its environment (held_python/sitecustomize.py). It reads the time from
shared memory. A thread of it that waits says on a socket until when, and for which files, and waits
there. Who holds time wakes one such thread at a time: what they do has one order.
"""

from __future__ import annotations

import math
import mmap
import os
import secrets
import select
import socket
import struct
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

NAME = "M_MRAC_HELD"  # environment: NAME of a socket, PATH of the shared time
SAYS = struct.Struct("<d")  # until when a thread waits, s
EVENTS = struct.Struct("<h")  # behind it, for each file that is sent along: what it waits for there
FILES = 250  # of a wait, at most: a datagram takes no more along
PYTHON = Path(__file__).with_name("held_python")  # for PYTHONPATH
CLOSE_S = 1e-9  # a time that is over but for rounding is over
_WAKE = b"\1"
_PEER = struct.Struct("iII")  # process, user and group at the other end


@dataclass
class _Thread:
    """A thread of a program, at the other end of its connection."""

    connection: socket.socket
    until_s: float = math.inf
    waits: bool = False
    files: list[int] = field(default_factory=list)  # copies, of those that it waits for
    poll: select.poll = field(default_factory=select.poll)

    def is_due(self, time_s: float) -> bool:
        """True if it waits, and what it waits for is there."""
        if not self.waits:
            return False
        return self.until_s <= time_s + CLOSE_S or bool(self.files and self.poll.poll(0))

    def wait(self, until_s: float, files: Sequence[int], events: Sequence[int]) -> None:
        self.waits, self.until_s, self.files = True, until_s, list(files)
        for file, event in zip(files, events, strict=True):
            self.poll.register(file, event)

    def wake(self) -> None:
        self.forget()
        with suppress(OSError):  # it has ended
            self.connection.send(_WAKE)

    def forget(self) -> None:
        self.waits = False
        for file in self.files:
            self.poll.unregister(file)
            os.close(file)
        self.files = []


class HeldClock:
    """Simulation time, and who sleeps until when. Of one user, and gone with its process."""

    def __init__(self) -> None:
        self._memory = os.memfd_create("held")
        os.ftruncate(self._memory, 8)
        self._time = mmap.mmap(self._memory, 8)
        self._name = f"m-mrac-held-{os.getpid()}-{secrets.token_hex(8)}"
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listener.bind(f"\0{self._name}")  # abstract: no file is left behind
        self._listener.listen(1024)
        self._listener.setblocking(False)
        self._threads: dict[int, _Thread] = {}  # by file number of the connection, in their order
        self._last = 0  # that was woken: the others come first
        self._poll = select.poll()
        self._poll.register(self._listener, select.POLLIN)
        self.heard: set[int] = set()  # processes whose time is held
        self.set(0.0)

    def environment(self) -> dict[str, str]:
        """What a program needs to find the clock, and to be the same each time."""
        paths = [str(PYTHON), *filter(None, [os.environ.get("PYTHONPATH")])]
        shared = f"/proc/{os.getpid()}/fd/{self._memory}"
        return {
            NAME: f"{self._name} {shared}", "PYTHONPATH": os.pathsep.join(paths), "PYTHONHASHSEED": "0",
        }  # fmt: skip

    def set(self, time_s: float) -> None:
        """Tell the time, s of simulation."""
        self._time[:] = struct.pack("<d", time_s)

    def wake(self, time_s: float) -> bool:
        """Wake a thread for which there is something, one after the other. Returns whether there is one.

        To be called while all sleep, and again when all sleep again.
        """
        self._hear()
        numbers = list(self._threads)
        first = numbers.index(self._last) + 1 if self._last in self._threads else 0
        for number in numbers[first:] + numbers[:first]:
            if self._threads[number].is_due(time_s):
                self._last = number
                self._threads[number].wake()
                return True
        return False

    def close(self) -> None:
        """Close all connections. Who still waits finds that there is no clock, and ends."""
        for each in self._threads.values():
            each.forget()
            each.connection.close()
        self._listener.close()
        self._time.close()
        os.close(self._memory)

    def _hear(self) -> None:
        """Take in what all have said. Of one that has said more, the last counts."""
        while ready := self._poll.poll(0):
            for number, _ in ready:
                if number == self._listener.fileno():
                    self._accept()
                else:
                    self._listen(number)

    def _accept(self) -> None:
        with suppress(OSError):  # it has ended again
            connection, _ = self._listener.accept()
            told = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
            pid, user, _ = _PEER.unpack(told)
            if user != os.getuid():
                connection.close()
                return
            self.heard.add(pid)
            connection.setblocking(False)
            self._threads[connection.fileno()] = _Thread(connection)
            self._poll.register(connection, select.POLLIN)

    def _listen(self, number: int) -> None:
        """Take in what a thread says: until when it waits, and for what. Let go of one that has ended."""
        thread, said = self._threads[number], b""
        files: list[int] = []
        with suppress(OSError):
            said, files, _, _ = socket.recv_fds(thread.connection, 4096, FILES)
        thread.forget()
        if len(said) != SAYS.size + EVENTS.size * len(files):
            for file in files:
                os.close(file)
            self._poll.unregister(number)
            del self._threads[number]
            thread.connection.close()
            return
        (until_s,) = SAYS.unpack_from(said)
        thread.wait(until_s, files, [each for (each,) in EVENTS.iter_unpack(said[SAYS.size :])])
