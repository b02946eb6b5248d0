"""What torque a jerk of the reference, or a gust, asks of the loop, whatever rotors and estimates are believed.

The tilt's matrix of `stability`, with the reference's acceleration for an input: attitude and rates that
follow it, rotors that lag, the tracking error that this makes and what closes it, and the disturbance
estimate, which has to make good what m_hat is off by. Torque is linear in the jerks that came before, so
what a jerk of one, however it is timed, can ask for is the L1 norm of that response: its sum.
Worked out when parameters change. README, "What thrust and torque reach together".
"""

from __future__ import annotations

import math

import numpy as np

from fcu.guard import stability, wrench
from fcu.guard.governor import SLOWEST
from fcu.guard.noise import LONGEST, Response, sums
from fcu.guard.stability import INPUTS, LAGS, OFF, Hover, Loop
from fcu.guard.types import GuardParams
from fcu.laws.allocation import RotorParams
from fcu.laws.least_thrust import thrusts
from fcu.laws.mmrac.types import Params

ENDLESS = 1e6  # 1/s: of a loop that does not settle
LEFT = 1e-4  # of the slowest mode, where a response is taken to have ended
BLOCK = 6  # doublings of a tick after which the other factor is doubled
NOT_YET = {
    "swinging": ENDLESS,
    "spread": 1.0,
    "T_turns": math.inf,
    "lift_turns": 0.0,
}  # before `derived`
# The L1 norm of a gust over what a wind makes of it: a wind has no more than its greatest speed to swing
# by. How much was set by computed winds (gcs_tools/gusts).
NOT_REACHED = 1.6
HALVINGS = 8
WAYS = 64  # directions of a torque


def stepped(loop: Loop, column: int) -> Response | None:
    """The demand after a step of an input, less where it ends: float64[ticks, 2]; None if it never does.

    column : of INPUTS.
    """
    radius = float(np.abs(np.linalg.eigvals(loop.A)).max())
    if radius >= 1.0:
        return None
    # C A^(i + j BLOCK) x, by rows C A^i and columns A^(j BLOCK) x: no product that is large
    rows, power, columns = loop.C, loop.A, np.linalg.solve(
        np.eye(len(loop.A)) - loop.A, loop.B[:, column : column + 1]
    )  # fmt: skip
    ticks = math.log(LEFT) / math.log(max(radius, 1e-3))
    for k in range(min(math.ceil(math.log2(max(ticks, 2.0))), LONGEST)):
        if k < BLOCK:
            rows = np.vstack([rows, rows @ power])
        else:
            columns = np.hstack([columns, power @ columns])
        power = power @ power
    each = (rows @ columns).reshape(-1, len(loop.C), columns.shape[1])
    h = each.transpose(2, 0, 1).reshape(-1, len(loop.C))
    return Response(h, radius ** (len(h) // 2))


def norm(params: Params, loop: Loop, here: Hover, axis: int) -> float:
    """Torque over inertia (1/s) for a demand that turns with 1 rad/s, at most; ENDLESS if it swings on."""
    found = stepped(loop, INPUTS.index("reference"))
    if found is None or found.lasts >= 1.0:
        return ENDLESS
    per_jerk = params.h * float(sums(found, gaussian=False)[1])  # N m of torque over m/s^3
    return per_jerk * here.thrust(params.g) / (here.m * here.J[axis])


def swinging(params: GuardParams, law: Params) -> float:
    """The greatest `norm` about hover, over LAGS, and the estimates that the rule on gains allows for.

    m_hat at either end of the believed masses with the mass at the other, and m_hat and J_hat right or 3 dB
    off. It grows with the lag: the greatest is taken.
    """
    if law.achieved < 0.5:
        return float(wrench.turning(law))  # of the printed prediction there is no rule
    ticks = stability.late(law, params.delay_s)
    J = params.J_tilt
    here = Hover(m=params.m_min, J=(J, J, J))
    wide = params.m_max / params.m_min
    doubts = ((wide, 1.0), (1.0 / wide, 1.0), *((off, off) for off in OFF))
    lag, worst = stability.fade(law, max(LAGS)), 0.0
    for axis in (1,) if stability.alike(law) else (0, 1):
        for off, off_J in doubts:
            loop = stability.tilt(law, lag, off, axis, here, ticks, off_J)
            worst = max(worst, norm(law, loop, here, axis))
    return worst


def per_gust(params: Params, loop: Loop) -> float:
    """Torque (N m) for drag whose acceleration changes with 1 m/s^3, at most. inf if it swings on."""
    h, pushed = params.h, np.zeros((len(loop.A), 1))
    pushed[0], pushed[1] = 0.5 * h * h, h  # way and its rate, by 1 m/s^2
    found = stepped(loop._replace(B=pushed, D=np.zeros((2, 1))), 0)
    if found is None or found.lasts >= 1.0:
        return math.inf
    return h * float(sums(found, gaussian=False)[1])


def least_per_torque(rotors: RotorParams) -> float:
    """The least total thrust (N) by which a torque of 1 N m about any level axis is had: of the worst axis."""
    angles = 2.0 * math.pi / WAYS * np.arange(WAYS)
    return max(float(sum(thrusts(rotors.pairs, math.cos(a), math.sin(a)))) for a in angles)


def lift_turns(params: GuardParams, law: Params) -> float:
    """The greatest drag from below (N) beside which the least mass has torque for a gust at its full rate.

    Where the air past the vehicle rises with u, drag carries c u^2 of the weight, and a gust turns it with
    c u w_dot_max. What the loop makes of that, with rotors that lag the most and drag that turns with
    the body, may be NOT_REACHED times the torque that the rest of the weight holds. It is no less than
    where the vehicle sinks with SLOWEST, nor more than where a tilt steers (`stability.lift`).
    """
    if law.achieved < 0.5:
        return params.lift
    ticks, J = stability.late(law, params.delay_s), params.J_tilt
    lag, per_torque = stability.fade(law, max(LAGS)), least_per_torque(law.rotors)
    light = stability.hover_of(params)._replace(m=params.m_min, J=(J, J, J), turns=True)
    axes = (1,) if stability.alike(law) else (0, 1)

    def turns(u: float) -> bool:
        """True where the air past it rises with u, m/s, and it still has that torque."""
        T = params.m_min * law.g - params.c_D * u * u
        holds = (T - law.rotors.W * law.rotors.f_min) / per_torque
        if holds <= 0.0:
            return False
        gust = params.c_D * u * params.w_dot_max / params.m_min  # m/s^3
        loops = (stability.tilt(law, lag, 1.0, axis, light._replace(T_0=T), ticks) for axis in axes)
        return all(per_gust(law, loop) * gust <= NOT_REACHED * holds for loop in loops)

    low, high = params.w_max + SLOWEST, math.sqrt(params.lift / params.c_D)
    if high <= low or turns(high):
        return params.lift
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if turns(middle) else (low, middle)
    return params.c_D * low * low


def derived(params: GuardParams, law: Params) -> GuardParams:
    """The parameters, with what the torque about a level axis is held to around this law."""
    B = np.array([law.rotors.B_x, law.rotors.B_y])
    params = params._replace(
        swinging=swinging(params, law),
        spread=math.sqrt(float((B * B).sum(axis=0).max())),
        lift_turns=lift_turns(params, law),
    )
    return params._replace(T_turns=float(wrench.turns_up_to(params, law)))
