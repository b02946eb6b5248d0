"""What thrust and torque reach together, and how fast a demand may therefore change. Not in the paper.

A rotor that gives torque gives its thrust for it: `allocation` moves the thrust for the sake of roll
and pitch, and leaves yaw the rest. The condition (`margin`) is on the force alone. It holds in flight
as long as attitude follows the force, so what is demanded must not turn faster than the rotors turn
the vehicle.
"""

from __future__ import annotations

import math

from fcu.interface.airframe import ROTORS
from fcu.kernel.algebra import greatest, maximum, minimum
from fcu.kernel.compile import kernel

FOLLOWS = 1.56  # fastest change of s_v_hat over that of the drag: an L1 norm, for m_hat up to 1.3 m
LEAST = 1.0  # m/s^3: a reference changes so fast whatever the gusts
PART = 0.5  # of the torque about yaw that the rotors give beside nothing else


@kernel
def tilting(rotors, T):
    """Torque (N m) about any level axis that a total thrust T (N) holds without being moved."""
    share = T / ROTORS
    room = minimum(share - rotors.f_min, rotors.f_max - share)
    spread = greatest(rotors.B_x * rotors.B_x + rotors.B_y * rotors.B_y)
    return maximum(room, 0.0) / math.sqrt(spread)


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
        rate = tilting(law.rotors, T) / (params.J_tilt * turning(law))
        j = minimum(j, (T * rate - gust) / m)
    return maximum(j, LEAST)


@kernel
def yaw_acceleration(params, law, T):
    """How fast (rad/s^2) yaw may gather speed at a total thrust T (N): by PART of what is there."""
    torque = law.rotors.k_Q * maximum(T - ROTORS * law.rotors.f_min, 0.0)
    return minimum(law.yaw_acceleration, PART * torque / params.J_yaw)
