"""What the vehicle warned of in a flight: STATUSTEXTs of severity WARNING or worse, as logged.

What the guard finds not as believed is one of them. Of texts that differ in their numbers alone the
first is kept: how often a vehicle tells of a moving setpoint depends on the wall clock.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

from gcs_tools.recording.events import Event

_VEHICLE = "fcu: "  # who says it, in what is logged
_NUMBER = re.compile(r"-?\d+(\.\d+)?")
_LEVELS = ("warning", "error", "fatal")


@dataclass(frozen=True)
class Warned:
    """One text of the vehicle."""

    time_s: float  # when it came first
    text: str
    count: int = 1  # how often it came, with these numbers or others

    def __str__(self) -> str:
        """One line."""
        again = f" ({self.count} times)" if self.count > 1 else ""
        return f"{self.time_s:.1f} s: {self.text}{again}"


def warnings(said: Iterable[Event], until_s: float) -> list[Warned]:
    """Each kind of text that the vehicle warned by, in the order in which they came first.

    until_s : when the flight was over; what is said after that is left out.
    """
    found: dict[str, Warned] = {}
    for event in sorted(said, key=lambda event: event.t):
        text = event.text.removeprefix(_VEHICLE)
        if event.level not in _LEVELS or text == event.text or event.t > until_s:
            continue
        kind = _NUMBER.sub("#", text)
        before = found.get(kind)
        found[kind] = (
            Warned(event.t, text) if before is None else replace(before, count=before.count + 1)
        )
    return list(found.values())
