"""Processes that wait, as Linux tells: a program has answered what it was sent when all its threads sleep."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable

AVAILABLE = sys.platform == "linux"

Asleep = dict[tuple[int, str], bytes]  # process, thread -> how often it was switched out
_ENDED = b"", b"Z", b"X"


def with_descendants(pids: Iterable[int]) -> list[int]:
    """These processes, and all that they have started. Those that have ended are left out."""
    found: list[int] = []
    waiting = list(pids)
    while waiting:
        pid = waiting.pop()
        found.append(pid)
        try:
            threads = os.listdir(f"/proc/{pid}/task")
        except OSError:
            continue
        for thread in threads:
            waiting += map(int, _read(f"/proc/{pid}/task/{thread}/children").split())
    return found


class Sleepers:
    """Processes, and all that they start, of which somebody waits that they sleep."""

    def __init__(self, pids: Iterable[int]) -> None:
        self._pids = list(pids)
        self._seen: Asleep | None = None
        self._before: Asleep = {}  # the last time that all slept
        self.ran: set[int] = set()  # processes of which a thread ran, for who asks to take away

    def have_slept(self) -> bool:
        """True if all their threads sleep, and none has run since this was last asked.

        A thread that ran was switched out once more before it sleeps again. One that is new was started
        by one that ran.
        """
        if self._seen is not None and _still_sleep(self._seen):
            return True
        self._seen = _all_sleep(self._pids)
        if self._seen is not None:
            before, self._before = self._before, self._seen
            self.ran |= {pid for (pid, at), n in self._seen.items() if before.get((pid, at)) != n}
        return False

    @property
    def pids(self) -> set[int]:
        """The processes that were there when all slept."""
        return {pid for pid, _ in self._seen or ()}


def _all_sleep(pids: Iterable[int]) -> Asleep | None:
    """The threads of these processes and of all that they have started. None if one of them runs."""
    found: Asleep = {}
    for pid in with_descendants(pids):
        try:
            threads = os.listdir(f"/proc/{pid}/task")
        except OSError:
            continue
        for thread in threads:
            told = _read(f"/proc/{pid}/task/{thread}/status")
            state = _state(told)
            if state in _ENDED:
                continue
            if state != b"S":
                return None
            found[pid, thread] = _switches(told)
    return found


def _still_sleep(seen: Asleep) -> bool:
    """True if each of these threads sleeps as it did when it was seen."""
    for (pid, thread), switches in seen.items():
        told = _read(f"/proc/{pid}/task/{thread}/status")
        if _state(told) != b"S" or _switches(told) != switches:
            return False
    return True


def has_ended(pid: int) -> bool:
    """True if the process is gone, or has only its exit code left."""
    return _state(_read(f"/proc/{pid}/status")) in _ENDED


def has_socket(pid: int) -> bool:
    """True if the process has a socket open."""
    try:
        files = os.listdir(f"/proc/{pid}/fd")
    except OSError:
        return False
    for file in files:
        try:
            if os.readlink(f"/proc/{pid}/fd/{file}").startswith("socket:"):
                return True
        except OSError:
            continue
    return False


def _state(status: bytes) -> bytes:
    """The letter of a thread's state."""
    return status.partition(b"\nState:\t")[2][:1]


def _switches(status: bytes) -> bytes:
    """How often a thread was switched out, voluntarily and not, as the last two lines say."""
    return status[status.rfind(b"\nvoluntary_ctxt_switches:") :]


def _read(path: str) -> bytes:
    """A file of /proc. Empty for one that is gone."""
    try:
        with open(path, "rb", buffering=0) as file:
            return file.read(1 << 16)
    except OSError:
        return b""
