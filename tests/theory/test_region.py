"""Conditions (22) to (31) and Theorem V.1 by hand, repaired and as printed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.guard.responses import peak
from fcu.theory.control_difference import ControlDifference
from fcu.theory.guarantee import Assumptions, Model, attraction, guarantee, starting
from fcu.theory.linear_loop import NoBoundError
from fcu.theory.region import (
    Adaptation,
    Reference,
    Sizes,
    adaptive_budget,
    known_budget,
    known_control,
    largest,
    limit,
    theorem,
)
from fcu.theory.systems import ReferenceModel

SIZES = Sizes(
    K=2.0, Lambda_star=4.0, Lambda_least=0.5, d_star=0.3, K_0=0.5, lambda_g=3.0, s_star=0.1
)
AT = Reference(x_m=1.5, r=2.0, g=0.7)
DIFFERENCE = ControlDifference(beta_1=0.25, nu_1=1.0, lasting=0.02)


def test_the_limit_of_all_channels():
    channels = np.array([3.0, 1.0, 2.0])
    assert limit(channels) == 1.0
    assert limit(channels, "printed") == pytest.approx(3.0 * math.sqrt(3.0))


def test_demand_of_known_control():
    K, Lambda = np.array([[2.0, 0.0]]), np.array([[0.5]])
    x, nothing, r, d = np.array([1.0, 5.0]), np.array([0.2]), np.array([3.0]), np.array([0.1])
    assert known_control(K, x, nothing, Lambda, r, d) == pytest.approx(abs(-2.0 - 0.2 + 6.0 - 0.1))
    printed = known_control(K, x, nothing, Lambda, r, d, "printed")
    assert printed == pytest.approx(2.0 + 0.2 + 6.0 + 0.1)


def test_budget_of_known_control():
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

    def known(e_0):
        return Adaptation(DIFFERENCE, 0.1)

    found = theorem(*of, 0.1, known, 100.0)
    edge = adaptive_budget(*of, found.e_0_most, DIFFERENCE, 0.1, 100.0)
    assert edge.margin == pytest.approx(0.0, abs=1e-8)
    assert found.rho_1 == pytest.approx(3.0 + 0.35 + 4.0)
    assert found.rho_2 == pytest.approx(1.2 * found.e_0_most)
    assert found.holds
    assert not theorem(*of, 1.01 * found.e_0_most, known, 100.0).holds
    assert not theorem(SIZES, AT, 7.0, 1.2, 0.0, known, 100.0).holds


def test_the_theorem_counts_adaptation_at_the_start_that_it_admits():
    """With a tracking error of 0.1 + e_0 it admits about half as much; without a bound, nothing."""

    def growing(e_0):
        if e_0 > 0.05:
            raise NoBoundError
        return Adaptation(DIFFERENCE, 0.1 + e_0)

    of = (SIZES, AT, 10.0, 1.0, 0.0)
    frozen = theorem(*of, lambda e_0: growing(0.0), 100.0)
    found = theorem(*of, lambda e_0: Adaptation(DIFFERENCE, 0.1 + e_0), 100.0)
    assert found.e_0_most == pytest.approx(0.5 * frozen.e_0_most)
    assert theorem(*of, growing, 100.0).e_0_most == pytest.approx(0.05)


def test_the_search_for_the_largest_ends():
    assert largest(lambda value: False) == 0.0
    assert largest(lambda value: value == 0.0) == 0.0
    assert largest(lambda value: True) >= 1e6
    assert largest(lambda value: value <= 3.7e-9) == pytest.approx(3.7e-9, rel=1e-6)


def test_the_printed_ball_grows_with_what_it_should_shrink_with():
    def ball(x_m, form):
        at, known = Reference(x_m, 2.0), Adaptation(DIFFERENCE, 0.1)
        return theorem(SIZES, at, 20.0, 1.0, 0.0, lambda e_0: known, 100.0, form).e_0_most

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


def frozen(model, assumed, v_star):
    """The e_0 at which (31) would end with the constants of e_0 = 0."""
    budget = guarantee(model, assumed, v_star).budget
    return budget.margin / (float(peak(model.A)[0, 0]) * assumed.sizes.per_state)


def held_at(model, assumed, v_star, e_0):
    try:
        return guarantee(model, starting(assumed, e_0), v_star).budget.holds
    except NoBoundError:
        return False


@pytest.mark.computes
def test_the_ball_of_attraction_counts_the_regressor_that_grows_with_it():
    model, v_star = MODEL._replace(gamma_Theta=100.0), 3.9
    too_far = frozen(model, assumptions(), v_star)
    assert too_far == pytest.approx(2.834, abs=1e-3)
    assert guarantee(model, assumptions(e_0=too_far), v_star).budget.margin < -0.29
    found = attraction(model, assumptions(), v_star)
    assert 0.7 * too_far < found.e_0_most < 0.8 * too_far
    assert guarantee(model, starting(assumptions(), found.e_0_most), v_star).budget.holds
    assert found.rho_2 == pytest.approx(found.e_0_most, rel=1e-3)  # gamma_A is 1
    nearer = attraction(MODEL._replace(gamma_Theta=0.01), assumptions(Theta_error=1e-6), v_star)
    assert nearer.e_0_most == pytest.approx(too_far, rel=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_the_ball_of_attraction_of_any_design_holds_everywhere_and_ends_where_it_says(seed):
    rng = np.random.default_rng(seed)
    n, q = 2, int(rng.integers(1, 3))
    A = rng.normal(size=(n, n))
    A = A - (np.linalg.eigvals(A).real.max() + rng.uniform(0.5, 3.0)) * np.eye(n)
    B, Lambda = np.linalg.qr(rng.normal(size=(n, q)))[0], rng.uniform(0.5, 2.0) * np.eye(q)
    P = ReferenceModel(A, B, np.eye(n)).P
    gamma, share = 10.0 ** rng.uniform(2.0, 4.0), rng.uniform(0.001, 0.05)
    P = P / np.linalg.norm(P, 2)
    model = Model(A, B, P, np.sqrt(gamma), Lambda, share * gamma, gamma)
    assumed = assumptions(0.1)._replace(Theta_error=rng.uniform(0.01, 0.3))
    v_star = guarantee(model, assumed, 0.0).budget.used + rng.uniform(0.1, 4.0)
    most = attraction(model, assumed, v_star).e_0_most
    assert most > 0.0
    assert all(held_at(model, assumed, v_star, share * most) for share in (0.1, 0.5, 0.9, 1.0))
    assert not held_at(model, assumed, v_star, 1.01 * most)


def test_a_regressor_that_its_own_bound_blows_up_is_refused():
    with pytest.raises(NoBoundError, match="too far"):
        guarantee(MODEL, assumptions(x_m=30.0, Theta_error=50.0), v_star=2.0)


@pytest.mark.parametrize("end", [0.1234567, 1.0 / 3.0, 2.0, 3.3, 71.7, 1234.5678])
def test_the_largest_that_is_admitted_is_found_to_the_precision(end):
    for precision in (1e-9, 1e-6):
        kind = {} if precision == 1e-9 else {"precision": precision}
        found = largest(lambda value: value <= end, **kind)
        assert end * (1.0 - precision) <= found <= end
