"""The meaning of the mission protocol's items: steps of a plan, areas of a fence, rally points.

The first item that cannot be flown is refused with its number, MISSION_ACK's reason and a sentence.
Frames and meanings are PX4's where PX4 has the item. Pure.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.kernel.rotations import wrap
from fcu.mavlink.definitions import (
    GLOBAL_FRAMES,
    MISSION_FRAME,
    PASSED_OVER,
    RELATIVE_FRAMES,
    Frame,
    ItemCommand,
    MissionResult,
    MissionType,
    command_name,
)
from fcu.mavlink.frames import heading
from fcu.mavlink.geodesy import Origin, to_local
from fcu.mavlink.plan_messages import UNSET, PlanItem
from fcu.vehicle import plans
from fcu.vehicle.areas import Area, Disc, Polygon
from fcu.vehicle.mission import Do, Step

MOST_ITEMS = 2000
FARTHEST = 20_000.0  # m from the origin
LOWEST, HIGHEST = -100.0, 20_000.0  # m, of a height above home or the origin
LONGEST_S, MOST_TURNS, FASTEST = 86_400.0, 1000.0, 100.0
WIDEST = 1000.0  # m, of an acceptance radius
_TERRAIN = frozenset({Frame.GLOBAL_TERRAIN_ALT, Frame.GLOBAL_TERRAIN_ALT_INT})
_ABOVE_HOME = RELATIVE_FRAMES - _TERRAIN
_ROI_LOCATION, _ROI_NONE = 3.0, 0.0  # MAV_ROI


class RefusedItem(Exception):
    """An item that is not taken: its number, from 0, MAV_MISSION_RESULT and the reason."""

    def __init__(self, result: MissionResult, why: Told, item: int = -1) -> None:
        super().__init__(result, why, item)
        self.result, self.why, self.item = result, why, item

    @property
    def told(self) -> Told:
        """The reason, with the item's number as a ground station counts it."""
        return self.why if self.item < 0 else Told(Code.ITEM, (self.item, self.why))


def _parameter(n: int, value: float, expected: str) -> RefusedItem:
    why = Told(Code.ITEM_PARAMETER, (n, value, expected))
    return RefusedItem(MissionResult[f"INVALID_PARAM{n}"], why)


class _Read(NamedTuple):
    """One item with the origin of its place."""

    item: PlanItem
    origin: Origin

    def number(self, n: int, low: float, high: float, default: float = 0.0) -> float:
        """Parameter n, 1 to 4 or 7. NaN: the default."""
        value = self.item.z if n == 7 else self.item.params[n - 1]
        if math.isnan(value):
            return default
        if not low <= value <= high:
            raise _parameter(n, value, f"{low:g} to {high:g}")
        return value

    def place(self, needed: bool = True, zero_is_here: bool = False) -> Vec3 | None:
        """Parameters 5 to 7, m, E. Above home in the relative frames. None: left out.

        needed : a latitude and longitude that are left out are refused.
        zero_is_here : 0, 0 stands for where the vehicle is, as in take-offs and landings.
        """
        item = self.item
        frame = item.frame
        if frame in _TERRAIN:
            raise RefusedItem(MissionResult.UNSUPPORTED_FRAME, Told(Code.ITEM_TERRAIN))
        if frame not in GLOBAL_FRAMES:
            if frame == MISSION_FRAME and not needed:
                return None
            raise RefusedItem(
                MissionResult.UNSUPPORTED_FRAME, Told(Code.FRAME_UNSUPPORTED, (frame,))
            )
        if not math.isfinite(item.z):
            raise _parameter(7, item.z, "a height")
        z = item.z if frame in _ABOVE_HOME else item.z - self.origin.alt_m
        if not LOWEST <= z <= HIGHEST:
            why = Told(Code.ITEM_HEIGHT, (z, LOWEST, HIGHEST))
            raise RefusedItem(MissionResult.INVALID_PARAM7, why)
        left_out = UNSET in (item.x, item.y) or (zero_is_here and item.x == item.y == 0)
        if left_out:
            if needed and item.x != UNSET and item.y == UNSET:
                raise _parameter(6, math.nan, "a longitude")
            if needed:
                raise _parameter(5, math.nan, "a latitude")
            return Vec3(math.nan, math.nan, z)
        lat, lon = item.x * 1e-7, item.y * 1e-7
        if abs(lat) > 90.0:
            raise _parameter(5, lat, "-90 to 90")
        if abs(lon) > 180.0:
            raise _parameter(6, lon, "-180 to 180")
        r = to_local(self.origin, lat, lon, self.origin.alt_m)
        far = math.hypot(r.x, r.y)
        if far > FARTHEST:
            why = Told(Code.ITEM_PLACE, (far, FARTHEST))
            raise RefusedItem(MissionResult.INVALID_PARAM5, why)
        return Vec3(r.x, r.y, z)

    @property
    def above_home(self) -> bool:
        """Tell whether the height of the place is above home."""
        return self.item.frame in _ABOVE_HOME

    @property
    def psi(self) -> float | None:
        """Parameter 4 as a heading, rad from East. None: left to the vehicle."""
        yaw = self.number(4, -1e6, 1e6, math.nan)
        return None if math.isnan(yaw) else float(wrap(heading(math.radians(yaw))))


def _to(each: _Read, do: Do = Do.GO_TO, **values: Any) -> Step:
    return Step(do, each.place(), each.above_home, **values)


def _waypoint(each: _Read) -> Step:
    return _to(
        each, hold_s=each.number(1, 0.0, LONGEST_S), radius=each.number(2, 0.0, WIDEST),
        psi=each.psi,
    )  # fmt: skip


def _loiter(each: _Read) -> Step:
    return _to(each, Do.LOITER, psi=each.psi)


def _loiter_time(each: _Read) -> Step:
    return _to(each, hold_s=each.number(1, 0.0, LONGEST_S), stops=True, psi=each.psi)


def _loiter_turns(each: _Read) -> Step:
    turns, radius = each.number(1, 0.0, MOST_TURNS), each.number(3, -WIDEST, WIDEST)
    if not plans.RADIUS_LEAST <= abs(radius) <= plans.RADIUS_MOST:
        raise _parameter(3, radius, f"{plans.RADIUS_LEAST:g} to {plans.RADIUS_MOST:g}")
    return _to(each, Do.CIRCLE, radius=radius, value=turns)


def _to_height(each: _Read) -> Step:
    return _to(each, stops=True)


def _take_off(each: _Read) -> Step:
    place = each.place(needed=False, zero_is_here=True)
    return Step(Do.TAKE_OFF, place, each.above_home, psi=each.psi)


def _land(each: _Read) -> Step:
    place = each.place(needed=False, zero_is_here=True)
    return Step(Do.LAND, place, each.above_home, psi=each.psi)


def _wait(each: _Read) -> Step:
    if each.item.command == ItemCommand.DELAY and each.number(1, -1.0, LONGEST_S) < 0.0:
        raise _parameter(1, each.item.params[0], "seconds (a time of day is not supported)")
    return Step(Do.WAIT, hold_s=each.number(1, 0.0, LONGEST_S))


def _turn(each: _Read) -> Step:
    angle, relative = each.number(1, -1e4, 1e4), each.number(4, 0.0, 1.0) == 1.0
    way = int(each.number(3, -1.0, 1.0))
    if relative:
        clockwise = math.radians(angle) * (way if way and angle >= 0.0 else 1)
        return Step(Do.TURN, value=-clockwise, relative=True)
    return Step(Do.TURN, value=float(wrap(heading(math.radians(angle)))), way=way)


def _near(each: _Read) -> Step:
    far = each.number(1, 0.0, FARTHEST)
    return Step(Do.NEAR, value=far)


def _speed(each: _Read) -> Step:
    kind = each.number(1, 0.0, 3.0)
    if kind > 1.0:
        raise _parameter(1, kind, "0 or 1 (a speed across)")
    speed = each.number(2, -2.0, FASTEST, -1.0)
    if speed == -1.0:
        return Step(Do.NOTHING)
    if speed != -2.0 and speed < 0.1:
        raise _parameter(2, speed, f"0.1 to {FASTEST:g}, -1 or -2")
    return Step(Do.SPEED, value=-1.0 if speed == -2.0 else speed)


def _jump(each: _Read) -> Step:
    to, times = each.number(1, 0.0, 65535.0, -1.0), each.number(2, -1.0, 65535.0)
    if to != int(to) or to < 0.0:
        raise _parameter(1, each.item.params[0], "the number of an item")
    return Step(Do.JUMP, to=int(to), times=int(times))


def _home(each: _Read) -> Step:
    if each.number(1, 0.0, 1.0) == 1.0:
        return Step(Do.HOME)
    return Step(Do.HOME, each.place(), each.above_home)


def _look_at(each: _Read) -> Step:
    return Step(Do.LOOK_AT, each.place(), each.above_home)


def _look(each: _Read) -> Step:
    kind = each.number(1, 0.0, 4.0)
    if kind not in (_ROI_LOCATION, _ROI_NONE):
        raise _parameter(1, kind, f"{_ROI_NONE:g} or {_ROI_LOCATION:g}")
    return Step(Do.LOOK_AHEAD) if kind == _ROI_NONE else _look_at(each)


_STEPS: dict[int, Callable[[_Read], Step]] = {
    ItemCommand.WAYPOINT: _waypoint,
    ItemCommand.LOITER_UNLIM: _loiter,
    ItemCommand.LOITER_TURNS: _loiter_turns,
    ItemCommand.LOITER_TIME: _loiter_time,
    ItemCommand.LOITER_TO_ALT: _to_height,
    ItemCommand.RETURN: lambda each: Step(Do.RETURN),
    ItemCommand.LAND: _land,
    ItemCommand.TAKEOFF: _take_off,
    ItemCommand.DELAY: _wait,
    ItemCommand.CONDITION_DELAY: _wait,
    ItemCommand.CONDITION_YAW: _turn,
    ItemCommand.JUMP: _jump,
    ItemCommand.CHANGE_SPEED: _speed,
    ItemCommand.SET_HOME: _home,
    ItemCommand.ROI_LOCATION: _look_at,
    ItemCommand.ROI_NONE: lambda each: Step(Do.LOOK_AHEAD),
    ItemCommand.ROI: _look,
    ItemCommand.LAND_START: lambda each: Step(Do.LANDING_BEGINS),
    ItemCommand.CONDITION_DISTANCE: _near,
}


def step_of(item: PlanItem, origin: Origin) -> Step:
    """The Step of an item of a plan. Raises RefusedItem."""
    if item.command in PASSED_OVER:
        return Step(Do.NOTHING)
    make = _STEPS.get(item.command)
    if make is None:
        why = Told(Code.UNSUPPORTED, (command_name(item.command),))
        raise RefusedItem(MissionResult.UNSUPPORTED, why)
    for n, value in enumerate(item.params, start=1):
        if math.isinf(value):
            raise _parameter(n, value, "a number")
    return make(_Read(item, origin))


def steps_of(items: Sequence[PlanItem], origin: Origin) -> tuple[Step, ...]:
    """The steps of a plan. Raises RefusedItem for the first item that cannot be flown."""
    return tuple(numbered_step(items, number, origin) for number in range(len(items)))


def numbered_step(items: Sequence[PlanItem], number: int, origin: Origin) -> Step:
    """The step of one item of a plan. Raises RefusedItem with its number."""
    try:
        step = step_of(items[number], origin)
        if step.do is Do.JUMP and (step.to >= len(items) or step.to == number):
            raise _parameter(1, step.to, f"another item, 0 to {len(items) - 1}")
    except RefusedItem as refused:
        raise RefusedItem(refused.result, refused.why, number) from None
    return step


def place_of(item: PlanItem, origin: Origin) -> tuple[Vec3 | None, bool]:
    """The place of an item that was taken, m, E, and whether its height is above home. None: it has none."""
    try:
        if item.command in _AREAS_AND_POINTS:
            return Vec3(*_across(item, origin), 0.0), False
        step = step_of(item, origin)
    except RefusedItem:  # it was taken for another origin
        return None, False
    return step.place, step.above_home


# --- fences and rally points

_POLYGONS = {ItemCommand.FENCE_POLYGON_IN: True, ItemCommand.FENCE_POLYGON_OUT: False}
_DISCS = {ItemCommand.FENCE_CIRCLE_IN: True, ItemCommand.FENCE_CIRCLE_OUT: False}
_AREAS_AND_POINTS = {*_POLYGONS, *_DISCS, ItemCommand.RALLY_POINT}


def areas_of(items: Sequence[PlanItem], origin: Origin) -> tuple[Area, ...]:
    """The areas of a fence. Raises RefusedItem.

    The corners of a polygon follow each other, and each says how many there are. A circle of radius 0 is no area.
    """
    areas: list[Area] = []
    corners: list[tuple[float, float]] = []
    total = 0
    for number, item in enumerate(items):
        try:
            if corners and (item.command != items[number - 1].command or item.params[0] != total):
                why = Told(Code.POLYGON_BROKEN, (len(corners), total))
                raise RefusedItem(MissionResult.INVALID, why)
            if item.command in _POLYGONS:
                total = _corners(item)
                x, y = _across(item, origin)
                corners.append((x, y))
                if len(corners) == total:
                    areas.append(Polygon(_POLYGONS[ItemCommand(item.command)], tuple(corners)))
                    corners = []
            elif item.command in _DISCS:
                radius = item.params[0]
                if not 0.0 <= radius <= FARTHEST:
                    raise _parameter(1, radius, f"0 to {FARTHEST:g}")
                # MAVSDK's geofence example sends one to say that it wants no circle
                if radius == 0.0:
                    continue
                x, y = _across(item, origin)
                areas.append(Disc(_DISCS[ItemCommand(item.command)], x, y, radius))
            elif item.command != ItemCommand.FENCE_RETURN_POINT:  # which PX4 takes and leaves
                why = Told(Code.UNSUPPORTED, (command_name(item.command),))
                raise RefusedItem(MissionResult.UNSUPPORTED, why)
        except RefusedItem as refused:
            raise RefusedItem(refused.result, refused.why, number) from None
    if corners:
        why = Told(Code.POLYGON_BROKEN, (len(corners), total))
        raise RefusedItem(MissionResult.INVALID, why, len(items) - 1)
    return tuple(areas)


def _corners(item: PlanItem) -> int:
    total = item.params[0]
    if not 0.0 <= total <= MOST_ITEMS or total != int(total):
        raise _parameter(1, total, "a number of corners")
    if total < 3.0:
        raise RefusedItem(MissionResult.INVALID_PARAM1, Told(Code.POLYGON_SHORT, (int(total),)))
    return int(total)


def _across(item: PlanItem, origin: Origin) -> tuple[float, float]:
    """East and north of an item, whose height says nothing."""
    place = _Read(item._replace(z=origin.alt_m if item.frame not in _ABOVE_HOME else 0.0), origin)
    r = place.place()
    assert r is not None
    return r.x, r.y


def rally_of(items: Sequence[PlanItem], origin: Origin) -> tuple[Vec3, ...]:
    """Rally points, m, E. Heights say nothing. Raises RefusedItem."""
    points = []
    for number, item in enumerate(items):
        try:
            if item.command != ItemCommand.RALLY_POINT:
                why = Told(Code.UNSUPPORTED, (command_name(item.command),))
                raise RefusedItem(MissionResult.UNSUPPORTED, why)
            x, y = _across(item, origin)
        except RefusedItem as refused:
            raise RefusedItem(refused.result, refused.why, number) from None
        points.append(Vec3(x, y, 0.0))
    return tuple(points)


def passed_over(items: Sequence[PlanItem]) -> int:
    """The number of items of a plan that are taken and do nothing."""
    return sum(item.command in PASSED_OVER for item in items)


NAMES = {
    MissionType.MISSION: "Mission",
    MissionType.FENCE: "Fence",
    MissionType.RALLY: "Rally points",
}
