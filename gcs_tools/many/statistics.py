"""Means with Student's intervals, shares with Wilson's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

CONFIDENCE = 0.95


class Interval(NamedTuple):
    """A value, and where it lies with 95 % confidence; of too few flights the ends are not numbers."""

    value: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """Whether the sign is certain."""
        return self.low > 0.0 or self.high < 0.0


def mean(values: Sequence[float]) -> Interval:
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
    t = float(stdtrit(len(data) - 1, 0.5 + 0.5 * CONFIDENCE))
    half = t * float(data.std(ddof=1)) / math.sqrt(len(data))
    return Interval(value, value - half, value + half)


def share(count: int, of: int) -> Interval:
    """A part, `count` of `of`, with Wilson's interval."""
    from scipy.stats import binomtest

    if not of:
        return Interval(math.nan, math.nan, math.nan)
    found = binomtest(count, of).proportion_ci(CONFIDENCE, method="wilson")
    return Interval(count / of, float(found.low), float(found.high))
