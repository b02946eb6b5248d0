"""What a system must be, and what is said of one that is not."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.theory.adaptive import Block, Predictor, predictor
from fcu.theory.arrays import frobenius
from fcu.theory.projection import Ball, Structure
from fcu.theory.systems import (
    AssumptionError,
    Limits,
    Plant,
    ReferenceModel,
    Uncertainty,
    constant,
    require_positive_definite,
    sat,
    swinging,
    symmetric,
)

EYE = np.eye(2)
MODEL = ReferenceModel(-EYE, EYE, EYE)


def known(Lambda, least=0.5, structure=Structure.FULL):
    return Uncertainty(constant(Lambda), np.array(least), structure)


def test_p_solves_the_lyapunov_equation_system_by_system():
    rng = np.random.default_rng(1)
    A = rng.normal(size=(20, 4, 4)) - 6.0 * np.eye(4)
    model = ReferenceModel(A, rng.normal(size=(20, 4, 2)), np.diag([1.0, 2.0, 3.0, 4.0]))
    np.testing.assert_allclose(
        np.swapaxes(A, 1, 2) @ model.P + model.P @ A, np.broadcast_to(-model.Q, A.shape), atol=1e-12
    )
    assert np.linalg.eigvalsh(model.P).min() > 0.0


def test_bounds_of_a_swinging_unknown_hold_and_are_reached_to_a_tenth():
    rng = np.random.default_rng(2)
    unknown = swinging(rng.normal(size=(2, 3)), 0.5, 3.0)
    values = np.array([unknown.value(t) for t in np.linspace(0.0, 5.0, 5001)])
    rates = np.diff(values, axis=0) / 1e-3
    assert 0.5 * unknown.bound < frobenius(values).max() <= unknown.bound
    assert 0.9 * unknown.rate_bound < frobenius(rates).max() <= unknown.rate_bound


def test_each_channel_saturates_on_its_own():
    limits = Limits(np.array([-1.0, 0.0, -5.0]), np.array([2.0, 4.0, 5.0]))
    np.testing.assert_array_equal(sat(np.array([3.0, -1.0, 1.0]), limits), [2.0, 0.0, 1.0])
    np.testing.assert_array_equal(symmetric(np.array([2.0]))(np.zeros(3), np.array([-7.0])), [-2.0])


@pytest.mark.parametrize(
    ("build", "says"),
    [
        (lambda: ReferenceModel(EYE, EYE, EYE), "A: must be Hurwitz, .* real part 1"),
        (lambda: ReferenceModel(-EYE, np.ones((3, 1)), EYE), r"B: expected shape"),
        (lambda: ReferenceModel(-EYE, EYE, -EYE), "Q: must be positive definite"),
        (lambda: ReferenceModel(-EYE, EYE, np.triu(np.ones((2, 2)))), "Q: must be symmetric"),
        (lambda: known(-EYE), r"Lambda\(0\): must be positive definite"),
        (lambda: known(EYE, least=2.0), "Lambda_min: .* smaller eigenvalue"),
        (lambda: known(EYE, least=0.0), "Lambda_min: must be above 0"),
        (lambda: known(np.diag([1.0, 2.0]), structure=Structure.SCALAR), "declared scalar"),
        (lambda: known(EYE + 0.1, structure=Structure.DIAGONAL), "declared diagonal"),
        (lambda: Limits(np.ones(2), np.array([2.0, 1.0])), "low must be below high"),
        (lambda: predictor(MODEL, 0.0), "k: must be above 0"),
        (lambda: Predictor(-EYE, EYE, EYE, -EYE), r"L\^T P \+ P L: must be positive definite"),
        (lambda: Block(0.0, Ball(1.0)), "gamma: must be above 0"),
        (
            lambda: Plant(MODEL, known(EYE), lambda t: np.zeros(2), f=lambda x, r: x),
            "Theta and f: give both or neither",
        ),
    ],
)
def test_what_is_outside_the_assumptions_is_refused(build, says):
    with pytest.raises(AssumptionError, match=says):
        build()


def test_a_matrix_that_is_only_semidefinite_is_refused():
    with pytest.raises(AssumptionError, match="positive definite"):
        require_positive_definite("P", np.zeros((1, 1)))
