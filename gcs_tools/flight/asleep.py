"""Processes that wait, as Linux tells: a program has answered what it was sent when all its threads sleep."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable

AVAILABLE = sys.platform == "linux"

Asleep = dict[tuple[int, str], tuple[int, ...]]  # process, thread -> how often it was switched out
_SWITCHES = b"ctxt_switches:"


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


def all_sleep(pids: Iterable[int]) -> Asleep | None:
    """The threads of these processes and of all that they have started. None if one of them runs.

    Two answers that are equal mean that none of the threads ran between the first and the second: a
    thread that wakes is switched out once more before it sleeps again.
    """
    found: Asleep = {}
    for pid in with_descendants(pids):
        try:
            threads = os.listdir(f"/proc/{pid}/task")
        except OSError:
            continue
        for thread in threads:
            told = _read(f"/proc/{pid}/task/{thread}/status")
            state = told.partition(b"\nState:\t")[2][:1]
            if state in (b"", b"Z", b"X"):  # it has ended
                continue
            if state != b"S":
                return None
            counts = [line.split()[1] for line in told.splitlines() if _SWITCHES in line]
            found[pid, thread] = tuple(map(int, counts))
    return found


def has_ended(pid: int) -> bool:
    """True if the process is gone, or has only its exit code left."""
    state = _read(f"/proc/{pid}/status").partition(b"\nState:\t")[2][:1]
    return state in (b"", b"Z", b"X")


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


def _read(path: str) -> bytes:
    """A file of /proc. Empty for one that is gone."""
    try:
        with open(path, "rb", buffering=0) as file:
            return file.read(1 << 16)
    except OSError:
        return b""
