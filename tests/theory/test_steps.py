"""The compiled backward-Euler steps converge to the general right-hand side at first order.

A vehicle's motion, and what its rotors give, are known functions of time; predictor and estimates
follow them, once integrated as the general form says (DOP853, 1e-12), once by the kernels at
shorter and shorter periods. The slope of the error over the period is the order.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fcu.kernel.algebra import Vec3
from fcu.laws.mmrac import adaptation, prediction
from fcu.theory import octocopter
from tests.theory.instants import past

END = 0.5  # s
RATES_HZ = (500.0, 1000.0, 2000.0, 4000.0)
AXES = ("roll", "pitch", "yaw")
COUPLINGS = ("c_p1_hat", "c_p2_hat", "c_q1_hat", "c_q2_hat", "c_r1_hat")


def vec3(row):
    return Vec3(*np.asarray(row, dtype=float).tolist())


def v_E(t):
    return np.array([np.sin(2.0 * t), 0.5 * np.cos(3.0 * t), 0.3 * t * t])


def T_a(t):
    return np.array([6.0 * np.sin(4.0 * t), 5.0 * np.cos(2.0 * t), 78.0 + 9.0 * np.sin(5.0 * t)])


def a_ref(t):
    return np.array([np.cos(3.0 * t), np.sin(2.0 * t), 9.0 + np.cos(4.0 * t)])


def w_B(t):
    return np.array([np.sin(5.0 * t), np.cos(4.0 * t), 0.5 * np.sin(3.0 * t + 1.0)])


def tau_a(t):
    return np.array([np.cos(6.0 * t), np.sin(5.0 * t), 0.4 * np.cos(2.0 * t)])


def w_asked(t):  # c_w (w_c - w)
    return np.array([3.0 * np.cos(5.0 * t), 4.0 * np.sin(4.0 * t), 2.0 * np.cos(3.0 * t)])


def Omega_m(t):
    return 2.0 * np.cos(2.0 * t)


def order(error_at, rates_hz=RATES_HZ):
    """Slope of log error over log period."""
    errors = [error_at(rate_hz) for rate_hz in rates_hz]
    slope = np.polyfit(np.log([1.0 / rate for rate in rates_hz]), np.log(errors), 1)[0]
    return slope, errors


def integrated(rate, start):
    solved = solve_ivp(rate, (0.0, END), start, method="DOP853", rtol=1e-12, atol=1e-13)
    assert solved.success
    return solved.y[:, -1]


V_HAT_0, S_0, M_0 = np.array([0.1, 0.4, -0.2]), np.array([0.5, -0.3, 0.2]), 6.0


def position_of_the_general_form(params, achieved):
    def rate(t, y):
        v_hat, s, about_mass = y[:3], y[3:6], y[6]
        if achieved:
            image = octocopter.position_achieved(params, v_E(t), 1.0 / about_mass, s, T_a(t))
        else:
            image = octocopter.position_demanded(params, v_E(t), about_mass, s, a_ref(t) - s)
        v_hat_dot, rates = image.rates(v_E(t) - v_hat)
        moving = rates.Lambda[0, 0] if achieved else -rates.Theta[0, 0]
        return [*v_hat_dot, *rates.s[:, 0], moving]

    return integrated(rate, [*V_HAT_0, *S_0, 1.0 / M_0 if achieved else M_0])


def position_by_the_kernels(params, start, achieved):
    h = params.h
    predictor = start.predictor._replace(v_hat=vec3(V_HAT_0))
    hats = start.estimates._replace(s_v_hat=vec3(S_0), m_hat=M_0)
    for k in range(round(END / h)):
        t, v = (k + 1) * h, vec3(v_E((k + 1) * h))
        if achieved:
            T = vec3(T_a(t))
            e = prediction.velocity_achieved(params, predictor, hats, v, T)
            m_hat = adaptation.m_hat_achieved(params, hats.m_hat, e, T)
        else:
            f_c = vec3(a_ref(t - h)) - hats.s_v_hat
            e = prediction.velocity_demanded(params, predictor, hats, v, f_c)
            m_hat = adaptation.m_hat_demanded(params, hats.m_hat, e, f_c)
        predictor = predictor._replace(v_hat=v - e)
        hats = hats._replace(s_v_hat=adaptation.s_v_hat(params, hats.s_v_hat, e), m_hat=m_hat)
    about_mass = 1.0 / hats.m_hat if achieved else hats.m_hat
    return np.array([*predictor.v_hat, *hats.s_v_hat, about_mass])


@pytest.mark.slow
@pytest.mark.parametrize("form", ["achieved", "demanded"])
def test_position_step_is_backward_euler(free, taken_over, form):
    achieved = form == "achieved"
    exact = position_of_the_general_form(free(prediction=form), achieved)

    def error_at(rate_hz):
        params = free(rate_hz, prediction=form)
        reached = position_by_the_kernels(params, taken_over(params), achieved)
        return np.linalg.norm((reached - exact) / np.abs(exact))

    slope, errors = order(error_at)
    assert 0.9 < slope < 1.1, (slope, errors)


W_HAT_0, S_W_0, J_0 = (
    np.array([0.2, 0.8, 0.1]),
    np.array([0.3, -0.2, 0.4]),
    np.array([0.3, 0.4, 0.5]),
)
C_0 = np.array([0.2, -1e-3, -0.3, 2e-3, 0.1])


def rate_of_the_general_form(params, achieved, axis):
    these = octocopter.COUPLED[axis] > 0.0
    c = these.sum()

    def rate(t, y):
        w_hat, s, about_J, c_hat = y[0], y[1], y[2], y[3:]
        w, phi = w_B(t)[axis], octocopter.products(w_B(t), Omega_m(t))[these]
        if achieved:
            image = octocopter.rate_achieved(
                params, w, 1.0 / about_J, s, c_hat, phi, tau_a(t)[axis]
            )
        else:
            f = w_asked(t)[axis] - c_hat @ phi - s
            image = octocopter.rate_demanded(params, w, about_J, s, c_hat, phi, f)
        w_hat_dot, rates = image.rates(np.array([w - w_hat]))
        moving = rates.Lambda[0, 0] if achieved else -rates.Theta[0, 0]
        return [w_hat_dot[0], rates.s[0, 0], moving, *rates.C[0]]

    about_J = 1.0 / J_0[axis] if achieved else J_0[axis]
    reached = integrated(rate, [W_HAT_0[axis], S_W_0[axis], about_J, *C_0[these]])
    assert len(reached) == 3 + c
    return reached


def rates_by_the_kernels(params, start, achieved):
    """What the kernels reach, axis by axis, in the order of the general form."""
    h = params.h
    predictor = start.predictor._replace(w_hat=vec3(W_HAT_0))
    hats = start.estimates._replace(
        s_w_hat=vec3(S_W_0), J_hat=vec3(J_0),
        **dict(zip(COUPLINGS, C_0.tolist(), strict=True)),
    )  # fmt: skip
    for k in range(round(END / h)):
        t = (k + 1) * h
        w, Om = vec3(w_B(t)), float(Omega_m(t))
        if achieved:
            tau = vec3(tau_a(t))
            e = prediction.rates_achieved(params, predictor, hats, w, past(w, Om, tau))
            J_hat = adaptation.J_hat_achieved(params, hats.J_hat, e, tau)
        else:
            known = prediction.couplings(hats, w, Om)
            f_wc = vec3(w_asked(t)) - known - hats.s_w_hat
            e = prediction.rates_demanded(params, predictor, hats, w, past(w, Om), f_wc)
            J_hat = adaptation.J_hat_demanded(params, hats.J_hat, e, f_wc)
        phi = octocopter.products(w_B(t), Om).tolist()
        moved = {
            name: adaptation.c_hat(params, getattr(hats, name), f, e[axis])
            for name, f, axis in zip(COUPLINGS, phi, (0, 0, 1, 1, 2), strict=True)
        }
        s_w_hat = adaptation.s_w_hat(params, hats.s_w_hat, e)
        predictor = predictor._replace(w_hat=w - e)
        hats = hats._replace(s_w_hat=s_w_hat, J_hat=J_hat, **moved)
    c = np.array([getattr(hats, name) for name in COUPLINGS])
    J = 1.0 / np.array(hats.J_hat) if achieved else np.array(hats.J_hat)
    return [
        np.array([predictor.w_hat[a], hats.s_w_hat[a], J[a], *c[octocopter.COUPLED[a] > 0.0]])
        for a in range(3)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("form", ["achieved", "demanded"])
def test_rate_step_is_backward_euler(free, taken_over, form):
    """As printed, departure 9 adds h (Phi Gamma Phi^T) to lambda: it vanishes with h, so the step
    converges to (41) and (45) all the same.
    """
    achieved = form == "achieved"
    rates_hz = RATES_HZ if achieved else [8.0 * rate_hz for rate_hz in RATES_HZ]
    exact = [rate_of_the_general_form(free(prediction=form), achieved, a) for a in range(3)]
    reached = {}
    for rate_hz in rates_hz:
        params = free(rate_hz, prediction=form)
        reached[rate_hz] = rates_by_the_kernels(params, taken_over(params), achieved)
    for a, axis in enumerate(AXES):
        slope, errors = order(
            lambda hz, a=a: np.linalg.norm((reached[hz][a] - exact[a]) / np.abs(exact[a])),
            rates_hz,
        )
        assert 0.9 < slope < 1.1, (axis, slope, errors)
