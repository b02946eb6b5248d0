"""What thrust and torque reach together, and how fast a demand may therefore change. Not in the paper.

A rotor that gives torque gives its thrust for it: `allocation` moves the thrust for the sake of roll
and pitch, and leaves yaw the rest. The condition (`margin`) is on the force alone. It holds in flight
as long as attitude follows the force, so what is demanded must not turn faster than the rotors turn
the vehicle.
"""

from __future__ import annotations

import math

from fcu.interface.airframe import ROTORS
from fcu.kernel.algebra import greatest, maximum, minimum, select
from fcu.kernel.compile import kernel

FOLLOWS = 1.56  # fastest change of s_v_hat over that of the drag: an L1 norm, for m_hat up to 1.3 m
LEAST = 1.0  # m/s^3: a reference changes so fast whatever the gusts
PART = 0.5  # of the torque about yaw that the rotors give beside nothing else
KEPT = 0.1  # part of it that noise does not take


@kernel
def tilting(rotors, T):
    """Torque (N m) about any level axis that a total thrust T (N) holds without being moved."""
    share = T / ROTORS
    room = minimum(share - rotors.f_min, rotors.f_max - share)
    spread = greatest(rotors.B_x * rotors.B_x + rotors.B_y * rotors.B_y)
    return maximum(room, 0.0) / math.sqrt(spread)


@kernel
def disturbed(params, T):
    """Torque (N m) about a level axis that noise may ask for beside a total thrust T (N).

    What it does through the tilt that is demanded grows as the thrust gets small (`noise`).
    """
    a, b = params.noise_torque, params.noise_turning / maximum(T, 1.0)
    return select(params.gaussian > 0.5, math.sqrt(a * a + b * b), a + b)


@kernel
def turning(law):
    """Angular acceleration over the rate (1/s) at which the demanded force turns, at most.

    The L1 norm of what attitude and rates make of a command, for filters of it up to 30 rad/s.
    """
    return law.c_rate.y + 2.0 * law.c_angle.y


@kernel
def jerk(params, law, T_now):
    """Fastest change (m/s^3) of the reference's acceleration that the rotors hold beside a gust.

    In hover a force of m g turns with (m j + FOLLOWS c w w_dot)/(m g) in a wind that turns at its
    greatest; one that grows there is not counted (README.md, "Assumed"). That takes J `turning` of
    it, which must not be more than `tilting`.  T_now : total thrust commanded, N; inf: hover's.
    """
    gust = FOLLOWS * params.c_D * params.w_max * params.w_dot_max
    j = params.jerk
    for m in (params.m_min, params.m_max):
        T = minimum(m * law.g, T_now)
        torque = maximum(tilting(law.rotors, T) - disturbed(params, T), 0.0)
        rate = torque / (params.J_tilt * turning(law))
        j = minimum(j, (T * rate - gust) / m)
    return maximum(j, LEAST)


@kernel
def spare(params, law):
    """Torque (N m) that hover leaves beside noise, a gust and the LEAST jerk; below 0 it lacks.

    As `jerk` counts them, of the worse mass. What lacks there may saturate a rotor.
    """
    gust, left = FOLLOWS * params.c_D * params.w_max * params.w_dot_max, math.inf
    for m in (params.m_min, params.m_max):
        T = m * law.g
        asked = params.J_tilt * turning(law) * (m * LEAST + gust) / T
        left = minimum(left, tilting(law.rotors, T) - disturbed(params, T) - asked)
    return left


@kernel
def lifted(params):
    """Thrust (N) that half of the greatest wind takes off, blowing upwards. How much was set by flights."""
    half = 0.5 * params.w_max
    return params.c_D * half * half


@kernel
def jerk_ahead(params, law, a_z):
    """`jerk` for a flight to come, where the reference accelerates upwards with a_z (m/s^2).

    In a wind from below, and on the way down, less thrust is there to turn with.
    """
    return jerk(params, law, params.m_min * (law.g + minimum(a_z, 0.0)) - lifted(params))


@kernel
def yaw_acceleration(params, law, T):
    """How fast (rad/s^2) yaw may gather speed at a total thrust T (N): by PART of what is there."""
    rotors = law.rotors
    spread = math.sqrt(greatest(rotors.B_x * rotors.B_x + rotors.B_y * rotors.B_y))
    there = maximum(T - ROTORS * rotors.f_min, 0.0)
    torque = rotors.k_Q * maximum(there - ROTORS * spread * disturbed(params, T), KEPT * there)
    return minimum(law.yaw_acceleration, PART * torque / params.J_yaw)
