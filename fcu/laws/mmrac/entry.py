"""Where the cascade is entered: what a setpoint of attitude or body rates gives in place of (39).

Level 1 gives roll, pitch and thrust, level 2 body rates and thrust. The limits of the position
law hold here too. Not in the paper.
"""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3, clip, select, select3
from fcu.kernel.compile import kernel
from fcu.laws.mmrac.attitude import Turn
from fcu.laws.mmrac.position import Force


@kernel
def below_position(setpoint):
    """Whether a setpoint is of attitude or of body rates."""
    return setpoint.level > 0.5


@kernel
def below_attitude(setpoint):
    """Whether a setpoint is of body rates."""
    return setpoint.level > 1.5


@kernel
def force(limits, estimates, setpoint, attitude, wanted):
    """The Force that a setpoint asks for: the one `wanted` of its position, or what it gives."""
    given, below = given_force(limits, estimates, setpoint, attitude), below_position(setpoint)
    return Force(
        f_c=select3(below, given.f_c, wanted.f_c),
        T_0=select3(below, given.T_0, wanted.T_0),
        T_d=select3(below, given.T_d, wanted.T_d),
        T_c=select(below, given.T_c, wanted.T_c),
        angles_c=select3(below, given.angles_c, wanted.angles_c),
        cut=select(below, given.cut, wanted.cut),
    )


@kernel
def given_force(limits, estimates, setpoint, attitude):
    """The Force of a setpoint of level 1 or 2.

    At level 2 no attitude is asked for: the one there is stands for it, so that the record shows
    no error of it and the filter of the tilt command follows.
    """
    rates, angles = below_attitude(setpoint), attitude.angles
    cos_psi, sin_psi = attitude.cos_psi, attitude.sin_psi
    phi_star, tilt = limits.phi_star, setpoint.tilt_c
    phi_c = select(rates, angles.x, clip(tilt.x, -phi_star, phi_star))
    theta_c = select(rates, angles.y, clip(tilt.y, -phi_star, phi_star))
    past = (abs(tilt.x) > phi_star) | (abs(tilt.y) > phi_star)
    T_c = clip(setpoint.T_c, limits.T_min, limits.T_max)
    axis = select3(rates, attitude.R_EB.e3, thrust_axis(phi_c, theta_c, cos_psi, sin_psi))
    T_d = T_c * axis
    return Force(
        f_c=T_d / estimates.m_hat,
        T_0=T_d,
        T_d=T_d,
        T_c=T_c,
        angles_c=Vec3(phi_c, theta_c, select(rates, angles.z, setpoint.psi_c)),
        cut=select(rates, 0.0, select(past, 1.0, 0.0)),
    )


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


@kernel
def turn(setpoint, wanted):
    """The Turn that a setpoint asks for: the one `wanted` of its attitude, or what it gives."""
    below = below_attitude(setpoint)
    return Turn(
        w_c=select3(below, setpoint.w_c, wanted.w_c),
        tilt_cut=select(below, 0.0, wanted.tilt_cut),
        yaw_cut=select(below, 0.0, wanted.yaw_cut),
    )
