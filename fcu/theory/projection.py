"""The projection Pr of the adaptive laws (10): limits the rate of an estimate to keep it in a set.

An estimate is a matrix (..., i, j); a vector is a matrix with one column. A set is a ball of the
Frobenius norm or a box. With `margin` above zero Pr is the smooth projection of Pomet and Praly: it
starts to act at the boundary of the set and acts fully at the boundary of a slightly larger outer
set, which the estimate never leaves. The bounds of Section IV must be those of the outer set. With
`margin` zero Pr is hard: at the boundary it removes the outward part of the rate, and after an
integration step `hold` clips the estimate to the set.

The proofs need this property of Pr. V (15) weights the error of an estimate with W, and

    tr(error^T W (Y - Pr(estimate, Y))) <= 0    while the true value is in the set.

W is Lambda for Theta and d, and the identity for Lambda itself and for unknowns outside Lambda.
`sound` tells which set has this property for which W.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from fcu.theory.arrays import Array, frobenius, inner

MARGIN = 0.1  # default of both sets: smooth, with an outer set a tenth larger


class ProjectionError(ValueError):
    """An invalid set, or a set that is not sound for a weight; the message names a valid choice."""


class Structure(Enum):
    """Known structure of a matrix: of Lambda, or of an estimated unknown."""

    SCALAR = "scalar"  # a multiple of the identity: one unknown
    DIAGONAL = "diagonal"
    FULL = "full"


@dataclass(frozen=True)
class Ball:
    """All matrices of Frobenius norm at most `radius`.

    radius : (...), above 0.  margin : outer radius over radius, minus one; 0 for a hard projection.
    metric : (..., i, i), the weight W if it is known, or None. With a metric, Pr removes the
    outward part along W^-1 times the estimate instead of along the estimate, which is sound for
    every W.
    """

    radius: Array | float
    margin: float = MARGIN
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
        """(...), largest Frobenius norm of an estimate."""
        return np.asarray(self.radius) * (1.0 + self.margin)

    def farthest(self, size: Array | float) -> Array:
        """Bound (...) of |truth - estimate| (Frobenius norm) for a truth of norm `size` (...)."""
        return np.asarray(size + self.outer_radius)

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
        """An estimate (..., i, j), scaled down to the outer ball if it is outside."""
        norm = frobenius(estimate)
        shrink = np.minimum(1.0, self.outer_radius / np.maximum(norm, 1e-300))
        return estimate * shrink[..., None, None]

    def contains(self, estimate: Array) -> Array:
        """bool (...): whether the estimate is in the set itself, not only in the outer set."""
        return np.asarray(frobenius(estimate) <= self.radius)


@dataclass(frozen=True)
class Box:
    """All matrices between `low` and `high`, component by component.

    low, high : (..., i, j); equal for a known component.  margin : additional width of the outer
    box over the width of the box; 0 for a hard projection.
    """

    low: Array
    high: Array
    margin: float = MARGIN

    def __post_init__(self) -> None:
        if not np.all(self.low <= self.high):
            raise ProjectionError("box: low must not be above high in any component")
        if self.margin < 0.0:
            raise ProjectionError(f"box: margin must be 0 (hard) or above, got {self.margin}")

    @property
    def outer_low(self) -> Array:
        """(..., i, j), lower bounds of the components of an estimate."""
        return self.low - 0.5 * self.margin * (self.high - self.low)

    @property
    def outer_high(self) -> Array:
        """(..., i, j), upper bounds of the components of an estimate."""
        return self.high + 0.5 * self.margin * (self.high - self.low)

    @property
    def outer_radius(self) -> Array:
        """(...), Frobenius norm of the farthest corner of the outer box."""
        return frobenius(np.maximum(np.abs(self.outer_low), np.abs(self.outer_high)))

    def farthest(self, size: Array | float) -> Array:
        """Bound (...) of |truth - estimate| (Frobenius norm) for a truth of norm `size` (...)."""
        return np.asarray(size + self.outer_radius)

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
        """An estimate, clipped to the outer box: (..., i, j)."""
        return np.minimum(np.maximum(estimate, self.outer_low), self.outer_high)

    def contains(self, estimate: Array) -> Array:
        """bool (...): whether the estimate is in the box itself, not only in the outer box."""
        return np.asarray(((self.low <= estimate) & (estimate <= self.high)).all(axis=(-2, -1)))


def _share(past: Array, edge: Array) -> Array:
    """0 inside to 1 at the outer edge; `past`: excess over the inner edge. Hard if `edge` is 0."""
    smooth = np.clip(past / np.where(edge > 0.0, edge, 1.0), 0.0, 1.0)
    return np.where(edge > 0.0, smooth, np.where(past >= 0.0, 1.0, 0.0))


Set = Ball | Box


def symmetric_box(half_width: Array, margin: float = MARGIN) -> Box:
    """The box of components with absolute values of at most `half_width` (..., i, j)."""
    return Box(-half_width, np.asarray(half_width), margin)


def sound(kept_in: Set, weight: Structure, scalar_unknown: bool = False) -> bool:
    """Whether Pr onto this set never increases V (15), for a weight of this structure.

    A ball shrinks an estimate along its own direction, which a matrix weight rotates: a ball is
    sound only for a multiple of the identity. A box acts on each component separately and is sound
    for every diagonal weight. For a full weight only a ball with the weight as its metric is sound,
    and the weight is rarely known: the products with Lambda, estimated outside it, have the identity
    as their weight. For one unknown (`scalar_unknown`) every set is an interval.
    """
    if scalar_unknown or weight is Structure.SCALAR:
        return True
    if isinstance(kept_in, Ball) and kept_in.metric is not None:
        return True
    return isinstance(kept_in, Box) and weight is Structure.DIAGONAL


def require_sound(name: str, kept_in: Set, weight: Structure, scalar_unknown: bool = False) -> None:
    """Raise ProjectionError, which names a sound set, unless `sound`."""
    if sound(kept_in, weight, scalar_unknown):
        return
    instead = "a box" if weight is Structure.DIAGONAL else "a ball with Lambda as its metric"
    kind = type(kept_in).__name__.lower()
    raise ProjectionError(
        f"{name}: Pr of a {kind} can raise V where Lambda is {weight.value}; use {instead}"
    )
