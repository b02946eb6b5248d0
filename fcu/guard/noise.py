"""What noise of the measurement takes of the actuators: force, and torque. Not in the paper.

The loop about hover (`stability`) answers a sample of noise with the demand h_k, k ticks later. So a
noise that is bounded by b in each sample moves the demand by b sum |h_k| at most, however it is
chosen; a white one of standard deviation s by one of s sqrt(sum h_k^2), of which SIGMAS are kept.
Worked out when parameters change, and only if noise is believed, for the worst of what is believed
beside it: every mass and every m_hat between m_min and m_max, J_hat as great as J is believed to be,
and measurements late by the believed delay. README, "What noise takes".
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from fcu.guard import stability
from fcu.guard.stability import NOISE, Hover, Loop
from fcu.guard.types import GuardParams
from fcu.laws.mmrac.types import Params

Array = np.ndarray[Any, np.dtype[np.float64]]

SIGMAS = 6.0  # of white noise, that are kept
LEFT = 1e-4  # of the slowest mode, where a response is taken to have ended
ENDLESS = 1e6  # N, N m, N^2 m: of a loop that does not settle
LONGEST = (
    12  # doublings of a tick that are computed; what is slower goes on as its slowest mode does
)


class Taken(NamedTuple):
    """What noise takes: the least and the greatest there is of it, or SIGMAS standard deviations."""

    force: float  # N, of the demanded force, in hover
    top: float  # N, of it at full thrust
    torque: float  # N m about a level axis that is as much for a rotor, whatever the thrust
    turning: float  # N m N, and over the thrust


NOTHING = Taken(force=0.0, top=0.0, torque=0.0, turning=0.0)


NOT_YET = {
    "noise_force": 0.0,
    "noise_top": 0.0,
    "noise_torque": 0.0,
    "noise_turning": 0.0,
}  # before `derived`


def amounts(params: GuardParams) -> Array:
    """float64[4]: noise of position (m), velocity (m/s), attitude (rad), rate (rad/s), by axis."""
    return np.array([params.noise_r, params.noise_v, params.noise_q, params.noise_w])


class Response(NamedTuple):
    """What one sample of an input makes of the demand."""

    h: Array  # float64[ticks, 2, 5]: the demand after one sample of each of INPUTS
    lasts: float  # of the slowest mode, what is left of it over the second half of those ticks


def response(loop: Loop) -> Response | None:
    """What the loop makes of a sample of noise; None if it does not settle."""
    radius = float(np.abs(np.linalg.eigvals(loop.A)).max())
    if radius >= 1.0:
        return None
    rows, power = loop.C, loop.A
    ticks = math.log(LEFT) / math.log(max(radius, 1e-3))
    for _ in range(min(math.ceil(math.log2(max(ticks, 2.0))), LONGEST)):
        rows, power = np.vstack([rows, rows @ power]), power @ power
    h = np.concatenate([loop.D[None], (rows @ loop.B).reshape(-1, *loop.D.shape)])
    return Response(h, radius ** (len(h) // 2))


def sums(found: Response, gaussian: bool) -> Array:
    """float64[2, 5]: what the demand moves by for each input of 1: a sum, or a root of one of squares.

    What comes after the ticks of the response is counted as its second half over and over, each time as
    much smaller as the slowest mode is by then.
    """
    h, lasts = found
    size = h * h if gaussian else np.abs(h)
    each = lasts * lasts if gaussian else lasts
    late = size[len(h) // 2 :].sum(axis=0) * (each / (1.0 - each))
    total = size.sum(axis=0) + late
    return np.asarray(np.sqrt(total) if gaussian else total)


def together(parts: Array, gaussian: bool) -> Array:
    """Of independent parts along the last axis."""
    return np.asarray(np.sqrt((parts * parts).sum(axis=-1)) if gaussian else parts.sum(axis=-1))


class _Of(NamedTuple):
    """What the noise of one mass, one m_hat and one thrust moves."""

    force: float  # N, of the demanded force, in any direction
    thrust: float  # N, of total thrust with its trim
    torque: Array  # float64[2], N m, about roll and pitch, whatever the thrust
    turning: Array  # float64[2], N m N, and over it


def _of(params: GuardParams, law: Params, m: float, m_hat: float, T_0: float) -> _Of | None:
    gaussian, given = params.gaussian > 0.5, amounts(params)
    off = m_hat / m
    J = params.J_tilt / off  # so that J_hat is what is believed at most
    here, lag = Hover(m=m, J=(J, J, J), T_0=T_0), stability.fade(law)
    ticks = stability.late(law, params.delay_s)
    loops = [
        stability.height(law, lag, off, here, ticks),
        stability.tilt(law, lag, off, 0, here, ticks),
        stability.tilt(law, lag, off, 1, here, ticks),
    ]
    found = []
    for loop in loops:
        answer = response(loop)
        if answer is None or answer.lasts >= 1.0:
            return None
        found.append(sums(answer, gaussian)[:, : len(NOISE)] * given)
    height, *tilts = found
    across = [float(together(tilt[0], gaussian)) for tilt in tilts]
    along = float(together(height[0], gaussian))
    return _Of(
        thrust=float(together(height[1], gaussian)),
        force=max(along, *across) if gaussian else math.hypot(along, *across),
        torque=np.array([together(tilt[1, 2:], gaussian) for tilt in tilts]),
        turning=np.array([together(tilt[1, :2], gaussian) * T_0 for tilt in tilts]),
    )


def taken(params: GuardParams, law: Params) -> Taken:
    """What the noise that is believed takes, of the worst that is believed beside it."""
    if not amounts(params).any() or law.achieved < 0.5:
        return NOTHING
    gaussian, rotors = params.gaussian > 0.5, law.rotors
    kept = SIGMAS if gaussian else 1.0
    B = np.abs(np.array([rotors.B_x, rotors.B_y]))  # float64[2, 8]
    spread = math.sqrt(float((B * B).sum(axis=0).max()))

    def of_rotor(torque: Array, thrust: float) -> float:
        """N m about a level axis that asks as much of a rotor as torque about both, and thrust."""
        parts = np.vstack([torque[:, None] * B, np.full((1, B.shape[1]), thrust / rotors.W)])
        return float(together(parts.T, gaussian).max()) / spread

    worst = NOTHING
    masses = {params.m_min, params.m_max}
    for m, m_hat in ((m, m_hat) for m in masses for m_hat in masses):
        found = _of(params, law, m, m_hat, m * law.g)
        full = _of(params, law, m, m_hat, law.limits.T_max)
        if found is None or full is None:
            return Taken(force=ENDLESS, top=ENDLESS, torque=ENDLESS, turning=ENDLESS)
        worst = Taken(
            force=max(worst.force, kept * found.force),
            top=max(worst.top, kept * full.force),
            torque=max(worst.torque, kept * of_rotor(found.torque, found.thrust)),
            turning=max(worst.turning, kept * of_rotor(found.turning, 0.0)),
        )
    return worst


def derived(params: GuardParams, law: Params) -> GuardParams:
    """The parameters, with what their noise takes around this law."""
    found = taken(params, law)
    return params._replace(
        noise_force=found.force,
        noise_top=found.top,
        noise_torque=found.torque,
        noise_turning=found.turning,
    )


def beyond(rotors: int, sigmas: float) -> float:
    """Probability that in one tick white noise goes beyond what is kept of so many `sigmas`.

    A rotor at either end of what it gives, each one side of a normal distribution; and the force in
    any direction, three normal ones.
    """
    tail = 0.5 * math.erfc(sigmas / math.sqrt(2.0))
    force = 2.0 * tail + sigmas * math.sqrt(2.0 / math.pi) * math.exp(-0.5 * sigmas * sigmas)
    return 2.0 * rotors * tail + force


def probability(law: Params, seconds: float) -> float:
    """At most so probable it is that white noise, where it is kept room for, saturates anything.

    The union bound, over the ticks of so many seconds.
    """
    return min(1.0, seconds / law.h * beyond(law.rotors.n, SIGMAS))
