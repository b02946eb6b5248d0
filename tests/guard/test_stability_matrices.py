"""The matrices of the rule on gains are the law and the vehicle, linearised."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import fcu
from fcu.guard import guard
from fcu.guard.stability import CHANNELS, INPUTS, OFF, Hover, fade, rotor_lag
from fcu.interface.airframe import load as airframe_file
from fcu.interface.airframe import read
from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import from_buffer, size, to_buffer
from fcu.kernel.rotations import euler, from_euler, matrix
from fcu.kernel.rows import column
from fcu.laws.mmrac import law as mmrac
from fcu.laws.mmrac.types import Params, State
from fcu.process.tick import FLYING, Remembered, Tick
from fcu.process.tick import tick as law_tick
from sitl_plant.physics import tick
from sitl_plant.physics.battery import BatteryState
from sitl_plant.physics.parameters import plant_params, steps_per_tick
from sitl_plant.physics.truth import truth
from tests.laws.values import with_fields

OCTO = airframe_file(Path(fcu.__file__).with_name("airframes") / "s1000.toml")
ZERO = Vec3(0.0, 0.0, 0.0)
MASS, INERTIA = 8.0, (0.3245, 0.3245, 0.4616)
HERE = Hover(m=MASS, J=INERTIA)


class Vehicle(NamedTuple):
    """Where a tick starts and ends: what is measured and what the law remembers."""

    measured: VehicleState
    law: State


def speeds(law: Params, thrust: float, torque: float, column: Rotors) -> Rotors:
    """Rotor speeds for a total thrust and a torque about one axis."""
    each = [thrust / 8.0 + torque * b for b in column]
    return Rotors(*[math.sqrt(f / law.rotors.c_T.r1) for f in each])


def hover(law: Params, off: float) -> State:
    """What the law remembers in hover, with m_hat = off m and J_hat = off J.

    The disturbance makes up for the mass: T_0 / m_hat + s_v_hat = g.
    """
    T_0 = MASS * law.g
    Omega = speeds(law, T_0, 0.0, law.rotors.B_x)
    at_rest = VehicleState(ZERO, ZERO, from_euler(0.0, 0.0, 0.0), ZERO, Omega)
    return with_fields(
        mmrac.beginning(law, at_rest),
        s_v_hat=Vec3(0.0, 0.0, law.g - T_0 / (off * MASS)),
        m_hat=off * MASS,
        J_hat=off * Vec3(*INERTIA),
        T_c=T_0,
    )


def of_height(law: Params, off: float, x: list[float]) -> Vehicle:
    z, v, T, T_prev, v_hat, s, trim, T_c_prev = x
    state, T_0 = hover(law, off), MASS * law.g
    measured = VehicleState(
        Vec3(0.0, 0.0, z), Vec3(0.0, 0.0, v), from_euler(0.0, 0.0, 0.0), ZERO,
        speeds(law, T_0 + T, 0.0, law.rotors.B_x),
    )  # fmt: skip
    return Vehicle(measured, with_fields(
        state,
        Omega=speeds(law, T_0 + T_prev, 0.0, law.rotors.B_x),
        v_hat=Vec3(0.0, 0.0, v_hat),
        s_v_hat=state.estimates.s_v_hat + Vec3(0.0, 0.0, s),
        T_trim=trim,
        T_c=T_0 + T_c_prev,
    ))  # fmt: skip


def to_height(law: Params, off: float, vehicle: Vehicle) -> list[float]:
    m, (_, predicted, found, s) = vehicle
    T_0 = MASS * law.g

    def thrust(Omega: Rotors) -> float:
        return law.rotors.c_T.r1 * sum(o * o for o in Omega) - T_0

    unknown = found.s_v_hat.z + T_0 / found.m_hat - law.g
    return [
        m.r_E.z, m.v_E.z, thrust(m.Omega), thrust(s.Omega), predicted.v_hat.z, unknown, s.T_trim,
        s.T_c - T_0,
    ]  # fmt: skip


def of_pitch(law: Params, off: float, x: list[float]) -> Vehicle:
    way, v, a, q, tau, a_prev, tau_prev, v_hat, s_v, w_hat, s_w, a_filter = x
    state, T_0 = hover(law, off), MASS * law.g
    measured = VehicleState(
        Vec3(way, 0.0, 0.0), Vec3(v, 0.0, 0.0), from_euler(0.0, a, 0.0), Vec3(0.0, q, 0.0),
        speeds(law, T_0, tau, law.rotors.B_y),
    )  # fmt: skip
    return Vehicle(measured, with_fields(
        state,
        e3=Vec3(math.sin(a_prev), 0.0, math.cos(a_prev)),
        Omega=speeds(law, T_0, tau_prev, law.rotors.B_y),
        v_hat=Vec3(v_hat, 0.0, 0.0),
        s_v_hat=state.estimates.s_v_hat + Vec3(s_v, 0.0, 0.0),
        w=Vec3(0.0, q, 0.0),
        w_hat=Vec3(0.0, w_hat, 0.0),
        s_w_hat=Vec3(0.0, s_w, 0.0),
        tilt_filter=Vec3(0.0, a_filter, 0.0),
    ))  # fmt: skip


def to_pitch(law: Params, off: float, vehicle: Vehicle) -> list[float]:
    m, (reference, predicted, found, s) = vehicle
    r, v, v_hat = m.r_E - reference.r_m, m.v_E - reference.v_m, predicted.v_hat - reference.v_m

    def torque(Omega: Rotors) -> float:
        return -law.rotors.c_T.r1 * sum(x * o * o for x, o in zip(law.rotors.x, Omega, strict=True))

    return [
        r.x, v.x, euler(matrix(m.q_EB)).y, m.w_B.y, torque(m.Omega),
        math.asin(s.e3.x), torque(s.Omega), v_hat.x, found.s_v_hat.x, predicted.w_hat.y,
        found.s_w_hat.y, s.tilt_filter.y,
    ]  # fmt: skip


def of_roll(law: Params, off: float, x: list[float]) -> Vehicle:
    """A roll to the right leads to the right: the way's signs, y is to the left."""
    way, v, a, q, tau, a_prev, tau_prev, v_hat, s_v, w_hat, s_w, a_filter = x
    state, T_0 = hover(law, off), MASS * law.g
    measured = VehicleState(
        Vec3(0.0, -way, 0.0), Vec3(0.0, -v, 0.0), from_euler(a, 0.0, 0.0), Vec3(q, 0.0, 0.0),
        speeds(law, T_0, tau, law.rotors.B_x),
    )  # fmt: skip
    return Vehicle(measured, with_fields(
        state,
        e3=Vec3(0.0, -math.sin(a_prev), math.cos(a_prev)),
        Omega=speeds(law, T_0, tau_prev, law.rotors.B_x),
        v_hat=Vec3(0.0, -v_hat, 0.0),
        s_v_hat=state.estimates.s_v_hat + Vec3(0.0, -s_v, 0.0),
        w=Vec3(q, 0.0, 0.0),
        w_hat=Vec3(w_hat, 0.0, 0.0),
        s_w_hat=Vec3(s_w, 0.0, 0.0),
        tilt_filter=Vec3(a_filter, 0.0, 0.0),
    ))  # fmt: skip


def to_roll(law: Params, off: float, vehicle: Vehicle) -> list[float]:
    m, (reference, predicted, found, s) = vehicle
    r, v, v_hat = m.r_E - reference.r_m, m.v_E - reference.v_m, predicted.v_hat - reference.v_m

    def torque(Omega: Rotors) -> float:
        return law.rotors.c_T.r1 * sum(y * o * o for y, o in zip(law.rotors.y, Omega, strict=True))

    return [
        -r.y, -v.y, euler(matrix(m.q_EB)).x, m.w_B.x, torque(m.Omega),
        -math.asin(s.e3.y), torque(s.Omega), -v_hat.y, -found.s_v_hat.y, predicted.w_hat.x,
        found.s_w_hat.x, s.tilt_filter.x,
    ]  # fmt: skip


def of_yaw(law: Params, off: float, x: list[float]) -> Vehicle:
    psi, r, tau, tau_prev, w_hat, s_w = x
    T_0 = MASS * law.g
    measured = VehicleState(
        ZERO,
        ZERO,
        from_euler(0.0, 0.0, psi),
        Vec3(0.0, 0.0, r),
        speeds(law, T_0, tau, law.rotors.B_z),
    )
    return Vehicle(measured, with_fields(
        hover(law, off),
        Omega=speeds(law, T_0, tau_prev, law.rotors.B_z),
        w=Vec3(0.0, 0.0, r),
        w_hat=Vec3(0.0, 0.0, w_hat),
        s_w_hat=Vec3(0.0, 0.0, s_w),
    ))  # fmt: skip


def to_yaw(law: Params, off: float, vehicle: Vehicle) -> list[float]:
    m, (_, predicted, found, s) = vehicle

    def torque(Omega: Rotors) -> float:
        rotors = law.rotors
        turning = sum(p * o * o for p, o in zip(rotors.spin, Omega, strict=True))
        return -rotors.k_Q * rotors.c_T.r1 * turning

    return [
        euler(matrix(m.q_EB)).z, m.w_B.z, torque(m.Omega), torque(s.Omega), predicted.w_hat.z,
        found.s_w_hat.z,
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
@pytest.mark.computes
def test_matrices_are_law_and_vehicle_linearised(settings_of, channel, chosen, off):
    is_linearised(settings_of, channel, chosen, off)


@pytest.mark.parametrize("channel", CHANNELS)
def test_leakage_shows_in_none_of_them(settings_of, channel):
    """Drag that goes over into the mass leaves the sum that is seen."""
    is_linearised(settings_of, channel, {"sigma_v": 10.0}, 1.0)


@pytest.mark.parametrize("ticks", [1, 3])
@pytest.mark.parametrize("channel", CHANNELS)
def test_matrices_are_law_and_vehicle_linearised_with_delay_too(settings_of, channel, ticks):
    is_linearised(settings_of, channel, CHOICES[2], OFF[1], ticks)


# of the report's noise float64[12]: what stands for a channel's position, velocity, attitude, rate
NOISY = {
    "height": ((2, 1.0), (5, 1.0), None, None),
    "roll": ((1, -1.0), (4, -1.0), (6, 1.0), (9, 1.0)),
    "pitch": ((0, 1.0), (3, 1.0), (7, 1.0), (10, 1.0)),
    "yaw": (None, None, (8, 1.0), (11, 1.0)),
}


# where the reference model accelerates, of the channels that look at it
ALONG = {"height": ZERO, "roll": Vec3(0.0, -1.0, 0.0), "pitch": Vec3(1.0, 0.0, 0.0), "yaw": ZERO}


def demanded(channel: str, row: np.ndarray) -> list[float]:
    """The two numbers that a channel demands, of a row of Tick."""
    force, torque = (
        column(Tick, row, "internals.demand.T_0"),
        column(Tick, row, "internals.demand.tau_d"),
    )
    T_c, trim = column(Tick, row, "outputs.T_c"), column(Tick, row, "state.memory.T_trim")
    r_c = column(Tick, row, "outputs.w_c")[2]
    return {
        "height": [float(T_c), float(T_c + trim)],
        "roll": [-force[1], torque[0]],
        "pitch": [force[0], torque[1]],
        "yaw": [r_c, torque[2]],
    }[channel]


def is_linearised(settings_of, channel, chosen, off, ticks=0):
    settings, rate_hz = settings_of(guard="warn", **chosen), 500.0
    params, of, to = settings.law, *WAYS[channel]
    plant = to_buffer(plant_params(
        truth(read()), rate_hz,
        {"rotor_lag_s": rotor_lag(params), "drag": [0.0] * 3, "drag_torque": [0.0] * 3},
        ground_z_m=-1e4,
    ))  # fmt: skip
    told, row, drawn = to_buffer(settings), np.zeros(size(Tick)), np.zeros(size(BatteryState))
    expected = CHANNELS[channel](params, fade(params), off, HERE, ticks)
    n = len(expected.A)
    own = len(CHANNELS[channel](params, fade(params), off, HERE).A)
    seen = (n - own) // ticks if ticks else 0

    def one_tick(x: np.ndarray) -> np.ndarray:
        """State, INPUTS -> state a tick later, 2 of the demand."""
        start, late = of(params, off, x[:own].tolist()), x[own:n]
        body = to_buffer(start.measured)
        shown = body
        if ticks:
            shown = to_buffer(of(params, off, [*late[-seen:], *[0.0] * (own - seen)]).measured)
        noise, reported = np.zeros(12), np.zeros_like(body)
        *noises, a_m = x[n:]
        for amount, at in zip(noises, NOISY[channel], strict=True):
            if at is not None:
                noise[at[0]] = at[1] * amount
        setpoint = to_buffer(Setpoint(ZERO, ZERO, float(a_m) * ALONG[channel], 0.0, 0.0))
        tick.sense(shown, noise, reported)
        at_rest, _ = guard.idle(start.measured)
        remembered = to_buffer(Remembered(start.law, at_rest))
        law_tick(0.0, FLYING, remembered, told, setpoint, 0.0, reported, row)
        command = column(Tick, row, "command")
        tick.advance(plant, body, drawn, command, 0.0, steps_per_tick(rate_hz))
        after = from_buffer(State, column(Tick, row, "state"))
        own_after = to(params, off, Vehicle(from_buffer(VehicleState, body), after))
        shifted = [*x[:seen], *late[:-seen]] if ticks else []
        return np.array([*own_after, *shifted, *demanded(channel, row)])

    eps, inputs = 1e-4, n + len(INPUTS)
    flown = np.column_stack(
        [(one_tick(eps * e) - one_tick(-eps * e)) / (2.0 * eps) for e in np.eye(inputs)]
    )
    whole = np.block([[expected.A, expected.B], [expected.C, expected.D]])
    scale = np.maximum(np.abs(whole).max(axis=1, keepdims=True), 1.0)
    np.testing.assert_allclose(flown / scale, whole / scale, atol=2e-5)
