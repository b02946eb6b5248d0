"""The tables of a mission file, as frozen models: what may be written, in which unit and range.

A key's unit is in its name where it is not obvious. Frames: Earth East-North-Up, body
Forward-Left-Up. A key left out of [law] or [plant] is the law's own default, or the truth of
sitl_plant/truth.toml.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, create_model, model_validator

from gcs_tools.judging.metrics import METRICS
from gcs_tools.missions.fields import (
    ZERO,
    NotNegative,
    NotNegatives,
    Numbers,
    Positive,
    Positives,
    Table,
    optional,
    three,
    wrong,
)
from gcs_tools.missions.flight_table import Flight

# --- [law]


class Bounds(Table):
    """The sets that projection keeps the estimates in."""

    m_min: Annotated[float, Field(ge=0.1, le=100.0)] | None = optional("kg")
    m_max: Annotated[float, Field(ge=0.1, le=100.0)] | None = optional("kg")
    J_min: Annotated[float, Field(ge=0.0, le=10.0)] | None = optional("kg m^2")
    J_max: Annotated[float, Field(ge=0.001, le=10.0)] | None = optional("kg m^2")
    s_v_max: Annotated[float, Field(ge=0.0, le=1000.0)] | None = optional(
        "drag force over mass, m/s^2"
    )
    s_w_max: Annotated[float, Field(ge=0.0, le=1000.0)] | None = optional(
        "angular disturbance, rad/s^2"
    )
    c_max: Annotated[float, Field(ge=0.0, le=1000.0)] | None = optional(
        "coupling and gyroscopic coefficients"
    )


class Law(Table):
    """Parameters of the law; fcu/laws/mmrac/README.md says what each does."""

    prediction: Literal["achieved", "demanded"] | None = optional("force the predictor is told")
    f_m: Annotated[float, Field(ge=0.1, le=10.0)] | None = optional("reference model, rad/s")
    zeta_m: Annotated[float, Field(ge=0.3, le=5.0)] | None = optional("reference model's damping")
    gamma: Annotated[float, Field(ge=1.0, le=1000000.0)] | None = optional("adaptation gain")
    gamma_m: Annotated[float, Field(ge=0.0, le=100.0)] | None = optional(
        "gain of m_hat (demanded), times gamma"
    )
    gamma_Lambda: Annotated[float, Field(ge=0.0, le=0.1)] | None = optional(
        "gain of Lambda_hat (achieved), times gamma"
    )
    gamma_J: Annotated[float, Field(ge=0.0, le=100.0)] | None = optional(
        "gain of J_hat (demanded), times gamma"
    )
    gamma_LambdaJ: Annotated[float, Field(ge=0.0, le=100.0)] | None = optional(
        "gain of LambdaJ_hat (achieved), times gamma"
    )
    gamma_c: Annotated[float, Field(ge=0.0, le=100.0)] | None = optional(
        "gain of the coupling coefficients, times gamma"
    )
    c_angle: (
        Annotated[
            Annotated[
                tuple[
                    Annotated[float, Field(ge=0.1, le=200.0)],
                    Annotated[float, Field(ge=0.1, le=200.0)],
                    Annotated[float, Field(ge=0.1, le=200.0)],
                ],
                Field(strict=False),
            ],
            BeforeValidator(
                three,
                json_schema_input_type=float
                | Annotated[
                    tuple[
                        Annotated[float, Field(ge=0.1, le=200.0)],
                        Annotated[float, Field(ge=0.1, le=200.0)],
                        Annotated[float, Field(ge=0.1, le=200.0)],
                    ],
                    Field(strict=False),
                ],
            ),
        ]
        | None
    ) = optional("angle gains, 1/s: one, or roll, pitch, yaw")
    c_rate: (
        Annotated[
            Annotated[
                tuple[
                    Annotated[float, Field(ge=0.1, le=2000.0)],
                    Annotated[float, Field(ge=0.1, le=2000.0)],
                    Annotated[float, Field(ge=0.1, le=2000.0)],
                ],
                Field(strict=False),
            ],
            BeforeValidator(
                three,
                json_schema_input_type=float
                | Annotated[
                    tuple[
                        Annotated[float, Field(ge=0.1, le=2000.0)],
                        Annotated[float, Field(ge=0.1, le=2000.0)],
                        Annotated[float, Field(ge=0.1, le=2000.0)],
                    ],
                    Field(strict=False),
                ],
            ),
        ]
        | None
    ) = optional("rate gains, 1/s: one, or roll, pitch, yaw")
    bounds: Bounds = Bounds()
    m_hat_0: Annotated[float, Field(ge=0.1, le=100.0)] | None = optional(
        "mass estimate at take-over, kg"
    )
    J_hat_0: Annotated[float, Field(ge=0.0, le=10.0)] | None = optional(
        "inertia estimates at take-over (achieved), kg m^2"
    )
    J_implicit: Annotated[float, Field(ge=1e-06)] | None = optional(
        "least J_hat in the backward-Euler step (demanded)"
    )
    r_m_offset: (
        Annotated[
            tuple[
                Annotated[float, Field(ge=-100000.0, le=100000.0)],
                Annotated[float, Field(ge=-100000.0, le=100000.0)],
                Annotated[float, Field(ge=-100000.0, le=100000.0)],
            ],
            Field(strict=False),
        ]
        | None
    ) = optional("reference model minus position at take-over, m")
    v_hat_offset: (
        Annotated[
            tuple[
                Annotated[float, Field(ge=-100000.0, le=100000.0)],
                Annotated[float, Field(ge=-100000.0, le=100000.0)],
                Annotated[float, Field(ge=-100000.0, le=100000.0)],
            ],
            Field(strict=False),
        ]
        | None
    ) = optional("predictor minus velocity at take-over, m/s")
    rotor_lag_s: Annotated[float, Field(ge=0.0, le=10.0)] | None = optional(
        "believed lag of the rotors"
    )
    rotor_response_s: Annotated[float, Field(ge=0.0001, le=1.0)] | None = optional(
        "what the inverted rotor lag is made to look like"
    )
    thrust_min_n: Annotated[float, Field(ge=0.0, le=100.0)] | None = optional(
        "limit of the total thrust"
    )
    thrust_max_n: Annotated[float, Field(ge=10.0, le=1000.0)] | None = optional(
        "limit of the total thrust"
    )
    tilt_max_deg: Annotated[float, Field(ge=1.0, le=79.0)] | None = optional("roll and pitch")
    T_dz_min: Annotated[float, Field(ge=0.0, le=1000.0)] | None = optional(
        "floor of the demanded vertical force, N"
    )
    trim_rate: Annotated[float, Field(ge=0.0, le=20.0)] | None = optional("trim of thrust, 1/s")
    trim_max: Annotated[float, Field(ge=0.0, le=100.0)] | None = optional("limit of that trim, N")
    tilt_rate_bandwidth: Annotated[float, Field(ge=0.1, le=1000.0)] | None = optional(
        "filter of the tilt command's rate, rad/s"
    )
    tilt_rate_max: Annotated[float, Field(ge=0.01, le=100.0)] | None = optional(
        "limit of the tilt command's rate, rad/s"
    )
    yaw_rate_max: Annotated[float, Field(ge=0.017453292519943295, le=6.283185307179586)] | None = (
        optional("limit of the commanded rate of yaw, rad/s")
    )
    yaw_acceleration: Annotated[float, Field(ge=0.01, le=100.0)] | None = optional(
        "what yaw is believed to slow down with, rad/s^2"
    )
    guard: Literal["warn", "govern", "refuse"] | None = optional(
        "when the actuators do not suffice"
    )
    guard_mass_kg: (
        Annotated[
            tuple[
                Annotated[float, Field(ge=0.1, le=100.0)], Annotated[float, Field(ge=0.1, le=100.0)]
            ],
            Field(strict=False),
        ]
        | None
    ) = optional("between which the mass is believed to lie")
    guard_drag: Annotated[float, Field(ge=0.001, le=10.0)] | None = optional(
        "greatest drag coefficient, N/(m/s)^2"
    )
    guard_wind_m_s: Annotated[float, Field(ge=0.0, le=100.0)] | None = optional(
        "greatest velocity of the air"
    )
    guard_wind_rate_m_s2: Annotated[float, Field(ge=0.0, le=1000.0)] | None = optional(
        "greatest rate of that velocity"
    )
    guard_jerk_m_s3: Annotated[float, Field(ge=5.0, le=1000.0)] | None = optional(
        "fastest change of the reference's acceleration"
    )


# --- [wind]


class Wind(Table):
    """The air: steady, plus amplitude sin(frequency t), plus a step; and its rotation."""

    steady_m_s: Numbers = Field(ZERO, description="velocity of the air, ENU")
    amplitude_m_s: Numbers = Field(ZERO, description="ENU")
    frequency_rad_s: NotNegatives = ZERO
    rotation_amplitude_rad_s: Numbers = Field(ZERO, description="body axes")
    rotation_frequency_rad_s: NotNegatives = ZERO
    step_m_s: Numbers = Field(ZERO, description="added from step_at_s on, ENU")
    step_at_s: NotNegative | None = optional("when the step comes")

    @model_validator(mode="after")
    def _step_has_a_time(self) -> Self:
        if self.step_m_s != ZERO and self.step_at_s is None:
            raise wrong(("step_at_s",), "a time for step_m_s")
        return self


# --- [plant]


class MassChange(Table):
    """A package dropped, or taken up."""

    at_s: NotNegative
    mass_kg: Positive


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


class Plant(Table):
    """How the truth differs from sitl_plant/truth.toml, and what the plant reports of it."""

    mass_kg: Positive | None = optional("kg")
    inertia_kg_m2: Positives | None = optional("principal moments, body axes")
    drag: NotNegatives | None = optional("quadratic, N/(m/s)^2, body axes")
    drag_torque: NotNegatives | None = optional("quadratic, N m/(rad/s)^2, body axes")
    rotor_lag_s: NotNegative | None = optional("first-order lag of the rotors' speed; may be 0")
    mass_change: MassChange | None = optional("in mid-flight")
    rotor_loss: Annotated[tuple[RotorLoss, ...], Field(strict=False)] = Field(
        (), description="at most one a rotor"
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


# --- [expect]


class Bound(Table):
    """A limit of a metric, over the flight or from a time to a time. A number is its `limit`."""

    limit: float | None = optional("at most")
    at_least: float | None = optional("at least")
    t_from: NotNegative | None = Field(None, alias="from", description="s")
    t_to: NotNegative | None = Field(None, alias="to", description="s")

    @model_validator(mode="after")
    def _one_limit(self) -> Self:
        if (self.limit is None) == (self.at_least is None):
            raise wrong((), "either limit or at_least")
        if (self.t_to or math.inf) <= (self.t_from or 0.0):
            raise wrong(("to",), f"a time after from, {self.t_from or 0.0:g}", self.t_to)
        return self


def _bound(value: Any) -> Any:
    """A number as the table that it is short for."""
    if isinstance(value, dict):
        return value
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise wrong((), "a number, or a table { limit or at_least, from, to }", value)
    return {"limit": value}


_Limit = Annotated[Bound, BeforeValidator(_bound, json_schema_input_type=float | Bound)]
_Ending = Literal["time", "arrived", "diverged", "crashed"]

_ended: Any = (_Ending | None, optional("how the flight ends; left out: time or arrived"))
_limits: dict[str, Any] = {name: (_Limit | None, None) for name in METRICS}
Expect: type[Table] = create_model(
    "Expect",
    __base__=Table,
    __doc__="What the flight is held against: metric = limit, or a table.",
    ended=_ended,
    **_limits,
)


# --- the file


def _sentence(text: str) -> str:
    if not (text[:1].isupper() and text.endswith(".") and "\n" not in text):
        raise wrong((), "a sentence on one line: a capital first, a full stop last", text)
    return text


class Document(Table):
    """A mission of the M-MRAC flight stack."""

    title: Annotated[str, AfterValidator(_sentence)] = Field(description="a sentence")
    flight: Flight
    law: Law = Law()
    wind: Wind = Wind()
    plant: Plant = Plant()
    expect: Expect = Expect()
