"""The matrices of the rule on gains are the law and the vehicle, linearised."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import fcu
from fcu.guard.stability import CHANNELS, INERTIA, MASS, OFF, fade, rotor_lag
from fcu.interface.airframe import load as airframe_file
from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import columns, from_buffer, size, to_buffer
from fcu.kernel.rotations import euler, from_euler, matrix
from fcu.laws.mmrac import cascade
from fcu.laws.mmrac.types import LawParams, LawState, Tick
from sitl_plant.physics import tick
from sitl_plant.physics.battery import BatteryState
from sitl_plant.physics.parameters import plant_params, steps_per_tick

OCTO = airframe_file(Path(fcu.__file__).with_name("airframes") / "s1000.toml")
ZERO = Vec3(0.0, 0.0, 0.0)
STATE = columns(Tick).index("state.r_m.x")
COMMAND = columns(Tick).index("command.u.r1")
AT_REST = to_buffer(Setpoint(ZERO, ZERO, ZERO, 0.0, 0.0))


class Vehicle(NamedTuple):
    """Where a tick starts and ends: what is measured and what the law remembers."""

    measured: VehicleState
    law: LawState


def speeds(law: LawParams, thrust: float, torque: float, column: Rotors) -> Rotors:
    """Rotor speeds for a total thrust and a torque about one axis."""
    each = [thrust / 8.0 + torque * b for b in column]
    return Rotors(*[math.sqrt(f / law.c_T) for f in each])


def hover(law: LawParams, off: float) -> LawState:
    """What the law remembers in hover, with m_hat = off m and J_hat = off J.

    The disturbance makes up for the mass: T_0 / m_hat + s_v_hat = g.
    """
    T_0 = MASS * law.g
    Omega = speeds(law, T_0, 0.0, law.B_x)
    at_rest = VehicleState(ZERO, ZERO, from_euler(0.0, 0.0, 0.0), ZERO, Omega)
    return cascade.take_over(law, at_rest)._replace(
        s_v_hat=Vec3(0.0, 0.0, law.g - T_0 / (off * MASS)),
        m_hat=off * MASS,
        J_hat=off * Vec3(*INERTIA),
        T_c_prev=T_0,
    )


def of_height(law: LawParams, off: float, x: list[float]) -> Vehicle:
    z, v, T, T_prev, v_hat, s, trim, T_c_prev = x
    state, T_0 = hover(law, off), MASS * law.g
    measured = VehicleState(
        Vec3(0.0, 0.0, z), Vec3(0.0, 0.0, v), from_euler(0.0, 0.0, 0.0), ZERO,
        speeds(law, T_0 + T, 0.0, law.B_x),
    )  # fmt: skip
    return Vehicle(measured, state._replace(
        Omega_prev=speeds(law, T_0 + T_prev, 0.0, law.B_x),
        v_hat=Vec3(0.0, 0.0, v_hat),
        s_v_hat=state.s_v_hat + Vec3(0.0, 0.0, s),
        T_trim=trim,
        T_c_prev=T_0 + T_c_prev,
    ))  # fmt: skip


def to_height(law: LawParams, off: float, vehicle: Vehicle) -> list[float]:
    m, s = vehicle
    T_0 = MASS * law.g

    def thrust(Omega: Rotors) -> float:
        return law.c_T * sum(o * o for o in Omega) - T_0

    unknown = s.s_v_hat.z + T_0 / s.m_hat - law.g
    return [
        m.r_E.z, m.v_E.z, thrust(m.Omega), thrust(s.Omega_prev), s.v_hat.z, unknown, s.T_trim,
        s.T_c_prev - T_0,
    ]  # fmt: skip


def of_pitch(law: LawParams, off: float, x: list[float]) -> Vehicle:
    way, v, a, q, tau, a_prev, tau_prev, v_hat, s_v, w_hat, s_w, a_filter = x
    state, T_0 = hover(law, off), MASS * law.g
    measured = VehicleState(
        Vec3(way, 0.0, 0.0), Vec3(v, 0.0, 0.0), from_euler(0.0, a, 0.0), Vec3(0.0, q, 0.0),
        speeds(law, T_0, tau, law.B_y),
    )  # fmt: skip
    return Vehicle(measured, state._replace(
        e3_prev=Vec3(math.sin(a_prev), 0.0, math.cos(a_prev)),
        Omega_prev=speeds(law, T_0, tau_prev, law.B_y),
        v_hat=Vec3(v_hat, 0.0, 0.0),
        s_v_hat=state.s_v_hat + Vec3(s_v, 0.0, 0.0),
        w_prev=Vec3(0.0, q, 0.0),
        w_hat=Vec3(0.0, w_hat, 0.0),
        s_w_hat=Vec3(0.0, s_w, 0.0),
        tilt_filter=Vec3(0.0, a_filter, 0.0),
    ))  # fmt: skip


def to_pitch(law: LawParams, off: float, vehicle: Vehicle) -> list[float]:
    m, s = vehicle

    def torque(Omega: Rotors) -> float:
        return -law.c_T * sum(x * o * o for x, o in zip(law.x, Omega, strict=True))

    return [
        m.r_E.x, m.v_E.x, euler(matrix(m.q_EB)).y, m.w_B.y, torque(m.Omega),
        math.asin(s.e3_prev.x), torque(s.Omega_prev), s.v_hat.x, s.s_v_hat.x, s.w_hat.y,
        s.s_w_hat.y, s.tilt_filter.y,
    ]  # fmt: skip


def of_roll(law: LawParams, off: float, x: list[float]) -> Vehicle:
    """A roll to the right leads to the right: the way's signs, y is to the left."""
    way, v, a, q, tau, a_prev, tau_prev, v_hat, s_v, w_hat, s_w, a_filter = x
    state, T_0 = hover(law, off), MASS * law.g
    measured = VehicleState(
        Vec3(0.0, -way, 0.0), Vec3(0.0, -v, 0.0), from_euler(a, 0.0, 0.0), Vec3(q, 0.0, 0.0),
        speeds(law, T_0, tau, law.B_x),
    )  # fmt: skip
    return Vehicle(measured, state._replace(
        e3_prev=Vec3(0.0, -math.sin(a_prev), math.cos(a_prev)),
        Omega_prev=speeds(law, T_0, tau_prev, law.B_x),
        v_hat=Vec3(0.0, -v_hat, 0.0),
        s_v_hat=state.s_v_hat + Vec3(0.0, -s_v, 0.0),
        w_prev=Vec3(q, 0.0, 0.0),
        w_hat=Vec3(w_hat, 0.0, 0.0),
        s_w_hat=Vec3(s_w, 0.0, 0.0),
        tilt_filter=Vec3(a_filter, 0.0, 0.0),
    ))  # fmt: skip


def to_roll(law: LawParams, off: float, vehicle: Vehicle) -> list[float]:
    m, s = vehicle

    def torque(Omega: Rotors) -> float:
        return law.c_T * sum(y * o * o for y, o in zip(law.y, Omega, strict=True))

    return [
        -m.r_E.y, -m.v_E.y, euler(matrix(m.q_EB)).x, m.w_B.x, torque(m.Omega),
        -math.asin(s.e3_prev.y), torque(s.Omega_prev), -s.v_hat.y, -s.s_v_hat.y, s.w_hat.x,
        s.s_w_hat.x, s.tilt_filter.x,
    ]  # fmt: skip


def of_yaw(law: LawParams, off: float, x: list[float]) -> Vehicle:
    psi, r, tau, tau_prev, w_hat, s_w = x
    T_0 = MASS * law.g
    measured = VehicleState(
        ZERO, ZERO, from_euler(0.0, 0.0, psi), Vec3(0.0, 0.0, r), speeds(law, T_0, tau, law.B_z)
    )
    return Vehicle(measured, hover(law, off)._replace(
        Omega_prev=speeds(law, T_0, tau_prev, law.B_z),
        w_prev=Vec3(0.0, 0.0, r),
        w_hat=Vec3(0.0, 0.0, w_hat),
        s_w_hat=Vec3(0.0, 0.0, s_w),
    ))  # fmt: skip


def to_yaw(law: LawParams, off: float, vehicle: Vehicle) -> list[float]:
    m, s = vehicle

    def torque(Omega: Rotors) -> float:
        return -law.k_Q * law.c_T * sum(p * o * o for p, o in zip(law.spin, Omega, strict=True))

    return [
        euler(matrix(m.q_EB)).z, m.w_B.z, torque(m.Omega), torque(s.Omega_prev), s.w_hat.z,
        s.s_w_hat.z,
    ]  # fmt: skip


WAYS = {
    "height": (of_height, to_height),
    "roll": (of_roll, to_roll),
    "pitch": (of_pitch, to_pitch),
    "yaw": (of_yaw, to_yaw),
}
CHOICES = (
    {},
    {"rotor_lag_s": 0.0, "gamma": 2e4},
    {"rotor_response_s": 0.02, "f_m": 2.0, "c_angle": [9.0, 11.0, 7.0], "c_rate": [25.0, 15.0, 30.0]},
)  # fmt: skip


@pytest.mark.parametrize("off", OFF)
@pytest.mark.parametrize("chosen", CHOICES, ids=["default", "no lag", "all different"])
@pytest.mark.parametrize("channel", CHANNELS)
def test_matrices_are_law_and_vehicle_linearised(law, channel, chosen, off):
    params, rate_hz = law(**chosen), 500.0
    plant = to_buffer(plant_params(
        OCTO["rotors"], rate_hz,
        {"rotor_lag_s": rotor_lag(params), "drag": [0.0] * 3, "drag_torque": [0.0] * 3},
        ground_z_m=-1e4,
    ))  # fmt: skip
    law_buffer, row, drawn = to_buffer(params), np.zeros(size(Tick)), np.zeros(size(BatteryState))
    of, to = WAYS[channel]

    def one_tick(x: np.ndarray) -> np.ndarray:
        start = of(params, off, x.tolist())
        body = to_buffer(start.measured)
        cascade.tick(0.0, cascade.FLYING, to_buffer(start.law), law_buffer, AT_REST, 0.0, body, row)
        tick.advance(plant, body, drawn, row[COMMAND : COMMAND + 8], 0.0, steps_per_tick(rate_hz))
        after = from_buffer(LawState, row[STATE : STATE + size(LawState)])
        return np.array(to(params, off, Vehicle(from_buffer(VehicleState, body), after)))

    expected = CHANNELS[channel](params, fade(params), off)
    n, eps = len(expected), 1e-4
    flown = np.column_stack(
        [(one_tick(eps * e) - one_tick(-eps * e)) / (2.0 * eps) for e in np.eye(n)]
    )
    scale = np.maximum(np.abs(expected).max(axis=1, keepdims=True), 1.0)
    np.testing.assert_allclose(flown / scale, expected / scale, atol=2e-5)
