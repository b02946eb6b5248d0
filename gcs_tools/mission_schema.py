"""What may stand in a mission file: the tables, their keys, units and limits.

The JSON Schema that editors complete missions from is made of these classes
(`make schemas`); the texts below are what an editor shows.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, create_model, field_validator, model_validator

from fcu.law.parameters import BOUNDS, DEFAULTS
from gcs_tools.metrics import METRICS

RATES = (100.0, 125.0, 200.0, 250.0, 400.0, 500.0, 800.0, 1000.0)

Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Three = tuple[Number, Number, Number]
ThreePositive = tuple[Positive, Positive, Positive]
ThreeNotNegative = tuple[NotNegative, NotNegative, NotNegative]


class Table(BaseModel):
    """A table that refuses keys it does not know."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class Start(Table):
    """The state in which the flight begins: at rest, level, rotors at hover speed."""

    position_m: Three = Field((0.0, 0.0, 0.0), description="East, North, Up")
    velocity_m_s: Three = Field((0.0, 0.0, 0.0), description="East, North, Up")
    yaw_deg: Number = Field(0.0, description="from East, counter-clockwise")
    on_ground: bool = Field(False, description="standing on the gear, rotors stopped")


class PositionAt(Table):
    """A position to be at from a time on."""

    at_s: NotNegative
    position_m: Three = Field(description="East, North, Up")


class FigureEight(Table):
    """A figure of eight in a horizontal plane, started from rest."""

    kind: Literal["figure_eight"]
    centre_m: Three
    size_m: tuple[Positive, Positive] = Field(description="half width East, half width North")
    speed_max_m_s: Positive = Field(description="reached where the two lobes cross")
    ramp_s: Positive = Field(5.0, description="time to reach full speed")


class SineYaw(Table):
    """A sinusoidal yaw command."""

    amplitude_rad: Number
    frequency_rad_s: Number


class Arrive(Table):
    """End the flight when the last setpoint is reached."""

    within_m: Positive
    for_s: NotNegative = 1.0


class Flight(Table):
    """Where the flight begins, where it is sent, and for how long."""

    duration_s: Annotated[float, Field(gt=0.0, le=3600.0)] = Field(description="simulation time")
    rate_hz: Number = Field(500.0, description="control rate")
    seed: Annotated[int, Field(ge=0)] = Field(1, description="of the noise")
    start: Start = Start()
    ground_z_m: Number = Field(-10.0, description="height of the ground")
    arena_m: Positive = Field(100.0, description="farther from the start is `diverged`")
    setpoints: tuple[PositionAt, ...] = Field((), description="positions over time")
    curve: FigureEight | None = Field(None, description="a moving setpoint")
    yaw_deg: Number = Field(0.0, description="constant yaw command")
    yaw: SineYaw | None = Field(None, description="a yaw command that moves, about yaw_deg")
    stream_hz: Positive = Field(50.0, description="rate at which a moving setpoint is sent")
    arrive: Arrive | None = None

    @field_validator("rate_hz")
    @classmethod
    def _whole_period(cls, rate: float) -> float:
        if rate not in RATES:
            raise ValueError("one of " + ", ".join(f"{r:g}" for r in RATES))
        return rate

    @model_validator(mode="after")
    def _setpoints_make_sense(self) -> Flight:
        if bool(self.setpoints) == (self.curve is not None):
            raise ValueError("expected either setpoints or curve")
        times = [s.at_s for s in self.setpoints]
        if times and times[0] != 0.0:
            raise ValueError("expected the first of setpoints at at_s = 0")
        if times != sorted(set(times)):
            raise ValueError("expected setpoints in order of time")
        if self.setpoints and self.start.on_ground and self.start.position_m[2] != 0.0:
            raise ValueError("expected no height in start.position_m with on_ground")
        return self


Bounds = create_model(
    "Bounds",
    __base__=Table,
    __doc__="The sets that projection keeps the estimates in.",
    **{name: (NotNegative | None, None) for name in BOUNDS},  # type: ignore[call-overload]
)

_SCALARS = {
    name: (Number | None, None)
    for name, value in DEFAULTS.items()
    if isinstance(value, int | float) and name not in ("c_angle", "c_rate")
}

_Scalars = create_model("_Scalars", __base__=Table, **_SCALARS)  # type: ignore[call-overload]


class Law(_Scalars):  # type: ignore[misc, valid-type]
    """The law's parameters; a key that is absent keeps the law's own default."""

    prediction: Literal["achieved", "demanded"] | None = Field(
        None, description="force and torque the predictors use; demanded: the paper to the letter"
    )
    c_angle: Positive | ThreePositive | None = Field(None, description="c_phi, c_theta, c_psi, 1/s")
    c_rate: Positive | ThreePositive | None = Field(None, description="c_p, c_q, c_r, 1/s")
    bounds: Bounds | None = None  # type: ignore[valid-type]
    rotor_lag_s: NotNegative | None = Field(None, description="what the controller believes")
    thrust_min_n: NotNegative | None = None
    thrust_max_n: Positive | None = None
    tilt_max_deg: Positive | None = None
    r_m_offset: Three | None = Field(None, description="reference model at take-over, m, ENU")
    v_hat_offset: Three | None = Field(None, description="predictor at take-over, m/s, ENU")


class Wind(Table):
    """The air: its velocity towards, in East, North, Up, and its rotation."""

    steady_m_s: Three = (0.0, 0.0, 0.0)
    amplitude_m_s: Three = Field((0.0, 0.0, 0.0), description="of sinusoids, axis by axis")
    frequency_rad_s: Three = (0.0, 0.0, 0.0)
    rotation_amplitude_rad_s: Three = Field((0.0, 0.0, 0.0), description="about body axes")
    rotation_frequency_rad_s: Three = (0.0, 0.0, 0.0)
    step_m_s: Three = Field((0.0, 0.0, 0.0), description="added from step_at_s on")
    step_at_s: NotNegative | None = None


class MassChange(Table):
    """The mass from a time on."""

    at_s: NotNegative
    mass_kg: Positive


class RotorLoss(Table):
    """A rotor that loses thrust and torque from a time on."""

    rotor: Annotated[int, Field(ge=1, le=8)]
    at_s: NotNegative
    effectiveness: Annotated[float, Field(ge=0.0, le=1.0)] = Field(description="fraction left")


class Noise(Table):
    """White noise on the reported state at every tick, one sigma an axis."""

    position_m: NotNegative = 0.0
    velocity_m_s: NotNegative = 0.0
    attitude_deg: NotNegative = 0.0
    rate_rad_s: NotNegative = 0.0


class Plant(Table):
    """How the truth differs from truth.toml and from what the controller believes."""

    mass_kg: Positive | None = None
    inertia_kg_m2: ThreePositive | None = None
    drag: ThreeNotNegative | None = Field(None, description="N/(m/s)^2, body axes")
    drag_torque: ThreeNotNegative | None = Field(None, description="N m/(rad/s)^2")
    rotor_lag_s: NotNegative | None = None
    mass_change: MassChange | None = None
    rotor_loss: tuple[RotorLoss, ...] = ()
    noise: Noise | None = None
    delay_s: Annotated[float, Field(ge=0.0, le=1.0)] = Field(0.0, description="of the report")


class Limit(Table):
    """A limit on a metric, over a window of time."""

    limit: Number | None = Field(None, description="at most")
    at_least: Number | None = None
    from_s: NotNegative | None = Field(None, alias="from", description="s")
    to_s: NotNegative | None = Field(None, alias="to", description="s")

    @model_validator(mode="after")
    def _one_limit(self) -> Limit:
        if (self.limit is None) == (self.at_least is None):
            raise ValueError("expected either limit or at_least")
        if self.from_s is not None and self.to_s is not None and self.from_s >= self.to_s:
            raise ValueError("expected from before to")
        return self


_LIMITS: dict[str, Any] = {name: (Number | Limit | None, None) for name in METRICS}
_Limits = create_model("_Limits", __base__=Table, **_LIMITS)


class Expect(_Limits):  # type: ignore[misc, valid-type]
    """What the flight must show: a metric and its limit, or how it must end."""

    ended: Literal["time", "arrived", "diverged", "crashed"] | None = None


class MissionFile(Table):
    """One flight, and what is expected of it."""

    title: str = Field(description="what the mission is about, as a sentence")
    flight: Flight
    law: Law = Law()
    wind: Wind = Wind()
    plant: Plant = Plant()
    expect: Expect

    @field_validator("title")
    @classmethod
    def _is_sentence(cls, title: str) -> str:
        if len(title) < 10 or not title[0].isupper() or not title.endswith("."):
            raise ValueError("a sentence: a capital first, a full stop last")
        return title
