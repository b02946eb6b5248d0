"""What a setpoint will ask of the actuators, before it is flown. Not in the paper as such.

The paper's condition (31) bounds the demand by norms; this follows the way that the reference
model (34) lays down, and asks the exact set of what the actuators reach at every step of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fcu.guard import margin, wrench
from fcu.guard.margin import Doubted
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3, maximum, minimum, norm, select
from fcu.kernel.buffers import unpacker
from fcu.kernel.compile import kernel
from fcu.laws.mmrac.reference_model import a_ref
from fcu.laws.setpoint import carried

QUICK = 0.6  # of a time constant of the reference model: attitude and rates may lag so much
QUICKEST = (
    1.2  # beyond it attitude does not follow what is governed; where that begins was set by flights
)
WARN, GOVERN, REFUSE = 0.0, 1.0, 2.0  # policies
LONGEST = 300.0  # s, that is looked ahead at most
LITTLE = 0.0125  # of the weight
SETTLED = 8.0  # time constants of the reference model after which there is nothing to come

_unpack_setpoint = unpacker(Setpoint)


@kernel
def steps(law):
    """How many steps of law.h it takes the reference model to settle."""
    slowest = law.f_m * minimum(law.zeta_m, 0.5 / maximum(law.zeta_m, 0.5))
    return math.ceil(minimum(SETTLED / slowest, LONGEST) / law.h)


@kernel
def fastest(params, law, a):
    """Fastest change (m/s^3) of the reference's acceleration, as far as it can be known before.

    And the fastest across the demand.  a : m/s^2, E, of the reference.
    """
    governed = select(
        params.policy == REFUSE,
        wrench.jerk_ahead(params, law, a.z),
        wrench.jerk(params, law, math.inf),
    )
    across = wrench.across_ahead(params, law, a, governed)
    warns = params.policy == WARN
    return select(warns, math.inf, governed), select(warns, math.inf, across)


@kernel
def lags(law):
    """2 zeta_m f_m (1/c_theta + 1/c_q): the reference model's rate times the lags of attitude and rates."""
    return 2.0 * law.zeta_m * law.f_m * (1.0 / law.c_angle.y + 1.0 / law.c_rate.y)


@kernel
def hurry(law):
    """What a demand is multiplied by for a reference model too quick for attitude and rates.

    1 while `lags` is below QUICK. Above, a step also runs into the torque
    of the rotors, which the condition does not know: each per cent more counts as one of demand.
    Where that begins was set by flights.
    """
    return maximum(1.0, lags(law) / QUICK)


@kernel
def advanced(law, a_d, r, v, w, a):
    """Where the vehicle is a step later: r, v, w, a (m, m/s, m/s^2, m/s^2, E).

    Its acceleration a follows the one demanded, a_d, behind two lags: that of attitude, 1/c_theta
    (to w), and that of the rates, 1/c_q. A reference model too fast for them demands more than it
    would without.
    """
    before = a
    w = a_d + math.exp(-law.h * law.c_angle.y) * (w - a_d)
    a = w + math.exp(-law.h * law.c_rate.y) * (a - w)
    v = v + (0.5 * law.h) * (before + a)
    return r + law.h * v, v, w, a


@kernel
def fading(law, doubted, slow, peak):
    """A Doubted a step of the look ahead later, which may be longer than the lags. Paper (30).

    slow, peak : 1 - FORGOTTEN and PEAK, as `margin.faded` has them. Each 1 for changes with their signs.
    """
    of_attitude = math.exp(-slow * law.h * law.c_angle.y)
    of_rates = math.exp(-slow * law.h * law.c_rate.y)
    kept = math.exp(-0.5 * law.h * law.lambda_v)  # (30)
    return margin.passed_on(doubted, of_attitude, of_rates, kept, peak)


@kernel
def closed(law):
    """What closing the tracking error adds to the demand, over `margin.difference`.

    The control difference z moves the vehicle off its reference, e'' + 2 zeta f e' + f^2 e = z, and
    the demand with it: the L1 norm of (2 zeta f s + f^2)/(s^2 + 2 zeta f s + f^2), times what of z is
    slow. Not in (31).
    """
    zeta = minimum(law.zeta_m, 0.99)  # above it the norm is smaller
    root = math.sqrt(1.0 - zeta * zeta)
    first = math.exp(-2.0 * zeta * math.acos(zeta) / root)  # overshoots of its step response
    gain = 1.0 + 2.0 * first / (1.0 - math.exp(-math.pi * zeta / root))
    return gain * margin.SETTLES / margin.LASTS


@kernel
def holds(known, a_d, off, v, adds):
    """The condition (N) for a demand a_d (m/s^2, E) that is off by `off`, either way.

    adds : `closed`.
    """
    more = adds * margin.difference(known, norm(v))
    return minimum(
        margin.condition(known, a_d + off, v, more), margin.condition(known, a_d - off, v, more)
    )


@kernel
def closing(law, e, e_dot):
    """Acceleration (m/s^2) that closes a tracking error; Vec3 or float."""
    return -2.0 * law.f_m * law.zeta_m * e_dot - (law.f_m * law.f_m) * e


class Pursuit(NamedTuple):
    """A reference model on its way, and the vehicle that follows it behind its lags."""

    r_m: Vec3  # m, E
    v_m: Vec3  # m/s, E
    a_m: Vec3  # m/s^2, E
    r: Vec3  # of the vehicle
    v: Vec3
    w: Vec3  # m/s^2, E, its acceleration behind the lag of attitude
    a: Vec3  # and behind that of the rates
    doubted: Doubted  # m/s^2, E, of changes of what is demanded
    before: Vec3  # m/s^2, E, acceleration demanded at the last step


class Point(NamedTuple):
    """What is asked for at one point of a way."""

    a_d: Vec3  # m/s^2, E, acceleration demanded
    off: Vec3  # m/s^2, E, by how much it may be off
    v: Vec3  # m/s, E, of the vehicle
    change: Vec3  # m/s^2, E, of the reference's acceleration in this step
    unsettled: float  # m/s^2, by how much that lags behind (34)


@kernel
def begun(r_m, v_m, a_m):
    """The Pursuit of a reference model at r_m, v_m, a_m (m, m/s, m/s^2, E), the vehicle on it."""
    zero = Vec3(0.0, 0.0, 0.0)
    return Pursuit(
        r_m=r_m, v_m=v_m, a_m=a_m, r=r_m, v=v_m, w=a_m, a=a_m,
        doubted=Doubted(unturned=zero, unflown=zero, beta=zero), before=a_m,
    )  # fmt: skip


@kernel
def onward(law, pursuit, setpoint, most, aside):
    """The Point a Pursuit is at, and the Pursuit a step of law.h later.

    setpoint : in force.  most, aside : m/s^3, the reference's acceleration changes no faster, and across
    the demand.
    """
    r_m, v_m, a_m = pursuit.r_m, pursuit.v_m, pursuit.a_m
    asked = a_ref(law, setpoint, r_m, v_m)
    up = Vec3(a_m.x, a_m.y, a_m.z + law.g)
    change = wrench.turned_to(asked - a_m, up, most * law.h, aside * law.h)
    a_m = a_m + change
    a_d = a_m + closing(law, pursuit.r - r_m, pursuit.v - v_m)
    doubted = margin.changed(pursuit.doubted, a_d - pursuit.before)
    off = margin.FORGOTTEN * margin.left(doubted)
    r, v, w, a = advanced(law, a_d, pursuit.r, pursuit.v, pursuit.w, pursuit.a)
    v_m = v_m + law.h * a_m
    r_m = r_m + law.h * v_m
    point = Point(a_d=a_d, off=off, v=pursuit.v, change=change, unsettled=norm(asked - a_m))
    return point, Pursuit(
        r_m=r_m, v_m=v_m, a_m=a_m, r=r, v=v, w=w, a=a,
        doubted=fading(law, doubted, 1.0, 1.0), before=a_d,
    )  # fmt: skip


@kernel
def as_asked(params, law, a):
    """`fastest` of a way that is flown as it is asked for: held to a jerk only by one that refuses."""
    most, aside = fastest(params, law, a)
    refuses = params.policy == REFUSE
    return select(refuses, most, math.inf), select(refuses, aside, math.inf)


@kernel
def demanding(params, law):
    """What demands are multiplied by (`hurry`): what a jump would take of the torque.

    Nothing on a way that keeps to a jerk.
    """
    return select(params.policy == REFUSE, 1.0, hurry(law))


@kernel
def least(params, law, setpoint, r, v):
    """The least `margin.condition` (N) on the way to a setpoint, as it is asked for; where, in s; the
    acceleration (m/s^2, E) that is demanded and the velocity (m/s, E) there.

    law.h is the step of the look ahead, a hundredth of a second say.  r, v : where the way
    begins, m, m/s, E, in hover.
    """
    known, worst, at, more = margin.known(params, law), math.inf, 0.0, demanding(params, law)
    zero = Vec3(0.0, 0.0, 0.0)
    adds, pursuit, a_worst, v_worst = closed(law), begun(r, v, zero), zero, v
    for k in range(steps(law)):
        t = k * law.h
        most, aside = as_asked(params, law, pursuit.a_m)
        point, pursuit = onward(law, pursuit, carried(setpoint, t), most, aside)
        now = holds(known, more * point.a_d, more * point.off, point.v, adds)
        if now < worst:
            worst, at, a_worst, v_worst = now, t, more * point.a_d, point.v
    return worst, at, a_worst, v_worst


@kernel
def along(params, law, sent_at, setpoints, r, v, rows):
    """The same along a script of setpoints: a row every law.h, float64[n, 8], is written.

    sent_at : float64[m], s, the first at 0.  setpoints : float64[m, size(Setpoint)].
    A row: time (s), condition (N), acceleration demanded (m/s^2, E), velocity (m/s, E).
    """
    known, sent, more = margin.known(params, law), 0, demanding(params, law)
    setpoint = _unpack_setpoint(setpoints[0])
    adds, pursuit = closed(law), begun(r, v, Vec3(0.0, 0.0, 0.0))
    for k in range(len(rows)):
        t = k * law.h
        while sent + 1 < len(sent_at) and sent_at[sent + 1] <= t + 1e-9:
            sent += 1
            setpoint = _unpack_setpoint(setpoints[sent])
        most, aside = as_asked(params, law, pursuit.a_m)
        now = carried(setpoint, t - sent_at[sent])
        point, pursuit = onward(law, pursuit, now, most, aside)
        asked, v = more * point.a_d, point.v
        rows[k, 0], rows[k, 1] = t, holds(known, asked, more * point.off, v, adds)
        rows[k, 2], rows[k, 3], rows[k, 4] = asked.x, asked.y, asked.z
        rows[k, 5], rows[k, 6], rows[k, 7] = v.x, v.y, v.z


@kernel
def transient_s(params, law):
    """After which (s) of a take-over the control difference left of its start is below LITTLE.

    Paper (30): beta_1 e^(-nu_1 t).
    """
    nu_1, little = 0.5 * law.lambda_v, LITTLE * params.m * law.g
    beta_1 = margin.beta_1(params, law, Vec3(0.0, 0.0, 0.0))
    return math.log(maximum(beta_1 / little, 1.0)) / nu_1  # (30)
