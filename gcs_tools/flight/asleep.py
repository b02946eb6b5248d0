"""Processes that wait, as Linux tells: a program has answered what it was sent when all its threads sleep."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from contextlib import suppress

AVAILABLE = sys.platform == "linux"

Seen = dict[tuple[int, str], bytes]  # process, thread -> how often it was switched out
_ENDED = b"", b"Z", b"X"
_IS_OVER = b"over"  # of a thread that has ended, in place of how often it was switched out


class Sleepers:
    """Processes, and all that they start, of which somebody waits that they sleep.

    Who leaves its processes to another (a subreaper) is to be named with it.
    """

    def __init__(self, pids: Iterable[int]) -> None:
        self._pids = list(pids)
        self._seen: Seen | None = None
        self._before: Seen = {}  # the last time that all slept
        self.ran: set[int] = set()  # processes of which a thread ran, for who asks to take away

    def have_slept(self) -> bool:
        """True if all their threads sleep, and none has run since this was last asked.

        A thread that ran was switched out once more before it sleeps again. Two looks with the same threads show
        that there is no other: who slept all the time between them has started none, and each of them lists
        what a process has started after it has seen its threads asleep.
        """
        before, self._seen = self._seen, _all_sleep(self._pids)
        if self._seen is None:
            return False
        if self._seen == before:
            return True
        for (pid, thread), switches in self._seen.items():
            if switches != _IS_OVER and self._before.get((pid, thread)) != switches:
                self.ran.add(pid)
        self._before = self._seen
        return False

    @property
    def pids(self) -> set[int]:
        """The processes that were there when all slept."""
        return {pid for (pid, _), switches in (self._seen or {}).items() if switches != _IS_OVER}


def _all_sleep(pids: Iterable[int]) -> Seen | None:
    """The threads of these processes and of all that they have started, also of those that have ended.

    None if one of them runs, or was gone before it was looked at.
    """
    found: Seen = {}
    roots = list(pids)
    waiting = roots.copy()
    while waiting:
        pid = waiting.pop()
        try:
            threads = os.listdir(f"/proc/{pid}/task")
        except OSError:
            if pid not in roots:
                return None
            found[pid, ""] = _IS_OVER
            continue
        for thread in threads:
            told = _read(f"/proc/{pid}/task/{thread}/status")
            state = _state(told)
            if state in _ENDED:
                found[pid, thread] = _IS_OVER
            elif state == b"S":
                found[pid, thread] = _switches(told)
            else:
                return None
        for thread in threads:  # after all sleep: who runs may start another before it does
            waiting += map(int, _read(f"/proc/{pid}/task/{thread}/children").split())
    return found


def work(pid: int) -> tuple[float, bool]:
    """Processor time (s) that a process and all that it has started have used, and whether one of them runs.

    One that waits for a processor runs, too.
    """
    used, runs, waiting = 0, False, [pid]
    while waiting:
        pid = waiting.pop()
        # behind the name, which may hold anything: the state, and from the 12th word on the times of user and
        # system, its own and those of children that have ended
        told = _read(f"/proc/{pid}/stat").rpartition(b")")[2].split()
        used += sum(map(int, told[11:15]))
        with suppress(OSError):
            for thread in os.listdir(f"/proc/{pid}/task"):
                runs = runs or _state(_read(f"/proc/{pid}/task/{thread}/status")) == b"R"
                waiting += map(int, _read(f"/proc/{pid}/task/{thread}/children").split())
    return used / os.sysconf("SC_CLK_TCK"), runs


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
