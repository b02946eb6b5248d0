"""What the law is told once (LawParams), remembers (LawState), and computes on the way (Internals).

Frames: E is Earth East-North-Up, B is body Forward-Left-Up; SI units. Symbols are the
paper's; the table in this folder's README gives each its name, unit and equation.
"""

from __future__ import annotations

from typing import NamedTuple

from fcu.interface.messages import RotorCommand, Setpoint, VehicleState
from fcu.kernel.algebra import Rotors, Vec3


class Bounds(NamedTuple):
    """The sets that projection keeps the estimates in. Each must contain the truth."""

    m_min: float  # kg, lower bound of m_hat
    m_max: float  # kg
    J_min: float  # kg m^2, lower bound of every J_hat
    J_max: float  # kg m^2
    s_v_max: float  # m/s^2, each component of s_v_hat
    s_w_max: float  # rad/s^2, each component of s_w_hat
    c_max: float  # each of the five coupling and gyroscopic coefficients


class Guard(NamedTuple):
    """What is believed of the flight to come, and what is done when it does not fit the actuators."""

    policy: float  # 0 warn, 1 govern, 2 refuse
    m_min: float  # kg, the vehicle's mass is believed to lie
    m_max: float  # kg, between these
    c_D: float  # N/(m/s)^2, greatest drag coefficient of any body axis
    w_max: float  # m/s, greatest velocity of the air
    w_dot_max: float  # m/s^2, greatest rate of that velocity
    jerk: float  # m/s^3, fastest change of the reference's acceleration


class LawParams(NamedTuple):
    """Everything the law is told. Constant in flight; a changed value is a new LawParams."""

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
    lambda_v: float  # velocity predictor gain, 1/s (36)
    lambda_w: float  # rate predictor gain, 1/s (41)
    c_angle: Vec3  # c_phi, c_theta, c_psi, 1/s (40)
    c_rate: Vec3  # c_p, c_q, c_r, 1/s (44)
    T_min: float  # N
    T_max: float  # N
    phi_star: float  # rad, limit of roll and of pitch
    T_dz_min: float  # N, floor of the demanded vertical force
    trim_rate: float  # 1/s, trim of thrust on commanded minus achieved
    trim_max: float  # N, limit of that trim
    tilt_rate_bandwidth: float  # rad/s, filter of the tilt command's own rate
    tilt_rate_max: float  # rad/s, limit of that rate
    yaw_rate_max: float  # rad/s, limit of the rate of yaw that is commanded
    yaw_acceleration: float  # rad/s^2, believed: yaw slows down no faster towards its command
    f_min: float  # N, least thrust allocated to a rotor
    f_max: float  # N, greatest thrust allocated to a rotor
    kappa: float  # rotor speed command over wanted change of speed: h^-1 of (7)
    rotor_mean: float  # weight of the earlier sample in a tick's mean of rotor speed or its square
    bounds: Bounds
    guard: Guard
    m_hat_0: float  # kg, m_hat at take-over
    J_hat_0: float  # kg m^2, each J_hat at take-over
    J_implicit: float  # kg m^2, floor of J_hat in the backward-Euler step of the printed law
    r_m_offset: Vec3  # m, E, reference model minus measured position at take-over
    v_hat_offset: Vec3  # m/s, E, predictor minus measured velocity at take-over
    x: Rotors  # believed rotor positions, m
    y: Rotors
    spin: Rotors
    c_T: float  # believed thrust coefficient, N/(rad/s)^2
    k_Q: float  # believed drag torque over thrust, m
    Omega_max: float  # believed full speed, rad/s
    B_x: Rotors  # rotor thrusts for one N m about body x
    B_y: Rotors  # about body y
    B_z: Rotors  # about body z


class LawState(NamedTuple):
    """Everything the law remembers from tick to tick."""

    r_m: Vec3  # reference model position at the next tick, m, E
    v_m: Vec3  # reference model velocity at the next tick, m/s, E
    v_hat: Vec3  # predicted velocity, m/s, E
    s_v_hat: Vec3  # drag force estimate over mass, m/s^2, E
    m_hat: float  # mass estimate, kg
    w_hat: Vec3  # predicted body rate, rad/s, B
    s_w_hat: Vec3  # angular disturbance estimate, rad/s^2, B
    J_hat: Vec3  # inertia estimates, kg m^2
    c_p1_hat: float  # coupling q r into p
    c_p2_hat: float  # gyroscopic q omega_m into p
    c_q1_hat: float  # coupling p r into q
    c_q2_hat: float  # gyroscopic p omega_m into q
    c_r1_hat: float  # coupling p q into r
    f_c_prev: Vec3  # demanded specific force of the last tick, m/s^2, E (37)
    f_wc_prev: Vec3  # f_pc, f_qc, f_rc of the last tick, rad/s^2 (44)
    T_c_prev: float  # commanded thrust of the last tick, N
    e3_prev: Vec3  # thrust axis R e3 at the last tick, E
    w_prev: Vec3  # body rate at the last tick, rad/s, B
    Omega_prev: Rotors  # rotor speeds at the last tick, rad/s
    T_trim: float  # slow trim of thrust, N
    tilt_filter: Vec3  # low-passed phi_c, theta_c (x, y), rad; z unused
    a_m: Vec3  # acceleration of the reference model at the last tick, m/s^2, E
    beta: float  # control difference left of take-over, and of the reference's changes, N (30)
    psi_g: float  # yaw that is commanded, rad: the setpoint's, or governed
    psi_g_dot: float  # its rate, rad/s


class Internals(NamedTuple):
    """What one tick computed: recorded, shown, never fed back."""

    r_m: Vec3  # reference model position at this tick, m, E
    v_m: Vec3  # reference model velocity at this tick, m/s, E
    e_r: Vec3  # position minus reference model, m, E
    v_til: Vec3  # velocity prediction error, m/s, E
    w_til: Vec3  # rate prediction error, rad/s, B
    f_c: Vec3  # demanded specific force, m/s^2, E
    T_d: Vec3  # demanded force, N, E
    T_a: Vec3  # achieved force, N, E
    delta_u: Vec3  # achieved minus demanded force, N, E
    T_c: float  # commanded total thrust, N
    T_achieved: float  # achieved total thrust, N
    angles: Vec3  # phi, theta, psi, rad
    angles_c: Vec3  # phi_c, theta_c, psi_c, rad
    w_c: Vec3  # commanded body rate, rad/s, B
    tau_d: Vec3  # demanded torque, N m, B
    tau_a: Vec3  # achieved torque, N m, B
    thrusts: Rotors  # allocated rotor thrusts, N
    thrust_saturated: float  # 1 while the total thrust command is at a limit
    tilt_saturated: float  # 1 while the tilt limit cuts the roll or pitch command
    rotor_saturated: float  # 1 while the allocation gives up torque or thrust
    projected: float  # 1 while projection holds an estimate
    tilt_rate_saturated: float  # 1 while the tilt command moves faster than is fed forward
    yaw_rate_saturated: float  # 1 while a limit cuts the yaw rate command
    trim_saturated: float  # 1 while the trim of thrust is at its limit
    r_g: Vec3  # position setpoint that the reference model is given, m, E: r_c, or governed
    governed: float  # 1 while that is not r_c
    margin: float  # N, from the demanded force to the nearest limit; negative outside
    margin_tilt: float  # rad, from its tilt to the tilt limit; negative outside
    margin_condition: float  # N, by which the condition for what is still to come holds


class Tick(NamedTuple):
    """One control tick, as the flight controller records it."""

    t: float  # simulation time, s
    measured: VehicleState
    setpoint: Setpoint  # as used: extrapolated to this tick
    state: LawState  # after the tick
    internals: Internals
    command: RotorCommand
    engaged: float  # 0 idle, 1 take-over at this tick, 2 flying the law
