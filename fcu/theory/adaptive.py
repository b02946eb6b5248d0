"""Prediction model, control and adaptive laws: Section III, for the plant of `systems`.

The predictor is written with the measured state and a matrix gain L,

    x_hat' = A x + B r + B { Lambda_hat (u + Theta_hat f + d_hat) + C_hat phi + s_hat + kappa }
             + L x_til

which is the paper's (5) for L = k I - A: A x_hat + k x_til = A x + (k I - A) x_til. The
octocopter's predictors have L = k I. What the proof needs of L and P is L^T P + P L > 0.

Nothing here asks where f, phi and kappa come from, so a loop whose regressor holds an estimate
(the printed Section VII) is an instance too: `octocopter`.
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
    """What a prediction model is told. Paper (5), (10).

    A, P, L : (..., n, n).  B : (..., n, q).  Raises AssumptionError unless P and
    L^T P + P L are positive definite: without that V (15) need not fall.
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
        """L^T P + P L (..., n, n): V' = -x_til^T of this x_til, and Q + 2 k P for the paper's L."""
        PL = self.P @ self.L
        return PL + transposed(PL)

    def y_til(self, x_til: Array) -> Array:
        """B^T P x_til: (..., n) to (..., q)."""
        return transposed_times(self.B, times(self.P, x_til))


def predictor(reference: ReferenceModel, k: Array | float) -> Predictor:
    """The paper's predictor of a reference model: L = k I - A, k (...) above 0. Paper (5)."""
    gain = np.asarray(k, dtype=float)
    if np.any(gain <= 0.0):
        raise AssumptionError(f"k: must be above 0, got {k}")
    L = gain[..., None, None] * np.eye(reference.n) - reference.A
    return Predictor(reference.A, reference.B, reference.P, L)


class Estimates(NamedTuple):
    """What is estimated, as it is stored: a matrix by its `Structure`, (..., i, j).

    Full (..., q, p); diagonal (..., q, 1); scalar (..., 1, 1); d and s (..., q, 1).
    None for what is not there.
    """

    Lambda: Array
    Theta: Array | None = None
    d: Array | None = None
    C: Array | None = None
    s: Array | None = None


@dataclass(frozen=True)
class Block:
    """How one unknown is adapted: its gain gamma (...), above 0; its set; its form.

    The set bounds the estimate as it is stored.
    """

    gamma: Array | float
    kept_in: Set
    structure: Structure = Structure.FULL

    def __post_init__(self) -> None:
        if not np.all(np.asarray(self.gamma) > 0.0):
            raise AssumptionError(f"gamma: must be above 0, got {self.gamma}; None for no block")

    def rate(self, stored: Array, Y: Array) -> Array:
        """gamma Pr(estimate, Y) for the unknowns of the form: as stored. Paper (10)."""
        gamma = np.asarray(self.gamma)[..., None, None]
        return np.asarray(gamma * self.kept_in.rate(stored, gathered(Y, self.structure)))  # (10)


def gathered(Y: Array, structure: Structure) -> Array:
    """What Y (..., q, p) says of the unknowns of a form: (..., q, p), (..., q, 1), (..., 1, 1)."""
    if structure is Structure.FULL:
        return Y
    diagonal = np.diagonal(Y, axis1=-2, axis2=-1)[..., None]
    if structure is Structure.DIAGONAL:
        return diagonal
    return np.asarray(diagonal.sum(axis=-2, keepdims=True))


def written_out(block: Block | None, stored: Array, q: int) -> Array:
    """A stored estimate as the matrix it stands for; one without a block is stored in full."""
    if block is None or block.structure is Structure.FULL:
        return stored
    return stored * np.eye(q)


@dataclass(frozen=True)
class Laws:
    """The adaptive laws (10), a block for each unknown; None for what is not adapted.

    weight : the form of the true Lambda, by which V weighs the errors of Theta and d. Raises
    ProjectionError where a set is not sound for it, unless `unsound` is set (for counterexamples).
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
        """Estimates put back into their (outer) sets, after a step of a fixed size."""

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
        """Estimates with every matrix written out: Lambda (..., q, q), Theta (..., q, p)."""
        Lambda, Theta, d, C, s = stored
        return Estimates(
            written_out(self.Lambda, Lambda, q),
            None if Theta is None else written_out(self.Theta, Theta, q),
            d,
            None if C is None else written_out(self.C, C, q),
            s,
        )


class Known(NamedTuple):
    """What is measured or known at an instant; None for what a system does not have."""

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
    """v (..., q). What acts beside Lambda is divided by Lambda_hat. Paper (26)."""
    q = known.r.shape[-1]
    demand = -inside(full, known, np.zeros(q))  # (26)
    if full.C is None and full.s is None and known.kappa is None:
        return demand
    return demand - solve(full.Lambda, beside(full, known))


def prediction_rate(
    told: Predictor, full: Estimates, known: Known, x_til: Array, u: Array
) -> Array:
    """x_hat' (..., n), predicted with u: achieved, (5) and (9); demanded, (8). Paper (5)."""
    matched = times(full.Lambda, inside(full, known, u)) + beside(full, known)
    own = times(told.A, known.x) + times(told.B, known.r + matched)
    return own + times(told.L, x_til)  # (5)


def estimate_rates(
    laws: Laws, stored: Estimates, full: Estimates, known: Known, y_til: Array, u: Array
) -> Estimates:
    """The rates of the estimates, as they are stored; 0 where one is not adapted. Paper (10)."""
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
    """V (...), with each block's own gain in place of the one gamma. Paper (15).

    Lambda : the true one, (..., q, q).  errors : truth minus estimate, written out; those of an
    unknown that is not adapted do not count. For one unknown times the identity its error
    counts once, not q times.
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
