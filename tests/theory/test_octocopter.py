"""Each loop of the law is the general M-MRAC: equal right-hand sides at 1000 random states.

Against the equations of Section VII written out, and against the control of the kernels.
"""

from __future__ import annotations

import numpy as np
import pytest

from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Rotors
from fcu.kernel.rotations import from_euler
from fcu.laws.mmrac import attitude, position, rates
from fcu.theory import octocopter
from fcu.theory.adaptive import Estimates, control
from fcu.theory.octocopter import Image
from fcu.theory.projection import Structure
from fcu.theory.simulate import LoopState
from fcu.theory.systems import Uncertainty, constant, unlimited
from tests.theory.instants import AXES, EXACT, G_E, N, equal, size, vec3


def test_the_position_loop_by_the_achieved_force(free, some):
    """v_hat' = T_a/m_hat + s_hat + g + lambda v_til; s_hat' = gamma v_til; (1/m_hat)' = gamma_L v_til.T_a."""
    params = free()
    image = octocopter.position_achieved(params, some.v, some.m, some.s_v, some.T_a)
    x_hat_dot, rates_ = image.rates(some.v_til)
    force, along = some.T_a / some.m[:, None], params.lambda_v * some.v_til
    equal(x_hat_dot, force + some.s_v + G_E + along, size(force, along))
    equal(rates_.s[..., 0], params.gamma * some.v_til, size(params.gamma * some.v_til))
    products = params.gamma_Lambda * some.v_til * some.T_a
    equal(rates_.Lambda[:, 0, 0], products.sum(axis=1), size(products))


def test_the_position_loop_as_printed(free, some):
    """(36): v_hat' = a_ref + lambda v_til; (38): s_hat' = gamma v_til, m_hat' = -gamma_m v_til.f_c."""
    params = free(prediction="demanded")
    f_c = some.a_ref - some.s_v  # (37), gravity left to s_v
    image = octocopter.position_demanded(params, some.v, some.m, some.s_v, f_c)
    x_hat_dot, rates_ = image.rates(some.v_til)
    along = params.lambda_v * some.v_til
    equal(x_hat_dot, some.a_ref + along, size(f_c, some.s_v, along))
    equal(rates_.s[..., 0], params.gamma * some.v_til, size(params.gamma * some.v_til))
    products = params.gamma_m * some.v_til * f_c
    equal(-rates_.Theta[:, 0, 0], -products.sum(axis=1), size(products))
    assert not rates_.Lambda.any()


@pytest.mark.parametrize("axis", range(3), ids=AXES)
def test_a_rate_loop_by_the_achieved_torque(free, some, axis):
    """w_hat' = c_hat.phi + s_hat + tau/J_hat + lambda w_til, and (45) with (1/J_hat)' = gamma w_til tau."""
    params = free()
    c, phi = some.coupled(axis)
    J, s, tau, e = (a[:, axis] for a in (some.J, some.s_w, some.tau_a, some.w_til))
    image = octocopter.rate_achieved(params, some.w[:, axis], J, s, c, phi, tau)
    x_hat_dot, rates_ = image.rates(e[:, None])
    terms = [*(c * phi).T, s, tau / J, params.lambda_w * e]
    equal(x_hat_dot[:, 0], sum(terms), size(*terms))
    equal(rates_.s[:, 0, 0], params.gamma * e, size(params.gamma * e))
    equal(
        rates_.C[:, 0], params.gamma_c * phi * e[:, None], size(params.gamma_c * phi * e[:, None])
    )
    product = params.gamma_LambdaJ * e * tau
    equal(rates_.Lambda[:, 0, 0], product, size(product))


@pytest.mark.parametrize("axis", range(3), ids=AXES)
def test_a_rate_loop_as_printed(free, some, axis):
    """(41): w_hat' = c_w (w_c - w) + lambda w_til; (45): J_hat' = -gamma_J w_til f, c_hat' = gamma_c w_til phi."""
    params = free(prediction="demanded")
    c, phi = some.coupled(axis)
    J, s, e = (a[:, axis] for a in (some.J, some.s_w, some.w_til))
    asked = params.c_rate[axis] * (some.w_c[:, axis] - some.w[:, axis])
    f = asked - (c * phi).sum(axis=1) - s  # (44)
    image = octocopter.rate_demanded(params, some.w[:, axis], J, s, c, phi, f)
    x_hat_dot, rates_ = image.rates(e[:, None])
    equal(
        x_hat_dot[:, 0],
        asked + params.lambda_w * e,
        size(asked, f, c * phi, s, params.lambda_w * e),
    )
    equal(rates_.s[:, 0, 0], params.gamma * e, size(params.gamma * e))
    equal(
        rates_.C[:, 0], params.gamma_c * phi * e[:, None], size(params.gamma_c * phi * e[:, None])
    )
    product = params.gamma_J * e * f
    equal(-rates_.Theta[:, 0, 0], -product, size(product))
    assert not rates_.Lambda.any()


def test_the_control_of_the_general_form_is_the_demand_of_the_kernels(free, taken_over, some):
    """(26) is T_d of (37) and tau_d of (44); and both whole loops adapt as their images do."""
    params = free()
    start, r_c = taken_over(params), np.array([4.0, 7.0, 18.0])
    zero, q_EB = vec3(np.zeros(3)), from_euler(0.0, 0.0, 0.0)
    still, level = Setpoint(vec3(r_c), zero, zero, 0.0, 0.0), attitude.measured(q_EB)
    at_rest = VehicleState(zero, zero, q_EB, zero, Rotors(*[345.0] * 8))
    T_d, tau_d = np.empty((N, 3)), np.empty((N, 3))
    for i in range(N):
        hats = some.law_state(start, i).estimates
        w, w_c = vec3(some.w[i]), vec3(some.w_c[i])
        seen = at_rest._replace(r_E=vec3(some.r[i]), v_E=vec3(some.v[i]))
        T_d[i] = position.achieved(params, hats, still, seen, level).T_0
        tau_d[i] = hats.J_hat * rates.f_wc(params.c_rate, hats, w, w_c, float(some.Omega_m[i]))

    eye, one = np.eye(3), np.ones((3, 1))
    truth = Uncertainty(constant(eye / 8.0), np.array(0.1), Structure.SCALAR, s=constant(one))
    loop = octocopter.position_loop(params, truth, lambda t: params.f_m**2 * r_c, unlimited)
    stored = Estimates(1.0 / some.m[:, None, None], s=some.s_v[..., None])
    x = np.concatenate([some.r, some.v], axis=1)
    known = loop.known(x, loop.plant.r(0.0))
    equal(control(loop.laws.full(stored, 3), known), T_d, size(T_d))

    u = some.T_a
    image = octocopter.position_achieved(params, some.v, some.m, some.s_v, u)
    x_til = np.concatenate([np.zeros((N, 3)), some.v_til], axis=1)
    whole = Image(loop.predictor, loop.laws, stored, known, u)
    (x_hat_dot, rates_), (v_hat_dot, expected) = whole.rates(x_til), image.rates(some.v_til)
    equal(x_hat_dot[:, :3], some.v, size(some.v))
    equal(
        x_hat_dot[:, 3:], v_hat_dot, size(u / some.m[:, None], params.lambda_v * some.v_til, some.r)
    )
    equal(rates_.Lambda, expected.Lambda, size(params.gamma_Lambda * some.v_til * u))
    equal(rates_.s, expected.s, size(expected.s))

    C = constant(octocopter.COUPLED)
    truth = Uncertainty(
        constant(eye * 3.0), np.array(1.0), Structure.DIAGONAL, C=C, s=constant(one)
    )
    for i in range(0, N, 50):  # omega_m belongs to the loop, not to the batch
        loop = octocopter.rate_loop(
            params,
            truth,
            lambda t, i=i: np.array(params.c_rate) * some.w_c[i],
            unlimited,
            some.Omega_m[i],
        )
        stored = Estimates(
            1.0 / some.J[i, :, None], C=some.c[i] * octocopter.COUPLED, s=some.s_w[i, :, None]
        )
        known = loop.known(some.w[i], loop.plant.r(0.0))
        tau = control(loop.laws.full(stored, 3), known)
        np.testing.assert_allclose(tau, tau_d[i], rtol=EXACT, atol=EXACT * np.abs(tau_d[i]).max())
        whole = Image(loop.predictor, loop.laws, stored, known, some.tau_a[i])
        x_hat_dot, rates_ = whole.rates(some.w_til[i])
        for axis in range(3):
            these = octocopter.COUPLED[axis] > 0.0
            image = octocopter.rate_achieved(
                params, some.w[i, axis], some.J[i, axis], some.s_w[i, axis], some.c[i, these],
                some.phi[i, these], some.tau_a[i, axis],
            )  # fmt: skip
            one_dot, one = image.rates(some.w_til[i, axis : axis + 1])
            assert x_hat_dot[axis] == pytest.approx(one_dot[0], rel=1e-11)
            np.testing.assert_allclose(rates_.C[axis, these], one.C[0], rtol=1e-12)
            assert not rates_.C[axis, ~these].any()
            assert rates_.Lambda[axis, 0] == pytest.approx(one.Lambda[0, 0], rel=1e-12)


@pytest.mark.parametrize("achieved", [True, False], ids=["achieved", "printed"])
def test_as_printed_v_has_a_term_in_delta_u_and_by_the_achieved_force_it_has_not(
    free, some, achieved
):
    """Position loop, constant truth: V' = -2 lambda |v_til|^2, as printed + 2 v_til.Delta_u/m."""
    params = free(prediction="achieved" if achieved else "demanded")
    m, s, e = 8.0, np.array([0.7, -0.4, -9.5]), some.v_til
    f_c = some.a_ref - some.s_v
    if achieved:
        image = octocopter.position_achieved(params, some.v, some.m, some.s_v, some.T_a)
        v_dot = some.T_a / m + s + G_E
    else:
        image = octocopter.position_demanded(params, some.v, some.m, some.s_v, f_c)
        v_dot = some.T_a / m + s
    v_hat_dot, rates_ = image.rates(e)
    s_til = s - some.s_v
    if achieved:
        about_mass = (1.0 / m - 1.0 / some.m) * rates_.Lambda[:, 0, 0] / params.gamma_Lambda
    else:
        about_mass = (some.m - m) / m * rates_.Theta[:, 0, 0] / params.gamma_m
    terms = [
        2.0 * (e * (v_dot - v_hat_dot)).sum(axis=1),
        -2.0 * (s_til * rates_.s[..., 0]).sum(axis=1) / params.gamma,
        -2.0 * about_mass,
    ]
    expected = -2.0 * params.lambda_v * (e * e).sum(axis=1)
    if not achieved:
        expected = expected + 2.0 * (e * (some.T_a - some.m[:, None] * f_c)).sum(axis=1) / m
    equal(sum(terms), expected, size(*terms, some.T_a))


def test_the_control_is_off_by_the_mass_times_what_is_not_yet_known(law, some):
    """v_0 - v = -m (s_til + Lambda_til T_d): in newtons, whatever the reference asks."""
    params, m, s = law(), 8.0, np.array([0.7, -0.4, 0.3])
    truth = Uncertainty(
        constant(np.eye(3) / m), np.array(1.0 / m), Structure.SCALAR, s=constant(s[:, None])
    )
    loop = octocopter.position_loop(params, truth, lambda t: np.array([4.0, 7.0, 18.0]), unlimited)
    x = np.concatenate([some.r, some.v], axis=1)
    stored = Estimates(1.0 / some.m[:, None, None], s=some.s_v[..., None])
    shown = loop.signals(0.0, LoopState(x, x, x, stored))
    Lambda_til = (1.0 / m - 1.0 / some.m)[:, None]
    expected = -m * (s - some.s_v + Lambda_til * shown.v)
    equal(shown.v_0 - shown.v, expected, size(shown.v_0, shown.v))
