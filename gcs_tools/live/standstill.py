"""Tell that the simulation time of a followed vehicle stands, and how its flight ended."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable

from fcu.interface.event_log import Event
from fcu.interface.status_texts import Code
from gcs_tools.live.samples import Sample
from gcs_tools.recording import events

STANDS = "simulation time stands"
STANDS_S = 10.0  # wall: how long time may stand, unless told
LEAST_S = 2.0  # wall: as long it may take until the first tick comes
START_S = 100.0  # wall: and until the first of a vehicle that compiles, unless told
_ENDS = {Code.CRASHED.name, Code.DIVERGED.name, Code.FLIGHT_ENDED.name}  # then time stands


class Standstill:
    """Watches a simulation time: it stands once it has not changed for long enough."""

    def __init__(self, after_s: float | None) -> None:
        """`after_s`: wall, LEAST_S at least. None: STANDS_S, or START_S for the first tick."""
        self._after_s = STANDS_S if after_s is None else max(after_s, LEAST_S)
        self._start_s = START_S if after_s is None else self._after_s
        self._last, self._since = math.nan, time.monotonic()

    def see(self, t: float, end: str) -> bool:
        """Return true if time stands, which is `t` now (s, nan before the first tick).

        `end`: how the flight ended, as `end_told` has it.
        """
        now = time.monotonic()
        if t != self._last and not math.isnan(t):
            self._last, self._since = t, now
        starts = math.isnan(self._last) and not end
        return now - self._since >= (self._start_s if starts else self._after_s)


def why(end: str) -> str:
    """The reason for which somebody who follows a vehicle stops. `end`: as `end_told` has it."""
    return f"{STANDS}: {end}" if end else STANDS


def end_told(told: Iterable[Event], before: str = "") -> str:
    """The end of the flight as events tell it, for people. Empty if it has not ended.

    told : in the order in which they came.  before : the end that earlier events told.
    """
    for event in told:
        if event.code == Code.RESET.name:
            before = ""
        elif event.code in _ENDS:
            before = event.shown
    return before


def end_in(sample: Sample, before: str) -> str:
    """The same by a sample of /events. A sample that cannot be read tells nothing."""
    try:
        return end_told(events.decode(events.schema(), sample.ticks), before)
    except (ValueError, KeyError):
        return before
