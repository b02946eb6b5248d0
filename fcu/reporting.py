"""What the loop adds to each Tick for whoever records or publishes it: a Report.

Worked out after the answer is on its way, so it costs the flight no latency.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from fcu import wind
from fcu.interface.diagnostics import Report, Status, Timing, fcu_row
from fcu.interface.publisher_feed import PublisherFeed
from fcu.interface.recorder_pipe import RecorderPipe
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import size, to_buffer
from fcu.kernel.rows import column_of, slice_of
from fcu.laws.loader import Law
from fcu.laws.mmrac.types import State
from fcu.services.status import MODES, landed_state, system_status
from fcu.vehicle.state_machine import StateMachine

Row = np.ndarray[Any, np.dtype[np.float64]]

_WIND, _STATUS, _TIMING = (slice_of(Report, name) for name in Report._fields)
_OFF = column_of(Report, "status.position_off")


def row_width(law: Law) -> int:
    """Number of float64 in a row of a law: its Tick, and a Report."""
    return size(fcu_row(law.ticks.Tick))


class Reporter:
    """Completes rows, and hands them on to the recorder and to the publisher."""

    def __init__(self, law: Law, tape: RecorderPipe, feed: PublisherFeed, drag: Vec3) -> None:
        """`drag`: believed, N/(m/s)^2, body axes."""
        self.width = row_width(law)
        self._of_report = slice(size(law.ticks.Tick), self.width)
        self._tells_wind = law.tells("state", State)
        self.tape = tape
        self.feed = feed
        self._drag = to_buffer(drag)
        self._report = np.zeros(size(Report))
        self._wind = self._report[_WIND]
        self._wind[:] = wind.NOT_KNOWN
        self._seen: tuple[Any, ...] = ()
        self._told: Any = None
        self._sequence = 0.0
        self.cycle_max_s = 0.0

    def warm_up(self, row: Row) -> None:
        """Compile what a report needs."""
        if self._tells_wind:
            wind.read(row, self._drag, self._wind)

    def report(
        self, row: Row, vehicle: StateMachine, off: float, cycle_s: float, load: float,
        resent: int, refused: int,
    ) -> None:  # fmt: skip
        """Complete the row of the Tick just flown, and hand it on; see Report for the numbers.

        Raises BrokenPipeError when the recorder is gone.
        """
        report = self._report
        if self._tells_wind:
            wind.read(row, self._drag, self._wind)
        seen = (
            vehicle.armed, vehicle.mode, landed_state(vehicle), vehicle.failsafe,
            vehicle.terminated,
        )  # fmt: skip
        if seen != self._seen:
            self._seen = seen
            report[_STATUS] = to_buffer(_status(vehicle))
        report[_OFF] = off
        self.cycle_max_s = max(self.cycle_max_s, cycle_s)
        report[_TIMING] = Timing(
            sequence=self._sequence, published=time.time(), cycle=cycle_s,
            cycle_max=self.cycle_max_s, load=load, resent=resent, refused=refused,
            unrecorded=self.tape.dropped, unpublished=self.feed.dropped,
        )  # fmt: skip
        row[self._of_report] = report
        self._sequence += 1.0
        self.feed.send(row)
        self.tape.done()

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
