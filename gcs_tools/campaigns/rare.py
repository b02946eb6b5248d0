"""The probability of a rare failure, by cross-entropy and importance sampling over what is drawn.

Every quantity is drawn by way of a standard normal number z. Stage after stage, flights are drawn from
a mixture of normal distributions whose centres were fitted to the worst tenth of the flights before:
cross-entropy (Rubinstein and Kroese, The Cross-Entropy Method, 2004, chapter 3). Several components
hold several regions of failures. They are no narrower than what they stand for: narrow ones, as a fit
of all moments has them, give intervals that are far too short. Part of the flights are drawn more
widely in all directions, to meet what the fit has missed, and part as they would be without any of
this, so that no weight is above ten.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

Numbers = np.ndarray[Any, np.dtype[np.float64]]

WORST = 0.1  # part of a stage's flights that the next one is fitted to
PLAIN = 0.1  # part of flights that are drawn without importance
WIDE = 0.2  # of the others, those that are drawn widely
FAR = 1.8  # standard deviation of these
COMPONENTS = 4
POINTS = 10  # that a component is fitted to, at least
DEVIATIONS = (1.0, 1.2)  # of a component, least and most
FEW = 30.0  # failures of equal weight, below which a few flights decide


class Mixture(NamedTuple):
    """Normal distributions of z with independent numbers, beside the standard one."""

    shares: Numbers  # (k,), their sum is 1 - PLAIN; of none: nothing but the standard one
    means: Numbers  # (k, d)
    deviations: Numbers  # (k, d)

    @classmethod
    def standard(cls, d: int) -> Mixture:
        """Nothing but the standard normal distribution."""
        return cls(np.zeros(0), np.zeros((0, d)), np.ones((0, d)))

    def draw(self, random: np.random.Generator) -> Numbers:
        """One z, float64 (d,)."""
        which = random.uniform()
        z: Numbers = random.standard_normal(self.means.shape[1])
        at = int(np.searchsorted(np.cumsum(self.shares), which, side="right"))
        if at == len(self.shares):
            return z
        drawn: Numbers = self.means[at] + self.deviations[at] * z
        return drawn

    def weights(self, z: Numbers) -> Numbers:
        """Density of the standard normal over that of the mixture, at z (n, d)."""
        if not len(self.shares):
            return np.ones(len(z))
        scaled = (z[:, None, :] - self.means) / self.deviations
        log = -0.5 * (scaled**2).sum(axis=2) - np.log(self.deviations).sum(axis=1)
        ratio = np.exp(log + 0.5 * (z**2).sum(axis=1)[:, None])
        found: Numbers = 1.0 / (PLAIN + ratio @ self.shares)
        return found

    def plain(self) -> list[Any]:
        """As JSON has it."""
        return [each.tolist() for each in self]

    @classmethod
    def of(cls, plain: list[Any], d: int) -> Mixture:
        """Back from JSON."""
        shares, means, deviations = (np.array(each, dtype=np.float64) for each in plain)
        return cls(shares, means.reshape(-1, d), deviations.reshape(-1, d))


class Estimate(NamedTuple):
    """A probability and its interval."""

    probability: float
    low: float
    high: float
    failures: int  # flights that failed among those that count
    flights: int
    effective: float  # failures of equal weight that would say as much: Kish, (sum w)^2 / sum w^2

    @property
    def doubt(self) -> str:
        """Why not to trust the interval, a sentence; empty: nothing against it is known."""
        if not self.failures:
            return (
                "No flight that counts failed: the upper end of the interval is all that is known."
            )
        if self.effective < FEW:
            return (
                f"The failures say as much as {self.effective:.1f} of equal weight: with fewer than"
                f" {FEW:g} a few flights decide. Fly more flights, or larger stages."
            )
        return ""


def fitted(z: Numbers, weights: Numbers, severity: Numbers, seed: int) -> tuple[Mixture, float]:
    """The mixture of the worst flights, and the severity from which they are (at most 0: a failure).

    z : (n, d).  severity : (n,), 0 or more for a failure.
    """
    n, d = z.shape
    level = min(0.0, float(np.sort(severity)[math.ceil((1.0 - WORST) * n) - 1]))
    worst = severity >= level
    # of roots of the weights: with the weights themselves a few flights would decide
    points, of = z[worst], np.sqrt(weights[worst])
    k = max(1, min(COMPONENTS, len(points) // POINTS))
    label = _clusters(points, k, seed)
    own = [label == i for i in range(k) if (label == i).any()]
    means = [np.average(points[which], axis=0, weights=of[which]) for which in own]
    spreads = [
        np.sqrt(np.average((points[which] - mean) ** 2, axis=0, weights=of[which]))
        for which, mean in zip(own, means, strict=True)
    ]
    # even a region of little weight is looked at: its weight is known from few flights
    share = np.array([of[which].sum() for which in own])
    share = (1.0 - PLAIN) * (1.0 - WIDE) * (0.5 * share / share.sum() + 0.5 / len(own))
    return Mixture(
        np.append(share, (1.0 - PLAIN) * WIDE),
        np.vstack([*means, np.zeros(d)]),
        np.vstack([np.clip(spreads, *DEVIATIONS), np.full(d, FAR)]),
    ), level


def _clusters(points: Numbers, k: int, seed: int) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Which of k groups of neighbours each point belongs to."""
    from scipy.cluster.vq import kmeans2

    if k == 1:
        return np.zeros(len(points), dtype=np.int64)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a group that no point is left in
        random = np.random.default_rng([seed, len(points)])
        found: np.ndarray[Any, np.dtype[np.int64]] = kmeans2(
            points, k, minit="++", rng=random, missing="warn"
        )[1].astype(np.int64)
    return found


def estimate(weights: Numbers, failed: Numbers, confidence: float) -> Estimate:
    """The probability of failure from flights with weights (n,), with Student's interval."""
    from scipy.special import stdtrit

    n = len(weights)
    value = weights * failed
    mean, spread = float(value.mean()), float(value.std(ddof=1)) / math.sqrt(n)
    count = int(failed.sum())
    if not count:  # as if one had failed with the greatest weight
        return Estimate(0.0, 0.0, min(1.0, -math.log(1.0 - confidence) / (PLAIN * n)), 0, n, 0.0)
    half = float(stdtrit(n - 1, 0.5 + 0.5 * confidence)) * spread
    effective = float(value.sum() ** 2 / (value @ value))
    return Estimate(mean, max(0.0, mean - half), min(1.0, mean + half), count, n, effective)


def search(
    severity: Callable[[int, Mixture], tuple[Numbers, Numbers]], d: int, stages: int, seed: int
) -> tuple[Mixture, list[float]]:
    """The mixture of the last stage, and the severity that each stage reached.

    severity : flies a stage with a mixture; its z (n, d) and severities (n,).
    """
    mixture, levels = Mixture.standard(d), list[float]()
    for stage in range(stages):
        z, found = severity(stage, mixture)
        mixture, level = fitted(z, mixture.weights(z), found, seed)
        levels.append(level)
        if level >= 0.0:
            break
    return mixture, levels
