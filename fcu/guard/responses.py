"""Upper bounds of the response of a stable linear system: peaks and L1 gains.

For X(t) = C exp(M t) E this module bounds the largest norm, weighted by e^(rate t), and the
integral of the norm. A norm is convex, so between two grid points it lies below the straight line
through its values there, plus h^2/8 times the largest |X''|. A grid of values therefore gives an
upper bound, not an estimate, but for rounding, which is not bounded here: relative to X, about 1e-16
times the condition number of the eigenvectors, which are used up to WELL_CONDITIONED. The grid is so
fine that a peak exceeds the true value by TOLERANCE at most, and a gain by a few times TOLERANCE. The
remaining modes bound X after the last grid point.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.linalg import expm, matrix_balance, solve_continuous_lyapunov

Matrix = np.ndarray[Any, np.dtype[np.float64]]
Norm = Literal["spectral", "entries"]

TOLERANCE = 2e-4  # of a peak or a gain, relative
POINTS = 200_000  # most grid points per time interval
WELL_CONDITIONED = (
    1e6  # largest condition number of the eigenvectors; above it use the matrix exponential
)


class UnstableError(ValueError):
    """A system without a bound. The message has its slowest rate and the requested rate."""


class _Stretch(NamedTuple):
    """Norms of X on a grid over a time interval, the grid step, and the largest |X''| there."""

    norms: Matrix  # times x 1 x 1 (spectral), times x rows x columns (entries)
    step: float
    bend: Matrix


def decay(M: Matrix) -> float:
    """Rate (1/s) of the slowest mode of exp(M t): minus the largest real part of an eigenvalue."""
    return -float(np.linalg.eigvals(M).real.max())


def _norms(X: Matrix, norm: Norm) -> Matrix:
    if norm == "entries":
        return np.abs(X)
    largest: Matrix = np.linalg.norm(X, 2, axis=(-2, -1), keepdims=True)
    return largest


class _Modes:
    """X(t) as a sum of modes R_i e^(lambda_i t), which also bounds X'' and the tail of X."""

    def __init__(self, rates: Any, residues: Any, norm: Norm) -> None:
        self.rates, self.residues, self.norm = rates, residues, norm
        sizes = np.stack([_norms(np.abs(R), "entries") for R in residues])
        if norm == "spectral":
            sizes = np.linalg.norm(residues, 2, axis=(-2, -1), keepdims=True)
        self.sizes = sizes
        self.fastest = float(np.abs(rates).max())

    def stretch(self, start: float, end: float, points: int) -> _Stretch:
        """Norms at `points` + 1 times from start to end (s)."""
        t = np.linspace(start, end, points + 1)
        X = np.tensordot(np.exp(np.outer(t, self.rates)), self.residues, axes=1).real
        return _Stretch(_norms(X, self.norm), (end - start) / points, self.bend(start))

    def bend(self, t: float) -> Matrix:
        """Upper bound of |X''| from time t on."""
        weights = np.abs(self.rates) ** 2 * np.exp(self.rates.real * t)
        return np.tensordot(weights, self.sizes, axes=1)

    def rest(self, t: float) -> Matrix:
        """Upper bound of |X| from time t on."""
        return np.tensordot(np.exp(self.rates.real * t), self.sizes, axes=1)

    def rest_integral(self, t: float) -> Matrix:
        """Upper bound of the integral of |X| from time t on."""
        weights = np.exp(self.rates.real * t) / -self.rates.real
        return np.tensordot(weights, self.sizes, axes=1)


class _Powers:
    """X(t) by powers of a matrix exponential, for systems whose eigenvectors (nearly) coincide.

    L of M^T L + L M = -I bounds the tail: |exp(M t)| <= sqrt(cond L) e^(-t / (2 max L)).
    """

    def __init__(self, M: Matrix, E: Matrix, C: Matrix, norm: Norm) -> None:
        # balance the states, because the norms below would otherwise mix their units
        M, scale = matrix_balance(M, permute=False)
        self.M, self.E, self.C, self.norm = M, np.linalg.solve(scale, E), C @ scale, norm
        spread = np.linalg.eigvalsh(solve_continuous_lyapunov(M.T, -np.eye(len(M))))
        self.overshoot = float(np.sqrt(spread[-1] / spread[0]))
        self.slowest = 0.5 / float(spread[-1])
        self.fastest = float(np.linalg.norm(M, 2))

    def stretch(self, start: float, end: float, points: int) -> _Stretch:
        """Norms at `points` + 1 times from start to end (s)."""
        step = (end - start) / points
        powers, one = np.eye(len(self.M))[None], expm(self.M * step)
        while len(powers) <= points:
            powers = np.concatenate([powers, powers @ one])
            one = one @ one
        X = self.C @ powers[: points + 1] @ (expm(self.M * start) @ self.E)
        return _Stretch(_norms(X, self.norm), step, self.bend(start))

    def _left(self, t: float, C: Matrix) -> Matrix:
        left = expm(self.M * t) @ self.E
        if self.norm == "entries":
            rows, columns = np.linalg.norm(C, axis=1), np.linalg.norm(left, axis=0)
            return self.overshoot * np.outer(rows, columns)
        return np.full(
            (1, 1), self.overshoot * float(np.linalg.norm(C, 2) * np.linalg.norm(left, 2))
        )

    def bend(self, t: float) -> Matrix:
        """Upper bound of |X''| from time t on."""
        return self._left(t, self.C @ self.M @ self.M)

    def rest(self, t: float) -> Matrix:
        """Upper bound of |X| from time t on."""
        return self._left(t, self.C)

    def rest_integral(self, t: float) -> Matrix:
        """Upper bound of the integral of |X| from time t on."""
        return self._left(t, self.C) / self.slowest


def _answer(M: Matrix, E: Matrix, C: Matrix, norm: Norm) -> _Modes | _Powers:
    rates, V = np.linalg.eig(M)
    if np.linalg.cond(V) > WELL_CONDITIONED:
        return _Powers(M, E, C, norm)
    left, right = C @ V, np.linalg.solve(V, E)
    return _Modes(rates, np.einsum("ai,ib->iab", left, right), norm)


def _stretches(answer: _Modes | _Powers) -> Any:
    """Start and end of time intervals. Each is as long as all intervals before it."""
    start, end = 0.0, 1.0 / answer.fastest
    while True:
        yield start, end
        start, end = end, 2.0 * end


def _points(wanted: float) -> int:
    return int(min(POINTS, max(16.0, np.ceil(wanted))))


def _checked(M: Matrix, E: Matrix | None, C: Matrix | None, rate: float) -> tuple[Matrix, ...]:
    M = np.atleast_2d(np.asarray(M, dtype=float))
    if not decay(M) > rate:
        raise UnstableError(
            f"no bound: the slowest mode decays at {decay(M):.6g} 1/s, which must exceed {rate:.6g}"
        )
    unit = np.eye(len(M))
    E = unit if E is None else np.asarray(E, dtype=float).reshape(len(M), -1)
    C = unit if C is None else np.asarray(C, dtype=float).reshape(-1, len(M))
    return M + rate * unit, E, C


def peak(
    M: Matrix, E: Matrix | None = None, C: Matrix | None = None, rate: float = 0.0,
    norm: Norm = "spectral",
) -> Matrix:  # fmt: skip
    """Bound of e^(rate t) |C exp(M t) E| over all t >= 0.

    M (n x n) must be Hurwitz and decay faster than `rate` (1/s). E (n x a) and C (b x n) default to
    the identity. The result is 1 x 1 for `norm` "spectral", and b x a, one bound per entry, for
    "entries". Raises UnstableError.
    """
    M, E, C = _checked(M, E, C, rate)
    answer = _answer(M, E, C, norm)
    most = _norms(C @ E, norm)
    for start, end in _stretches(answer):
        rest = answer.rest(start)
        if np.all(rest <= np.maximum(most, TOLERANCE * float(most.max()))):
            return np.maximum(most, rest)
        allowed = 8.0 * TOLERANCE * max(float(most.max()), TOLERANCE * float(rest.max()))
        wanted = (end - start) * np.sqrt(float(answer.bend(start).max()) / allowed)
        values = answer.stretch(start, end, _points(wanted))
        most = np.maximum(most, values.norms.max(axis=0) + values.bend * values.step**2 / 8.0)
    raise AssertionError("unreachable: the time intervals never end")


def gain(
    M: Matrix, E: Matrix | None = None, C: Matrix | None = None, norm: Norm = "spectral"
) -> Matrix:
    """Bound of the integral of |C exp(M t) E| over t >= 0, the L1 gain from input E to output C.

    From rest, an input whose norm is at most 1 at all times gives an output whose norm is at most
    this bound. Shapes as in `peak`. Raises UnstableError.
    """
    M, E, C = _checked(M, E, C, 0.0)
    answer = _answer(M, E, C, norm)
    total = np.zeros(_norms(C @ E, norm).shape)
    for start, end in _stretches(answer):
        rest = answer.rest_integral(start)
        if (start > 0.0 or not rest.any()) and float(rest.max()) <= TOLERANCE * float(total.max()):
            return total + rest
        length = end - start
        allowed = TOLERANCE / 4.0 * max(float(total.max()), length * float(answer.rest(end).max()))
        wanted = length * np.sqrt(length * float(answer.bend(start).max()) / (12.0 * allowed))
        values = answer.stretch(start, end, _points(wanted))
        inner = values.norms[1:-1].sum(axis=0) + 0.5 * (values.norms[0] + values.norms[-1])
        total = total + values.step * inner + length * values.bend * values.step**2 / 12.0
    raise AssertionError("unreachable: the time intervals never end")


class Decay(NamedTuple):
    """|exp(A t)| <= gamma_A e^(-lambda_A t) for all t >= 0."""

    gamma_A: float
    lambda_A: float  # 1/s


def decay_pair(A: Matrix, lambda_A: float | None = None) -> Decay:
    """A valid pair for a Hurwitz A (n x n). gamma_A is tight for lambda_A (1/s) to TOLERANCE.

    lambda_A must be below the rate of the slowest mode (default: nine tenths of that rate).
    gamma_A is the largest norm of exp((A + lambda_A I) t). Raises UnstableError.
    """
    lambda_A = 0.9 * decay(np.atleast_2d(A)) if lambda_A is None else lambda_A
    return Decay(float(peak(A, rate=lambda_A)[0, 0]), lambda_A)
