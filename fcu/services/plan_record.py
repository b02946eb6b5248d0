"""Tells the log of plans: items as uploaded with their places, progress, and the place of home.

Many items are told in parts, one at a time, so that none keeps the loop from its next tick.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence

from fcu.interface.status_texts import Code, Told
from fcu.mavlink.definitions import MissionType, command_name
from fcu.mavlink.geodesy import Origin
from fcu.mavlink.plan_messages import PlanItem
from fcu.services.plan_items import NAMES, place_of
from fcu.vehicle.state_machine import StateMachine

TOGETHER = 16  # items of one part
LEVEL = "debug"

Say = Callable[[str, Told, int], None]
"""Takes level, what is told, and its simulation time, us."""


class PlanRecord:
    """Tells the log of one vehicle, and nobody else."""

    def __init__(self, vehicle: StateMachine, say: Say) -> None:
        self._vehicle, self._say = vehicle, say
        self._parts: deque[tuple[int, Callable[[], Told]]] = deque()
        self._has_any: dict[MissionType, bool] = {}
        self._changed = vehicle.mission.changed
        self._home = 0

    def take(self, kind: MissionType, items: Sequence[PlanItem], origin: Origin, t_us: int) -> None:
        """All items of a kind, in place of those that there were. None: they were cleared.

        origin : of local places.  t_us : simulation time from which they are in force.
        """
        if not any(self._has_any.values()):
            self._home = -1  # it was not told of without anything to fly
        self._has_any[kind] = bool(items)
        for first in range(0, max(1, len(items)), TOGETHER):
            some = items[first : first + TOGETHER]
            self._parts.append((t_us, lambda some=some, first=first: part(kind, some, first, len(items), origin)))  # type: ignore[misc]  # fmt: skip

    def look(self, t_us: int) -> None:
        """Tell where the plan and home are, if that has changed. Costs next to nothing if not."""
        vehicle = self._vehicle
        if self._changed != vehicle.mission.changed:
            self._changed = vehicle.mission.changed
            plan = vehicle.mission
            if plan.steps:
                where = plan.current, len(plan.steps), plan.last_reached
                self._say(LEVEL, Told(Code.PLAN_AT, where), t_us)
        if self._home != vehicle.home_changed and any(self._has_any.values()):
            self._home = vehicle.home_changed
            if vehicle.home is not None:
                self._say(LEVEL, Told(Code.HOME_AT, tuple(vehicle.home)), t_us)

    def tell(self) -> None:
        """Tell the next part."""
        if self._parts:
            t_us, made = self._parts.popleft()
            self._say(LEVEL, made(), t_us)

    def close(self) -> None:
        """Tell all that is left."""
        while self._parts:
            self.tell()


def part(
    kind: MissionType, items: Sequence[PlanItem], first: int, total: int, origin: Origin
) -> Told:
    """Some items. Of each: name, frame, parameters 1 to 4, x, y, z, whether its height is above home, and
    its place east, north and up, m, NaN where it has none.
    """  # fmt: skip
    values: list[float | str] = [NAMES[kind], first, first + len(items) - 1, total]
    for item in items:
        place, above_home = place_of(item, origin)
        r = (math.nan, math.nan, math.nan) if place is None else tuple(place)
        values += [command_name(item.command), item.frame, *item.params, item.x, item.y, item.z]
        values += [float(above_home), *r]
    return Told(Code.PLAN_ITEMS, tuple(values))
