"""L1 adaptive augmentation of geometric control: README.md has its equations and departures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from fcu.interface.messages import RotorCommand
from fcu.interface.parameter import Parameter, Part, group
from fcu.kernel.algebra import Rotors, Vec3, clip3, cross, dot, maximum, norm, select, select3
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import Matrix, euler, matrix, rotate, rotate_back, wrap
from fcu.laws import scales
from fcu.laws.allocation import RotorParams, achieved, allocate, mean_squares, speed_command
from fcu.laws.demand import (
    G,
    asked_tilt,
    axis_of,
    tilt_of,
    trimmed,
    velocity_towards,
    within_thrust,
    within_tilt,
    yaw_error,
)
from fcu.laws.face import Limits, Pace
from fcu.laws.filter import Filtered, low_pass
from fcu.laws.outputs import without_reference

LEFT, TILTED = "left", "tilted"


class Params(NamedTuple):
    """Everything the law is told. Constant in flight."""

    h: float  # control period, s
    limits: Limits
    rotors: RotorParams
    m: float  # mass, kg
    J: Vec3  # inertia, kg m^2, B
    k_p: Vec3  # force over mass and error of position, 1/s^2, E (1)
    k_v: Vec3  # over error of velocity, 1/s, E (1)
    k_R: Vec3  # torque over inertia and error of attitude, 1/s^2, B (6)
    k_w: Vec3  # over error of body rate, 1/s, B (6)
    A_v: float  # decay of the velocity's prediction error, 1/s (8)
    A_w: float  # decay of the body rate's, 1/s (8)
    w_T: float  # cut-off for thrust, rad/s (11)
    w_M1: float  # cut-off for torque, rad/s (11)
    w_M2: float  # cut-off of a second filter for torque, rad/s (11)
    tilted: float  # 1: lean against the unmatched force too; 0: leave it to the baseline
    cutoff_j: float  # filter of the setpoint's acceleration, whose rate is its jerk, rad/s
    w_feed_max: float  # limit of the body rate of the commanded attitude, rad/s
    a_brake: float  # deceleration with which a setpoint is approached, m/s^2
    yaw_acceleration: float  # with which yaw is believed to slow down, rad/s^2
    yaw_rate_max: float  # fastest yaw towards a command, rad/s
    trim_rate: float  # integral of commanded minus achieved thrust, 1/s


Tables = Mapping[str, Any]


def _k_R(tables: Tables) -> Vec3:
    k_R: Vec3 = scales.rate_bandwidth(tables) * scales.attitude_bandwidth(tables)
    return k_R


def _tilt(tables: Tables) -> float:
    """Bandwidth of roll and pitch (1/s)."""
    return float(scales.attitude_bandwidth(tables).x)


def _w_p(tables: Tables) -> float:
    """Frequency of position (rad/s)."""
    return _tilt(tables) / 2.1


def _k_p(tables: Tables) -> Vec3:
    w = _w_p(tables)
    return Vec3(w * w, w * w, w * w)


def _k_v(tables: Tables) -> Vec3:
    w = 1.6 * _w_p(tables)
    return Vec3(w, w, w)


P = Parameter

PARAMETERS = (
    *group(
        "Vehicle",
        P("m", "L1_MASS", None, 0.05, 200.0, "kg", "mass", rule=scales.mass),
        P(
            "J", (Part("L1_J_X", ("J.x",), "inertia about x"), Part("L1_J_Y", ("J.y",), "inertia about y"), Part("L1_J_Z", ("J.z",), "inertia about z")),
            None, 1e-5, 100.0, "kg m^2", "inertia: one, or about x, y, z", axes=True, rule=scales.inertia,
        ),
    ),
    *group(
        "Geometric baseline",
        P(
            "k_p", (Part("L1_K_P_XY", ("k_p.x", "k_p.y"), "gain of position, level"), Part("L1_K_P_Z", ("k_p.z",), "gain of height")),
            None, 0.1, 1000.0, "1/s^2", "gains of position over mass: one, or east, north, up", axes=True, rule=_k_p, gain=True,
        ),
        P(
            "k_v", (Part("L1_K_V_XY", ("k_v.x", "k_v.y"), "gain of velocity, level"), Part("L1_K_V_Z", ("k_v.z",), "gain of velocity upwards")),
            None, 0.1, 200.0, "1/s", "gains of velocity over mass: one, or east, north, up", axes=True, rule=_k_v, gain=True,
        ),
        P(
            "k_R", (Part("L1_K_R_XY", ("k_R.x", "k_R.y"), "gain of roll and pitch"), Part("L1_K_R_Z", ("k_R.z",), "gain of yaw")),
            None, 0.1, 10000.0, "1/s^2", "gains of attitude over inertia: one, or roll, pitch, yaw", axes=True, rule=_k_R, gain=True,
        ),
        P(
            "k_w", (Part("L1_K_W_XY", ("k_w.x", "k_w.y"), "gain of the rates p and q"), Part("L1_K_W_Z", ("k_w.z",), "gain of the rate r")),
            None, 0.1, 1000.0, "1/s", "gains of body rates over inertia: one, or p, q, r", axes=True, rule=scales.rate_bandwidth, gain=True,
        ),
        P("cutoff_j", "L1_CUTOFF_J", None, 1.0, 1000.0, "rad/s", "filter of the setpoint's acceleration", rule=lambda t: 5.0 * _tilt(t)),
        P("w_feed_max", "L1_W_FEED_MAX", 5.0, 0.0, 50.0, "rad/s", "greatest body rate of the commanded attitude that is fed forward"),
        P("a_brake", "L1_A_BRAKE", None, 0.1, 50.0, "m/s^2", "deceleration with which a setpoint is approached", rule=scales.brake),
        P("yaw_acceleration", "L1_YAW_ACC", None, 0.01, 500.0, "rad/s^2", "what yaw is believed to slow down with", rule=scales.yaw_acceleration),
        P("yaw_rate_max", "L1_YAWRATE_MAX", None, 0.02, 20.0, "rad/s", "greatest yaw rate towards a command", rule=lambda t: min(3.0, 1.2 * scales.yaw_acceleration(t)), degrees=True),
    ),
    *group(
        "L1 adaptation",
        P("A_v", "L1_A_V", 5.0, 0.1, 500.0, "1/s", "decay of the prediction error of velocity", gain=True),
        P("A_w", "L1_A_W", 10.0, 0.1, 500.0, "1/s", "decay of the prediction error of body rate", gain=True),
        P("w_T", "L1_W_T", None, 0.1, 1000.0, "rad/s", "cut-off of the compensation by thrust", rule=lambda t: 2.0 * _tilt(t), gain=True),
        P("w_M1", "L1_W_M1", None, 0.1, 1000.0, "rad/s", "cut-off of the compensation by torque", rule=lambda t: _tilt(t) / 3.0, gain=True),
        P("w_M2", "L1_W_M2", None, 0.1, 1000.0, "rad/s", "cut-off of the second filter of it", rule=_tilt, gain=True),
        P("unmatched", "L1_UNMATCHED", LEFT, 0.0, 1.0, "", "force across the thrust: left to the baseline, or leaned against", "tilted", words={LEFT: 0.0, TILTED: 1.0}),
    ),
    *group("Thrust", P("trim_rate", "L1_TRIM_RATE", 3.0, 0.0, 20.0, "1/s", "rate of the trim of thrust")),
)  # fmt: skip


class Predictor(NamedTuple):
    """Predicted minus measured, and the uncertainty that explains it."""

    v_til: Vec3  # velocity, m/s, E (9)
    w_til: Vec3  # body rate, rad/s, B (9)
    s_v_hat: Vec3  # force over mass, m/s^2, E (10)
    s_w_hat: Vec3  # torque over inertia, rad/s^2, B (10)


class Filters(NamedTuple):
    """The low-passed estimates, C(s) of (11)."""

    T: float  # force along the thrust, N
    f: Vec3  # force, N, E
    M1: Vec3  # torque after the first filter, N m, B
    M2: Vec3  # torque after the second, N m, B


class State(NamedTuple):
    """Everything the law remembers from tick to tick."""

    v: Vec3  # velocity, m/s, E
    w: Vec3  # body rate, rad/s, B
    e3: Vec3  # thrust axis, E
    Omega: Rotors  # rotor speeds, rad/s
    predictor: Predictor
    filters: Filters
    a_ref_f: Filtered  # the setpoint's acceleration, m/s^2, E
    T_c: float  # commanded thrust, N
    T_trim: float  # trim of thrust, N


class Internals(NamedTuple):
    """What one tick computed: recorded, never fed back."""

    F_d: Vec3  # demanded force, N, E (1)
    e_R: Vec3  # error of attitude, B (4)
    e_w: Vec3  # error of body rate, rad/s, B (5)
    M_b: Vec3  # torque of the baseline, N m, B (6)
    tau_c: Vec3  # commanded torque, N m, B (7)
    sigma_T: float  # matched uncertainty of thrust, N (10)
    sigma_M: Vec3  # matched uncertainty of torque, N m, B (10)
    sigma_um: Vec3  # unmatched uncertainty, N, B; z unused (10)
    fed_cut: float  # 1 while the commanded attitude turns faster than is fed forward


@kernel
def take_over(params, setpoint, measured):
    """The tick at which the law takes over: no past to learn from yet. As `step` returns."""
    zero = Vec3(0.0, 0.0, 0.0)
    R_EB = matrix(measured.q_EB)
    T, _ = achieved(params.rotors, measured.Omega * measured.Omega)
    state = State(
        v=measured.v_E,
        w=measured.w_B,
        e3=R_EB.e3,
        Omega=measured.Omega,
        predictor=Predictor(v_til=zero, w_til=zero, s_v_hat=zero, s_w_hat=zero),
        filters=Filters(T=0.0, f=zero, M1=zero, M2=zero),
        a_ref_f=Filtered(x=setpoint.a_c, x_dot=zero),
        T_c=T,
        T_trim=0.0,
    )
    return command(state, params, setpoint, measured)


@kernel
def step(state, params, setpoint, measured):
    """One tick in flight: (state, command, outputs, internals) from the last state."""
    return command(learnt(state, params, setpoint, measured), params, setpoint, measured)


@kernel
def piecewise_constant(a, h):
    """Phi^-1 mu over the prediction error (1/s), and Phi (s), for A_s = -a (1/s) and a period h (s)."""
    decay = math.exp(-a * h)
    Phi = (1.0 - decay) / a
    return decay / Phi, Phi


@kernel
def learnt(state, params, setpoint, measured):
    """The State with what the last tick taught: prediction, adaptation, low-pass filters."""
    h, m, J = params.h, params.m, params.J
    R_EB = matrix(measured.q_EB)
    last = state.predictor
    T, tau = achieved(params.rotors, mean_squares(params.rotors, state.Omega, measured.Omega))
    a_b = (0.5 * T / m) * (state.e3 + R_EB.e3) + Vec3(0.0, 0.0, -G)
    alpha_b = (tau - cross(state.w, J * state.w)) / J

    # predicted minus measured after the tick, and what explains it
    K_v, Phi_v = piecewise_constant(params.A_v, h)
    K_w, Phi_w = piecewise_constant(params.A_w, h)
    v_til = (math.exp(-params.A_v * h) * last.v_til + Phi_v * last.s_v_hat + h * a_b) - (
        measured.v_E - state.v
    )  # (8) (9) departure 1
    w_til = (math.exp(-params.A_w * h) * last.w_til + Phi_w * last.s_w_hat + h * alpha_b) - (
        measured.w_B - state.w
    )  # (8) (9) departure 1
    s_v_hat, s_w_hat = -K_v * v_til, -K_w * w_til  # (10)

    # the part of it that is compensated
    k_T, k_1 = 1.0 - math.exp(-params.w_T * h), 1.0 - math.exp(-params.w_M1 * h)
    k_2 = 1.0 - math.exp(-params.w_M2 * h)
    f = state.filters
    M1 = f.M1 + k_1 * (J * s_w_hat - f.M1)  # (11)
    filters = Filters(
        T=f.T + k_T * (m * dot(R_EB.e3, s_v_hat) - f.T),  # (11)
        f=f.f + k_T * (m * s_v_hat - f.f),
        M1=M1,
        M2=f.M2 + k_2 * (M1 - f.M2),  # (11)
    )

    gain, most = h * params.trim_rate, 0.3 * G * m
    return State(
        v=measured.v_E,
        w=measured.w_B,
        e3=R_EB.e3,
        Omega=measured.Omega,
        predictor=Predictor(v_til=v_til, w_til=w_til, s_v_hat=s_v_hat, s_w_hat=s_w_hat),
        filters=filters,
        a_ref_f=low_pass(state.a_ref_f, setpoint.a_c, params.cutoff_j, h),  # departure 4
        T_c=state.T_c,
        T_trim=trimmed(params.limits, state.T_trim, gain, most, state.T_c, T),  # departure 2
    )


class Turning(NamedTuple):
    """A unit vector, and its first and second derivative."""

    u: Vec3
    rate: Vec3  # 1/s
    acceleration: Vec3  # 1/s^2


@kernel
def unit(q, q_dot, q_ddot):
    """The Turning of a vector q that moves."""
    n = maximum(norm(q), 1e-9)
    u = q / n
    n_dot = dot(u, q_dot)
    u_dot = (q_dot - n_dot * u) / n
    n_ddot = dot(u_dot, q_dot) + dot(u, q_ddot)
    return Turning(u, u_dot, (q_ddot - 2.0 * n_dot * u_dot - n_ddot * u) / n)


@kernel
def turning_cross(a, b):
    """The vector product of two Turnings, which stays one of unit length if they are normal."""
    return Turning(
        cross(a.u, b.u),
        cross(a.rate, b.u) + cross(a.u, b.rate),
        cross(a.acceleration, b.u) + 2.0 * cross(a.rate, b.rate) + cross(a.u, b.acceleration),
    )


class Commanded(NamedTuple):
    """The commanded attitude and how it turns."""

    R: Matrix
    w: Vec3  # rad/s, in its own axes
    w_dot: Vec3  # rad/s^2, in its own axes


@kernel
def commanded(b3, psi, psi_dot):
    """The Commanded attitude of a thrust axis b3 (Turning, E), at a yaw psi (rad) and psi_dot (rad/s)."""
    c, s = math.cos(psi), math.sin(psi)
    left = Turning(
        Vec3(-s, c, 0.0), -psi_dot * Vec3(c, s, 0.0), (psi_dot * psi_dot) * Vec3(s, -c, 0.0)
    )
    ahead = turning_cross(left, b3)
    b1 = unit(ahead.u, ahead.rate, ahead.acceleration)  # (3) departure 5
    b2 = turning_cross(b3, b1)  # (3)
    w = Vec3(dot(b3.u, b2.rate), dot(b1.u, b3.rate), dot(b2.u, b1.rate))
    w_dot = Vec3(
        dot(b3.u, b2.acceleration) - w.y * w.z,
        dot(b1.u, b3.acceleration) - w.x * w.z,
        dot(b2.u, b1.acceleration) - w.x * w.y,
    )
    return Commanded(R=Matrix(b1.u, b2.u, b3.u), w=w, w_dot=w_dot)


@kernel
def attitude_error(R_c, R):
    """Half of (R_c^T R - R^T R_c), as a vector."""
    return 0.5 * Vec3(
        dot(R_c.e3, R.e2) - dot(R_c.e2, R.e3),
        dot(R_c.e1, R.e3) - dot(R_c.e3, R.e1),
        dot(R_c.e2, R.e1) - dot(R_c.e1, R.e2),
    )  # (4)


@kernel
def command(state, params, setpoint, measured):
    """The rest of a tick: from position to the rotors, with the estimates as they stand."""
    filters, R_EB, by_angle = state.filters, matrix(measured.q_EB), setpoint.level > 0.5
    angles = euler(R_EB)

    force = demanded_force(state, params, setpoint, measured, R_EB)
    target = commanded_attitude(params, setpoint, R_EB, angles, force)
    base = baseline(params, setpoint, measured, R_EB, target)

    # with the adaptive part
    along = (1.0 - params.tilted) * filters.T
    T_0 = select(by_angle, setpoint.T_c, force.f_b - along)  # (7) (11)
    T_c, thrust_cut = within_thrust(params.limits, T_0)
    tau_c = base.M_b - filters.M2  # (7) (11)
    thrusts, gave_up = allocate(params.rotors, T_c + state.T_trim, tau_c)  # departure 7
    u = speed_command(params.rotors, thrusts, measured.Omega)

    outputs = without_reference(
        params.rotors, measured, T_c, angles, target.angles, base.w_c, thrusts, thrust_cut,
        target.cut, gave_up,
    )  # fmt: skip
    internals = recorded(params, state.predictor, R_EB, force, target, base, tau_c)
    return commanding(state, T_c), RotorCommand(u=u), outputs, internals


class Force(NamedTuple):
    """The demanded force, and its derivatives by model and estimate."""

    F_d: Vec3  # N, E
    F_dot: Vec3  # N/s, E
    F_ddot: Vec3  # N/s^2, E
    f_b: float  # its part along the thrust axis, N
    cut: float  # 1 if the tilt limit cut it


@kernel
def demanded_force(state, params, setpoint, measured, R_EB):
    """The Force that leads to the setpoint."""
    m, w, f, a_ref_dot = params.m, measured.w_B, state.filters.f, state.a_ref_f.x_dot
    v_c, slope = velocity_towards(
        setpoint.r_c - measured.r_E, params.k_p / params.k_v, params.a_brake
    )
    e_v = measured.v_E - setpoint.v_c
    F_0 = (
        m * (setpoint.a_c + params.k_v * (v_c - e_v) + Vec3(0.0, 0.0, G)) - params.tilted * f
    )  # (1) departure 3, 8
    F_d, cut = within_tilt(F_0, 0.25 * G * m, params.limits.phi_star)
    f_b = dot(F_d, R_EB.e3)  # (2)
    e_a = (f_b * R_EB.e3 + f) / m + Vec3(0.0, 0.0, -G) - setpoint.a_c  # departure 4
    F_dot = m * (a_ref_dot - params.k_v * (slope * e_v + e_a))
    e3_dot = w.y * R_EB.e1 - w.x * R_EB.e2
    f_dot = dot(F_dot, R_EB.e3) + dot(F_d, e3_dot)
    e_j = (f_dot / m) * R_EB.e3 + (f_b / m) * e3_dot - a_ref_dot
    F_ddot = -m * (params.k_v * (slope * e_a + e_j))
    return Force(F_d=F_d, F_dot=F_dot, F_ddot=F_ddot, f_b=f_b, cut=cut)


class Target(NamedTuple):
    """The commanded attitude, of the position or of the setpoint, and what is fed forward of its turn."""

    R: Matrix
    w: Vec3  # rad/s, in its own axes
    w_dot: Vec3  # rad/s^2, in its own axes
    angles: Vec3  # phi_c, theta_c, psi_c, rad
    cut: float  # 1 if the tilt limit cut it
    fed_cut: float  # 1 if it turns faster than is fed forward


@kernel
def commanded_attitude(params, setpoint, R_EB, angles, force):
    """The Target that points the thrust along a Force, or that a setpoint below the position level gives."""
    by_angle, by_rate = setpoint.level > 0.5, setpoint.level > 1.5
    tilt, past = asked_tilt(params.limits, setpoint)
    axis = select3(by_angle, axis_of(tilt.x, tilt.y, angles.z), force.F_d)
    axis = select3(by_rate, R_EB.e3, axis)
    fed = select(by_angle | (force.cut > 0.5), 0.0, 1.0)
    b3 = unit(axis, fed * force.F_dot, fed * force.F_ddot)
    c, e_psi = params.k_R.z / params.k_w.z, wrap(setpoint.psi_c - angles.z)
    e_psi = yaw_error(e_psi, c, params.yaw_acceleration, params.yaw_rate_max)  # departure 6
    psi_c = select(by_rate, angles.z, setpoint.psi_c)
    psi_now = select(by_rate, angles.z, angles.z + e_psi)
    target = commanded(b3, psi_now, select(by_rate, 0.0, setpoint.psi_dot_c))
    most = params.w_feed_max
    w = clip3(target.w, -most, most)  # departure 4
    fed_cut = (target.w.x != w.x) | (target.w.y != w.y) | (target.w.z != w.z)
    phi_c, theta_c = tilt_of(b3.u, psi_c)
    return Target(
        R=target.R,
        w=w,
        w_dot=select(fed_cut, 0.0, 1.0) * target.w_dot,
        angles=Vec3(phi_c, theta_c, psi_c),
        cut=select(by_rate, 0.0, select(by_angle, past, force.cut)),
        fed_cut=select(fed_cut, 1.0, 0.0),
    )


class Baseline(NamedTuple):
    """The torque of the geometric baseline, and the errors that it closes."""

    e_R: Vec3  # error of attitude, B
    e_w: Vec3  # error of body rate, rad/s, B
    w_c: Vec3  # body rate that closes the error of attitude, rad/s, B
    M_b: Vec3  # N m, B


@kernel
def baseline(params, setpoint, measured, R_EB, target):
    """The Baseline of a Target, or of a setpoint of body rates."""
    J, w, zero, by_rate = params.J, measured.w_B, Vec3(0.0, 0.0, 0.0), setpoint.level > 1.5
    e_R = select3(by_rate, zero, attitude_error(target.R, R_EB))
    w_d = select3(by_rate, setpoint.w_c, rotate_back(R_EB, rotate(target.R, target.w)))
    w_d_dot = rotate_back(R_EB, rotate(target.R, target.w_dot)) - cross(w, w_d)
    w_d_dot = select3(by_rate, zero, w_d_dot)
    e_w = w - w_d  # (5)
    M_b = J * (w_d_dot - params.k_R * e_R - params.k_w * e_w) + cross(w, J * w)  # (6)
    return Baseline(e_R=e_R, e_w=e_w, w_c=w_d - params.k_R / params.k_w * e_R, M_b=M_b)


# --- what is remembered and recorded of a tick


@kernel
def commanding(state, T_c):
    """The State with the commanded thrust T_c (N)."""
    return State(
        v=state.v,
        w=state.w,
        e3=state.e3,
        Omega=state.Omega,
        predictor=state.predictor,
        filters=state.filters,
        a_ref_f=state.a_ref_f,
        T_c=T_c,
        T_trim=state.T_trim,
    )


@kernel
def recorded(params, predictor, R_EB, force, target, base, tau_c):
    """The Internals of a tick."""
    m, s_v, s_w = params.m, predictor.s_v_hat, predictor.s_w_hat
    return Internals(
        F_d=force.F_d,
        e_R=base.e_R,
        e_w=base.e_w,
        M_b=base.M_b,
        tau_c=tau_c,
        sigma_T=m * dot(R_EB.e3, s_v),  # (10)
        sigma_M=params.J * s_w,  # (10)
        sigma_um=Vec3(m * dot(R_EB.e1, s_v), m * dot(R_EB.e2, s_v), 0.0),  # (10)
        fed_cut=target.fed_cut,
    )


def pace(params: Params) -> Pace:
    """What modes that lead the vehicle have to know of the law."""
    f_m = math.sqrt(min(params.k_p.x, params.k_p.z))
    return Pace(f_m=0.5 * f_m, yaw_rate_max=params.yaw_rate_max, T_hover=params.m * G)
