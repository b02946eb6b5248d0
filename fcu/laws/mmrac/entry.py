"""Where the cascade is entered: what a setpoint of attitude or body rates gives in place of (39).

Level 1 gives roll, pitch and thrust, level 2 body rates and thrust. The limits of the position
law hold here too. Not in the paper.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fcu.kernel.algebra import Vec3, clip, select, select3
from fcu.kernel.compile import kernel


class Demand(NamedTuple):
    """What the attitude law is handed."""

    T_d: Vec3  # demanded force, N, E
    T_c: float  # total thrust, N
    angles_c: Vec3  # roll, pitch, yaw, rad
    clipped: float  # 1 if the tilt limit cut roll or pitch


@kernel
def given(params, setpoint, angles, e3, cos_psi, sin_psi):
    """The Demand of a setpoint of level 1 or 2, `angles` and thrust axis e3 as they are.

    At level 2 no attitude is asked for: the one there is stands for it, so that the record shows
    no error of it and the filter of the tilt command follows.
    """
    rates = setpoint.level > 1.5
    phi_star, tilt = params.phi_star, setpoint.tilt_c
    phi_c = select(rates, angles.x, clip(tilt.x, -phi_star, phi_star))
    theta_c = select(rates, angles.y, clip(tilt.y, -phi_star, phi_star))
    past = (abs(tilt.x) > phi_star) | (abs(tilt.y) > phi_star)
    clipped = select(rates, 0.0, select(past, 1.0, 0.0))
    T_c = clip(setpoint.T_c, params.T_min, params.T_max)
    axis = select3(rates, e3, thrust_axis(phi_c, theta_c, cos_psi, sin_psi))
    angles_c = Vec3(phi_c, theta_c, select(rates, angles.z, setpoint.psi_c))
    return Demand(T_c * axis, T_c, angles_c, clipped)


@kernel
def thrust_axis(phi, theta, cos_psi, sin_psi):
    """R e3 (E) of roll and pitch (rad), each within a quarter turn, at a heading."""
    sin_phi, sin_theta = math.sin(phi), math.sin(theta)
    cos_phi = math.sqrt(1.0 - sin_phi * sin_phi)  # cheaper than a cosine
    cos_theta = math.sqrt(1.0 - sin_theta * sin_theta)
    return Vec3(
        cos_psi * sin_theta * cos_phi + sin_psi * sin_phi,
        sin_psi * sin_theta * cos_phi - cos_psi * sin_phi,
        cos_theta * cos_phi,
    )
