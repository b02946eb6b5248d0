"""Whether what is asked for meets the condition, and how much of it would. Not in the paper.

`foreseen` on flat buffers, for the edge of a process, in steps much coarser than a tick. A way is
what is flown one after the other: setpoints, each for so long, the last until it is reached.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from fcu.guard import arrival, foreseen, margin, present, wrench
from fcu.guard.governor import BRAKING, SLOWEST, inside, speeds, wanted
from fcu.guard.present import Beginning
from fcu.guard.types import GuardParams
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3, maximum, minimum, norm, select
from fcu.kernel.buffers import size, to_buffer, unpacker
from fcu.kernel.compile import kernel
from fcu.laws.mmrac.reference_model import a_ref, advance
from fcu.laws.mmrac.types import Params
from fcu.laws.setpoint import carried

Buffer = np.ndarray[Any, np.dtype[np.float64]]
Way = Sequence[tuple[Setpoint, float]]

LOOKS = 1000  # at a way's last setpoint, and at most at any other
HALVINGS = 10
LATE = 0.25  # part of a look, its last
FADED = 2.0  # time constants of the reference model, in which what was off it has faded
TAKEN_UP_S = 0.22  # for a governed reference to take up a plan's acceleration: later, it overshoots
UNSETTLED = 1e-3  # m/s^2: a reference model that lags so far behind (34) has not settled
STREAM_S = 0.5  # the next setpoint of a stream comes within: so long its acceleration is believed
_WIDTH = 1 + size(Setpoint)  # of a row of a way
BEGINNING = size(Beginning)

_unpack_params = unpacker(GuardParams)
_unpack_law = unpacker(Params)
_unpack_setpoint = unpacker(Setpoint)
_unpack_beginning = unpacker(Beginning)


@kernel
def pace_at(params_buffer, law_buffer):
    """What a plan has to keep to so that the reference follows it: the fields of Pace.

    Governed, the reference gets no faster than `governor.speeds` has it. All that is left there to
    brake with is a plan's, whose acceleration is fed forward, as far as it is taken up in TAKEN_UP_S.
    """
    params, law = _unpack_params(params_buffer), _unpack_law(law_buffer)
    known = margin.known(params, law)
    top, brake = speeds(known)
    down = maximum(margin.sinking(known), SLOWEST)
    steers = maximum(margin.steered(params), SLOWEST)
    governed = params.policy == 1.0
    jerk, _ = foreseen.fastest(params, law, Vec3(0.0, 0.0, -brake / BRAKING))
    taken_up = TAKEN_UP_S * wrench.jerk(params, law, math.inf)
    return (
        jerk,
        select(params.policy == 0.0, math.inf, minimum(brake / BRAKING, taken_up)),
        select(governed, minimum(top, steers), math.inf),
        select(governed, minimum(top, down), math.inf),
    )


@kernel
def ahead(params_buffer, law_buffer, way, beginning, believed=1.0):
    """The least `margin.condition` (N) on a way; arguments as of `tightest`."""
    worst, _, _, _, _ = tightest(params_buffer, law_buffer, way, beginning, believed)
    return worst


@kernel
def tightest(params_buffer, law_buffer, way, beginning, believed=1.0):
    """The least `margin.condition` (N) on a way, ungoverned, as `foreseen` looks at one; after how long
    (s), and the acceleration (m/s^2, E) that is demanded there, and the velocity (m/s, E); and after how
    long the vehicle stays within `arrival.ARRIVED_M` of the last setpoint, inf for longer than is looked.

    params_buffer : float64[size(GuardParams)].
    law_buffer : float64[size(Params)]; its first, h, is overwritten.
    way : float64[n, 1 + size(Setpoint)], for how long (s; the last: whatever it says), and what.
    beginning : float64[size(Beginning)], with which what is demanded now may admit what the beliefs
    alone do not: at each point of the way the larger of two margins holds.
    believed : 0 to have what is demanded now count alone, which tells what it is worth.
    Under every policy but to warn the acceleration changes no faster than `foreseen.fastest`. So slow, (34)
    may swing ever farther: a way that in the last LATE of the look is not flown as it asks has not been
    seen to an end, and misses the condition by the force that is missing there.
    """
    params, law = _unpack_params(params_buffer), _unpack_law(law_buffer)
    settled = foreseen.steps(law) * law.h
    known, adds = margin.known(params, law), foreseen.closed(law)
    # what a jump would take of the torque is no part of a way that keeps to the jerk
    more = select(params.policy == 0.0, foreseen.hurry(law), 1.0)
    worst, zero, begins = math.inf, Vec3(0.0, 0.0, 0.0), _unpack_beginning(beginning)
    began, at, a, v = 0.0, 0.0, zero, zero
    near, arrives, unsettled = arrival.ARRIVED_M - arrival.off_at_most(params, law), 0.0, 0.0
    pursuit, seen = foreseen.begun(begins.r_m, begins.v_m, begins.a_m), begins.present
    told, since = seen.told > 0.5, present.begun(law, seen, begins.r_m, begins.a_m)
    for i in range(len(way)):
        setpoint, for_s = _unpack_setpoint(way[i, 1:]), way[i, 0]
        last = i == len(way) - 1
        looked = settled if last else min(for_s, settled)
        n = max(1, math.ceil(LOOKS * looked / settled))
        law_buffer[0] = looked / n
        law = _unpack_law(law_buffer)
        for k in range(n):
            now = carried(setpoint, k * law.h)
            most, aside = foreseen.fastest(params, law, pursuit.a_m)
            point, pursuit = foreseen.onward(law, pursuit, now, most, aside)
            holds = foreseen.holds(known, more * point.a_d, more * point.off, point.v, adds)
            holds = select(believed > 0.5, holds, -math.inf)
            if told:
                since = present.gone_on(law, since, point.a_d)
                turns = present.turns(params, law, seen, since, point.change)
                if (most == math.inf or turns) and holds < worst:
                    holds = max(
                        holds,
                        present.condition(
                            params, law, known, seen, since, point.v, now.psi_c, more, adds
                        ),
                    )
            if holds < worst:
                worst, at, a, v = holds, began + k * law.h, more * point.a_d, point.v
            if norm(pursuit.r_m - now.r_c) > near:
                arrives = began + (k + 1) * law.h
            if k >= (1.0 - LATE) * n:
                unsettled = max(unsettled, point.unsettled)
        began += looked
        if last and unsettled > UNSETTLED and -params.m_max * unsettled < worst:
            worst, at, a, v = -params.m_max * unsettled, began, point.a_d, point.v
        unsettled = 0.0
        if for_s > settled and not last:  # with it from there on
            end = carried(setpoint, for_s)
            pursuit = foreseen.begun(end.r_c, end.v_c, setpoint.a_c)
            told = False  # of what there was then, nothing is left
            began += for_s - looked
            holds = foreseen.holds(known, more * setpoint.a_c, zero, end.v_c, adds)
            if holds < worst:
                worst, at, a, v = holds, began, more * setpoint.a_c, end.v_c
    arrives = arrives + FADED / arrival.slowest(law)
    return worst, at, a, v, select(arrives < began, arrives, math.inf)


@kernel
def follow(params_buffer, law_buffer, setpoint_buffer, ticks, reference):
    """Bring `reference` (float64[9]: r_m, v_m, a_m) on by as many ticks as the setpoint is flown.

    Governed, as it goes with the vehicle on it, at the least thrust that hover takes.
    """
    params, law = _unpack_params(params_buffer), _unpack_law(law_buffer)
    setpoint, known = _unpack_setpoint(setpoint_buffer), margin.known(params, law)
    zero = Vec3(0.0, 0.0, 0.0)
    r_m = Vec3(reference[0], reference[1], reference[2])
    v_m = Vec3(reference[3], reference[4], reference[5])
    a_m = Vec3(reference[6], reference[7], reference[8])
    for k in range(ticks):
        now = carried(setpoint, k * law.h)
        plain = a_ref(law, now, r_m, v_m)
        most, aside = foreseen.fastest(params, law, a_m)
        up = Vec3(a_m.x, a_m.y, a_m.z + law.g)
        if params.policy == foreseen.GOVERN:
            change = wanted(law, known, now, r_m, v_m, most) - a_m
            a = a_m + wrench.turned_to(change, up, most * law.h, aside * law.h)
            a_m = inside(known, v_m, 0.0, a, zero)
        else:
            a_m = a_m + wrench.turned_to(plain - a_m, up, most * law.h, aside * law.h)
        given = Setpoint(
            r_c=now.r_c + (a_m - plain) / (law.f_m * law.f_m),
            v_c=now.v_c, a_c=now.a_c, psi_c=now.psi_c, psi_dot_c=now.psi_dot_c,
            level=now.level, tilt_c=now.tilt_c, w_c=now.w_c, T_c=now.T_c,
        )  # fmt: skip
        r_m, v_m = advance(law, given, r_m, v_m)
    reference[0], reference[1], reference[2] = r_m.x, r_m.y, r_m.z
    reference[3], reference[4], reference[5] = v_m.x, v_m.y, v_m.z
    reference[6], reference[7], reference[8] = a_m.x, a_m.y, a_m.z


class Pace(NamedTuple):
    """What the reference follows; endless where the guard does not hold it."""

    jerk: float = math.inf  # m/s^3
    acceleration: float = math.inf  # m/s^2
    top: float = math.inf  # m/s
    down: float = math.inf  # m/s, downwards


class Tightest(NamedTuple):
    """The point of a way at which the condition holds by least."""

    margin: float  # N
    at: float  # s, from where the way begins
    a_d: Vec3  # m/s^2, E, acceleration demanded
    v: Vec3  # m/s, E
    arrives: float = (
        math.inf
    )  # s, after which the vehicle stays at the last setpoint; inf: not seen


class Look:
    """Looks ahead with one set of the guard's and of the law's parameters."""

    def __init__(self, params: GuardParams, law: Params) -> None:
        self._params = to_buffer(params)
        self._law = to_buffer(law)
        self._h = law.h
        self.pace = Pace(*map(float, pace_at(self._params, self._law)))

    def short(self, way: Way, reference: Buffer) -> float:
        """By how much (N) a way misses the condition; 0 if it meets it. Arguments as of `tightest`."""
        return max(0.0, -self.tightest(way, reference).margin)

    def tightest(self, way: Way, reference: Buffer) -> Tightest:
        """Where a way is nearest to missing the condition, or misses it most.

        reference : float64[9], r_m, v_m and a_m where it begins; or float64[BEGINNING].
        """
        beginning = np.zeros(BEGINNING)  # what is not told is zero, and says so
        beginning[: len(reference)] = reference
        rows = np.empty((len(way), _WIDTH))
        for row, (setpoint, for_s) in zip(rows, way, strict=True):
            row[0], row[1:] = for_s, to_buffer(setpoint)
        self._law[0] = self._h
        worst, at, a, v, arrives = tightest(self._params, self._law, rows, beginning)
        return Tightest(float(worst), float(at), Vec3(*a), Vec3(*v), float(arrives))


class Lack(NamedTuple):
    """A setpoint that misses the condition."""

    far: float  # m, that it leads
    speed: float  # m/s
    short: float  # N, that are missing
    part: float  # the largest part of it, from 0 to 1, that meets the condition


def most(
    look: Look, way_of: Callable[[float], Way], reference: Buffer, halvings: int = HALVINGS
) -> float:
    """The largest part, from 0 to 1, of which the way meets the condition, by halving.

    way_of : from a part to the way of it.
    """
    low, high = 0.0, 1.0
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        fits = look.short(way_of(middle), reference) == 0.0
        low, high = (middle, high) if fits else (low, middle)
    return low


def way_to(setpoint: Setpoint) -> Way:
    """The way of one setpoint of a stream: its acceleration ends when the next could be there."""
    if setpoint.a_c == Vec3(0.0, 0.0, 0.0):
        return [(setpoint, math.inf)]
    then: Setpoint = carried(setpoint, STREAM_S)
    return [(setpoint, STREAM_S), (then._replace(a_c=Vec3(0.0, 0.0, 0.0)), math.inf)]


def is_same_way(a: Setpoint, b: Setpoint) -> bool:
    """Whether two setpoints differ in yaw at most."""
    return (a.level, a.r_c, a.v_c, a.a_c) == (b.level, b.r_c, b.v_c, b.a_c)


def lack_of(look: Look, setpoint: Setpoint, short: float, reference: Buffer) -> Lack:
    """What a setpoint of a stream that misses the condition by `short` N asks for, and could."""
    r_m = Vec3(*reference[:3].tolist())
    to_go = setpoint.r_c - r_m

    def of(part: float) -> Way:
        v_c, a_c = part * setpoint.v_c, part * setpoint.a_c
        return way_to(setpoint._replace(r_c=r_m + part * to_go, v_c=v_c, a_c=a_c))

    part = most(look, of, reference)
    return Lack(far=norm(to_go), speed=norm(setpoint.v_c), short=short, part=part)
