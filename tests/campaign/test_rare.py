"""Rare failures: an estimate whose interval holds a probability that is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from gcs_tools.campaigns.rare import FEW, PLAIN, Mixture, estimate, fitted, search

D, CONFIDENCE = 5, 0.9


def linear(z):
    """A plane 4 standard deviations from the middle: failure with Phi(-4) = 3.2e-5."""
    return z @ np.array([2.0, 1.0, 0.0, -1.0, 0.5]) / np.sqrt(6.25) - 4.0


def two_sided(z):
    """Two regions, as a wind that may come from either side: 2 Phi(-3.5) = 4.7e-4."""
    return np.abs(z[:, 1]) - 3.5


def crooked(z):
    """Failures outside of a circle in two of five numbers: exp(-r^2 / 2), 1.1e-4 for r = 4.27."""
    return np.hypot(z[:, 0], z[:, 3]) - 4.27


CASES = [
    (linear, float(norm.cdf(-4.0))),
    (two_sided, float(2.0 * norm.cdf(-3.5))),
    (crooked, float(np.exp(-0.5 * 4.27**2))),
]


def found(limit, seed, n=1500, stage=400):
    random = np.random.default_rng(seed)

    def severity(_stage, mixture):
        z = np.array([mixture.draw(random) for _ in range(stage)])
        return z, limit(z)

    mixture, levels = search(severity, D, 10, seed)
    z = np.array([mixture.draw(random) for _ in range(n)])
    return estimate(mixture.weights(z), limit(z) >= 0.0, CONFIDENCE), levels


@pytest.mark.parametrize(("limit", "p"), CASES[:2], ids=["linear", "two_sided"])
@pytest.mark.computes
def test_the_interval_covers_a_known_probability(limit, p):
    estimates = [found(limit, seed)[0] for seed in range(60)]
    covered = sum(each.low <= p <= each.high for each in estimates)
    assert covered >= 45  # of 60 at 90 %: 54, less four standard deviations
    assert np.mean([each.probability for each in estimates]) == pytest.approx(p, rel=0.1)
    # 1500 plain flights would see 0.05 failures of the first, and less than one of the second
    assert np.median([each.high - each.low for each in estimates]) < 0.5 * p


@pytest.mark.computes
def test_a_ring_of_failures_is_not_missed():
    limit, p = CASES[2]
    estimates = [found(limit, seed)[0] for seed in range(30)]
    assert np.mean([each.probability for each in estimates]) == pytest.approx(p, rel=0.15)
    # more regions than components: the interval is known to be somewhat short
    assert sum(each.low <= p <= each.high for each in estimates) >= 19


def test_stages_go_on_until_a_tenth_fails():
    _, levels = found(linear, 3)
    assert levels == sorted(levels)
    assert levels[-1] == 0.0
    assert len(levels) < 10


def test_weights_are_the_ratio_of_densities_and_bounded():
    mixture = Mixture(np.array([0.5, 0.4]), np.array([[3.0, 0.0], [-1.0, 2.0]]), np.array([[0.5, 1.0], [1.0, 0.3]]))  # fmt: skip
    z = np.random.default_rng(1).normal(size=(50, 2)) * 3.0
    density = PLAIN * norm.pdf(z).prod(axis=1)
    for share, mean, deviation in zip(*mixture, strict=True):
        density += share * norm.pdf(z, mean, deviation).prod(axis=1)
    np.testing.assert_allclose(mixture.weights(z), norm.pdf(z).prod(axis=1) / density, rtol=1e-9)
    assert mixture.weights(z).max() <= 1.0 / PLAIN
    # and they are 1 on average over what the mixture draws
    random = np.random.default_rng(2)
    drawn = np.array([mixture.draw(random) for _ in range(20_000)])
    assert mixture.weights(drawn).mean() == pytest.approx(1.0, abs=0.05)


def test_without_a_failure_the_interval_begins_at_zero_and_is_not_empty():
    none = estimate(np.ones(1000), np.zeros(1000, dtype=bool), 0.95)
    assert (none.probability, none.low) == (0.0, 0.0)
    assert none.high >= 3.0 / 1000.0  # what plain flights would show


def test_failures_of_unequal_weight_say_less():
    failed = np.array([True] * 4 + [False] * 6)
    assert estimate(np.full(10, 0.2), failed, 0.95).effective == pytest.approx(4.0)
    one_heavy = np.array([9.0, 1.0, 1.0, 1.0] + [5.0] * 6)  # (9 + 3)^2 / (81 + 3)
    assert estimate(one_heavy, failed, 0.95).effective == pytest.approx(144.0 / 84.0)
    assert estimate(np.ones(10), np.zeros(10, dtype=bool), 0.95).effective == 0.0


@pytest.mark.computes
def test_few_failures_are_doubted():
    limit, _ = CASES[0]
    few, many = ([found(limit, seed, n=n)[0] for seed in range(20)] for n in (100, 1500))
    assert all(each.effective < FEW and each.doubt for each in few)
    assert not any(each.doubt for each in many)
    # docs/campaigns.md: of so many flights so many fail, and say as much as so many
    assert np.mean([each.failures for each in many]) == pytest.approx(690, rel=0.05)
    assert np.median([each.effective for each in many]) == pytest.approx(110, rel=0.1)
    assert estimate(np.ones(10), np.zeros(10, dtype=bool), 0.95).doubt


def test_a_mixture_is_the_same_after_json():
    z = np.random.default_rng(1).normal(size=(200, 3))
    mixture, level = fitted(z, np.ones(200), z[:, 0] - 4.0, 1)
    assert level < 0.0
    again = Mixture.of(mixture.plain(), 3)
    assert all((a == b).all() for a, b in zip(mixture, again, strict=True))
