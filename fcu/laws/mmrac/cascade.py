"""The whole law, once a tick: measure, predict and adapt, demand, allocate. Paper Section VII.

`step(state, params, setpoint, measured)` is pure. `tick` is the same on flat buffers, for
the edge of a process; `rollout` and the real-time loop call the same text.
"""

from __future__ import annotations

import math

from fcu.guard import governor, margin
from fcu.interface.messages import RotorCommand, Setpoint, VehicleState
from fcu.kernel.algebra import Rotors, Vec3, maximum, select, select3
from fcu.kernel.buffers import packer, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import euler, matrix
from fcu.laws import allocation
from fcu.laws.mmrac import adaptation, attitude, entry, position, prediction, rates, reference_model
from fcu.laws.mmrac.types import Internals, LawParams, LawState, Tick

IDLE, TAKE_OVER, FLYING = 0.0, 1.0, 2.0


@kernel
def take_over(params, measured):
    """The state in which the law takes over a vehicle it has just measured."""
    zero = Vec3(0.0, 0.0, 0.0)
    R_EB = matrix(measured.q_EB)
    angles = euler(R_EB)
    J_0 = params.J_hat_0
    T_a, _ = allocation.achieved(params, measured.Omega * measured.Omega)
    return LawState(
        measured.r_E + params.r_m_offset,
        measured.v_E,
        measured.v_E + params.v_hat_offset,
        zero,
        params.m_hat_0,
        measured.w_B,
        zero,
        Vec3(J_0, J_0, J_0),
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        zero,
        zero,
        T_a,
        R_EB.e3,
        measured.w_B,
        measured.Omega,
        0.0,
        Vec3(angles.x, angles.y, 0.0),
        zero,
        margin.beta_1(params, measured.v_E),
        angles.z,
        measured.w_B.z,
    )


@kernel
def adapt(state, params, measured):
    """Predictor and estimates advanced over the last tick, to the measurement that ends it."""
    v, w = measured.v_E, measured.w_B
    e3 = matrix(measured.q_EB).e3

    # means over the tick, from its two ends
    Omega2 = allocation.mean_squares(params, state.Omega_prev, measured.Omega)
    T_mean, tau_a = allocation.achieved(params, Omega2)
    T_a = (0.5 * T_mean) * (state.e3_prev + e3)
    w_mean = 0.5 * (state.w_prev + w)
    Omega_m = allocation.mean_omega_m(params, state.Omega_prev, measured.Omega)

    if params.achieved > 0.5:
        v_til = prediction.velocity_achieved(params, state, v, T_a)
        w_til = prediction.rates_achieved(params, state, w, w_mean, Omega_m, tau_a)
        m_hat = adaptation.m_hat_achieved(params, state, v_til, T_a)
        J_hat = adaptation.J_hat_achieved(params, state, w_til, tau_a)
    else:
        v_til = prediction.velocity_demanded(params, state, v)
        w_til = prediction.rates_demanded(params, state, w, w_mean, Omega_m)
        m_hat = adaptation.m_hat_demanded(params, state, v_til)
        J_hat = adaptation.J_hat_demanded(params, state, w_til)

    p, q, r = w_mean.x, w_mean.y, w_mean.z
    c_hat = adaptation.c_hat
    adapted = LawState(
        state.r_m,
        state.v_m,
        v - v_til,
        adaptation.s_v_hat(params, state, v_til),
        m_hat,
        w - w_til,
        adaptation.s_w_hat(params, state, w_til),
        J_hat,
        c_hat(params, state.c_p1_hat, q * r, w_til.x),
        c_hat(params, state.c_p2_hat, q * Omega_m, w_til.x),
        c_hat(params, state.c_q1_hat, p * r, w_til.y),
        c_hat(params, state.c_q2_hat, p * Omega_m, w_til.y),
        c_hat(params, state.c_r1_hat, p * q, w_til.z),
        state.f_c_prev,
        state.f_wc_prev,
        state.T_c_prev,
        state.e3_prev,
        state.w_prev,
        state.Omega_prev,
        position.trim(params, state, T_mean),
        state.tilt_filter,
        state.a_m,
        margin.faded(params, state.beta),
        state.psi_g,
        state.psi_g_dot,
    )
    return adapted, v_til, w_til


@kernel
def command(state, params, setpoint, measured, v_til, w_til):
    """Rotor command from the estimates as they stand, and the reference model's next point."""
    r, v, w, Omega = measured.r_E, measured.v_E, measured.w_B, measured.Omega
    R_EB = matrix(measured.q_EB)
    e3, angles = R_EB.e3, euler(R_EB)
    cos_theta = math.sqrt(R_EB.e1.x * R_EB.e1.x + R_EB.e1.y * R_EB.e1.y) + 1e-30
    cos_psi, sin_psi = R_EB.e1.x / cos_theta, R_EB.e1.y / cos_theta

    # what the reference model is given: the setpoint, or what the limits leave of it
    asked = setpoint
    known = margin.known(params)
    setpoint, a_m, governed = governor.governed(params, known, state, asked, r, v)

    # position: demanded force, thrust, tilt
    f_c = position.f_c(params, state, setpoint, r, v)
    T_0 = state.m_hat * f_c  # (37)
    T_d, narrowed = position.safe(params, T_0)
    T_c = position.thrust(params, T_d, e3)
    phi_c, theta_c, tilt_clipped = position.tilt(params, T_d, cos_psi, sin_psi)
    tilt_saturated, psi_c = maximum(tilt_clipped, narrowed), setpoint.psi_c

    # or, below the position level, what the setpoint gives
    below_position, below_attitude = setpoint.level > 0.5, setpoint.level > 1.5
    given = entry.given(params, setpoint, angles, e3, cos_psi, sin_psi)
    f_c = select3(below_position, given.T_d / state.m_hat, f_c)
    T_d = select3(below_position, given.T_d, T_d)
    T_0 = select3(below_position, given.T_d, T_0)
    T_c = select(below_position, given.T_c, T_c)
    angles_c = select3(below_position, given.angles_c, Vec3(phi_c, theta_c, psi_c))
    tilt_saturated = select(below_position, given.clipped, tilt_saturated)

    # attitude: body-rate commands
    tilt_rate, rate_clipped, tilt_filter = attitude.tilt_rate(params, state.tilt_filter, angles_c)
    rates_c = Vec3(tilt_rate.x, tilt_rate.y, setpoint.psi_dot_c)
    w_c, yaw_limited = attitude.w_c(params, R_EB, angles, angles_c, rates_c)
    w_c = select3(below_attitude, setpoint.w_c, w_c)

    # rates: demanded torque
    Omega_m = allocation.omega_m(params, Omega)
    f_wc = rates.f_wc(params, state, w, w_c, Omega_m)
    tau_d = state.J_hat * f_wc  # (44)

    # rotors
    thrusts, gave_up = allocation.allocate(params, T_c + state.T_trim, tau_d)
    u = allocation.speed_command(params, thrusts, Omega)

    # what is shown of it
    T_achieved, tau_a = allocation.achieved(params, Omega * Omega)
    T_a = T_achieved * e3
    limited = (T_c <= params.T_min) or (T_c >= params.T_max)
    r_m, v_m = select3(below_position, r, state.r_m), select3(below_position, v, state.v_m)
    g_E = Vec3(0.0, 0.0, -params.g * params.achieved)
    a_d = f_c + g_E + state.s_v_hat
    internals = Internals(
        r_m,
        v_m,
        r - r_m,
        v_til,
        w_til,
        f_c,
        T_d,
        T_a,
        T_a - T_d,  # (9)
        T_c,
        T_achieved,
        angles,
        angles_c,
        w_c,
        tau_d,
        tau_a,
        thrusts,
        select(limited, 1.0, 0.0),
        tilt_saturated,
        gave_up,
        adaptation.held(params, state),
        select(below_attitude, 0.0, rate_clipped),
        select(below_attitude, 0.0, yaw_limited),
        select(abs(state.T_trim) >= params.trim_max, 1.0, 0.0),
        setpoint.r_c,
        governed,
        margin.distance(known, T_0),
        margin.tilt_left(params.phi_star, T_0),
        margin.condition(known, a_d, v_m, state.beta),
    )

    next_r_m, next_v_m = reference_model.followed(params, setpoint, measured, r_m, v_m)
    after = LawState(
        next_r_m,
        next_v_m,
        state.v_hat,
        state.s_v_hat,
        state.m_hat,
        state.w_hat,
        state.s_w_hat,
        state.J_hat,
        state.c_p1_hat,
        state.c_p2_hat,
        state.c_q1_hat,
        state.c_q2_hat,
        state.c_r1_hat,
        f_c,
        f_wc,
        T_c,
        e3,
        w,
        Omega,
        state.T_trim,
        tilt_filter,
        select3(below_position, Vec3(0.0, 0.0, 0.0), a_m),
        state.beta + select(below_position, 0.0, margin.doubt(params, a_m - state.a_m)),
        select(below_position, angles.z, setpoint.psi_c + params.h * setpoint.psi_dot_c),
        select(below_position, w.z, setpoint.psi_dot_c),
    )
    return after, RotorCommand(u), internals


@kernel
def step(state, params, setpoint, measured):
    """One tick of the law in flight: (state, command, internals) from the last state.

    state : LawState, params : LawParams, setpoint : Setpoint, measured : VehicleState.
    """
    adapted, v_til, w_til = adapt(state, params, measured)
    return command(adapted, params, setpoint, measured, v_til, w_til)


@kernel
def first_step(params, setpoint, measured):
    """The tick at which the law takes over: no past to learn from yet."""
    zero = Vec3(0.0, 0.0, 0.0)
    return command(take_over(params, measured), params, setpoint, measured, zero, zero)


unpack_params = unpacker(LawParams)
_unpack_state = unpacker(LawState)
_unpack_setpoint = unpacker(Setpoint)
_unpack_measured = unpacker(VehicleState)
_pack_tick = packer(Tick)


@kernel
def _idle(measured):
    """The state of a law that is not flying: it follows the measurement, estimates untouched."""
    zero = Vec3(0.0, 0.0, 0.0)
    nothing = Rotors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    angles = euler(matrix(measured.q_EB))
    state = LawState(
        measured.r_E, measured.v_E, measured.v_E, zero, 0.0, measured.w_B, zero, zero,
        0.0, 0.0, 0.0, 0.0, 0.0, zero, zero, 0.0, zero, measured.w_B, measured.Omega, 0.0, zero,
        zero, 0.0, angles.z, measured.w_B.z,
    )  # fmt: skip
    internals = Internals(
        measured.r_E, measured.v_E, zero, zero, zero, zero, zero, zero, zero, 0.0, 0.0,
        angles, angles, zero, zero, zero, nothing, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
        measured.r_E, 0.0, math.nan, math.nan, math.nan,
    )  # fmt: skip
    return state, RotorCommand(nothing), internals


@kernel
def tick(t, engaged, state_buffer, params_buffer, setpoint_buffer, age, measured_buffer, row):
    """One control tick on flat float64 buffers; writes `row`, a Tick, and nothing else.

    t : simulation time, s.  engaged : IDLE, TAKE_OVER or FLYING.  age : s since the setpoint
    was received.  The state for the next tick is the `state` of the row.
    """
    measured = _unpack_measured(measured_buffer)
    setpoint = reference_model.carried(_unpack_setpoint(setpoint_buffer), age)
    if engaged == IDLE:
        state, rotors, internals = _idle(measured)
    else:
        params = unpack_params(params_buffer)
        if engaged == TAKE_OVER:
            state, rotors, internals = first_step(params, setpoint, measured)
        else:
            state, rotors, internals = step(_unpack_state(state_buffer), params, setpoint, measured)
    _pack_tick(row, Tick(t, measured, setpoint, state, internals, rotors, engaged))
