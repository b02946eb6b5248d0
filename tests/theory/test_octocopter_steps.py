"""A step of the compiled kernels is backward Euler of the general right-hand side, at any period."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.laws.mmrac import adaptation, prediction
from fcu.theory import octocopter
from tests.theory.instants import COUPLINGS, N, equal, past, size, vec3


@pytest.mark.parametrize("rate_hz", [20.0, 500.0])
def test_the_compiled_position_step_is_backward_euler_of_the_general_form(
    free, taken_over, some, rate_hz
):
    """After the kernels' step: change over h = right-hand side at what stands after the step."""
    params = free(rate_hz)
    start, h = taken_over(params), params.h
    after = np.empty((N, 7))
    for i in range(N):
        _, predictor, hats, _ = some.law_state(start, i)
        T_a = vec3(some.T_a[i])
        e = prediction.velocity_achieved(params, predictor, hats, vec3(some.v[i]), T_a)
        m_hat = adaptation.m_hat_achieved(params, hats.m_hat, e, T_a)
        after[i] = [*e, *adaptation.s_v_hat(params, hats.s_v_hat, e), m_hat]
    e, s, m = after[:, :3], after[:, 3:6], after[:, 6]
    x_hat_dot, rates_ = octocopter.position_achieved(params, some.v, m, s, some.T_a).rates(e)
    v_hat = some.v - some.v_til
    force = h * some.T_a / m[:, None]
    equal(some.v - e - v_hat, h * x_hat_dot, size(some.v, force, h * params.lambda_v * e, s))
    equal(s - some.s_v, h * rates_.s[..., 0], size(s, some.s_v))
    equal(1.0 / m - 1.0 / some.m, h * rates_.Lambda[:, 0, 0], size(1.0 / m))


@pytest.mark.parametrize("rate_hz", [20.0, 500.0])
def test_the_compiled_printed_position_step_is_backward_euler_of_the_general_form(
    free, taken_over, some, rate_hz
):
    """(36) holds a_ref = f_c + s_hat of the last tick; (38) moves along the new error and that f_c."""
    params = free(rate_hz, prediction="demanded")
    start, h = taken_over(params), params.h
    f_c = some.a_ref - some.s_v
    after = np.empty((N, 7))
    for i in range(N):
        _, predictor, hats, _ = some.law_state(start, i)
        f = vec3(f_c[i])
        e = prediction.velocity_demanded(params, predictor, hats, vec3(some.v[i]), f)
        m_hat = adaptation.m_hat_demanded(params, hats.m_hat, e, f)
        after[i] = [*e, *adaptation.s_v_hat(params, hats.s_v_hat, e), m_hat]
    e, s, m = after[:, :3], after[:, 3:6], after[:, 6]
    before = octocopter.position_demanded(params, some.v, some.m, some.s_v, f_c)
    x_hat_dot, rates_ = before.rates(e)
    v_hat = some.v - some.v_til
    equal(some.v - e - v_hat, h * x_hat_dot, size(some.v, h * f_c, h * params.lambda_v * e))
    equal(s - some.s_v, h * rates_.s[..., 0], size(s, some.s_v))
    equal(m - some.m, -h * rates_.Theta[:, 0, 0], size(m, some.m))


@pytest.mark.parametrize("achieved", [True, False], ids=["achieved", "printed"])
@pytest.mark.parametrize("rate_hz", [20.0, 500.0])
@pytest.mark.computes
def test_the_compiled_rate_steps_are_backward_euler_of_the_general_form(
    free, taken_over, some, rate_hz, achieved
):
    """As printed with departure 9: the predictor's gain is lambda + h (Phi Gamma Phi^T), not lambda."""
    params = free(rate_hz, prediction="achieved" if achieved else "demanded")
    start, h = taken_over(params), params.h
    e, s, J, c, reaction = (
        np.empty((N, 3)),
        np.empty((N, 3)),
        np.empty((N, 3)),
        np.empty((N, 5)),
        np.zeros((N, 3)),
    )
    f_wc = np.array(params.c_rate) * (some.w_c - some.w)
    f_wc = f_wc - (some.c * some.phi) @ octocopter.COUPLED.T - some.s_w  # (44)
    for i in range(N):
        _, predictor, hats, _ = some.law_state(start, i)
        w, Omega_m, tau = vec3(some.w[i]), float(some.Omega_m[i]), vec3(some.tau_a[i])
        f, J_hat, over = vec3(f_wc[i]), hats.J_hat, past(w, Omega_m, tau)
        if achieved:
            e_i = prediction.rates_achieved(params, predictor, hats, w, over)
            J[i] = adaptation.J_hat_achieved(params, J_hat, e_i, tau)
        else:
            e_i = prediction.rates_demanded(params, predictor, hats, w, over, f)
            J[i] = adaptation.J_hat_demanded(params, J_hat, e_i, f)
            J_floored = np.maximum(some.J[i], params.J_implicit)
            reaction[i] = prediction.coupling_gain(params, w, Omega_m)
            reaction[i] += params.gamma_J * f_wc[i] ** 2 / J_floored
        e[i], s[i] = e_i, adaptation.s_w_hat(params, hats.s_w_hat, e_i)
        moving = zip(COUPLINGS, some.phi[i], (0, 0, 1, 1, 2), strict=True)
        c[i] = [adaptation.c_hat(params, getattr(hats, n), float(g), e_i[a]) for n, g, a in moving]
    for axis in range(3):
        these = octocopter.COUPLED[axis] > 0.0
        phi, w, e_a, w_hat = (
            some.phi[:, these],
            some.w[:, axis],
            e[:, axis],
            (some.w - some.w_til)[:, axis],
        )
        if achieved:
            image = octocopter.rate_achieved(
                params, w, J[:, axis], s[:, axis], c[:, these], phi, some.tau_a[:, axis]
            )
        else:
            image = octocopter.rate_demanded(
                params, w, some.J[:, axis], some.s_w[:, axis], some.c[:, these], phi, f_wc[:, axis]
            )
        x_hat_dot, rates_ = image.rates(e_a[:, None])
        x_hat_dot = x_hat_dot[:, 0] + h * reaction[:, axis] * e_a
        terms = size(
            w, e_a, h * some.tau_a[:, axis] / J[:, axis], h * f_wc[:, axis], h * c[:, these] * phi
        )
        equal(w - e_a - w_hat, h * x_hat_dot, terms)
        equal(s[:, axis] - some.s_w[:, axis], h * rates_.s[:, 0, 0], size(s))
        equal(c[:, these] - some.c[:, these], h * rates_.C[:, 0], size(c))
        if achieved:
            equal(
                1.0 / J[:, axis] - 1.0 / some.J[:, axis],
                h * rates_.Lambda[:, 0, 0],
                size(1.0 / J[:, axis], 1.0 / some.J[:, axis]),
            )
        else:
            equal(J[:, axis] - some.J[:, axis], -h * rates_.Theta[:, 0, 0], size(J))
