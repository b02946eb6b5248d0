"""The prediction models: how far the measured velocity and body rate are from the predicted.

Predictor and estimates advance together by backward Euler, in closed form, so the step is
stable for every gain and every period (departure 6). Each function here solves for the
prediction error *after* the tick; `adaptation` then moves the estimates along it, and the
new prediction is the measurement minus that error.

With gain lambda, period h, regressor Phi of the unknown parameters and their gains Gamma:

    e_minus = x - x_hat - h (known + Phi theta_hat)          prediction with the old estimates
    e       = (1 + h lambda + h^2 Phi Gamma Phi^T)^-1 e_minus
"""

from __future__ import annotations

from typing import NamedTuple

from fcu.kernel.algebra import Vec3, dot, maximum
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import matrix
from fcu.laws import allocation
from fcu.laws.mmrac.types import PredictionError


class Past(NamedTuple):
    """Means over the last tick, from its two ends."""

    T_mean: float  # achieved total thrust, N
    T_a: Vec3  # achieved force, N, E
    tau_a: Vec3  # achieved torque, N m, B
    w: Vec3  # body rate, rad/s, B
    Omega_m: float  # sum of rotor speeds signed by spin, rad/s (33)


@kernel
def past(rotors, memory, measured):
    """The Past of what was remembered at its beginning and is measured at its end."""
    Omega2 = allocation.mean_squares(rotors, memory.Omega, measured.Omega)
    T_mean, tau_a = allocation.achieved(rotors, Omega2)
    return Past(
        T_mean=T_mean,
        T_a=(0.5 * T_mean) * (memory.e3 + matrix(measured.q_EB).e3),
        tau_a=tau_a,
        w=0.5 * (memory.w + measured.w_B),
        Omega_m=allocation.mean_omega_m(rotors, memory.Omega, measured.Omega),
    )


@kernel
def achieved(params, state, measured, past):
    """The PredictionError after the tick, predicted with what was achieved in it."""
    predictor, estimates = state.predictor, state.estimates
    return PredictionError(
        v_til=velocity_achieved(params, predictor, estimates, measured.v_E, past.T_a),
        w_til=rates_achieved(params, predictor, estimates, measured.w_B, past),
    )


@kernel
def demanded(params, state, measured, past):
    """The same as printed, predicted with what was demanded."""
    predictor, estimates, memory = state.predictor, state.estimates, state.memory
    return PredictionError(
        v_til=velocity_demanded(params, predictor, estimates, measured.v_E, memory.f_c),
        w_til=rates_demanded(params, predictor, estimates, measured.w_B, past, memory.f_wc),
    )


@kernel
def rank_one(c, b, u, e_minus):
    """(c I + b u u^T)^-1 e_minus: three axes that share one scalar unknown along u."""
    return (e_minus - (b * dot(u, e_minus) / (c + b * dot(u, u))) * u) / c


@kernel
def velocity_achieved(params, predictor, estimates, v, T_a):
    """Velocity prediction error (m/s, E), predicted with the achieved force T_a (N, E).

    The term B Lambda_hat Delta_u of (9), written as the paper's (5): it holds no demanded
    quantity. Regressor of 1/m_hat is T_a. Paper (5), (9), (36).
    """
    h, gamma = params.h, params.gamma
    g_E = Vec3(0.0, 0.0, -params.g)
    dv = g_E + estimates.s_v_hat + T_a / estimates.m_hat  # (5) departure 10
    e_minus = v - predictor.v_hat - h * dv
    c = 1.0 + h * params.lambda_v + h * h * gamma
    return rank_one(c, h * h * params.gamma_Lambda, T_a, e_minus)  # departure 6


@kernel
def velocity_demanded(params, predictor, estimates, v, f_c):
    """Velocity prediction error (m/s, E), predicted as printed: with the demanded force.

    f_c + s_v_hat, f_c that of the last tick, is the right-hand side of (36). It holds no estimate, so
    the closed form is that of a plain first-order lag. Paper (36).
    """
    h = params.h
    e_minus = v - predictor.v_hat - h * (f_c + estimates.s_v_hat)  # (36)
    return e_minus / (1.0 + h * params.lambda_v)  # departure 6


@kernel
def couplings(estimates, w, Omega_m):
    """Coupling and gyroscopic accelerations (rad/s^2, B) by the estimates. Paper (43), (44)."""
    p, q, r = w.x, w.y, w.z
    return Vec3(
        estimates.c_p1_hat * q * r + estimates.c_p2_hat * q * Omega_m,
        estimates.c_q1_hat * p * r + estimates.c_q2_hat * p * Omega_m,
        estimates.c_r1_hat * p * q,
    )  # (43) departure 3


@kernel
def coupling_gain(params, w, Omega_m):
    """Phi Gamma Phi^T of the five coefficients and the disturbance, for each axis (1/s^2)."""
    p, q, r = w.x, w.y, w.z
    qq, pp = q * q, p * p
    mm = Omega_m * Omega_m
    gamma, gamma_c = params.gamma, params.gamma_c
    return Vec3(
        gamma + gamma_c * (qq * r * r + qq * mm),
        gamma + gamma_c * (pp * r * r + pp * mm),
        gamma + gamma_c * (pp * qq),
    )


@kernel
def rates_achieved(params, predictor, estimates, w, past):
    """Rate prediction error (rad/s, B), predicted with the achieved torque. Paper (5), (9), (41), (43)."""
    h, tau_a = params.h, past.tau_a
    known = couplings(estimates, past.w, past.Omega_m)
    dw = known + estimates.s_w_hat + tau_a / estimates.J_hat  # (5) departure 10
    e_minus = w - predictor.w_hat - h * dw
    gain = coupling_gain(params, past.w, past.Omega_m) + params.gamma_LambdaJ * (tau_a * tau_a)
    return e_minus / over_one(h * params.lambda_w, h * h * gain)  # departure 6


@kernel
def rates_demanded(params, predictor, estimates, w, past, f_wc):
    """Rate prediction error (rad/s, B), predicted as printed: with the demanded torque.

    The divisor holds the plant's reaction to the estimates of this tick, gamma f^2 / J for
    inertia. J_hat starts at zero: J_implicit stands in for it while it is small. Paper (41), (45).
    """
    h, J = params.h, estimates.J_hat
    known = couplings(estimates, past.w, past.Omega_m)
    e_minus = w - predictor.w_hat - h * (known + estimates.s_w_hat + f_wc)  # (41)
    floor = params.J_implicit
    J_floored = Vec3(maximum(J.x, floor), maximum(J.y, floor), maximum(J.z, floor))
    gain = coupling_gain(params, past.w, past.Omega_m) + params.gamma_J * (f_wc * f_wc) / J_floored
    return e_minus / over_one(h * params.lambda_w, h * h * gain)  # departure 9


@kernel
def over_one(a, b):
    """1 + a + b for a float a and a Vec3 b: the divisor of a backward-Euler step."""
    return Vec3(1.0 + a + b.x, 1.0 + a + b.y, 1.0 + a + b.z)
