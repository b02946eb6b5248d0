"""What in flight contradicts what is believed. Not in the paper.

The condition is worth what its beliefs are. Some of what contradicts them shows in the law's own
estimates once it lasts: a force that the beliefs do not explain, a trim that does not suffice. Each
such sign is smoothed over LASTS_S; while it is beyond its bound, a belief is contradicted. README.md
says which ones each can mean.
"""

from __future__ import annotations

from fcu.guard.types import Contradicted, Signs
from fcu.kernel.algebra import hypot, maximum, minimum, norm, select
from fcu.kernel.compile import kernel

LASTS_S = 5.0  # time constant: a wind that comes and goes within seconds is none of these
PART = 0.05  # of the least weight: an unexplained force that is worth telling
PINNED = 0.5  # part of the time that the trim is at its limit
LIFTS = 0.5  # of the least weight: with less thrust nothing is in the air
EDGE = 1e-6  # of its end: so near to it an estimate is at the end of its set


@kernel
def enough(params, law):
    """The force (N) that is worth telling."""
    return PART * params.m_min * law.g


@kernel
def none(params, law):
    """The Signs of a flight that has shown none yet."""
    return Signs(mass=0.0, drag=-enough(params, law), thrust=0.0, trim=0.0)


@kernel
def unexplained(bounds, m_hat, f_z):
    """The force f_z (N, up) that m_hat would take, and its set does not let it; else 0."""
    lighter = m_hat <= bounds.m_min * (1.0 + EDGE)
    heavier = m_hat >= bounds.m_max * (1.0 - EDGE)
    return select(lighter, maximum(f_z, 0.0), 0.0) + select(heavier, minimum(f_z, 0.0), 0.0)


@kernel
def now(params, law, law_state, outputs, internals, measured):
    """The Signs of one tick, not smoothed. law_state : State, after the tick."""
    estimates = law_state.estimates
    f = estimates.m_hat * estimates.s_v_hat  # drag (N, E), if mass and thrust are as believed
    air = norm(measured.v_E) + params.w_max
    return Signs(
        mass=unexplained(law.bounds, estimates.m_hat, f.z),
        drag=maximum(hypot(f.x, f.y) - params.c_D * air * air, -enough(params, law)),
        thrust=outputs.T_c - outputs.T_achieved,
        trim=internals.flags.trim,
    )


@kernel
def smoothed(params, law, signs, law_state, outputs, internals, measured):
    """The Signs after a tick in flight. With too little thrust to be in the air they fade.

    params : GuardParams, law : Params, signs : Signs before it, law_state : State, after it,
    outputs : Outputs, internals : Internals, measured : VehicleState.
    """
    flies = outputs.T_achieved >= LIFTS * params.m_min * law.g
    seen = now(params, law, law_state, outputs, internals, measured)
    quiet = none(params, law)
    part = law.h / (LASTS_S + law.h)
    return Signs(
        mass=signs.mass + part * (select(flies, seen.mass, quiet.mass) - signs.mass),
        drag=signs.drag + part * (select(flies, seen.drag, quiet.drag) - signs.drag),
        thrust=signs.thrust + part * (select(flies, seen.thrust, quiet.thrust) - signs.thrust),
        trim=signs.trim + part * (select(flies, seen.trim, quiet.trim) - signs.trim),
    )


@kernel
def told(params, law, signs):
    """Contradicted, by Signs."""
    most = enough(params, law)
    return Contradicted(
        lighter=select(signs.mass > most, 1.0, 0.0),
        heavier=select(signs.mass < -most, 1.0, 0.0),
        drag=select(signs.drag > 0.0, 1.0, 0.0),
        thrust=select(abs(signs.thrust) > most, 1.0, 0.0),
        trim=select(signs.trim > PINNED, 1.0, 0.0),
    )
