"""The plan, fence and rally point that clients without a plan of their own upload: degrees and metres.

Home is PX4's, which `gcs` takes for local (0, 0, 0).
"""

from __future__ import annotations

import math
from pathlib import Path

HOME = 47.397742, 8.545594
EARTH = 6_371_000.0  # m, radius
HEIGHT = 8.0  # m above home
JUMP_TO = 3  # the item that becomes the next while item 1 is flown
RELATIVE, RETURN = 3, 20


def at(north: float, east: float) -> tuple[float, float]:
    """Latitude and longitude of a place, m from home."""
    lat = HOME[0] + math.degrees(north / EARTH)
    return lat, HOME[1] + math.degrees(east / (EARTH * math.cos(math.radians(HOME[0]))))


# command, place, height: a take-off, a square that has no fourth side, a return
ITEMS = (
    (22, at(0.0, 0.0), 6.0), (16, at(40.0, 0.0), HEIGHT), (16, at(40.0, -40.0), HEIGHT),
    (16, at(40.0, 20.0), HEIGHT), (RETURN, (0.0, 0.0), 0.0),
)  # fmt: skip
FENCE = tuple(at(*corner) for corner in ((-40.0, -60.0), (-40.0, 60.0), (70.0, 60.0), (70.0, -60.0)))  # fmt: skip
RALLY = at(32.0, 20.0)  # nearer to the last place than home is


def row(n: int, frame: int, command: int, first: float, lat: float, lon: float, z: float) -> str:
    """One row of a .waypoints file."""
    return "\t".join(map(str, (n, 0, frame, command, first, 0, 0, 0, f"{lat:.7f}", f"{lon:.7f}", z, 1)))  # fmt: skip


def write(folder: Path) -> None:
    """plan.waypoints, fence.waypoints and rally.waypoints."""
    plan = [row(n, RELATIVE, command, 0.0, *place, z) for n, (command, place, z) in enumerate(ITEMS)]  # fmt: skip
    fence = [row(n, 0, 5001, float(len(FENCE)), *place, 0.0) for n, place in enumerate(FENCE)]
    for name, rows in (("plan", plan), ("fence", fence), ("rally", [row(0, RELATIVE, 5100, 0.0, *RALLY, 0.0)])):  # fmt: skip
        (folder / f"{name}.waypoints").write_text("\n".join(["QGC WPL 110", *rows, ""]))
