"""Whether the simulation time of a vehicle that is followed stands, and which end of a flight it told."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable

from fcu.interface.status_texts import Code
from gcs_tools.live.samples import Sample
from gcs_tools.recording import events
from gcs_tools.recording.events import Event

STANDS = "simulation time stands"
_ENDS = Code.CRASHED, Code.DIVERGED  # time stands after these, until the vehicle is reset


class Standstill:
    """Watches a simulation time: it stands once it has not changed for long enough."""

    def __init__(self, after_s: float) -> None:
        """`after_s`: wall; inf: it never counts as standing."""
        self._after_s = after_s
        self._last, self._since = math.nan, time.monotonic()

    def see(self, t: float) -> bool:
        """Whether time stands, which is `t` now (s; nan: nothing has come yet)."""
        now = time.monotonic()
        if t != self._last and not math.isnan(t):
            self._last, self._since = t, now
        return now - self._since >= self._after_s


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
        before = next((end.value for end in _ENDS if end.value in event.text), before)
    return before


def end_in(sample: Sample, before: str) -> str:
    """The same by a sample of /events; one that cannot be read tells nothing."""
    try:
        return end_told(events.decode(events.schema(), sample.ticks), before)
    except (ValueError, KeyError):
        return before
