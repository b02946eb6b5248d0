"""Bounds of prediction error, control difference and tracking error, for any A, B, P.

The errors of `fcu.theory.control_difference` form one linear system with state (x_til, z, e). The
bounds are its L1 gains and peaks, so some delta comes arbitrarily close to them. A time-varying
regressor or Lambda is treated as a deviation from a constant, which is bounded in terms of the
bounds themselves: a small-gain argument. NoBoundError is raised if its loop gain is not below one.

Assumes no saturation. The projection of Theta_hat may act if the range of G says so
(`any_projection`); the projection of d_hat must not, for which a set is enough that is larger than
d* + |Theta_til| |f| + |z|. Before the run, the bounds of a design hold for `any_projection`; those of
a narrower range of G hold for a run in which no projection acts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fcu.guard.responses import Matrix, Norm, decay, gain, peak
from fcu.theory.control_difference import ControlDifference


class NoBoundError(ValueError):
    """Regressor or Lambda vary too much for a bound; the message has the loop gain."""


class Loop(NamedTuple):
    """x_til' = F x_til + drive z, z' = -G output x_til + delta, e' = A e + drive_e z.

    In the general case F = A - k I, output = B^T P, and drive = drive_e = B Lambda (unknowns inside
    Lambda) or B (outside). The octocopter predicts only the velocity: F = -k I, and e holds
    position and velocity. The time-varying part of Lambda times z enters x_til' and e' through
    `unknown` and `unknown_e`, which are 0 for a disturbance outside Lambda. There v_0 - v =
    -Lambda(t)^-1 z, and the time-varying part of Lambda times v_0 - v enters v_0 - v through
    `unknown_v`, which is 0 inside Lambda.
    """

    F: Matrix  # n x n
    drive: Matrix  # n x q
    output: Matrix  # q x n
    G: Matrix  # q x q
    A: Matrix  # m x m
    drive_e: Matrix  # m x q
    control: Matrix  # q x q: v_0 - v = -control z
    unknown: Matrix  # n x q
    unknown_e: Matrix  # m x q
    unknown_v: Matrix  # q x q

    @property
    def fast(self) -> Matrix:
        """System matrix of (x_til, z), n + q square."""
        q = self.drive.shape[1]
        return np.block([[self.F, self.drive], [-self.G @ self.output, np.zeros((q, q))]])

    @property
    def whole(self) -> Matrix:
        """System matrix of (x_til, z, e), n + q + m square."""
        (n, q), m = self.drive.shape, len(self.A)
        return np.block([
            [self.fast, np.zeros((n + q, m))],
            [np.zeros((m, n)), self.drive_e, self.A],
        ])  # fmt: skip


def loop(
    A: Matrix, B: Matrix, P: Matrix, k: float, Lambda: Matrix, G: Matrix | float,
    beside: bool = False,
) -> Loop:  # fmt: skip
    """The loop of the general M-MRAC for constant Lambda (q x q) and G (q x q, or a number).

    beside : whether the disturbance acts outside Lambda. delta and G are then those of
    z = Lambda Theta_til f + s_til: with a time-varying Lambda, delta contains Lambda' Theta_til f.
    """
    A, B, Lambda = (np.atleast_2d(np.asarray(X, dtype=float)) for X in (A, B, Lambda))
    n, q = B.shape
    square = np.asarray(G, dtype=float) * np.eye(q) if np.ndim(G) == 0 else np.asarray(G)
    F = A - k * np.eye(n)
    if not beside:
        return Loop(
            F, B @ Lambda, B.T @ P, square, A, B @ Lambda, np.eye(q), B, B, np.zeros((q, q))
        )
    control = np.asarray(np.linalg.inv(Lambda), dtype=np.float64)
    return Loop(F, B, B.T @ P, square, A, B, control, 0.0 * B, 0.0 * B, control)


class Start(NamedTuple):
    """Norms at t = 0 (norm "spectral"), or arrays of absolute values (norm "entries")."""

    x_til: Matrix | float = 0.0
    z: Matrix | float = 0.0
    e: Matrix | float = 0.0


class Moving(NamedTuple):
    """Largest deviations of G(t) and Lambda(t) from the constants of the loop: norms or entries."""

    G: Matrix | float = 0.0
    Lambda: Matrix | float = 0.0


def any_projection(gamma_d: float, gamma_Theta: float, f_star: float) -> tuple[float, Moving]:
    """G, and its deviations, for |f| <= f_star, whatever the projection of Theta_hat does.

    Theta_hat' f = gamma_Theta (|f|^2 I - S) y_til, where Pr takes S y_til away. For a ball, with
    N = Theta_hat / |Theta_hat| and a share s from 0 to 1, S = s N f f^T N^T while y_til^T N f > 0,
    else 0. |N f| <= |f|, because no 2-norm exceeds the Frobenius norm. For a box S is diagonal,
    sum_j s_ij f_j^2. Both are symmetric, and 0 <= S <= |f|^2 I. Hence

        gamma_d I <= G <= (gamma_d + gamma_Theta |f|^2) I,

    whatever Lambda is (unknowns inside Lambda), and however often Pr switches. A ball with a metric
    is excluded: its S is not symmetric. The bound of Theta_til must be that of the outer set.
    """
    half = 0.5 * gamma_Theta * f_star * f_star
    return gamma_d + half, Moving(G=half)


class LoopBounds(NamedTuple):
    """Bounds of norms (one number) or of each component."""

    prediction: Matrix  # |x_til| at all times
    prediction_settled: Matrix  # the same after the transient
    control: ControlDifference  # (30); of the largest component for norm "entries"
    control_settled: Matrix
    control_peak: Matrix  # |v_0 - v| at all times
    tracking: Matrix  # |e| at all times
    tracking_settled: Matrix
    loop_gain: float  # of the small-gain argument, below 1


class _Ways(NamedTuple):
    """Matrices that select outputs of the state (x_til, z, e), and one that puts an input in."""

    x: Matrix
    z: Matrix
    e: Matrix
    y: Matrix  # y_til
    d_Lambda: Matrix  # where the time-varying part of Lambda, times z, enters the rate of the state


def _ways(system: Loop) -> _Ways:
    (n, q), m = system.drive.shape, len(system.A)
    unit = np.eye(n + q + m)
    x, z, e = unit[:n], unit[n : n + q], unit[n + q :]
    d_Lambda = x.T @ system.unknown + e.T @ system.unknown_e
    return _Ways(x, z, e, system.output @ x, d_Lambda)


def _column(value: Matrix | float, rows: int, norm: Norm) -> Matrix:
    column = np.asarray(value, dtype=float).reshape(-1)
    rows = 1 if norm == "spectral" else rows
    return np.full(rows, column[0]) if len(column) == 1 else column


def _square(value: Matrix | float, rows: int, norm: Norm) -> Matrix:
    if norm == "spectral":
        return np.array([[float(np.asarray(value).reshape(-1)[0])]])
    if np.ndim(value) == 0:
        return float(np.asarray(value)) * np.ones((rows, rows))
    return np.asarray(value, dtype=float)


def bounds(
    system: Loop, delta_star: Matrix | float, start: Start | None = None,
    moving: Moving | None = None, norm: Norm = "spectral", nu_1: float | None = None,
) -> LoopBounds:  # fmt: skip
    """Bounds for |delta| at most delta_star at all times (a norm, or an array of entries).

    nu_1 (1/s): decay rate of the transient in (30), below the rate of the slowest mode of
    (x_til, z); default: half of that rate. Raises UnstableError, NoBoundError.
    """
    start, moving = start or Start(), moving or Moving()
    (n, q), m = system.drive.shape, len(system.A)
    rows = zip(start, (n, q, m), strict=True)
    begin = [_column(value, count, norm) for value, count in rows]
    delta = _column(delta_star, q, norm)
    problem = _problem(system, begin, moving, norm)
    lasting, radius = problem.signals(delta, [0.0 * value for value in begin])
    ever, _ = problem.signals(delta, begin)
    ways = problem.ways
    v, widened = system.control @ ways.z, _widening(system, moving, norm)
    settled = widened @ problem.at_most(v, delta, lasting)
    fast = problem.without_e(len(system.fast))
    nu_1 = 0.5 * decay(fast.M) if nu_1 is None else nu_1
    forgotten = fast._replace(rate=nu_1, found={})
    nothing = 0.0 * delta
    weighted, _ = forgotten.signals(nothing, begin)
    v_fast = v[:, : len(fast.M)]
    beta_1 = forgotten.at_most(v_fast, nothing, weighted) + forgotten.started(v_fast, begin)
    beta_1 = widened @ beta_1
    return LoopBounds(
        prediction=problem.at_most(ways.x, delta, ever) + problem.started(ways.x, begin),
        prediction_settled=problem.at_most(ways.x, delta, lasting),
        control=ControlDifference(float(beta_1.max()), nu_1, float(settled.max())),
        control_settled=settled,
        control_peak=widened @ (problem.at_most(v, delta, ever) + problem.started(v, begin)),
        tracking=problem.at_most(ways.e, delta, ever) + problem.started(ways.e, begin),
        tracking_settled=problem.at_most(ways.e, delta, lasting),
        loop_gain=radius,
    )


def _widening(system: Loop, moving: Moving, norm: Norm) -> Matrix:
    """(I - |unknown_v| |dLambda|)^-1, from bounds of control z to bounds of v_0 - v."""
    by_v = np.abs(system.unknown_v)
    if norm == "spectral":
        by_v = np.array([[float(np.linalg.norm(system.unknown_v, 2))]])
    back = by_v @ _square(moving.Lambda, len(system.unknown_v), norm)
    if float(np.abs(np.linalg.eigvals(back)).max()) >= 1.0:
        raise NoBoundError("no bound: Lambda varies so much that it may become singular")
    return np.asarray(np.linalg.inv(np.eye(len(back)) - back), dtype=np.float64)


class _Problem(NamedTuple):
    """The small-gain problem for signals times e^(rate t).

    G(t) and Lambda(t) are constants plus dG and dLambda. In the constant system these are two
    inputs: dG y_til adds to delta, and dLambda z enters x_til' and e' (only for unknowns inside
    Lambda). Both contain signals of the loop, (y_til, z), here called fed. With bounds of norms or
    entries throughout, from an initial state and delta,

        fed <= free + feedback fed,    so    fed <= (I - feedback)^-1 free

    if the spectral radius of feedback, the loop gain, is below one. Every output then has a bound.
    """

    M: Matrix
    ways: _Ways
    fed: Matrix  # rows that select (y_til, z) from the state
    into_delta: Matrix  # bounds of dG, from bounds of fed to a bound of dG y_til
    into_d_Lambda: Matrix  # bounds of dLambda, from bounds of fed to a bound of dLambda z
    norm: Norm
    rate: float  # 1/s
    found: dict[bytes, tuple[Matrix, Matrix]]  # cache of the gains to an output

    def without_e(self, size: int) -> _Problem:
        """The same problem for (x_til, z) only, `size` states."""
        ways = self.ways
        x, z, e, y = (way[:, :size] for way in ways[:4])
        cut = _Ways(x, z, e, y, ways.d_Lambda[:size])
        return self._replace(M=self.M[:size, :size], ways=cut, fed=self.fed[:, :size], found={})

    def _outputs(self) -> list[Matrix]:
        """The fed signals: separately for norm "spectral", together for "entries"."""
        if self.norm == "entries":
            return [self.fed]
        half = len(self.fed) // 2
        return [self.fed[:half], self.fed[half:]]

    def _gains(self, out: Matrix) -> tuple[Matrix, Matrix]:
        """Gains to an output from delta and from dLambda z."""
        key = out.tobytes()
        if key not in self.found:
            faster = self.M + self.rate * np.eye(len(self.M))
            by_delta = gain(faster, self.ways.z.T, out, self.norm)
            by_d_Lambda = 0.0 * by_delta[:, : len(self.into_d_Lambda)]
            if np.any(self.into_d_Lambda):
                by_d_Lambda = gain(faster, self.ways.d_Lambda, out, self.norm)
            self.found[key] = by_delta, by_d_Lambda
        return self.found[key]

    def _gain(self, out: Matrix) -> Matrix:
        """Gain from bounds of the fed signals to a bound of `out`."""
        by_delta, by_d_Lambda = self._gains(out)
        return np.asarray(by_delta @ self.into_delta + by_d_Lambda @ self.into_d_Lambda)

    def _driven(self, out: Matrix, delta: Matrix) -> Matrix:
        return np.asarray(self._gains(out)[0] @ delta)

    def started(self, out: Matrix, begin: list[Matrix]) -> Matrix:
        """Bound of `out` times e^(rate t) that the initial state causes."""
        ways = (self.ways.x.T, self.ways.z.T, self.ways.e.T)
        rows = 1 if self.norm == "spectral" else len(out)
        total = np.zeros(rows)
        for way, value in zip(ways, begin, strict=True):
            if np.any(value) and np.any(way):
                total = total + peak(self.M, way, out, self.rate, self.norm) @ value
        return total

    def at_most(self, out: Matrix, delta: Matrix, signals: Matrix) -> Matrix:
        """Bound of `out` that delta and the fed signals cause from rest."""
        moved = self._gain(out) @ signals if np.any(signals) else 0.0
        return self._driven(out, delta) + moved

    def signals(self, delta: Matrix, begin: list[Matrix]) -> tuple[Matrix, float]:
        """Bounds of the fed signals with the feedback closed, and the loop gain."""
        free = np.concatenate([
            self._driven(out, delta) + self.started(out, begin) for out in self._outputs()
        ])  # fmt: skip
        if not (np.any(self.into_delta) or np.any(self.into_d_Lambda)):
            return 0.0 * free, 0.0
        feedback = np.concatenate([self._gain(out) for out in self._outputs()])
        radius = float(np.abs(np.linalg.eigvals(feedback)).max())
        if radius >= 1.0:
            raise NoBoundError(
                "no bound: the regressor or Lambda moves too far, "
                f"loop gain {radius:.3g}, not below 1"
            )
        return np.linalg.solve(np.eye(len(free)) - feedback, free), radius


def _problem(system: Loop, begin: list[Matrix], moving: Moving, norm: Norm) -> _Problem:
    q, ways = system.drive.shape[1], _ways(system)
    G, Lambda = _square(moving.G, q, norm), _square(moving.Lambda, q, norm)
    into_delta = np.hstack([G, 0.0 * Lambda])
    into_d_Lambda = np.hstack([np.zeros((len(Lambda), G.shape[1])), Lambda])
    return _Problem(
        M=system.whole, ways=ways, fed=np.vstack([ways.y, ways.z]), into_delta=into_delta,
        into_d_Lambda=into_d_Lambda, norm=norm, rate=0.0, found={},
    )  # fmt: skip
