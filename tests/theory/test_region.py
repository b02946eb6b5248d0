"""Conditions (22) to (31) and Theorem V.1 by hand, repaired and as printed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.theory.control_difference import ControlDifference
from fcu.theory.guarantee import Assumptions, Model, guarantee
from fcu.theory.linear_loop import NoBoundError
from fcu.theory.region import (
    Reference,
    Sizes,
    adaptive_budget,
    known_budget,
    known_control,
    limit,
    theorem,
)

SIZES = Sizes(
    K=2.0, Lambda_star=4.0, Lambda_least=0.5, d_star=0.3, K_0=0.5, lambda_g=3.0, s_star=0.1
)
AT = Reference(x_m=1.5, r=2.0, g=0.7)
DIFFERENCE = ControlDifference(beta_1=0.25, nu_1=1.0, lasting=0.02)


def test_the_limit_of_all_channels():
    channels = np.array([3.0, 1.0, 2.0])
    assert limit(channels) == 1.0
    assert limit(channels, "printed") == pytest.approx(3.0 * math.sqrt(3.0))


def test_the_demand_itself():
    K, Lambda = np.array([[2.0, 0.0]]), np.array([[0.5]])
    x, nothing, r, d = np.array([1.0, 5.0]), np.array([0.2]), np.array([3.0]), np.array([0.1])
    assert known_control(K, x, nothing, Lambda, r, d) == pytest.approx(abs(-2.0 - 0.2 + 6.0 - 0.1))
    printed = known_control(K, x, nothing, Lambda, r, d, "printed")
    assert printed == pytest.approx(2.0 + 0.2 + 6.0 + 0.1)


def test_the_known_budget():
    found = known_budget(SIZES, AT, 10.0, gamma_A=1.2, e_0=0.5)
    per_state = 2.0 + 3.0 * 0.5
    assert found == (10.0, 3.0, 0.35, 4.0, 0.3 + 0.2, pytest.approx(1.2 * per_state * 0.5), 0, 0, 0)
    printed = known_budget(SIZES, AT, 10.0, 1.2, 0.5, "printed")
    assert printed.reference == pytest.approx(per_state * 1.5)
    assert printed.command == pytest.approx(0.5)  # by the upper bound of Lambda
    assert found.margin == pytest.approx(10.0 - sum(found[1:]))
    assert found.largest == "command"


def test_the_adaptive_budget_holds_what_adaptation_adds():
    known = known_budget(SIZES, AT, 10.0, 1.2, 0.5)
    found = adaptive_budget(SIZES, AT, 10.0, 1.2, 0.5, DIFFERENCE, tracking=0.1, gamma=100.0)
    assert found.tracking_error == pytest.approx(0.35)
    assert found.used - known.used == pytest.approx(0.35 + 0.25 + 0.02)
    printed = adaptive_budget(SIZES, AT, 10.0, 1.2, 0.5, DIFFERENCE, 0.1, 100.0, "printed")
    assert printed.tracking_error == 0.0
    assert printed.lasting_error == pytest.approx(0.2)  # beta_2 without gamma^(-1/2)


def test_the_theorem_is_the_adaptive_budget_solved_for_the_initial_error():
    of = (SIZES, AT, 10.0, 1.2)
    found = theorem(*of, 0.1, DIFFERENCE, 0.1, 100.0)
    edge = adaptive_budget(*of, found.e_0_most, DIFFERENCE, 0.1, 100.0)
    assert edge.margin == pytest.approx(0.0, abs=1e-9)
    assert found.rho_1 == pytest.approx(3.0 + 0.35 + 4.0)
    assert found.rho_2 == pytest.approx(1.2 * found.e_0_most)
    assert found.holds
    assert not theorem(*of, 1.01 * found.e_0_most, DIFFERENCE, 0.1, 100.0).holds
    assert not theorem(SIZES, AT, 7.0, 1.2, 0.0, DIFFERENCE, 0.1, 100.0).holds


def test_the_printed_ball_grows_with_what_it_should_shrink_with():
    def ball(x_m, form):
        at = Reference(x_m, 2.0)
        return theorem(SIZES, at, 20.0, 1.0, 0.0, DIFFERENCE, 0.1, 100.0, form).e_0_most

    assert ball(2.0, "printed") > ball(1.0, "printed")
    assert ball(2.0, "repaired") < ball(1.0, "repaired")


MODEL = Model(-2.0 * np.eye(1), np.eye(1), np.eye(1), 31.6, 0.5 * np.eye(1), 1000.0, 1000.0)


def assumptions(x_m=0.2, **changed):
    sizes = Sizes(K=1.0, Lambda_star=0.5, Lambda_least=0.5, d_star=0.3)
    base = Assumptions(sizes, 0.5, 0.2, Reference(x_m, 0.1), 0.4, 0.2, z_0=0.3)
    return base._replace(**changed)


def test_a_guarantee_is_consistent_with_itself():
    found = guarantee(MODEL, assumptions(), v_star=2.0)
    assert found.budget.holds
    control = found.budget.learning + found.budget.lasting_error
    assert control == pytest.approx(found.bounds.control_peak[0])
    assert found.budget.tracking_error == pytest.approx(found.bounds.tracking[0])
    nearer = guarantee(MODEL, assumptions(e_0=0.1), v_star=2.0).budget
    assert nearer.initial_error == pytest.approx(0.1, rel=1e-3)
    assert nearer.used > found.budget.used + 0.1
    faster = MODEL._replace(k=100.0, gamma_Theta=1e4, gamma_d=1e4)
    assert guarantee(faster, assumptions(), 2.0).budget.margin > found.budget.margin


def test_a_regressor_that_its_own_bound_blows_up_is_refused():
    with pytest.raises(NoBoundError, match="too far"):
        guarantee(MODEL, assumptions(x_m=30.0, Theta_error=50.0), v_star=2.0)
