"""Peaks and L1 gains: never below, and hardly above, what sampling finds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from fcu.guard.responses import UnstableError, decay, decay_pair, gain, peak
from fcu.theory.control_difference import control_gain, prediction_gain

TIGHT = 2e-3


def answer(M, E, C, end=60.0, points=20_000):
    """C exp(M t) E at `points` times, and the time between."""
    h = end / points
    step, X = expm(M * h), [E]
    for _ in range(points - 1):
        X.append(step @ X[-1])
    return C @ np.array(X), h


def hurwitz(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    M = rng.normal(size=(n, n))
    M = M - (np.linalg.eigvals(M).real.max() + 0.2) * np.eye(n)
    return M, rng.normal(size=(n, 2)), rng.normal(size=(2, n))


@pytest.mark.parametrize("seed", range(5))
def test_gain_and_peak_are_above_and_close_to_what_is_found_by_sampling(seed):
    M, E, C = hurwitz(seed)

    X, h = answer(M, E, C)
    for norm, sizes in (
        ("spectral", np.linalg.norm(X, 2, axis=(1, 2))),
        ("entries", abs(X[:, 0, 1])),
    ):
        found = h * (sizes.sum() - 0.5 * sizes[0])
        bound = gain(M, E, C, norm=norm)
        assert found * (1.0 - 1e-5) <= bound[0, -1] <= found * (1.0 + 10 * TIGHT)
        bound = peak(M, E, C, norm=norm)
        assert sizes.max() <= bound[0, -1] * (1.0 + 1e-9) <= sizes.max() * (1.0 + 10 * TIGHT)


@pytest.mark.parametrize("A", [[[0.0, 1.0], [-1.0, -2.0]], [[-1.0, 5.0], [0.0, -1.0]]])
@pytest.mark.computes
def test_systems_without_a_basis_of_eigenvectors_are_bounded_too(A):
    M = np.array(A)
    X, h = answer(M, np.eye(2), np.eye(2))
    sizes = np.linalg.norm(X, 2, axis=(1, 2))
    found = h * (sizes.sum() - 0.5 * sizes[0])
    assert found * (1.0 - 1e-5) <= gain(M)[0, 0] <= found * (1.0 + TIGHT)
    assert sizes.max() <= peak(M)[0, 0] * (1.0 + 1e-9) <= sizes.max() * (1.0 + TIGHT)


@pytest.mark.parametrize("zeta", [0.05, 0.139, 0.3, 0.5, 0.707, 0.99, 1.0, 1.01, 3.0, 50.0])
def test_closed_forms_of_a_channel_are_its_l1_gains(zeta):
    omega = 30.0
    M = np.array([[-2.0 * zeta * omega, 1.0], [-omega * omega, 0.0]])
    to_x, to_z = gain(M, np.array([[0.0], [1.0]]), norm="entries")[:, 0]
    for found, exact in (
        (to_z * omega, control_gain(zeta)),
        (to_x * omega**2, prediction_gain(zeta)),
    ):
        assert exact * (1.0 - 1e-9) <= found <= exact * (1.0 + TIGHT)


@pytest.mark.slow
@pytest.mark.parametrize(("f_m", "overshoot", "full"), [(1.0, 1.000, 3.00), (1.4, 1.019, 3.21)])
def test_the_reference_model_of_position(f_m, overshoot, full):
    A = np.array([[0.0, 1.0], [-f_m * f_m, -1.6 * f_m]])
    assert peak(A)[0, 0] == pytest.approx(overshoot, abs=6e-4)
    pair = decay_pair(A, 0.9999 * 0.8 * f_m)
    assert pair.gamma_A == pytest.approx(full, abs=6e-3)
    for t in np.linspace(0.0, 20.0, 401):
        bound = pair.gamma_A * np.exp(-pair.lambda_A * t)
        assert np.linalg.norm(expm(A * t), 2) <= bound


def test_a_decay_that_is_not_there_is_refused():
    A = np.array([[-1.0, 0.0], [0.0, -2.0]])
    assert decay(A) == pytest.approx(1.0)
    with pytest.raises(UnstableError, match=r"\b1 1/s.*\b1\.5"):
        decay_pair(A, 1.5)
    with pytest.raises(UnstableError, match="must exceed 0"):
        gain(-A)


@pytest.mark.parametrize("norm", ["spectral", "entries"])
def test_without_an_input_or_an_output_there_is_no_response(norm):
    M, E, C = hurwitz(1)
    for input_, output in ((0.0 * E, C), (E, 0.0 * C)):
        assert not gain(M, input_, output, norm).any()
        assert not peak(M, input_, output, norm=norm).any()
