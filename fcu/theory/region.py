"""The region of attraction: commands and starts for which the control stays inside its limits.

Section V bounds the known control, v_0 = -K x - K_0 g(x) + Lambda^-1 r - d, term by term along the
reference model, and adds the contribution of adaptation. Every term is in the units of u, so a
`Budget` shows how much of the limit each term uses.

The form "repaired" (the default) takes the smallest limit of the channels and bounds Lambda^-1 by
the lower bound of Lambda. Its (31) and Theorem V.1 contain the adaptive tracking error, beta_1 and
beta_2 gamma^(-1/2). It drops the unnecessary term lambda_g |K_0| |x_m|. The form "printed" follows
the paper to the letter.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fcu.guard.hover import Budget, largest
from fcu.guard.responses import Matrix
from fcu.theory.bounds import Form
from fcu.theory.control_difference import ControlDifference
from fcu.theory.linear_loop import NoBoundError


class Sizes(NamedTuple):
    """Bounds of the unknowns in v_0 (2-norms). Paper (3), (4)."""

    K: float
    Lambda_star: float  # upper bound of |Lambda|
    Lambda_least: float  # lower bound of its eigenvalues
    d_star: float  # inside Lambda
    K_0: float = 0.0
    lambda_g: float = 0.0  # Lipschitz constant of g
    s_star: float = 0.0  # outside Lambda

    @property
    def per_state(self) -> float:
        """|K| + lambda_g |K_0|: control per unit of tracking error."""
        return self.K + self.lambda_g * self.K_0


class Reference(NamedTuple):
    """Norms along the reference model, at one time or the largest of all times. Paper (24)."""

    x_m: float
    r: float
    g: float = 0.0  # |g(x_m)|


def limit(channels: Matrix, form: Form = "repaired") -> float:
    """v*: while |v| is below v*, every channel is inside its limit. After (22).

    The printed v* is sqrt(q) times the largest limit, which is necessary but not sufficient.
    """
    if form == "printed":
        return math.sqrt(len(channels)) * float(np.max(channels))
    return float(np.min(channels))


def known_control(
    K: Matrix, x: Matrix, K_0_g: Matrix, Lambda: Matrix, r: Matrix, d: Matrix,
    form: Form = "repaired",
) -> float:  # fmt: skip
    """|v_0| at a state. Paper (22), which prints -Lambda^-1 r."""
    sign = -1.0 if form == "printed" else 1.0
    v_0 = -K @ x - K_0_g + sign * np.linalg.solve(Lambda, r) - d  # (22)
    return float(np.linalg.norm(v_0))


def known_budget(
    sizes: Sizes, reference: Reference, v_star: float, gamma_A: float, e_0: float,
    form: Form = "repaired",
) -> Budget:  # fmt: skip
    """The condition for the known control. Paper (24); (25) is its margin.

    gamma_A : bound of |exp(A t)| at all times. e_0 : |x(0) - x_m(0)|.
    """
    printed = form == "printed"
    return Budget(
        limit=v_star,
        reference=(sizes.per_state if printed else sizes.K) * reference.x_m,
        nonlinearity=sizes.K_0 * reference.g,
        command=reference.r / (sizes.Lambda_star if printed else sizes.Lambda_least),
        disturbance=sizes.d_star + sizes.s_star / sizes.Lambda_least,
        initial_error=gamma_A * sizes.per_state * e_0,
    )  # (24)


def adaptive_budget(
    sizes: Sizes, reference: Reference, v_star: float, gamma_A: float, e_0: float,
    difference: ControlDifference, tracking: float, gamma: float, form: Form = "repaired",
) -> Budget:  # fmt: skip
    """The condition for the adaptive control. Paper (31).

    tracking : bound of |e| from e(0) = 0, from (29) or from `linear_loop.bounds`. gamma : that of
    the paper. The printed form uses beta_2 without gamma^(-1/2) and omits the tracking error.
    """
    known = known_budget(sizes, reference, v_star, gamma_A, e_0, form)
    printed = form == "printed"
    beta_2 = difference.lasting * math.sqrt(gamma)
    return known._replace(
        tracking_error=0.0 if printed else sizes.per_state * tracking,
        learning=difference.beta_1,
        lasting_error=beta_2 if printed else difference.lasting,
    )  # (31)


class Adaptation(NamedTuple):
    """Bounds of what adaptation adds to the known control and to the known tracking error."""

    difference: ControlDifference
    tracking: float  # of |e| from e(0) = 0


class Theorem(NamedTuple):
    """Theorem V.1: a quantity that must be positive, and the ball of admissible initial errors."""

    positive: float  # v* - beta_1 - beta_2 - d* - rho_1 (repaired: minus the tracking error)
    rho_1: float  # of reference model and command, units of u
    rho_2: float
    e_0_most: float  # every |e(0)| up to it is admitted: rho_2 / gamma_A
    e_0: float

    @property
    def holds(self) -> bool:
        """Whether the theorem guarantees tracking without saturation."""
        return self.positive > 0.0 and self.e_0 <= self.e_0_most


def theorem(
    sizes: Sizes, reference: Reference, v_star: float, gamma_A: float, e_0: float,
    adaptation: Callable[[float], Adaptation], gamma: float, form: Form = "repaired",
    precision: float = 1e-9,
) -> Theorem:  # fmt: skip
    """Theorem V.1, for the smallest rho_1 that the reference and the command allow.

    adaptation : bounds for every start of |e(0)| up to its argument. They grow with it where the
    regressor depends on the state, so (31) at e_0_most counts them at e_0_most. NoBoundError means
    that the start is not admitted; at e_0 itself it is raised. `fcu.theory.guarantee.attraction`
    computes them. precision : relative, of e_0_most. Other arguments as in `adaptive_budget`.

    The printed ball is rho_2 (|K| + lambda_g |K_0|) <= d* + rho_1, which grows where it should
    shrink. The repaired ball is the largest for which (31) holds.
    """

    def budget(start: float) -> Budget:
        difference, tracking = adaptation(start)
        return adaptive_budget(
            sizes, reference, v_star, gamma_A, start, difference, tracking, gamma, form
        )

    def admitted(start: float) -> bool:
        try:
            return budget(start).holds
        except NoBoundError:
            return False

    own = budget(e_0)
    rho_1 = own.reference + own.nonlinearity + own.command
    added = own.learning + own.lasting_error + own.tracking_error
    positive = v_star - added - own.disturbance - rho_1
    if form == "printed":
        room = own.disturbance + rho_1
        rho_2 = room / sizes.per_state if sizes.per_state > 0.0 else math.inf
        return Theorem(positive, rho_1, rho_2, rho_2 / gamma_A, e_0)
    e_0_most = largest(admitted, precision)
    return Theorem(positive, rho_1, gamma_A * e_0_most, e_0_most, e_0)
