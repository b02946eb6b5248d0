"""Largest steps from rest at hover, by the exact set and by the two weaker conditions."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

from fcu.guard import margin
from fcu.guard.hover import (
    Air,
    K,
    ball,
    ball_budget,
    largest_step,
    position_error,
    theorem_budget,
    unit_step,
)
from fcu.interface.airframe import airframe
from fcu.kernel.algebra import Vec3
from fcu.process.settings import settings
from fcu.theory.linear_loop import bounds
from fcu.theory.loop_bounds import position_loop, stiffness
from tests.theory.conftest import OCTO
from tests.theory.exact_set import exact_set_distance

MASS = 8.0
# Section VIII: sinusoids of 7.2, 7.2, 5.7 m/s at 1.5, 1.6, 1.7 rad/s
AIR = Air(math.hypot(7.2, 7.2, 5.7), math.hypot(7.2 * 1.5, 7.2 * 1.6, 5.7 * 1.7), 0.15)
STILL = Air(0.0, 0.0, 0.0)
LASTING = 3.5  # N, beta_2 gamma^(-1/2)
UP, DOWN, ASIDE = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)
PAPER = tuple(np.array([4.0, 7.0, 18.0]) / math.hypot(4.0, 7.0, 18.0))


@cache
def unit_reference(f_m, zeta_m):
    """Position from the target, velocity and acceleration (400 x 3) of a step of 1 m from rest."""
    M = np.array([[0.0, 1.0], [-f_m * f_m, -2.0 * f_m * zeta_m]])
    one, states = expm(M * 0.02), [np.array([-1.0, 0.0])]
    for _ in range(399):
        states.append(one @ states[-1])
    states = np.array(states)
    return np.column_stack([states, states @ M[1]])


def exact_margin(params, direction, air, step, adaptation=0.0):
    """Smallest distance (N) to the actuators' limits along a step, less drag and adaptation."""
    reference = step * unit_reference(params.f_m, params.zeta_m)
    T = MASS * (reference[:, 2:] * np.array(direction) + np.array([0.0, 0.0, params.g]))
    inside = exact_set_distance(T, params.limits.T_min, params.limits.T_max, params.limits.phi_star)
    drag = np.array([air.force(v) for v in np.abs(reference[:, 1])])
    return float((inside - drag).min()) - adaptation


def exact_step(params, direction, air, adaptation=0.0):
    low, high = 0.0, 40.0
    while high - low > 0.01:
        middle = 0.5 * (low + high)
        fits = exact_margin(params, direction, air, middle, adaptation) >= 0.0
        low, high = (middle, high) if fits else (low, middle)
    return low


# direction, f_m, still air, wind, wind and beta_2
TABLE = [
    (UP, 1.0, 15.2, 12.6, 12.2), (DOWN, 1.0, 9.2, 6.2, 5.6), (ASIDE, 1.0, 9.8, 6.2, 5.6),
    (PAPER, 1.0, 15.7, 12.9, 11.74),
    (UP, 1.4, 7.8, 6.5, 6.2), (DOWN, 1.4, 4.7, 3.2, 2.9), (ASIDE, 1.4, 5.0, 3.2, 2.9),
    (PAPER, 1.4, 8.0, 6.7, 6.5),
]  # fmt: skip


@pytest.mark.parametrize(("direction", "f_m", "still", "wind", "lasting"), TABLE)
def test_largest_steps_of_the_exact_set(law, direction, f_m, still, wind, lasting):
    params = law(f_m=f_m)
    assert exact_step(params, direction, STILL) == pytest.approx(still, abs=0.06)
    assert exact_step(params, direction, AIR) == pytest.approx(wind, abs=0.06)
    assert exact_step(params, direction, AIR, LASTING) == pytest.approx(lasting, abs=0.06)


@pytest.mark.parametrize(
    ("f_m", "of_ball", "of_ball_lasting", "of_theorem", "of_theorem_lasting"),
    [(1.0, 4.4, 3.9, 2.1, 1.9), (1.4, 2.2, 2.0, 1.3, 1.2)],
)
def test_largest_steps_of_the_ball_and_of_the_theorem(
    law, f_m, of_ball, of_ball_lasting, of_theorem, of_theorem_lasting
):
    params = law(f_m=f_m)
    for condition, alone, lasting in (
        (ball_budget, of_ball, of_ball_lasting),
        (theorem_budget, of_theorem, of_theorem_lasting),
    ):
        for mu, expected in ((0.0, alone), (LASTING, lasting)):
            found = largest_step(lambda step, of=condition, mu=mu: of(params, MASS, AIR, step, mu))
            assert found == pytest.approx(expected, abs=0.06)


@pytest.mark.parametrize("f_m", [1.0, 1.4])
@pytest.mark.parametrize("direction", [UP, DOWN, ASIDE, PAPER])
def test_each_condition_is_weaker_than_the_one_before(law, f_m, direction):
    params = law(f_m=f_m)
    for air in (STILL, AIR):
        exact = exact_step(params, direction, air)
        by_ball = largest_step(lambda step, air=air: ball_budget(params, MASS, air, step))
        by_theorem = largest_step(lambda step, air=air: theorem_budget(params, MASS, air, step))
        assert exact + 0.01 > by_ball > by_theorem > 0.0


def test_the_kernels_distance_is_this_one(law):
    """Without the floor of the vertical force, which belongs to the law."""
    params, rng = law(T_dz_min=0.0), np.random.default_rng(5)
    believed = airframe(OCTO["rotors"], "s1000.toml")
    known = margin.known(settings(believed, OCTO, 500.0, {}).guard, params)
    inside = outside = 0
    for _ in range(3000):
        T = rng.uniform([-150.0, -150.0, -20.0], [150.0, 150.0, 220.0])
        found = margin.distance(known, Vec3(*T.tolist()))
        exact = exact_set_distance(
            T, params.limits.T_min, params.limits.T_max, params.limits.phi_star
        )
        if exact >= 0.0:
            inside += 1
            assert found == pytest.approx(exact, abs=1e-9)
        else:
            outside += 1
            assert exact - 1e-9 <= found < 1e-9
    assert inside > 300 and outside > 300


def test_the_ball_the_gain_and_the_step_have_these_values(law):
    assert ball(law(), MASS) == pytest.approx(8.0 * 9.81 * math.sin(math.pi / 4.0))  # tilt decides
    assert ball(law(thrust_max_n=100.0), MASS) == pytest.approx(100.0 - 78.48)
    assert ball(law(thrust_min_n=60.0), MASS) == pytest.approx(78.48 - 60.0)
    assert K(law(), MASS) == pytest.approx(15.09, abs=0.01)
    assert K(law(f_m=1.4), MASS) == pytest.approx(23.81, abs=0.01)
    assert AIR.force() == pytest.approx(20.4, abs=0.1)
    fast = unit_step(law(f_m=1.4))
    assert fast.acceleration == pytest.approx(1.96, rel=1e-3)
    assert fast.speed == pytest.approx(0.5936, rel=1e-3)


def test_the_budget_names_what_eats_it(law):
    params = law()
    budget = theorem_budget(params, MASS, AIR, 1.0, LASTING, e_0=0.5)
    assert budget.used == pytest.approx(sum(budget[1:]))
    assert budget.initial_error == pytest.approx(0.5 * K(params, MASS), rel=2e-3)
    assert budget.lasting_error == LASTING
    assert budget.largest == "disturbance"
    assert not theorem_budget(params, MASS, AIR, 5.0).holds
    assert theorem_budget(params, MASS, AIR, 5.0).largest == "reference"
    windy = Air(25.0, 0.0, 0.15)
    assert largest_step(lambda step: ball_budget(params, MASS, windy, step)) == 0.0


def test_the_setpoint_of_section_viii_fits_no_condition(law):
    params, step = law(), math.hypot(4.0, 7.0, 18.0)
    T_0 = MASS * (np.array([4.0, 7.0, 18.0]) + np.array([0.0, 0.0, params.g]))
    assert np.linalg.norm(T_0) == pytest.approx(231.6, abs=0.1)  # of 200 N
    assert exact_margin(params, PAPER, STILL, step) < 0.0
    by_theorem = theorem_budget(params, MASS, STILL, step)
    assert by_theorem.used + MASS * params.g == pytest.approx(376.0, abs=1.0)  # of 346 N as printed
    assert not by_theorem.holds
    for f_m, fits in ((0.72, True), (0.75, False)):
        assert (exact_margin(law(f_m=f_m), PAPER, AIR, step) >= 0.0) == fits


def test_what_is_left_of_learning_at_hover(law):
    paper = law(prediction="demanded")
    across, _, along = stiffness(paper, MASS, MASS * paper.g)
    assert paper.lambda_v / (2.0 * math.sqrt(across)) == pytest.approx(0.5)
    assert paper.lambda_v / (2.0 * math.sqrt(along)) == pytest.approx(0.139, abs=5e-4)
    found = bounds(position_loop(paper, MASS), AIR.force_rate() / MASS)
    assert 3.5 < found.control.lasting < 4.2
    assert found.control.beta_1 == 0.0
    assert position_error(paper, found.control.lasting / MASS) == pytest.approx(
        1.031 * found.control.lasting / MASS, rel=1e-3
    )
