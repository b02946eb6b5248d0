"""The octocopter's loops in flight: bounds that hold, are tight, and shrink with gamma."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.theory import scenes
from fcu.theory.linear_loop import NoBoundError, bounds
from fcu.theory.loop_bounds import Flight, at_rest, position_bounds, position_loop, rate_bounds
from fcu.theory.sweep import (
    HIGH,
    LOW,
    STEP,
    believing,
    hover_assumed,
    hover_run,
    lyapunov_settled,
    prediction_against_gamma,
    with_gamma,
)
from fcu.theory.systems import constant

MASS, DRAG = 8.0, 0.15
AMPLITUDE, OMEGA = scenes.WIND
MOST = DRAG / MASS * AMPLITUDE**2
RATE = MOST * OMEGA
WIND = Flight(MOST, RATE, np.zeros(3), np.zeros(3), LOW, HIGH)


def norm(rows):
    return float(np.linalg.norm(rows, axis=-1).max())


@pytest.mark.slow
@pytest.mark.parametrize("gamma", [1000.0, 4000.0])
def test_hover_in_the_papers_wind_stays_under_its_bounds_and_near_them(law, gamma):
    params = believing(with_gamma(law(), gamma), MASS)
    found = position_bounds(params, MASS, WIND)
    run = hover_run(params, MASS, scenes.drag(AMPLITUDE, OMEGA, DRAG / MASS), 8.0)
    m_hat = 1.0 / run.states.estimates.Lambda
    assert m_hat.min() > LOW * MASS and m_hat.max() < HIGH * MASS  # no projection acts
    for bound, measured, loosest in (
        (found.prediction, norm((run.states.x - run.states.x_hat)[:, 3:]), 3.0),
        (found.control.peak, norm(run.signals.v_0 - run.signals.v), 4.0),
        (found.tracking, norm((run.states.x - run.states.x_m)[:, :3]), 8.0),
    ):
        assert measured < bound < loosest * measured


@pytest.mark.slow
def test_a_disturbance_at_the_loops_own_frequency_comes_closer(law):
    params = believing(with_gamma(law(), 1000.0), MASS)
    found = position_bounds(params, MASS, WIND)
    run = hover_run(params, MASS, scenes.triangle(RATE, 28.0 * np.ones(3)), 4.0)
    measured = norm((run.states.x - run.states.x_hat)[:, 3:])
    assert measured < found.prediction < 2.0 * measured


def test_a_hover_is_integrated_in_a_part_of_its_fastest_oscillation(law):
    """Of s_hat, and of a mass estimate whose regressor is the weight with a third to spare."""
    for gamma, gamma_Lambda in ((1000.0, 1e-9), (1.0, 1.0), (400.0, 0.1)):
        params = law()._replace(gamma=gamma, gamma_Lambda=gamma_Lambda, lambda_v=1.0)
        run = hover_run(params, MASS, constant(np.array([[0.1], [0.0], [0.0]])), 0.5)
        fastest = np.sqrt(gamma + gamma_Lambda * (1.3 * MASS * params.g) ** 2)
        assert 0.95 * STEP < run.t[1] * fastest <= STEP
        assert norm(run.states.x[:, :3]) < 0.1


def test_a_wrong_start_is_forgotten_under_the_bound(law):
    params = with_gamma(law(), 10_000.0)
    rest = at_rest(0.2 * MOST, 0.2 * RATE)
    calm = position_bounds(params, MASS, rest)
    assert calm.control.beta_1 == 0.0
    off = position_bounds(
        params, MASS, rest._replace(z_0=np.array([0.0, 0.0, 0.1]), rho_low=0.97, rho_high=1.0)
    )
    assert MASS * 0.1 < off.control.beta_1 < 4.0 * MASS * 0.1
    assert off.prediction > off.prediction_settled
    assert off.control.at(20.0) == pytest.approx(off.control.lasting, rel=1e-2)


def test_with_a_steady_force_it_is_the_linear_loop(law):
    params, s_rate = with_gamma(law(), 1000.0), 1e-4 * np.array([0.0, 0.0, 1.0])
    found = position_bounds(params, MASS, at_rest(0.0 * s_rate, s_rate))
    linear = bounds(position_loop(params, MASS), s_rate, norm="entries")
    assert found.prediction == pytest.approx(linear.prediction[2], rel=1e-2)
    assert found.control.lasting == pytest.approx(linear.control_settled[2], rel=1e-2)
    assert found.tracking >= linear.tracking[2]


def test_too_little_known_of_the_mass_or_too_much_wind_has_no_bound(law):
    params = with_gamma(law(), 1000.0)
    with pytest.raises(NoBoundError):
        position_bounds(params, MASS, WIND._replace(rho_low=0.5, rho_high=1.5))
    with pytest.raises(NoBoundError, match="force may vanish"):
        position_bounds(params, MASS, WIND._replace(s=np.array([0.0, 0.0, 10.0])))
    with pytest.raises(NoBoundError):
        rate_bounds(params, np.full(3, 0.3), WIND._replace(rho_low=0.2, rho_high=3.0))


@pytest.mark.slow
def test_prediction_error_falls_as_one_over_gamma_its_bounds_as_they_say(law):
    found = prediction_against_gamma([1000.0, 4000.0], law(), duration=5.0)
    assert found.measured[0] / found.measured[1] == pytest.approx(4.0, rel=0.1)
    assert 3.9 < found.inverse[0] / found.inverse[1] < 5.5  # the loop gain falls besides
    assert found.lyapunov[0] / found.lyapunov[1] == pytest.approx(2.0, rel=0.05)
    assert np.all(found.measured < found.inverse) and np.all(found.inverse < found.lyapunov)
    low = prediction_against_gamma([10.0], law(), duration=3.0)
    assert np.isnan(low.inverse[0]) and low.measured[0] < low.lyapunov[0]


def test_the_lyapunov_bound_by_hand(law):
    params = believing(law(), MASS)
    assumed = hover_assumed(params, MASS, MOST, RATE)
    b = params.bounds
    s_error = np.linalg.norm(MOST + b.s_v_max)
    Lambda_error = 1.0 / MASS - 1.0 / b.m_max
    level = (s_error**2 + np.linalg.norm(RATE) * s_error / params.lambda_v) / params.gamma
    level += Lambda_error**2 / params.gamma_Lambda
    assert lyapunov_settled(params, assumed) == pytest.approx(np.sqrt(level))


def test_bounds_of_motion_do_not_depend_on_the_unit_of_mass(law):
    """The same vehicle in grams: gamma_Lambda goes with 1/m^2, a force with m, all else stays."""
    tilted = WIND._replace(z_0=np.array([0.05, 0.0, 0.05]))
    params = with_gamma(law(), 10_000.0)
    kilos = position_bounds(believing(params, MASS), MASS, tilted)
    scale = 1000.0
    heavy = believing(params, scale * MASS)._replace(gamma_Lambda=params.gamma_Lambda / scale**2)
    grams = position_bounds(heavy, scale * MASS, tilted)
    assert grams.prediction == pytest.approx(kilos.prediction, rel=1e-9)
    assert grams.tracking == pytest.approx(kilos.tracking, rel=1e-9)
    assert grams.control.peak == pytest.approx(scale * kilos.control.peak, rel=1e-9)
