"""What a setpoint will ask of the actuators, before it is flown. Not in the paper as such.

The paper's condition (31) bounds the demand by norms; this follows the way that the reference
model (34) lays down, and asks the exact set of what the actuators reach at every step of it.
"""

from __future__ import annotations

import math

from fcu.guard import margin
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3, maximum, minimum, norm
from fcu.kernel.buffers import unpacker
from fcu.kernel.compile import kernel
from fcu.laws.mmrac.reference_model import a_ref, carried

QUICK = 0.6  # of a time constant of the reference model: attitude and rates may lag so much
LONGEST = 300.0  # s, that is looked ahead at most
SETTLED = 8.0  # time constants of the reference model after which there is nothing to come

_unpack_setpoint = unpacker(Setpoint)


@kernel
def steps(law):
    """How many steps of law.h it takes the reference model to settle."""
    slowest = law.f_m * minimum(law.zeta_m, 0.5 / maximum(law.zeta_m, 0.5))
    return math.ceil(minimum(SETTLED / slowest, LONGEST) / law.h)


@kernel
def hurry(law):
    """What a demand is multiplied by for a reference model too quick for attitude and rates.

    1 while 2 zeta_m f_m (1/c_theta + 1/c_q) is below QUICK. Above, a step also runs into the torque
    of the rotors, which the condition does not know: each per cent more counts as one of demand.
    Where that begins was set by flights.
    """
    lags = 1.0 / law.c_angle.y + 1.0 / law.c_rate.y
    return maximum(1.0, 2.0 * law.zeta_m * law.f_m * lags / QUICK)


@kernel
def advanced(law, a_d, r, v, w, a):
    """Where the vehicle is a step later: r, v, w, a (m, m/s, m/s^2, m/s^2, E).

    Its acceleration a follows the one demanded, a_d, behind two lags: that of attitude, 1/c_theta
    (to w), and that of the rates, 1/c_q. A reference model too fast for them demands more than it
    would without.
    """
    h = law.h
    of_attitude, of_rates = h * law.c_angle.y, h * law.c_rate.y
    w = (w + of_attitude * a_d) / (1.0 + of_attitude)
    a = (a + of_rates * w) / (1.0 + of_rates)
    v = v + h * a
    return r + h * v, v, w, a


@kernel
def misjudged(law, off, change):
    """By how much (m/s^2, E) what is demanded may be off after a change of it (m/s^2, E).

    m_hat may be off by FORGOTTEN when the demand changes; that is learnt with nu_1 = lambda/2.
    """
    return off / (1.0 + 0.5 * law.h * law.lambda_v) + margin.FORGOTTEN * change


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
def least(params, law, setpoint, r, v):
    """The least `margin.condition` (N) on the way to a setpoint, ungoverned; where, in s; the
    acceleration (m/s^2, E) that is demanded and the velocity (m/s, E) there.

    law.h is the step of the look ahead, a hundredth of a second say.  r, v : where the way
    begins, m, m/s, E, in hover.
    """
    known, worst, at, more = margin.known(params, law), math.inf, 0.0, hurry(law)
    zero = Vec3(0.0, 0.0, 0.0)
    w, a, a_worst, v_worst = zero, zero, zero, v
    before, off, adds = zero, zero, closed(law)
    for k in range(steps(law)):
        t = k * law.h
        a_d = a_ref(law, carried(setpoint, t), r, v)
        off = misjudged(law, off, a_d - before)
        now = holds(known, more * a_d, more * off, v, adds)
        if now < worst:
            worst, at, a_worst, v_worst = now, t, more * a_d, v
        r, v, w, a = advanced(law, a_d, r, v, w, a)
        before = a_d
    return worst, at, a_worst, v_worst


@kernel
def along(params, law, sent_at, setpoints, r, v, rows):
    """The same along a script of setpoints: a row every law.h, float64[n, 8], is written.

    sent_at : float64[m], s, the first at 0.  setpoints : float64[m, size(Setpoint)].
    A row: time (s), condition (N), acceleration demanded (m/s^2, E), velocity (m/s, E).
    """
    known, sent, more = margin.known(params, law), 0, hurry(law)
    setpoint = _unpack_setpoint(setpoints[0])
    zero = Vec3(0.0, 0.0, 0.0)
    w, a, before, off, adds = zero, zero, zero, zero, closed(law)
    for k in range(len(rows)):
        t = k * law.h
        while sent + 1 < len(sent_at) and sent_at[sent + 1] <= t + 1e-9:
            sent += 1
            setpoint = _unpack_setpoint(setpoints[sent])
        a_d = a_ref(law, carried(setpoint, t - sent_at[sent]), r, v)
        off = misjudged(law, off, a_d - before)
        asked = more * a_d
        rows[k, 0], rows[k, 1] = t, holds(known, asked, more * off, v, adds)
        rows[k, 2], rows[k, 3], rows[k, 4] = asked.x, asked.y, asked.z
        rows[k, 5], rows[k, 6], rows[k, 7] = v.x, v.y, v.z
        r, v, w, a = advanced(law, a_d, r, v, w, a)
        before = a_d


@kernel
def transient_s(params, law):
    """After which (s) of a take-over the control difference left of its start is below 1 N.

    Paper (30): beta_1 e^(-nu_1 t).
    """
    nu_1 = 0.5 * law.lambda_v
    return math.log(maximum(margin.beta_1(params, law, Vec3(0.0, 0.0, 0.0)), 1.0)) / nu_1  # (30)
