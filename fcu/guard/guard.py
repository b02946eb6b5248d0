"""The guard around the law: one function before its step, one after it. Not in the paper.

`before` gives the law its setpoint, as asked for or governed; `after` tells the margins of what the
law then demands, and what the guard remembers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fcu.guard import contradictions, governor, margin
from fcu.guard.parameters import PARAMETERS, check, derived, followed, guard_params, printed
from fcu.guard.types import (
    Contradicted,
    GuardInternals,
    GuardParams,
    GuardState,
    Margin,
    Signs,
)
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3, select, select3
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import euler, matrix
from fcu.laws.mmrac import position, reference_model
from fcu.laws.mmrac.types import Params as LawParams

__all__ = [
    "PARAMETERS", "GuardInternals", "GuardParams", "GuardState", "LawParams", "after", "before",
    "check", "derived", "followed", "guard_params", "idle", "printed", "take_over",
]  # fmt: skip  # what the shell knows of a guard; LawParams: what the guard has to know of its law


class Governed(NamedTuple):
    """What the guard hands to the law, and keeps for what comes after its step."""

    setpoint: Setpoint  # that the law is given
    a_m: Vec3  # acceleration of the reference model, m/s^2, E
    governed: float  # 1 if the position is not the one asked for
    known: margin.Known
    state: GuardState  # beta as of this tick; a_m and yaw of the last


@kernel
def take_over(params, law, setpoint, measured):
    """The Governed of the tick at which the law takes over.

    params : GuardParams, law : Params of the law, setpoint : Setpoint, measured : VehicleState.
    """
    state = GuardState(
        a_m=Vec3(0.0, 0.0, 0.0),
        unturned=0.0,
        unflown=0.0,
        beta=margin.beta_1(params, law, measured.v_E),
        psi_g=euler(matrix(measured.q_EB)).z,
        psi_g_dot=measured.w_B.z,
        signs=contradictions.none(params, law),
    )
    reference = reference_model.at_take_over(law, measured)
    return governed(state, params, law, reference, setpoint, measured, params.m_min * law.g)


@kernel
def before(state, params, law, law_state, setpoint, measured):
    """The Governed of a tick in flight, from the last states of guard and law."""
    left = margin.faded(law, state)
    now = GuardState(
        a_m=state.a_m,
        unturned=left.unturned,
        unflown=left.unflown,
        beta=left.beta,
        psi_g=state.psi_g,
        psi_g_dot=state.psi_g_dot,
        signs=state.signs,
    )
    T_c = law_state.memory.T_c
    return governed(now, params, law, law_state.reference, setpoint, measured, T_c)


@kernel
def governed(state, params, law, reference, setpoint, measured, T):
    """The Governed of a state as of this tick; `reference`, the law's."""
    known = margin.known(params, law)
    given, a_m, limited = governor.governed(
        params, law, known, state, reference, setpoint, measured.r_E, measured.v_E,
        euler(matrix(measured.q_EB)).z, T,
    )  # fmt: skip
    return Governed(setpoint=given, a_m=a_m, governed=limited, known=known, state=state)


@kernel
def after(governed, params, law, law_state, outputs, internals, measured):
    """(GuardState, GuardInternals) of a tick, from what the law returned."""
    setpoint, state, known = governed.setpoint, governed.state, governed.known
    below_position = setpoint.level > 0.5
    a_d = position.a_d(law, internals.demand.f_c, law_state.estimates.s_v_hat)
    v_m, T_0 = outputs.reference.v_m, internals.demand.T_0
    changed = margin.doubt(params, governed.a_m - state.a_m)
    yaw = setpoint.psi_c + law.h * setpoint.psi_dot_c
    signs = contradictions.smoothed(
        params, law, state.signs, law_state, outputs, internals, measured
    )
    next_state = GuardState(
        a_m=select3(below_position, Vec3(0.0, 0.0, 0.0), governed.a_m),
        unturned=state.unturned + select(below_position, 0.0, changed),
        unflown=state.unflown,
        beta=state.beta,
        psi_g=select(below_position, outputs.angles.z, yaw),
        psi_g_dot=select(below_position, measured.w_B.z, setpoint.psi_dot_c),
        signs=signs,
    )
    margins = Margin(
        force=margin.distance(known, T_0),
        tilt=margin.tilt_left(law.limits.phi_star, T_0),
        condition=margin.condition(known, a_d, v_m, margin.left(next_state)),
    )
    return next_state, GuardInternals(
        r_g=setpoint.r_c,
        governed=governed.governed,
        margin=margins,
        contradicted=contradictions.told(params, law, signs),
    )


@kernel
def idle(measured):
    """(GuardState, GuardInternals) while the law does not fly."""
    state = GuardState(
        a_m=Vec3(0.0, 0.0, 0.0),
        unturned=0.0,
        unflown=0.0,
        beta=0.0,
        psi_g=euler(matrix(measured.q_EB)).z,
        psi_g_dot=measured.w_B.z,
        signs=Signs(mass=0.0, drag=0.0, thrust=0.0, trim=0.0),
    )
    nothing = Margin(force=math.nan, tilt=math.nan, condition=math.nan)
    nowhere = Contradicted(lighter=0.0, heavier=0.0, drag=0.0, thrust=0.0, trim=0.0)
    return state, GuardInternals(
        r_g=measured.r_E, governed=0.0, margin=nothing, contradicted=nowhere
    )
