"""Landing gear on flat ground: enough to stand on, take off from and land on.

One spring and damper under the centre of mass carries the weight; friction holds it in
place; a torque proportional to the load rights it, as feet a footprint apart would.
"""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3, cross, maximum, minimum, select
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import rotate_back


@kernel
def contact(ground, r_E, v_E, R_EB, w_B):
    """Force (N, E), torque (N m, B) of the ground, and 1 while the gear touches it."""
    depth = ground.z + ground.gear - r_E.z
    touching = select(depth > 0.0, 1.0, 0.0)
    load = touching * maximum(ground.stiffness * depth - ground.damping * v_E.z, 0.0)

    slip = math.sqrt(v_E.x * v_E.x + v_E.y * v_E.y)
    grip = ground.friction * load / maximum(slip, 0.05)  # viscous below 5 cm/s
    force = Vec3(-grip * v_E.x, -grip * v_E.y, load)

    # righting: towards body z along Earth z, with the leverage of the footprint
    up_B = rotate_back(R_EB, Vec3(0.0, 0.0, 1.0))
    b = ground.footprint
    lean = cross(Vec3(0.0, 0.0, 1.0), up_B)
    lever = minimum(load * b, ground.stiffness * b * b)
    torque = (4.0 * lever) * lean - (touching * ground.damping * b * b) * w_B
    return force, torque, touching
