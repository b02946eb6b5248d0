"""The clock of a script whose time is held: simulation time, told to the Python programs of a script.

A Python program finds the clock by its environment (held_python/sitecustomize.py). It reads the time from
shared memory, and says on a socket until when it sleeps. Who holds time wakes it then.
"""

from __future__ import annotations

import math
import mmap
import os
import secrets
import select
import socket
import struct
from contextlib import suppress
from pathlib import Path

NAME = "M_MRAC_HELD"  # environment: NAME of a socket, PATH of the shared time
SAYS = struct.Struct(
    "<id"
)  # process, and until when a thread of it sleeps, s; infinity: it does not
PYTHON = Path(__file__).with_name("held_python")  # for PYTHONPATH
CLOSE_S = 1e-9  # a time that is over but for rounding is over
_WAKE = b"\1"
_PEER = struct.Struct("iII")  # process, user and group at the other end


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
        self._until_s: dict[int, float] = {}  # file number of a connection -> until when it sleeps
        self._connections = {self._listener.fileno(): self._listener}
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
        """Wake the thread that sleeps until the earliest time, if that is over. Returns whether there is one.

        To be called while all sleep, and again when all sleep again: one at a time, so that what they
        do has one order.
        """
        self._hear()
        if not self._until_s:
            return False
        first = min(self._until_s, key=self._until_s.__getitem__)
        if self._until_s[first] > time_s + CLOSE_S:
            return False
        self._until_s[first] = math.inf
        with suppress(OSError):  # it has ended
            self._connections[first].send(_WAKE)
        return True

    def close(self) -> None:
        """Close all connections. Who still sleeps wakes, and finds that there is no clock."""
        for each in self._connections.values():
            each.close()
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
            if _PEER.unpack(told)[1] != os.getuid():
                connection.close()
                return
            connection.setblocking(False)
            self._connections[connection.fileno()] = connection
            self._poll.register(connection, select.POLLIN)

    def _listen(self, number: int) -> None:
        said = b""
        with suppress(OSError):
            said = self._connections[number].recv(64)
        if len(said) != SAYS.size:
            self._poll.unregister(number)
            self._connections.pop(number).close()
            self._until_s.pop(number, None)
            return
        pid, until_s = SAYS.unpack(said)
        self.heard.add(pid)
        self._until_s[number] = until_s
