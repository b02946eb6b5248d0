"""The items of a mission: what a ground script has the vehicle do, one after the other.

Each ends when the vehicle has done it, and the next begins. Frame: Earth East-North-Up.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path as File
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PrivateAttr,
    ValidationInfo,
    create_model,
    model_validator,
)

from fcu.interface.parameter import choice, not_one_of
from gcs_tools.missions import paths, plan_file, track_file
from gcs_tools.missions.bounds import AT_MOST, LIMITS
from gcs_tools.missions.fields import (
    MOST,
    NotNegative,
    Number,
    Position,
    Positive,
    Table,
    because,
    one_of,
    optional,
    wrong,
)
from gcs_tools.missions.paths import Path, PathError

FOLDER = "folder"  # of a validation's context: where names of files begin

_took: Any = (AT_MOST | None, optional("from its begin to its end, s"))
_touchdown: dict[str, Any] = {
    "touchdown_m_s": (AT_MOST | None, optional("speed at which the gear first touches the ground")),
    "touchdown_m": (
        AT_MOST | None, optional("from there to where it should land, across the ground"),
    ),
}  # fmt: skip
_doc = "What an item is held against: metric = limit, or a table; times from its begin."
ItemExpect: type[Table] = create_model(
    "ItemExpect", __base__=Table, __doc__=_doc, took_s=_took, **LIMITS
)
LandingExpect: type[Table] = create_model(
    "LandingExpect", __base__=ItemExpect, __doc__=_doc, **_touchdown
)

_passed: Any = (
    AT_MOST | None, optional("least distance from its place, while it was flown"),
)  # fmt: skip
PlanItemExpect: type[Table] = create_model(
    "PlanItemExpect", __base__=ItemExpect, __doc__=_doc, passed_m=_passed
)


def _number(key: str) -> str:
    """The number of an item as a key."""
    if not re.fullmatch(r"0|[1-9][0-9]{0,3}", key):
        raise wrong((), "the number of an item of the plan, from 0", key)
    return key


Numbered = Annotated[
    dict[Annotated[str, AfterValidator(_number)], PlanItemExpect],
    Field(description="what items of the plan are held against, by number, from 0"),
]
PlanExpect: type[Table] = create_model(
    "PlanExpect", __base__=ItemExpect, __doc__=_doc, items=(Numbered | None, None)
)

_expect: Any = Field(ItemExpect(), description="of this item")
Within = Annotated[Positive, Field(le=10.0)]
_WITHIN_M = 0.3


class TakeOff(Table):
    """Arm, and climb straight up: the vehicle's own take-off (MAVLink NAV_TAKEOFF)."""

    kind: Literal["take_off"]
    height_m: Annotated[float, Field(ge=0.5, le=400.0)] = Field(description="above the ground")
    within_m: Within = Field(_WITHIN_M, description="so near, and at rest, it has taken off")
    expect: ItemExpect = _expect


class GoTo(Table):
    """Fly to a place and come to rest: a position setpoint in offboard mode."""

    kind: Literal["go_to"]
    position_m: Position = Field(description="ENU")
    yaw_deg: Number | None = optional("from East, counter-clockwise; left out: as before")
    within_m: Within = Field(_WITHIN_M, description="so near, and at rest, it has arrived")
    expect: ItemExpect = _expect


Points = Annotated[tuple[Position, ...], Field(strict=False, min_length=2, max_length=1000)]


class Follow(Table):
    """Fly to the begin of a path, then along it: moving setpoints with velocity and acceleration."""

    kind: Literal["follow"]
    points_m: Points | None = optional("ENU; or file")
    corners: Annotated[Literal["rounded", "spline"], one_of("rounded", "spline")] = Field(
        "rounded", description="straight lines with rounded corners, or a spline through all points"
    )
    corner_m: Annotated[float, Field(ge=0.01, le=MOST)] = Field(
        0.5, description="how far from its point a rounded corner may pass"
    )
    speed_m_s: Annotated[float, Field(ge=0.01, le=20.0)] = Field(3.0, description="at most")
    acceleration_m_s2: Annotated[float, Field(ge=0.01, le=20.0)] = Field(
        2.0, description="at most, along and across together"
    )
    file: str | None = optional(
        f"a recorded track: CSV with columns {', '.join(track_file.COLUMNS)}; or points_m"
    )
    smooth_m: NotNegative = Field(0.0, description="RMS by which the path may miss the samples")
    yaw_deg: Number | None = optional("from East, counter-clockwise; left out: as before")
    within_m: Within = Field(_WITHIN_M, description="so near, and at rest, it has arrived")
    expect: ItemExpect = _expect

    _path: Path | None = PrivateAttr(None)

    @property
    def path(self) -> Path:
        """Where to be when. Raises PathError for a file that was not to be read."""
        if self._path is None:
            raise PathError("the file of this path is not known")
        return self._path

    @model_validator(mode="after")
    def _leads_somewhere(self, info: ValidationInfo) -> Self:
        if (self.points_m is None) == (self.file is None):
            raise wrong((), "either points_m or file")
        folder = (info.context or {}).get(FOLDER)
        if self.file is not None and folder is None:
            return self
        try:
            self._path = self._laid(folder)
        except PathError as error:
            if self.points_m is None:
                raise because(("file",), str(error)) from None
            at = () if error.at is None else (error.at,)
            raise because(("points_m", *at), str(error)) from None
        return self

    def _laid(self, folder: File | None) -> Path:
        if self.file is not None:
            assert folder is not None
            t, points = track_file.read(folder / self.file)
            return paths.recorded(t, points, self.smooth_m, self.acceleration_m_s2)
        points = np.array(self.points_m, dtype=np.float64)
        if self.corners == "spline":
            return paths.spline(points, self.speed_m_s, self.acceleration_m_s2)
        return paths.rounded(points, self.corner_m, self.speed_m_s, self.acceleration_m_s2)


class Hold(Table):
    """Stay at the place asked for last."""

    kind: Literal["hold"]
    for_s: Positive
    expect: ItemExpect = _expect


class Land(Table):
    """Land here, and wait until the vehicle has stopped its rotors (mode Land)."""

    kind: Literal["land"]
    expect: LandingExpect = Field(LandingExpect(), description="of this item")


class Return(Table):
    """Fly home, where it took off, land and stop the rotors (mode Return)."""

    kind: Literal["return"]
    expect: LandingExpect = Field(LandingExpect(), description="of this item")


class Plan(Table):
    """Upload a plan of a ground station, and fly it in mode Mission until it is complete."""

    kind: Literal["plan"]
    file: str = Field(description="a .plan of QGroundControl or a .waypoints file (docs/plans.md)")
    expect: PlanExpect = Field(PlanExpect(), description="of this item, and of the plan's own")

    _plan: plan_file.PlanFile | None = PrivateAttr(None)

    @property
    def is_known(self) -> bool:
        """Tell whether its file was read."""
        return self._plan is not None

    @property
    def plan(self) -> plan_file.PlanFile:
        """The items to upload. Raises PlanError for a file that was not to be read."""
        if self._plan is None:
            raise plan_file.PlanError("the file of this plan is not known")
        return self._plan

    @model_validator(mode="after")
    def _is_read(self, info: ValidationInfo) -> Self:
        folder = (info.context or {}).get(FOLDER)
        if folder is None:
            return self
        try:
            self._plan = plan_file.read(folder / self.file)
            _ = self._plan.begin
            if not self._plan.leads:
                raise plan_file.PlanError(f"{self.file}: no item leads the vehicle anywhere")
        except plan_file.PlanError as error:
            raise because(("file",), str(error)) from None
        self.check_items(("expect", "items"), self.expect.items or {})  # type: ignore[attr-defined]
        return self

    def check_items(self, where: tuple[str, ...], items: Mapping[str, Any]) -> None:
        """Raise for an item that the plan does not have, and for a distance from the place of one without a place.

        items : a PlanItemExpect, by the item's number.
        """
        last, placed = len(self.plan.mission) - 1, self.plan.flown_to()
        for number, expected in items.items():
            if int(number) > last:
                raise wrong((*where, number), f"an item of the plan, 0 to {last}", int(number))
            if expected.passed_m is not None and int(number) not in placed:
                why = f"item {number} leads to no place that it could pass"
                raise because((*where, number, "passed_m"), why)


KINDS = ("take_off", "go_to", "follow", "hold", "land", "return", "plan")
LANDINGS = (Land, Return)
OF_AN_AUTOPILOT = ("take_off", "land", "return", "plan")  # the others are setpoints


def lands(item: Any) -> bool:
    """Tell whether an item ends on the ground, with the rotors stopped."""
    return isinstance(item, LANDINGS) or (isinstance(item, Plan) and item.plan.lands)


def _of_a_kind(value: Any) -> Any:
    """Says what kinds there are."""
    if not isinstance(value, dict):
        raise wrong((), "a table with a kind", value)
    if value.get("kind") not in KINDS:
        said = not_one_of(KINDS, value["kind"]) if "kind" in value else choice(KINDS)
        raise wrong(("kind",), said.removeprefix("expected "))
    return value


Item = Annotated[
    Annotated[TakeOff | GoTo | Follow | Hold | Land | Return | Plan, Field(discriminator="kind")],
    BeforeValidator(_of_a_kind),
]


def check(
    items: tuple[Item, ...], *, in_air: bool, start: tuple[float, float, float], ground: float,
    arena: float, duration: float,
) -> None:  # fmt: skip
    """Raise for what can never come to its end: an item that a vehicle on the ground, or in the air,
    cannot begin, a place it cannot be at, more time than the flight has.

    start, ground, arena, duration : where it begins, the ground's height, m, how far from the start
    it may fly, m, and the flight's most, s.
    """  # fmt: skip
    least = 0.0
    for i, item in enumerate(items):
        if isinstance(item, TakeOff):
            if in_air:
                raise wrong(("items", i, "kind"), "an item for a vehicle in the air", item.kind)
            in_air = True
            if item.height_m > arena:
                raise wrong(
                    ("items", i, "height_m"), f"at most arena_m, {arena:g} m", item.height_m
                )
            continue
        if isinstance(item, Plan):
            in_air = not lands(item)
            if item.plan.reach_m > arena:
                raise because(
                    ("items", i, "file"),
                    f"leads {item.plan.reach_m:.0f} m from its home, and arena_m is {arena:g} m",
                )
            continue
        if not in_air:
            raise wrong(("items", i, "kind"), "take_off, for a vehicle on the ground", item.kind)
        in_air = not lands(item)
        for key, place in _places(item):
            if place[2] <= ground:
                raise wrong(
                    ("items", i, *key, 2), f"a height above ground_z_m, {ground:g} m", place[2]
                )
            if math.dist(place, start) > arena:
                raise wrong(
                    ("items", i, *key), f"a place within arena_m, {arena:g} m, of the start", place
                )
        if isinstance(item, Hold):
            least += item.for_s
        elif isinstance(item, Follow) and item._path is not None:
            _check_path(i, item, start, ground, arena)
            least += item.path.duration_s
    if least >= duration:
        raise wrong(
            ("duration_s",), f"more than {least:.4g} s, which paths and holds take", duration
        )


def _places(item: Any) -> list[tuple[tuple[str | int, ...], tuple[float, float, float]]]:
    """The places that an item leads to, each with its key."""
    if isinstance(item, GoTo):
        return [(("position_m",), item.position_m)]
    if isinstance(item, Follow) and item.points_m is not None:
        return [(("points_m", k), point) for k, point in enumerate(item.points_m)]
    return []


def _check_path(i: int, item: Follow, start: Any, ground: float, arena: float) -> None:
    """As its points: a curve may leave them."""
    r = item.path.at(np.linspace(0.0, item.path.duration_s, 1000)).r
    key = ("items", i, "file" if item.points_m is None else "points_m")
    lowest, farthest = r[r[:, 2].argmin()], r[np.linalg.norm(r - start, axis=1).argmax()]
    for place, lies, bound in (
        (lowest, lowest[2] <= ground, f"below ground_z_m, {ground:g} m"),
        (
            farthest,
            math.dist(farthest, start) > arena,
            f"beyond arena_m, {arena:g} m, of the start",
        ),
    ):
        if lies:
            at = ", ".join(f"{x:.4g}" for x in place)
            raise because(key, f"the path leads to ({at}) m, which is {bound}")
