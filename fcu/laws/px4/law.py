"""PX4's multicopter cascade: P position, PID velocity, P attitude on quaternions, PID body rates.

`step` is one tick from top to bottom. Equations, departures and where each stands in PX4's source:
README.md. E is Earth East-North-Up, B is body Forward-Left-Up, SI units throughout.
"""

from __future__ import annotations

import math
from math import acos, asin, cos, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from fcu.interface.airframe import airframe
from fcu.interface.messages import RotorCommand
from fcu.interface.parameter import Parameter, group
from fcu.kernel.algebra import (
    Quat,
    Vec3,
    clip,
    cross,
    dot,
    hypot,
    maximum,
    minimum,
    norm,
    select,
    select3,
)
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import (
    Matrix,
    conjugate,
    euler,
    from_euler,
    matrix,
    normalised,
    rotate_back,
)
from fcu.laws import scales
from fcu.laws.allocation import RotorParams, allocate, speed_command
from fcu.laws.demand import G, asked_tilt, within_thrust
from fcu.laws.face import Limits, Pace
from fcu.laws.outputs import without_reference

I_FADES = math.radians(400.0)  # rad/s, error of a body rate at which nothing is integrated
YAW_AUTO = math.radians(45.0)  # rad/s, MPC_YAWRAUTO_MAX: yaw of modes that lead the vehicle


class Params(NamedTuple):
    """What the law is told. Gains of the body rates are normalised, as PX4 has them."""

    h: float  # control period, s
    limits: Limits
    rotors: RotorParams
    m: float  # believed mass, kg
    k_r_xy: float  # commanded velocity over error of position, 1/s
    k_r_z: float  # the same, vertically
    v_max_xy: float  # greatest commanded speed across, m/s
    v_max_up: float  # upwards, m/s
    v_max_down: float  # downwards, m/s
    k_v_xy: float  # acceleration over error of velocity, 1/s
    k_i_xy: float  # acceleration over the integral of that error, 1/s^2
    k_d_xy: float  # acceleration over the rate of velocity
    k_v_z: float  # the same three, vertically
    k_i_z: float
    k_d_z: float
    velocity_cutoff: float  # of the filter of the rate of velocity, Hz
    thrust_margin: float  # thrust kept for the horizontal, over the greatest
    k_tilt: float  # body rate over error of attitude about roll and pitch, 1/s
    k_yaw: float  # the same about yaw, 1/s
    yaw_weight: float  # of the error about yaw, 0 to 1
    w_max_tilt: float  # greatest commanded rate of roll and of pitch, rad/s
    w_max_yaw: float  # of yaw, rad/s
    rate_k: float  # factor of the three gains below
    rate_p: float  # normalised torque over error of the rates of roll and pitch, s
    rate_i: float  # over its integral
    rate_d: float  # over angular acceleration, s^2
    rate_ff: float  # over the commanded rate, s
    rate_i_max: float  # limit of the integral's torque, normalised
    yaw_rate_k: float  # the same six about yaw
    yaw_rate_p: float
    yaw_rate_i: float
    yaw_rate_d: float
    yaw_rate_ff: float
    yaw_rate_i_max: float
    rate_cutoff: float  # of the filter of angular acceleration, Hz
    yaw_torque_cutoff: float  # of the filter of the torque about yaw, Hz
    torque_unit: Vec3  # torque that PX4 calls 1, N m, B


class State(NamedTuple):
    """What the law remembers from tick to tick."""

    v_E: Vec3  # velocity at the last tick, m/s, E
    v_dot: Vec3  # its rate, low-passed, m/s^2, E
    v_int: Vec3  # integral of the error of velocity, as acceleration, m/s^2, E
    w_B: Vec3  # body rate at the last tick, rad/s, B
    w_dot: Vec3  # its rate, low-passed, rad/s^2, B
    w_int: Vec3  # integral of the error of body rate, as normalised torque, B
    tau_yaw: float  # torque about yaw, low-passed, normalised
    refused: Vec3  # normalised torque of the last tick where the allocation gave it up, else 0, B


class Internals(NamedTuple):
    """What a tick computes on the way."""

    v_c: Vec3  # commanded velocity, m/s, E
    a_c: Vec3  # commanded acceleration, m/s^2, E
    T_E: Vec3  # commanded thrust vector, N, E
    tau_c: Vec3  # commanded torque, N m, B


# --- parameters


def torque_units(tables):
    """Torque (N m; roll, pitch, yaw) that a normalised torque of 1 is on an airframe.

    PX4 scales the columns of the allocation matrix: about roll and pitch to a mean square of one half,
    with one scale for both, about yaw to a greatest entry of one; a rotor's command of 1 is its
    full thrust.
    """
    rotors = airframe(tables["rotors"])
    f_max = np.asarray(rotors.c_T) * np.square(rotors.Omega_max) * np.ones(8)
    used = f_max > 0.0
    y, x, spin = (np.asarray(row)[used] for row in (rotors.y, rotors.x, rotors.spin))
    mix = np.linalg.pinv(np.stack([np.ones(used.sum()), y, -x, -rotors.k_Q * spin]))[:, 1:]
    live = np.maximum((np.abs(mix[:, :2]) > 1e-3).sum(axis=0), 1)
    tilt = np.sqrt(np.square(mix[:, :2]).sum(axis=0) / (live / 2.0)).max()
    unit = f_max[used].mean() / np.array([tilt, tilt, mix[:, 2].max()])  # (12)
    return tuple(unit.tolist())


P_TILT, P_YAW = 0.15, 0.2  # MC_ROLLRATE_P, MC_YAWRATE_P
RATES = 0.4  # rate loop times the lag that is left of the rotors', at most


def _rate_k(tables):
    """MC_ROLLRATE_K: 1, or less where the published gain would make the rate loop too fast."""
    unit, J = torque_units(tables), scales.inertia(tables)
    loop = max(P_TILT * unit[axis] / J[axis] for axis in (0, 1))
    return min(1.0, RATES / scales.rotor_response(tables) / loop)  # departure 5


def _k_tilt(tables):
    """MC_ROLL_P: 6.5, or a third of the rate loop where that is slow."""
    unit, J = torque_units(tables), scales.inertia(tables)
    loop = min(_rate_k(tables) * P_TILT * unit[axis] / J[axis] for axis in (0, 1))
    return min(6.5, loop / 3.0)  # departure 5


K_YAW = 2.8  # 1/s, MC_YAW_P


def _yaw_rate_k(tables):
    """MC_YAWRATE_K: makes the rate loop half as fast again as that of yaw, with a gain of 0.6 at most."""
    loop = P_YAW * torque_units(tables)[2] / scales.inertia(tables).z
    return min(3.0, 1.5 * K_YAW / loop)  # departure 5


P = Parameter
DEGREE = math.radians(1.0)

PARAMETERS = (
    P("m", "PX_MASS", None, 0.05, 100.0, "kg", "believed mass; its weight is PX4's hover thrust", rule=scales.mass),
    *group(
        "Position and velocity",
        P("k_r_xy", "MPC_XY_P", 0.95, 0.2, 4.0, "1/s", "gain of position across", gain=True),
        P("k_r_z", "MPC_Z_P", 1.0, 0.2, 4.0, "1/s", "gain of height", gain=True),
        P("v_max_xy", "PX_V_MAX_XY", 12.0, 0.5, 50.0, "m/s", "greatest commanded speed across (MPC_XY_VEL_MAX)"),
        P("v_max_up", "PX_V_MAX_UP", 3.0, 0.5, 20.0, "m/s", "greatest commanded climb (MPC_Z_VEL_MAX_UP)"),
        P("v_max_down", "PX_V_MAX_DN", 1.5, 0.5, 20.0, "m/s", "greatest commanded descent (MPC_Z_VEL_MAX_DN)"),
        P("k_v_xy", "MPC_XY_VEL_P_ACC", 1.8, 0.4, 8.0, "1/s", "gain of velocity across", gain=True),
        P("k_i_xy", "MPC_XY_VEL_I_ACC", 0.4, 0.0, 2.0, "1/s^2", "gain of its integral", gain=True),
        P("k_d_xy", "MPC_XY_VEL_D_ACC", 0.2, 0.0, 1.0, "", "gain of its rate", gain=True),
        P("k_v_z", "MPC_Z_VEL_P_ACC", 4.0, 1.0, 16.0, "1/s", "gain of vertical velocity", gain=True),
        P("k_i_z", "MPC_Z_VEL_I_ACC", 2.0, 0.0, 8.0, "1/s^2", "gain of its integral", gain=True),
        P("k_d_z", "MPC_Z_VEL_D_ACC", 0.0, 0.0, 1.0, "", "gain of its rate"),
        P("velocity_cutoff", "MPC_VELD_LP", 5.0, 0.5, 100.0, "Hz", "filter of the rate of velocity"),
        P("thrust_margin", "MPC_THR_XY_MARG", 0.3, 0.0, 0.9, "", "thrust kept for the horizontal, over the greatest"),
    ),
    *group(
        "Attitude",
        P("k_tilt", "MC_ROLL_P", None, 0.5, 30.0, "1/s", "gain of roll and pitch", rule=_k_tilt, gain=True),
        P("k_yaw", "MC_YAW_P", K_YAW, 0.1, 12.0, "1/s", "gain of yaw", gain=True),
        P("yaw_weight", "MC_YAW_WEIGHT", 0.4, 0.0, 1.0, "", "weight of the error about yaw"),
        P("w_max_tilt", "MC_ROLLRATE_MAX", 220.0 * DEGREE, 10.0 * DEGREE, 1800.0 * DEGREE, "rad/s", "greatest commanded rate of roll and of pitch", degrees=True),
        P("w_max_yaw", "MC_YAWRATE_MAX", 200.0 * DEGREE, 10.0 * DEGREE, 1800.0 * DEGREE, "rad/s", "greatest commanded rate of yaw", degrees=True),
    ),
    *group(
        "Body rates",
        P("rate_k", "MC_ROLLRATE_K", None, 0.01, 5.0, "", "factor of the gains of roll and pitch", rule=_rate_k),
        P("rate_p", "MC_ROLLRATE_P", P_TILT, 0.03, 0.6, "s", "gain of the rates of roll and pitch", gain=True),
        P("rate_i", "MC_ROLLRATE_I", 0.2, 0.0, 0.8, "", "gain of their integral", gain=True),
        P("rate_d", "MC_ROLLRATE_D", 0.003, 0.0, 0.012, "s^2", "gain of their rate", gain=True),
        P("rate_ff", "MC_ROLLRATE_FF", 0.0, 0.0, 1.0, "s", "feed-forward of the commanded rate"),
        P("rate_i_max", "MC_RR_INT_LIM", 0.3, 0.0, 1.0, "", "limit of the integral, normalised torque"),
        P("yaw_rate_k", "MC_YAWRATE_K", None, 0.01, 5.0, "", "factor of the gains of yaw", rule=_yaw_rate_k),
        P("yaw_rate_p", "MC_YAWRATE_P", P_YAW, 0.04, 0.8, "s", "gain of the rate of yaw", gain=True),
        P("yaw_rate_i", "MC_YAWRATE_I", 0.1, 0.0, 0.4, "", "gain of its integral", gain=True),
        P("yaw_rate_d", "MC_YAWRATE_D", 0.0, 0.0, 0.012, "s^2", "gain of its rate"),
        P("yaw_rate_ff", "MC_YAWRATE_FF", 0.0, 0.0, 1.0, "s", "feed-forward of the commanded rate of yaw"),
        P("yaw_rate_i_max", "MC_YR_INT_LIM", 0.3, 0.0, 1.0, "", "limit of the integral, normalised torque"),
        P("rate_cutoff", "IMU_DGYRO_CUTOFF", 20.0, 1.0, 1000.0, "Hz", "filter of angular acceleration"),
        P("yaw_torque_cutoff", "MC_YAW_TQ_CUTOFF", 2.0, 0.1, 1000.0, "Hz", "filter of the torque about yaw"),
        P("torque_unit", "", None, 1e-4, 1e4, "N m", "torque that PX4 calls 1", axes=True, rule=torque_units),
    ),
)  # fmt: skip


def pace(params):
    """How fast it follows, and the thrust of hover."""
    return Pace(f_m=params.k_r_xy, yaw_rate_max=YAW_AUTO, T_hover=params.m * G)


# --- one tick


@kernel
def take_over(params, setpoint, measured):
    """The first tick: no past, no integrals."""
    zero = Vec3(0.0, 0.0, 0.0)
    state = State(
        v_E=measured.v_E, v_dot=zero, v_int=zero, w_B=measured.w_B, w_dot=zero, w_int=zero,
        tau_yaw=0.0, refused=zero,
    )  # fmt: skip
    return step(state, params, setpoint, measured)


@kernel
def step(state, params, setpoint, measured):
    """One tick: position to velocity, to thrust vector, to attitude, to body rates, to torque."""
    R_EB, v, w, limits = matrix(measured.q_EB), measured.v_E, measured.w_B, params.limits
    v_dot = low_passed(params, params.velocity_cutoff, state.v_dot, v - state.v_E)
    w_dot = low_passed(params, params.rate_cutoff, state.w_dot, w - state.w_B)  # departure 3
    at_position, at_rates = setpoint.level < 0.5, setpoint.level > 1.5

    v_c = commanded_velocity(params, setpoint, measured.r_E)
    a_c = acceleration(params, state.v_int, v_c - v, v_dot, setpoint.a_c)
    T_E, thrust_cut, tilt_cut, v_int = thrust(params, state.v_int, v_c - v, a_c)
    v_int = select3(at_position, v_int, state.v_int)

    T_asked = select(at_position, norm(T_E), setpoint.T_c)
    T_c, T_cut = within_thrust(limits, T_asked)
    tilt, past = asked_tilt(limits, setpoint)  # departure 2
    asked = select3(at_position, euler(attitude_of(T_E, setpoint.psi_c)), tilt)
    q_d = from_euler(asked.x, asked.y, setpoint.psi_c)
    angles = euler(R_EB)
    angles_c = select3(at_rates, angles, Vec3(asked.x, asked.y, setpoint.psi_c))

    w_c = commanded_rates(params, measured.q_EB, q_d, setpoint.psi_dot_c)
    w_c = select3(at_rates, setpoint.w_c, w_c)
    unit, w_int = body_torque(params, state, w_c, w, w_dot)
    alpha = weight(params, params.yaw_torque_cutoff)
    tau_yaw = state.tau_yaw + alpha * (unit.z - state.tau_yaw)  # (11)
    unit = Vec3(unit.x, unit.y, tau_yaw)
    tau_c = unit * params.torque_unit
    thrusts, gave_up = allocate(params.rotors, T_c, tau_c)  # departure 4
    u = speed_command(params.rotors, thrusts, measured.Omega)

    thrust_cut = select(at_position, thrust_cut, T_cut)
    tilt_cut = select(at_position, tilt_cut, select(at_rates, 0.0, past))
    outputs = without_reference(
        params.rotors, measured, T_c, angles, angles_c, w_c, thrusts, thrust_cut, tilt_cut, gave_up
    )
    refused = Vec3(gave_up.torque * unit.x, gave_up.torque * unit.y, gave_up.yaw * unit.z)
    after = State(
        v_E=v, v_dot=v_dot, v_int=v_int, w_B=w, w_dot=w_dot, w_int=w_int, tau_yaw=tau_yaw,
        refused=refused,
    )  # fmt: skip
    return after, RotorCommand(u=u), outputs, Internals(v_c=v_c, a_c=a_c, T_E=T_E, tau_c=tau_c)


# --- filters


@kernel
def weight(params, cutoff):
    """Weight of a new sample in a first-order low-pass of a cutoff (Hz)."""
    return params.h / (params.h + 1.0 / (2.0 * pi * cutoff))


@kernel
def low_passed(params, cutoff, rate, change):
    """The low-passed rate (1/s) of a quantity one tick on, from its change over the tick."""
    alpha = weight(params, cutoff)
    return rate + alpha * ((1.0 / params.h) * change - rate)


# --- position and velocity


@kernel
def commanded_velocity(params, setpoint, r_E):
    """Commanded velocity (m/s, E): P on position, the setpoint's own added, within limits."""
    e = setpoint.r_c - r_E
    p = Vec3(params.k_r_xy * e.x, params.k_r_xy * e.y, params.k_r_z * e.z)
    x, y = within(p.x, p.y, setpoint.v_c.x, setpoint.v_c.y, params.v_max_xy)
    v_z = clip(p.z + setpoint.v_c.z, -params.v_max_down, params.v_max_up)
    return Vec3(x, y, v_z)  # (1) (2)


@kernel
def within(x0, y0, x1, y1, most):
    """Two velocities (x0, y0) + (x1, y1) across, m/s, at most `most`: the first goes before."""
    n0, n1 = hypot(x0, y0), hypot(x1, y1)
    free = hypot(x0 + x1, y0 + y1) <= most
    alone = n0 >= most
    ux, uy = x1 / maximum(n1, 1e-9), y1 / maximum(n1, 1e-9)
    along = ux * x0 + uy * y0
    s = sqrt(maximum(along * along + most * most - n0 * n0, 0.0)) - along
    k = most / maximum(n0, 1e-9)
    x = select(free, x0 + x1, select(alone, k * x0, x0 + s * ux))
    y = select(free, y0 + y1, select(alone, k * y0, y0 + s * uy))
    return x, y  # (2)


@kernel
def acceleration(params, v_int, e_v, v_dot, a_c):
    """Commanded acceleration (m/s^2, E): PID on velocity, the setpoint's own added."""
    return Vec3(
        a_c.x + params.k_v_xy * e_v.x + v_int.x - params.k_d_xy * v_dot.x,
        a_c.y + params.k_v_xy * e_v.y + v_int.y - params.k_d_xy * v_dot.y,
        a_c.z + params.k_v_z * e_v.z + v_int.z - params.k_d_z * v_dot.z,
    )  # (3)


@kernel
def thrust(params, v_int, e_v, a_c):
    """(T_E, cut, tilted, v_int): thrust vector (N, E) for an acceleration (m/s^2, E), and after it.

    cut, tilted: 1 while a limit of thrust, or that of tilt, holds it. v_int: the integral of the error
    of velocity e_v (m/s) one tick on, wound up by none of these limits.
    """
    T_min, T_max = maximum(params.limits.T_min, 1e-3), params.limits.T_max  # it points somewhere
    T_hover = params.m * G  # departure 1
    up, tilted = within_tilt(Vec3(a_c.x, a_c.y, G), params.limits.phi_star)
    T_0 = T_hover / G * (a_c.z + G) / up.z
    T = maximum(T_0, T_min)  # (4)
    x, y, z = T * up.x, T * up.y, T * up.z

    # height first, but for a margin across
    across = hypot(x, y)
    kept = minimum(across, params.thrust_margin * T_max)
    top = sqrt(T_max * T_max - kept * kept)
    held = (z <= T_min) & (e_v.z <= 0.0) | (z >= T_max) & (e_v.z >= 0.0)
    z_c = minimum(z, top)
    room = sqrt(maximum(T_max * T_max - z_c * z_c, 0.0))
    k = minimum(1.0, room / maximum(across, 1e-9))
    T_E = Vec3(k * x, k * y, z_c)  # (5)

    # what was not produced unwinds the integral across; held, it waits upwards
    made_x, made_y = T_E.x * (G / T_hover), T_E.y * (G / T_hover)
    short = hypot(a_c.x, a_c.y) > hypot(made_x, made_y)
    back = 2.0 / params.k_v_xy
    e_x = e_v.x - select(short, back * (a_c.x - made_x), 0.0)
    e_y = e_v.y - select(short, back * (a_c.y - made_y), 0.0)
    e_z = select(held, 0.0, e_v.z)
    v_int = Vec3(
        v_int.x + params.h * params.k_i_xy * e_x,
        v_int.y + params.h * params.k_i_xy * e_y,
        clip(v_int.z + params.h * params.k_i_z * e_z, -G, G),
    )  # (6)
    cut = (T_min > T_0) | (z > top) | (across > room)
    return T_E, select(cut, 1.0, 0.0), tilted, v_int


@kernel
def within_tilt(a, most):
    """The direction of a (E), tilted from upright by no more than `most` (rad); 1 if it was more."""
    n = norm(a)
    tilt = acos(clip(a.z / n, -1.0, 1.0))
    across = hypot(a.x, a.y)
    lies = across > 1e-7 * n  # neither upright nor upside down
    x, y = (
        select(lies, a.x / maximum(across, 1e-12), 1.0),
        select(lies, a.y / maximum(across, 1e-12), 0.0),
    )
    kept = minimum(tilt, most)
    return Vec3(sin(kept) * x, sin(kept) * y, cos(kept)), select(tilt > most, 1.0, 0.0)  # (4)


@kernel
def attitude_of(T_E, psi):
    """The attitude whose thrust axis is along T_E and whose nose points to yaw psi (rad)."""
    z = T_E / norm(T_E)
    x = cross(Vec3(-sin(psi), cos(psi), 0.0), z)
    x = x / norm(x)
    return Matrix(x, cross(z, x), z)  # (7)


# --- attitude


@kernel
def commanded_rates(params, q_EB, q_d, psi_dot_c):
    """Commanded body rate (rad/s, B) from an attitude to q_d, yaw given less weight than tilt."""
    z, z_d = matrix(q_EB).e3, matrix(q_d).e3
    w, n = dot(z, z_d), cross(z, z_d)
    opposite = (norm(n) < 1e-5) & (w < 0.0)
    turn = Quat(select(opposite, 1.0, 1.0 + w), n.x, n.y, n.z)
    turn = normalised(turn)
    opposite = opposite | (abs(turn.x) > 1.0 - 1e-5) | (abs(turn.y) > 1.0 - 1e-5)
    q_red = of_two(opposite, q_d, turn * q_EB)

    yaw = canonical(conjugate(q_red) * q_d)
    k = params.yaw_weight
    half_w, half_z = acos(clip(yaw.w, -1.0, 1.0)), asin(clip(yaw.z, -1.0, 1.0))
    q_c = q_red * Quat(cos(k * half_w), 0.0, 0.0, sin(k * half_z))

    e = canonical(conjugate(q_EB) * q_c)
    k_yaw = params.k_yaw / select(k > 1e-4, k, 1.0)
    gain = Vec3(params.k_tilt, params.k_tilt, k_yaw)
    w_c = gain * Vec3(2.0 * e.x, 2.0 * e.y, 2.0 * e.z)
    w_c = w_c + psi_dot_c * rotate_back(matrix(q_EB), Vec3(0.0, 0.0, 1.0))  # (8)
    tilt, yaw_most = params.w_max_tilt, params.w_max_yaw
    return Vec3(
        clip(w_c.x, -tilt, tilt), clip(w_c.y, -tilt, tilt), clip(w_c.z, -yaw_most, yaw_most)
    )


@kernel
def of_two(condition, a, b):
    """`select` of two quaternions."""
    return Quat(
        select(condition, a.w, b.w), select(condition, a.x, b.x), select(condition, a.y, b.y),
        select(condition, a.z, b.z),
    )  # fmt: skip


@kernel
def canonical(q):
    """The one of q and -q that turns the short way."""
    return of_two(q.w < 0.0, -q, q)


# --- body rates


@kernel
def body_torque(params, state, w_c, w, w_dot):
    """(torque, w_int): normalised torque (B) that closes the error of the body rates, and the
    integral one tick on.
    """
    e = w_c - w
    k, k_yaw = params.rate_k, params.yaw_rate_k
    p = Vec3(k * params.rate_p, k * params.rate_p, k_yaw * params.yaw_rate_p)
    i = Vec3(k * params.rate_i, k * params.rate_i, k_yaw * params.yaw_rate_i)
    d = Vec3(k * params.rate_d, k * params.rate_d, k_yaw * params.yaw_rate_d)
    ff = Vec3(params.rate_ff, params.rate_ff, params.yaw_rate_ff)
    tau = p * e + state.w_int - d * w_dot + ff * w_c  # (9)
    most, most_yaw = params.rate_i_max, params.yaw_rate_i_max
    w_int = Vec3(
        integral(params.h * i.x, state.w_int.x, e.x, state.refused.x, most),
        integral(params.h * i.y, state.w_int.y, e.y, state.refused.y, most),
        integral(params.h * i.z, state.w_int.z, e.z, state.refused.z, most_yaw),
    )  # departure 6
    return tau, w_int


@kernel
def integral(gain, value, e, refused, most):
    """The integral of a body rate's error e (rad/s) one tick on, within `most` (normalised torque).

    It does not grow where the allocation refused torque of that sign, and hardly at large errors.
    """
    e = select(refused > 0.0, minimum(e, 0.0), e)
    e = select(refused < 0.0, maximum(e, 0.0), e)
    part = e / I_FADES
    return clip(value + maximum(0.0, 1.0 - part * part) * gain * e, -most, most)  # (10)
