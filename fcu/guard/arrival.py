"""How long the way to a setpoint takes at most: stated before it is flown. Not in the paper.

While the condition holds the reference is governed, not stopped: it keeps at least the speed and the
acceleration that hover leaves in the greatest wind, and changes that acceleration at least as fast as
the rotors turn the vehicle there (`wrench.jerk`).
"""

from __future__ import annotations

import math

from fcu.guard import margin, wrench
from fcu.guard.governor import BRAKING, SLOWEST, speeds, taken_back
from fcu.kernel.algebra import maximum, minimum, select
from fcu.kernel.compile import kernel

ARRIVED_M = 0.3  # from the setpoint
NOTHING = 1e-9


@kernel
def slowest(law):
    """The rate (1/s) with which the slowest part of the reference model (34) fades."""
    zeta = law.zeta_m
    return law.f_m * (zeta - math.sqrt(maximum(zeta * zeta - 1.0, 0.0)))


@kernel
def off_at_most(params, law):
    """The tracking error (m) that the control difference which lasts leaves, at most.

    It moves the vehicle by e'' + 2 zeta f e' + f^2 e = z: the L1 norm of that response, times z.
    """
    zeta = minimum(law.zeta_m, 0.99)  # above it the norm is 1/f^2
    half = math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta * zeta))
    norm = (1.0 + half) / (1.0 - half) / (law.f_m * law.f_m)
    return norm * margin.known(params, law).z_0 / params.m_min


@kernel
def at_most_s(params, law, far, speed, acceleration, moves, down, moves_down):
    """Time (s) after which the vehicle is, and stays, within ARRIVED_M of a setpoint.

    From a reference model that is `far` (m) from it, with `speed` (m/s) and `acceleration` (m/s^2) in
    the direction that suits worst: the acceleration is taken back, the speed is braked, and the way from
    there is flown from rest to rest; then (34) fades.
    moves : the setpoint's own speed, m/s. Of one that moves, `speed` is relative to it; of the speed that
    is governed it leaves that much less to catch up with.
    down : how far down the setpoint lies, m, and moves_down (m/s) how fast it sinks; that way it may have
    to go slower (`margin.sinking`).
    inf where a wind as believed may keep the vehicle farther off its reference than ARRIVED_M.
    """
    known = margin.known(params, law)
    fastest, brake = speeds(known)
    sinks = maximum(margin.sinking(known), SLOWEST) - maximum(moves_down, 0.0)
    top, near = fastest - moves, ARRIVED_M - off_at_most(params, law)
    lifted = (
        params.m_min * law.g - params.c_D * params.w_max * params.w_max
    )  # N, hover in an updraft
    j = wrench.jerk(params, law, maximum(lifted, law.limits.T_min))
    a = taken_back(brake, law.f_m / (2.0 * law.zeta_m), j) / BRAKING
    # until nothing accelerates any more
    t_0 = acceleration / j
    v_0 = speed + 0.5 * acceleration * t_0
    drift = (speed + acceleration * t_0 / 3.0) * t_0
    # until it stands
    t_1 = (v_0 / a + a / j) * minimum(v_0 / NOTHING, 1.0)
    way = far + drift + v_0 * t_1
    # from rest to rest: acceleration, braking, and the time in which each begins and ends
    v = maximum(minimum(maximum(top, NOTHING), math.sqrt(a * way)), NOTHING)
    t_2 = way / v + v / a + 2.0 * a / j
    # down: what is slower there than the rest of the way
    lower = minimum(maximum(down, 0.0) + drift + v_0 * t_1, way)
    t_2 += lower * maximum(1.0 / maximum(sinks, NOTHING) - 1.0 / v, 0.0)
    # near the setpoint: from where `approach` is linear, with a time constant to spare; braking that
    # cannot be taken back as fast as (34) has it swings about the setpoint, and that fades with j / a
    knee = a * (2.0 * law.zeta_m / law.f_m) * (2.0 * law.zeta_m / law.f_m)
    fades = minimum(slowest(law), j / a)
    t_3 = math.log(10.0 * maximum(knee / maximum(near, NOTHING), 1.0)) / fades
    return select((top > 0.0) & (sinks > 0.0) & (near > 0.0), t_0 + t_1 + t_2 + t_3, math.inf)
