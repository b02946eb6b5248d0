"""Outputs of a law at rest, and of a law without a reference model."""

from __future__ import annotations

import math

from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import euler, matrix
from fcu.laws.allocation import achieved
from fcu.laws.face import Outputs, Reference, Saturation


@kernel
def no_reference():
    """The Reference of a law without a reference model."""
    none = Vec3(math.nan, math.nan, math.nan)
    return Reference(r_m=none, v_m=none)


@kernel
def at_rest(measured, reference, e_r):
    """The Outputs of a law that does not fly.  e_r : position minus reference, m, E."""
    angles = euler(matrix(measured.q_EB))
    return Outputs(
        reference=reference,
        e_r=e_r,
        T_c=0.0,
        T_achieved=0.0,
        angles=angles,
        angles_c=angles,
        w_c=Vec3(0.0, 0.0, 0.0),
        thrusts=Rotors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        saturation=Saturation(thrust=0.0, tilt=0.0, torque=0.0, yaw=0.0),
    )


@kernel
def without_reference(
    rotors, measured, T_c, angles, angles_c, w_c, thrusts, thrust_cut, tilt_cut, gave_up
):
    """The Outputs of a law that has no reference model.

    T_c : N.  angles, angles_c : measured and commanded, rad.  w_c : rad/s, B.  thrusts, gave_up : of `allocate`.
    thrust_cut, tilt_cut : 1 while a limit cuts the command.
    """
    reference = no_reference()
    return Outputs(
        reference=reference,
        e_r=reference.r_m,
        T_c=T_c,
        T_achieved=achieved(rotors, measured.Omega * measured.Omega)[0],
        angles=angles,
        angles_c=angles_c,
        w_c=w_c,
        thrusts=thrusts,
        saturation=Saturation(
            thrust=thrust_cut, tilt=tilt_cut, torque=gave_up.torque, yaw=gave_up.yaw
        ),
    )
