"""Landing gear on flat ground: the vehicle can stand, take off, land and fall over.

One spring and damper under the centre of mass carries the weight. Friction cancels sideways forces
up to its limit, as static friction does. A torque rights and damps a leaning vehicle. Feet push but
do not pull, so this torque is at most the load times the lever arm of the foot under the load.
Not modelled: the moment of friction about the centre of mass, and ground that is not flat.
"""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3, clip, maximum, select
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import rotate_back

_TINY = 1e-9  # avoids 0 / 0


@kernel
def depth(ground, r_E):
    """Depth (m) of the feet of the gear in the ground; negative above it."""
    return ground.z + ground.gear - r_E.z


@kernel
def within(x, y, limit):
    """Scale factor that limits the length of (x, y) to `limit`."""
    length = math.sqrt(x * x + y * y)
    return limit / maximum(maximum(length, limit), _TINY)


@kernel
def contact(ground, r_E, v_E, R_EB, w_B, f_E):
    """Force (N, E) and torque (N m, B) of the ground; f_E (N, E): other forces on the vehicle."""
    deep = depth(ground, r_E)
    spring = ground.stiffness * deep - ground.damping * v_E.z
    load = select(deep > 0.0, maximum(spring, 0.0), 0.0)

    # friction cancels sideways forces and damps, up to the limit; below the limit nothing creeps
    x, y = f_E.x + ground.damping * v_E.x, f_E.y + ground.damping * v_E.y
    held = within(x, y, ground.friction * load)
    force = Vec3(-held * x, -held * y, load)

    # righting torque: turns body z to Earth z; the lean is z_B x up_B, which has no z component
    up_B = rotate_back(R_EB, Vec3(0.0, 0.0, 1.0))
    b = ground.footprint
    stiffness, damping = ground.stiffness * b * b, ground.damping * b * b
    roll = -stiffness * up_B.y - damping * w_B.x
    pitch = stiffness * up_B.x - damping * w_B.y

    # lever arm of the foot under the load; negative beyond the tipping angle: the vehicle falls
    lean = math.sqrt(up_B.x * up_B.x + up_B.y * up_B.y)
    lever = b * up_B.z - ground.gear * lean
    falling = load * lever / maximum(lean, _TINY)
    righted = within(roll, pitch, load * maximum(lever, 0.0))
    roll = select(lever > 0.0, righted * roll, -falling * up_B.y)
    pitch = select(lever > 0.0, righted * pitch, falling * up_B.x)
    turning = ground.friction * load * b
    yaw = clip(-damping * w_B.z, -turning, turning)
    return force, Vec3(roll, pitch, yaw)
