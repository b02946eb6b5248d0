"""Shares of successful flights: exact intervals, and an early end that keeps their coverage.

A campaign that may end early looks at its flights at numbers that are fixed before the first flight.
Each look has an equal part of the error: K looks have intervals of confidence 1 - alpha / K. With
probability 1 - alpha or more all K intervals hold the true share (the union bound), so the one at
which a campaign ends does, whatever made it end there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

FIRST = 20  # flights before which nobody looks
RATIO = 1.5  # of the flights at a look to those at the one before


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


def share(successes: int, of: int, confidence: float) -> Share:
    """The share with its two-sided interval of Clopper and Pearson, which is exact."""
    each = 0.5 * (1.0 - confidence)
    return Share(successes, of, _above(successes, of, each), 1.0 - _above(of - successes, of, each))


def interval(successes: int, of: int, confidence: float) -> tuple[float, float]:
    """The interval of `share` alone."""
    return share(successes, of, confidence)[2:]


def at_least(successes: int, of: int, confidence: float) -> float:
    """The bound that the probability is above with this confidence: one-sided, Clopper and Pearson."""
    return _above(successes, of, 1.0 - confidence)


def _above(successes: int, of: int, error: float) -> float:
    """The probability with which so many successes, or more, come with the probability `error`."""
    from scipy.special import betaincinv

    return float(betaincinv(successes, of - successes + 1, error)) if successes else 0.0


@dataclass(frozen=True)
class Looks:
    """At how many flights a campaign is looked at, and with which part of the error."""

    at: tuple[int, ...]  # flights of each law, ascending; the last: all
    width: float | None  # it ends when no interval is wider; None: at the last alone

    @classmethod
    def of(cls, n: int, confidence: float, width: float | None = None) -> Looks:
        """The looks of a campaign of `n` flights.

        Where not even flights that all succeed have an interval so narrow, nobody looks.
        """
        if width is None:
            return cls((n,), None)
        at = [n]
        while (before := math.ceil(at[0] / RATIO)) >= FIRST and before < at[0]:
            at.insert(0, before)
        while len(at) > 1 and _narrowest(at[0], _part(confidence, len(at))) > width:
            at.pop(0)
        return cls(tuple(at), width)

    def confidence(self, confidence: float) -> float:
        """That of each look's interval, for all of them to hold with `confidence`."""
        return _part(confidence, len(self.at))

    def ends(self, shares: Sequence[Share]) -> bool:
        """Whether a campaign ends at a look with these shares, one a law."""
        return self.width is not None and all(each.width <= self.width for each in shares)


def _part(confidence: float, looks: int) -> float:
    return 1.0 - (1.0 - confidence) / looks


def _narrowest(n: int, confidence: float) -> float:
    """Width of the interval when all of n flights succeed."""
    return 1.0 - float((0.5 * (1.0 - confidence)) ** (1.0 / n))
