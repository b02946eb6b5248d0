"""Pr of (10): what stays in its set, and for which Lambda it cannot raise V (15)."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.theory.arrays import frobenius, inner
from fcu.theory.projection import (
    Ball,
    Box,
    ProjectionError,
    Structure,
    require_sound,
    sound,
    symmetric_box,
)

N, Q, P = 100_000, 2, 3
ROUNDING = 1e-12


def weights(structure, rng):
    """N random positive definite Lambda of a form, eigenvalues apart by up to a factor of 20."""
    eigenvalues = np.exp(rng.uniform(np.log(0.1), np.log(2.0), (N, Q)))
    if structure is Structure.SCALAR:
        return eigenvalues[:, :1, None] * np.eye(Q)
    diagonal = eigenvalues[..., None] * np.eye(Q)
    if structure is Structure.DIAGONAL:
        return diagonal
    rotation, _ = np.linalg.qr(rng.normal(size=(N, Q, Q)))
    full = rotation @ diagonal @ np.swapaxes(rotation, 1, 2)
    return 0.5 * (full + np.swapaxes(full, 1, 2))


def a_set(kind, margin, Lambda):
    if kind == "box":
        return symmetric_box(np.full((Q, P), 0.7), margin)
    return Ball(1.0, margin, Lambda if kind == "ball in Lambda" else None)


def instants(kept_in, rng):
    """Truths in the set, estimates in the outer set (half of them at its edge), any rates."""
    truth = rng.normal(size=(N, Q, P))
    inner_set = (
        Ball(kept_in.radius, 0.0)
        if isinstance(kept_in, Ball)
        else Box(kept_in.low, kept_in.high, 0.0)
    )
    truth = inner_set.hold(truth)
    estimate = kept_in.hold(rng.normal(size=(N, Q, P)) * rng.choice([0.3, 1.0], (N, 1, 1)))
    return truth, estimate, rng.normal(size=(N, Q, P))


@pytest.mark.parametrize("margin", [0.1, 0.0], ids=["smooth", "hard"])
@pytest.mark.parametrize("kind", ["ball", "box", "ball in Lambda"])
@pytest.mark.parametrize("structure", list(Structure))
@pytest.mark.computes
def test_sound_says_where_projection_cannot_raise_v(kind, structure, margin):
    """tr(error^T Lambda (Y - Pr)) <= 0 at 100 000 instants where sound, and above 0 somewhere if not."""
    if kind == "ball in Lambda" and margin == 0.0:
        with pytest.raises(ProjectionError, match="margin above 0"):
            Ball(1.0, 0.0, np.eye(Q))
        return
    rng = np.random.default_rng(5)
    Lambda = weights(structure, rng)
    kept_in = a_set(kind, margin, Lambda)
    truth, estimate, Y = instants(kept_in, rng)
    taken = Y - kept_in.rate(estimate, Y)
    moved = inner(truth - estimate, Lambda @ taken)
    assert np.count_nonzero(frobenius(taken)) > N // 50  # projection did act
    if sound(kept_in, structure):
        assert moved.max() <= ROUNDING
    else:
        assert np.count_nonzero(moved > 1e-3) > 20  # counterexamples, not rounding


@pytest.mark.parametrize("kind", ["ball", "box"])
@pytest.mark.parametrize("structure", list(Structure))
def test_the_same_holds_after_a_step(kind, structure):
    """Putting an estimate back never moves it away from a truth in the set, as V measures it."""
    rng = np.random.default_rng(6)
    Lambda = weights(structure, rng)
    kept_in = a_set(kind, 0.0, Lambda)
    truth, _, outside = instants(kept_in, rng)
    before, after = truth - outside, truth - kept_in.hold(outside)
    growth = inner(after, Lambda @ after) - inner(before, Lambda @ before)
    if sound(kept_in, structure):
        assert growth.max() <= ROUNDING
    else:
        assert np.count_nonzero(growth > 1e-3) > 20


@pytest.mark.parametrize("kind", ["ball", "box", "ball in Lambda"])
def test_a_smooth_projection_never_lets_an_estimate_out_of_its_outer_set(kind):
    """At the outer edge no rate points out; and inside the set every rate is left as it is."""
    rng = np.random.default_rng(7)
    kept_in = a_set(kind, 0.2, weights(Structure.FULL, rng))
    far = kept_in.hold(rng.normal(size=(N, Q, P)) * 5.0)
    Y = rng.normal(size=(N, Q, P))
    rate = kept_in.rate(far, Y)
    if kind == "box":
        assert np.all(rate[far == kept_in.outer_high] <= 0.0)
        assert np.all(rate[far == kept_in.outer_low] >= 0.0)
        assert kept_in.outer_radius == pytest.approx(0.7 * 1.2 * np.sqrt(Q * P))
    else:
        assert inner(far, rate).max() <= ROUNDING
        assert kept_in.outer_radius == pytest.approx(1.2)
    assert frobenius(far).max() <= kept_in.outer_radius * (1.0 + 1e-12)
    within = rng.uniform(-0.3, 0.3, (N, Q, P))
    assert kept_in.contains(within).all()
    assert not kept_in.contains(far).any()
    np.testing.assert_array_equal(kept_in.rate(within, Y), Y)


@pytest.mark.parametrize("kind", ["ball", "box"])
def test_a_smooth_projection_is_continuous_and_a_hard_one_is_not(kind):
    rng = np.random.default_rng(8)
    for margin, jump in ((0.1, False), (0.0, True)):
        kept_in = a_set(kind, margin, np.eye(Q))
        edge = rng.normal(size=(N, Q, P))
        edge = Ball(1.0, 0.0).hold(edge * 10.0) if kind == "ball" else kept_in.hold(edge * 10.0)
        Y = rng.normal(size=(N, Q, P))
        change = kept_in.rate(edge * (1.0 + 1e-9), Y) - kept_in.rate(edge * (1.0 - 1e-9), Y)
        assert bool(np.abs(change).max() > 0.1) is jump
        assert jump or np.abs(change).max() < 1e-6


def test_an_estimate_driven_outwards_for_long_stays_in_the_outer_set():
    """Explicit steps of the smooth projection: it comes to rest between the two edges."""
    for kept_in in (Ball(1.0, 0.1), symmetric_box(np.full((Q, P), 0.7))):
        estimate, push = np.zeros((Q, P)), np.arange(1.0, 1.0 + Q * P).reshape(Q, P)
        for _ in range(5000):
            estimate = estimate + 1e-3 * kept_in.rate(estimate, push)
        assert not kept_in.contains(estimate)
        assert frobenius(estimate) <= kept_in.outer_radius


def test_a_component_that_is_known_stays_as_it_is():
    kept_in = Box(np.array([[0.0, -1.0]]), np.array([[0.0, 1.0]]), margin=0.1)
    for sign in (1.0, -1.0):
        rate = kept_in.rate(np.zeros((1, 2)), np.array([[sign, sign]]))
        np.testing.assert_array_equal(rate, [[0.0, sign]])


def test_an_unsound_pair_is_refused_with_what_to_use():
    with pytest.raises(ProjectionError, match=r"Theta_hat: .* ball .* diagonal"):
        require_sound("Theta_hat", Ball(1.0), Structure.DIAGONAL)
    with pytest.raises(ProjectionError, match=r"d_hat: .* box .* full"):
        require_sound("d_hat", symmetric_box(np.ones((2, 1))), Structure.FULL)
    require_sound("Theta_hat", Ball(1.0), Structure.DIAGONAL, scalar_unknown=True)


@pytest.mark.parametrize(
    ("build", "says"),
    [
        (lambda: Ball(0.0), "radius must be above 0"),
        (lambda: Ball(1.0, -0.1), "margin must be 0"),
        (lambda: Box(np.ones((1, 1)), np.zeros((1, 1))), "low must not be above high"),
        (lambda: symmetric_box(np.ones((1, 1)), -1.0), "margin must be 0"),
    ],
)
def test_a_set_that_is_none_is_refused(build, says):
    with pytest.raises(ProjectionError, match=says):
        build()
