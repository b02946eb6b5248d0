"""The [flight] table of a mission: where it starts, what it is told, how long it lasts.

Frames: Earth East-North-Up; angles from East, counter-clockwise.
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from gcs_tools.missions.fields import (
    ZERO,
    Coordinate,
    NotNegative,
    Number,
    Numbers,
    Position,
    Positive,
    Rate,
    Table,
    one_of,
    optional,
    wrong,
)
from gcs_tools.missions.items import Item, check


def _timed(value: Any) -> Any:
    """[at_s, x, y, z] as a table."""
    if not isinstance(value, list):
        return value
    if len(value) != 4:
        raise wrong((), "four numbers: at_s, x, y, z", value)
    return {"at_s": value[0], "position_m": value[1:]}


class Start(Table):
    """The state in which the flight begins: level, rotors at hover speed."""

    position_m: Position = Field(ZERO, description="ENU; on the ground, its height is the ground's")
    velocity_m_s: Numbers = Field(ZERO, description="ENU")
    yaw_deg: Number = Field(0.0, description="from East, counter-clockwise")
    on_ground: bool = Field(False, description="standing on its gear, rotors stopped")


class TimedSetpoint(Table):
    """A position to hold from a time on. Short form: [at_s, x, y, z]."""

    at_s: NotNegative
    position_m: Position


class FigureEight(Table):
    """x = a/2 sin p, y = b/2 sin 2p about the centre, size_m = [a, b]; p grows from rest."""

    kind: Annotated[Literal["figure_eight"], one_of("figure_eight")]
    centre_m: Position = Field(ZERO, description="ENU, m: where it begins, and where it crosses")
    size_m: Annotated[tuple[Positive, Positive], Field(strict=False)] = Field(
        description="length (East) and width (North), m"
    )
    speed_max_m_s: Positive | None = optional("speed where it crosses, its greatest; or period_s")
    period_s: Positive | None = optional("time of one round, s; or speed_max_m_s")
    ramp_s: NotNegative = Field(5.0, description="time from rest to full speed, s")

    @model_validator(mode="after")
    def _one_speed(self) -> Self:
        if (self.speed_max_m_s is None) == (self.period_s is None):
            raise wrong((), "either speed_max_m_s or period_s")
        return self


class Yaw(Table):
    """A yaw command that swings about yaw_deg: amplitude sin(frequency t)."""

    amplitude_rad: Number
    frequency_rad_s: NotNegative


class Arrive(Table):
    """End the flight once it has been near the last setpoint for a while."""

    within_m: Positive
    for_s: NotNegative


Setpoint = Annotated[
    TimedSetpoint, BeforeValidator(_timed, json_schema_input_type=TimedSetpoint | list[float])
]


AFTER_SCRIPT_S = 30.0  # of simulation time, if a mission does not say
SCRIPT_ARENA_M = 1000.0  # if a mission with a script does not say
_PACE = re.compile(r"speed:([0-9]+(\.[0-9]+)?)")
FASTEST = 100.0  # pace of a script
HELD = "held"  # pace of a script: time stands until it has answered


def _pace(value: Any) -> Any:
    """`real`, `held`, or a factor."""
    found = _PACE.fullmatch(value) if isinstance(value, str) else None
    if value not in ("real", HELD) and not (found and 0.0 < float(found[1]) <= FASTEST):
        raise wrong((), f'"real", "held", or "speed:N" with N from above 0 to {FASTEST:g}', value)
    return value


class Flight(Table):
    """Where the flight starts, what it is told, how long it lasts."""

    duration_s: Annotated[float, Field(ge=0.01, le=3600.0)]
    rate_hz: Rate = Field(500, description="control ticks a second")
    seed: Annotated[int, Field(ge=0, lt=2**53)] = Field(1, description="of the noise")
    start: Start = Start()
    ground_z_m: Coordinate = Field(-10.0, description="height of the ground, m")
    arena_m: Positive = Field(
        100.0,
        description=f"farther from the start the flight has diverged; left out, of a script: {SCRIPT_ARENA_M:g}",
    )
    setpoints: Annotated[tuple[Setpoint, ...], Field(strict=False)] = Field(
        (), description="positions over time, the first at 0; or curve, items or script"
    )
    curve: FigureEight | None = optional("a moving setpoint; in place of setpoints")
    items: Annotated[tuple[Item, ...], Field(strict=False)] = Field(
        (), description="what the vehicle does, one after the other; in place of setpoints"
    )
    script: str | None = optional(
        "a command that flies the vehicle over MAVLink, in place of setpoints; run with --allow-commands"
    )
    pace: Annotated[str, BeforeValidator(_pace)] | None = optional(
        'of a script: "real" (left out), "speed:N", N simulated seconds per second, or "held": time stands until it has answered'
    )
    after_script_s: NotNegative | None = optional(
        f"of a script: the flight goes on so long at most after it has ended; left out: {AFTER_SCRIPT_S:g}"
    )
    plan: str | None = optional(
        "a .plan or .waypoints file, flown in mode Mission: short for one item of kind plan"
    )
    yaw: Yaw | None = optional("a swing of the yaw command")
    yaw_deg: Number | None = optional("yaw command; left out: the yaw of the start")
    stream_hz: Annotated[int, Field(ge=2, le=100)] = Field(
        20, description="rate at which a moving setpoint is sent"
    )
    arrive: Arrive | None = optional("when to end before duration_s")

    @model_validator(mode="before")
    @classmethod
    def _derived(cls, given: Any) -> Any:
        """A script says where it flies as it flies: a place on the map may be far. A plan is one item."""
        if not isinstance(given, dict):
            return given
        if given.get("script") is not None:
            return {"arena_m": SCRIPT_ARENA_M, **given}
        if isinstance(given.get("plan"), str) and "items" not in given:
            return {**given, "items": [{"kind": "plan", "file": given["plan"]}]}
        return given

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        given = bool(self.setpoints), bool(self.items), self.curve is not None
        if sum(given) + (self.script is not None) != 1:
            raise wrong((), "one of setpoints, curve, items, plan and script")
        self._check_script()
        times = [s.at_s for s in self.setpoints]
        if times and times[0] != 0.0:
            raise wrong(("setpoints", 0, "at_s"), "0 (a flight begins with a setpoint)", times[0])
        for i, (before, at_s) in enumerate(pairwise(times), start=1):
            if at_s <= before:
                raise wrong(("setpoints", i, "at_s"), f"a time after {before:g}", at_s)
        if times and times[-1] >= self.duration_s:
            last = ("setpoints", len(times) - 1, "at_s")
            raise wrong(last, f"a time before duration_s, {self.duration_s:g}", times[-1])
        if self.start.on_ground and self.start.velocity_m_s != ZERO:
            raise wrong(("start", "velocity_m_s"), "zero on the ground", self.start.velocity_m_s)
        height = self.start.position_m[2]
        if not self.start.on_ground and height <= self.ground_z_m:
            key = ("start", "position_m", 2)
            raise wrong(key, f"a height above ground_z_m, {self.ground_z_m:g}", height)
        if self.items:
            self._check_items()
        return self

    @property
    def speed(self) -> float:
        """Simulated seconds per second, of a script."""
        return 1.0 if self.pace in (None, "real", HELD) else float(str(self.pace).partition(":")[2])

    def _check_script(self) -> None:
        if self.script is None:
            for key in ("pace", "after_script_s"):
                if getattr(self, key) is not None:
                    raise wrong((key,), "no such key without a script")
            return
        for key in ("arrive", "yaw", "yaw_deg"):
            if getattr(self, key) is not None:
                raise wrong(
                    (key,), "no such key beside a script, which commands the vehicle itself"
                )

    def _check_items(self) -> None:
        for key in ("arrive", "yaw"):
            if getattr(self, key) is not None:
                raise wrong(
                    (key,), "no such key beside items: they have an end, and a yaw_deg, each"
                )
        x, y, height = self.start.position_m
        if self.start.on_ground:
            height = self.ground_z_m
        check(
            self.items, in_air=not self.start.on_ground, start=(x, y, height),
            ground=self.ground_z_m, arena=self.arena_m, duration=self.duration_s,
        )  # fmt: skip
