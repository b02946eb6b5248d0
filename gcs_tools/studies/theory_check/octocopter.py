"""The octocopter's loops held against their sharpest bounds: how tight are they?

Position loop and rate loops at rest, in the paper's wind and under the worst disturbances of the
same bounds: always moving at the full rate, back and forth at the frequency that the errors like
best. gamma is 1000 and more, masses and gains vary.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from fcu.laws.mmrac.types import Params
from fcu.theory import scenes
from fcu.theory.adaptive import Estimates
from fcu.theory.arrays import Array
from fcu.theory.linear_loop import NoBoundError
from fcu.theory.loop_bounds import Flight, FlightBounds, position_bounds, rate_bounds
from fcu.theory.octocopter import rate_loop
from fcu.theory.projection import Structure
from fcu.theory.simulate import LoopState, Run, simulate, step_for
from fcu.theory.sweep import HIGH, LOW, believing, hover_run, with_gamma
from fcu.theory.systems import Uncertainty, Varying, constant, unlimited
from gcs_tools.studies.theory_check.check import Excluded, Held, held

DRAG, TURNING_DRAG = 0.15, 0.05  # N/(m/s)^2, N m/(rad/s)^2
INERTIA = (0.3245, 0.4616)  # kg m^2, of roll and pitch, and of yaw
WAVES = (0.06, 0.25, 0.5, 0.9, 1.5)  # of sqrt(gamma): rad/s of the worst disturbances
SLOW = (1.0, 2.0)  # rad/s, where the reference model amplifies most
NAMES = ("prediction", "control difference", "tracking")


class Scene(NamedTuple):
    """Disturbances side by side, (S, 3, 1), of the same rate (3,), and their largest values (3,)."""

    s: Varying
    most: Array
    rate: Array
    runs: int


def scene(amplitude: Array, omega: Array, over: float | Array, gamma: float) -> Scene:
    """The wind, and triangles of its rates that stay within its size."""
    wind = scenes.drag(amplitude, omega, over)
    most = over * amplitude**2
    rate = most * omega
    waves = np.array([*(w * np.sqrt(gamma) for w in WAVES), *SLOW])
    waves = np.maximum(waves[:, None], 0.5 * np.pi * rate / most)
    worst = scenes.triangle(rate, waves)

    def value(t: float) -> Array:
        return np.concatenate([wind.value(t)[None], worst.value(t)])

    bound = np.full(1 + len(waves), np.linalg.norm(most))
    return Scene(Varying(value, bound, 0.0 * bound + np.linalg.norm(rate)), most, rate, len(bound))


def compared(
    loop: str, bounds: FlightBounds, scene: int, x_til: Array, v_til: Array, e: Array
) -> Iterator[Held]:
    """The three bounds of one run against the largest that was simulated (arrays over time)."""
    values = bounds.prediction, bounds.control.peak, bounds.tracking
    for name, bound, found in zip(NAMES, values, (x_til, v_til, e), strict=True):
        # what shakes the prediction error at its own frequency does not move the vehicle
        aimed = name != "tracking" or not 1 <= scene <= len(WAVES)
        yield held(f"{loop}: {name}", bound, float(found.max()))._replace(aimed=aimed)


def _norm(rows: Array) -> Array:
    return np.asarray(np.linalg.norm(rows, axis=-1))


def excluded(loop: str, why: str) -> Iterator[Excluded]:
    """All three, for a reason."""
    return (Excluded(f"{loop}: {name}", why) for name in NAMES)


def position(
    params: Params, gamma: float, mass: float, duration: float
) -> Iterator[Held | Excluded]:
    """Hover of one mass: a start that knows it and believes in no disturbance."""
    law = believing(with_gamma(params, gamma), mass)
    drawn = scene(*scenes.WIND, DRAG / mass, gamma)
    flight = Flight(drawn.most, drawn.rate, np.zeros(3), np.zeros(3), LOW, HIGH)
    try:
        bounds = position_bounds(law, mass, flight)
    except NoBoundError:
        yield from excluded("position", "the regressor moves too far")
        return
    run = hover_run(law, mass, drawn.s, duration, (drawn.runs,))
    rho = 1.0 / (mass * run.states.estimates.Lambda[..., 0, 0])
    least, most = np.atleast_1d(rho.min(axis=0)), np.atleast_1d(rho.max(axis=0))
    states = run.states
    for i in range(drawn.runs):
        if least[i] <= 1.0001 * LOW or most[i] >= 0.9999 * HIGH:
            yield from excluded("position", "the projection of m_hat acts")
            continue
        yield from compared(
            "position", bounds, i, _norm((states.x - states.x_hat)[:, i, 3:]),
            _norm((run.signals.v_0 - run.signals.v)[:, i]),
            _norm((states.x - states.x_m)[:, i, :3]),
        )  # fmt: skip


def rates(
    params: Params, gamma: float, inertia: float, duration: float
) -> Iterator[Held | Excluded]:
    """Three rate loops of one inertia (kg m^2) at rest, couplings left out of plant and law.

    Their bounds hold though the projection of J_hat acts.
    """
    low, high, J = inertia * LOW, inertia * HIGH, np.full(3, inertia)
    scaled = with_gamma(params, gamma)
    law = scaled._replace(gamma_c=1e-9, bounds=scaled.bounds._replace(J_min=low, J_max=high))
    drawn = scene(*scenes.ROTATION, TURNING_DRAG / inertia, gamma)
    flight = Flight(drawn.most, drawn.rate, np.zeros(3), np.zeros(3), LOW, HIGH)
    bounds = rate_bounds(law, J, flight)
    run = _rate_run(law, drawn, J, duration)
    states, v_til = run.states, run.signals.v_0 - run.signals.v
    for i in range(drawn.runs):
        for axis in range(3):
            yield from compared(
                "rates", bounds[axis], i, np.abs((states.x - states.x_hat)[:, i, axis]),
                np.abs(v_til[:, i, axis]), np.abs((states.x - states.x_m)[:, i, axis]),
            )  # fmt: skip


def _rate_run(law: Params, drawn: Scene, J: Array, duration: float) -> Run:
    truth = Uncertainty(
        constant(np.diag(1.0 / J)), np.asarray(1.0 / J[0]), Structure.DIAGONAL,
        C=constant(np.zeros((3, 5))), s=drawn.s,
    )  # fmt: skip
    whole = rate_loop(law, truth, lambda t: np.zeros(3), unlimited)
    nothing = np.zeros((drawn.runs, 3))
    start = LoopState(nothing, nothing, nothing, Estimates(
        np.tile(1.0 / J[:, None], (drawn.runs, 1, 1)), C=np.zeros((drawn.runs, 3, 5)),
        s=np.zeros((drawn.runs, 3, 1)),
    ))  # fmt: skip
    h = step_for(whole, delta_u=0.1)
    return simulate(whole, start, duration, h, every=max(1, int(0.02 / (h * law.lambda_w))))


def octocopter_loops(
    params: Params, gammas: Sequence[float], masses: Sequence[float], duration: float
) -> Iterator[list[Held | Excluded]]:
    """All loops, one list for each that is simulated."""
    for gamma in gammas:
        for inertia in INERTIA:
            yield list(rates(params, gamma, inertia, duration))
        for mass in masses:
            yield list(position(params, gamma, mass, duration))
