"""Statistics of flights: means with Student's intervals, shares with Clopper and Pearson's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

CONFIDENCE = 0.95


class Interval(NamedTuple):
    """A value and its confidence interval. Of too few flights the ends are not numbers."""

    value: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """Whether the sign is certain."""
        return self.low > 0.0 or self.high < 0.0


class Share(NamedTuple):
    """A part of flights, and the interval of its probability."""

    successes: int
    of: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """The part; of no flights not a number."""
        return self.successes / self.of if self.of else math.nan

    @property
    def width(self) -> float:
        """Of the interval."""
        return self.high - self.low

    @property
    def interval(self) -> Interval:
        """The part with its interval, without the counts."""
        return Interval(self.value, self.low, self.high)


def mean(values: Sequence[float], confidence: float = CONFIDENCE) -> Interval:
    """The mean, with Student's t: of few flights as wide as their number asks for.

    Of one value, or of none, there is no interval.
    """
    from scipy.special import stdtrit

    data = np.array(values, dtype=np.float64)
    if not len(data):
        return Interval(math.nan, math.nan, math.nan)
    value = float(data.mean())
    if len(data) == 1:
        return Interval(value, math.nan, math.nan)
    if np.ptp(data) == 0.0:
        return Interval(value, value, value)
    t = float(stdtrit(len(data) - 1, 0.5 + 0.5 * confidence))
    half = t * float(data.std(ddof=1)) / math.sqrt(len(data))
    return Interval(value, value - half, value + half)


def share(successes: int, of: int, confidence: float = CONFIDENCE) -> Share:
    """The share with its two-sided interval of Clopper and Pearson, which is exact."""
    each = 0.5 * (1.0 - confidence)
    return Share(successes, of, _above(successes, of, each), 1.0 - _above(of - successes, of, each))


def interval(successes: int, of: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """The interval of `share` alone."""
    return share(successes, of, confidence)[2:]


def at_least(successes: int, of: int, confidence: float = CONFIDENCE) -> float:
    """The bound that the probability is above with this confidence: one-sided, Clopper and Pearson."""
    return _above(successes, of, 1.0 - confidence)


def _above(successes: int, of: int, error: float) -> float:
    """The probability with which so many successes, or more, come with the probability `error`."""
    from scipy.special import betaincinv

    return float(betaincinv(successes, of - successes + 1, error)) if successes else 0.0
