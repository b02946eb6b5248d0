"""The law's numbers as parameters: how each is read off LawParams, and what setting it changes.

A parameter that nobody has set leaves its fields as they were handed over, to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from fcu.guard.stability import rotor_lag
from fcu.laws.mmrac.parameters import BOUNDS, DEFAULTS, GOVERN, POLICIES, PRINTED_BOUNDS, WARN
from fcu.laws.mmrac.types import LawParams
from fcu.parameters_table import Parameter

PREDICTION, GAMMA = "MR_PRED", "MR_GAMMA"
MULTIPLES = {
    "MR_G_M": "gamma_m", "MR_G_LAM": "gamma_Lambda", "MR_G_J": "gamma_J",
    "MR_G_LAMJ": "gamma_LambdaJ", "MR_G_C": "gamma_c",
}  # fmt: skip


class OfLaw(NamedTuple):
    """A parameter of the law, its value in LawParams, and LawParams with another value."""

    parameter: Parameter
    get: Callable[[LawParams], float]
    put: Callable[[LawParams, float], LawParams]


def with_field(law: LawParams, field: str, value: float) -> LawParams:
    """LawParams with another number in one field."""
    return LawParams(**{**law._asdict(), field: value})


def _field(field: str, *parameter: object, **more: bool) -> OfLaw:
    return OfLaw(
        Parameter(*parameter, **more),  # type: ignore[arg-type]
        lambda law: float(getattr(law, field)),
        lambda law, value: with_field(law, field, value),
    )


def _bound(field: str, *parameter: object) -> OfLaw:
    return OfLaw(
        Parameter(*parameter),  # type: ignore[arg-type]
        lambda law: float(getattr(law.bounds, field)),
        lambda law, value: law._replace(bounds=law.bounds._replace(**{field: value})),
    )


def _believed(field: str, *parameter: object) -> OfLaw:
    return OfLaw(
        Parameter(*parameter),  # type: ignore[arg-type]
        lambda law: float(getattr(law.guard, field)),
        lambda law, value: law._replace(guard=law.guard._replace(**{field: value})),
    )


def _multiple(name: str, high: float, sentence: str) -> OfLaw:
    field = MULTIPLES[name]
    return OfLaw(
        Parameter(name, "gamma", 0.0, high, DEFAULTS[field], sentence),
        lambda law: float(getattr(law, field)) / law.gamma,
        lambda law, value: with_field(law, field, law.gamma * value),
    )


def _put_gamma(law: LawParams, gamma: float) -> LawParams:
    gains = {f: gamma * (getattr(law, f) / law.gamma) for f in MULTIPLES.values()}
    root = math.sqrt(gamma)
    law = LawParams(**{**law._asdict(), **gains})
    return law._replace(gamma=gamma, lambda_v=root, lambda_w=root)


def _put_prediction(law: LawParams, achieved: float) -> LawParams:
    """The other prediction, with its own defaults for what stands at a default of this one."""
    sets = {0.0: PRINTED_BOUNDS, 1.0: BOUNDS}
    old, new = sets[law.achieved], sets[achieved]
    bounds = {f: new[f] if v == old[f] else v for f, v in law.bounds._asdict().items()}
    J_0 = {0.0: 0.0, 1.0: float(DEFAULTS["J_hat_0"])}
    J_hat_0 = J_0[achieved] if law.J_hat_0 == J_0[law.achieved] else law.J_hat_0
    policies = {0.0: WARN, 1.0: GOVERN}
    policy = law.guard.policy
    policy = policies[achieved] if policy == policies[law.achieved] else policy
    return law._replace(
        achieved=achieved, bounds=law.bounds._replace(**bounds), J_hat_0=J_hat_0,
        guard=law.guard._replace(policy=policy),
    )  # fmt: skip


def _response(law: LawParams) -> float:
    lag = rotor_lag(law)
    return lag / law.kappa if law.kappa > 1.0 else max(lag, float(DEFAULTS["rotor_response_s"]))


TABLE: tuple[OfLaw, ...] = (
    OfLaw(
        Parameter(
            PREDICTION, "", 0.0, 1.0, 1.0, "1 predicts with the achieved force, 0 as printed",
            disarmed_only=True, values=(0.0, 1.0),
        ),
        lambda law: law.achieved,
        _put_prediction,
    ),
    OfLaw(
        Parameter(
            GAMMA, "1/s^2", 1.0, 1e6, DEFAULTS["gamma"],
            "adaptation gain; predictor gains are its root, block gains its multiples",
        ),
        lambda law: law.gamma,
        _put_gamma,
    ),
    _multiple("MR_G_M", 100.0, "adaptation gain of the mass, as printed"),
    _multiple("MR_G_LAM", 0.1, "adaptation gain of 1/mass"),
    _multiple("MR_G_J", 100.0, "adaptation gain of the inertia, as printed"),
    _multiple("MR_G_LAMJ", 100.0, "adaptation gain of 1/inertia"),
    _multiple("MR_G_C", 100.0, "adaptation gain of the couplings between rates"),
    _field("f_m", "MR_F_M", "rad/s", 0.1, 10.0, DEFAULTS["f_m"], "frequency of the reference model"),
    _field("zeta_m", "MR_ZETA_M", "", 0.3, 5.0, DEFAULTS["zeta_m"], "damping of the reference model"),
    OfLaw(
        Parameter("MR_C_TILT", "1/s", 0.1, 200.0, DEFAULTS["c_angle"], "gain of roll and pitch"),
        lambda law: law.c_angle.x,
        lambda law, value: law._replace(c_angle=law.c_angle._replace(x=value, y=value)),
    ),
    OfLaw(
        Parameter("MR_C_YAW", "1/s", 0.1, 200.0, DEFAULTS["c_angle"], "gain of yaw"),
        lambda law: law.c_angle.z,
        lambda law, value: law._replace(c_angle=law.c_angle._replace(z=value)),
    ),
    OfLaw(
        Parameter("MR_C_PQ", "1/s", 0.1, 2000.0, DEFAULTS["c_rate"], "gain of the rates p and q"),
        lambda law: law.c_rate.x,
        lambda law, value: law._replace(c_rate=law.c_rate._replace(x=value, y=value)),
    ),
    OfLaw(
        Parameter("MR_C_R", "1/s", 0.1, 2000.0, DEFAULTS["c_rate"], "gain of the rate r"),
        lambda law: law.c_rate.z,
        lambda law, value: law._replace(c_rate=law.c_rate._replace(z=value)),
    ),
    OfLaw(
        Parameter("MR_T_MIN", "N", 0.0, 100.0, 5.0, "least total thrust"),
        lambda law: law.T_min,
        lambda law, value: law._replace(T_min=value, f_min=value / 8.0),
    ),
    _field("T_max", "MR_T_MAX", "N", 10.0, 1000.0, 200.0, "greatest total thrust"),
    OfLaw(
        Parameter("MR_TILT_MAX", "deg", 1.0, 79.0, 45.0, "greatest roll, and greatest pitch"),
        lambda law: math.degrees(law.phi_star),
        lambda law, value: law._replace(phi_star=math.radians(value)),
    ),
    OfLaw(
        Parameter(
            "MR_YAWRATE_MAX", "deg/s", 1.0, 360.0, math.degrees(DEFAULTS["yaw_rate_max"]),
            "greatest yaw rate towards a command",
        ),
        lambda law: math.degrees(law.yaw_rate_max),
        lambda law, value: law._replace(yaw_rate_max=math.radians(value)),
    ),
    _field("trim_rate", "MR_TRIM_RATE", "1/s", 0.0, 20.0, DEFAULTS["trim_rate"], "rate of the trim of thrust"),
    _field("trim_max", "MR_TRIM_MAX", "N", 0.0, 100.0, DEFAULTS["trim_max"], "limit of that trim"),
    OfLaw(
        Parameter(
            "MR_ROTOR_RESP", "s", 0.0001, 1.0, DEFAULTS["rotor_response_s"],
            "what the rotors' lag is made to look like",
        ),
        _response,
        lambda law, value: law._replace(kappa=max(1.0, rotor_lag(law) / value)),
    ),
    _bound("m_min", "MR_M_MIN", "kg", 0.1, 100.0, BOUNDS["m_min"], "least mass estimate"),
    _bound("m_max", "MR_M_MAX", "kg", 0.1, 100.0, BOUNDS["m_max"], "greatest mass estimate"),
    _bound("J_min", "MR_J_MIN", "kg m^2", 0.0, 10.0, BOUNDS["J_min"], "least inertia estimate"),
    _bound("J_max", "MR_J_MAX", "kg m^2", 0.001, 10.0, BOUNDS["J_max"], "greatest inertia estimate"),
    _bound("s_v_max", "MR_S_V_MAX", "m/s^2", 0.0, 1000.0, BOUNDS["s_v_max"], "greatest estimate of drag over mass"),
    _bound("s_w_max", "MR_S_W_MAX", "rad/s^2", 0.0, 1000.0, BOUNDS["s_w_max"], "greatest angular disturbance"),
    _bound("c_max", "MR_C_MAX", "", 0.0, 1000.0, BOUNDS["c_max"], "greatest coupling between rates"),
    _field("m_hat_0", "MR_M_0", "kg", 0.1, 100.0, DEFAULTS["m_hat_0"], "mass estimate at arming"),
    _field("J_hat_0", "MR_J_0", "kg m^2", 0.0, 10.0, DEFAULTS["J_hat_0"], "inertia estimate at arming"),
    OfLaw(
        Parameter(
            "MR_GUARD", "", 0.0, 2.0, POLICIES[DEFAULTS["guard"]],
            "when the actuators do not suffice: 0 warns, 1 governs, 2 refuses",
            values=tuple(POLICIES.values()),
        ),
        lambda law: law.guard.policy,
        lambda law, value: law._replace(guard=law.guard._replace(policy=value)),
    ),
    _believed("m_min", "MR_GRD_M_MIN", "kg", 0.1, 100.0, DEFAULTS["guard_mass_kg"][0], "least mass that the guard believes in"),
    _believed("m_max", "MR_GRD_M_MAX", "kg", 0.1, 100.0, DEFAULTS["guard_mass_kg"][1], "greatest mass that it believes in"),
    _believed("c_D", "MR_GRD_DRAG", "N/(m/s)^2", 0.001, 10.0, DEFAULTS["guard_drag"], "greatest drag coefficient that it believes in"),
    _believed("w_max", "MR_GRD_WIND", "m/s", 0.0, 100.0, DEFAULTS["guard_wind_m_s"], "greatest wind that it believes in"),
    _believed("w_dot_max", "MR_GRD_WRATE", "m/s^2", 0.0, 1000.0, DEFAULTS["guard_wind_rate_m_s2"], "greatest rate of that wind"),
    _believed("jerk", "MR_GRD_JERK", "m/s^3", 5.0, 1000.0, DEFAULTS["guard_jerk_m_s3"], "fastest change of the acceleration of what is governed"),
    OfLaw(
        Parameter("MR_RATE", "Hz", 1.0, 10000.0, 500.0, "control rate, set at the start", True),
        lambda law: 1.0 / law.h,
        lambda law, value: law._replace(h=1.0 / value),
    ),
)  # fmt: skip

LAW: dict[str, OfLaw] = {entry.parameter.name: entry for entry in TABLE}  # in the order of `put`

# What decides whether a channel is stable; what stands first is what it is held against.
_OF_TILT = ("MR_C_TILT", "MR_C_PQ", "MR_F_M", "MR_ZETA_M", "MR_GAMMA", "MR_ROTOR_RESP")
DECIDES: dict[str, tuple[str, ...]] = {
    "height": ("MR_F_M", "MR_GAMMA", "MR_ZETA_M", "MR_G_LAM", "MR_TRIM_RATE", "MR_ROTOR_RESP"),
    "roll": _OF_TILT,
    "pitch": _OF_TILT,
    "yaw": ("MR_C_YAW", "MR_C_R", "MR_GAMMA", "MR_ROTOR_RESP"),
}


def with_values(start: LawParams, values: Mapping[str, float]) -> LawParams:
    """LawParams with the law parameters among `values`; `start` itself if there are none."""
    law = start
    for name, entry in LAW.items():
        if name in values:
            law = entry.put(law, values[name])
    return law
