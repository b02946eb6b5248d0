"""Which gains fly together: the believed lag of a rotor, and the rule on the closed loop."""

from __future__ import annotations

from fcu.law.parameters import rotor_mean
from fcu.law.types import LawParams


def rotor_lag(params: LawParams) -> float:
    """The lag (s) that a rotor is believed to have: the inverse of `rotor_mean`.

    A lag beyond 10 000 periods reads as that.
    """
    weight = params.rotor_mean
    if weight <= 0.0:
        return 0.0
    low, high = 0.0, 1e4 * params.h
    while low < (middle := 0.5 * (low + high)) < high:
        if rotor_mean(params.h, middle) < weight:
            low = middle
        else:
            high = middle
    return high
