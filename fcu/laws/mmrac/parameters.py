"""From what is believed and chosen (names a person uses) to LawParams (what the kernels use).

Every default of the law stands here once, with its reason.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from fcu.interface.airframe import Airframe
from fcu.kernel.algebra import Rotors, Vec3
from fcu.laws.mmrac.types import Bounds, Guard, LawParams

G = 9.81  # m/s^2


class ParameterError(ValueError):
    """A law parameter that cannot be flown: its name and what was expected."""


DEFAULTS: dict[str, Any] = {
    "prediction": "achieved",  # or "demanded": Section VII to the letter
    # Section VIII of the paper
    "f_m": 1.0,
    "zeta_m": 0.8,
    "gamma": 1000.0,
    "c_angle": 10.0,
    "c_rate": 20.0,
    "m_hat_0": 5.0,
    # Gains of mass and inertia, scaled to the size of their regressors (README.md)
    "gamma_m": 1.0,  # times gamma
    "gamma_Lambda": 5e-4,  # times gamma
    "gamma_J": 1.0,  # times gamma
    "gamma_LambdaJ": 1.0,  # times gamma
    "gamma_c": 1.0,  # times gamma
    "J_hat_0": 0.1,
    "J_implicit": 0.1,
    # Departures
    "T_dz_min": 20.0,
    "trim_rate": 3.0,
    "trim_max": 30.0,
    "tilt_rate_bandwidth": 30.0,
    "tilt_rate_max": 5.0,
    "yaw_rate_max": 1.5,
    "yaw_acceleration": 1.25,  # half of what drag torque gives in hover at 8 kg
    "rotor_response_s": 0.01,  # what the inverted rotor lag is made to look like
    "r_m_offset": [0.0, 0.0, 0.0],
    "v_hat_offset": [0.0, 0.0, 0.0],
    # The guard (README.md, "The condition and the guard")
    "guard": "govern",  # or "warn", "refuse"; as printed there is none, and it is "warn"
    "guard_mass_kg": [7.0, 9.0],  # 8 kg, the paper's, and what a kilogram more or less does
    "guard_drag": 0.15,  # N/(m/s)^2, as s1000.toml believes
    "guard_wind_m_s": 12.0,  # the paper's is up to 11.7
    "guard_wind_rate_m_s2": 20.0,  # the paper's is up to 18.5
    "guard_jerk_m_s3": 25.0,
}

POLICIES = {"warn": 0.0, "govern": 1.0, "refuse": 2.0}
WARN, GOVERN, REFUSE = POLICIES.values()

# Sets that hold every S1000 (6 to 11 kg take-off mass) with room; inertia after `J_hat_0`.
BOUNDS: dict[str, float] = {
    "m_min": 1.0,
    "m_max": 20.0,
    "J_min": 0.02,
    "J_max": 2.0,
    "s_v_max": 30.0,
    "s_w_max": 100.0,
    "c_max": 10.0,
}

# Section VIII gives no bounds; these are the ones with which its figures come out.
PRINTED_BOUNDS: dict[str, float] = {
    "m_min": 0.5,
    "m_max": 12.0,
    "J_min": 0.0,
    "J_max": 2.0,
    "s_v_max": 1000.0,
    "s_w_max": 1000.0,
    "c_max": 1000.0,
}


# What a person may choose, each: the same in missions, over MAVLink and here
RANGES: dict[str, tuple[float, float]] = {
    "f_m": (0.1, 10.0),
    "zeta_m": (0.3, 5.0),
    "gamma": (1.0, 1000000.0),
    "gamma_m": (0.0, 100.0),
    "gamma_Lambda": (0.0, 0.1),
    "gamma_J": (0.0, 100.0),
    "gamma_LambdaJ": (0.0, 100.0),
    "gamma_c": (0.0, 100.0),
    "c_angle": (0.1, 200.0),
    "c_rate": (0.1, 2000.0),
    "tilt_rate_bandwidth": (0.1, 1000.0),
    "tilt_rate_max": (0.01, 100.0),
    "yaw_rate_max": (math.radians(1.0), math.radians(360.0)),
    "yaw_acceleration": (0.01, 100.0),
    "thrust_min_n": (0.0, 100.0),
    "thrust_max_n": (10.0, 1000.0),
    "tilt_max_deg": (1.0, 79.0),
    "T_dz_min": (0.0, 1000.0),
    "trim_rate": (0.0, 20.0),
    "trim_max": (0.0, 100.0),
    "rotor_lag_s": (0.0, 10.0),
    "rotor_response_s": (0.0001, 1.0),
    "bounds.m_min": (0.1, 100.0),
    "bounds.m_max": (0.1, 100.0),
    "bounds.J_min": (0.0, 10.0),
    "bounds.J_max": (0.001, 10.0),
    "bounds.s_v_max": (0.0, 1000.0),
    "bounds.s_w_max": (0.0, 1000.0),
    "bounds.c_max": (0.0, 1000.0),
    "m_hat_0": (0.1, 100.0),
    "J_hat_0": (0.0, 10.0),
    "J_implicit": (1e-06, math.inf),
    "r_m_offset": (-100000.0, 100000.0),
    "v_hat_offset": (-100000.0, 100000.0),
    "guard_mass_kg": (0.1, 100.0),
    "guard_drag": (0.001, 10.0),
    "guard_wind_m_s": (0.0, 100.0),
    "guard_wind_rate_m_s2": (0.0, 1000.0),
    "guard_jerk_m_s3": (5.0, 1000.0),
}


def _three(name: str, value: Any) -> Vec3:
    row = [float(value)] * 3 if isinstance(value, int | float) else [float(v) for v in value]
    if len(row) != 3 or not all(math.isfinite(v) for v in row):
        raise ParameterError(f"{name}: expected a finite number or three, got {value!r}")
    return Vec3(*row)


def _guard(value: Mapping[str, Any]) -> Guard:
    mass = value["guard_mass_kg"]
    if not (isinstance(mass, list | tuple) and len(mass) == 2):
        raise ParameterError(f"guard_mass_kg: expected two numbers, least and most, got {mass!r}")
    return Guard(
        POLICIES[value["guard"]], float(mass[0]), float(mass[1]), float(value["guard_drag"]),
        float(value["guard_wind_m_s"]), float(value["guard_wind_rate_m_s2"]),
        float(value["guard_jerk_m_s3"]),
    )  # fmt: skip


def _columns(believed: Airframe) -> tuple[Rotors, Rotors, Rotors]:
    """Rotor thrusts for one N m about x, y, z with no change of total thrust (pseudo-inverse)."""
    x, y, spin = (np.array(row) for row in (believed.x, believed.y, believed.spin))
    effect = np.stack([np.ones(8), y, -x, -believed.k_Q * spin])
    inverse = np.linalg.pinv(effect)
    return tuple(Rotors(*inverse[:, i].tolist()) for i in (1, 2, 3))  # type: ignore[return-value]


def rotor_mean(h: float, lag: float) -> float:
    """Weight of the earlier of two samples h apart in the mean of a first-order lag between them.

    One half for a slow rotor, nought for one without lag, whose speed is constant in a tick.
    """
    if lag <= 0.0:
        return 0.0
    ratio, decay = h / lag, math.exp(-h / lag)
    return 0.5 if ratio < 1e-4 else 1.0 / ratio - decay / (1.0 - decay)


def law_params(
    believed: Airframe,
    limits: Mapping[str, float],
    rate_hz: float,
    chosen: Mapping[str, Any] | None = None,
) -> LawParams:
    """LawParams for an airframe, its limits and a control rate.

    `limits` is the `[limits]` table of the airframe file; `chosen` overrides DEFAULTS (and,
    under `bounds`, BOUNDS; under `rotor_lag_s`, the believed lag). Raises ParameterError.
    """
    given = dict(chosen or {})
    bounds_given = dict(given.pop("bounds", None) or {})
    lag = float(given.pop("rotor_lag_s", believed.rotor_lag))
    limits = {**limits, **{k: given.pop(k) for k in list(given) if k in limits}}
    for name in given:
        if name not in DEFAULTS:
            raise ParameterError(f"{name}: no such law parameter")
    value = {**DEFAULTS, **given}
    if value["prediction"] not in ("achieved", "demanded"):
        raise ParameterError(
            f"prediction: expected achieved or demanded, got {value['prediction']}"
        )
    achieved = value["prediction"] == "achieved"
    if not achieved and "guard" not in given:
        value["guard"] = "warn"
    if value["guard"] not in POLICIES:
        raise ParameterError(f"guard: expected {', '.join(POLICIES)}, got {value['guard']}")
    bounds = {**(BOUNDS if achieved else PRINTED_BOUNDS), **bounds_given}
    all_of = {
        **limits,
        "rotor_lag_s": lag,
        **value,
        **{f"bounds.{k}": v for k, v in bounds.items()},
    }
    for name, (low, high) in RANGES.items():
        if not np.all((low <= np.asarray(all_of[name])) & (np.asarray(all_of[name]) <= high)):
            raise ParameterError(f"{name}: expected a value from {low:g} to {high:g}")
    gamma = float(value["gamma"])
    h = 1.0 / rate_hz
    B_x, B_y, B_z = _columns(believed)
    params = LawParams(
        h=h,
        achieved=1.0 if achieved else 0.0,
        f_m=float(value["f_m"]),
        zeta_m=float(value["zeta_m"]),
        g=G,
        gamma=gamma,
        gamma_m=gamma * float(value["gamma_m"]),
        gamma_Lambda=gamma * float(value["gamma_Lambda"]),
        gamma_J=gamma * float(value["gamma_J"]),
        gamma_LambdaJ=gamma * float(value["gamma_LambdaJ"]),
        gamma_c=gamma * float(value["gamma_c"]),
        lambda_v=math.sqrt(gamma),  # Section VIII: k = sqrt(gamma)
        lambda_w=math.sqrt(gamma),
        c_angle=_three("c_angle", value["c_angle"]),
        c_rate=_three("c_rate", value["c_rate"]),
        T_min=float(limits["thrust_min_n"]),
        T_max=float(limits["thrust_max_n"]),
        phi_star=math.radians(limits["tilt_max_deg"]),
        T_dz_min=float(value["T_dz_min"]),
        trim_rate=float(value["trim_rate"]),
        trim_max=float(value["trim_max"]),
        tilt_rate_bandwidth=float(value["tilt_rate_bandwidth"]),
        tilt_rate_max=float(value["tilt_rate_max"]),
        yaw_rate_max=float(value["yaw_rate_max"]),
        yaw_acceleration=float(value["yaw_acceleration"]),
        f_min=float(limits["thrust_min_n"]) / 8.0,
        f_max=believed.c_T * believed.Omega_max**2,
        kappa=max(1.0, lag / float(value["rotor_response_s"])),
        rotor_mean=rotor_mean(h, lag),
        bounds=Bounds(**{k: float(v) for k, v in bounds.items()}),
        guard=_guard(value),
        m_hat_0=float(value["m_hat_0"]),
        J_hat_0=float(value["J_hat_0"]) if achieved else 0.0,
        J_implicit=float(value["J_implicit"]),
        r_m_offset=_three("r_m_offset", value["r_m_offset"]),
        v_hat_offset=_three("v_hat_offset", value["v_hat_offset"]),
        x=believed.x,
        y=believed.y,
        spin=believed.spin,
        c_T=believed.c_T,
        k_Q=believed.k_Q,
        Omega_max=believed.Omega_max,
        B_x=B_x,
        B_y=B_y,
        B_z=B_z,
    )
    check(params)
    return params


def check(params: LawParams) -> None:
    """Raise ParameterError for values that the kernels cannot work with."""
    b, guard = params.bounds, params.guard
    for name, ok, expected in (
        ("f_m", 0.1 <= params.f_m <= 10.0, "between 0.1 and 10 rad/s"),
        ("zeta_m", 0.3 <= params.zeta_m <= 5.0, "between 0.3 and 5"),
        ("gamma", 1.0 <= params.gamma <= 1e6, "between 1 and 1e6"),
        ("yaw_rate_max", params.yaw_rate_max > 0.0, "above 0 rad/s"),
        ("yaw_acceleration", params.yaw_acceleration > 0.0, "above 0 rad/s^2"),
        ("m_hat_0", b.m_min <= params.m_hat_0 <= b.m_max, f"in [{b.m_min}, {b.m_max}] kg"),
        (
            "J_hat_0",
            not params.achieved or 0.0 < b.J_min <= params.J_hat_0 <= b.J_max,
            f"in [{b.J_min}, {b.J_max}] kg m^2, bounds.J_min above 0",
        ),
        ("bounds.m_min", 0.0 < b.m_min < b.m_max, "above 0 and below bounds.m_max"),
        ("tilt_max_deg", 0.0 < params.phi_star < math.radians(80.0), "between 0 and 80 degrees"),
        ("thrust_min_n", 0.0 <= params.T_min < params.T_max, "from 0 to below thrust_max_n"),
        (
            "guard",
            params.achieved or guard.policy == WARN,
            'of "warn" with prediction = "demanded": the condition is for what was achieved',
        ),
        (
            "guard_mass_kg",
            0.1 <= guard.m_min <= guard.m_max <= 100.0,
            "[least, most], from 0.1 to 100 kg",
        ),
        ("guard_drag", 1e-3 <= guard.c_D <= 10.0, "from 0.001 to 10 N/(m/s)^2"),
        ("guard_wind_m_s", 0.0 <= guard.w_max <= 100.0, "from 0 to 100 m/s"),
        ("guard_wind_rate_m_s2", 0.0 <= guard.w_dot_max <= 1000.0, "from 0 to 1000 m/s^2"),
        ("guard_jerk_m_s3", 5.0 <= guard.jerk <= 1000.0, "from 5 to 1000 m/s^3"),
    ):
        if not ok:
            raise ParameterError(f"{name}: expected a value {expected}")
