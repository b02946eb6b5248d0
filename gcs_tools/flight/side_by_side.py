"""Several flights at a time, each in a process of its own, told of in the order of the missions."""

from __future__ import annotations

import os
import signal
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, cast

from fcu.interface.ports import INSTANCES
from gcs_tools.exit_codes import INFRASTRUCTURE, INTERRUPTED
from gcs_tools.flight.compiling import Compiled
from gcs_tools.flight.display import Display
from gcs_tools.flight.forking import Forked, fork
from gcs_tools.flight.interrupts import Interrupts, interrupts_wait

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from gcs_tools.judging.result import Result

TELL_S = 0.1  # wall: between two words of a flight on how far it is
STOP_S = 20.0  # wall: for flights that are told to end, to write down what they have
WAITING = 2  # finished flights waiting for their figure, per job

Tell = Callable[[str], None]


class Run(Protocol):
    """One mission that is to be flown."""

    name: str
    duration_s: float

    @property
    def folder(self) -> Path:
        """Where it is kept."""

    @property
    def is_cold(self) -> bool:
        """Whether it compiles before it flies."""

    @property
    def needs_first(self) -> bool:
        """True if it can only be instance 0."""

    def load(self) -> None:
        """Load here what it flies by."""

    def make_folder(self) -> None:
        """Make its folder."""

    def fly(
        self, note: Tell, progress: Callable[[float], None], compiling: Compiled
    ) -> Result:  # fmt: skip
        """Fly it."""

    def draw(self, judged: Result) -> Result:
        """Draw what was flown."""

    def lost(self, why: str, exit_code: int = INFRASTRUCTURE) -> Result:
        """Its result when nobody is left who could tell it."""


def cores() -> int:
    """Cores that this process may use, at most one for each instance."""
    may = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(may, INSTANCES)


@dataclass
class _Flight:
    """One that was begun."""

    run: Run
    process: Forked
    alone: bool  # it compiles what others need
    time_s: float = 0.0
    result: Result | None = None


def fly_side_by_side(runs: Sequence[Run], jobs: int, display: Display) -> list[Result]:
    """The results in the order of `runs`; of an interrupted call, of those that had begun.

    jobs : flights at a time. What is drawn of a flight is drawn while the next ones fly.
    """
    from multiprocessing.connection import wait

    todo = deque(runs)
    under_way: dict[Connection, _Flight] = {}
    begun: list[_Flight] = []
    told = 0
    total_s = sum(run.duration_s for run in runs)

    def is_turn_of(run: Run) -> bool:
        flying = [flight for flight in under_way.values() if flight.result is None]
        if len(flying) >= jobs or len(under_way) >= (1 + WAITING) * jobs:
            return False
        if run.needs_first and any(flight.run.needs_first for flight in flying):
            return False
        return not flying or not (run.is_cold or any(flight.alone for flight in flying))

    stop = _Stop()
    with (
        interrupts_wait() as interrupts,
        display.flight(f"{len(runs)} missions", total_s) as progress,
    ):
        try:
            while todo or under_way:
                if interrupts.is_heard:
                    todo.clear()
                    stop.end([flight.process for flight in under_way.values()])
                while todo and is_turn_of(todo[0]):
                    end, flight = _begin(todo.popleft())
                    under_way[end] = flight
                    begun.append(flight)
                for heard in wait(list(under_way), TELL_S):
                    end = cast("Connection", heard)
                    _hear(end, under_way[end], display)
                    if end.closed:
                        del under_way[end]
                progress(sum(flight.time_s for flight in begun))
                while told < len(begun) and (said := begun[told].result) is not None:
                    display.verdict(said, str(begun[told].run.folder))
                    told += 1
        finally:
            for flight in under_way.values():
                flight.process.kill()
        results = [flight.result for flight in begun if flight.result is not None]
        if any(each.exit_code == INTERRUPTED for each in results):
            interrupts.take()  # their exit code says it
    return results


def _begin(run: Run) -> tuple[Connection, _Flight]:
    """Fork a process that flies `run`; where it is heard."""
    from multiprocessing.connection import Pipe

    alone = run.is_cold
    run.load()
    run.make_folder()
    here, there = Pipe(duplex=False)

    def work() -> None:
        with suppress(BrokenPipeError):  # who started us is gone, and with it whoever reads this
            _fly(run, there)

    process = fork(
        work, "gcs fly", [there.fileno()], handlers={signal.SIGTERM: Interrupts(waits=True)}
    )
    there.close()
    return here, _Flight(run, process, alone)


def _fly(run: Run, there: Connection) -> None:
    """In a process of its own: what is told of it are (what, value)."""
    last = 0.0

    def progress(time_s: float) -> None:
        nonlocal last
        if (now := time.monotonic()) - last >= TELL_S:
            last = now
            there.send(("time", time_s))  # raises when nobody is left: the flight ends

    def compiled(done: int, of: int, wall_s: float) -> None:
        there.send(("compiling", (done, of, wall_s)))

    flown = run.fly(lambda text: there.send(("note", text)), progress, compiled)
    there.send(("result", flown))
    drawn = run.draw(flown)
    if drawn != flown:
        there.send(("result", drawn))
        there.send(("note", drawn.error))


def _hear(end: Connection, flight: _Flight, display: Display) -> None:
    """Take what a flight says of itself; closes `end` when it has said everything."""
    try:
        what, value = end.recv()
    except (EOFError, OSError):
        end.close()
        code = flight.process.wait()
        if flight.result is None:
            how = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
            flight.result = flight.run.lost(f"the process that flew it {how}")
        flight.time_s = flight.run.duration_s
        return
    if what == "time":
        flight.time_s = value
    elif what == "note":
        display.note(f"{flight.run.name}: {value}")
    elif what == "compiling":
        display.compiling(*value)
    else:
        flight.result, flight.time_s = value, flight.run.duration_s


class _Stop:
    """Flights that are told to end, and how long that takes."""

    def __init__(self) -> None:
        self._until: float | None = None

    def end(self, processes: Sequence[Forked]) -> None:
        """Ask them to end, once; end those that have not when `STOP_S` is over."""
        if self._until is None:
            self._until = time.monotonic() + STOP_S
            for process in processes:
                process.send_signal(signal.SIGTERM)
        elif time.monotonic() > self._until:
            for process in processes:
                process.kill()
