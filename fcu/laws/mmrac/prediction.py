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

from fcu.kernel.algebra import Vec3, dot, maximum
from fcu.kernel.compile import kernel


@kernel
def rank_one(c, b, u, e_minus):
    """(c I + b u u^T)^-1 e_minus: three axes that share one scalar unknown along u."""
    return (e_minus - (b * dot(u, e_minus) / (c + b * dot(u, u))) * u) / c


@kernel
def velocity_achieved(params, state, v, T_a):
    """Velocity prediction error (m/s, E), predicted with the achieved force T_a (N, E).

    The term B Lambda_hat Delta_u of (9), written as the paper's (5): it holds no demanded
    quantity. Regressor of 1/m_hat is T_a. Paper (5), (9), (36).
    """
    h, gamma = params.h, params.gamma
    g_E = Vec3(0.0, 0.0, -params.g)
    e_minus = v - state.v_hat - h * (g_E + state.s_v_hat + T_a / state.m_hat)  # (5) departure 10
    c = 1.0 + h * params.lambda_v + h * h * gamma
    return rank_one(c, h * h * params.gamma_Lambda, T_a, e_minus)  # departure 6


@kernel
def velocity_demanded(params, state, v):
    """Velocity prediction error (m/s, E), predicted as printed: with the demanded force.

    f_c + s_v_hat of the last tick is the right-hand side of (36). It holds no estimate, so
    the closed form is that of a plain first-order lag. Paper (36).
    """
    h = params.h
    e_minus = v - state.v_hat - h * (state.f_c_prev + state.s_v_hat)  # (36)
    return e_minus / (1.0 + h * params.lambda_v)  # departure 6


@kernel
def couplings(state, w, Omega_m):
    """Coupling and gyroscopic accelerations (rad/s^2, B) by the estimates. Paper (43), (44)."""
    p, q, r = w.x, w.y, w.z
    return Vec3(
        state.c_p1_hat * q * r + state.c_p2_hat * q * Omega_m,
        state.c_q1_hat * p * r + state.c_q2_hat * p * Omega_m,
        state.c_r1_hat * p * q,
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
def rates_achieved(params, state, w, w_mean, Omega_m, tau_a):
    """Rate prediction error (rad/s, B), predicted with the achieved torque tau_a (N m, B).

    `w_mean` and `Omega_m` (rad/s) are means over the tick. Paper (5), (9), (41), (43).
    """
    h = params.h
    tau_over_J = tau_a / state.J_hat
    known = couplings(state, w_mean, Omega_m)
    e_minus = w - state.w_hat - h * (known + state.s_w_hat + tau_over_J)  # (5) departure 10
    gain = coupling_gain(params, w_mean, Omega_m) + params.gamma_LambdaJ * (tau_a * tau_a)
    return e_minus / over_one(h * params.lambda_w, h * h * gain)  # departure 6


@kernel
def rates_demanded(params, state, w, w_mean, Omega_m):
    """Rate prediction error (rad/s, B), predicted as printed: with the demanded torque.

    The divisor holds the plant's reaction to the estimates of this tick, gamma f^2 / J for
    inertia. J_hat starts at zero: J_implicit stands in for it while it is small. Paper (41), (45).
    """
    h, J = params.h, state.J_hat
    f = state.f_wc_prev
    known = couplings(state, w_mean, Omega_m)
    e_minus = w - state.w_hat - h * (known + state.s_w_hat + f)  # (41)
    floor = params.J_implicit
    J_floored = Vec3(maximum(J.x, floor), maximum(J.y, floor), maximum(J.z, floor))
    gain = coupling_gain(params, w_mean, Omega_m) + params.gamma_J * (f * f) / J_floored
    return e_minus / over_one(h * params.lambda_w, h * h * gain)  # departure 9


@kernel
def over_one(a, b):
    """1 + a + b for a float a and a Vec3 b: the divisor of a backward-Euler step."""
    return Vec3(1.0 + a + b.x, 1.0 + a + b.y, 1.0 + a + b.z)
