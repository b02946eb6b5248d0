"""Prediction error over gamma for the position loop of the octocopter in the paper's wind."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fcu.laws.mmrac.types import Params
from fcu.theory import scenes
from fcu.theory.adaptive import Estimates
from fcu.theory.arrays import Array
from fcu.theory.bounds import Assumed, Blocks, Unknown, prediction_bound
from fcu.theory.linear_loop import NoBoundError
from fcu.theory.loop_bounds import Flight, position_bounds
from fcu.theory.octocopter import position_loop
from fcu.theory.projection import Structure
from fcu.theory.simulate import ClosedLoop, LoopState, Run, simulate
from fcu.theory.systems import Uncertainty, Varying, constant, unlimited

DRAG = 0.15  # N/(m/s)^2
STEP = 0.3  # integration step times the fastest frequency, rad


class GammaSweep(NamedTuple):
    """Largest prediction errors (m/s) in hover and their bounds, one per gamma."""

    gamma: Array
    measured: Array
    lyapunov: Array  # (20), of order 1/sqrt(gamma)
    inverse: Array  # of order 1/gamma; NaN without a bound, or if the projection of m_hat acted


def with_gamma(params: Params, gamma: float) -> Params:
    """The same law with another gamma: block gains scaled in proportion, lambda = sqrt(gamma)."""
    scale = gamma / params.gamma
    return params._replace(
        gamma=gamma,
        gamma_m=params.gamma_m * scale,
        gamma_Lambda=params.gamma_Lambda * scale,
        gamma_J=params.gamma_J * scale,
        gamma_LambdaJ=params.gamma_LambdaJ * scale,
        gamma_c=params.gamma_c * scale,
        lambda_v=math.sqrt(gamma),
        lambda_w=math.sqrt(gamma),
    )


# The projection set of the mass estimate, relative to the true mass. In the paper's wind the
# estimate of 8 kg moves between 0.9544 and 1.0533, at gamma from 1000 to 1e5. With a set of 6 % no
# bound exists at gamma = 1000, because the force is too uncertain.
LOW, HIGH = 0.954, 1.055


def believing(params: Params, mass: float) -> Params:
    """The same law with its mass estimate limited to LOW to HIGH times a mass (kg)."""
    bounds = params.bounds._replace(m_min=mass * LOW, m_max=mass * HIGH)
    return params._replace(bounds=bounds, initial=params.initial._replace(m_hat_0=mass))


def hover_loop(params: Params, mass: float, s: Varying) -> ClosedLoop:
    """The position loop at the origin with disturbance s ((..., 3, 1), m/s^2), without limits."""
    Lambda = constant(np.eye(3) / mass)
    truth = Uncertainty(Lambda, np.asarray(1.0 / mass), Structure.SCALAR, s=s)
    return position_loop(params, truth, lambda t: np.zeros(3), unlimited)


def hover_start(mass: float, batch: tuple[int, ...] = ()) -> LoopState:
    """At rest at the origin, with known mass and an estimated disturbance of zero."""
    nothing = np.zeros((*batch, 6))
    Lambda_hat = np.full((*batch, 1, 1), 1.0 / mass)
    return LoopState(
        nothing, nothing, nothing, Estimates(Lambda_hat, s=np.zeros((*batch, 3, 1)))
    )  # fmt: skip


def hover_run(
    params: Params, mass: float, s: Varying, duration: float, batch: tuple[int, ...] = ()
) -> Run:
    """A simulated hover; the step size follows from the gains."""
    weight = mass * params.g
    fastest = math.sqrt(params.gamma + params.gamma_Lambda * (1.3 * weight) ** 2)
    h = STEP / max(fastest, params.lambda_v)
    kept = max(1, int(0.02 / fastest / h * 10.0))
    return simulate(hover_loop(params, mass, s), hover_start(mass, batch), duration, h, every=kept)


def at_edge(run: Run, mass: float) -> bool:
    """Whether the mass estimate ever reached LOW or HIGH, where its projection acts."""
    m_hat = 1.0 / (mass * run.states.estimates.Lambda)
    return bool((m_hat <= 1.0001 * LOW).any() or (m_hat >= 0.9999 * HIGH).any())


def hover_assumed(params: Params, mass: float, s: Array, s_rate: Array) -> Assumed:
    """Assumptions of (14): projection sets, and bounds of s and its rate by axis (3,)."""
    b = params.bounds
    width = max(1.0 / b.m_min - 1.0 / mass, 1.0 / mass - 1.0 / b.m_max)
    farthest = float(np.linalg.norm(np.asarray(s) + b.s_v_max))
    return Assumed(
        Unknown(1.0 / mass, error=width),
        1.0 / mass,
        s=Unknown(float(np.linalg.norm(s)), float(np.linalg.norm(s_rate)), error=farthest),
    )


def lyapunov_settled(params: Params, assumed: Assumed) -> float:
    """(20) of the position loop (m/s), with P = I and no A in the velocity predictor."""
    gammas = Blocks(Lambda=params.gamma_Lambda, s=params.gamma)
    bound = prediction_bound(
        assumed, gammas, params.lambda_v, np.eye(3), np.zeros((3, 3)), np.zeros(3)
    )
    return float(bound.settled)


def prediction_against_gamma(
    gammas: Sequence[float], params: Params, mass: float = 8.0, duration: float = 12.0
) -> GammaSweep:
    """Simulate a hover of `duration` s in the paper's wind at each gamma, and bound its errors.

    The mass estimate is limited to LOW to HIGH times the mass (kg). The errors are measured over
    the whole hover, from a start with known mass and a wind estimate of zero. The bound of order
    1/gamma is that of a hover in which the projection of the mass estimate does not act, which
    only the simulation tells.
    """
    amplitude, omega = scenes.WIND
    s = scenes.drag(amplitude, omega, DRAG / mass)
    most = DRAG / mass * amplitude**2
    flight = Flight(most, most * omega, np.zeros(3), np.zeros(3), LOW, HIGH)
    rows = []
    for gamma in gammas:
        law = believing(with_gamma(params, gamma), mass)
        run = hover_run(law, mass, s, duration)
        measured = float(np.linalg.norm((run.states.x - run.states.x_hat)[..., 3:], axis=-1).max())
        try:
            inverse = position_bounds(law, mass, flight).prediction
        except NoBoundError:
            inverse = math.nan
        if at_edge(run, mass):
            inverse = math.nan
        assumed = hover_assumed(law, mass, most, most * omega)
        rows.append((gamma, measured, lyapunov_settled(law, assumed), inverse))
    return GammaSweep(*np.array(rows).T)
