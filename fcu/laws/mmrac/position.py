"""From position error to total thrust and to commanded roll and pitch. Paper (37), (39)."""

from __future__ import annotations

import math
from typing import NamedTuple

from fcu.kernel.algebra import Vec3, clip, dot, maximum, minimum, norm, select
from fcu.kernel.compile import kernel
from fcu.laws.demand import trimmed
from fcu.laws.mmrac.reference_model import a_ref


class Force(NamedTuple):
    """What the attitude and the rotors are asked to point and to lift."""

    f_c: Vec3  # demanded specific force, m/s^2, E
    T_0: Vec3  # demanded force before anything limits it, N, E
    T_d: Vec3  # demanded force, N, E
    T_c: float  # commanded total thrust, N
    angles_c: Vec3  # commanded roll, pitch, yaw, rad
    cut: float  # 1 if the tilt limit cuts the force, roll or pitch


@kernel
def achieved(params, estimates, setpoint, measured, attitude):
    """The Force that leads to the setpoint, safe to point along, gravity known. Paper (37), (39).

    With the achieved force gravity stands in the bracket, so that s_v_hat holds drag alone.
    """
    g_E = Vec3(0.0, 0.0, -params.g)
    a_d = a_ref(params, setpoint, measured.r_E, measured.v_E)
    f_c = a_d - g_E - estimates.s_v_hat  # (37) departure 12
    T_0 = estimates.m_hat * f_c  # (37)
    T_d, narrowed = safe(params, T_0)
    T_c = dot(T_d, attitude.R_EB.e3)  # (39) departure 13
    return pointed(params.limits, setpoint, attitude, f_c, T_0, T_d, T_c, narrowed)


@kernel
def demanded(params, estimates, setpoint, measured, attitude):
    """The same as printed: s_v_hat has to find gravity too, and thrust is the demand's norm.

    That norm turns a demand that points down into full thrust upwards. Paper (37), (39).
    """
    f_c = a_ref(params, setpoint, measured.r_E, measured.v_E) - estimates.s_v_hat  # (37)
    T_d = estimates.m_hat * f_c  # (37)
    return pointed(params.limits, setpoint, attitude, f_c, T_d, T_d, norm(T_d), 0.0)  # (39)


@kernel
def a_d(params, f_c, s_v_hat):
    """Acceleration (m/s^2, E) that a specific force f_c asks for, by the estimates."""
    if params.achieved > 0.5:
        return f_c + Vec3(0.0, 0.0, -params.g) + s_v_hat
    return f_c + s_v_hat


@kernel
def pointed(limits, setpoint, attitude, f_c, T_0, T_d, T_c, narrowed):
    """The Force of a demand T_d (N, E), its thrust T_c (N) and its tilt within the limits."""
    phi_c, theta_c, clipped = tilt(limits.phi_star, T_d, attitude.cos_psi, attitude.sin_psi)
    return Force(
        f_c=f_c,
        T_0=T_0,
        T_d=T_d,
        T_c=clip(T_c, limits.T_min, limits.T_max),
        angles_c=Vec3(phi_c, theta_c, setpoint.psi_c),
        cut=maximum(clipped, narrowed),
    )


@kernel
def at_limit(limits, T_c):
    """1 while the commanded total thrust (N) is at a limit, else 0."""
    limited = (T_c <= limits.T_min) | (T_c >= limits.T_max)
    return select(limited, 1.0, 0.0)


@kernel
def safe(params, T_d):
    """A demanded force (N, E) that can be pointed along, and 1 if its horizontal part gave way.

    Height first: the vertical part is kept off the floor, and the horizontal part shrinks to
    what the tilt limit leaves beside it.
    """
    T_z = maximum(T_d.z, params.T_dz_min)
    aside = math.sqrt(T_d.x * T_d.x + T_d.y * T_d.y)
    k = minimum(1.0, T_z * math.tan(params.limits.phi_star) / (aside + 1e-30))
    return Vec3(k * T_d.x, k * T_d.y, T_z), select(k < 1.0, 1.0, 0.0)  # departure 13


@kernel
def tilt(phi_star, T_d, cos_psi, sin_psi):
    """Commanded roll and pitch (rad) for a demanded force (N, E), and 1 if either is clipped.

    From R e3 T = T_d for Z-Y-X angles; the printed (39) has the two exchanged. Paper (39).
    """
    ahead = T_d.x * cos_psi + T_d.y * sin_psi
    right = T_d.x * sin_psi - T_d.y * cos_psi
    theta_c = math.atan2(ahead, T_d.z)  # (39) departure 1
    cos_theta = T_d.z / math.sqrt(ahead * ahead + T_d.z * T_d.z + 1e-30)
    phi_c = math.atan2(right, T_d.z / nonzero(cos_theta))  # (39) departure 1
    clipped = (abs(phi_c) > phi_star) | (abs(theta_c) > phi_star)
    return (
        clip(phi_c, -phi_star, phi_star),
        clip(theta_c, -phi_star, phi_star),
        select(clipped, 1.0, 0.0),
    )


@kernel
def nonzero(x):
    """x, kept away from zero on its own side."""
    return select(x < 0.0, minimum(x, -1e-9), maximum(x, 1e-9))


@kernel
def trim(params, memory, T_achieved):
    """Slow trim of thrust (N) on what was commanded and not achieved.

    Delta_u hides a bias of the thrust from the estimates: square root and lag rectify the
    noise of the rotor command, and an uncalibrated thrust curve does the same. Off while
    the thrust is saturated.
    """
    gain, most = params.h * params.trim_rate, params.trim_max
    return trimmed(params.limits, memory.T_trim, gain, most, memory.T_c, T_achieved)  # departure 14
