"""What a setpoint will ask of the actuators, before it is flown. Not in the paper as such.

The paper's condition (31) bounds the demand by norms; this follows the reference model (34) and
asks the exact set at every step of the way.
"""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3, maximum, minimum
from fcu.kernel.compile import kernel
from fcu.law import margin
from fcu.law.reference_model import a_ref, advance, carried

SETTLED = 8.0  # time constants of the reference model after which there is nothing to come


@kernel
def steps(params):
    """How many steps of params.h it takes the reference model to settle."""
    slowest = params.f_m * minimum(params.zeta_m, 0.5 / maximum(params.zeta_m, 0.5))
    return math.ceil(SETTLED / (slowest * params.h))


@kernel
def least(params, setpoint, r_m, v_m):
    """The least `margin.condition` (N) on the way to a setpoint, ungoverned; where, in s; the
    acceleration (m/s^2, E), velocity (m/s, E) there.

    params.h is the step of the look ahead.  r_m, v_m : where the reference model is, m, m/s, E.
    What is left of the start of adaptation is not counted: it is over within `transient_s`.
    """
    worst, at = math.inf, 0.0
    a_worst, v_worst = Vec3(0.0, 0.0, 0.0), v_m
    for k in range(steps(params)):
        now = carried(setpoint, k * params.h)
        a = a_ref(params, now, r_m, v_m)
        holds = margin.condition(params, a, v_m, 0.0)
        if holds < worst:
            worst, at, a_worst, v_worst = holds, k * params.h, a, v_m
        r_m, v_m = advance(params, now, r_m, v_m)
    return worst, at, a_worst, v_worst


@kernel
def transient_s(params):
    """After which (s) of a take-over the control difference left of its start is below 1 N.

    Paper (30): beta_1 e^(-nu_1 t).
    """
    nu_1 = 0.5 * params.lambda_v
    return math.log(maximum(margin.beta_1(params), 1.0)) / nu_1  # (30)
