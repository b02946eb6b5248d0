"""Landing gear on flat ground: enough to stand on, take off from, land on and fall over.

One spring and damper under the centre of mass carries the weight. Friction holds against what
pushes the vehicle aside, as static friction does, up to its limit. A torque rights and damps it,
no greater than the load at the lever of the foot it leans on: feet push, they do not pull.
Left out: the moment of friction about the centre of mass, and what is not flat.
"""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3, clip, maximum, select
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import rotate_back

_TINY = 1e-9  # keeps 0 / 0 away


@kernel
def depth(ground, r_E):
    """How far (m) the gear's feet are in the ground; negative above it."""
    return ground.z + ground.gear - r_E.z


@kernel
def within(x, y, limit):
    """What to multiply (x, y) by so that its length is at most `limit`."""
    length = math.sqrt(x * x + y * y)
    return limit / maximum(maximum(length, limit), _TINY)


@kernel
def contact(ground, r_E, v_E, R_EB, w_B, f_E):
    """Force (N, E) and torque (N m, B) of the ground on a vehicle that f_E (N, E) acts on."""
    deep = depth(ground, r_E)
    spring = ground.stiffness * deep - ground.damping * v_E.z
    load = select(deep > 0.0, maximum(spring, 0.0), 0.0)

    # friction: all that would move it, and a damper, up to the limit. Nothing creeps below it.
    x, y = f_E.x + ground.damping * v_E.x, f_E.y + ground.damping * v_E.y
    held = within(x, y, ground.friction * load)
    force = Vec3(-held * x, -held * y, load)

    # righting: towards body z along Earth z; the lean is z_B x up_B, whose z is 0
    up_B = rotate_back(R_EB, Vec3(0.0, 0.0, 1.0))
    b = ground.footprint
    stiffness, damping = ground.stiffness * b * b, ground.damping * b * b
    roll = -stiffness * up_B.y - damping * w_B.x
    pitch = stiffness * up_B.x - damping * w_B.y

    # the foot it leans on is this far out: beyond its tipping angle on the other side, and it falls
    lean = math.sqrt(up_B.x * up_B.x + up_B.y * up_B.y)
    lever = b * up_B.z - ground.gear * lean
    falling = load * lever / maximum(lean, _TINY)
    righted = within(roll, pitch, load * maximum(lever, 0.0))
    roll = select(lever > 0.0, righted * roll, -falling * up_B.y)
    pitch = select(lever > 0.0, righted * pitch, falling * up_B.x)
    turning = ground.friction * load * b
    yaw = clip(-damping * w_B.z, -turning, turning)
    return force, Vec3(roll, pitch, yaw)
