"""From position error to total thrust and to commanded roll and pitch. Paper (37), (39)."""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3, clip, dot, maximum, minimum, norm, select
from fcu.kernel.compile import kernel
from fcu.laws.mmrac.reference_model import a_ref


@kernel
def f_c(params, state, setpoint, r, v):
    """Demanded specific force (m/s^2, E): what the estimates say the reference needs.

    With the achieved force gravity is known and stands in the bracket, so that s_v_hat
    holds drag alone; as printed, s_v_hat has to find gravity too. Paper (37).
    """
    g_E = Vec3(0.0, 0.0, -params.g * params.achieved)
    return a_ref(params, setpoint, r, v) - g_E - state.s_v_hat  # (37) departure 12


@kernel
def thrust(params, T_d, e3):
    """Total thrust (N) for a demanded force T_d (N, E) with the thrust axis along e3 (E).

    Achieved: the part of the demand along the actual axis. As printed: its norm, which
    turns a demand that points down into full thrust upwards. Paper (39).
    """
    T = select(params.achieved > 0.5, dot(T_d, e3), norm(T_d))  # (39) departure 13
    return clip(T, params.T_min, params.T_max)


@kernel
def safe(params, T_d):
    """A demanded force (N, E) that can be pointed along, and 1 if its horizontal part gave way.

    Height first: the vertical part is kept off the floor, and the horizontal part shrinks to
    what the tilt limit leaves beside it. As printed, the demand stays as it is.
    """
    achieved = params.achieved > 0.5
    T_z = maximum(T_d.z, params.T_dz_min)
    aside = math.sqrt(T_d.x * T_d.x + T_d.y * T_d.y)
    k = minimum(1.0, T_z * math.tan(params.phi_star) / (aside + 1e-30))
    k, T_z = select(achieved, k, 1.0), select(achieved, T_z, T_d.z)
    return Vec3(k * T_d.x, k * T_d.y, T_z), select(k < 1.0, 1.0, 0.0)  # departure 13


@kernel
def tilt(params, T_d, cos_psi, sin_psi):
    """Commanded roll and pitch (rad) for a demanded force (N, E), and 1 if either is clipped.

    From R e3 T = T_d for Z-Y-X angles; the printed (39) has the two exchanged. Paper (39).
    """
    ahead = T_d.x * cos_psi + T_d.y * sin_psi
    right = T_d.x * sin_psi - T_d.y * cos_psi
    theta_c = math.atan2(ahead, T_d.z)  # (39) departure 1
    cos_theta = T_d.z / math.sqrt(ahead * ahead + T_d.z * T_d.z + 1e-30)
    phi_c = math.atan2(right, T_d.z / nonzero(cos_theta))  # (39) departure 1
    phi_star = params.phi_star
    clipped = (abs(phi_c) > phi_star) or (abs(theta_c) > phi_star)
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
def trim(params, state, T_achieved):
    """Slow trim of thrust (N) on what was commanded and not achieved.

    Delta_u hides a bias of the thrust from the estimates: square root and lag rectify the
    noise of the rotor command, and an uncalibrated thrust curve does the same. Off while
    the thrust is saturated, and as printed.
    """
    T_c = state.T_c_prev
    inside = (T_c > params.T_min) and (T_c < params.T_max)
    rate = select(inside, params.trim_rate * params.achieved, 0.0)
    moved = state.T_trim + params.h * rate * (T_c - T_achieved)  # departure 14
    return clip(moved, -params.trim_max, params.trim_max)
