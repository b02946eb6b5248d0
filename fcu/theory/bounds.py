"""Bounds of prediction error and reference model, for any n, q, p. Paper (12)-(20), (28).

The form "repaired" (the default) contains what the printed argument needs: Frobenius norms in the
traces, the rates of the true Theta, Lambda and d, the term with the rate of Lambda that (13) omits,
and the part of the decay that (17) drops. The form "printed" follows the paper to the letter. Norms
are 2-norms unless stated otherwise. A number may be an array (...) over a batch of systems.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from fcu.guard.responses import Decay, Matrix, gain
from fcu.theory.projection import MARGIN

Form = Literal["repaired", "printed"]
Number = float | Matrix


class Unknown(NamedTuple):
    """Assumed bounds of one unknown, in the structure in which it is estimated. Paper (4).

    Two questions about it, each with its own norm:

    1. How far may the estimate be from it, and how fast does it move away? `error` and `rate`,
       Frobenius norms. Only the repaired form asks. Without an `error` the estimate is that of the
       default `fcu.theory.projection.Ball`, with `size` as its radius. For every other set it is
       `kept_in.farthest(size)`, and for an unknown that is known and not adapted it is 0.
    2. How large is it as a matrix? `star` and `star_rate`, 2-norms. The repaired form asks this of
       Lambda, which weights the errors of Theta and d; the printed form asks nothing else, of any.
       `norm` and `norm_rate` are needed where the 2-norm is below the Frobenius norm.

    A Lambda that is a multiple of the identity is one number, so its Frobenius norm is its
    absolute value. A diagonal Lambda is a column.
    """

    size: Number  # Frobenius norm of the true value
    rate: Number = 0.0  # Frobenius norm of its rate, 1/s
    error: Number | None = None  # largest |truth - estimate|, with the estimate in its outer set
    norm: Number | None = None  # 2-norm as a matrix; None: size
    norm_rate: Number | None = None  # the same of the rate; None: rate

    @property
    def farthest(self) -> Number:
        """Largest error of the estimate (Frobenius norm); the paper uses twice the bound."""
        return (2.0 + MARGIN) * self.size if self.error is None else self.error

    @property
    def star(self) -> Number:
        """lambda*, theta*, d* of the paper."""
        return self.size if self.norm is None else self.norm

    @property
    def star_rate(self) -> Number:
        """lambda_d*, theta_d*, d_d* of the paper."""
        return self.rate if self.norm_rate is None else self.norm_rate


NOTHING = Unknown(0.0)


class Assumed(NamedTuple):
    """Assumptions about the unknowns inside Lambda (Theta, d) and outside (C, s). Paper (4).

    Lambda_least : lower bound of the eigenvalues of Lambda; the paper's (4) has no such bound.
    """

    Lambda: Unknown
    Lambda_least: Number
    Theta: Unknown = NOTHING
    d: Unknown = NOTHING
    C: Unknown = NOTHING
    s: Unknown = NOTHING


class Blocks(NamedTuple):
    """One number per block of estimates: its gain, or its contribution to a constant."""

    Lambda: Number = 0.0
    Theta: Number = 0.0
    d: Number = 0.0
    C: Number = 0.0
    s: Number = 0.0

    @property
    def total(self) -> Number:
        """c1 of (12), c2 of (13)."""
        return self.Lambda + self.Theta + self.d + self.C + self.s

    def over(self, gains: Blocks) -> Number:
        """c/gamma, each block by its own gain."""
        total: Number = 0.0
        for constant, gamma in zip(self, gains, strict=True):
            if np.any(np.asarray(constant) > 0.0):
                total = total + constant / gamma
        return total


def single(gamma: Number) -> Blocks:
    """The paper's gains: one for all."""
    return Blocks(gamma, gamma, gamma, gamma, gamma)


def c1(known: Assumed, form: Form = "repaired") -> Blocks:
    """Bound of the contribution of the estimation errors to gamma V of (15). Paper (12)."""
    star = known.Lambda.star
    if form == "printed":
        Theta, d = 4.0 * star * known.Theta.star**2, 4.0 * star * known.d.star**2
        C, s = 4.0 * known.C.star**2, 4.0 * known.s.star**2
        return Blocks(4.0 * star**2, Theta, d, C, s)  # (12)
    return Blocks(
        known.Lambda.farthest**2,
        star * known.Theta.farthest**2,
        star * known.d.farthest**2,
        known.C.farthest**2,
        known.s.farthest**2,
    )  # (12)


def c2(known: Assumed, form: Form = "repaired") -> Blocks:
    """Bound (1/s) of the contribution of time-varying unknowns to gamma V'. Paper (13).

    The printed form lacks 2 tr(Lambda'^T Lambda_til) <= 4 lambda* lambda_d*.
    """
    star, rate = known.Lambda.star, known.Lambda.star_rate

    def moving(block: Unknown, weight: Number, weight_rate: Number) -> Number:
        if form == "printed":
            return 4.0 * weight * block.star * block.star_rate + 4.0 * weight_rate * block.star**2
        own = 2.0 * weight * block.rate * block.farthest
        return own + weight_rate * block.farthest**2

    Lambda = 0.0 if form == "printed" else moving(known.Lambda, 1.0, 0.0)
    return Blocks(
        Lambda,
        moving(known.Theta, star, rate),
        moving(known.d, star, rate),
        moving(known.C, 1.0, 0.0),
        moving(known.s, 1.0, 0.0),
    )  # (13)


class PredictionBound(NamedTuple):
    """|x_til(t)| as a function of time. Paper (14), (19), (20)."""

    V_0: Number  # V(0) of (15), or a bound of it
    level: Number  # c/gamma: level that V decays to
    rate: Number  # 1/s: half the decay rate of V
    P_least: Number  # smallest eigenvalue of P

    def at(self, t: Number) -> Number:
        """The bound at time t (s). Paper (19)."""
        V = (self.V_0 - self.level) * np.exp(-2.0 * self.rate * t) + self.level
        return np.sqrt(V / self.P_least)  # (19)

    def split(self, t: Number) -> Number:
        """The same, coarser, as a decaying term plus a constant term. Paper (14)."""
        decaying = np.sqrt(np.abs(self.V_0 - self.level) / self.P_least) * np.exp(-self.rate * t)
        return decaying + np.sqrt(self.level / self.P_least)  # (14)

    @property
    def settled(self) -> Number:
        """The bound after the transient; if x_hat(0) = x(0), the bound at all times. Paper (20)."""
        return np.sqrt(self.level / self.P_least)  # (20)

    @property
    def peak(self) -> Number:
        """The bound over all times."""
        return np.sqrt(np.maximum(self.V_0, self.level) / self.P_least)


def initial_V(
    known: Assumed, gammas: Blocks, P: Matrix, x_til_0: Matrix, form: Form = "repaired"
) -> Number:
    """Bound of V(0) of (15), for a prediction error x_til_0 (..., n)."""
    start = np.einsum("...i,...ij,...j->...", x_til_0, P, x_til_0)
    return np.asarray(start + c1(known, form).over(gammas))  # (15)


def prediction_bound(
    known: Assumed, gammas: Blocks, k: Number, P: Matrix, Q: Matrix, x_til_0: Matrix,
    form: Form = "repaired",
) -> PredictionBound:  # fmt: skip
    """The bound of the prediction error, for any control. Paper (14), (19), (20).

    P, Q : (..., n, n) with A^T P + P A = -Q (Q = 0, P = I for a predictor without A). In the
    repaired form V decays with 2 k + min eig(P^-1 Q); the printed form drops the second term.
    Assumes that projection never increases the growth of V (`fcu.theory.projection.sound`).
    """
    rate = k
    if form == "repaired":
        rate = k + 0.5 * np.linalg.eigvals(np.linalg.solve(P, Q)).real.min(axis=-1)
    level = c1(known, form).over(gammas) + c2(known, form).over(gammas) / (2.0 * rate)  # (17)
    V_0 = initial_V(known, gammas, P, x_til_0, form)
    least = np.asarray(np.linalg.eigvalsh(P)[..., 0], dtype=np.float64)
    return PredictionBound(V_0, level, rate, least)  # (18)


def reference_bound(decay: Decay, B: Matrix, x_m_0: Matrix, r_star: float) -> float:
    """x_m*, the largest norm of the reference state for commands of norm r_star. After (23)."""
    along = float(np.linalg.norm(B, 2)) * r_star / decay.lambda_A
    return decay.gamma_A * (float(np.linalg.norm(x_m_0)) + along)


def predictor_bound(
    A: Matrix, decay: Decay, k: float, x_hat_m_0: Matrix, prediction: float, form: Form = "repaired"
) -> float:
    """Bound of |x_hat - x_m| without saturation. Paper (28).

    x_hat_m_0 : x_hat(0) - x_m(0), n. prediction : bound of |x_til| at all times (printed: (20)).
    The repaired form uses the L1 gain of A where it is below its bound gamma_A / lambda_A.
    """
    most = decay.gamma_A / decay.lambda_A
    if form == "repaired":
        most = min(most, float(gain(A)[0, 0]))
    return decay.gamma_A * float(np.linalg.norm(x_hat_m_0)) + most * k * prediction  # (28)


def tracking_bound(
    A: Matrix, decay: Decay, k: float, x_hat_m_0: Matrix, prediction: float, form: Form = "repaired"
) -> float:
    """Bound of |x - x_m| without saturation. Paper (29).

    With k = sqrt(gamma) the bound does not shrink as gamma grows, because k sqrt(c/gamma) is
    constant. In this case use `fcu.theory.linear_loop.bounds`.
    """
    return prediction + predictor_bound(A, decay, k, x_hat_m_0, prediction, form)  # (29)
