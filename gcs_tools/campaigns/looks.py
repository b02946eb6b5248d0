"""The looks of a campaign: when it may end early, so that its intervals keep their coverage.

A campaign that may end early looks at its flights at numbers that are fixed before the first flight.
Each look has an equal part of the error: K looks have intervals of confidence 1 - alpha / K. With
probability 1 - alpha or more all K intervals hold the true share (the union bound), so the one at
which a campaign ends does, whatever made it end there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gcs_tools.campaigns.statistics import Share

FIRST = 20  # flights before which nobody looks
RATIO = 1.5  # of the flights at a look to those at the one before


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
