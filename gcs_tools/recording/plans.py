"""Plans, fences and rally points of a flight, and how far it flew them, from the events of its recording.

Frame: Earth East-North-Up, m.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from typing import Any, Generic, NamedTuple, TypeVar

from fcu.interface.event_log import Event
from fcu.interface.status_texts import Code
from fcu.kernel.algebra import Vec3
from gcs_tools.recording.table import HALF_US

MISSION, FENCE, RALLY = "Mission", "Fence", "Rally points"
MOST_ITEMS, MOST_CHANGES = 10_000, 100_000  # that are believed of a log
_WIDTH = 13  # values of an item
_POLYGON, _CIRCLE = "NAV_FENCE_POLYGON_VERTEX_", "NAV_FENCE_CIRCLE_"
_AIMED = ("DO_SET_ROI", "DO_SET_ROI_LOCATION", "DO_SET_HOME")  # places that are not flown to
ROUND = 72  # corners of a circle that is drawn

T = TypeVar("T")


class PlanItem(NamedTuple):
    """One item as it was uploaded, and its place."""

    command: str  # MAV_CMD without its prefix
    frame: int  # MAV_FRAME
    params: tuple[float, float, float, float]
    x: float  # latitude in degE7, y longitude, where the item has a place
    y: float
    z: float
    above_home: bool  # the height of `place` is above home
    place: Vec3  # m, E; NaN where it has none

    def at(self, home: Vec3 | None) -> Vec3 | None:
        """The place to which the vehicle flies, with home where it is. None: to none."""
        r = self.place
        if self.command in _AIMED or not (math.isfinite(r.x) and math.isfinite(r.y)):
            return None
        up = r.z if math.isfinite(r.z) else 0.0
        return Vec3(r.x, r.y, up + home.z if self.above_home and home is not None else up)


class FencedArea(NamedTuple):
    """An area to stay inside or outside of."""

    inclusion: bool
    corners: tuple[tuple[float, float], ...]  # east and north; of a circle ROUND of them


class PlanAt(NamedTuple):
    """All that is known of plans at one time. `current`: the next item, from 0."""

    mission: tuple[PlanItem, ...] = ()
    fence: tuple[FencedArea, ...] = ()
    rally: tuple[Vec3, ...] = ()
    home: Vec3 | None = None
    current: int = 0

    @property
    def progress(self) -> str:
        """The item that is flown, in words. Empty without a plan."""
        if not self.mission:
            return ""
        if self.current >= len(self.mission):
            return f"all {len(self.mission)} items are done"
        name = self.mission[self.current].command
        return f"item {self.current} of 0 to {len(self.mission) - 1}, {name}"


class _Changes(Generic[T]):
    """A value that changes now and then, with the times at which it did, s."""

    def __init__(self, first: T) -> None:
        self.times: list[float] = [-math.inf]
        self.values: list[T] = [first]

    def put(self, t: float, value: T) -> None:
        if len(self.times) < MOST_CHANGES:
            self.times.append(max(t, self.times[-1]))
            self.values.append(value)

    def at(self, t: float) -> T:
        return self.values[bisect_right(self.times, t) - 1]


class PlanHistory:
    """Plans over the time of a flight. `take` its events in turn."""

    def __init__(self, events: Iterable[Event] = ()) -> None:
        self._clear()
        for event in events:
            self.take(event)

    def _clear(self) -> None:
        self._mission = _Changes[tuple[PlanItem, ...]](())
        self._fence = _Changes[tuple[FencedArea, ...]](())
        self._rally = _Changes[tuple[Vec3, ...]](())
        self._home = _Changes[Vec3 | None](None)
        self._at = _Changes((0, -1))  # the next item, and the last that was done
        self._parts: dict[str, list[PlanItem]] = {}

    def take(self, event: Event) -> None:
        """Take an event. Any that does not tell of plans, or is not what it should be, is left out."""
        try:
            if event.code == Code.RESET.name:
                self._clear()
            elif event.code == Code.PLAN_ITEMS.name:
                self._take_items(event.t, event.values)
            elif event.code == Code.PLAN_AT.name:
                self._at.put(event.t, (int(event.values[0]), int(event.values[2])))
            elif event.code == Code.HOME_AT.name:
                self._home.put(event.t, _place(event.values[:3]))
        except (ValueError, TypeError, IndexError):
            pass

    def _take_items(self, t: float, values: tuple[Any, ...]) -> None:
        kind, first, last, total = values[0], *map(int, values[1:4])
        items = [_item(values[k : k + _WIDTH]) for k in range(4, len(values), _WIDTH)]
        if first == 0:
            self._parts[kind] = []
        parts = self._parts.get(kind)
        if parts is None or first != len(parts) or last + 1 > total or total > MOST_ITEMS:
            return
        parts += items
        if len(parts) == total:
            self._whole(t, kind, tuple(self._parts.pop(kind)))

    def _whole(self, t: float, kind: str, items: tuple[PlanItem, ...]) -> None:
        if kind == MISSION:
            self._mission.put(t, items)
        elif kind == FENCE:
            self._fence.put(t, tuple(_areas(items)))
        elif kind == RALLY:
            self._rally.put(t, tuple(item.place for item in items))

    @property
    def has_any(self) -> bool:
        """Tell whether there ever was a plan, a fence or a rally point."""
        return any(any(each.values) for each in (self._mission, self._fence, self._rally))

    def placed(self) -> PlanItem | None:
        """An item of the last plan with a place. None: there is none."""
        found = (item for item in self._mission.values[-1] if item.at(None) is not None)
        return next(found, None)

    def at(self, t: float) -> PlanAt:
        """All that is known at a time, s."""
        return PlanAt(
            self._mission.at(t), self._fence.at(t), self._rally.at(t), self._home.at(t),
            self._at.at(t)[0],
        )  # fmt: skip

    def steps(self) -> Iterator[tuple[float, int, int]]:
        """Each change: when, s, which item became the next, and the last that was done (-1: none)."""
        for t, (current, last) in zip(self._at.times[1:], self._at.values[1:], strict=True):
            yield t, current, last

    def spans(self, since: float, until: float) -> dict[int, tuple[float, float | None]]:
        """When each item was begun and done first, s, of those begun from one time to another.

        An item that takes no time is done as it begins. None: it was not done.
        """
        found: dict[int, tuple[float, float | None]] = {}
        flown, began = None, since
        for t, current, last in self.steps():
            if t > until:
                break
            if t < since - HALF_US:
                continue
            if flown is None:
                flown, began = current, t
                continue
            if current == flown and last < flown:  # told again
                continue
            for k in range(flown, last + 1):
                found.setdefault(k, (began if k == flown else t, t))
            found.setdefault(flown, (began, None))  # a client had another one flown
            flown, began = current, t
        if flown is not None:
            found.setdefault(flown, (began, None))
        return found


def way(plan: PlanAt) -> list[Vec3]:
    """The places that a plan leads to in turn, from home on."""
    places = [] if plan.home is None else [plan.home]
    for item in plan.mission:
        r = item.at(plan.home)
        if r is not None:
            flown_at = item.command == "NAV_LAND" and places  # first over it
            places += [Vec3(r.x, r.y, places[-1].z), r] if flown_at else [r]
    return places


def _place(values: Iterable[Any]) -> Vec3:
    x, y, z = map(float, values)
    return Vec3(x, y, z)


def _item(values: tuple[Any, ...]) -> PlanItem:
    name, frame, p1, p2, p3, p4, x, y, z, above_home, *r = values
    four = float(p1), float(p2), float(p3), float(p4)
    return PlanItem(str(name), int(frame), four, float(x), float(y), float(z), float(above_home) > 0.5, _place(r))  # fmt: skip


def _areas(items: Iterable[PlanItem]) -> Iterator[FencedArea]:
    corners: list[tuple[float, float]] = []
    for item in items:
        inclusion, r = item.command.endswith("INCLUSION"), item.place
        if item.command.startswith(_POLYGON):
            corners.append((r.x, r.y))
            if len(corners) == item.params[0]:
                yield FencedArea(inclusion, tuple(corners))
                corners = []
        elif item.command.startswith(_CIRCLE) and item.params[0] > 0.0:
            turns = [2.0 * math.pi * k / ROUND for k in range(ROUND)]
            radius = item.params[0]
            circle = ((r.x + radius * math.cos(q), r.y + radius * math.sin(q)) for q in turns)
            yield FencedArea(inclusion, tuple(circle))
