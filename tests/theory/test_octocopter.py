"""Each loop of the law is the general M-MRAC: equal right-hand sides at 1000 random states.

Against the equations of Section VII written out, and against the compiled kernels themselves: a
step of theirs must be backward Euler of the general right-hand side, at any period.
"""

from __future__ import annotations

import numpy as np
import pytest

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.law import adaptation, position, prediction, rates
from fcu.theory import octocopter
from fcu.theory.adaptive import Estimates, control
from fcu.theory.octocopter import Image
from fcu.theory.projection import Structure
from fcu.theory.simulate import LoopState
from fcu.theory.systems import Uncertainty, constant, unlimited

N = 1000
G_E = np.array([0.0, 0.0, -9.81])
AXES = ("roll", "pitch", "yaw")
COUPLINGS = ("c_p1_hat", "c_p2_hat", "c_q1_hat", "c_q2_hat", "c_r1_hat")
EXACT = 1e-12


def vec3(row):
    return Vec3(*np.asarray(row, dtype=float).tolist())


def equal(a, b, scale):
    """Equal to 1e-12 of the largest term that is summed, state by state."""
    a, b = np.asarray(a), np.asarray(b)
    scale = np.asarray(scale).reshape(-1, *[1] * (a.ndim - 1))
    assert a.shape == b.shape
    assert np.abs((a - b) / scale).max() < EXACT
    assert np.abs(a / scale).max() > 0.01  # and they are not both nothing


def size(*terms):
    """(N,) the largest component of any term, at least 1."""
    return np.max([np.abs(t).reshape(N, -1).max(axis=1) for t in terms] + [np.ones(N)], axis=0)


class States:
    """1000 random instants of both loops, as arrays and as LawStates."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.v, self.v_til = rng.normal(size=(N, 3)) * 5.0, rng.normal(size=(N, 3))
        self.w, self.w_til = rng.normal(size=(N, 3)) * 2.0, rng.normal(size=(N, 3))
        self.s_v, self.s_w = rng.normal(size=(N, 3)) * 3.0, rng.normal(size=(N, 3)) * 3.0
        self.m, self.J = rng.uniform(4.0, 12.0, N), rng.uniform(0.1, 1.0, (N, 3))
        self.c = rng.normal(size=(N, 5)) * (1.0, 1e-3, 1.0, 1e-3, 1.0)
        self.T_a = rng.normal(size=(N, 3)) * 30.0 + (0.0, 0.0, 78.0)
        self.tau_a, self.Omega_m = rng.normal(size=(N, 3)), rng.normal(size=N) * 50.0
        self.a_ref, self.w_c = rng.normal(size=(N, 3)) * 5.0, rng.normal(size=(N, 3))
        self.r = rng.normal(size=(N, 3)) * 5.0
        self.phi = octocopter.products(self.w, self.Omega_m)

    def coupled(self, axis):
        """c_hat and phi of one axis, (N, 2) or (N, 1)."""
        these = octocopter.COUPLED[axis] > 0.0
        return self.c[:, these], self.phi[:, these]

    def law_state(self, start, i, **more):
        return start._replace(
            v_hat=vec3(self.v[i] - self.v_til[i]), s_v_hat=vec3(self.s_v[i]), m_hat=float(self.m[i]),
            w_hat=vec3(self.w[i] - self.w_til[i]), s_w_hat=vec3(self.s_w[i]), J_hat=vec3(self.J[i]),
            **{name: float(c) for name, c in zip(COUPLINGS, self.c[i], strict=True)}, **more,
        )  # fmt: skip


@pytest.fixture(scope="module")
def some():
    return States(7)


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


@pytest.mark.parametrize("rate_hz", [20.0, 500.0])
def test_the_compiled_position_step_is_backward_euler_of_the_general_form(
    free, taken_over, some, rate_hz
):
    """After the kernels' step: change over h = right-hand side at what stands after the step."""
    params = free(rate_hz)
    start, h = taken_over(params), params.h
    after = np.empty((N, 7))
    for i in range(N):
        state, T_a = some.law_state(start, i), vec3(some.T_a[i])
        e = prediction.velocity_achieved(params, state, vec3(some.v[i]), T_a)
        m_hat = adaptation.m_hat_achieved(params, state, e, T_a)
        after[i] = [*e, *adaptation.s_v_hat(params, state, e), m_hat]
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
        state = some.law_state(start, i, f_c_prev=vec3(f_c[i]))
        e = prediction.velocity_demanded(params, state, vec3(some.v[i]))
        m_hat = adaptation.m_hat_demanded(params, state, e)
        after[i] = [*e, *adaptation.s_v_hat(params, state, e), m_hat]
    e, s, m = after[:, :3], after[:, 3:6], after[:, 6]
    before = octocopter.position_demanded(params, some.v, some.m, some.s_v, f_c)
    x_hat_dot, rates_ = before.rates(e)
    v_hat = some.v - some.v_til
    equal(some.v - e - v_hat, h * x_hat_dot, size(some.v, h * f_c, h * params.lambda_v * e))
    equal(s - some.s_v, h * rates_.s[..., 0], size(s, some.s_v))
    equal(m - some.m, -h * rates_.Theta[:, 0, 0], size(m, some.m))


@pytest.mark.parametrize("achieved", [True, False], ids=["achieved", "printed"])
@pytest.mark.parametrize("rate_hz", [20.0, 500.0])
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
        state = some.law_state(start, i, f_wc_prev=vec3(f_wc[i]))
        w, Omega_m, tau = vec3(some.w[i]), float(some.Omega_m[i]), vec3(some.tau_a[i])
        if achieved:
            e_i = prediction.rates_achieved(params, state, w, w, Omega_m, tau)
            J[i] = adaptation.J_hat_achieved(params, state, e_i, tau)
        else:
            e_i = prediction.rates_demanded(params, state, w, w, Omega_m)
            J[i] = adaptation.J_hat_demanded(params, state, e_i)
            J_floored = np.maximum(some.J[i], params.J_implicit)
            reaction[i] = prediction.coupling_gain(params, w, Omega_m)
            reaction[i] += params.gamma_J * f_wc[i] ** 2 / J_floored
        e[i], s[i] = e_i, adaptation.s_w_hat(params, state, e_i)
        moving = zip(COUPLINGS, some.phi[i], (0, 0, 1, 1, 2), strict=True)
        c[i] = [adaptation.c_hat(params, getattr(state, n), float(f), e_i[a]) for n, f, a in moving]
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


def test_the_control_of_the_general_form_is_the_demand_of_the_kernels(free, taken_over, some):
    """(26) is T_d of (37) and tau_d of (44); and both whole loops adapt as their images do."""
    params = free()
    start, r_c = taken_over(params), np.array([4.0, 7.0, 18.0])
    still = Setpoint(vec3(r_c), vec3(np.zeros(3)), vec3(np.zeros(3)), 0.0, 0.0)
    T_d, tau_d = np.empty((N, 3)), np.empty((N, 3))
    for i in range(N):
        state = some.law_state(start, i)
        v, w, w_c = vec3(some.v[i]), vec3(some.w[i]), vec3(some.w_c[i])
        T_d[i] = state.m_hat * position.f_c(params, state, still, vec3(some.r[i]), v)
        tau_d[i] = state.J_hat * rates.f_wc(params, state, w, w_c, float(some.Omega_m[i]))

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
