"""What both flying processes logged, as events of the recording."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from gcs_tools.recording.events import LEVELS, Event

# simulation time or "-", level, process, text: fcu.loop.say, sitl_plant.loop.say
_LINE = re.compile(r" *(?P<t>-|[0-9]+\.[0-9]{3}) (?P<level>\w+) +(?P<who>\w+) +(?P<text>.+)")


def logged(folder: Path) -> Iterator[Event]:
    """The lines of fcu.log and plant.log of a run; what came before the flight is at time 0."""
    for name in ("fcu.log", "plant.log"):
        try:
            lines = (folder / name).read_text(errors="replace").splitlines()
        except OSError:
            continue
        for line in lines:
            found = _LINE.fullmatch(line)
            if found and found["level"] in LEVELS:
                t = 0.0 if found["t"] == "-" else float(found["t"])
                yield Event(t, found["level"], f"{found['who']}: {found['text']}")
