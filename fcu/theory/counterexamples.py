"""Simulated systems for which the printed bounds and conditions fail, with repaired values.

Each function names the equation of the paper. A bound fails if a simulated value exceeds it. A
condition fails if it holds and the control saturates nevertheless. The repaired form must hold or
make no claim.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fcu.laws.mmrac.types import Params
from fcu.theory.adaptive import Block, Estimates, Laws, predictor
from fcu.theory.arrays import Array
from fcu.theory.bounds import Assumed, Form, Unknown, prediction_bound, single
from fcu.theory.control_difference import Channel, ControlDifference, control_difference
from fcu.theory.linear_loop import bounds, loop
from fcu.theory.octocopter import cone, position_loop
from fcu.theory.projection import Ball, Box, Set, Structure
from fcu.theory.region import (
    Adaptation,
    Reference,
    Sizes,
    Theorem,
    adaptive_budget,
    known_budget,
    limit,
    theorem,
)
from fcu.theory.simulate import ClosedLoop, LoopState, Run, simulate
from fcu.theory.systems import (
    Actuator,
    Plant,
    ReferenceModel,
    Signal,
    Uncertainty,
    Varying,
    constant,
    swinging,
    symmetric,
)


class BoundFails(NamedTuple):
    """A bound that is exceeded."""

    printed: float
    repaired: float
    measured: float


class ConditionFails(NamedTuple):
    """A condition that holds as printed (margin at least zero) while the control saturates."""

    printed_margin: float  # units of u; at least zero: the condition claims no saturation
    repaired_margin: float
    saturated: bool
    run: Run


ONE = np.eye(1)


def scalar_model(a: float) -> ReferenceModel:
    """x_m' = -a x_m + r, with P = 1."""
    return ReferenceModel(-a * ONE, ONE, 2.0 * a * ONE)


def moving_lambda() -> BoundFails:
    """(13) without 4 lambda* lambda_d*: Lambda oscillates in phase with Delta_u.

    Theta is known and tiny and its regressor is large, so Delta_u oscillates. No other unknown
    exists, and the printed c2 is almost zero. Lambda_hat is too slow to follow, the product of the
    two oscillations has a nonzero mean, and x_til grows with this mean. Paper (13), (20).
    """
    gamma, k, theta, omega, swing = 100.0, 1.0, 1e-3, 600.0, 3.0
    told = scalar_model(1.0)
    Lambda = swinging(np.array([[1.0]]), 0.9, omega)
    high = 1.9
    truth = Uncertainty(Lambda, np.asarray(0.1), Structure.SCALAR, Theta=constant(theta * ONE))

    def r(t: float) -> Array:
        return np.array([-np.sin(omega * t)])

    def f(x: Array, r: Array) -> Array:
        return -swing / theta * r

    plant = Plant(told, truth, r, f=f, actuator=symmetric(np.array([1e-3])))
    sets = Laws(Lambda=Block(gamma, Ball(high, 0.0), Structure.SCALAR), weight=Structure.SCALAR)
    nothing = np.zeros(1)
    start = LoopState(nothing, nothing, nothing, Estimates(ONE, Theta=theta * ONE))
    run = simulate(ClosedLoop(plant, predictor(told, k), sets), start, 1.0, 0.3 / omega, every=4)
    known = Assumed(
        Unknown(high, 0.9 * omega, error=2.0 * high), 0.1, Theta=Unknown(theta, error=0.0)
    )
    of = (known, single(gamma), k, told.P, told.Q, nothing)
    return BoundFails(
        float(prediction_bound(*of, form="printed").peak),
        float(prediction_bound(*of).peak),
        float(np.abs(run.states.x - run.states.x_hat).max()),
    )


def _known_run(
    told: ReferenceModel, Lambda: Array, K: Array, r: Signal, actuator: Actuator, x_0: Array,
    x_m_0: Array, d: Varying | None = None, gamma: float = 100.0,
) -> Run:  # fmt: skip
    """Simulate a loop that knows Lambda, K and Lambda^-1 and estimates only d."""
    q = told.q
    Theta = np.concatenate([K, -np.linalg.inv(Lambda)], axis=-1)
    d = constant(np.zeros((q, 1))) if d is None else d
    truth = Uncertainty(
        constant(Lambda), np.asarray(np.diag(Lambda).min()), Structure.DIAGONAL,
        Theta=constant(Theta), d=d,
    )  # fmt: skip

    def f(x: Array, r: Array) -> Array:
        return np.concatenate([x, r], axis=-1)

    wide = Box(np.full((q, 1), -1e3), np.full((q, 1), 1e3), 0.0)
    laws = Laws(Lambda=None, d=Block(gamma, wide), weight=Structure.DIAGONAL)
    start = LoopState(x_0, x_m_0, x_0, Estimates(Lambda, Theta=Theta, d=np.zeros((q, 1))))
    whole = ClosedLoop(
        Plant(told, truth, r, f=f, actuator=actuator), predictor(told, math.sqrt(gamma)), laws
    )
    return simulate(whole, start, 20.0, 0.02, every=2)


def _saturated(run: Run) -> bool:
    return bool((run.signals.u != run.signals.v).any())


NO_DIFFERENCE = ControlDifference(0.0, 1.0, 0.0)


def command_over_lambda() -> ConditionFails:
    """(24), (25), (31) divide |r| by the upper bound of Lambda instead of the lower bound.

    Lambda = diag(2, 1/2), everything known; a command to the weak channel, from rest at the origin.
    """
    told = ReferenceModel(-np.eye(2), np.eye(2), 2.0 * np.eye(2))
    Lambda, K = np.diag([2.0, 0.5]), np.zeros((2, 2))
    limits, at_rest = np.array([0.6, 0.6]), np.zeros(2)
    run = _known_run(
        told, Lambda, K, lambda t: np.array([0.0, 1.0]), symmetric(limits), at_rest, at_rest
    )
    sizes, reference = Sizes(0.0, 2.0, 0.5, 0.0), Reference(1.0, 1.0)
    margins = [
        known_budget(sizes, reference, limit(limits), 1.0, 0.0, form).margin
        for form in ("printed", "repaired")
    ]
    return ConditionFails(margins[0], margins[1], _saturated(run), run)


def limit_of_channels() -> ConditionFails:
    """v* = sqrt(q) max v_i* after (22) admits a demand beyond the limit of one channel.

    Lambda = I, limits (1, 0.2), everything known; a command of 0.5 to the second channel.
    """
    told = ReferenceModel(-np.eye(2), np.eye(2), 2.0 * np.eye(2))
    limits, at_rest = np.array([1.0, 0.2]), np.zeros(2)
    run = _known_run(
        told, np.eye(2), np.zeros((2, 2)), lambda t: np.array([0.0, 0.5]), symmetric(limits),
        at_rest, at_rest,
    )  # fmt: skip
    sizes, reference = Sizes(0.0, 1.0, 1.0, 0.0), Reference(0.5, 0.5)
    printed = known_budget(sizes, reference, limit(limits, "printed"), 1.0, 0.0)
    repaired = known_budget(sizes, reference, limit(limits), 1.0, 0.0)
    return ConditionFails(printed.margin, repaired.margin, _saturated(run), run)


def ball_of_the_theorem() -> ConditionFails:
    """The ball of Theorem V.1 grows with d* + rho_1, although these terms reduce the margin.

    Everything is known and there is no disturbance; the open loop x' = 2 x + u is unstable. The
    margins are those of |e(0)| inside the ball, in units of u. The state diverges.
    """
    told, K, v_star = scalar_model(1.0), 3.0, 1.0
    r = x_m_0 = 0.2375
    sizes, reference = Sizes(K, 1.0, 1.0, 0.0), Reference(x_m_0, r)
    nothing = Adaptation(NO_DIFFERENCE, 0.0)

    def found_at(e_0: float, form: Form) -> Theorem:
        return theorem(sizes, reference, v_star, 1.0, e_0, lambda start: nothing, 1.0, form)

    e_0 = found_at(0.0, "printed").e_0_most
    found = [found_at(e_0, "printed"), found_at(e_0, "repaired")]
    assert found[0].positive > 0.0
    run = _known_run(
        told, ONE, K * ONE, lambda t: np.array([r]), symmetric(np.array([v_star])),
        np.array([-x_m_0 - e_0]), np.array([-x_m_0]),
    )  # fmt: skip
    printed, repaired = (sizes.K * (one.e_0_most - one.e_0) for one in found)
    return ConditionFails(printed, repaired, _saturated(run), run)


def tracking_error_left_out() -> ConditionFails:
    """(31) omits the tracking error that adaptation causes and that enters v_0 through K.

    Only d is unknown; it is a ramp. e settles at z / a, and K e is several times beta_2. The open
    loop is unstable: the control saturates, and the state diverges.
    """
    a, K, gamma, rate, d_star = 0.1, 10.0, 100.0, 0.1, 1.0
    told, k = scalar_model(a), math.sqrt(gamma)
    ramp = Varying(
        lambda t: np.array([[min(rate * t, d_star)]]), np.asarray(d_star), np.asarray(rate)
    )
    difference = control_difference(Channel(-a, k, 1.0, gamma), 0.0, rate)
    beta_2 = difference.lasting * math.sqrt(gamma)
    v_star = d_star + beta_2
    run = _known_run(
        told, ONE, K * ONE, lambda t: np.zeros(1), symmetric(np.array([v_star])), np.zeros(1),
        np.zeros(1), ramp, gamma,
    )  # fmt: skip
    tracking = float(bounds(loop(told.A, told.B, told.P, k, ONE, gamma), rate).tracking[0])
    sizes, reference = Sizes(K, 1.0, 1.0, d_star), Reference(0.0, 0.0)
    margins = [
        adaptive_budget(
            sizes, reference, v_star, 1.0, 0.0, difference, tracking, gamma, form
        ).margin
        for form in ("printed", "repaired")
    ]
    return ConditionFails(margins[0], margins[1], _saturated(run), run)


class Growth(NamedTuple):
    """V (15) of a loop with constant unknowns: initial value, and largest value for two sets."""

    start: float
    ball: float  # projection to a ball, as printed
    box: float


def ball_and_diagonal() -> Growth:
    """Pr onto a ball with a diagonal Lambda: V grows, but decreases in (16). Paper (10), (16)."""
    Lambda, gamma, k = np.diag([10.0, 0.1]), 100.0, 1.0
    told = ReferenceModel(-np.eye(2), np.eye(2), 2.0 * np.eye(2))
    truth = Uncertainty(
        constant(Lambda), np.asarray(0.1), Structure.DIAGONAL, d=constant(np.array([[1.0], [0.0]]))
    )
    plant = Plant(told, truth, lambda t: np.zeros(2))
    at = math.radians(60.0)
    d_hat = np.array([[math.cos(at)], [math.sin(at)]])
    x_til = np.array([0.0, 0.02])
    start = LoopState(x_til, x_til, np.zeros(2), Estimates(Lambda, d=d_hat))
    sets: dict[str, Set] = {
        "ball": Ball(1.0, 0.0),
        "box": Box(-np.ones((2, 1)), np.ones((2, 1)), 0.0),
    }
    largest = {}
    for name, kept_in in sets.items():
        laws = Laws(None, d=Block(gamma, kept_in), weight=Structure.DIAGONAL, unsound=True)
        run = simulate(ClosedLoop(plant, predictor(told, k), laws), start, 0.5, 1e-3)
        largest[name] = float(run.signals.V.max())
        first = float(run.signals.V[0])
    return Growth(first, **largest)


def setpoint_of_section_viii(params: Params, mass: float = 8.0) -> ConditionFails:
    """Section VIII claims that (4, 7, 18) m at f_m = 1, from rest at the origin, satisfies (31).

    It does not. The margins are those of |v_0(0)| = |mass (f_m^2 r_c + g e_3)| to the paper's v*
    (three channels of T_max) and to T_max, the limit of |T|; no wind, mass known.
    """
    r_c = np.array([4.0, 7.0, 18.0])
    f = params.f_m
    truth = Uncertainty(
        constant(np.eye(3) / mass), np.asarray(1.0 / mass), Structure.SCALAR,
        s=constant(np.zeros((3, 1))),
    )  # fmt: skip
    whole = position_loop(params, truth, lambda t: f * f * r_c, cone(params))
    nothing = np.zeros(6)
    estimates = Estimates(np.full((1, 1), 1.0 / mass), s=np.zeros((3, 1)))
    run = simulate(whole, LoopState(nothing, nothing, nothing, estimates), 1.0, 2e-3, every=5)
    demand = float(np.linalg.norm(mass * (f * f * r_c + np.array([0.0, 0.0, params.g]))))
    printed = limit(np.full(3, params.limits.T_max), "printed")
    return ConditionFails(printed - demand, params.limits.T_max - demand, _saturated(run), run)
