"""Recordings of version 4, which tell events and values in force in sentences that nothing else reads.

Versions 1 to 3 are refused. They were written for a day each, before the first release, and to read them took a table
of 60 names and a second way through the reader.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Mapping
from typing import Any

from fcu.interface.event_log import Event

VERSIONS = ("4",)

_TABLES = ("flight.", "law.", "wind.", "plant.")  # of values in force
_OF_A_BUS = "values."
_WHO = ("fcu", "plant")
_CODES = {  # what a text holds -> its code
    "Crashed: hit the ground (gcs reset puts it back)": "CRASHED",
    "Lost: left the arena (gcs reset puts it back)": "DIVERGED",
    "Reset: at the start, time begins again": "RESET",
    "the flight ended": "FLIGHT_ENDED",
}
_ITEM = re.compile(r"item (\d+) of (\d+), (\w+)(, to its begin)?(?:: to \(([^)]*)\) m)?")


def of_metadata(metadata: Mapping[str, str]) -> dict[str, str]:
    """Metadata as they are now: values in force as JSON, in place of "60.0 (mission)"."""
    found, values = {}, {}
    for name, told in metadata.items():
        key = name.removeprefix(_OF_A_BUS)
        written, _, origin = told.rpartition(" (")
        if written and (key != name or key.startswith(_TABLES)):
            values[key] = {"value": _literal(written), "origin": origin.removesuffix(")")}
        else:
            found[name] = told
    return {**found, "values": json.dumps(values)} if values else found


def _literal(written: str) -> Any:
    try:
        value = ast.literal_eval(written)
        json.dumps(value)
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):
        return written
    return value


def of_event(told: Event) -> Event:
    """An event as it is now, with the code and the numbers that others read of it."""
    who, colon, text = told.text.partition(": ")
    if colon and who in _WHO:
        codes = (code for part, code in _CODES.items() if part in text)
        return told._replace(text=text, who=who, code=next(codes, ""))
    if (match := _ITEM.fullmatch(told.text)) is None:
        return told
    item, of, kind, to_begin, place = match.groups()
    leg = "go_to" if to_begin else "path" if kind == "follow" else kind
    r = map(float, place.split(", ")) if place else ()
    return told._replace(code="ITEM_BEGUN", values=(float(item), float(of), kind, leg, *r))
