"""Reference model, uncertainty, actuator and plant of Sections II and V, for any n, q, p.

The plant is that of the paper, (3), with three additional terms outside Lambda that the octocopter
needs: a regressor phi with unknown C, a disturbance s, and a known term kappa,

    x' = A x + B r + B { Lambda (u + Theta f + d) + C phi + s + kappa }

Shapes: x n, u and r q, f p, phi c; every array may have leading axes (`arrays`). Bounds are in the
Frobenius norm: the proof of (14) contains tr(X^T Y), which no smaller norm bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from fcu.theory.arrays import Array, frobenius, times, transposed
from fcu.theory.projection import Structure

Signal = Callable[[float], Array]  # t (s) -> (..., q)
Regressor = Callable[[Array, Array], Array]  # x (..., n), r (..., q) -> (..., p)
Actuator = Callable[[Array, Array], Array]  # x (..., n), v (..., q) -> u (..., q)


class AssumptionError(ValueError):
    """A system violates an assumption of Section II; the message says which, and by how much."""


@dataclass(frozen=True)
class ReferenceModel:
    """x_m' = A x_m + B r, with P from A^T P + P A = -Q. Paper (1).

    A : (..., n, n), Hurwitz.  B : (..., n, q).  Q : (..., n, n), symmetric, positive definite.
    Raises AssumptionError for other shapes or properties.
    """

    A: Array
    B: Array
    Q: Array
    P: Array = field(init=False)  # (..., n, n), symmetric, positive definite

    def __post_init__(self) -> None:
        n = self.A.shape[-1]
        for name, array, shape in (
            ("A", self.A, (n, n)),
            ("Q", self.Q, (n, n)),
            ("B", self.B, (n, self.B.shape[-1])),
        ):
            if array.shape[-2:] != shape:
                raise AssumptionError(f"{name}: expected shape (..., {shape}), got {array.shape}")
        slowest = np.linalg.eigvals(self.A).real.max()
        if slowest >= 0.0:
            raise AssumptionError(
                f"A: must be Hurwitz, but an eigenvalue has real part {slowest:.3g}"
            )
        require_positive_definite("Q", self.Q)
        batch = np.broadcast_shapes(self.A.shape[:-2], self.Q.shape[:-2])
        A, Q = (np.broadcast_to(M, (*batch, n, n)) for M in (self.A, self.Q))
        P = np.empty((*batch, n, n))
        for index in np.ndindex(batch):
            solved = solve_continuous_lyapunov(A[index].T, -Q[index])
            P[index] = 0.5 * (solved + solved.T)
        object.__setattr__(self, "P", P)

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.A.shape[-1])

    @property
    def q(self) -> int:
        """Number of inputs."""
        return int(self.B.shape[-1])

    def rate(self, x_m: Array, r: Array) -> Array:
        """(..., n). Paper (1)."""
        return times(self.A, x_m) + times(self.B, r)  # (1)


def require_positive_definite(name: str, M: Array) -> None:
    """Raise AssumptionError unless M (..., n, n) is symmetric and positive definite."""
    scale = np.abs(M).max(initial=1e-300)
    if np.abs(M - transposed(M)).max(initial=0.0) > 1e-9 * scale:
        raise AssumptionError(f"{name}: must be symmetric")
    least = np.linalg.eigvalsh(M).min()
    if least <= 0.0:
        raise AssumptionError(f"{name}: must be positive definite, least eigenvalue {least:.3g}")


@dataclass(frozen=True)
class Varying:
    """An unknown as a function of time, with the bounds of (4).

    value : t -> (..., i, j), a vector has one column.  bound : (...), of the Frobenius norm.
    rate_bound : (...), of the Frobenius norm of the time derivative.
    """

    value: Signal
    bound: Array
    rate_bound: Array


def constant(value: Array) -> Varying:
    """A constant unknown (..., i, j); its bound is its norm."""
    fixed = np.asarray(value, dtype=float)
    norm = frobenius(fixed)
    return Varying(lambda t: fixed, norm, np.zeros_like(norm))


def swinging(
    mean: Array, amplitude: Array | float, omega: Array | float, phase: Array | float = 0.0
) -> Varying:
    """mean + amplitude sin(omega t + phase), by component; mean is (..., i, j)."""
    mean, amplitude, omega, phase = np.broadcast_arrays(mean, amplitude, omega, phase)
    return Varying(
        lambda t: mean + amplitude * np.sin(omega * t + phase),
        frobenius(np.abs(mean) + np.abs(amplitude)),
        frobenius(np.abs(amplitude * omega)),
    )


@dataclass(frozen=True)
class Uncertainty:
    """The unknowns of a system. Paper (4); C and s are added for the octocopter.

    Lambda : (..., q, q), symmetric, positive definite.  Lambda_min : (...), lower bound of its
    smallest eigenvalue at all times; the paper's (4) has none, but (24), (25), (31) need one.
    structure : structure of Lambda.  Theta : (..., q, p).  d, s : (..., q, 1).  C : (..., q, c).
    None for an unknown that the system does not have. Raises AssumptionError if Lambda(0) violates
    Lambda_min or the structure.
    """

    Lambda: Varying
    Lambda_min: Array
    structure: Structure = Structure.FULL
    Theta: Varying | None = None
    d: Varying | None = None
    C: Varying | None = None
    s: Varying | None = None

    def __post_init__(self) -> None:
        Lambda = self.Lambda.value(0.0)
        require_positive_definite("Lambda(0)", Lambda)
        if np.any(np.asarray(self.Lambda_min) <= 0.0):
            raise AssumptionError("Lambda_min: must be above 0")
        least = np.linalg.eigvalsh(Lambda)[..., 0]
        if np.any(least < np.asarray(self.Lambda_min) * (1.0 - 1e-12)):
            raise AssumptionError("Lambda_min: Lambda(0) has a smaller eigenvalue")
        eye = np.eye(Lambda.shape[-1])
        allowed = {
            Structure.SCALAR: Lambda[..., :1, :1] * eye,
            Structure.DIAGONAL: Lambda * eye,
            Structure.FULL: Lambda,
        }
        if not np.array_equal(Lambda, allowed[self.structure]):
            raise AssumptionError(f"Lambda(0): declared {self.structure.value} but is not")


@dataclass(frozen=True)
class Limits:
    """The actuator of the paper: limits each channel to `low` to `high` (..., q). Section II."""

    low: Array
    high: Array

    def __post_init__(self) -> None:
        if not np.all(self.low < self.high):
            raise AssumptionError("limits: low must be below high in every channel")

    def __call__(self, x: Array, v: Array) -> Array:
        """u = h(x, v) (..., q), independent of x."""
        return sat(v, self)


def symmetric(v_star: Array) -> Limits:
    """The limits -v_star and v_star (..., q)."""
    return Limits(-np.asarray(v_star, dtype=float), np.asarray(v_star, dtype=float))


def sat(v: Array, limits: Limits) -> Array:
    """v (..., q) with each channel clipped to its limits. Paper Section II."""
    return np.minimum(np.maximum(v, limits.low), limits.high)


def unlimited(x: Array, v: Array) -> Array:
    """An actuator without limits: u = v."""
    return v


@dataclass(frozen=True)
class Plant:
    """x' = A x + B r + B { Lambda (u + Theta f + d) + C phi + s + kappa }, u = h(x, v).

    f, phi : regressors (x, r) -> (..., p), (..., c); None if `truth` has no Theta, no C.
    kappa : (x, r) -> (..., q), a known term, or None.
    r : t -> (..., q).  actuator : (x, v) -> u. Paper (2), (3).
    """

    reference: ReferenceModel
    truth: Uncertainty
    r: Signal
    f: Regressor | None = None
    phi: Regressor | None = None
    kappa: Regressor | None = None
    actuator: Actuator = unlimited

    def __post_init__(self) -> None:
        for name, unknown, regressor in (
            ("Theta and f", self.truth.Theta, self.f),
            ("C and phi", self.truth.C, self.phi),
        ):
            if (unknown is None) != (regressor is None):
                raise AssumptionError(f"{name}: give both or neither")

    def inside(self, t: float, x: Array, r: Array) -> Array:
        """Theta f + d (..., q): the unknown terms inside Lambda, in units of the input."""
        truth, total = self.truth, np.zeros(self.reference.q)
        if truth.Theta is not None and self.f is not None:
            total = total + times(truth.Theta.value(t), self.f(x, r))
        if truth.d is not None:
            total = total + truth.d.value(t)[..., 0]
        return total

    def beside(self, t: float, x: Array, r: Array) -> Array:
        """C phi + s + kappa (..., q): the terms outside Lambda."""
        truth, total = self.truth, np.zeros(self.reference.q)
        if truth.C is not None and self.phi is not None:
            total = total + times(truth.C.value(t), self.phi(x, r))
        if truth.s is not None:
            total = total + truth.s.value(t)[..., 0]
        if self.kappa is not None:
            total = total + self.kappa(x, r)
        return total

    def rate(self, t: float, x: Array, u: Array, r: Array) -> Array:
        """(..., n). Paper (3)."""
        matched = times(self.truth.Lambda.value(t), u + self.inside(t, x, r))
        known = self.reference.rate(x, r)
        return known + times(self.reference.B, matched + self.beside(t, x, r))  # (3)

    def known_control(self, t: float, x: Array, r: Array) -> Array:
        """v_0 (..., q), the known control, with which x follows (1). Paper (21)."""
        Lambda, beside = self.truth.Lambda.value(t), self.beside(t, x, r)
        return -self.inside(t, x, r) - solve(Lambda, beside)  # (21)


def solve(Lambda: Array, y: Array) -> Array:
    """Lambda^-1 y: (..., q, q) and (..., q) to (..., q)."""
    if not y.any():
        return y
    return np.asarray(np.linalg.solve(Lambda, y[..., None])[..., 0], dtype=np.float64)
