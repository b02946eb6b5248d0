"""What is added to each Tick for whoever records or publishes it: a Report.

Worked out after the answers of a burst are on their way, so it costs the flight no latency.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from fcu import wind
from fcu.interface.diagnostics import Report, Status, fcu_row
from fcu.interface.publisher_feed import PublisherFeed
from fcu.interface.recorder_pipe import Tape
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import size, to_buffer
from fcu.kernel.rows import column_of, slice_of
from fcu.laws.loader import Law
from fcu.laws.mmrac.types import State
from fcu.services.status import MODES, landed_state, system_status
from fcu.vehicle.state_machine import StateMachine

Row = np.ndarray[Any, np.dtype[np.float64]]

_WIND, _STATUS = (slice_of(Report, name) for name in ("wind", "status"))
_OFF = column_of(Report, "status.position_off")
_SEQUENCE, _PUBLISHED, _CYCLE, _CYCLE_MAX, _LOAD = (
    column_of(Report, f"timing.{name}")
    for name in ("sequence", "published", "cycle", "cycle_max", "load")
)
_COUNTED = slice(_LOAD + 1, size(Report))  # resent, refused, unrecorded, unpublished


def row_width(law: Law) -> int:
    """Number of float64 in a row of a law: its Tick, and a Report."""
    return size(fcu_row(law.ticks.Tick))


class Reporter:
    """Completes rows, and hands them on to the recorder and to the publisher."""

    def __init__(self, law: Law, tape: Tape, feed: PublisherFeed, drag: Vec3) -> None:
        """`drag`: believed, N/(m/s)^2, body axes."""
        self.width = row_width(law)
        self._of_report = slice(size(law.ticks.Tick), self.width)
        self._tells_wind = law.tells("state", State)
        self.tape = tape
        self.feed = feed
        self._drag = to_buffer(drag)
        self._report = np.zeros(size(Report))  # what the next tick has of it already
        self._report[_WIND] = wind.NOT_KNOWN
        self._wind_at = size(law.ticks.Tick) + _WIND.start
        self._seen: tuple[Any, ...] = ()
        self._told: Any = None
        self._sequence = 0.0
        self.cycle_max_s = 0.0

    def warm_up(self, row: Row) -> None:
        """Compile what a report needs."""
        if self._tells_wind:
            wind.tell(row[None], self._drag, self._wind_at)

    def report(
        self, rows: Row, times: Row, vehicle: StateMachine, off: float, resent: int, refused: int
    ) -> None:
        """Complete the rows of the Ticks just flown, and hand them on; see Report for the numbers.

        rows : float64[n, width].  times : float64[n, 3], of each: when it was answered (wall,
        monotonic, s), how long that took (s), and the load. Raises BrokenPipeError when the
        recorder is gone.
        """
        n = len(rows)
        seen = (
            vehicle.armed, vehicle.mode, landed_state(vehicle), vehicle.failsafe,
            vehicle.terminated,
        )  # fmt: skip
        if seen != self._seen:
            self._seen = seen
            self._report[_STATUS] = to_buffer(_status(vehicle))
        self._report[_OFF] = off
        self._report[_COUNTED] = resent, refused, self.tape.dropped, self.feed.dropped
        report = rows[:, self._of_report]
        report[:] = self._report
        answered, cycle = times[:, 0], times[:, 1]
        report[:, _SEQUENCE] = np.arange(self._sequence, self._sequence + n)
        report[:, _PUBLISHED] = answered + (time.time() - time.monotonic())
        report[:, _CYCLE], report[:, _LOAD] = cycle, times[:, 2]
        longest = report[:, _CYCLE_MAX]
        np.maximum.accumulate(cycle, out=longest)
        np.maximum(longest, self.cycle_max_s, out=longest)
        self.cycle_max_s = float(longest[-1])
        if self._tells_wind:
            wind.tell(rows, self._drag, self._wind_at)
        self._sequence += n
        self.feed.send_rows(rows)
        self.tape.done(n)

    def idle(self, t: float, settings: Any, now: float) -> None:
        """Between ticks: look for a publisher, and tell it the settings in force.

        t : simulation time, s.  now : wall, s.
        """
        if self.feed.find(now):
            self._told = None
        if settings is not self._told:
            self._told = settings
            self.feed.tell(np.concatenate([[t], to_buffer(settings)]).tobytes())


def _status(vehicle: StateMachine) -> Status:
    mode = MODES[vehicle.mode]
    return Status(
        armed=float(vehicle.armed),
        main_mode=float(mode.main),
        sub_mode=float(mode.sub),
        state=float(system_status(vehicle)),
        landed=float(landed_state(vehicle)),
        failsafe=float(bool(vehicle.failsafe)),
        position_off=0.0,
    )
