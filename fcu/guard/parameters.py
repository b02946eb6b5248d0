"""The parameters of the guard: the one table of them, GuardParams from it, and what must hold."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fcu.guard import noise, stability, torque
from fcu.guard.types import GuardParams
from fcu.interface.parameter import (
    Parameter,
    ParameterError,
    Part,
    Value,
    blank,
    filled,
    group,
    values,
)
from fcu.interface.parameter import check as check_rows
from fcu.laws import scales
from fcu.laws.mmrac.parameters import DEMANDED, NAME
from fcu.laws.mmrac.types import Params

POLICIES = {"warn": 0.0, "govern": 1.0, "refuse": 2.0}
WARN, GOVERN, REFUSE = POLICIES.values()
NOISES = {"bounded": 0.0, "gaussian": 1.0}

PRINTED: dict[str, Value] = {"guard": "warn"}  # with prediction = "demanded" there is none

P = Parameter

# README.md
ROWS: tuple[Parameter, ...] = (
    *group(
        "The guard",
        P(
            "guard", "MR_GUARD", "govern", 0.0, 2.0, "", "when the actuators do not suffice",
            "policy", words=POLICIES,
        ),
        P(
            "guard_mass_kg",
            (
                Part("MR_GRD_M_MIN", ("m_min",), "least mass that the guard believes in"),
                Part("MR_GRD_M_MAX", ("m_max",), "greatest mass that it believes in"),
            ),
            None, 0.01, 1e4, "kg", "least and greatest mass that the guard believes in", ("m_min", "m_max"), airframe="vehicle.mass_kg",
        ),
        P("guard_drag", "MR_GRD_DRAG", None, 1e-5, 100.0, "N/(m/s)^2", "greatest drag coefficient that it believes in", "c_D", airframe="air.drag"),
        # the paper's wind is up to 11.7 m/s, and changes by up to 18.5 m/s^2
        P("guard_wind_m_s", "MR_GRD_WIND", None, 0.0, 100.0, "m/s", "greatest wind that it believes in", "w_max", rule=scales.wind),
        P("guard_wind_rate_m_s2", "MR_GRD_WRATE", None, 0.0, 1000.0, "m/s^2", "greatest rate of that wind", "w_dot_max", rule=lambda tables: scales.GUSTS * scales.wind(tables)),
        # the acceleration of a tilt of 52 degrees, within 1/f_m
        P("guard_jerk_m_s3", "MR_GRD_JERK", None, 5.0, 1000.0, "m/s^3", "fastest change of the acceleration of what is governed", "jerk", rule=lambda tables: 12.5 * scales.position_bandwidth(tables)),
        P("guard_noise", "MR_GRD_NOISE", "bounded", 0.0, 1.0, "", "what the noise that it believes in is", "gaussian", words=NOISES),
        P("guard_noise_position_m", "MR_GRD_N_POS", 0.0, 0.0, 10.0, "m", "noise of the measured position that it believes in", "noise_r"),
        P("guard_noise_velocity_m_s", "MR_GRD_N_VEL", 0.0, 0.0, 10.0, "m/s", "noise of the velocity that it believes in", "noise_v"),
        P("guard_noise_attitude_rad", "MR_GRD_N_ATT", 0.0, 0.0, 0.5, "rad", "noise of the attitude that it believes in", "noise_q"),
        P("guard_noise_rate_rad_s", "MR_GRD_N_RATE", 0.0, 0.0, 10.0, "rad/s", "noise of the body rates that it believes in", "noise_w"),
        P("guard_delay_s", "MR_GRD_DELAY", 0.0, 0.0, 0.05, "s", "delay from measurement to rotor that it believes in", "delay_s"),
    ),
)  # fmt: skip
PARAMETERS = tuple(row._replace(law=NAME) for row in ROWS)


def printed(chosen: Mapping[str, Any]) -> Mapping[str, Value]:
    """The defaults that are others with what was chosen of the law: those of the printed one."""
    return PRINTED if chosen.get("prediction") == DEMANDED else {}


def guard_params(
    airframe: Mapping[str, Any], law: Params, chosen: Mapping[str, Any] | None = None
) -> GuardParams:
    """GuardParams around a law.

    `airframe`: the tables of an airframe file; `chosen`: values of PARAMETERS, under their keys, in
    place of their defaults. Raises ParameterError, AirframeError.
    """
    given = values(PARAMETERS, airframe, chosen or {}, {} if law.achieved else PRINTED)
    J = [greatest for _, greatest in airframe["vehicle"]["inertia_kg_m2"]]
    least, most = airframe["vehicle"]["mass_kg"]
    middle = scales.inertia(airframe)
    empty = blank(
        GuardParams, J_tilt=float(max(J[:2])), J_yaw=float(J[2]), m=scales.mass(airframe),
        J_x=middle.x, J_y=middle.y, J_z=middle.z, heavier=float(most) / float(least), lift=0.0,
        **noise.NOT_YET, **torque.NOT_YET,
    )  # fmt: skip
    params = filled(empty, PARAMETERS, given)
    check(params, law)
    return derived(params, law)


def derived(params: GuardParams, law: Params) -> GuardParams:
    """GuardParams with what is worked out from the others and from the law, once they are chosen."""
    params = params._replace(lift=stability.lift(law, params))
    return torque.derived(noise.derived(params, law), law)


def followed(params: GuardParams, before: Params, law: Params) -> GuardParams:
    """GuardParams around a law that was another: with its defaults for what stands at the other's."""
    if law.achieved == before.achieved:
        return params
    for row in PARAMETERS:
        if row.key in PRINTED and row.default is not None:
            old, new = row.default, PRINTED[row.key]
            old, new = (old, new) if before.achieved else (new, old)
            if row.get(params) == row.numbers(old):
                params = row.put(params, row.numbers(new))
    return params


def check(params: GuardParams, law: Params) -> None:
    """Raise ParameterError for values that the kernels cannot work with."""
    check_rows(params, PARAMETERS)
    if not law.achieved and params.policy != WARN:
        expected = 'of "warn" with prediction = "demanded": the condition is for what was achieved'
        raise ParameterError(f"guard: expected a value {expected}")
