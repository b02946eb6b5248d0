"""Programs of the project run again and again, each in a copy of this process.

A copy costs a tenth of a start of Python, its memory is its own, and what it ends with is what the
program would end with: the same entry point, the same exit code, the same standard error. Some are
started anew all the same.
"""

from __future__ import annotations

import os
import resource
import select
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Collection, Sequence
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from gcs_tools.flight.forking import fork

MOST_BYTES = 500_000_000  # of memory
WITHIN_S = 20.0  # of processor time
PATIENCE_S = 120.0  # wall: a machine may be busy
INTERRUPTED_S = 10.0  # wall: a program that waits for a vehicle, or serves, is interrupted
TRACES = ("Traceback (most recent call last)", "Fatal Python error", "Exception ignored")
PROGRAMS = {"gcs": "gcs_tools.cli.program", "fcu": "fcu.__main__", "sitl-plant": "sitl_plant.__main__"}  # fmt: skip
MODULES = {"gcs": "gcs_tools", "fcu": "fcu", "sitl-plant": "sitl_plant"}


class Outcome(NamedTuple):
    """What became of one command line."""

    arguments: tuple[str, ...]
    code: int  # of one that a signal ended: minus its number
    said: str  # standard output, then standard error
    memory: int  # bytes, the most
    worked_s: float  # of processor time
    interrupted: bool  # by a SIGINT, after INTERRUPTED_S

    def findings(self, codes: Collection[int]) -> list[str]:
        """What is wrong with it; `codes`: those that its help names."""
        found = [word for word in TRACES if word in self.said]
        if self.code not in codes:
            found.append(f"exit code {self.code}")
        if self.memory > MOST_BYTES:
            found.append(f"{self.memory / 1e6:.0f} MB")
        if self.worked_s > WITHIN_S:
            found.append(f"{self.worked_s:.1f} s of processor time")
        return found


def run(
    arguments: Sequence[str], folder: Path, interrupt_s: float = INTERRUPTED_S,
    most_s: float = WITHIN_S + 10.0, anew: bool = False,
) -> Outcome:  # fmt: skip
    """What a command line does, its program first; in `folder`, interrupted after so long (wall).

    most_s : of processor time; then it is ended.  anew : in a Python of its own, not in a copy.
    """
    program, *others = arguments
    entry = import_module(PROGRAMS[program]).main

    def called() -> None:
        sys.argv = [program, *others]
        signal.signal(signal.SIGINT, signal.default_int_handler)
        os.chdir(folder)
        resource.setrlimit(resource.RLIMIT_CPU, (int(most_s), int(most_s)))
        if anew:
            os.execv(sys.executable, [sys.executable, "-m", MODULES[program], *others])
        entry(prog_name=program)

    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        pid = fork(called, program, (), out.fileno(), err.fileno()).pid
        interrupted = not _ends(pid, interrupt_s)
        if interrupted:
            os.kill(pid, signal.SIGINT)
            if not _ends(pid, PATIENCE_S):
                os.killpg(pid, signal.SIGKILL)
        _, status, used = os.wait4(pid, 0)
        texts = [os.pread(file.fileno(), 1 << 20, 0) for file in (out, err)]
    return Outcome(
        tuple(map(str, arguments)), os.waitstatus_to_exitcode(status),
        "".join(text.decode(errors="replace") for text in texts),
        1024 * used.ru_maxrss, used.ru_utime + used.ru_stime, interrupted,
    )  # fmt: skip


def _ends(pid: int, within_s: float) -> bool:
    """Whether a process ends within that time; it is yet to be waited for."""
    fd = os.pidfd_open(pid)
    try:
        return bool(select.select([fd], [], [], within_s)[0])
    finally:
        os.close(fd)


class Tally:
    """How many there were of each end, the most memory and time, and what is wrong."""

    def __init__(self, told: Callable[[str], None] = lambda line: None) -> None:
        """`told`: of each finding, as soon as it is there."""
        self.codes: dict[int, int] = {}
        self.memory, self.worked_s = 0, 0.0
        self.findings: list[str] = []
        self._told = told
        self._began = time.monotonic()

    def add(self, outcome: Outcome, codes: Collection[int], what: str) -> list[str]:
        """Count one; what is wrong with it. `what`: leads to it again."""
        self.codes[outcome.code] = self.codes.get(outcome.code, 0) + 1
        self.memory = max(self.memory, outcome.memory)
        self.worked_s = max(self.worked_s, outcome.worked_s)
        found = outcome.findings(codes)
        if found:
            words = " ".join(outcome.arguments)
            last = "\n    ".join(outcome.said.strip().splitlines()[-4:])
            self.find(f"{what}: {', '.join(found)}: {words[:300]}\n    {last}")
        return found

    def find(self, what: str) -> None:
        """Something is wrong."""
        self.findings.append(what)
        self._told(what)

    def line(self) -> str:
        """One line of a table: count, exit codes, memory, time, findings."""
        codes = ", ".join(f"{n} x {code}" for code, n in sorted(self.codes.items()))
        return (
            f"| {sum(self.codes.values())} | {codes} | {self.memory / 1e6:.0f} "
            f"| {self.worked_s:.1f} | {len(self.findings)} |"
            f" {time.monotonic() - self._began:.0f} |"
        )
