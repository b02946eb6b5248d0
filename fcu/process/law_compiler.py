"""A process that compiles what holds the law, while the process that starts it compiles the rest.

A tick of law and guard is half of what a flight controller compiles, and no other kernel holds a copy
of it. Two processes compile on two cores, and share the cache. What goes wrong here costs time: the
process that waits compiles what it does not find.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from fcu.guard.present import Beginning
from fcu.interface.messages import VehicleState
from fcu.interface.starter import watched
from fcu.kernel.buffers import size, to_buffer
from fcu.laws import loader
from fcu.laws.loader import Law
from fcu.parameters import Parameters
from fcu.process.autopilot import tells_beginning
from fcu.process.configuration import read_airframe, read_settings
from fcu.vehicle.feasibility_check import FeasibilityCheck


def _cores() -> int:
    may = getattr(os, "sched_getaffinity", None)
    return len(may(0)) if may is not None else os.cpu_count() or 1


class LawCompiler:
    """The process, for its starter."""

    def __init__(self, process: subprocess.Popen[bytes] | None) -> None:
        """`process`: None where there is none."""
        self._process = process

    def wait(self) -> None:
        """Wait until the process has compiled."""
        if self._process is not None:
            self._process.wait()


@contextmanager
def law_compiler(law: Law | None) -> Iterator[LawCompiler]:
    """Have a law compiled in a process of its own, at most until the body ends.

    `law`: None, if it is compiled already. On one core there is no such process.
    """
    if law is None or _cores() == 1:
        yield LawCompiler(None)
        return
    process = subprocess.Popen(
        [sys.executable, "-m", __name__, law.source],
        stdin=subprocess.PIPE,  # its lifeline
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,  # the starter tells what cannot be compiled
    )
    try:
        yield LawCompiler(process)
    finally:
        process.kill()
        process.communicate()


def main(source: str) -> None:
    """Compile into the cache what holds the law of a name or a FILE.py."""
    law = loader.load(source)
    airframe = read_airframe(law)
    params = Parameters(read_settings(law, None, 500.0, airframe), 1, None, law, airframe)
    law.ticks.compiled()
    FeasibilityCheck(params).warm_up()
    if tells_beginning(law):
        law.ticks.beginning(
            to_buffer(params.settings), np.zeros(size(law.ticks.Remembered)),
            np.zeros(size(VehicleState)), np.zeros(size(Beginning)),
        )  # fmt: skip


if __name__ == "__main__":
    with watched(0):
        main(sys.argv[1])
