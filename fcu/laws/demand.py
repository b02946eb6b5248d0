"""Limits on what a law asks of position, thrust and tilt: shared by laws of other papers than M-MRAC's.

Publications assume setpoints that a vehicle can follow. A step, or a gust, asks for more than
thrust and tilt can do. These functions say what is asked for then.
"""

from __future__ import annotations

import math

from fcu.interface.airframe import G as G
from fcu.kernel.algebra import Vec3, clip, clip3, hypot, maximum, minimum, select
from fcu.kernel.compile import kernel
from fcu.laws.approach import approach


@kernel
def velocity_towards(e, c, a):
    """Velocity (m/s) that closes an error of position e (m, E), and its slope over e (1/s), both Vec3.

    Close by c e (c in 1/s, Vec3), farther away less: a speed from which the deceleration a (m/s^2)
    stops in time, in the horizontal plane and upwards.
    """
    aside, up = hypot(e.x, e.y), abs(e.z)
    level, rise = approach(c.x, a, aside), approach(c.z, a, up)
    k, k_z = level / maximum(aside, 1e-9), rise / maximum(up, 1e-9)
    near, near_z = select(aside > 1e-6, k, c.x), select(up > 1e-6, k_z, c.z)
    slope = minimum(c.x, a / maximum(level, 1e-9))
    return (
        Vec3(near * e.x, near * e.y, near_z * e.z),
        Vec3(slope, slope, minimum(c.z, a / maximum(rise, 1e-9))),
    )


@kernel
def within_tilt(F, least, phi_star):
    """A force (N, E) that thrust can be pointed along, and 1 if F is not one.

    Height comes first: the vertical part is at least `least` (N), and the horizontal part shrinks
    to what the tilt limit phi_star (rad) leaves beside it.
    """
    F_z = maximum(F.z, least)
    aside = hypot(F.x, F.y)
    k = minimum(1.0, F_z * math.tan(phi_star) / maximum(aside, 1e-30))
    return Vec3(k * F.x, k * F.y, F_z), select((k < 1.0) | (F.z < least), 1.0, 0.0)


@kernel
def within_thrust(limits, T):
    """A total thrust (N) held within its limits, and 1 if they cut T."""
    T_c = clip(T, limits.T_min, limits.T_max)
    return T_c, select(T_c != T, 1.0, 0.0)


@kernel
def asked_tilt(limits, setpoint):
    """Roll and pitch (x, y, rad) of a setpoint, held within the tilt limit, and 1 if it cuts them."""
    asked = setpoint.tilt_c
    tilt = clip3(asked, -limits.phi_star, limits.phi_star)
    return tilt, select((tilt.x != asked.x) | (tilt.y != asked.y), 1.0, 0.0)


@kernel
def trimmed(limits, T_trim, gain, most, T_c, T_achieved):
    """The trim of thrust (N) one tick on: an integral, at most `most` (N), of the thrust not achieved.

    gain : rate of the trim times the control period.  While T_c (N) is at a limit, the trim rests.
    """
    inside = (T_c > limits.T_min) & (T_c < limits.T_max)
    return clip(T_trim + select(inside, gain, 0.0) * (T_c - T_achieved), -most, most)


@kernel
def tilt_of(axis, psi):
    """Roll and pitch (rad) that point the thrust along a unit vector (E) at a yaw psi (rad)."""
    ahead = math.cos(psi) * axis.x + math.sin(psi) * axis.y
    right = math.sin(psi) * axis.x - math.cos(psi) * axis.y
    return math.atan2(right, hypot(ahead, axis.z)), math.atan2(ahead, axis.z)


@kernel
def axis_of(phi, theta, psi):
    """Unit vector (E) of the thrust at roll phi, pitch theta, yaw psi (rad)."""
    ahead, right = math.sin(theta) * math.cos(phi), math.sin(phi)
    return Vec3(
        math.cos(psi) * ahead + math.sin(psi) * right,
        math.sin(psi) * ahead - math.cos(psi) * right,
        math.cos(theta) * math.cos(phi),
    )


@kernel
def yaw_error(e_psi, c, a, fastest):
    """An error of yaw (rad), as much of it as a law may close at c e (c in 1/s).

    Yaw is the weak axis: the rate is one from which the yaw acceleration a (rad/s^2) stops in time,
    and at most `fastest` (rad/s).
    """
    most = minimum(approach(c, a, abs(e_psi)), fastest) / c
    return select(e_psi < 0.0, -minimum(-e_psi, most), minimum(e_psi, most))


@kernel
def turned_with(R_EB, psi_dot, w_x, w_y):
    """The body rate (rad/s, B) of roll and pitch rates w_x, w_y at which yaw moves at psi_dot."""
    cos2_theta = R_EB.e2.z * R_EB.e2.z + R_EB.e3.z * R_EB.e3.z
    w_z = (psi_dot * cos2_theta - R_EB.e2.z * w_y) / maximum(R_EB.e3.z, 0.2)
    return Vec3(w_x, w_y, w_z)
