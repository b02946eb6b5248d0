"""Incremental nonlinear dynamic inversion: README.md has its equations, sources and departures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from fcu.interface.messages import RotorCommand
from fcu.interface.parameter import Parameter, Part, group
from fcu.kernel.algebra import Quat, Rotors, Vec3, dot, maximum, norm, select, select3
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import euler, matrix, normalised, rotate_back
from fcu.laws import scales
from fcu.laws.allocation import RotorParams, achieved, allocate, mean_squares, speed_command
from fcu.laws.demand import (
    G,
    asked_tilt,
    axis_of,
    tilt_of,
    trimmed,
    turned_with,
    velocity_towards,
    within_thrust,
    within_tilt,
    yaw_error,
)
from fcu.laws.face import Limits, Pace
from fcu.laws.filter import Filtered, low_pass
from fcu.laws.outputs import without_reference


class Params(NamedTuple):
    """Everything the law is told. Constant in flight."""

    h: float  # control period, s
    limits: Limits
    rotors: RotorParams
    m: float  # mass, kg
    J: Vec3  # inertia, kg m^2, B
    K_x: Vec3  # acceleration over error of position, 1/s^2, E (17)
    K_v: Vec3  # over error of velocity, 1/s, E (17)
    K_a: Vec3  # over error of acceleration, E (17)
    K_xi: Vec3  # angular acceleration over error angle, 1/s^2, B (28)
    K_w: Vec3  # over error of body rate, 1/s, B (28)
    cutoff_v: float  # filter of acceleration and thrust, rad/s
    cutoff_w: float  # filter of angular acceleration and torque, rad/s
    cutoff_j: float  # filter of the setpoint's acceleration, whose rate is its jerk, rad/s
    a_brake: float  # deceleration with which a setpoint is approached, m/s^2
    yaw_acceleration: float  # with which yaw is believed to slow down, rad/s^2
    yaw_rate_max: float  # fastest yaw towards a command, rad/s
    trim_rate: float  # integral of commanded minus achieved thrust, 1/s (36)


Tables = Mapping[str, Any]


def _K_xi(tables: Tables) -> Vec3:
    K_xi: Vec3 = scales.rate_bandwidth(tables) * scales.attitude_bandwidth(tables)
    return K_xi


def _tilt(tables: Tables) -> float:
    """Bandwidth of roll and pitch (1/s)."""
    return float(scales.attitude_bandwidth(tables).x)


def _w_x(tables: Tables) -> float:
    """Frequency of position (rad/s): that of attitude as in Table II of the paper."""
    return _tilt(tables) / 2.1


def _K_x(tables: Tables) -> Vec3:
    w = _w_x(tables)
    return Vec3(w * w, w * w, 0.75 * w * w)


def _K_v(tables: Tables) -> Vec3:
    w = _w_x(tables)
    return Vec3(1.84 * w, 1.84 * w, 1.38 * w)


P = Parameter

PARAMETERS = (
    *group(
        "Vehicle",
        P("m", "IN_MASS", None, 0.05, 200.0, "kg", "mass", rule=scales.mass),
        P(
            "J", (Part("IN_J_X", ("J.x",), "inertia about x"), Part("IN_J_Y", ("J.y",), "inertia about y"), Part("IN_J_Z", ("J.z",), "inertia about z")),
            None, 1e-5, 100.0, "kg m^2", "inertia: one, or about x, y, z", axes=True, rule=scales.inertia,
        ),
    ),
    *group(
        "Position",
        P(
            "K_x", (Part("IN_K_X_XY", ("K_x.x", "K_x.y"), "gain of position, level"), Part("IN_K_X_Z", ("K_x.z",), "gain of height")),
            None, 0.1, 1000.0, "1/s^2", "gains of position: one, or east, north, up", axes=True, rule=_K_x, gain=True,
        ),
        P(
            "K_v", (Part("IN_K_V_XY", ("K_v.x", "K_v.y"), "gain of velocity, level"), Part("IN_K_V_Z", ("K_v.z",), "gain of velocity upwards")),
            None, 0.1, 200.0, "1/s", "gains of velocity: one, or east, north, up", axes=True, rule=_K_v, gain=True,
        ),
        P(
            "K_a", (Part("IN_K_A_XY", ("K_a.x", "K_a.y"), "gain of acceleration, level"), Part("IN_K_A_Z", ("K_a.z",), "gain of acceleration upwards")),
            (0.5, 0.5, 0.3), 0.0, 5.0, "", "gains of acceleration: one, or east, north, up", axes=True, gain=True,
        ),
        P("cutoff_v", "IN_CUTOFF_V", None, 1.0, 1000.0, "rad/s", "filter of acceleration and thrust", rule=lambda t: 5.0 * _tilt(t), gain=True),
        P("cutoff_j", "IN_CUTOFF_J", None, 1.0, 1000.0, "rad/s", "filter of the setpoint's acceleration", rule=lambda t: 5.0 * _tilt(t)),
        P("a_brake", "IN_A_BRAKE", None, 0.1, 50.0, "m/s^2", "deceleration with which a setpoint is approached", rule=scales.brake),
    ),
    *group(
        "Attitude and rates",
        P(
            "K_xi", (Part("IN_K_XI_XY", ("K_xi.x", "K_xi.y"), "gain of roll and pitch"), Part("IN_K_XI_Z", ("K_xi.z",), "gain of yaw")),
            None, 0.1, 10000.0, "1/s^2", "gains of the error angles: one, or roll, pitch, yaw", axes=True, rule=_K_xi, gain=True,
        ),
        P(
            "K_w", (Part("IN_K_W_XY", ("K_w.x", "K_w.y"), "gain of the rates p and q"), Part("IN_K_W_Z", ("K_w.z",), "gain of the rate r")),
            None, 0.1, 1000.0, "1/s", "gains of the body rates: one, or p, q, r", axes=True, rule=scales.rate_bandwidth, gain=True,
        ),
        P("cutoff_w", "IN_CUTOFF_W", None, 1.0, 2000.0, "rad/s", "filter of angular acceleration and torque", rule=lambda t: 10.0 * _tilt(t), gain=True),
        P("yaw_acceleration", "IN_YAW_ACC", None, 0.01, 500.0, "rad/s^2", "what yaw is believed to slow down with", rule=scales.yaw_acceleration),
        P("yaw_rate_max", "IN_YAWRATE_MAX", None, 0.02, 20.0, "rad/s", "greatest yaw rate towards a command", rule=lambda t: min(3.0, 1.2 * scales.yaw_acceleration(t)), degrees=True),
    ),
    *group("Thrust", P("trim_rate", "IN_TRIM_RATE", 3.0, 0.0, 20.0, "1/s", "rate of the trim of thrust")),
)  # fmt: skip


class State(NamedTuple):
    """Everything the law remembers from tick to tick."""

    v: Vec3  # velocity, m/s, E
    w: Vec3  # body rate, rad/s, B
    e3: Vec3  # thrust axis, E
    Omega: Rotors  # rotor speeds, rad/s
    a_f: Filtered  # acceleration, m/s^2, E (16)
    f_f: Filtered  # specific thrust, m/s^2, E (18)
    alpha_f: Filtered  # angular acceleration, rad/s^2, B
    tau_f: Filtered  # torque of the rotors, N m, B (29)
    a_ref_f: Filtered  # the setpoint's acceleration, m/s^2, E
    T_c: float  # commanded thrust, N
    T_trim: float  # trim of thrust, N (36)


class Internals(NamedTuple):
    """What one tick computed: recorded, never fed back."""

    a_c: Vec3  # commanded acceleration, m/s^2, E (17)
    f_c: Vec3  # commanded specific thrust, m/s^2, E (20)
    f_ext: Vec3  # external force, N, E (18)
    xi_e: Vec3  # error angles, rad, B (27)
    alpha_c: Vec3  # commanded angular acceleration, rad/s^2, B (28)
    tau_ext: Vec3  # external torque, N m, B (29)
    tau_c: Vec3  # commanded torque, N m, B (31)


@kernel
def take_over(params, setpoint, measured):
    """The tick at which the law takes over. As `step` returns.

    There is no past to differentiate: what moves the vehicle is taken to be its rotors and gravity.
    """
    zero = Vec3(0.0, 0.0, 0.0)
    R_EB = matrix(measured.q_EB)
    T, tau = achieved(params.rotors, measured.Omega * measured.Omega)
    f = (T / params.m) * R_EB.e3
    state = State(
        v=measured.v_E,
        w=measured.w_B,
        e3=R_EB.e3,
        Omega=measured.Omega,
        a_f=Filtered(x=f + Vec3(0.0, 0.0, -G), x_dot=zero),
        f_f=Filtered(x=f, x_dot=zero),
        alpha_f=Filtered(x=tau / params.J, x_dot=zero),
        tau_f=Filtered(x=tau, x_dot=zero),
        a_ref_f=Filtered(x=setpoint.a_c, x_dot=zero),
        T_c=T,
        T_trim=0.0,
    )
    return command(state, params, setpoint, measured)


@kernel
def step(state, params, setpoint, measured):
    """One tick in flight: (state, command, outputs, internals) from the last state."""
    return command(sensed(state, params, setpoint, measured), params, setpoint, measured)


@kernel
def sensed(state, params, setpoint, measured):
    """The State with this tick's measurement filtered: what the last tick did to the vehicle."""
    h = params.h
    R_EB = matrix(measured.q_EB)
    Omega2 = mean_squares(params.rotors, state.Omega, measured.Omega)
    T, tau = achieved(params.rotors, Omega2)
    a = (measured.v_E - state.v) / h  # (16) departure 1
    alpha = (measured.w_B - state.w) / h
    f = (0.5 * T / params.m) * (state.e3 + R_EB.e3)
    gain, most = h * params.trim_rate, 0.3 * G * params.m
    return State(
        v=measured.v_E,
        w=measured.w_B,
        e3=R_EB.e3,
        Omega=measured.Omega,
        a_f=low_pass(state.a_f, a, params.cutoff_v, h),
        f_f=low_pass(state.f_f, f, params.cutoff_v, h),
        alpha_f=low_pass(state.alpha_f, alpha, params.cutoff_w, h),
        tau_f=low_pass(state.tau_f, tau, params.cutoff_w, h),
        a_ref_f=low_pass(state.a_ref_f, setpoint.a_c, params.cutoff_j, h),  # departure 2
        T_c=state.T_c,
        T_trim=trimmed(params.limits, state.T_trim, gain, most, state.T_c, T),  # (36) departure 3
    )


@kernel
def command(state, params, setpoint, measured):
    """The rest of a tick: from position to the rotors."""
    limits, rotors, J = params.limits, params.rotors, params.J
    R_EB = matrix(measured.q_EB)
    angles = euler(R_EB)
    by_angle, by_rate = setpoint.level > 0.5, setpoint.level > 1.5
    g_E = Vec3(0.0, 0.0, -G)

    # position: acceleration, then specific thrust, by increments
    v_c, _ = velocity_towards(setpoint.r_c - measured.r_E, params.K_x / params.K_v, params.a_brake)
    a_c = (
        params.K_v * (v_c + setpoint.v_c - measured.v_E)
        + params.K_a * (setpoint.a_c - state.a_f.x)
        + setpoint.a_c
    )  # (17) departure 4
    f_c = state.f_f.x + a_c - state.a_f.x  # (20)
    F, narrowed = within_tilt(params.m * f_c, 0.25 * G * params.m, limits.phi_star)
    T_0 = select(by_angle, setpoint.T_c, dot(F, R_EB.e3))  # (21) departure 5
    T_c, thrust_cut = within_thrust(limits, T_0)

    # the thrust's axis, from the position or from the setpoint
    tilt, past = asked_tilt(limits, setpoint)
    axis = select3(by_angle, axis_of(tilt.x, tilt.y, angles.z), F / norm(F))
    axis = select3(by_rate, R_EB.e3, axis)
    cut = select(by_rate, 0.0, select(by_angle, past, narrowed))
    psi_c = select(by_rate, angles.z, setpoint.psi_c)
    phi_c, theta_c = tilt_of(axis, psi_c)

    # attitude and body rate
    xi_e = error_angles(params, R_EB, axis, psi_c)
    along = maximum(dot(state.f_f.x, R_EB.e3), 0.25 * G)
    w_ref = w_reference(R_EB, state.a_ref_f.x_dot, along, setpoint.psi_dot_c)
    w_ref = select3(by_angle, turned_with(R_EB, setpoint.psi_dot_c, 0.0, 0.0), w_ref)
    w_c = select3(by_rate, setpoint.w_c, w_ref + params.K_xi / params.K_w * xi_e)
    alpha_c = params.K_w * (w_c - measured.w_B)  # (28) departure 6
    tau_c = state.tau_f.x + J * (alpha_c - state.alpha_f.x)  # (31)

    thrusts, gave_up = allocate(rotors, T_c + state.T_trim, tau_c)  # (33) departure 8
    u = speed_command(rotors, thrusts, measured.Omega)

    angles_c = Vec3(phi_c, theta_c, psi_c)
    outputs = without_reference(
        rotors, measured, T_c, angles, angles_c, w_c, thrusts, thrust_cut, cut, gave_up
    )
    internals = Internals(
        a_c=a_c,
        f_c=f_c,
        f_ext=params.m * (state.a_f.x - state.f_f.x - g_E),  # (18)
        xi_e=xi_e,
        alpha_c=alpha_c,
        tau_ext=J * state.alpha_f.x - state.tau_f.x,  # (29)
        tau_c=tau_c,
    )
    after = State(
        v=state.v,
        w=state.w,
        e3=state.e3,
        Omega=state.Omega,
        a_f=state.a_f,
        f_f=state.f_f,
        alpha_f=state.alpha_f,
        tau_f=state.tau_f,
        a_ref_f=state.a_ref_f,
        T_c=T_c,
        T_trim=state.T_trim,
    )
    return after, RotorCommand(u=u), outputs, internals


@kernel
def error_angles(params, R_EB, axis, psi_c):
    """Angles (rad, B) from the attitude there is to the one that points the thrust along axis (E)."""
    d = rotate_back(R_EB, axis)  # (22)
    level = normalised(Quat(maximum(1.0 + d.z, 1e-6), -d.y, d.x, 0.0))  # (23)
    n = Vec3(math.sin(psi_c), -math.cos(psi_c), 0.0)
    n = rotate_back(matrix(level), rotate_back(R_EB, n))  # (24)
    c = params.K_xi.z / params.K_w.z
    e_psi = yaw_error(
        math.atan2(n.x, -n.y), c, params.yaw_acceleration, params.yaw_rate_max
    )  # (25) departure 7
    xi = level * Quat(math.cos(0.5 * e_psi), 0.0, 0.0, math.sin(0.5 * e_psi))  # (26)
    size = math.sqrt(xi.x * xi.x + xi.y * xi.y + xi.z * xi.z)
    k = select(size > 1e-9, 2.0 * math.atan2(size, xi.w) / maximum(size, 1e-9), 2.0)
    return Vec3(k * xi.x, k * xi.y, k * xi.z)  # (27)


@kernel
def w_reference(R_EB, j_ref, f, psi_dot):
    """Body rate (rad/s, B) of a setpoint of jerk j_ref (m/s^3, E), at a specific thrust f (m/s^2)."""
    j = rotate_back(R_EB, j_ref)
    return turned_with(R_EB, psi_dot, -j.y / f, j.x / f)  # (14) departure 2


def pace(params: Params) -> Pace:
    """What modes that lead the vehicle have to know of the law."""
    f_m = math.sqrt(min(params.K_x.x, params.K_x.z))
    return Pace(f_m=0.5 * f_m, yaw_rate_max=params.yaw_rate_max, T_hover=params.m * G)
