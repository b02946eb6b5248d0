"""What torque a jerk of the reference, or a gust, asks of the loop, whatever rotors and estimates are believed.

The tilt's matrix of `stability`, with the reference's acceleration for an input: attitude and rates that
follow it, rotors that lag, the tracking error that this makes and what closes it, and the disturbance
estimate, which has to make good what m_hat is off by. Torque is linear in the jerks that came before, so
what a jerk of one, however it is timed, can ask for is the L1 norm of that response: its sum.
Worked out when parameters change. README, "What thrust and torque reach together".
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fcu.guard import governor, margin, stability, wrench
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
    "lean_turns": 0.0,
    "promises": 1.0,
    "top": 0.0,
    "brake": 0.0,
    "down": 0.0,
}  # before `derived`
# The L1 norm of a gust over what a wind makes of it: a wind has no more than its greatest speed to swing
# by. How much was set by computed winds (gcs_tools/gusts).
NOT_REACHED = 1.6
# The same of level air and a gust along it, by the loop of a vehicle that leans and of one upright. The lesser counts:
# a loop that leans swings on with quick gains, as no wind that was flown makes it.
NOT_REACHED_LEANING, NOT_REACHED_UPRIGHT = 1.3, 1.12
HALVINGS = 8
LEVELS = 17  # at which a response is split
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


def pushed(params: Params, loop: Loop) -> Response | None:
    """The torque after a step of drag that accelerates with 1 m/s^2: as `stepped`."""
    h, push = params.h, np.zeros((len(loop.A), 1))
    push[0], push[1] = 0.5 * h * h, h  # way and its rate, by 1 m/s^2
    return stepped(loop._replace(B=push, D=np.zeros((2, 1))), 0)


def per_gust(params: Params, loop: Loop) -> float:
    """Torque (N m) for drag whose acceleration changes with 1 m/s^3, at most. inf if it swings on."""
    found = pushed(params, loop)
    if found is None or found.lasts >= 1.0:
        return math.inf
    return params.h * float(sums(found, gaussian=False)[1])


def per_swing(params: Params, loop: Loop, rate: float) -> float:
    """The same for drag whose acceleration changes with `rate` (m/s^3) and is within 1 m/s^2, at most.

    What the torque remembers of the changes, h(t), is split: of what is above a level in size each change counts, of
    the rest by parts the acceleration itself, with the whole way that it goes up and down. Any level bounds it.
    """
    found = pushed(params, loop)
    if found is None or found.lasts >= 1.0:
        return math.inf
    changes = rate * params.h * float(sums(found, gaussian=False)[1])
    h = found.h[:, 1]
    for level in np.linspace(0.0, np.abs(h).max(), LEVELS)[1:]:
        rest = np.clip(h, -level, level)
        above = rate * params.h * float(np.abs(h - rest).sum())
        changes = min(changes, above + float(np.abs(np.diff(rest, prepend=0.0, append=0.0)).sum()))
    return changes


def least_per_torque(rotors: RotorParams) -> float:
    """The least total thrust (N) by which a torque of 1 N m about any level axis is had: of the worst axis."""
    angles = 2.0 * math.pi / WAYS * np.arange(WAYS)
    return max(float(sum(thrusts(rotors.pairs, math.cos(a), math.sin(a)))) for a in angles)


def light_tilts(params: GuardParams, law: Params, T: float, side: float = math.nan) -> list[Loop]:
    """A matrix of each tilt of the least mass beside a thrust T (N).

    With rotors that lag the most, and drag that turns with the body.  side : N, as of Hover.
    """
    ticks, J = stability.late(law, params.delay_s), params.J_tilt
    here = stability.hover_of(params)._replace(
        m=params.m_min, J=(J, J, J), T_0=T, turns=True, side=side
    )
    lag, axes = stability.fade(law, max(LAGS)), (1,) if stability.alike(law) else (0, 1)
    return [stability.tilt(law, lag, 1.0, axis, here, ticks) for axis in axes]


def holding(law: Params, T: float) -> float:
    """Torque (N m) about any level axis that the pairs of rotors give beside a thrust T (N) of less than half."""
    return (T - law.rotors.W * law.rotors.f_min) / least_per_torque(law.rotors)


def greatest(low: float, high: float, turns: Callable[[float], bool]) -> float:
    """The greatest speed (m/s) between two at which it `turns`, by halves, or the low one."""
    if turns(high):
        return high
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if turns(middle) else (low, middle)
    return low


def lift_turns(params: GuardParams, law: Params) -> float:
    """The greatest drag from below (N) beside which the least mass has torque for a gust at its full rate.

    Where the air past the vehicle rises with u, drag carries c u^2 of the weight, and a gust turns it with
    c u w_dot_max. What the loop makes of that, with rotors that lag the most and drag that turns with
    the body, may be NOT_REACHED times the torque that the rest of the weight holds. It is no less than
    where the vehicle sinks with SLOWEST, nor more than where a tilt steers (`stability.lift`).
    """
    low, high = params.w_max + governor.SLOWEST, math.sqrt(params.lift / params.c_D)
    if law.achieved < 0.5 or high <= low:
        return params.lift

    def turns(u: float) -> bool:
        """True where the air past it rises with u, m/s, and it still has that torque."""
        T = params.m_min * law.g - params.c_D * u * u
        holds = holding(law, T)
        if holds <= 0.0:
            return False
        gust = params.c_D * u * params.w_dot_max / params.m_min  # m/s^3
        loops = light_tilts(params, law, T)
        return all(per_gust(law, loop) * gust <= NOT_REACHED * holds for loop in loops)

    u = greatest(low, high, turns)
    return params.lift if u == high else params.c_D * u * u


class Leaning(NamedTuple):
    """A vehicle of the least mass that leans into level air, with drag across its thrust alone: so it has the least."""

    T: float  # N, its thrust
    side: float  # N, to the side over a tilt, with what drag adds as it turns
    gusts: float  # N/(m/s), change of its drag over that of the air along the way


def leaning(params: GuardParams, law: Params, u: float) -> Leaning:
    """The Leaning in air of u (m/s): m g sin = c u^2 cos^2, of its angle from upright."""
    y = params.c_D * u * u / (params.m_min * law.g)
    sine = 2.0 * y / (1.0 + math.sqrt(1.0 + 4.0 * y * y))
    cosine = math.sqrt(1.0 - sine * sine)
    T, drag = params.m_min * law.g * cosine, params.c_D * u
    return Leaning(T, T + 2.0 * drag * u * sine * cosine, 2.0 * drag * cosine * cosine)


def for_gust(params: GuardParams, law: Params, u: float) -> tuple[float, float]:
    """Torque (N m) that a gust along level air of u (m/s) asks of the least mass, over NOT_REACHED, and that its thrust holds."""
    T, side, gusts = leaning(params, law, u)
    swing = gusts * params.w_max / params.m_min  # m/s^2
    rate = params.w_dot_max / max(params.w_max, 1e-9)  # 1/s
    leans, upright = (
        max(swing * per_swing(law, loop, rate) for loop in light_tilts(params, law, T, pull))
        for pull in (side, math.nan)
    )
    asked = min(leans / NOT_REACHED_LEANING, upright / NOT_REACHED_UPRIGHT)
    return asked, holding(law, T)


def lean_turns(params: GuardParams, law: Params) -> float:
    """The greatest drag in level air (N) beside which the least mass has torque for a gust at its full rate.

    As `lift_turns`, with a gust along the way: drag is quadratic, so it changes with 2 c u w_dot_max there. It is no
    less than at SLOWEST against the greatest wind, nor more than where a tilt steers (`margin.leant`).
    """
    most = float(margin.leant(params, law))
    low, high = params.w_max + governor.SLOWEST, math.sqrt(most / params.c_D)
    if law.achieved < 0.5 or high <= low:
        return most

    def turns(u: float) -> bool:
        """True where the level air past it has u, m/s, and it still has that torque."""
        asked, holds = for_gust(params, law, u)
        return asked <= holds

    u = greatest(low, high, turns)
    return most if u == high else params.c_D * u * u


def derived(params: GuardParams, law: Params) -> GuardParams:
    """The parameters, with what the torque about a level axis is held to around this law."""
    B = np.array([law.rotors.B_x, law.rotors.B_y])
    params = params._replace(
        swinging=swinging(params, law),
        spread=math.sqrt(float((B * B).sum(axis=0).max())),
        lift_turns=lift_turns(params, law),
        lean_turns=lean_turns(params, law),
    )
    params = params._replace(T_turns=float(wrench.turns_up_to(params, law)))
    known = margin.known(params._replace(promises=1.0), law)
    top, brake = governor.speeds(known)
    return params._replace(
        promises=1.0, top=float(top), brake=float(brake), down=float(margin.sinking(known))
    )
