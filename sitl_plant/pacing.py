"""Pacing of simulation time against the wall clock: absolute deadlines, counted slips."""

from __future__ import annotations

import math
import time

import numpy as np


class Pacer:
    """Delays each tick until its wall-clock deadline; does nothing at full speed.

    A slip is a tick that would start a whole period or more late. The pacer counts slips and
    moves the deadlines on by whole periods, so that no two ticks run back to back to catch up.
    """

    def __init__(self, period_s: float, speed: float | None) -> None:
        """`speed`: simulated seconds per wall-clock second; None for as fast as possible."""
        self._period = None if speed is None else period_s / speed
        self._due = 0.0
        self.slips = 0
        self.late_s = math.nan  # lateness of the last tick, s; NaN without deadlines
        self._late_us: list[float] = []

    @property
    def paced(self) -> bool:
        """Whether ticks have deadlines."""
        return self._period is not None

    def restart(self) -> None:
        """Reset the deadline to now, after simulation time was held."""
        self._due = 0.0

    def wait(self) -> None:
        """Sleep until the next tick is due."""
        if self._period is None:
            return
        now = time.monotonic()
        if self._due == 0.0:
            self._due = now
        elif self._due > now:
            time.sleep(self._due - now)
            now = time.monotonic()
        late = self.late_s = now - self._due
        self._late_us.append(late * 1e6)
        if late >= self._period:
            missed = int(late / self._period)
            self.slips += missed
            self._due += missed * self._period
        self._due += self._period

    def lateness(self) -> dict[str, float] | None:
        """p50, p99 and maximum lateness of ticks (us); None at full speed."""
        if not self._late_us:
            return None
        late = np.array(self._late_us)
        return {
            "p50_us": float(np.percentile(late, 50)),
            "p99_us": float(np.percentile(late, 99)),
            "max_us": float(late.max()),
        }
