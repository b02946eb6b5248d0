"""What torque a jerk of the reference asks of the loop, whatever rotors and estimates are believed.

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
from fcu.guard.noise import LONGEST, Response, sums
from fcu.guard.stability import INPUTS, LAGS, OFF, Hover, Loop
from fcu.guard.types import GuardParams
from fcu.laws.mmrac.types import Params

ENDLESS = 1e6  # 1/s: of a loop that does not settle
LEFT = 1e-4  # of the slowest mode, where a response is taken to have ended
BLOCK = 6  # doublings of a tick after which the other factor is doubled
NOT_YET = {"swinging": ENDLESS, "spread": 1.0, "T_turns": math.inf}  # before `derived`


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


def derived(params: GuardParams, law: Params) -> GuardParams:
    """The parameters, with what the torque about a level axis is held to around this law."""
    B = np.array([law.rotors.B_x, law.rotors.B_y])
    params = params._replace(
        swinging=swinging(params, law), spread=math.sqrt(float((B * B).sum(axis=0).max()))
    )
    return params._replace(T_turns=float(wrench.turns_up_to(params, law)))
