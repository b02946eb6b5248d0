"""The place over which a return ends, and the part of the plan by which it leads there, as RTL_TYPE says.

The types are those of PX4: 0 to 3 of its release 1.15, 4 to 6 of its main branch. The landing of a plan begins at DO_LAND_START, or is the first landing of a
plan without that mark. Pure. Frame: Earth ENU. M.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple

from fcu.interface.messages import Battery
from fcu.kernel.algebra import Vec3
from fcu.vehicle.mission import Do, Mission, leads, placed


class ReturnType(IntEnum):
    """RTL_TYPE."""

    HOME_OR_RALLY = 0  # the nearest of home and rally points
    NOT_HOME = 1  # the nearest of rally points and the plan's landing; home without any
    PLAN = 2  # along the plan to its landing, or back along it and home
    NEAREST = 3  # the nearest of all
    SHORTER = 4  # along the plan to its landing, or back along it and home: by fewer items
    RALLY = 5  # the nearest of rally points, also at home; without any: here
    CHARGE = 6  # home if the charge lasts, else the nearest rally point; as 0 if that is not known


# as in PX4, rtl.cpp
RETURN_FACTOR, RETURN_MARGIN_S = (
    1.1,
    100.0,
)  # RTL_TIME_FACTOR, RTL_TIME_MARGIN: of the time of a return
LEAST_CURRENT = 1.0  # A, from which the time that a charge lasts is told
OF_HOME = 10.0  # m: a rally point that near to home is home
NEARER = 2.0  # m: by so much another place has to be nearer than the one before


class Ending(NamedTuple):
    """The end of a return."""

    place: Vec3  # over which it lands
    along: tuple[Vec3, ...] = ()  # places that are flown to before, in turn, at their own heights
    straight: bool = (
        True  # first at RTL_RETURN_ALT to the first of them; else along the plan from the begin
    )


def ending(
    kind: ReturnType, here: Vec3, home: Vec3, rally: tuple[Vec3, ...], mission: Mission, flown: bool,
    lasts: bool | None = None,
) -> Ending:  # fmt: skip
    """The end of a return from a place.

    rally : of which z says nothing.  flown : the plan was flown until now, and goes on, or back, from its current step.
    lasts : the charge lasts for the way home. None: not known.
    """
    landing = _landing(mission)
    if kind is ReturnType.SHORTER and landing is not None:
        ahead, behind = landing[0] - mission.current, mission.current
        landing = landing if ahead < behind else None
    if kind in (ReturnType.PLAN, ReturnType.SHORTER):
        found = _along_plan(here, home, mission, landing, flown)
        return Ending(home) if found is None else found
    ends = []
    if kind in (ReturnType.HOME_OR_RALLY, ReturnType.NEAREST):
        ends.append(Ending(home))
    if kind is ReturnType.CHARGE and lasts is not False:
        ends.append(Ending(home))
        rally = () if lasts else rally
    if kind is ReturnType.RALLY:
        away = [Ending(Vec3(r.x, r.y, home.z)) for r in rally]
        return _nearest_of(away or [Ending(Vec3(here.x, here.y, home.z))], here)
    if kind in (ReturnType.NOT_HOME, ReturnType.NEAREST) and landing is not None:
        first, last = landing
        ends.append(_landed(mission, home, here, first, last, straight=True))
    ends += [Ending(Vec3(r.x, r.y, home.z)) for r in rally if _across(r, home) > OF_HOME]
    return _nearest_of(ends, here) if ends else Ending(home)


def _nearest_of(ends: list[Ending], here: Vec3) -> Ending:
    """The nearest, where one has to be clearly nearer than those before it."""
    best, *others = ends
    for each in others:
        if _across(each.place, here) + NEARER < _across(best.place, here):
            best = each
    return best


def battery_left_s(battery: Battery | None, capacity_mAh: float) -> float | None:
    """The time that a charge lasts at the current that is drawn, s. None: not known."""
    if battery is None or battery.current <= LEAST_CURRENT:
        return None
    return 3.6 * battery.remaining * capacity_mAh / battery.current


def _across(a: Vec3, b: Vec3) -> float:
    return math.hypot(a.x - b.x, a.y - b.y)


def _landing(mission: Mission) -> tuple[int, int] | None:
    """The step with which the landing of a plan begins, and the landing itself. None: the plan has none."""
    begin = mission.landing
    first = 0 if begin is None else begin
    found = (i for i in range(first, len(mission.steps)) if mission.steps[i].do is Do.LAND)
    land = next(found, None)
    return None if land is None else (land if begin is None else begin, land)


def _landed(
    mission: Mission, home: Vec3, here: Vec3, first: int, land: int, straight: bool
) -> Ending:
    """Fly the places of the steps from `first` on, and land at the place of step `land`."""
    along = tuple(_places(mission, home, range(first, land)))
    place = placed(mission.steps[land], home)
    over = along[-1] if along else here
    if place is None or not (math.isfinite(place.x) and math.isfinite(place.y)):
        place = over  # it lands where the steps before have led it
    return Ending(Vec3(place.x, place.y, home.z), along, straight)


def _along_plan(
    here: Vec3, home: Vec3, mission: Mission, landing: tuple[int, int] | None, flown: bool
) -> Ending | None:
    """The way on to the plan's landing, or back to its begin and home. None: the plan leads nowhere."""
    now = mission.current if flown else _nearest(mission, here, home)
    if now is None:
        return None
    if landing is not None:
        land = landing[1]
        if now > land:  # it has landed there before
            now = landing[0]
        return _landed(mission, home, here, now, land, straight=False)
    last = now - 1 if flown else now
    back = tuple(_places(mission, home, range(min(last, len(mission.steps) - 1), -1, -1)))
    return Ending(home, back, straight=False)


def _nearest(mission: Mission, here: Vec3, home: Vec3) -> int | None:
    """The step whose place is the nearest, a landing's among them. None: no step leads anywhere."""
    away = {
        i: math.dist(place, here)
        for i in range(len(mission.steps))
        for place in _places(mission, home, range(i, i + 1))
    }
    for i, step in enumerate(mission.steps):
        place = placed(step, home) if step.do is Do.LAND else None
        if place is not None and all(map(math.isfinite, place)):
            away[i] = math.dist(place, here)
    return min(away, key=away.__getitem__) if away else None


def _places(mission: Mission, home: Vec3, steps: range) -> Iterator[Vec3]:
    """The places that steps lead to, in turn. A landing's is left out: its height is the ground's."""
    for i in steps:
        step = mission.steps[i]
        place = placed(step, home) if leads(step) and step.do is not Do.LAND else None
        if place is not None and math.isfinite(place.z):
            x, y = (place.x, place.y) if math.isfinite(place.x) else (home.x, home.y)
            yield Vec3(x, y, place.z)
