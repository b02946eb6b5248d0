"""The octocopter's loops simulated as the general form: saturation, arrival, prediction."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fcu.theory import octocopter
from fcu.theory.adaptive import Estimates
from fcu.theory.projection import Structure
from fcu.theory.simulate import ClosedLoop, LoopState, SimulationError, simulate, step_for
from fcu.theory.systems import Uncertainty, constant, swinging, symmetric, unlimited

M, J = 8.0, np.array([0.3245, 0.3245, 0.4616])
TARGET = np.array([4.0, 7.0, 18.0])
J_M = 2e-4
COUPLINGS = np.array([
    [(J[1] - J[2]) / J[0], -J_M / J[0], 0, 0, 0],
    [0, 0, (J[2] - J[0]) / J[1], J_M / J[1], 0],
    [0, 0, 0, 0, (J[0] - J[1]) / J[2]],
])  # fmt: skip


def at_rest(m_hat):
    x = np.zeros(6)
    return LoopState(x, x, x, Estimates(np.array([[1.0 / m_hat]]), s=np.zeros((3, 1))))


def position(params, s, actuator):
    truth = Uncertainty(constant(np.eye(3) / M), np.array(1.0 / M), Structure.SCALAR, s=s)
    return octocopter.position_loop(params, truth, lambda t: params.f_m**2 * TARGET, actuator)


STILL = constant(np.array([[1.0], [-0.5], [0.3]]))


@pytest.mark.slow
@pytest.mark.parametrize("f_m", [1.0, 1.4])
def test_the_papers_step_saturates_v_does_not_grow_and_the_vehicle_arrives(law, f_m):
    """r_c = (4, 7, 18) from rest with m_hat = 5: the demand is past 200 N, V falls all the same."""
    params = law(f_m=f_m)
    loop = position(params, STILL, octocopter.cone(params))
    run = simulate(loop, at_rest(5.0), 12.0, 2e-3, every=2)
    u, v = run.signals.u, run.signals.v
    assert np.linalg.norm(u - v, axis=1).max() > 5.0
    assert np.linalg.norm(u, axis=1).max() <= params.limits.T_max * (1.0 + 1e-12)
    tilt = np.arctan2(np.linalg.norm(u[:, :2], axis=1), u[:, 2])
    assert tilt.max() <= params.limits.phi_star + 1e-12
    assert np.diff(run.signals.V).max() < 1e-9 * run.signals.V[0]
    assert np.linalg.norm(run.states.x[-1, :3] - TARGET) < 0.02
    assert 1.0 / run.states.estimates.Lambda[-1, 0, 0] == pytest.approx(M, rel=0.2)


@pytest.mark.slow
def test_told_the_demanded_force_the_same_loop_raises_v(law):
    """Without Delta_u in its predictor: V grows while the thrust is short of the demand."""
    params = law(f_m=1.4)
    loop = position(params, STILL, octocopter.cone(params))
    told_the_demand = ClosedLoop(loop.plant, loop.predictor, loop.laws, achieved=False)
    V = simulate(told_the_demand, at_rest(8.0), 3.0, 1e-3).signals.V
    assert V.max() > 10.0 * V[0]


@pytest.mark.slow
def test_the_largest_prediction_error_falls_as_one_over_gamma(law):
    """Disturbance that swings, mass known: mm/s at gamma 100, 1000, 10 000; (20) has one over root."""
    s = swinging(np.zeros((3, 1)), np.array([[2.0], [1.5], [1.0]]), np.array([[1.5], [1.6], [1.7]]))
    largest = []
    for gamma in (100.0, 1000.0, 10000.0):
        params = law(gamma=gamma)
        loop = position(params, s, unlimited)
        run = simulate(loop, at_rest(M), 6.0, step_for(loop, delta_u=120.0), every=5)
        late = run.t > 3.0
        error = run.states.x[late, 3:] - run.states.x_hat[late, 3:]
        largest.append(np.linalg.norm(error, axis=1).max())
    slope = np.polyfit(np.log([100.0, 1000.0, 10000.0]), np.log(largest), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.15), largest


@pytest.mark.slow
def test_the_rate_loops_saturate_and_v_does_not_grow(law):
    """Three axes at once, torque short of the demand at first, couplings and disturbance unknown."""
    params = law(bounds={"c_max": 1.0})
    truth = Uncertainty(
        constant(np.diag(1.0 / J)), np.array(1.0 / J.max()), Structure.DIAGONAL,
        C=constant(COUPLINGS), s=constant(np.array([[0.5], [-0.4], [0.2]])),
    )  # fmt: skip
    asked = 20.0 * np.array([1.0, -0.8, 0.4])
    loop = octocopter.rate_loop(
        params,
        truth,
        lambda t: asked * math.cos(2.0 * t),
        symmetric(np.array([3.0, 3.0, 1.2])),
        20.0,
    )
    w = np.zeros(3)
    estimates = Estimates(np.full((3, 1), 10.0), C=np.zeros((3, 5)), s=np.zeros((3, 1)))
    run = simulate(loop, LoopState(w, w, w, estimates), 3.0, 1e-3, every=2)
    assert np.abs(run.signals.u - run.signals.v).max() > 0.1
    assert np.diff(run.signals.V).max() < 1e-9 * run.signals.V[0]
    assert np.abs(run.states.x - run.states.x_m)[-250:].max() < 0.05
    assert not run.states.estimates.C[:, octocopter.COUPLED == 0.0].any()


def test_a_loop_that_leaves_the_numbers_says_when(law):
    params = law()
    loop = position(params, STILL, unlimited)
    with pytest.raises(SimulationError, match=r"t = \d"):
        simulate(loop, at_rest(5.0), 60.0, 0.5)


@pytest.mark.slow
def test_a_batch_is_its_systems_one_by_one(law):
    """Leading axes change nothing: each of three runs is the one of its own gamma."""
    gammas = np.array([100.0, 400.0, 900.0])
    starts = at_rest(6.0)
    loops = [position(law(gamma=g)._replace(lambda_v=20.0), STILL, unlimited) for g in gammas]
    laws = loops[0].laws
    together = ClosedLoop(
        loops[0].plant, loops[0].predictor,
        type(laws)(
            Lambda=type(laws.Lambda)(5e-4 * gammas, laws.Lambda.kept_in, Structure.SCALAR),
            s=type(laws.s)(gammas, laws.s.kept_in), weight=Structure.SCALAR,
        ),
    )  # fmt: skip
    run = simulate(together, starts, 0.5, 1e-3)
    assert run.states.x.shape == (501, 3, 6)
    for i, loop in enumerate(loops):
        alone = simulate(loop, starts, 0.5, 1e-3)
        np.testing.assert_allclose(run.states.x_hat[:, i], alone.states.x_hat, rtol=0.0, atol=1e-11)
        np.testing.assert_allclose(run.signals.V[:, i], alone.signals.V, rtol=1e-8)


def test_integration_is_of_fourth_order_and_agrees_with_scipy(law):
    """A swinging disturbance, no limit: the error against DOP853 falls 16-fold as the step halves."""
    params = law(gamma=100.0)
    s = swinging(np.ones((3, 1)), np.array([[2.0], [1.5], [1.0]]), 3.0)
    loop, start = position(params, s, unlimited), at_rest(6.0)

    def rate(t, y):
        state = LoopState(y[:6], y[6:12], y[12:18], Estimates(y[18:19, None], s=y[19:, None]))
        dot = loop.rate(t, state)
        return np.concatenate([*dot[:3], dot.estimates.Lambda[0], dot.estimates.s[:, 0]])

    y_0 = np.concatenate([*start[:3], start.estimates.Lambda[0], start.estimates.s[:, 0]])
    exact = solve_ivp(rate, (0.0, 1.0), y_0, method="DOP853", rtol=1e-13, atol=1e-13).y[:6, -1]
    errors = [
        np.abs(simulate(loop, start, 1.0, h).states.x[-1] - exact).max() for h in (0.01, 0.005)
    ]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.15)
    assert errors[1] < 1e-6
