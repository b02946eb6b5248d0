"""Geometric tracking control on SE(3) of Lee, Leok and McClamroch, with integral terms.

`step` is one tick from top to bottom. Equations and departures: README.md. E is Earth
East-North-Up, B is body Forward-Left-Up, SI units throughout; the paper's z axes point down.
"""

from __future__ import annotations

import math
from math import cos, sin, sqrt
from typing import NamedTuple

from fcu.interface.messages import RotorCommand
from fcu.interface.parameter import Parameter, group
from fcu.kernel.algebra import (
    Vec3,
    clip3,
    cross,
    dot,
    maximum,
    minimum,
    norm,
    select,
    select3,
)
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import Matrix, euler, from_euler, matrix, rotate, rotate_back
from fcu.laws import scales
from fcu.laws.allocation import RotorParams, allocate, speed_command
from fcu.laws.demand import G, asked_tilt, within_thrust, within_tilt
from fcu.laws.face import Limits, Pace
from fcu.laws.outputs import without_reference

NEAR = 0.2  # rad, error of attitude below which it is integrated


class Params(NamedTuple):
    """What the law is told. Gains of force are over mass, gains of torque over inertia."""

    h: float  # control period, s
    limits: Limits
    rotors: RotorParams
    m: float  # believed mass, kg
    J: Vec3  # believed inertia, kg m^2, B
    k_x: float  # acceleration over error of position, 1/s^2
    k_v: float  # over error of velocity, 1/s
    k_i: float  # over the integral of both, 1/s^2
    c_1: float  # weight of position in that integral, 1/s
    sigma: float  # limit of that integral, m
    v_max: float  # greatest speed towards a position, m/s
    a_max: float  # what that speed is slowed down with, m/s^2
    A_z_min: float  # floor of the vertical demand, over g
    k_R_tilt: float  # angular acceleration over error of roll and pitch, 1/s^2
    k_R_yaw: float  # of yaw, 1/s^2
    k_W_tilt: float  # over error of the rates of roll and pitch, 1/s
    k_W_yaw: float  # of yaw, 1/s
    k_I_tilt: float  # over the integral of both, 1/s^2
    k_I_yaw: float  # of yaw, 1/s^2
    c_2: float  # weight of attitude in that integral, 1/s
    sigma_I: float  # limit of that integral, rad


class State(NamedTuple):
    """What the law remembers from tick to tick."""

    e_i: Vec3  # integral of e_v + c_1 e_x, m, E
    e_I: Vec3  # integral of c_2 e_R, rad, B


class Command(NamedTuple):
    """An attitude to be followed, with its body rate and its angular acceleration."""

    R: Matrix  # target to Earth
    W: Vec3  # rad/s, in the axes of the target
    W_dot: Vec3  # rad/s^2, likewise


class Internals(NamedTuple):
    """What a tick computes on the way."""

    A: Vec3  # demanded specific force, m/s^2, E
    e_R: Vec3  # error of attitude, B
    e_W: Vec3  # error of body rate, rad/s, B
    Psi: float  # error function of attitude, 0 to 2
    W_c: Vec3  # body rate of the commanded attitude, rad/s, in its axes
    W_dot_c: Vec3  # its angular acceleration, rad/s^2, likewise
    tau_c: Vec3  # commanded torque, N m, B


# --- parameters


# Of the paper's Section VI, over its mass and its inertia about roll
K_X, K_V, K_R, K_W = 16.0, 5.6, 8.81 / 0.0820, 2.54 / 0.0820


def _speed(tables):
    """How fast the airframe is beside the paper's: 1, or less if torque is scarce or the rotors slow.

    The paper's k_R is let ask for all torque about roll or pitch at an error of 0.7, and k_Omega over
    inertia be 0.4 of what is left of the rotors' lag once it is inverted.
    """
    alpha = scales.authority(tables)
    torque = math.sqrt(min(alpha.x, alpha.y) / 0.7 / K_R)
    rotors = 0.4 / scales.rotor_response(tables) / K_W
    return min(1.0, torque, rotors)


def _yaw(tables):
    """k_R about yaw: the paper's, or less, so that a quarter of a radian asks for all torque there is."""
    return min(8.81 / 0.1377, 4.0 * scales.authority(tables).z)


P = Parameter

PARAMETERS = (
    P("m", "SE_MASS", None, 0.05, 100.0, "kg", "believed mass", rule=scales.mass),
    P("J", "", None, 1e-5, 100.0, "kg m^2", "believed inertia", axes=True, rule=scales.inertia),
    *group(
        "Position",
        P("k_x", "SE_K_X", None, 0.5, 100.0, "1/s^2", "gain of position, over mass", rule=lambda t: K_X * _speed(t) ** 2, gain=True),
        P("k_v", "SE_K_V", None, 0.5, 50.0, "1/s", "gain of velocity, over mass", rule=lambda t: K_V * _speed(t), gain=True),
        P("k_i", "SE_K_I", None, 0.0, 20.0, "1/s^2", "gain of the integral, over mass; 0: none", rule=lambda t: 1.7 * _speed(t) ** 2, gain=True),
        P("c_1", "SE_C_1", None, 0.1, 20.0, "1/s", "weight of position in the integral", rule=lambda t: 3.6 * _speed(t), gain=True),
        P("sigma", "SE_SIGMA", 2.0, 0.0, 100.0, "m", "limit of the integral"),
        P("v_max", "SE_V_MAX", 12.0, 0.5, 50.0, "m/s", "greatest speed towards a position"),
        P("a_max", "SE_A_MAX", 4.0, 0.2, 50.0, "m/s^2", "what that speed is slowed down with"),
        P("A_z_min", "SE_A_Z_MIN", 0.25, 0.0, 1.0, "", "floor of the vertical demand, over g"),
    ),
    *group(
        "Attitude",
        P("k_R_tilt", "SE_K_R_TILT", None, 5.0, 1000.0, "1/s^2", "gain of roll and pitch, over inertia", rule=lambda t: K_R * _speed(t) ** 2, gain=True),
        P("k_R_yaw", "SE_K_R_YAW", None, 0.1, 500.0, "1/s^2", "gain of yaw, over inertia", rule=_yaw, gain=True),
        P("k_W_tilt", "SE_K_W_TILT", None, 2.0, 200.0, "1/s", "gain of the rates of roll and pitch, over inertia", rule=lambda t: K_W * _speed(t), gain=True),
        P("k_W_yaw", "SE_K_W_YAW", None, 0.2, 100.0, "1/s", "gain of the rate of yaw, over inertia", rule=lambda t: 2.3 * math.sqrt(_yaw(t)), gain=True),
        P("k_I_tilt", "SE_K_I_TILT", None, 0.0, 100.0, "1/s^2", "gain of their integral, over inertia; 0: none", rule=lambda t: 11.0 * _speed(t) ** 2, gain=True),
        P("k_I_yaw", "SE_K_I_YAW", None, 0.0, 100.0, "1/s^2", "gain of its integral, over inertia; 0: none", rule=lambda t: 0.1 * _yaw(t), gain=True),
        P("c_2", "SE_C_2", 0.8, 0.0, 20.0, "1/s", "weight of attitude in the integral"),
        P("sigma_I", "SE_SIGMA_I", 1.0, 0.0, 100.0, "rad", "limit of the integral"),
    ),
)  # fmt: skip


def pace(params):
    """How fast it follows, and the thrust of hover."""
    return Pace(
        f_m=0.5 * math.sqrt(params.k_x),
        yaw_rate_max=min(1.5, params.k_R_yaw / params.k_W_yaw),
        T_hover=params.m * G,
    )


# --- one tick


@kernel
def take_over(params, setpoint, measured):
    """The first tick: nothing is integrated yet."""
    zero = Vec3(0.0, 0.0, 0.0)
    return step(State(e_i=zero, e_I=zero), params, setpoint, measured)


@kernel
def step(state, params, setpoint, measured):
    """One tick: errors of position to a force, to thrust and attitude, to torque."""
    R, W, limits = matrix(measured.q_EB), measured.w_B, params.limits
    at_position, at_rates = setpoint.level < 0.5, setpoint.level > 1.5

    e_x, e_v, far = position_errors(params, setpoint, measured)
    A, tilted = force(params, state.e_i, e_x, e_v, setpoint.a_c)
    T_asked = select(at_position, params.m * dot(A, R.e3), setpoint.T_c)  # (19)
    T_c, thrust_cut = within_thrust(limits, T_asked)
    held = (tilted > 0.0) | (thrust_cut > 0.0)

    tilt, past = asked_tilt(limits, setpoint)
    e = measured.r_E - setpoint.r_c
    followed = followed_attitude(params, setpoint, state.e_i, e, e_v, far, A, T_c, R, W, held)
    given = given_attitude(tilt, setpoint)
    c = Command(
        R=Matrix(
            select3(at_position, followed.R.e1, given.R.e1),
            select3(at_position, followed.R.e2, given.R.e2),
            select3(at_position, followed.R.e3, given.R.e3),
        ),
        W=select3(at_position, followed.W, given.W),
        W_dot=select3(at_position, followed.W_dot, given.W_dot),
    )

    zero = Vec3(0.0, 0.0, 0.0)
    e_R, Psi = attitude_error(c.R, R)
    e_R, Psi = select3(at_rates, zero, e_R), select(at_rates, 0.0, Psi)
    W_d = select3(at_rates, setpoint.w_c, rotate_back(R, rotate(c.R, c.W)))
    W_dot_d = select3(at_rates, zero, rotate_back(R, rotate(c.R, c.W_dot)))
    e_W = W - W_d  # (9)
    tau_c = moment(params, state.e_I, e_R, e_W, W, W_d, W_dot_d)
    thrusts, gave_up = allocate(params.rotors, T_c, tau_c)
    u = speed_command(params.rotors, thrusts, measured.Omega)

    e_i = select3(
        at_position & (not held) & (not far),
        clip3(state.e_i + params.h * (e_v + params.c_1 * e_x), -params.sigma, params.sigma),
        state.e_i,
    )  # departure 1
    grown = clip3(
        state.e_I + params.h * params.c_2 * e_R, -params.sigma_I, params.sigma_I
    )  # departure 1
    off = norm(e_R) > NEAR
    tilts, yaws = off | (gave_up.torque > 0.0), off | (gave_up.yaw > 0.0)
    e_I = Vec3(
        select(tilts, state.e_I.x, grown.x), select(tilts, state.e_I.y, grown.y),
        select(yaws, state.e_I.z, grown.z),
    )  # fmt: skip

    angles = euler(R)
    angles_c = select3(at_rates, angles, euler(c.R))
    tilt_cut = select(at_position, tilted, select(at_rates, 0.0, past))
    outputs = without_reference(
        params.rotors, measured, T_c, angles, angles_c, W_d, thrusts, thrust_cut, tilt_cut, gave_up
    )
    internals = Internals(A=A, e_R=e_R, e_W=e_W, Psi=Psi, W_c=c.W, W_dot_c=c.W_dot, tau_c=tau_c)
    return State(e_i=e_i, e_I=e_I), RotorCommand(u=u), outputs, internals


# --- position


@kernel
def position_errors(params, setpoint, measured):
    """(e_x, e_v, far): errors of position (m) and velocity (m/s), E, and whether it is far away.

    Far away e_x is cut to what is balanced by a speed that a_max can still stop: c e close by, with
    c = k_x/k_v, then the square root that joins it smoothly, and v_max at most.
    """
    e_x = measured.r_E - setpoint.r_c  # (17)
    e_v = measured.v_E - setpoint.v_c  # (18)
    n, c, a = norm(e_x), params.k_x / params.k_v, params.a_max
    stops = sqrt(maximum(2.0 * a * n - a * a / (c * c), 0.0))
    speed = minimum(select(n > a / (c * c), stops, c * n), params.v_max)
    k = minimum(1.0, speed / maximum(c * n, 1e-12))
    return k * e_x, e_v, k < 1.0  # departure 4


@kernel
def cut_error_rates(params, e, e_v, e_a):
    """First (m/s) and second (m/s^2) rate, E, of an error of position e (m, E) that is cut.

    e_v, e_a : rates of e itself.  With n = |e| the cut error is s(n)/c along e, s as in `position_errors`.
    """
    c, a = params.k_x / params.k_v, params.a_max
    knee = minimum(a / (c * c), params.v_max / c)  # m, from where it is cut
    n = maximum(norm(e), knee)
    stops = sqrt(maximum(2.0 * a * n - a * a / (c * c), 0.0))
    stops = maximum(stops, minimum(a / c, params.v_max))
    top = stops >= params.v_max
    g = minimum(stops, params.v_max) / c
    slope = select(top, 0.0, a / (c * stops))
    bend = select(top, 0.0, -a * a / (c * stops * stops * stops))
    u = e / n
    n_dot = dot(u, e_v)
    across = e_v - n_dot * u
    n_ddot = dot(u, e_a) + dot(across, across) / n
    turn = e_a - n_ddot * u - (n_dot / n) * across
    e_dot = (slope * n_dot) * u + (g / n) * across
    along = bend * n_dot * n_dot + slope * n_ddot
    return e_dot, along * u + (n_dot / n) * (2.0 * slope - g / n) * across + (g / n) * turn


@kernel
def force(params, e_i, e_x, e_v, a_c):
    """(A, tilted): the demanded specific force (m/s^2, E), and 1 if the tilt limit cut it.

    Kept upright first: its vertical part has a floor, its horizontal part shrinks to the limit.
    """
    A = unlimited(params, e_i, e_x, e_v, a_c)
    return within_tilt(A, params.A_z_min * G, params.limits.phi_star)  # departure 3


@kernel
def unlimited(params, e_i, e_x, e_v, a_c):
    """The specific force (m/s^2, E) that closes the errors of position and velocity."""
    up = Vec3(0.0, 0.0, G)
    return up + a_c - params.k_x * e_x - params.k_v * e_v - params.k_i * e_i  # (23) departure 1


@kernel
def followed_attitude(params, setpoint, e_i, e_x, e_v, far, A, T, R, W, held):
    """The commanded attitude of a demand A, its body rate and angular acceleration.

    The rates of A are those of its errors, in closed form: the acceleration is that of the model,
    with the thrust T (N) and with what the integral holds. e_x (m, E) is the whole error of position;
    `far` away it is cut, and not integrated.
    """
    b3, b3_dot = R.e3, rotate(R, Vec3(W.y, -W.x, 0.0))
    still = Vec3(0.0, 0.0, 0.0)
    e_a = (T / params.m) * b3 - Vec3(0.0, 0.0, G) + params.k_i * e_i - setpoint.a_c
    cut_dot, cut_ddot = cut_error_rates(params, e_x, e_v, e_a)
    x_dot, x_ddot = select3(far, cut_dot, e_v), select3(far, cut_ddot, e_a)  # departure 4
    e_i_dot = select3(far, still, e_v + params.c_1 * e_x)
    e_i_ddot = select3(far, still, e_a + params.c_1 * e_v)
    A_dot = -params.k_x * x_dot - params.k_v * e_a - params.k_i * e_i_dot
    f_dot = dot(A_dot, b3) + dot(A, b3_dot)
    e_j = f_dot * b3 + (T / params.m) * b3_dot + params.k_i * e_i_dot
    A_ddot = -params.k_x * x_ddot - params.k_v * e_j - params.k_i * e_i_ddot
    A_dot, A_ddot = select3(held, still, A_dot), select3(held, still, A_ddot)  # departure 2

    c, s, r = cos(setpoint.psi_c), sin(setpoint.psi_c), setpoint.psi_dot_c
    b1d, b1d_dot, b1d_ddot = (
        Vec3(c, s, 0.0),
        Vec3(-r * s, r * c, 0.0),
        Vec3(-r * r * c, -r * r * s, 0.0),
    )
    z, z_dot, z_ddot = direction(A, A_dot, A_ddot)  # (23)
    C = cross(z, b1d)
    C_dot = cross(z_dot, b1d) + cross(z, b1d_dot)
    C_ddot = cross(z_ddot, b1d) + 2.0 * cross(z_dot, b1d_dot) + cross(z, b1d_ddot)
    y, y_dot, y_ddot = direction(C, C_dot, C_ddot)
    x = cross(y, z)  # (38)
    x_dot = cross(y_dot, z) + cross(y, z_dot)
    x_ddot = cross(y_ddot, z) + 2.0 * cross(y_dot, z_dot) + cross(y, z_ddot)
    return Command(
        R=Matrix(x, y, z),  # (22)
        W=Vec3(dot(z, y_dot), dot(x, z_dot), dot(y, x_dot)),
        W_dot=Vec3(
            dot(z_dot, y_dot) + dot(z, y_ddot),
            dot(x_dot, z_dot) + dot(x, z_ddot),
            dot(y_dot, x_dot) + dot(y, x_ddot),
        ),
    )


@kernel
def direction(a, a_dot, a_ddot):
    """The direction of a vector, and its first and second derivative."""
    n = norm(a)
    u = a / n
    along = dot(u, a_dot)
    u_dot = (a_dot - along * u) / n
    u_ddot = (a_ddot - dot(u, a_ddot) * u - 2.0 * along * u_dot - dot(u_dot, a_dot) * u) / n
    return u, u_dot, u_ddot


@kernel
def given_attitude(tilt, setpoint):
    """The attitude of a setpoint that names it, turning at its rate of yaw."""
    R = matrix(from_euler(tilt.x, tilt.y, setpoint.psi_c))
    W = rotate_back(R, Vec3(0.0, 0.0, setpoint.psi_dot_c))
    return Command(R=R, W=W, W_dot=Vec3(0.0, 0.0, 0.0))


# --- attitude


@kernel
def attitude_error(R_d, R):
    """(e_R, Psi): error of an attitude R to R_d (B), and the error function, 0 to 2."""
    e1, e2, e3 = rotate_back(R_d, R.e1), rotate_back(R_d, R.e2), rotate_back(R_d, R.e3)
    Psi = 0.5 * (3.0 - e1.x - e2.y - e3.z)  # (6)
    e_R = 0.5 * Vec3(e2.z - e3.y, e3.x - e1.z, e1.y - e2.x)  # (8) (21)
    return e_R, Psi


@kernel
def moment(params, e_I, e_R, e_W, W, W_d, W_dot_d):
    """Torque (N m, B) for errors of attitude and body rate, along W_d and W_dot_d (B)."""
    J = params.J
    k_R = J * Vec3(params.k_R_tilt, params.k_R_tilt, params.k_R_yaw)  # departure 5
    k_W = J * Vec3(params.k_W_tilt, params.k_W_tilt, params.k_W_yaw)  # departure 5
    k_I = J * Vec3(params.k_I_tilt, params.k_I_tilt, params.k_I_yaw)
    tau = -(k_R * e_R) - k_W * e_W + cross(W, J * W) - J * (cross(W, W_d) - W_dot_d)  # (11) (20)
    return tau - k_I * (e_R + e_I)  # departure 1
