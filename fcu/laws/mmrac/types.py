"""What the law is told once (Params), remembers (State), and computes on the way (Internals).

Frames: E is Earth East-North-Up, B is body Forward-Left-Up; SI units. Symbols are the
paper's; the table in this folder's README gives each its name, unit and equation.
"""

from __future__ import annotations

from typing import NamedTuple

from fcu.kernel.algebra import Rotors, Vec3
from fcu.laws.allocation import RotorParams
from fcu.laws.face import Limits, Reference


class Bounds(NamedTuple):
    """The sets that projection keeps the estimates in. Each must contain the truth."""

    m_min: float  # kg, lower bound of m_hat
    m_max: float  # kg
    J_min: float  # kg m^2, lower bound of every J_hat
    J_max: float  # kg m^2
    s_v_max: float  # m/s^2, each component of s_v_hat
    s_w_max: float  # rad/s^2, each component of s_w_hat
    c_max: float  # each of the five coupling and gyroscopic coefficients


class Initial(NamedTuple):
    """Where estimates, reference model and predictor begin at take-over."""

    m_hat_0: float  # m_hat, kg
    J_hat_0: float  # each J_hat, kg m^2
    r_m_offset: Vec3  # reference model minus measured position, m, E
    v_hat_offset: Vec3  # predictor minus measured velocity, m/s, E


class Params(NamedTuple):
    """Everything the law is told. Constant in flight; a changed value is a new Params."""

    h: float  # control period, s
    achieved: float  # 1: predict with the achieved force and torque; 0: with the demanded
    f_m: float  # reference model natural frequency, rad/s (34)
    zeta_m: float  # reference model damping ratio (34)
    g: float  # gravity, m/s^2
    gamma: float  # adaptation gain of the disturbances, 1/s^2 (38), (45)
    gamma_m: float  # of m_hat (demanded), kg s^2/m^2 (38)
    gamma_Lambda: float  # of Lambda_hat = 1/m_hat (achieved), s^2/(kg^2 m^2)
    gamma_J: float  # of J_hat (demanded), kg m^2 s^2 (45)
    gamma_LambdaJ: float  # of LambdaJ_hat = 1/J_hat (achieved), s^2/(kg^2 m^4)
    gamma_c: float  # of the coupling and gyroscopic coefficients, s^2 (45)
    sigma_v: float  # leakage of s_v_hat upwards (achieved), 1/s
    lambda_v: float  # velocity predictor gain, 1/s (36)
    lambda_w: float  # rate predictor gain, 1/s (41)
    c_angle: Vec3  # c_phi, c_theta, c_psi, 1/s (40)
    c_rate: Vec3  # c_p, c_q, c_r, 1/s (44)
    T_dz_min: float  # N, floor of the demanded vertical force
    trim_rate: float  # 1/s, trim of thrust on commanded minus achieved
    trim_max: float  # N, limit of that trim
    tilt_rate_bandwidth: float  # rad/s, filter of the tilt command's own rate
    tilt_rate_max: float  # rad/s, limit of that rate
    yaw_rate_max: float  # rad/s, limit of the rate of yaw that is commanded
    yaw_acceleration: float  # rad/s^2, believed: yaw slows down no faster towards its command
    J_implicit: float  # kg m^2, floor of J_hat in the backward-Euler step of the printed law
    limits: Limits
    rotors: RotorParams
    bounds: Bounds
    initial: Initial


class Predictor(NamedTuple):
    """The prediction models. Paper (36), (41)."""

    v_hat: Vec3  # predicted velocity, m/s, E
    w_hat: Vec3  # predicted body rate, rad/s, B


class Estimates(NamedTuple):
    """What adaptation finds. Paper (38), (45)."""

    s_v_hat: Vec3  # drag force over mass, m/s^2, E
    m_hat: float  # mass, kg
    s_w_hat: Vec3  # angular disturbance, rad/s^2, B
    J_hat: Vec3  # inertia, kg m^2
    c_p1_hat: float  # coupling q r into p
    c_p2_hat: float  # gyroscopic q omega_m into p
    c_q1_hat: float  # coupling p r into q
    c_q2_hat: float  # gyroscopic p omega_m into q
    c_r1_hat: float  # coupling p q into r


class Memory(NamedTuple):
    """What prediction and filters need of the last tick."""

    f_c: Vec3  # demanded specific force, m/s^2, E (37)
    f_wc: Vec3  # f_pc, f_qc, f_rc, rad/s^2 (44)
    T_c: float  # commanded thrust, N
    e3: Vec3  # thrust axis R e3, E
    w: Vec3  # body rate, rad/s, B
    Omega: Rotors  # rotor speeds, rad/s
    T_trim: float  # slow trim of thrust, N
    tilt_filter: Vec3  # low-passed phi_c, theta_c (x, y), rad; z unused


class State(NamedTuple):
    """Everything the law remembers from tick to tick."""

    reference: Reference  # at the next tick
    predictor: Predictor
    estimates: Estimates
    memory: Memory


class PredictionError(NamedTuple):
    """Measured minus predicted, after the tick."""

    v_til: Vec3  # velocity, m/s, E
    w_til: Vec3  # body rate, rad/s, B


class Demand(NamedTuple):
    """What the estimates say is needed."""

    f_c: Vec3  # specific force, m/s^2, E (37)
    T_0: Vec3  # force before anything limits it, N, E
    T_d: Vec3  # force, N, E
    tau_d: Vec3  # torque, N m, B (44)


class Achieved(NamedTuple):
    """What the measured rotor speeds achieve, by the believed coefficients."""

    T_a: Vec3  # force, N, E
    tau_a: Vec3  # torque, N m, B
    delta_u: Vec3  # achieved minus demanded force, N, E (9)


class Flags(NamedTuple):
    """What the law holds back by itself, 1 while it does."""

    projected: float  # projection holds an estimate
    tilt_rate: float  # the tilt command moves faster than is fed forward
    yaw_rate: float  # a limit cuts the yaw rate command
    trim: float  # the trim of thrust is at its limit


class Internals(NamedTuple):
    """What one tick computed: recorded, shown, never fed back."""

    prediction: PredictionError
    demand: Demand
    achieved: Achieved
    flags: Flags
