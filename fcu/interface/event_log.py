"""Events: a line of log for people, and the same as JSON with code and numbers for programs.

Programs read the code and the values of an event. The text of an event without a code is free: a
program shows it, and never looks into it.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

from fcu.interface.starter import log
from fcu.interface.status_texts import Told, words

LEVELS = ("unknown", "debug", "info", "warning", "error", "fatal")
BEFORE_S = -1.0  # the time of what happens before time begins
_DEEPEST = 8  # reasons inside one another

Said = Told | str


class Event(NamedTuple):
    """Something that happened in a flight."""

    t: float  # simulation time, s; negative: before time begins
    level: str  # one of LEVELS
    text: str  # for people
    who: str = ""  # the process: fcu, plant, pub; empty: the mission's script
    code: str = ""  # empty: the text is free
    values: tuple[Any, ...] = ()  # numbers, names, and reasons: {"code": ..., "values": [...]}

    @property
    def shown(self) -> str:
        """The text, with the process before it."""
        return f"{self.who}: {self.text}" if self.who else self.text

    @property
    def kind(self) -> tuple[Any, ...]:
        """The same for two events that differ in their numbers at most."""
        return _kind(self.code, self.values) if self.code else ("", self.text)


def event(t: float, level: str, who: str, said: Said) -> Event:
    """The event of what a process tells: a Told, or free text."""
    if isinstance(said, str):
        return Event(t, level, said, who)
    told = _plain(said)
    return Event(t, level, words(said), who, told["code"], tuple(told["values"]))


def line(event: Event) -> str:
    """The line of log of an event: simulation time, level, process, text."""
    stamp = f"{event.t:10.3f}" if event.t >= 0.0 else f"{'-':>10}"
    return f"{stamp} {event.level:<7} {event.who:<4} {event.text}"


def as_line(event: Event) -> str:
    """The line of JSON of an event."""
    return json.dumps(as_json(event))


def as_json(event: Event) -> dict[str, Any]:
    """An event for programs: without code and values, if it has none."""
    told = {"code": event.code, "values": list(event.values)} if event.code else {}
    return {"t": event.t, "level": event.level, "who": event.who, "event": event.text, **told}


def of_json(said: dict[str, Any]) -> Event:
    """The event that `as_json` tells. A level that there is not is "unknown". Raises ValueError."""
    t, level, text, who = (said.get(name, "") for name in ("t", "level", "event", "who"))
    code, values = said.get("code", ""), said.get("values", [])
    named = all(isinstance(word, str) for word in (text, who, code))
    if not (named and _is_number(t) and isinstance(values, list) and _are_values(values)):
        raise ValueError("not an event")
    known = level if level in LEVELS else LEVELS[0]
    return Event(float(t), known, text, who, code, tuple(values))


def write(event: Event, fd: int | None = None) -> None:
    """Log an event on standard error, and as a line of JSON on a file descriptor, if there is one.

    A file that cannot be written neither ends nor stops a flight.
    """
    log(line(event))
    if fd is not None:
        with suppress(OSError):
            os.write(fd, f"{as_line(event)}\n".encode())


def beside(log: Path) -> Path:
    """The file of the events whose lines of log are in `log`."""
    return log.with_suffix(".jsonl")


def read(path: Path) -> Iterator[Event]:
    """The events in a file. A file that is not there has none."""
    try:
        lines = path.read_text(errors="replace").splitlines()
    except OSError:
        return
    for each in lines:
        with suppress(ValueError, AttributeError):  # a line that was cut short
            yield of_json(json.loads(each))


def _plain(value: Any) -> Any:
    if isinstance(value, Told):
        return {"code": value.code.name, "values": [_plain(each) for each in value.values]}
    is_number = isinstance(value, Real) and math.isfinite(value)  # JSON has no others
    return float(value) if is_number else str(value)


def _kind(code: str, values: Any) -> tuple[Any, ...]:
    reasons = (_kind(v["code"], v["values"]) if isinstance(v, dict) else v for v in values)
    return code, *(each for each in reasons if isinstance(each, str | tuple))


def _is_number(value: Any) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and abs(value) <= sys.float_info.max


def _are_values(values: list[Any], depth: int = 0) -> bool:
    """Return true if they are such as events have."""
    return depth < _DEEPEST and all(
        each.keys() == {"code", "values"}
        and isinstance(each["code"], str)
        and isinstance(each["values"], list)
        and _are_values(each["values"], depth + 1)
        if isinstance(each, dict)
        else isinstance(each, str) or _is_number(each)
        for each in values
    )
