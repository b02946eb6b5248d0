"""Warnings of the vehicle in a flight: its events of level warning or worse.

What the guard finds not as believed is one of them. Of those that differ in their numbers alone one
is kept: the one that needs most force, if they tell of a force, else the first. How often a vehicle
tells of a moving setpoint depends on the wall clock.
"""

from __future__ import annotations

import string
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from fcu.interface.event_log import Event
from fcu.interface.status_texts import Code

_VEHICLE = "fcu"  # the process that tells it
_LEVELS = ("warning", "error", "fatal")
_LACK = "newtons"  # the format of a force that is missing, in the texts of codes


@dataclass(frozen=True)
class Warned:
    """One text of the vehicle."""

    time_s: float  # when it came
    text: str
    count: int = 1  # how often it came, with these numbers or others
    first_s: float | None = None  # when it came first, with lesser numbers. None: at time_s

    def __str__(self) -> str:
        """One line."""
        again = f"{self.count} times" if self.count > 1 else ""
        if self.first_s is not None:
            again = f"the greatest of {self.count}, the first at {self.first_s:.1f} s"
        return f"{self.time_s:.1f} s: {self.text}{again and f' ({again})'}"


def warnings(said: Iterable[Event], until_s: float) -> list[Warned]:
    """Each kind of event that the vehicle warned by, in the order of their times.

    until_s : when the flight was over. What is said after that is left out.
    """
    found: dict[tuple[Any, ...], tuple[float, Warned]] = {}
    for event in sorted(said, key=lambda event: event.t):
        if event.level not in _LEVELS or event.who != _VEHICLE or event.t > until_s:
            continue
        lack = _lack(event.code, event.values)
        most, kept = found.get(event.kind, (lack, Warned(event.t, event.text, count=0)))
        kept = replace(kept, count=kept.count + 1)
        if lack > most:
            first_s = kept.time_s if kept.first_s is None else kept.first_s
            most, kept = lack, Warned(event.t, event.text, kept.count, first_s)
        found[event.kind] = most, kept
    return sorted((kept for _, kept in found.values()), key=lambda each: each.time_s)


def _lack(code: str, values: Sequence[Any]) -> float:
    """The force (N) that an event tells to be missing. 0: it tells of none."""
    if code not in Code.__members__:
        return 0.0
    formats = [
        spec for _, name, spec, _ in string.Formatter().parse(Code[code].value) if name is not None
    ]
    lacks = [
        _lack(value["code"], value["values"]) if isinstance(value, dict) else float(value)
        for spec, value in zip(formats, values, strict=False)
        if isinstance(value, dict) or (spec == _LACK and isinstance(value, int | float))
    ]
    return max(lacks, default=0.0)
