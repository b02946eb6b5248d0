"""What a setpoint will ask of the actuators, before it is flown. Not in the paper as such.

The paper's condition (31) bounds the demand by norms; this follows the way that the reference
model (34) lays down, and asks the exact set of what the actuators reach at every step of it.
"""

from __future__ import annotations

import math

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3, maximum, minimum
from fcu.kernel.buffers import unpacker
from fcu.kernel.compile import kernel
from fcu.law import margin
from fcu.law.reference_model import a_ref, carried

SETTLED = 8.0  # time constants of the reference model after which there is nothing to come

_unpack_setpoint = unpacker(Setpoint)


@kernel
def steps(params):
    """How many steps of params.h it takes the reference model to settle."""
    slowest = params.f_m * minimum(params.zeta_m, 0.5 / maximum(params.zeta_m, 0.5))
    return math.ceil(SETTLED / (slowest * params.h))


@kernel
def advanced(params, a_d, r, v, a, jumped):
    """Where the vehicle is a step later (r, v, a: m, m/s, m/s^2, E), and what is left of a jump.

    It follows the acceleration a_d demanded with the lag of its attitude, 1/c_theta: a reference
    model that is too fast for it demands more than it would of one without.
    """
    h, lag = params.h, 1.0 / params.c_angle.y
    a = (a + (h / lag) * a_d) / (1.0 + h / lag)
    v = v + h * a
    return r + h * v, v, a, jumped / (1.0 + 0.5 * h * params.lambda_v)


@kernel
def least(params, setpoint, r, v):
    """The least `margin.condition` (N) on the way to a setpoint, ungoverned; where, in s; the
    acceleration (m/s^2, E) that is demanded and the velocity (m/s, E) there.

    params.h is the step of the look ahead, a hundredth of a second say.  r, v : where the way
    begins, m, m/s, E, in hover.  The jump of the demand is flown with m_hat, which may be
    FORGOTTEN more than the mass until that is learnt.
    """
    worst, at = math.inf, 0.0
    a = Vec3(0.0, 0.0, 0.0)
    jumped = margin.FORGOTTEN * a_ref(params, setpoint, r, v)
    a_worst, v_worst = a, v
    for k in range(steps(params)):
        t = k * params.h
        a_d = a_ref(params, carried(setpoint, t), r, v)
        holds = margin.condition(params, a_d + jumped, v, 0.0)
        if holds < worst:
            worst, at, a_worst, v_worst = holds, t, a_d + jumped, v
        r, v, a, jumped = advanced(params, a_d, r, v, a, jumped)
    return worst, at, a_worst, v_worst


@kernel
def along(params, sent_at, setpoints, r, v, rows):
    """The same along a script of setpoints: a row every params.h, float64[n, 8], is written.

    sent_at : float64[m], s, the first at 0.  setpoints : float64[m, size(Setpoint)].
    A row: time (s), condition (N), acceleration demanded (m/s^2, E), velocity (m/s, E).
    """
    sent = 0
    setpoint = _unpack_setpoint(setpoints[0])
    a = Vec3(0.0, 0.0, 0.0)
    jumped = margin.FORGOTTEN * a_ref(params, setpoint, r, v)
    for k in range(len(rows)):
        t = k * params.h
        while sent + 1 < len(sent_at) and sent_at[sent + 1] <= t + 1e-9:
            before = a_ref(params, carried(setpoint, t - sent_at[sent]), r, v)
            sent += 1
            setpoint = _unpack_setpoint(setpoints[sent])
            jumped = jumped + margin.FORGOTTEN * (a_ref(params, setpoint, r, v) - before)
        a_d = a_ref(params, carried(setpoint, t - sent_at[sent]), r, v)
        asked = a_d + jumped
        rows[k, 0], rows[k, 1] = t, margin.condition(params, asked, v, 0.0)
        rows[k, 2], rows[k, 3], rows[k, 4] = asked.x, asked.y, asked.z
        rows[k, 5], rows[k, 6], rows[k, 7] = v.x, v.y, v.z
        r, v, a, jumped = advanced(params, a_d, r, v, a, jumped)


@kernel
def transient_s(params):
    """After which (s) of a take-over the control difference left of its start is below 1 N.

    Paper (30): beta_1 e^(-nu_1 t).
    """
    nu_1 = 0.5 * params.lambda_v
    return math.log(maximum(margin.beta_1(params), 1.0)) / nu_1  # (30)
