"""What thrust and torque reach together, and how fast a demand may therefore change. Not in the paper.

A rotor that gives torque gives its thrust for it: `allocation` moves the thrust for the sake of roll
and pitch, and leaves yaw the rest. The condition (`margin`) is on the force alone. It holds in flight
as long as attitude follows the force, so what is demanded must not turn faster than the rotors turn
the vehicle.
"""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3, dot, maximum, minimum, norm, select, select3
from fcu.kernel.compile import kernel

FOLLOWS = 1.56  # fastest change of s_v_hat over that of the drag: an L1 norm, for m_hat up to 1.3 m
LEAST = 1.0  # m/s^3: a reference changes so fast whatever the gusts
PART = 0.5  # of the torque about yaw that the rotors give beside nothing else
KEPT = 0.1  # part of it that noise does not take
HALVINGS = 30  # of a search for a thrust


@kernel
def tilting(params, rotors, T):
    """Torque (N m) about any level axis that a total thrust T (N) holds without being moved."""
    share = T / rotors.W
    room = minimum(share - rotors.f_min, rotors.f_max - share)
    return maximum(room, 0.0) / params.spread


@kernel
def disturbed(params, T):
    """Torque (N m) about a level axis that noise may ask for beside a total thrust T (N).

    What it does through the tilt that is demanded grows as the thrust gets small (`noise`).
    """
    a, b = params.noise_torque, params.noise_turning / maximum(T, 0.01 * params.m)
    return select(params.gaussian > 0.5, math.sqrt(a * a + b * b), a + b)


@kernel
def turning(law):
    """Angular acceleration over the rate (1/s) at which the demanded force turns, at most.

    The L1 norm of what attitude and rates make of a command, for filters of it up to 30 rad/s.
    """
    return law.c_rate.y + 2.0 * law.c_angle.y


@kernel
def gust(params):
    """Fastest change (N/s) of the demand in a wind that turns at its greatest.

    One that grows there is not counted (README.md, "Assumed").
    """
    return FOLLOWS * params.c_D * params.w_max * params.w_dot_max


@kernel
def held(params, law, T):
    """Fastest change (N/s) of the demand for the reference's sake that a total thrust T (N) holds.

    Across a thrust T it turns the demand by 1/T of it, and asks for J `turning` of that beside a gust,
    which attitude alone has to follow; or for J `swinging` with all that the loop makes of it. Neither may
    be more than `tilting`.
    """
    rate = T * maximum(tilting(params, law.rotors, T) - disturbed(params, T), 0.0) / params.J_tilt
    return minimum(rate / turning(law) - gust(params), rate / params.swinging)


@kernel
def jerk(params, law, T_now):
    """Fastest change (m/s^3) of the reference's acceleration that the rotors hold, about hover.

    Of the worse mass, what is `held` by its weight.  T_now : total thrust commanded, N, if it is less;
    inf: hover's.
    """
    light = held(params, law, minimum(params.m_min * law.g, T_now)) / params.m_min
    heavy = held(params, law, minimum(params.m_max * law.g, T_now)) / params.m_max
    return maximum(minimum(params.jerk, minimum(light, heavy)), LEAST)


@kernel
def jerk_across(params, law, T_now, j, rising):
    """Fastest change (m/s^3) across the demand, of a thrust T_now (N) that changes; not above j (m/s^3).

    Towards full thrust rotors have as little room for torque as towards none, and a torque that is asked
    for now is there once attitude and rates have turned: so the thrust counts that may be there by then,
    risen with j, or fallen as it does now.
    rising : m/s^3, along the demand, now.
    """
    soon = params.m_max * (1.0 / law.c_angle.y + 1.0 / law.c_rate.y)
    above = held(params, law, minimum(T_now + soon * j, params.T_turns)) / params.m_max
    sunk = maximum(minimum(params.m_min * law.g, T_now + soon * minimum(rising, 0.0)), 0.0)
    below = held(params, law, sunk) / params.m_min
    below = select(rising < 0.0, below, j)
    return minimum(j, maximum(minimum(above, below), LEAST))


@kernel
def turned_to(change, up, along, across):
    """A change (m/s^2, E) of the reference's acceleration, or as much of it as the rotors turn to.

    Its direction is kept, but for what is cut across the demand.
    up : m/s^2, E, along what is demanded.  along, across : m/s^2, at most at all, and across that.
    """
    length = norm(change)
    x = select3(length > along, (along / (length + 1e-30)) * change, change)
    n = (1.0 / (norm(up) + 1e-30)) * up
    rises = dot(x, n)
    aside = x - rises * n
    size = norm(aside)
    return select3(size > across, (across / (size + 1e-30)) * aside + rises * n, x)


@kernel
def turns_up_to(params, law):
    """The greatest thrust (N) beside which roll and pitch hold the LEAST jerk; T_max if hover does not."""
    low, high = params.m_max * law.g, law.limits.T_max
    if held(params, law, low) < params.m_max * LEAST:
        return high
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if held(params, law, middle) >= params.m_max * LEAST:
            low = middle
        else:
            high = middle
    return low


@kernel
def spare(params, law):
    """Torque (N m) that hover leaves beside noise, a gust and the LEAST jerk; below 0 it lacks.

    As `held` counts them, of the worse mass. What lacks there may saturate a rotor.
    """
    left = math.inf
    for m in (params.m_min, params.m_max):
        T = m * law.g
        beside = turning(law) * (m * LEAST + gust(params))
        asked = params.J_tilt * maximum(beside, params.swinging * m * LEAST) / T
        left = minimum(left, tilting(params, law.rotors, T) - disturbed(params, T) - asked)
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
def across_ahead(params, law, a, j):
    """`jerk_across` for a flight to come, where the reference accelerates with a (m/s^2, E); not above j.

    In a wind from above more thrust is there.  j : `jerk_ahead`, which counts with less.
    """
    T = params.m_max * norm(Vec3(a.x, a.y, a.z + law.g)) + lifted(params)
    return jerk_across(params, law, T, j, 0.0)


@kernel
def yaw_acceleration(params, law, T):
    """How fast (rad/s^2) yaw may gather speed at a total thrust T (N): by PART of what is there."""
    rotors = law.rotors
    there = maximum(T - rotors.W * rotors.f_min, 0.0)
    noise = rotors.W * params.spread * disturbed(params, T)
    torque = rotors.k_Q * maximum(there - noise, KEPT * there)
    return minimum(law.yaw_acceleration, PART * torque / params.J_yaw)
