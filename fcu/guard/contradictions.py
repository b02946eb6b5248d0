"""What in flight contradicts what is believed. Not in the paper.

The condition is worth what its beliefs are. Some of what contradicts them shows in the law's own
estimates once it lasts: a force that the beliefs do not explain, a trim that does not suffice. Each
such sign is smoothed over LASTS_S; while it is beyond its bound, a belief is contradicted. README.md
says which ones each can mean.
"""

from __future__ import annotations

import math

from fcu.guard.types import Contradicted, Signs
from fcu.kernel.algebra import maximum, norm, select
from fcu.kernel.compile import kernel

LASTS_S = 5.0  # time constant: a wind that comes and goes within seconds is none of these
PART = 0.05  # of the least weight: an unexplained force that is worth telling
PINNED = 0.5  # part of the time that the trim is at its limit
LIFTS = 0.5  # of the least weight: with less thrust nothing is in the air
SEEN = 0.5  # of gravity: falling faster says little about the mass


@kernel
def enough(params, law):
    """The force (N) that is worth telling."""
    return PART * params.m_min * law.g


@kernel
def none(params, law):
    """The Signs of a flight that has shown none yet."""
    return Signs(mass=0.0, drag=-enough(params, law), thrust=0.0, trim=0.0)


@kernel
def unexplained(params, law, m_hat, s_z, T_z, v):
    """The force (N, up) that no believed mass explains: what is carried, against what is believed.

    T_z : achieved force upwards, N.  s_z : of s_v_hat, m/s^2.  v : velocity, m/s, E.  T_z/m_hat + s_z is
    how fast it would climb without weight, however m_hat and s_v_hat share it, and says what mass that
    thrust carries. The drag of the vehicle's own speed is taken off.
    """
    climbs = T_z / m_hat + s_z
    weight = law.g * T_z / maximum(climbs, SEEN * law.g)
    own = params.c_D * norm(v) * abs(v.z)
    lighter = maximum(params.m_min * law.g - weight - own, 0.0)
    heavier = maximum(weight - params.m_max * law.g - own, 0.0)
    return select(climbs > SEEN * law.g, lighter - heavier, 0.0)


@kernel
def now(params, law, law_state, outputs, internals, measured):
    """The Signs of one tick, not smoothed. law_state : State, after the tick."""
    estimates, v = law_state.estimates, measured.v_E
    f = estimates.m_hat * estimates.s_v_hat  # drag (N, E), if mass and thrust are as believed
    air = norm(v) + params.w_max
    T_z = internals.achieved.T_a.z
    return Signs(
        mass=unexplained(params, law, estimates.m_hat, estimates.s_v_hat.z, T_z, v),
        drag=maximum(
            math.sqrt(f.x * f.x + f.y * f.y) - params.c_D * air * air, -enough(params, law)
        ),
        thrust=outputs.T_c - outputs.T_achieved,
        trim=select(law.trim_max > 0.0, internals.flags.trim, 0.0),
    )


@kernel
def smoothed(params, law, signs, law_state, outputs, internals, measured):
    """The Signs after a tick in flight. With too little thrust to be in the air they fade.

    Of the printed law there are none: its estimates mean something else (departure 12).

    params : GuardParams, law : Params, signs : Signs before it, law_state : State, after it,
    outputs : Outputs, internals : Internals, measured : VehicleState.
    """
    flies = (outputs.T_achieved >= LIFTS * params.m_min * law.g) & (law.achieved > 0.5)
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
