"""Check before a run whether a command and a start keep the adaptive control inside its limits.

The system is that of the paper, Theta f = K x + K_0 g(x) - Lambda^-1 r with constant unknowns and a
time-varying d inside Lambda. The regressor f depends on the state. The bound of the state needs the
bound of the control difference, which needs the bound of f. An iteration finds the bounds together,
and (31) follows from them. This is Theorem V.1 with all its constants computed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fcu.guard.hover import Budget
from fcu.guard.responses import Matrix, peak
from fcu.theory.control_difference import ControlDifference
from fcu.theory.linear_loop import (
    LoopBounds,
    NoBoundError,
    Start,
    any_projection,
    bounds,
    loop,
)
from fcu.theory.region import (
    Adaptation,
    Reference,
    Sizes,
    Theorem,
    adaptive_budget,
    theorem,
)

ROUNDS, SLACK = 30, 5e-3  # iterations; relative increase of the assumed bounds per iteration
PRECISION = 1e-4  # of the largest start, relative


class Model(NamedTuple):
    """Reference model, predictor and the true, constant Lambda. Paper (1), (5)."""

    A: Matrix
    B: Matrix
    P: Matrix
    k: float
    Lambda: Matrix
    gamma_Theta: float
    gamma_d: float


class Assumptions(NamedTuple):
    """Bounds (norms, at all times) of the unknowns, the estimates and the reference trajectory."""

    sizes: Sizes
    d_rate: float
    Theta_error: float  # |Theta - Theta_hat| that the outer set allows, 2-norm
    reference: Reference  # largest |x_m|, |r|, |g|
    x_m_rate: float
    r_rate: float
    z_0: float  # |Theta_til f + d_til| at the start, for every start with |e(0)| <= e_0
    e_0: float = 0.0
    x_til_0: float = 0.0


class Guarantee(NamedTuple):
    """The condition (31), and the bounds that hold if it does."""

    budget: Budget
    bounds: LoopBounds
    d_hat: float  # |d_hat| at all times: the set for d must be larger


def guarantee(model: Model, assumed: Assumptions, v_star: float) -> Guarantee:
    """The budget of (31) and the bounds of all errors, for a limit v_star of |v|.

    Holds before a run: the projection of Theta_hat onto a ball (without a metric) or a box may act,
    as long as `Theta_error` is that of its outer set. The projection of d_hat never acts if the
    radius, or the half-width in every component, of the set for d is above the returned d_hat. The
    set for Lambda does not matter, because Lambda_hat has no effect without saturation. Raises
    UnstableError, and NoBoundError if the regressor may vary too much for a bound.
    """
    found, gamma_A = _bounds(model, assumed), float(peak(model.A)[0, 0])
    difference, tracking = _adaptation(found, gamma_A, assumed.e_0)
    budget = adaptive_budget(
        assumed.sizes, assumed.reference, v_star, gamma_A, assumed.e_0, difference, tracking,
        model.gamma_d,
    )  # fmt: skip  # (31)
    f_star = _regressor(assumed, float(found.tracking[0]))
    d_hat = assumed.sizes.d_star + assumed.Theta_error * f_star + float(found.control_peak[0])
    return Guarantee(budget, found, d_hat)


def attraction(model: Model, assumed: Assumptions, v_star: float) -> Theorem:
    """Theorem V.1 with every constant evaluated at the initial error that it is to admit.

    `guarantee` holds at e_0_most, and its assumptions hold for every smaller start: so e_0_most
    needs no proof that the margin falls as e_0 grows. Raises as `guarantee`, at assumed.e_0.
    """
    gamma_A = float(peak(model.A)[0, 0])

    def adaptation(e_0: float) -> Adaptation:
        return _adaptation(_bounds(model, starting(assumed, e_0)), gamma_A, e_0)

    return theorem(
        assumed.sizes, assumed.reference, v_star, gamma_A, assumed.e_0, adaptation, model.gamma_d,
        precision=PRECISION,
    )  # fmt: skip


def starting(assumed: Assumptions, e_0: float) -> Assumptions:
    """The same assumptions for every start with |e(0)| <= e_0, which also changes f in z_0."""
    farther = max(e_0 - assumed.e_0, 0.0)
    f_moved = math.hypot(1.0, assumed.sizes.lambda_g) * farther
    return assumed._replace(e_0=e_0, z_0=assumed.z_0 + assumed.Theta_error * f_moved)


def _adaptation(found: LoopBounds, gamma_A: float, e_0: float) -> Adaptation:
    settled = float(found.control_settled[0])
    difference = ControlDifference(
        float(found.control_peak[0]) - settled, found.control.nu_1, settled
    )
    return Adaptation(difference, max(float(found.tracking[0]) - gamma_A * e_0, 0.0))


def _regressor(assumed: Assumptions, E: float) -> float:
    """Bound of |f| = |(x, g(x), r)| while |e| <= E."""
    at = assumed.reference
    return math.hypot(at.x_m + E, at.g + assumed.sizes.lambda_g * E, at.r)


def _bounds(model: Model, assumed: Assumptions) -> LoopBounds:
    """Bounds of all errors, with the regressor that these errors allow.

    While |e| <= E and |z| <= Z, the regressor, its rate and so G and delta are in the ranges computed
    here, and the errors are below `found`. If `found` is below E and Z, then neither error, being
    continuous and below them at the start, is ever the first to reach them.
    """
    system_A = float(np.linalg.norm(model.A, 2))
    driven = float(np.linalg.norm(model.B @ model.Lambda, 2))
    lambda_g = assumed.sizes.lambda_g
    E, Z = assumed.e_0, assumed.z_0
    for _ in range(ROUNDS):
        E, Z = E * (1.0 + SLACK), Z * (1.0 + SLACK)
        f_star = _regressor(assumed, E)
        x_rate = assumed.x_m_rate + system_A * E + driven * Z
        f_rate = math.hypot(x_rate, lambda_g * x_rate, assumed.r_rate)
        G, moving = any_projection(model.gamma_d, model.gamma_Theta, f_star)
        delta = assumed.d_rate + assumed.Theta_error * f_rate
        found = bounds(
            loop(model.A, model.B, model.P, model.k, model.Lambda, G), delta,
            Start(assumed.x_til_0, assumed.z_0, assumed.e_0), moving,
        )  # fmt: skip
        if found.tracking[0] <= E and found.control_peak[0] <= Z:
            return found
        E, Z = float(found.tracking[0]), float(found.control_peak[0])
    raise NoBoundError("no bound: the iteration did not converge; the state moves too far")
