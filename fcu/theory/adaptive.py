"""Prediction model, control and adaptive laws of Section III, for the plant of `systems`.

The predictor uses the measured state and a matrix gain L,

    x_hat' = A x + B r + B { Lambda_hat (u + Theta_hat f + d_hat) + C_hat phi + s_hat + kappa }
             + L x_til

which equals the paper's (5) for L = k I - A: A x_hat + k x_til = A x + (k I - A) x_til. The
predictors of the octocopter have L = k I. The proof needs L^T P + P L > 0.

This module makes no assumption about f, phi and kappa. A loop whose regressor contains an estimate
(the printed Section VII) is therefore also an instance: see `octocopter`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fcu.theory.arrays import Array, inner, outer, times, transposed, transposed_times
from fcu.theory.projection import Set, Structure, require_sound
from fcu.theory.systems import (
    AssumptionError,
    ReferenceModel,
    require_positive_definite,
    solve,
)


@dataclass(frozen=True)
class Predictor:
    """Parameters of a prediction model. Paper (5), (10).

    A, P, L : (..., n, n).  B : (..., n, q).  Raises AssumptionError unless P and
    L^T P + P L are positive definite: otherwise V (15) need not decrease.
    """

    A: Array
    B: Array
    P: Array
    L: Array

    def __post_init__(self) -> None:
        require_positive_definite("P", self.P)
        require_positive_definite("L^T P + P L", self.dissipation)

    @property
    def dissipation(self) -> Array:
        """D = L^T P + P L (..., n, n): V' = -x_til^T D x_til. For the paper's L, D = Q + 2 k P."""
        PL = self.P @ self.L
        return PL + transposed(PL)

    def y_til(self, x_til: Array) -> Array:
        """B^T P x_til: (..., n) to (..., q)."""
        return transposed_times(self.B, times(self.P, x_til))


def predictor(reference: ReferenceModel, k: Array | float) -> Predictor:
    """The paper's predictor for a reference model: L = k I - A, with k (...) above 0. Paper (5)."""
    gain = np.asarray(k, dtype=float)
    if np.any(gain <= 0.0):
        raise AssumptionError(f"k: must be above 0, got {k}")
    L = gain[..., None, None] * np.eye(reference.n) - reference.A
    return Predictor(reference.A, reference.B, reference.P, L)


class Estimates(NamedTuple):
    """The estimates as stored: each matrix (..., i, j) by its `Structure`.

    Full (..., q, p); diagonal (..., q, 1); scalar (..., 1, 1); d and s (..., q, 1).
    None for an unknown that the system does not have.
    """

    Lambda: Array
    Theta: Array | None = None
    d: Array | None = None
    C: Array | None = None
    s: Array | None = None


@dataclass(frozen=True)
class Block:
    """Adaptation of one unknown: gain gamma (...) above 0, projection set and structure.

    The set bounds the estimate as stored.
    """

    gamma: Array | float
    kept_in: Set
    structure: Structure = Structure.FULL

    def __post_init__(self) -> None:
        if not np.all(np.asarray(self.gamma) > 0.0):
            raise AssumptionError(f"gamma: must be above 0, got {self.gamma}; None for no block")

    def rate(self, stored: Array, Y: Array) -> Array:
        """Rate of the estimate as stored: gamma Pr(estimate, Y). Paper (10)."""
        gamma = np.asarray(self.gamma)[..., None, None]
        return np.asarray(gamma * self.kept_in.rate(stored, gathered(Y, self.structure)))  # (10)


def gathered(Y: Array, structure: Structure) -> Array:
    """Y (..., q, p) reduced to a structure: (..., q, p), (..., q, 1) or (..., 1, 1)."""
    if structure is Structure.FULL:
        return Y
    diagonal = np.diagonal(Y, axis1=-2, axis2=-1)[..., None]
    if structure is Structure.DIAGONAL:
        return diagonal
    return np.asarray(diagonal.sum(axis=-2, keepdims=True))


def written_out(block: Block | None, stored: Array, q: int) -> Array:
    """A stored estimate as a full matrix; an estimate without a block is stored in full."""
    if block is None or block.structure is Structure.FULL:
        return stored
    return stored * np.eye(q)


@dataclass(frozen=True)
class Laws:
    """The adaptive laws (10): one block per unknown, None for an unknown that is not adapted.

    weight : structure of the true Lambda, with which V weights the errors of Theta and d. Raises
    ProjectionError if a set is not sound for it, unless `unsound` is set (for counterexamples).
    """

    Lambda: Block | None
    Theta: Block | None = None
    d: Block | None = None
    C: Block | None = None
    s: Block | None = None
    weight: Structure = Structure.FULL
    unsound: bool = False

    def __post_init__(self) -> None:
        for name, block in (("Theta_hat", self.Theta), ("d_hat", self.d)):
            if block is not None and not self.unsound:
                one = block.structure is Structure.SCALAR
                require_sound(name, block.kept_in, self.weight, one)

    @property
    def blocks(self) -> tuple[Block | None, ...]:
        """The blocks in the order of Estimates."""
        return self.Lambda, self.Theta, self.d, self.C, self.s

    def hold(self, stored: Estimates) -> Estimates:
        """Estimates clipped to their (outer) sets, after an integration step."""

        def held(block: Block | None, estimate: Array) -> Array:
            return estimate if block is None else block.kept_in.hold(estimate)

        Lambda, Theta, d, C, s = stored
        return Estimates(
            held(self.Lambda, Lambda),
            None if Theta is None else held(self.Theta, Theta),
            None if d is None else held(self.d, d),
            None if C is None else held(self.C, C),
            None if s is None else held(self.s, s),
        )

    def full(self, stored: Estimates, q: int) -> Estimates:
        """Estimates with full matrices: Lambda (..., q, q), Theta (..., q, p)."""
        Lambda, Theta, d, C, s = stored
        return Estimates(
            written_out(self.Lambda, Lambda, q),
            None if Theta is None else written_out(self.Theta, Theta, q),
            d,
            None if C is None else written_out(self.C, C, q),
            s,
        )


class Known(NamedTuple):
    """Measured or known signals at one time; None for a signal that the system does not have."""

    x: Array  # (..., n)
    r: Array  # (..., q)
    f: Array | None = None  # (..., p)
    phi: Array | None = None  # (..., c)
    kappa: Array | None = None  # (..., q)


def inside(full: Estimates, known: Known, u: Array) -> Array:
    """u + Theta_hat f + d_hat (..., q): the regressor of Lambda_hat. Paper (10)."""
    total = u
    if full.Theta is not None and known.f is not None:
        total = total + times(full.Theta, known.f)
    if full.d is not None:
        total = total + full.d[..., 0]
    return total


def beside(full: Estimates, known: Known) -> Array:
    """C_hat phi + s_hat + kappa (..., q)."""
    total = np.zeros_like(known.r)
    if full.C is not None and known.phi is not None:
        total = total + times(full.C, known.phi)
    if full.s is not None:
        total = total + full.s[..., 0]
    if known.kappa is not None:
        total = total + known.kappa
    return total


def control(full: Estimates, known: Known) -> Array:
    """v (..., q). The terms outside Lambda are divided by Lambda_hat. Paper (26)."""
    q = known.r.shape[-1]
    demand = -inside(full, known, np.zeros(q))  # (26)
    if full.C is None and full.s is None and known.kappa is None:
        return demand
    return demand - solve(full.Lambda, beside(full, known))


def prediction_rate(
    told: Predictor, full: Estimates, known: Known, x_til: Array, u: Array
) -> Array:
    """x_hat' (..., n), predicted with u: achieved in (5) and (9), demanded in (8). Paper (5)."""
    matched = times(full.Lambda, inside(full, known, u)) + beside(full, known)
    own = times(told.A, known.x) + times(told.B, known.r + matched)
    return own + times(told.L, x_til)  # (5)


def estimate_rates(
    laws: Laws, stored: Estimates, full: Estimates, known: Known, y_til: Array, u: Array
) -> Estimates:
    """Rates of the estimates as stored; 0 for an estimate that is not adapted. Paper (10)."""
    column = y_til[..., None]

    def rate(block: Block | None, estimate: Array, regressor: Array | None) -> Array:
        if block is None:
            return np.zeros_like(estimate)
        Y = column if regressor is None else outer(y_til, regressor)
        return block.rate(estimate, Y)

    return Estimates(
        rate(laws.Lambda, stored.Lambda, inside(full, known, u)),
        None if stored.Theta is None else rate(laws.Theta, stored.Theta, known.f),
        None if stored.d is None else rate(laws.d, stored.d, None),
        None if stored.C is None else rate(laws.C, stored.C, known.phi),
        None if stored.s is None else rate(laws.s, stored.s, None),
    )


def lyapunov(told: Predictor, laws: Laws, Lambda: Array, x_til: Array, errors: Estimates) -> Array:
    """V (...), with the gain of each block instead of a common gamma. Paper (15).

    Lambda : true value, (..., q, q).  errors : true value minus estimate, as full matrices. Errors
    of unknowns that are not adapted do not count. The error of a scalar unknown (times the
    identity) counts once, not q times.
    """
    V = (x_til * times(told.P, x_til)).sum(axis=-1)
    q = Lambda.shape[-1]
    for block, error, weighed in zip(
        laws.blocks, errors, (False, True, True, False, False), strict=True
    ):
        if block is None or error is None:
            continue
        squared = inner(error, Lambda @ error if weighed else error)
        counted = q if block.structure is Structure.SCALAR else 1
        V = V + squared / (counted * np.asarray(block.gamma))  # (15)
    return np.asarray(V)
