"""Warnings of the vehicle in a flight: its events of level warning or worse.

What the guard finds not as believed is one of them. Of those that differ in their numbers alone the
first is kept: how often a vehicle tells of a moving setpoint depends on the wall clock.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from fcu.interface.event_log import Event

_VEHICLE = "fcu"  # the process that tells it
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
    """Each kind of event that the vehicle warned by, in the order in which they came first.

    until_s : when the flight was over. What is said after that is left out.
    """
    found: dict[tuple[Any, ...], Warned] = {}
    for event in sorted(said, key=lambda event: event.t):
        if event.level not in _LEVELS or event.who != _VEHICLE or event.t > until_s:
            continue
        before = found.get(event.kind)
        found[event.kind] = (
            Warned(event.t, event.text)
            if before is None
            else replace(before, count=before.count + 1)
        )
    return list(found.values())
