"""Equations of motion and integration: rigid body, rotors, air and ground. Paper (32), (33).

Classical Runge-Kutta integrates position, velocity, attitude and body rate. The first-order lag
of the rotors is solved exactly. `integrate` is pure: (state, command, time) -> state.
"""

from __future__ import annotations

from typing import NamedTuple

from fcu.interface.messages import VehicleState
from fcu.kernel.algebra import Quat, Vec3, cross, norm, select
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import matrix, normalised, quaternion_rate, rotate, rotate_back
from sitl_plant.physics import battery, drag, ground, rotors
from sitl_plant.physics.types import PlantRecord
from sitl_plant.physics.wind import sines

FLYING, DIVERGED, CRASHED, HIT_BUILDING, LEFT_FIELD = 0.0, 1.0, 2.0, 3.0, 4.0
ENDED = {DIVERGED: "diverged", CRASHED: "crashed", HIT_BUILDING: "crashed", LEFT_FIELD: "diverged"}
TIPPED = 0.5  # body z along Earth z; a vehicle on the ground below this value lies on its side


class Body(NamedTuple):
    """The part of the state that Runge-Kutta integrates; also its derivative."""

    r_E: Vec3
    v_E: Vec3
    q_EB: Quat
    w_B: Vec3


class Push(NamedTuple):
    """Inputs of one Runge-Kutta stage that do not depend on the motion of the body."""

    m: float
    T: float  # N
    tau_B: Vec3  # N m
    Omega_m: float  # rad/s
    v_air_E: Vec3  # m/s
    w_air_B: Vec3  # rad/s


@kernel
def moved(body, rate, h):
    """body + h rate."""
    return Body(
        body.r_E + h * rate.r_E,
        body.v_E + h * rate.v_E,
        body.q_EB + h * rate.q_EB,
        body.w_B + h * rate.w_B,
    )


@kernel
def derivative(params, body, push):
    """Time derivative of the body state, as a Body. Paper (32), (33)."""
    R_EB = matrix(body.q_EB)
    w_B, J = body.w_B, params.J

    # force on the body, Earth axes
    f_T_E = push.T * R_EB.e3
    v_a_B = rotate_back(R_EB, body.v_E - push.v_air_E)
    f_D_E = rotate(R_EB, drag.against(params.c_D, v_a_B))
    f_E = f_T_E + f_D_E
    f_G_E, tau_G_B = ground.contact(params.ground, body.r_E, body.v_E, R_EB, w_B, f_E)
    g_E = Vec3(0.0, 0.0, -params.g)
    v_dot_E = (f_E + f_G_E) / push.m + g_E  # (32)

    # torque on the body, body axes
    J_m = params.airframe.J_m
    tau_gyro_B = (J_m * push.Omega_m) * Vec3(-w_B.y, w_B.x, 0.0)
    tau_D_B = drag.against(params.c_tau, w_B - push.w_air_B)
    tau_B = push.tau_B + tau_gyro_B + tau_D_B + tau_G_B
    w_dot_B = (tau_B - cross(w_B, J * w_B)) / J  # (33)

    return Body(body.v_E, v_dot_E, quaternion_rate(body.q_EB, w_B), w_dot_B)


@kernel
def mass(params, t):
    """Mass (kg) at time t (s)."""
    return select(t >= params.m_time, params.m_after, params.m)


@kernel
def push_at(params, Omega, left, m, at, t):
    """The Push at time t (s), with wind phases `at` and rotor speeds Omega (rad/s)."""
    T, tau_B = rotors.thrust_and_torque(params, Omega, left)
    wind = params.wind
    return Push(
        m, T, tau_B, rotors.omega_m(params, Omega),
        sines.v_air_E(wind, at, t), sines.w_air_B(wind, at),
    )  # fmt: skip


@kernel
def integrate(params, state, command, t):
    """The state one step h after time t (s); the command is rotor speeds relative to full speed."""
    h = params.h
    Omega_c = params.airframe.Omega_max * command.u
    Omega_0 = select_lagless(params, state.Omega, Omega_c)
    Omega_half = rotors.lagged(state.Omega, Omega_c, params.decay_half)
    Omega_1 = rotors.lagged(state.Omega, Omega_c, params.decay)

    # mass and effectiveness change between steps, not within a step
    m, left = mass(params, t), rotors.effectiveness(params, t)
    at_0 = sines.phases(params.wind, t)
    at_half = sines.half_step_later(params.wind, at_0)
    at_1 = sines.half_step_later(params.wind, at_half)
    push_0 = push_at(params, Omega_0, left, m, at_0, t)
    push_half = push_at(params, Omega_half, left, m, at_half, t + 0.5 * h)
    push_1 = push_at(params, Omega_1, left, m, at_1, t + h)

    body = Body(state.r_E, state.v_E, state.q_EB, state.w_B)
    k1 = derivative(params, body, push_0)
    k2 = derivative(params, moved(body, k1, 0.5 * h), push_half)
    k3 = derivative(params, moved(body, k2, 0.5 * h), push_half)
    k4 = derivative(params, moved(body, k3, h), push_1)
    sixth, third = h / 6.0, h / 3.0
    end = moved(moved(moved(moved(body, k1, sixth), k2, third), k3, third), k4, sixth)
    return VehicleState(
        r_E=end.r_E, v_E=end.v_E, q_EB=normalised(end.q_EB), w_B=end.w_B, Omega=Omega_1
    )


@kernel
def select_lagless(params, Omega, Omega_c):
    """Rotor speeds at the start of a step: the state, or the command if there is no lag."""
    lagged = select(params.decay_half > 0.0, 1.0, 0.0)
    return Omega_c + lagged * (Omega - Omega_c)


@kernel
def ended(params, state, r_start):
    """FLYING, DIVERGED (outside the arena, or not a number), CRASHED, HIT_BUILDING or LEFT_FIELD.

    A vehicle has crashed if it hits the ground too fast, is below the ground, or lies on its side
    or back.
    """
    away = norm(state.r_E - r_start)
    inside = (away <= params.arena) & (norm(state.w_B) < 1e6) & (norm(state.v_E) < 1e6)
    low = ground.depth(params.ground, state.r_E) > 0.0
    hit = low & (state.v_E.z < -params.ground.impact_max)
    tipped = low & (matrix(state.q_EB).e3.z < TIPPED)
    buried = state.r_E.z < params.ground.z - params.ground.gear
    down = select(hit | tipped | buried, CRASHED, FLYING)
    wall = params.ground.wall
    down = select(wall == 1.0, HIT_BUILDING, select(wall == 2.0, LEFT_FIELD, down))
    return select(inside, down, DIVERGED)


@kernel
def record(params, state, drawn, t, r_start):
    """The true state at time t (s), as a PlantRecord. `drawn`: BatteryState."""
    R_EB = matrix(state.q_EB)
    m, left = mass(params, t), rotors.effectiveness(params, t)
    push = push_at(params, state.Omega, left, m, sines.phases(params.wind, t), t)
    v_a_B = rotate_back(R_EB, state.v_E - push.v_air_E)
    return PlantRecord(
        t,
        state,
        push.v_air_E,
        push.w_air_B,
        rotate(R_EB, drag.against(params.c_D, v_a_B)),
        push.T,
        push.tau_B,
        m,
        params.J,
        select(ground.depth(params.ground, state.r_E) > 0.0, 1.0, 0.0),
        battery.report(params.battery, params.airframe, state.Omega, left, drawn),
        ended(params, state, r_start),
    )
