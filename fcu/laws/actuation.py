"""Parameters of the rotors that every law has: how their lag is inverted, and what gives way first."""

from __future__ import annotations

from typing import Any

from fcu.interface.parameter import Conversion, Parameter, with_field
from fcu.laws import scales
from fcu.laws.allocation import rotor_mean

METHODS = {"plain": 0.0, "safe": 1.0}


def rotor_lag(law: Any) -> float:
    """The lag (s) that a rotor is believed to have: the inverse of `rotor_mean`.

    A lag beyond 10 000 periods reads as that.
    """
    weight = law.rotors.mean
    if weight <= 0.0:
        return 0.0
    low, high = 0.0, 1e4 * float(law.h)
    while low < (middle := 0.5 * (low + high)) < high:
        if rotor_mean(law.h, middle) < weight:
            low = middle
        else:
            high = middle
    return high


def kappa(lag: float, response: float) -> float:
    """Speed command over wanted change of speed, of a lag (s) that is made to look like another (s)."""
    factor: float = max(1.0, lag / response)
    return factor


def _get_response(law: Any) -> float:
    lag, factor = rotor_lag(law), float(law.rotors.kappa)
    response: float = lag / factor if factor > 1.0 else max(lag, scales.QUICKEST)
    return response


ROTOR_RESPONSE = Conversion(
    _get_response, lambda law, s: with_field(law, "rotors.kappa", kappa(rotor_lag(law), s))
)


def rows(response: str) -> tuple[Parameter, ...]:
    """Rows of Params that have the fields `h` and `rotors`. `response`: what MAVLink calls that one."""
    return (
        Parameter(
            "rotor_response_s", response, None, 0.0001, 1.0, "s",
            "what the rotors' lag is made to look like", "rotors.kappa", ROTOR_RESPONSE,
            rule=scales.rotor_response,
        ),
        Parameter(
            "allocation", "CA_METHOD", "safe", 0.0, 1.0, "",
            "how thrust and torque that do not fit give way",
            "rotors.safe", words=METHODS, values=tuple(METHODS.values()), integer=True,
        ),
    )  # fmt: skip
