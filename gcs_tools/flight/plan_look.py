"""A plan file looked at as the vehicle looks at it when it is uploaded, and sent to a vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fcu.interface.status_texts import words
from fcu.kernel.algebra import Vec3
from fcu.mavlink.definitions import ItemCommand, MissionType, command_name
from fcu.mavlink.geodesy import Origin, to_local
from fcu.mavlink.plan_messages import PlanItem
from fcu.services.plan_items import RefusedItem, areas_of, rally_of, steps_of
from fcu.vehicle.areas import Area, Polygon
from fcu.vehicle.fence import Fence
from fcu.vehicle.mission import Step, leads, outside
from gcs_tools.flight.ground_script import Vehicle
from gcs_tools.flight.scenario import scenario
from gcs_tools.judging.envelope import PlanMargin
from gcs_tools.judging.preflight_check import margins_along
from gcs_tools.missions.items import Plan
from gcs_tools.missions.mission import Mission
from gcs_tools.missions.plan_file import PlanError, PlanFile
from gcs_tools.recording.plans import PlanHistory
from gcs_tools.recording.reader import RecordingError, read

ROUND = 72  # corners of a circle that is drawn
DRAWN = 5000  # places of a way that is drawn, about
ROI_LOCATION = 3.0  # MAV_ROI
_HIGH = frozenset(  # items whose parameter 7 is a height
    {
        ItemCommand.WAYPOINT, ItemCommand.TAKEOFF, ItemCommand.LAND, ItemCommand.LOITER_UNLIM,
        ItemCommand.LOITER_TURNS, ItemCommand.LOITER_TIME, ItemCommand.LOITER_TO_ALT,
        ItemCommand.ROI_LOCATION,
    }
)  # fmt: skip


class Shown(NamedTuple):
    """One item of a plan, about its home."""

    item: int
    command: str
    params: tuple[float, ...]
    east_m: float | None
    north_m: float | None
    height_m: float | None
    speed_m_s: float | None = None  # of DO_CHANGE_SPEED, if it names one


@dataclass(frozen=True)
class Look:
    """A plan as the vehicle would have it. `refused`: why it does not take it. Empty: it does."""

    items: tuple[Shown, ...]
    steps: tuple[Step, ...]
    areas: tuple[Area, ...]
    rally: tuple[Vec3, ...]
    refused: str


def look(plan: PlanFile, alt_m: float = 488.0) -> Look:
    """Look at a plan from its own home, where the vehicle stands. Raises PlanError.

    alt_m : height of home above the sea, if the plan does not say.
    """
    home = plan.begin
    origin = Origin(home.lat_deg, home.lon_deg, alt_m if home.alt_m is None else home.alt_m)
    items = tuple(_shown(plan, number, origin) for number in range(len(plan.mission)))
    steps: tuple[Step, ...] = ()
    areas: tuple[Area, ...] = ()
    rally: tuple[Vec3, ...] = ()
    what = "Fence"
    try:
        areas = areas_of(plan.fence, origin)
        what = "Rally points"
        rally = rally_of(plan.rally, origin)
        what = "Mission"
        steps = steps_of(plan.mission, origin)
    except RefusedItem as refused:
        return Look(items, steps, areas, rally, f"{what}: {words(refused.told)}")
    fence = Fence()
    fence.areas = areas
    crossed = outside(steps, Vec3(0.0, 0.0, 0.0), fence.first_outside)
    why = "" if crossed is None else f"Mission: item {crossed[0]}: {words(crossed[1])}"
    return Look(items, steps, areas, rally, why)


def _shown(plan: PlanFile, number: int, origin: Origin) -> Shown:
    item = plan.mission[number]
    name = command_name(item.command)
    at = {k: (lat, lon, z) for k, lat, lon, z, _ in plan.places()}.get(number)
    if at is None:
        return Shown(number, name, item.params, None, None, _height(item), _speed(item))
    r = to_local(origin, at[0], at[1], origin.alt_m)
    return Shown(number, name, item.params, round(r.x, 3), round(r.y, 3), at[2])


def _height(item: PlanItem) -> float | None:
    high = (
        item.command in _HIGH
        or (item.command == ItemCommand.SET_HOME and item.params[0] != 1.0)
        or (item.command == ItemCommand.ROI and item.params[0] == ROI_LOCATION)
    )
    return item.z if high and math.isfinite(item.z) else None


def _speed(item: PlanItem) -> float | None:
    speed = item.params[1]
    return speed if item.command == ItemCommand.CHANGE_SPEED and speed > 0.0 else None


def counts(plan: PlanFile, found: Look) -> str:
    """The numbers of items, areas and rally points of a plan, in words."""
    polygons = sum(isinstance(area, Polygon) for area in found.areas)
    circles = len(found.areas) - polygons
    areas = [
        _count(many, what) for many, what in ((polygons, "polygon"), (circles, "circle")) if many
    ]
    fence = "no fence"
    if plan.fence:  # one that is refused has no areas
        fence = f"fence: {', '.join(areas) or _count(len(plan.fence), 'item')}"
    return f"{_count(len(plan.mission), 'item')}; {fence}; {_count(len(plan.rally), 'rally point')}"


def _count(many: int, what: str) -> str:
    return f"{many} {what}{'' if many == 1 else 's'}"


def path(found: Look) -> list[Vec3]:
    """The places of a plan in turn, m, E, about its home."""
    here, places = Vec3(0.0, 0.0, 0.0), [Vec3(0.0, 0.0, 0.0)]
    for step in found.steps:
        if leads(step) and step.place is not None:
            x, y = (step.place.x, step.place.y) if math.isfinite(step.place.x) else here[:2]
            here = Vec3(x, y, step.place.z if math.isfinite(step.place.z) else here.z)
            places.append(here)
    return places


def outlines(found: Look) -> list[tuple[bool, list[tuple[float, float]]]]:
    """The areas of a fence, each by whether the vehicle stays inside, and its corners, m."""
    lines: list[tuple[bool, list[tuple[float, float]]]] = []
    for area in found.areas:
        if isinstance(area, Polygon):
            lines.append((area.inclusion, list(area.corners)))
            continue
        angles = [2.0 * math.pi * k / ROUND for k in range(ROUND)]
        circle = [(area.x + area.radius * math.cos(q), area.y + area.radius * math.sin(q)) for q in angles]  # fmt: skip
        lines.append((area.inclusion, circle))
    return lines


def margins(mission: Mission) -> tuple[PlanMargin, ...]:
    """The least margin on the way to each item of a mission's plans, as the vehicle would look at them.

    Take-offs and descents are left out. Raises PlanError for a plan that the vehicle does not take.
    """
    scene, flight = scenario(mission), mission.flight
    found: dict[int, PlanMargin] = {}
    for item in flight.items:
        if not isinstance(item, Plan):
            continue
        seen = look(item.plan)
        if seen.refused:
            raise PlanError(f"{item.file}: {seen.refused}")
        for number, tightest in margins_along(scene, seen.steps, seen.areas):
            before = found.get(number)
            if before is None or tightest.margin < before.margin_n:
                command = command_name(item.plan.mission[number].command)
                found[number] = PlanMargin(
                    number, command, tightest.margin, tightest.at, tightest.a_d, tightest.v
                )
    return tuple(found[number] for number in sorted(found))


class FlownWay(NamedTuple):
    """The way of a flight from above, east and north of a plan's home, m, and what is to be known of it."""

    way: list[tuple[float, float]]
    notes: list[str]


def flown_way(recording: Path, plan: PlanFile) -> FlownWay:
    """The way of a flight over a plan. Raises RecordingError, PlanError.

    The flight's own plan says where on Earth it was. Without one it begins at home.
    """
    notes = []
    found = read(recording)
    if not len(found.plant):
        raise RecordingError(f"{recording}: nothing was recorded of this flight")
    r = np.column_stack([found.plant["state.r_E.x"], found.plant["state.r_E.y"]])
    items = PlanHistory(found.events).placed()
    if not found.complete:
        notes.append(
            f"{recording}: the recording was cut, its way ends at {found.plant['t'][-1]:.1f} s (gcs recover)"
        )
    if items is None:
        notes.append(f"{recording}: it flew no plan, its way is drawn from home")
        x, y = r[0].tolist()
    else:  # a place on Earth whose local place is known
        home = plan.begin
        about = Origin(home.lat_deg, home.lon_deg, 0.0)
        same = to_local(about, items.x * 1e-7, items.y * 1e-7, 0.0)
        x, y = items.place.x - same.x, items.place.y - same.y
    every = max(1, len(r) // DRAWN)
    return FlownWay(
        [(float(east) - x, float(north) - y) for east, north in r[::every].tolist()], notes
    )


def send(vehicle: Vehicle, plan: PlanFile) -> None:
    """Upload a plan, its fence and its rally points, where the vehicle is. Raises VehicleError."""
    vehicle.upload(MissionType.MISSION, ())  # the one there is may not fit the fence
    vehicle.upload(MissionType.FENCE, plan.fence)
    vehicle.upload(MissionType.RALLY, plan.rally)
    vehicle.upload(MissionType.MISSION, plan.mission)
