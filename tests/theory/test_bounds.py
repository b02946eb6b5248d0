"""Constants and bounds of Section IV by hand, and the two forms of each."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.guard.responses import decay_pair
from fcu.theory.bounds import (
    Assumed,
    Blocks,
    PredictionBound,
    Unknown,
    c1,
    c2,
    initial_V,
    prediction_bound,
    predictor_bound,
    reference_bound,
    single,
    tracking_bound,
)
from fcu.theory.projection import Ball, symmetric_box

PAPER = Assumed(
    Unknown(2.0, 0.3, error=4.0), 0.5, Theta=Unknown(3.0, 0.4, error=6.0),
    d=Unknown(5.0, 0.6, error=10.0),
)  # fmt: skip


def test_constants_of_the_paper():
    assert c1(PAPER, "printed").total == pytest.approx(4 * 2 * 25 + 4 * 2 * 9 + 4 * 4)  # (12)
    printed = 4 * 2 * 3 * 0.4 + 4 * 2 * 5 * 0.6 + 4 * 0.3 * 25 + 4 * 0.3 * 9
    assert c2(PAPER, "printed").total == pytest.approx(printed)  # (13)


def test_repaired_they_have_the_term_of_lambdas_rate_and_frobenius_norms():
    assert c1(PAPER).total == c1(PAPER, "printed").total
    assert c2(PAPER).total - c2(PAPER, "printed").total == pytest.approx(4 * 2.0 * 0.3)
    q = 3  # Lambda = 2 I known to be diagonal: its 2-norm is 2, its Frobenius norm 2 sqrt(3)
    wide = PAPER._replace(Lambda=Unknown(2.0 * math.sqrt(q), error=4.0 * math.sqrt(q), norm=2.0))
    assert c1(wide, "printed").Lambda == pytest.approx(16.0)
    assert c1(wide).Lambda == pytest.approx(16.0 * q)


def test_beside_lambda_no_bound_of_lambda_counts():
    beside = Assumed(Unknown(2.0, 0.3), 0.5, s=Unknown(5.0, 0.6, error=10.0))
    assert c1(beside).s == pytest.approx(100.0)
    assert c2(beside).s == pytest.approx(2 * 0.6 * 10.0)


def pushed(kept_in, truth):
    """The estimate that Pr ends at when adaptation pushes it away from the truth for good."""
    estimate, h = truth.copy(), 0.02
    for _ in range(2000):
        estimate = kept_in.hold(estimate + h * kept_in.rate(estimate, -truth))
    return estimate


@pytest.mark.parametrize("shape", [(1, 1), (2, 3)])
def test_by_default_the_error_reaches_across_the_outer_set_of_the_default_ball(shape):
    """An estimate at the far edge of the smooth ball: 2.1 times the size, not twice."""
    rng = np.random.default_rng(4)
    truth = rng.normal(size=shape)
    size = float(np.linalg.norm(truth))
    error = float(np.linalg.norm(truth - pushed(Ball(size), truth)))
    assert error > 2.09 * size
    assert error <= Unknown(size).farthest * (1.0 + 1e-12)
    assert Unknown(size).farthest == pytest.approx(Ball(size).farthest(size))
    known = Assumed(Unknown(1.0), 1.0, s=Unknown(size))
    P, x_til = np.eye(2), np.zeros(2)
    assert initial_V(known._replace(Lambda=Unknown(0.0)), single(10.0), P, x_til) >= error**2 / 10.0


@pytest.mark.parametrize("kept_in", [
    Ball(2.0), Ball(3.0, 0.0), Ball(2.0, 0.5), symmetric_box(np.full((2, 3), 2.0)),
    symmetric_box(np.full((2, 3), 2.0), 0.0),
])  # fmt: skip
def test_any_other_set_says_how_far_its_estimates_may_be(kept_in):
    truth = np.full((2, 3), 2.0 / math.sqrt(6.0))  # of norm 2, towards a corner of the box
    error = float(np.linalg.norm(truth - pushed(kept_in, truth)))
    assert 0.99 * kept_in.farthest(2.0) < error <= kept_in.farthest(2.0) * (1.0 + 1e-12)


def test_each_block_is_divided_by_its_own_gain_and_nothing_needs_none():
    assert Blocks(1.0, 2.0, 3.0).over(Blocks(10.0, 20.0, 30.0)) == pytest.approx(0.3)
    assert Blocks(Lambda=1.0).over(Blocks(Lambda=2.0)) == 0.5


def test_time_and_the_split_of_it():
    bound = PredictionBound(V_0=9.0, level=4.0, rate=2.0, P_least=0.25)
    assert bound.at(0.0) == pytest.approx(6.0)
    assert bound.settled == pytest.approx(4.0)
    assert bound.at(50.0) == pytest.approx(bound.settled)
    assert bound.peak == pytest.approx(6.0)
    for t in np.linspace(0.0, 3.0, 13):
        assert bound.at(t) <= bound.split(t)


def test_the_prediction_bound_is_put_together_from_its_parts():
    P, Q, x_til = np.diag([1.0, 2.0]), np.diag([2.0, 8.0]), np.array([0.1, 0.2])
    gammas, k = single(100.0), 10.0
    assert initial_V(PAPER, gammas, P, x_til) == pytest.approx(0.09 + c1(PAPER).total / 100.0)
    bound = prediction_bound(PAPER, gammas, k, P, Q, x_til)
    assert bound.rate == pytest.approx(11.0)  # k and half of the least eigenvalue of P^-1 Q
    expected = (c1(PAPER).total + c2(PAPER).total / 22.0) / 100.0
    assert bound.settled == pytest.approx(math.sqrt(expected))
    printed = prediction_bound(PAPER, gammas, k, P, Q, x_til, "printed")
    assert printed.rate == k


def test_a_batch_is_what_its_systems_are():
    known = Assumed(Unknown(np.array([1.0, 2.0])), 0.5, d=Unknown(np.array([3.0, 4.0])))
    eye, nothing = np.stack([np.eye(2)] * 2), np.zeros((2, 2))
    both = prediction_bound(known, single(np.array([10.0, 20.0])), 1.0, eye, eye, nothing)
    for i, (Lambda, d, gamma) in enumerate([(1.0, 3.0, 10.0), (2.0, 4.0, 20.0)]):
        one = prediction_bound(
            Assumed(Unknown(Lambda), 0.5, d=Unknown(d)), single(gamma), 1.0, eye[0], eye[0],
            nothing[0],
        )  # fmt: skip
        assert np.asarray(both.settled)[i] == pytest.approx(one.settled)


def test_reference_and_tracking_bounds():
    A, B = np.array([[-2.0]]), np.array([[3.0]])
    pair = decay_pair(A, 1.0)
    assert pair.gamma_A == pytest.approx(1.0)
    assert reference_bound(pair, B, np.array([5.0]), 4.0) == pytest.approx(5.0 + 12.0, rel=1e-3)
    away = np.array([0.5])
    printed = predictor_bound(A, pair, 10.0, away, 0.1, "printed")
    assert printed == pytest.approx(0.5 + 10.0 * 0.1, rel=1e-3)
    repaired = predictor_bound(A, pair, 10.0, away, 0.1)
    assert repaired == pytest.approx(0.5 + 0.5 * 10.0 * 0.1, rel=1e-3)  # 1/2 is the L1 gain
    assert tracking_bound(A, pair, 10.0, away, 0.1) == pytest.approx(repaired + 0.1)


def test_the_papers_tracking_bound_does_not_shrink_with_gamma():
    A = np.array([[0.0, 1.0], [-1.0, -1.6]])
    pair, known = decay_pair(A), Assumed(Unknown(0.25), 0.1, d=Unknown(20.0))
    found = []
    for gamma in (1e2, 1e4, 1e6):
        k = math.sqrt(gamma)
        bound = prediction_bound(
            known, single(gamma), k, np.eye(2), 0.0 * np.eye(2), np.zeros(2), "printed"
        )
        found.append(tracking_bound(A, pair, k, np.zeros(2), float(bound.settled), "printed"))
    assert min(found) > 40.0  # m, of a vehicle that holds its place to centimetres
    assert found[2] == pytest.approx(found[1], rel=0.02)
