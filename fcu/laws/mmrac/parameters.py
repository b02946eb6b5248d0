"""The parameters of the law: the one table of them, Params from it, and what must hold between."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from fcu.interface.airframe import Airframe, G
from fcu.interface.parameter import (
    Conversion,
    Parameter,
    ParameterError,
    Part,
    Value,
    blank,
    default,
    filled,
    flat,
    group,
    values,
    with_field,
)
from fcu.interface.parameter import check as check_rows
from fcu.laws import actuation, scales
from fcu.laws.allocation import believed_rotors
from fcu.laws.face import Pace
from fcu.laws.mmrac.types import Params

ACHIEVED, DEMANDED = "achieved", "demanded"
PREDICTIONS = {ACHIEVED: 1.0, DEMANDED: 0.0}

# Defaults with prediction = "demanded". Section VIII gives no bounds; these are the ones with
# which its figures come out. It begins without an estimate of inertia.
PRINTED: dict[str, Value] = {
    "bounds.J_min": 0.0,
    "bounds.s_v_max": 1000.0,
    "bounds.s_w_max": 1000.0,
    "bounds.c_max": 1000.0,
    "J_hat_0": 0.0,
    # of Section VIII
    "f_m": 1.0,
    "gamma": 1000.0,
    "c_angle": (10.0, 10.0, 10.0),
    "c_rate": (20.0, 20.0, 20.0),
}
# and parts of the middle of the mass that is believed, 8 kg in Section VIII
PRINTED_MASSES = {"bounds.m_min": 1.0 / 16.0, "bounds.m_max": 1.5, "m_hat_0": 0.625}


# --- what a number has to do with Params, where it is not one of its fields

MULTIPLES = ("gamma_m", "gamma_Lambda", "gamma_J", "gamma_LambdaJ", "gamma_c")


def _multiple(field: str) -> Conversion:
    return Conversion(
        lambda law: getattr(law, field) / law.gamma,
        lambda law, times: with_field(law, field, law.gamma * times),
    )


def _put_gamma(law: Params, gamma: float) -> Params:
    gains = {f: gamma * (getattr(law, f) / law.gamma) for f in MULTIPLES}
    root = math.sqrt(gamma)  # Section VIII: k = sqrt(gamma)
    return law._replace(gamma=gamma, lambda_v=root, lambda_w=root, **gains)


def _put_prediction(law: Params, achieved: float, airframe: Mapping[str, Any]) -> Params:
    """The other prediction, with its own defaults for what stands at a default of this one."""
    if achieved == law.achieved:
        return law
    instead = printed({"prediction": DEMANDED}, airframe)
    for row in PARAMETERS:
        if row.key in instead:
            old, new = default(row, airframe), instead[row.key]
            old, new = (old, new) if law.achieved else (new, old)
            if row.get(law) == row.numbers(old):
                law = row.put(law, row.numbers(new))
    return law._replace(achieved=achieved)


def _put_least_thrust(law: Params, T_min: float) -> Params:
    f_min = T_min / law.rotors.W
    return law._replace(
        limits=law.limits._replace(T_min=T_min), rotors=law.rotors._replace(f_min=f_min)
    )


PREDICTION = Conversion(
    lambda law: law.achieved, lambda law, number: law._replace(achieved=number), _put_prediction
)
GAMMA = Conversion(lambda law: law.gamma, _put_gamma)
LEAST_THRUST = Conversion(lambda law: law.limits.T_min, _put_least_thrust)
TILT = Conversion(
    lambda law: math.degrees(law.limits.phi_star),
    lambda law, degrees: with_field(law, "limits.phi_star", math.radians(degrees)),
)
RATE = Conversion(lambda law: 1.0 / law.h, lambda law, rate_hz: law._replace(h=1.0 / rate_hz))


# --- the table


def _mean(several: Sequence[float]) -> float:
    return sum(several) / len(several)


# How a default follows from the tables of an airframe. README.md, "Gains that follow from an airframe"


def _gamma(tables: Mapping[str, Any]) -> float:
    """Estimates PREDICTS times as fast as the rates."""
    root = PREDICTS * scales.rate_bandwidth(tables).x
    return root * root


def _gamma_Lambda(tables: Mapping[str, Any]) -> float:
    T = scales.hover_thrust(tables)
    return ALONG / (T * T)


def _gamma_LambdaJ(tables: Mapping[str, Any]) -> float:
    tau = scales.torque(tables)
    learns_with = TWISTS * min(tau.x, tau.y)
    return 1.0 / (learns_with * learns_with)


def _tilt_rate_bandwidth(tables: Mapping[str, Any]) -> float:
    return FORWARD * scales.rate_bandwidth(tables).x


def _tilt_rate_max(tables: Mapping[str, Any]) -> float:
    return SWING * scales.attitude_bandwidth(tables).x


def _T_dz_min(tables: Mapping[str, Any]) -> float:
    return 0.25 * scales.hover_thrust(tables)


def _trim_max(tables: Mapping[str, Any]) -> float:
    return 0.375 * scales.hover_thrust(tables)


def _J_min(tables: Mapping[str, Any]) -> float:
    return min(scales.inertia(tables)) / 16.0


def _J_max(tables: Mapping[str, Any]) -> float:
    return 4.0 * max(scales.inertia(tables))


def _J_implicit(tables: Mapping[str, Any]) -> float:
    return 0.3 * scales.inertia(tables).x


def _s_w_max(tables: Mapping[str, Any]) -> float:
    alpha = scales.authority(tables)
    return 1.5 * max(alpha.x, alpha.y)


PREDICTS = 3.2
ALONG = 3.0  # gamma_Lambda T^2 over gamma in hover: a damping ratio of 1/4 along the thrust
TWISTS = 0.05  # of the torque beside hover, at which inertia is learnt as fast as a disturbance
FORWARD = 2.1  # times the gain of the rates: the filter of what is fed forward to them
SWING = 0.7  # rad: what the gain of the angles makes of it is fed forward at most

P = Parameter
DEGREE = math.radians(1.0)

ROWS: tuple[Parameter, ...] = (
    *group(
        "Prediction and reference model",
        P(
            "prediction", "MR_PRED", ACHIEVED, 0.0, 1.0, "", "force and torque that the predictors are told",
            "achieved", PREDICTION, words=PREDICTIONS, disarmed_only=True, leads=True,
        ),
        # Section VIII of the paper
        P("f_m", "MR_F_M", None, 0.1, 10.0, "rad/s", "frequency of the reference model", rule=scales.position_bandwidth, gain=True),
        P("zeta_m", "MR_ZETA_M", 0.8, 0.3, 5.0, "", "damping of the reference model", gain=True),
    ),
    *group(
        "Adaptation",
        P(
            "gamma", "MR_GAMMA", None, 1.0, 1e6, "1/s^2",
            "adaptation gain; predictor gains are its root, block gains its multiples", convert=GAMMA, rule=_gamma, gain=True,
        ),
        # gains of mass and inertia, scaled to the size of their regressors (README.md)
        P("gamma_m", "MR_G_M", 1.0, 0.0, 100.0, "gamma", "adaptation gain of the mass, as printed", convert=_multiple("gamma_m")),
        P("gamma_Lambda", "MR_G_LAM", None, 0.0, 1e4, "gamma", "adaptation gain of 1/mass", convert=_multiple("gamma_Lambda"), rule=_gamma_Lambda),
        P("gamma_J", "MR_G_J", 1.0, 0.0, 100.0, "gamma", "adaptation gain of the inertia, as printed", convert=_multiple("gamma_J")),
        P("gamma_LambdaJ", "MR_G_LAMJ", None, 0.0, 1e8, "gamma", "adaptation gain of 1/inertia", convert=_multiple("gamma_LambdaJ"), rule=_gamma_LambdaJ),
        P("sigma_v", "MR_SIGMA_V", 0.7, 0.0, 10.0, "1/s", "leakage of the drag upwards into the mass: what lasts of it is mass"),
        P("gamma_c", "MR_G_C", 1.0, 0.0, 100.0, "gamma", "adaptation gain of the couplings between rates", convert=_multiple("gamma_c")),
    ),
    *group(
        "Attitude and rates",
        P(
            "c_angle",
            (Part("MR_C_TILT", ("c_angle.x", "c_angle.y"), "gain of roll and pitch"), Part("MR_C_YAW", ("c_angle.z",), "gain of yaw")),
            None, 0.1, 200.0, "1/s", "gains of the angles: one, or roll, pitch, yaw", axes=True, rule=lambda tables: tuple(scales.attitude_bandwidth(tables)), gain=True,
        ),
        P(
            "c_rate",
            (Part("MR_C_PQ", ("c_rate.x", "c_rate.y"), "gain of the rates p and q"), Part("MR_C_R", ("c_rate.z",), "gain of the rate r")),
            None, 0.1, 2000.0, "1/s", "gains of the rates: one, or p, q, r", axes=True, rule=lambda tables: tuple(scales.rate_bandwidth(tables)), gain=True,
        ),
        P("tilt_rate_bandwidth", "", None, 0.1, 1000.0, "rad/s", "filter of the tilt command's rate", rule=_tilt_rate_bandwidth),
        P("tilt_rate_max", "", None, 0.01, 100.0, "rad/s", "limit of the tilt command's rate", rule=_tilt_rate_max),
        P("yaw_rate_max", "MR_YAWRATE_MAX", 1.5, DEGREE, 360.0 * DEGREE, "rad/s", "greatest yaw rate towards a command", degrees=True),
        P("yaw_acceleration", "", None, 0.01, 1000.0, "rad/s^2", "what yaw is believed to slow down with", rule=scales.yaw_acceleration),
    ),
    *group(
        "Thrust, tilt and rotors",
        P("thrust_min_n", "MR_T_MIN", None, 0.0, 1e4, "N", "least total thrust", "limits.T_min", LEAST_THRUST, airframe="limits.thrust_min_n", below="thrust_max_n"),
        P("thrust_max_n", "MR_T_MAX", None, 0.1, 1e5, "N", "greatest total thrust", "limits.T_max", airframe="limits.thrust_max_n"),
        P("tilt_max_deg", "MR_TILT_MAX", None, 1.0, 79.0, "deg", "greatest roll, and greatest pitch", "limits.phi_star", TILT, airframe="limits.tilt_max_deg"),
        P("T_dz_min", "", None, 0.0, 1e5, "N", "floor of the demanded vertical force", rule=_T_dz_min),
        P("trim_rate", "MR_TRIM_RATE", 3.0, 0.0, 20.0, "1/s", "rate of the trim of thrust"),
        P("trim_max", "MR_TRIM_MAX", None, 0.0, 1e4, "N", "limit of that trim", rule=_trim_max),
        P("rotor_lag_s", "", None, 0.0, 10.0, "s", "believed lag of the rotors' speed", (), airframe="rotors.lag_s"),
        *actuation.rows("MR_ROTOR_RESP"),
    ),
    *group(
        "Sets of the estimates",
        P("bounds.m_min", "MR_M_MIN", None, 0.01, 1e4, "kg", "least mass estimate", airframe="vehicle.mass_kg", of_several=min, below="bounds.m_max"),
        P("bounds.m_max", "MR_M_MAX", None, 0.01, 1e4, "kg", "greatest mass estimate", airframe="vehicle.mass_kg"),
        P("bounds.J_min", "MR_J_MIN", None, 0.0, 1e4, "kg m^2", "least inertia estimate", below="bounds.J_max", rule=_J_min),
        P("bounds.J_max", "MR_J_MAX", None, 1e-6, 1e4, "kg m^2", "greatest inertia estimate", rule=_J_max),
        P("bounds.s_v_max", "MR_S_V_MAX", 30.0, 0.0, 1000.0, "m/s^2", "greatest estimate of drag over mass"),
        P("bounds.s_w_max", "MR_S_W_MAX", None, 0.0, 1e5, "rad/s^2", "greatest angular disturbance", rule=_s_w_max),
        P("bounds.c_max", "MR_C_MAX", 10.0, 0.0, 1000.0, "", "greatest coupling between rates"),
    ),
    *group(
        "Take-over",
        P("m_hat_0", "MR_M_0", None, 0.01, 1e4, "kg", "mass estimate at arming", "initial.m_hat_0", airframe="vehicle.mass_kg", of_several=_mean),
        P("J_hat_0", "MR_J_0", None, 0.0, 1e4, "kg m^2", "inertia estimate at arming", "initial.J_hat_0", airframe="vehicle.inertia_kg_m2", of_several=lambda axes: _mean(axes[0])),
        P("J_implicit", "", None, 1e-9, math.inf, "kg m^2", "least inertia estimate in the backward-Euler step, as printed", rule=_J_implicit),
        P("r_m_offset", "", (0.0, 0.0, 0.0), -1e5, 1e5, "m", "reference model minus position, ENU", "initial.r_m_offset"),
        P("v_hat_offset", "", (0.0, 0.0, 0.0), -1e5, 1e5, "m/s", "predicted minus measured velocity, ENU", "initial.v_hat_offset"),
    ),
    *group("Rate", P("", "MR_RATE", 500.0, 1.0, 10000.0, "Hz", "control rate, set at the start", "h", RATE, read_only=True)),
)  # fmt: skip

NAME = "mmrac"  # of the table [law.mmrac] of an airframe file
PARAMETERS = tuple(row._replace(law=NAME) for row in ROWS)


# --- Params


def printed(chosen: Mapping[str, Any], airframe: Mapping[str, Any]) -> Mapping[str, Value]:
    """The defaults that are others with what was chosen: those of the printed prediction.

    `airframe`: the tables of an airframe file.
    """
    if chosen.get("prediction") != DEMANDED:
        return {}
    m = scales.mass(airframe)
    return {**PRINTED, **{key: part * m for key, part in PRINTED_MASSES.items()}}


def law_params(
    believed: Airframe,
    airframe: Mapping[str, Any],
    rate_hz: float,
    chosen: Mapping[str, Any] | None = None,
) -> Params:
    """Params for an airframe and a control rate.

    `airframe`: the tables of the file that `believed` is of; `chosen`: values of PARAMETERS, under
    their keys, in place of their defaults. Raises ParameterError, AirframeError.
    """
    given = dict(flat(chosen or {}))
    value = values(PARAMETERS, airframe, given, printed(given, airframe))
    h, (lag,), (response,) = 1.0 / rate_hz, value["rotor_lag_s"], value["rotor_response_s"]
    rotors = believed_rotors(believed, h, lag, f_min=math.nan, kappa=math.nan)  # both below
    law = filled(blank(Params, h=h, g=G, rotors=rotors), PARAMETERS, value)
    law = with_field(law, "rotors.kappa", actuation.kappa(lag, response))
    if not law.achieved:
        law = with_field(law, "initial.J_hat_0", 0.0)  # whatever was chosen
    check(law)
    return law


def pace(law: Params) -> Pace:
    """What modes that lead the vehicle have to know of the law, which estimates its mass itself."""
    return Pace(f_m=law.f_m, yaw_rate_max=law.yaw_rate_max, T_hover=law.initial.m_hat_0 * law.g)


def check(law: Params) -> None:
    """Raise ParameterError for values that the kernels cannot work with."""
    check_rows(law, PARAMETERS)
    b, initial = law.bounds, law.initial
    for name, ok, expected in (
        ("m_hat_0", b.m_min <= initial.m_hat_0 <= b.m_max, f"in [{b.m_min}, {b.m_max}] kg"),
        (
            "J_hat_0",
            not law.achieved or 0.0 < b.J_min <= initial.J_hat_0 <= b.J_max,
            f"in [{b.J_min}, {b.J_max}] kg m^2, bounds.J_min above 0",
        ),
    ):
        if not ok:
            raise ParameterError(f"{name}: expected a value {expected}")
