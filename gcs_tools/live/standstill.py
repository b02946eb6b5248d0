"""Whether the simulation time of a vehicle that is followed stands, and which end of a flight it told."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable

from fcu.interface.status_texts import FLIGHT_ENDED, Code
from gcs_tools.live.samples import Sample
from gcs_tools.recording import events
from gcs_tools.recording.events import Event

STANDS = "simulation time stands"
STANDS_S = 10.0  # wall: how long time may stand, unless told
LEAST_S = 2.0  # wall: as long it may take until the first tick comes
START_S = 100.0  # wall: and until the first of a vehicle that compiles, unless told
_ENDS = (
    Code.CRASHED.value,
    Code.DIVERGED.value,
    FLIGHT_ENDED,
)  # time stands after these, until the vehicle is reset


class Standstill:
    """Watches a simulation time: it stands once it has not changed for long enough."""

    def __init__(self, after_s: float | None) -> None:
        """`after_s`: wall, LEAST_S at least; None: STANDS_S, or START_S for the first tick."""
        self._after_s = STANDS_S if after_s is None else max(after_s, LEAST_S)
        self._start_s = START_S if after_s is None else self._after_s
        self._last, self._since = math.nan, time.monotonic()

    def see(self, t: float, end: str) -> bool:
        """Whether time stands, which is `t` now (s; nan: nothing has come yet).

        `end`: of the flight, as the vehicle told it; empty: it told none.
        """
        now = time.monotonic()
        if t != self._last and not math.isnan(t):
            self._last, self._since = t, now
        starts = math.isnan(self._last) and not end
        return now - self._since >= (self._start_s if starts else self._after_s)


def why(end: str) -> str:
    """Why it ended. `end`: of the flight, as the vehicle told it; empty: it told none."""
    return f"{STANDS}: {end}" if end else STANDS


def end_told(told: Iterable[Event], before: str = "") -> str:
    """How the flight ended, by events in the order in which they came; empty: it has not.

    `before`: the same of the events before them.
    """
    for event in told:
        if Code.RESET.value in event.text:
            before = ""
        elif any(end in event.text for end in _ENDS):
            before = event.text
    return before


def end_in(sample: Sample, before: str) -> str:
    """The same by a sample of /events; one that cannot be read tells nothing."""
    try:
        return end_told(events.decode(events.schema(), sample.ticks), before)
    except (ValueError, KeyError):
        return before
