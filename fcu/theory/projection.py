"""The projection Pr of the adaptive laws (10): the rate of an estimate, held to a set.

An estimate is a matrix (..., i, j); a vector is a matrix of one column. A set is a ball of the
Frobenius norm or a box. With `margin` above zero Pr is the smooth one of Pomet and Praly: it
begins at the edge of the set and is complete at the edge of a slightly larger outer set, which
the estimate never leaves. The bounds of Section IV must be those of the outer set. With
`margin` zero Pr is hard: a rate that points out of the set loses that part at the edge, and
after a step of a fixed size `hold` puts the estimate back.

What the proofs need of Pr: V (15) weighs the error of an estimate by W, and

    tr(error^T W (Y - Pr(estimate, Y))) <= 0    while the truth is in the set.

W is Lambda for Theta and d, and the identity for Lambda itself and for what acts beside it.
`sound` says which set has this property for which W.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from fcu.theory.arrays import Array, frobenius, inner


class ProjectionError(ValueError):
    """A set, or a set and a weight, that cannot be used: what is wrong and what to use."""


class Structure(Enum):
    """What is known of the form of a matrix: of Lambda, or of an unknown that is estimated."""

    SCALAR = "scalar"  # a multiple of the identity: one unknown
    DIAGONAL = "diagonal"
    FULL = "full"


@dataclass(frozen=True)
class Ball:
    """All matrices of Frobenius norm at most `radius`.

    radius : (...), above 0.  margin : outer radius over radius, less one; 0 for hard.
    metric : (..., i, i), the weight W if it is known, or None. Pr then takes away what points out
    along W^-1 times the estimate instead of along the estimate, which is sound for every W.
    """

    radius: Array | float
    margin: float = 0.1
    metric: Array | None = None

    def __post_init__(self) -> None:
        if not np.all(np.asarray(self.radius) > 0.0):
            raise ProjectionError(f"ball: radius must be above 0, got {self.radius}")
        if self.margin < 0.0:
            raise ProjectionError(f"ball: margin must be 0 (hard) or above, got {self.margin}")
        if self.metric is not None and self.margin == 0.0:
            raise ProjectionError("ball: with a metric Pr must be smooth; give a margin above 0")

    @property
    def outer_radius(self) -> Array:
        """(...), the Frobenius norm that an estimate never exceeds."""
        return np.asarray(self.radius) * (1.0 + self.margin)

    def rate(self, estimate: Array, Y: Array) -> Array:
        """Pr(estimate, Y): (..., i, j)."""
        R, R_outer = np.asarray(self.radius), self.outer_radius
        squared = inner(estimate, estimate)
        if self.margin > 0.0:
            share = np.clip((squared - R * R) / (R_outer * R_outer - R * R), 0.0, 1.0)
        else:
            share = np.where(squared >= R * R, 1.0, 0.0)
        if not share.any():
            return Y
        away = estimate
        if self.metric is not None:
            away = np.asarray(np.linalg.solve(self.metric, estimate), dtype=np.float64)
        outward = np.maximum(inner(estimate, Y), 0.0) / np.where(
            share > 0.0, inner(estimate, away), 1.0
        )
        return np.asarray(Y - (share * outward)[..., None, None] * away)

    def hold(self, estimate: Array) -> Array:
        """An estimate (..., i, j) put back on the outer ball, along itself, if it is outside."""
        norm = frobenius(estimate)
        shrink = np.minimum(1.0, self.outer_radius / np.maximum(norm, 1e-300))
        return estimate * shrink[..., None, None]

    def contains(self, estimate: Array) -> Array:
        """bool (...): in the set itself, not only in the outer one."""
        return np.asarray(frobenius(estimate) <= self.radius)


@dataclass(frozen=True)
class Box:
    """All matrices between `low` and `high`, component by component.

    low, high : (..., i, j); equal where a component is known.  margin : by how much the outer box
    is wider, over the width; 0 for hard.
    """

    low: Array
    high: Array
    margin: float = 0.1

    def __post_init__(self) -> None:
        if not np.all(self.low <= self.high):
            raise ProjectionError("box: low must not be above high in any component")
        if self.margin < 0.0:
            raise ProjectionError(f"box: margin must be 0 (hard) or above, got {self.margin}")

    @property
    def outer_low(self) -> Array:
        """(..., i, j), what no component of an estimate falls below."""
        return self.low - 0.5 * self.margin * (self.high - self.low)

    @property
    def outer_high(self) -> Array:
        """(..., i, j), what no component of an estimate exceeds."""
        return self.high + 0.5 * self.margin * (self.high - self.low)

    @property
    def outer_radius(self) -> Array:
        """(...), the Frobenius norm of the outer box's farthest corner."""
        return frobenius(np.maximum(np.abs(self.outer_low), np.abs(self.outer_high)))

    def rate(self, estimate: Array, Y: Array) -> Array:
        """Pr(estimate, Y): (..., i, j)."""
        over, under = estimate - self.high, self.low - estimate
        if max(over.max(), under.max()) < 0.0:
            return Y
        edge = 0.5 * self.margin * (self.high - self.low)
        above = np.where(Y > 0.0, _share(over, edge), 0.0)
        below = np.where(Y < 0.0, _share(under, edge), 0.0)
        return np.asarray(Y * (1.0 - above - below))

    def hold(self, estimate: Array) -> Array:
        """The point of the outer box that is nearest to an estimate: (..., i, j)."""
        return np.minimum(np.maximum(estimate, self.outer_low), self.outer_high)

    def contains(self, estimate: Array) -> Array:
        """bool (...): in the box itself, not only in the outer one."""
        return np.asarray(((self.low <= estimate) & (estimate <= self.high)).all(axis=(-2, -1)))


def _share(past: Array, edge: Array) -> Array:
    """From 0 inside to 1 at the outer edge, for components `past` the inner one; hard if no edge."""
    smooth = np.clip(past / np.where(edge > 0.0, edge, 1.0), 0.0, 1.0)
    return np.where(edge > 0.0, smooth, np.where(past >= 0.0, 1.0, 0.0))


Set = Ball | Box


def symmetric_box(half_width: Array, margin: float = 0.1) -> Box:
    """The box of components at most `half_width` (..., i, j) in absolute value."""
    return Box(-half_width, np.asarray(half_width), margin)


def sound(kept_in: Set, weight: Structure, scalar_unknown: bool = False) -> bool:
    """Whether Pr of this set never raises V (15) when V weighs the error by such a matrix.

    A ball shrinks an estimate along itself, a direction that a matrix weight turns: it is sound
    only for a multiple of the identity. A box acts on each component alone, which any diagonal
    weight leaves alone. For a full one only a ball with the weight as its metric is, and the
    weight is seldom known. For one unknown (`scalar_unknown`) every set is an interval.
    """
    if scalar_unknown or weight is Structure.SCALAR:
        return True
    if isinstance(kept_in, Ball) and kept_in.metric is not None:
        return True
    return isinstance(kept_in, Box) and weight is Structure.DIAGONAL


def require_sound(name: str, kept_in: Set, weight: Structure, scalar_unknown: bool = False) -> None:
    """Raise ProjectionError, with what to use instead, unless `sound`."""
    if sound(kept_in, weight, scalar_unknown):
        return
    instead = "a box" if weight is Structure.DIAGONAL else "a ball with Lambda as its metric"
    kind = type(kept_in).__name__.lower()
    raise ProjectionError(
        f"{name}: Pr of a {kind} can raise V where Lambda is {weight.value}; use {instead}"
    )
