"""The tables of a mission file, as frozen models: what may be written, in which unit and range.

A key's unit is in its name where it is not obvious. Frames: Earth East-North-Up, body
Forward-Left-Up. A key left out of [law] or [plant] is the law's own default, or what is true of the
airframe.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
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

from fcu.guard.gains import UNSTABLE_GAINS, has_rule
from fcu.interface import samples_file
from fcu.interface.faults import DELAY_MOST_S, LATEST_S, SPECS
from fcu.interface.faults import MOST as MOST_FAULTS
from fcu.interface.parameter import Parameter, not_one_of
from fcu.laws.loader import Law
from fcu.process.settings import PARAMETERS
from fcu.vehicle.modes import Mode
from gcs_tools.judging.failsafes import FAILSAFES, NO_FAILSAFE
from gcs_tools.judging.metrics import REACHED_M, SETTLE_S
from gcs_tools.missions import parquet_samples
from gcs_tools.missions.bounds import LIMITS
from gcs_tools.missions.fields import (
    ZERO,
    NotNegative,
    NotNegatives,
    Number,
    Numbers,
    Position,
    Positive,
    Positives,
    Table,
    because,
    one_of,
    optional,
    three,
    wrong,
)
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.items import FOLDER, Numbered, Plan
from gcs_tools.missions.items import lands as ends_on_ground
from sitl_plant.physics.wind.layers import FieldLayer, Layers
from sitl_plant.physics.wind.packed_field import FieldError, is_packed, opened

Rows = np.ndarray[Any, np.dtype[np.float64]]

ROOF_M = 0.5  # a start so far below a roof is in the building

# --- [law]


def _value(row: Parameter) -> Any:
    """What a parameter of the law may be."""
    if row.words is not None:
        return Annotated[Literal[tuple(row.words)], one_of(*row.words)]
    limits = {"ge": row.low, "le": row.high}
    number = Annotated[float, Field(**{k: v for k, v in limits.items() if math.isfinite(v)})]
    n = len(row.fields)
    if n < 2:
        return number
    numbers: Any = tuple[(number,) * n]  # type: ignore[misc]
    several: Any = Annotated[numbers, Field(strict=False)]
    if row.interval:
        return Annotated[several, BeforeValidator(_both_ends(row)), AfterValidator(_in_order)]
    each = BeforeValidator(three, json_schema_input_type=float | several)
    return Annotated[several, each] if row.axes else several


def _both_ends(row: Parameter) -> Callable[[Any], Any]:
    """Says what an interval is to whoever writes one number, or three."""

    def check(value: Any) -> Any:
        if isinstance(value, list | tuple) and len(value) == 2:
            return value
        unit = f" in {row.unit}" if row.unit else ""
        expected = f"[least, most]{unit}, two numbers {row.expected().removesuffix(row.unit)}"
        exact = [value] if isinstance(value, int | float) and not isinstance(value, bool) else value
        if isinstance(exact, list) and len(exact) == 1:
            expected = f"{expected.rstrip()} (to believe in one value: [{exact[0]}, {exact[0]}])"
        raise wrong((), expected.rstrip(), value)

    return check


def _in_order(ends: tuple[float, float]) -> tuple[float, float]:
    least, most = ends
    if least > most:
        raise wrong((), f"[least, most], as in [{most:g}, {least:g}]", ends)
    return ends


def law_table(
    rows: Iterable[Parameter], guarded: bool = True, has_rule: bool = True
) -> type[Table]:
    """[law] for a law's table of parameters: a key a row, a table for keys with a dot.

    `guarded`: True for a law that names a guard. Without a guard, nothing but `guard = "warn"` is
    true. `has_rule`: True for a law whose gains the rule of stability judges.
    """
    module = "the law: a name, or a Python file of yours (relative to the mission), which is run"
    tables: dict[str, dict[str, Any]] = {"": {"module": (str | None, optional(module))}}
    if not guarded:
        tables[""]["guard"] = Annotated[str, AfterValidator(_no_guard)] | None, optional("warn")
    if has_rule:
        said = 'gains that the rule of stability refuses: "fly" flies them, for a study (default "refuse")'
        words = Annotated[Literal["fly", "refuse"], one_of(*UNSTABLE_GAINS)]
        tables[""]["unstable_gains"] = words | None, optional(said)
    for row in rows:
        if row.key:
            above, _, key = row.key.rpartition(".")
            tables.setdefault(above, {})[key] = _value(row) | None, optional(row.described())
    for name, keys in tables.items():
        if name:
            inner = create_model(name.capitalize(), __base__=Table, **keys)
            tables[""][name] = inner, inner()
    doc = "Parameters of the law; docs/parameters.md lists them with what a ground station calls them."
    return create_model("Law", __base__=Table, __doc__=doc, **tables[""])


def _no_guard(policy: str) -> str:
    if policy != "warn":
        said = not_one_of(["warn"], policy).removeprefix("expected ")
        raise wrong((), f"{said} (this law has no guard)")
    return policy


LawTable = law_table(PARAMETERS)


# --- [wind]


# the paper's wind, Section VIII
PAPER = {
    "amplitude_m_s": (7.2, 7.2, 5.7), "frequency_rad_s": (1.5, 1.6, 1.7),
    "rotation_amplitude_rad_s": (0.7, 0.6, 0.5), "rotation_frequency_rad_s": (2.5, 2.4, 2.3),
}  # fmt: skip
MOST_GUSTS = 64


class Gust(Table):
    """A discrete gust: it rises as 1 - cos, holds, and falls as it rose."""

    at_s: NotNegative
    velocity_m_s: Numbers = Field(description="added while it holds, ENU")
    rise_s: Positive
    hold_s: NotNegative = 0.0
    fall_s: Positive | None = optional("left out: as rise_s")


class FieldOfWind(Table):
    """A 3-D field of wind, with its buildings."""

    file: str = Field(description="packed by gcs wind pack (a folder, relative to the mission)")
    origin_m: Numbers = Field(ZERO, description="of the mission, in the field")
    scale: Annotated[float, Field(gt=0.0, le=100.0)] = Field(1.0, description="of the velocities")
    start_s: NotNegative = Field(
        0.0, description="time since the first of the field when the flight begins"
    )
    after: Annotated[Literal["hold", "repeat"], one_of("hold", "repeat")] | None = optional(
        "after the last time of the field; left out: a flight that is longer is refused"
    )
    inflow: bool = Field(True, description="the air at each rotor changes its thrust")


class Wind(Table):
    """The air: steady, plus amplitude sin(frequency t), plus a step; and its rotation; and layers."""

    base: Annotated[Literal["paper"], one_of("paper")] | None = optional(
        "paper: the sines of the paper, where these are left out"
    )

    steady_m_s: Numbers = Field(ZERO, description="velocity of the air, ENU")
    amplitude_m_s: Numbers = Field(ZERO, description="ENU")
    frequency_rad_s: NotNegatives = ZERO
    phase_rad: Numbers = Field(ZERO, description="of the sines, at time 0")
    rotation_amplitude_rad_s: Numbers = Field(ZERO, description="body axes")
    rotation_frequency_rad_s: NotNegatives = ZERO
    rotation_phase_rad: Numbers = ZERO
    step_m_s: Numbers = Field(ZERO, description="added from step_at_s on, ENU")
    step_at_s: NotNegative | None = optional("when the step comes")
    azimuth_deg: Number = Field(
        0.0, description="turns the velocity about the vertical, counter-clockwise"
    )

    file: str | None = optional(
        f"velocity of the air over time, added to the rest: CSV or Parquet with columns {', '.join(samples_file.WIND)}"
    )

    shear: Annotated[Literal["log", "power"], one_of("log", "power")] | None = optional(
        "how steady_m_s grows with height above ground; left out: not"
    )
    shear_height_m: Positive = Field(10.0, description="at which the wind is steady_m_s")
    roughness_m: Positive = Field(0.1, description="of the ground, for log")
    shear_exponent: NotNegative = Field(1.0 / 7.0, description="for power")
    turbulence: (
        Annotated[Literal["dryden", "von_karman"], one_of("dryden", "von_karman")] | None
    ) = optional("MIL-F-8785C at low altitude, drawn from [flight] seed")
    turbulence_w20_m_s: NotNegative | None = optional(
        "mean wind at 20 ft that turbulence is for: light 7.7, moderate 15.4, severe 23.1"
    )
    gusts: Annotated[tuple[Gust, ...], Field(strict=False, max_length=MOST_GUSTS)] = ()
    field: FieldOfWind | None = optional("3-D, with buildings")

    _samples: Rows | None = PrivateAttr(None)
    _field: Path | None = PrivateAttr(None)

    @model_validator(mode="before")
    @classmethod
    def _of_a_base(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("base") == "paper":
            return {**PAPER, **given}
        return given

    @model_validator(mode="after")
    def _layers_are_whole(self) -> Self:
        if (self.turbulence is None) != (self.turbulence_w20_m_s is None):
            key = "turbulence" if self.turbulence is None else "turbulence_w20_m_s"
            raise because((key,), "turbulence needs both turbulence and turbulence_w20_m_s")
        if self.shear == "log" and self.roughness_m >= self.shear_height_m:
            raise wrong(("roughness_m",), "less than shear_height_m", self.roughness_m)
        if self.field is not None and self.azimuth_deg != 0.0:
            raise because(
                ("azimuth_deg",), "a field has buildings and cannot be turned: leave it out"
            )
        return self

    def begins(self, place: tuple[float, float, float]) -> str:
        """Why a flight cannot begin at a place of the mission (m), for its field. Empty: it can."""
        if self._field is None or self.field is None:
            return ""
        field = opened(self._field).field
        at = [a + b for a, b in zip(place, self.field.origin_m, strict=True)]
        for axis, value, low, high in zip(
            "xyz", at, field.bounds[::2], field.bounds[1::2], strict=True
        ):
            if not low <= value <= high:
                return f"the flight begins at {axis} = {value:g} m, outside the field: {low:g} to {high:g} m"
        i, j = (
            min(max(int(np.searchsorted(edges, value, side="right")) - 1, 0), len(edges) - 2)
            for edges, value in ((field.top_x, at[0]), (field.top_y, at[1]))
        )
        roof = float(field.top[j, i])
        inside = at[2] < roof - ROOF_M and roof > field.top.min()
        return f"the flight begins {at[2]:g} m up, in a building of {roof:g} m" if inside else ""

    def roofs(self) -> tuple[Any, Any, Any] | None:
        """Edges of cells to East and North (m, of the field), and the height of ground and buildings in each. None without a field."""
        if self._field is None:
            return None
        field = opened(self._field).field
        return field.top_x, field.top_y, field.top

    @property
    def field_ends_s(self) -> float | None:
        """Time of the flight (s) at which its field ends. None without a field, and where something follows."""
        if self._field is None or self.field is None or self.field.after is not None:
            return None
        times = opened(self._field).field.t
        return None if len(times) == 1 else float(times[-1]) - self.field.start_s

    def layers(self, seed: int) -> Layers | None:
        """Layers for the simulator, or None if no key asks for one.  seed : of turbulence."""
        asked = self.shear, self.turbulence, self.field
        if not any(asked) and not self.gusts:
            return None
        field = self.field
        return Layers(
            shear=self.shear,
            shear_height_m=self.shear_height_m,
            roughness_m=self.roughness_m,
            shear_exponent=self.shear_exponent,
            turbulence=self.turbulence,
            turbulence_w20_m_s=self.turbulence_w20_m_s or 0.0,
            seed=seed,
            gusts=tuple(
                (g.at_s, g.rise_s, g.hold_s, g.rise_s if g.fall_s is None else g.fall_s, *g.velocity_m_s)
                for g in self.gusts
            ),
            field=None if field is None else FieldLayer(
                path=str(self._field or field.file), origin_m=(field.origin_m[0], field.origin_m[1], field.origin_m[2]), scale=field.scale,
                start_s=field.start_s, repeats=field.after == "repeat", inflow=field.inflow,
            ),
        )  # fmt: skip

    @property
    def samples(self) -> Rows | None:
        """float64[n, 4], s and m/s, E, of `file`. None without one."""
        return self._samples

    @model_validator(mode="after")
    def _is_read(self, info: ValidationInfo) -> Self:
        folder = (info.context or {}).get(FOLDER)
        if self.file is not None and folder is not None:
            try:
                path = folder / self.file
                reads = parquet_samples if path.suffix in parquet_samples.SUFFIXES else samples_file
                self._samples = reads.read_wind(path)
            except samples_file.SamplesError as error:
                raise because(("file",), str(error)) from None
        if self.field is not None and folder is not None:
            self._field = (folder / self.field.file).absolute()
            if self._field.is_dir() and not is_packed(self._field):
                why = f"{self._field}: a folder, but no packed field (gcs wind pack makes one)"
                raise because(("field", "file"), why)
            try:
                opened(self._field)
            except FieldError as error:
                raise because(("field", "file"), str(error)) from None
        return self

    @model_validator(mode="after")
    def _step_has_a_time(self) -> Self:
        if self.step_m_s != ZERO and self.step_at_s is None:
            raise wrong(("step_at_s",), "a time for step_m_s")
        return self


# --- [plant]


class MassChange(Table):
    """A package dropped, or taken up."""

    at_s: NotNegative
    mass_kg: Positive | None = optional("mass from then on; or mass_ratio")
    mass_ratio: Positive | None = optional("mass from then on, as a part of that before")

    @model_validator(mode="after")
    def _one_mass(self) -> Self:
        if (self.mass_kg is None) == (self.mass_ratio is None):
            raise wrong((), "either mass_kg or mass_ratio")
        return self


class RotorLoss(Table):
    """One rotor weaker from a time on: the fraction of its thrust and torque that is left."""

    rotor: Annotated[int, Field(ge=1, le=8)]
    at_s: NotNegative
    effectiveness: Annotated[float, Field(ge=0.0, le=1.0)]


class Noise(Table):
    """White noise on the reported state at every tick, one sigma, each axis."""

    position_m: NotNegative = 0.0
    velocity_m_s: NotNegative = 0.0
    attitude_deg: NotNegative = 0.0
    rate_rad_s: NotNegative = 0.0


FAULT_KEYS = tuple(dict.fromkeys(key for spec in SPECS.values() for key in spec.keys))


# values with which a fault changes nothing, and what to give in their place
_NOTHING = {
    "effectiveness": 1.0,
    "remaining": 1.0,
    "delay_s": 0.0,
    "drain_a": 0.0,
    "share": 0.0,
    "late_s": 0.0,
}
_SOMETHING = {
    "effectiveness": "give less than 1",
    "remaining": "give less than 1",
    "delay_s": "give a tick or more",
    "drain_a": "give a current above 0 A",
    "share": "give more than 0",
    "late_s": "give more than 0 s",
}


class PlantFault(Table):
    """One fault to order: what breaks, when, for how long and by how much (docs/missions.md)."""

    kind: Annotated[str, one_of(*SPECS)] = Field(json_schema_extra={"enum": [*SPECS]})
    at_s: Annotated[float, Field(ge=0.0, le=LATEST_S)]
    for_s: Annotated[float, Field(gt=0.0, le=LATEST_S)] | None = optional(
        "how long; left out: to the end of the flight"
    )
    rotor: Annotated[int, Field(ge=1, le=8)] | None = optional("of motor_...; left out: all")
    effectiveness: Annotated[float, Field(ge=0.0, le=1.0)] | None = optional(
        "of motor_weak: fraction of thrust and torque that is left"
    )
    noise: Noise | None = optional("of state_noisy")
    delay_s: Annotated[float, Field(ge=0.0, le=DELAY_MOST_S)] | None = optional("of state_delayed")
    jump_m: Position | None = optional("of state_jumps, ENU")
    drain_a: Annotated[float, Field(ge=0.0, le=1e4)] | None = optional("of battery_drain")
    remaining: Annotated[float, Field(ge=0.0, le=1.0)] | None = optional("of battery_level")
    share: Annotated[float, Field(ge=0.0, le=1.0)] | None = optional("of link_...: of the states")
    late_s: Annotated[float, Field(ge=0.0, le=0.5)] | None = optional("of link_late: wall time")

    @model_validator(mode="after")
    def _has_its_keys(self) -> Self:
        wanted = SPECS[self.kind].keys
        for key in FAULT_KEYS:
            given = getattr(self, key) is not None
            if given and key not in wanted:
                of = ", ".join(name for name, spec in SPECS.items() if key in spec.keys)
                raise because((key,), f"no key of {self.kind}: it is one of {of}")
            if not given and key in wanted and key != "rotor":
                raise because((key,), f"expected a value: {self.kind} needs it")
        for key, nothing in _NOTHING.items():
            if (given := getattr(self, key)) is not None and given == nothing:
                raise because((key,), f"{self.kind} of {given} changes nothing: {_SOMETHING[key]}")
        if self.jump_m is not None and not any(self.jump_m):
            raise because(("jump_m",), "a jump of 0 m changes nothing: give a distance")
        if self.noise is not None and not any(self.noise.model_dump().values()):
            raise because(("noise",), "of no noise nothing is seen: give an amount")
        return self


class Plant(Table):
    """How the truth differs from that of the airframe, and what the plant reports of it."""

    mass_kg: Positive | None = optional("kg")
    inertia_kg_m2: Positives | None = optional("principal moments, body axes")
    drag: NotNegatives | None = optional("quadratic, N/(m/s)^2, body axes")
    drag_torque: NotNegatives | None = optional("quadratic, N m/(rad/s)^2, body axes")
    rotor_lag_s: NotNegative | None = optional("first-order lag of the rotors' speed; may be 0")
    mass_change: MassChange | None = optional("in mid-flight")
    rotor_loss: Annotated[tuple[RotorLoss, ...], Field(strict=False)] = Field(
        (), description="at most one a rotor"
    )
    faults: Annotated[tuple[PlantFault, ...], Field(strict=False, max_length=MOST_FAULTS)] = Field(
        (), description="faults to order"
    )
    battery_ah: Positive | None = optional("capacity")
    battery_remaining: Annotated[float, Field(ge=0.0, le=1.0)] | None = optional(
        "fraction of it left when the flight begins"
    )
    noise: Noise = Noise()
    delay_s: Annotated[float, Field(ge=0.0, le=0.5)] = Field(
        0.0, description="age of the reported state, in whole ticks"
    )

    @model_validator(mode="after")
    def _one_loss_a_rotor(self) -> Self:
        for i, loss in enumerate(self.rotor_loss):
            if any(loss.rotor == other.rotor for other in self.rotor_loss[:i]):
                raise wrong(
                    ("rotor_loss", i, "rotor"), "a rotor that is not listed yet", loss.rotor
                )
        return self


# --- [vehicle]


class Vehicle(Table):
    """The autopilot, as a ground station would set it."""

    params: dict[str, Number] = Field(
        default_factory=dict,
        description="the vehicle's own parameters by their MAVLink names (docs/parameters.md)",
    )


# --- [expect]


_ENDINGS = ("time", "arrived", "landed", "done", "script", "refused", "diverged", "crashed", "fell")

_ended: Any = (
    Annotated[Literal[_ENDINGS], one_of(*_ENDINGS)] | None,
    optional(
        "how the flight ends; left out: time or arrived, of items landed or done, of a script landed (or script, from the air)"
    ),
)


def _distance(value: Any) -> Any:
    """Whether setpoints are to be reached, or how near."""
    number = isinstance(value, int | float) and math.isfinite(value) and value > 0.0
    if not isinstance(value, bool) and not number:
        raise wrong((), "true, false, or a distance > 0 in m", value)
    return value


_reached: Any = (
    Annotated[bool | float, BeforeValidator(_distance)] | None,
    optional(
        f"every setpoint that stands for {SETTLE_S:g} s is reached within so many m; "
        f"left out or true: {REACHED_M:g}; false: not expected"
    ),
)
_limited: Any = (
    bool | None,
    optional("true: the vehicle limits or refuses a setpoint; left out or false: it does neither"),
)
_MODES = tuple(mode.value for mode in Mode)


class Failsafe(Table):
    """The first failsafe that acts, and when."""

    name: Annotated[str, one_of(*FAILSAFES)] = Field(json_schema_extra={"enum": [*FAILSAFES]})
    t_from: NotNegative | None = Field(None, alias="from", description="s")
    t_to: NotNegative | None = Field(None, alias="to", description="s")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if (self.t_to is not None or self.t_from is not None) and self.name == NO_FAILSAFE:
            raise wrong(("name",), "a failsafe, which alone has a time", self.name)
        if (math.inf if self.t_to is None else self.t_to) < (self.t_from or 0.0):
            raise wrong(("to",), f"a time from {self.t_from or 0.0:g} s on", self.t_to)
        return self


_mode: Any = (
    Annotated[Literal[_MODES], one_of(*_MODES)] | None,
    optional("the mode in which the flight ends"),
)


def _failsafe(value: Any) -> Any:
    """A name as the table that it is short for."""
    return {"name": value} if isinstance(value, str) else value


Expect: type[Table] = create_model(
    "Expect",
    __base__=Table,
    __doc__="What the flight is held against: metric = limit, or a table.",
    ended=_ended,
    reached=_reached,
    limited=_limited,
    mode=_mode,
    failsafe=(
        Annotated[Failsafe, BeforeValidator(_failsafe, json_schema_input_type=str | Failsafe)]
        | None,
        optional("the first failsafe that acts: its name, or a table with from and to; none"),
    ),
    fence_breached=(bool | None, optional("the fence is breached at some time, or at none")),
    items=(Numbered | None, optional("of a flight with one plan: of the plan's items, by number")),
    **LIMITS,
)


# --- the file


def _sentence(text: str) -> str:
    if not (text[:1].isupper() and text.endswith(".") and text.isprintable()):
        raise wrong((), "a sentence on one line: a capital first, a full stop last", text)
    return text


class Document(Table):
    """A mission of the M-MRAC flight stack."""

    title: Annotated[str, AfterValidator(_sentence)] = Field(description="a sentence")
    airframe: str | None = optional(
        "the vehicle: a name (s1000), or an airframe file of yours (relative to the mission)"
    )
    flight: Flight
    law: LawTable = LawTable()  # type: ignore[valid-type]
    wind: Wind = Wind()
    plant: Plant = Plant()
    vehicle: Vehicle = Vehicle()
    expect: Expect = Expect()

    @model_validator(mode="after")
    def _begins_in_its_field(self) -> Self:
        start = self.flight.start
        x, y, z = start.position_m
        why = self.wind.begins((x, y, self.flight.ground_z_m if start.on_ground else z))
        if why:
            raise because(("wind", "field", "origin_m"), why)
        return self

    @model_validator(mode="after")
    def _field_lasts(self) -> Self:
        ends = self.wind.field_ends_s
        if ends is not None and self.flight.duration_s > ends:
            why = f'the field ends {ends:g} s after the flight begins, which takes {self.flight.duration_s:g} s: after = "hold" or "repeat" says what follows'
            raise because(("wind", "field", "after"), why)
        return self

    @model_validator(mode="after")
    def _can_end_so(self) -> Self:
        ended, items = self.expect.ended, self.flight.items  # type: ignore[attr-defined]
        self._check_plan_items()
        lands = bool(items) and ends_on_ground(items[-1])
        if self.flight.script is not None:
            if ended in ("time", "arrived", "done", "refused"):
                why = f"a flight with a script never ends {ended}: expected landed, script, fell, diverged or crashed"
                raise because(("expect", "ended"), why)
            if self.expect.limited is not None:  # type: ignore[attr-defined]
                why = "what a script asked for is not recorded, only what the vehicle made of it: leave it out"
                raise because(("expect", "limited"), why)
            return self
        lacks = {
            "script": "[flight] script names one",
            "arrived": self.flight.arrive is None and "[flight] arrive says when it has arrived",
            "landed": not lands and "the last of [[flight.items]] is land or return",
            "done": (lands or not items) and "the last of [[flight.items]] does not land",
            "refused": not items and "there are [[flight.items]]",
        }
        if lack := lacks.get(ended):
            key = ("expect", "ended")
            raise because(key, f"a flight ends {ended} only where {lack}: this end can never come")
        return self

    def _check_plan_items(self) -> None:
        numbered = self.expect.items  # type: ignore[attr-defined]
        if numbered is None:
            return
        plans = [item for item in self.flight.items if isinstance(item, Plan)]
        if len(plans) != 1:
            why = f"the flight needs one plan for these, and has {len(plans) or 'none'}"
            raise because(("expect", "items"), why)
        if plans[0].is_known:
            plans[0].check_items(("expect", "items"), numbered)


@cache
def document(law: Law) -> type[Document]:
    """A mission of a law."""
    if law.settings.PARAMETERS is PARAMETERS:
        return Document
    table = law_table(law.settings.PARAMETERS, law.guard is not None, has_rule(law))
    made: type[Document] = create_model("Document", __base__=Document, law=(table, table()))
    return made
