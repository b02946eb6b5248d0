"""Distributions of a drawn quantity: what [draw] of a campaign may say, and its quantiles.

Every method (random, Latin hypercube, Sobol, grid) makes numbers between 0 and 1, and each quantity
is its distribution's quantile there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

from fcu.interface.files.input_file import written
from gcs_tools.missions.fields import Number, Table, optional, wrong

Numbers = np.ndarray[Any, np.dtype[np.float64]]

_Pair = Annotated[tuple[Number, Number], Field(strict=False)]
_Three = Annotated[tuple[Number, Number, Number], Field(strict=False)]
_Integer = Annotated[int, Field(gt=-(2**53), lt=2**53)]  # that a float holds
_Whole = Annotated[tuple[_Integer, _Integer], Field(strict=False)]
_Values = Annotated[tuple[Any, ...], Field(strict=False, min_length=1, max_length=1000)]
_Weights = Annotated[tuple[Annotated[float, Field(ge=0.0)], ...], Field(strict=False, min_length=1)]

KINDS = ("uniform", "log_uniform", "normal", "log_normal", "triangular", "integer", "choice")
_BOUNDED = ("normal", "log_normal")  # that have no end of their own
RAREST = 1e-9  # of a quantity without an end: the part beyond which nobody looks before the flights
_EPS = 2.0**-53


class Distribution(Table):
    """One quantity: exactly one of the first seven keys says how it is distributed."""

    uniform: _Pair | None = optional("[least, most]")
    log_uniform: _Pair | None = optional("[least, most], both > 0: uniform in the logarithm")
    normal: _Pair | None = optional("[mean, standard deviation]")
    log_normal: _Pair | None = optional("[median, standard deviation of the natural logarithm]")
    triangular: _Three | None = optional("[least, most likely, most]")
    integer: _Whole | None = optional("[least, most], both included")
    choice: _Values | None = optional("one of these values, of any kind")
    weights: _Weights | None = optional("of the choices; left out: all alike")
    low: Number | None = optional("nothing below is drawn (normal, log_normal)")
    high: Number | None = optional("nothing above is drawn (normal, log_normal)")
    relative: bool = Field(False, description="true: the draw multiplies the mission's value")
    levels: Annotated[int, Field(ge=1, le=1000)] | None = optional(
        'values of a quantity that is no choice with method = "grid"'
    )

    @model_validator(mode="after")
    def _can_be_drawn(self) -> Self:
        given = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            raise wrong((), f"exactly one of {', '.join(KINDS)}")
        kind = given[0]
        value: Any = getattr(self, kind)
        if kind in ("uniform", "log_uniform", "integer") and not value[0] <= value[1]:
            raise wrong((kind,), "[least, most]", list(value))
        if kind in ("log_uniform", "log_normal") and not value[0] > 0.0:
            raise wrong((kind, 0), "a number > 0", value[0])
        if kind in _BOUNDED and not value[1] >= 0.0:
            raise wrong((kind, 1), "a standard deviation >= 0", value[1])
        if kind == "triangular" and not value[0] <= value[1] <= value[2]:
            raise wrong((kind,), "[least, most likely, most]", list(value))
        if kind == "choice" and (twice := _twice(value)) is not None:
            raise wrong(
                (kind,), f"values that differ ({written(twice)} is there twice)", list(value)
            )
        if self.weights is not None and (kind != "choice" or len(self.weights) != len(value)):
            raise wrong(("weights",), "as many weights as there are choices")
        if self.weights is not None and not 0.0 < sum(self.weights) < math.inf:
            raise wrong(("weights",), "a weight > 0, and a sum that is a number")
        if kind not in _BOUNDED and (self.low is not None or self.high is not None):
            key = "low" if self.low is not None else "high"
            raise wrong((key,), f"no bound: {kind} has its own")
        if self.relative and kind == "choice" and not all(map(_is_number, value)):
            raise wrong(("relative",), "numbers to multiply by", list(value))
        if kind in _BOUNDED:
            low, high = self._ends()
            if not low < high:
                raise wrong(("high",), f"a number above low, {low:g}", high)
            if not self._share(low, high) > 1e-12:
                raise wrong((kind,), f"a distribution that reaches {low:g} to {high:g}")
        return self

    @property
    def kind(self) -> str:
        """Which of KINDS it is."""
        return next(kind for kind in KINDS if getattr(self, kind) is not None)

    @property
    def is_choice(self) -> bool:
        """Whether its values are listed."""
        return self.choice is not None

    def at(self, part: Numbers) -> list[Any]:
        """Quantiles at parts (n,) between 0 and 1."""
        u = np.clip(part, _EPS, 1.0 - _EPS)
        if self.choice is not None:
            weights = np.ones(len(self.choice)) if self.weights is None else np.array(self.weights)
            ends = np.cumsum(weights) / weights.sum()
            which = np.minimum(np.searchsorted(ends, u, side="right"), len(self.choice) - 1)
            return [_plain(self.choice[i]) for i in which.tolist()]
        if self.integer is not None:
            least, most = self.integer
            whole = least + np.floor(u * (most - least + 1)).astype(np.int64)
            return [int(value) for value in np.minimum(whole, most)]
        found: list[float] = self._continuous(u).tolist()
        return found

    def ends(self) -> list[Any]:
        """All choices, or the least and the greatest value; of one without an end, a rare one."""
        if self.choice is not None:
            return self.grid()
        if self.kind in _BOUNDED:
            return self.at(np.array([RAREST, 1.0 - RAREST]))
        value: Any = getattr(self, self.kind)
        return [value[0], value[-1]]

    def grid(self) -> list[Any]:
        """Its values in a grid: the choices, or the middles of `levels` parts of equal probability."""
        if self.choice is not None:
            return [_plain(each) for each in self.choice]
        n = self.levels or 0
        return self.at((np.arange(n) + 0.5) / n)

    def _continuous(self, u: Numbers) -> Numbers:
        from scipy.special import ndtr, ndtri

        if self.uniform is not None:
            low, high = self.uniform
            return low + u * (high - low)
        if self.log_uniform is not None:
            first, last = (math.log(end) for end in self.log_uniform)
            found: Numbers = np.exp(first + u * (last - first))
            return np.clip(found, *self.log_uniform)
        if self.triangular is not None:
            least, mode, most = self.triangular
            if most == least:
                return np.full(len(u), least)
            split = (mode - least) / (most - least)
            rise = least + np.sqrt(u * (most - least) * (mode - least))
            fall = most - np.sqrt((1.0 - u) * (most - least) * (most - mode))
            return np.where(u < split, rise, fall)
        location, scale = self._gaussian()
        low, high = self._ends()
        if scale == 0.0:
            z = np.zeros(len(u))
        else:
            below, above = (float(ndtr((end - location) / scale)) for end in (low, high))
            z = ndtri(np.clip(below + u * (above - below), _EPS, 1.0 - _EPS))
        drawn: Numbers = np.clip(location + scale * z, low, high)
        if self.normal is not None:
            return drawn
        with np.errstate(over="ignore"):  # infinite: no mission has it, and says so
            return np.exp(drawn)

    def _gaussian(self) -> tuple[float, float]:
        """Mean and standard deviation of the quantity, of log_normal of its logarithm."""
        if self.normal is not None:
            return self.normal
        assert self.log_normal is not None
        return math.log(self.log_normal[0]), self.log_normal[1]

    def _ends(self) -> tuple[float, float]:
        """Of the quantity, of log_normal of its logarithm."""
        low, high = self.low, self.high
        if self.normal is not None:
            return -math.inf if low is None else low, math.inf if high is None else high
        return (
            -math.inf if low is None or low <= 0.0 else math.log(low),
            math.inf if high is None else math.log(high) if high > 0.0 else -math.inf,
        )

    def _share(self, low: float, high: float) -> float:
        from scipy.special import ndtr

        location, scale = self._gaussian()
        if scale == 0.0:
            return float(low <= location <= high)
        return float(ndtr((high - location) / scale) - ndtr((low - location) / scale))


def _twice(values: Sequence[Any]) -> Any:
    """The first value that was there before: 1 and 1.0 are one. None: all differ."""
    seen: set[Any] = set()
    for value in values:
        same = (float(value),) if _is_number(value) and abs(value) < 2**53 else written(value)
        if same in seen:
            return value
        seen.add(same)
    return None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _plain(value: Any) -> Any:
    """A choice as TOML had it: lists in place of tuples."""
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value
