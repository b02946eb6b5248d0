"""What is added to each Tick for whoever records or publishes it: a Report.

Worked out after the answers of a burst are on their way, so it costs the flight no latency.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from fcu.interface.diagnostics import Report, Status, fcu_row
from fcu.interface.publisher_feed import PublisherFeed
from fcu.interface.recorder_pipe import Tape
from fcu.kernel.algebra import Vec3, maximum
from fcu.kernel.buffers import size, to_buffer
from fcu.kernel.compile import kernel
from fcu.kernel.rows import column_of, slice_of
from fcu.laws.face import IDLE, TAKE_OVER, SharedTick
from fcu.laws.loader import Law
from fcu.process import finite, wind
from fcu.process.finite import is_finite, note_computed
from fcu.process.tick import State
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
_UNPUBLISHED = _COUNTED.stop - 1
_WIND_FIRST = _WIND.start
_ENGAGED = column_of(SharedTick, "engaged")


def row_width(law: Law) -> int:
    """Number of float64 in a row of a law: its Tick, and a Report."""
    return size(fcu_row(law.ticks.Tick))


@kernel
def complete(rows, times, report, drag, at, tells_wind, computed):
    """Write the Reports of Ticks into their rows, from column `at` on. `report` goes on with them.

    rows : float64[n, width].  times : float64[n, 3], of each tick: when it was answered (wall,
    monotonic, s), how long that took (s), and the load.  report : Report (its buffer), of the next
    tick: `published` is what is added to a time, `cycle_max` is of those before.
    drag : believed, float64[3], N/(m/s)^2, body axes.  tells_wind : whether the Ticks are fcu.process.tick's.
    computed : int64[at], of `note_computed`, renewed where a law takes over.
    Returns the first Tick of a law that flies at which it is not finite, -1 without one.
    """
    not_finite = -1
    for i in range(len(rows)):
        row = rows[i]
        for j in range(len(report)):
            row[at + j] = report[j]
        report[_SEQUENCE] += 1.0
        report[_CYCLE_MAX] = maximum(report[_CYCLE_MAX], times[i, 1])
        row[at + _PUBLISHED] += times[i, 0]
        row[at + _CYCLE], row[at + _LOAD] = times[i, 1], times[i, 2]
        row[at + _CYCLE_MAX] = report[_CYCLE_MAX]
        if tells_wind:
            wind.read(row, drag, row[at + _WIND_FIRST : at + _WIND_FIRST + 3])
        if row[_ENGAGED] == TAKE_OVER:
            note_computed(row, computed)
        if not_finite < 0 and row[_ENGAGED] != IDLE and not is_finite(row, computed):
            not_finite = i
    return not_finite


class Reporter:
    """Completes rows, and hands them on to the recorder and to the publisher."""

    def __init__(self, law: Law, tape: Tape, feed: PublisherFeed, drag: Vec3) -> None:
        """`drag`: believed, N/(m/s)^2, body axes."""
        self._law = law
        self.width = row_width(law)
        self._at = size(law.ticks.Tick)
        self._tells_wind = law.tells("state", State)
        self.tape = tape
        self.feed = feed
        self._drag = to_buffer(drag)
        self._computed = np.zeros(self._at, dtype=np.int64)
        self._report = np.zeros(size(Report))  # what the next tick has of it already
        self._report[_WIND] = wind.NOT_KNOWN
        self._seen: tuple[Any, ...] = ()
        self._counted: tuple[int, ...] = ()
        self._told: Any = None

    def renewed(self) -> Reporter:
        """One for a flight that begins after this one: its rows begin again."""
        self.feed.reset()
        return Reporter(self._law, self.tape, self.feed, Vec3(*self._drag.tolist()))

    @property
    def cycle_max_s(self) -> float:
        """The longest cycle so far (wall), s."""
        return float(self._report[_CYCLE_MAX])

    def warm_up(self, row: Row) -> None:
        """Compile what a report needs."""
        self._complete(row[None], np.zeros((1, 3)), self._report.copy())

    def _complete(self, rows: Row, times: Row, report: Row) -> int:
        first: int = complete(
            rows, times, report, self._drag, self._at, self._tells_wind, self._computed
        )
        return first

    def not_finite(self, row: Row) -> tuple[str, ...]:
        """Names of what the law computes that is not finite in a row, as recordings name it."""
        names: tuple[str, ...] = finite.not_finite(self._law.ticks.Tick, row, self._computed)
        return names

    def report(
        self, rows: Row, times: Row, vehicle: StateMachine, off: float, resent: int, refused: int
    ) -> Row | None:
        """Complete the rows of the Ticks just flown, and hand them on; see Report for the numbers.

        rows, times : as for `complete`. Returns the first of them at which the law that flies is
        not finite. Raises BrokenPipeError when the recorder is gone.
        """
        report = self._report
        seen = (
            vehicle.armed, vehicle.mode, landed_state(vehicle), vehicle.failsafe,
            vehicle.terminated,
        )  # fmt: skip
        if seen != self._seen:
            self._seen = seen
            report[_STATUS] = to_buffer(_status(vehicle))
        counted = resent, refused, self.tape.dropped, self.feed.dropped
        if counted != self._counted:
            self._counted = counted
            report[_COUNTED] = counted
        report[_OFF] = off
        report[_PUBLISHED] = time.time() - time.monotonic()
        first = self._complete(rows, times, report)
        not_finite = rows[first].copy() if first >= 0 else None
        self.feed.send_rows(rows, self._at + _UNPUBLISHED)
        self.tape.done(len(rows))
        return not_finite

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
