"""A vehicle as a body in a field: the air at each rotor gives its velocity, its rotation and each thrust.

Velocity and rotation are those of the rigid motion nearest to the air at the hubs (least squares). The rotation is
the paper's rotation of the air mass. The thrust of a rotor changes with the velocity of the air
along its axis: blade element and momentum theory, linearised about hover, give

    dT / T = -(V / v_h) s a / (s a + 16 l),

with V the speed of the rotor through the air along its thrust, v_h the induced velocity of a hover at that
rotor speed, s a the solidity times the lift slope and l the inflow ratio (Leishman, Principles of Helicopter
Aerodynamics, 2.14 and 3.2). For model propellers s a is about 0.45 and l about 0.065, which
is 0.3. The plant does not know its blades: their radius is taken from the distance of the hubs.
"""

from __future__ import annotations

import math

from fcu.kernel import groups
from fcu.kernel.algebra import Vec3, clip, cross, select
from fcu.kernel.compile import kernel
from fcu.kernel.groups import ROTORS, WIDE
from fcu.kernel.pointers import address_of
from fcu.kernel.rotations import rotate
from sitl_plant.physics.wind import field
from sitl_plant.physics.wind.near import HUBS
from sitl_plant.physics.wind.near import meet as meet_near

SENSITIVITY = 0.3  # of thrust to V / v_h
AIR_DENSITY = 1.225  # kg/m^3
FILLED = 0.95  # of the distance between two hubs that their two rotors take


def rotor_radius(airframe):
    """Radius of the rotors (m), for which neighbours do not touch."""
    hubs = {(round(x, 6), round(y, 6)) for x, y, c in zip(airframe.x, airframe.y, airframe.c_T, strict=True) if c > 0.0}  # fmt: skip
    apart = [math.dist(a, b) for a in hubs for b in hubs if a != b]
    return 0.5 * FILLED * min(apart)


def reach(airframe):
    """Distance of the tip of the outermost rotor from the centre of the vehicle (m)."""
    return max(map(math.hypot, airframe.x, airframe.y)) + rotor_radius(airframe)


def induced_velocity(airframe, radius):
    """Induced velocity in hover over rotor speed (m), of each rotor: Rotors."""
    return tuple(
        math.sqrt(c / (2.0 * AIR_DENSITY * math.pi * radius * radius)) for c in airframe.c_T
    )


@kernel
def axial(speed, v_h):
    """Factor of thrust of a rotor that moves through the air along its thrust with `speed` (m/s).

    v_h : induced velocity in hover (m/s), beyond which `speed` counts no more. There the linearisation
    gives 0.70 and 1.30, where the equations that it stands for give 0.62 and 1.24.
    1 for a rotor at rest.
    """
    return select(v_h <= 0.0, 1.0, 1.0 - SENSITIVITY * clip(speed / v_h, -1.0, 1.0))


@kernel
def hub(airframe, i):
    """Position (m, B) of rotor i, and its thrust coefficient."""
    return Vec3(airframe.x[i], airframe.y[i], 0.0), airframe.c_T[i]


@kernel
def meet(of, airframe, origin, scale, r_E, R_EB, k, f, near, at_hubs):
    """Velocity (m/s, E) and rotation (rad/s, B) of the air about a vehicle.

    of : Field.  origin : of the mission, in the field (m).  scale : of its velocities.
    k, f : as of `field.time_in`.  near : as of `near.meet`.  at_hubs : float64[3, 8], to be filled:
    velocity of the air at each hub, m/s, E.
    """
    e1, e2, e3 = R_EB.e1, R_EB.e2, R_EB.e3
    kept, air = address_of(near), address_of(at_hubs)
    centre, to = origin + r_E, HUBS * ROTORS
    for h in range(0, ROTORS, WIDE):
        x, y = groups.of(airframe.x, h), groups.of(airframe.y, h)
        groups.write(kept, to + h, centre.x + (x * e1.x + y * e2.x))
        groups.write(kept, to + ROTORS + h, centre.y + (x * e1.y + y * e2.y))
        groups.write(kept, to + 2 * ROTORS + h, centre.z + (x * e1.z + y * e2.z))
    meet_near(of, near, k, f, at_hubs)
    mean, n = Vec3(0.0, 0.0, 0.0), 0.0
    x_sum, y_sum = 0.0, 0.0
    for h in range(0, ROTORS, WIDE):
        there = groups.of(airframe.c_T, h) > 0.0
        x, y = groups.of(airframe.x, h), groups.of(airframe.y, h)
        v_x = scale * groups.read(air, h)
        v_y = scale * groups.read(air, ROTORS + h)
        v_z = scale * groups.read(air, 2 * ROTORS + h)
        groups.write(air, h, v_x)
        groups.write(air, ROTORS + h, v_y)
        groups.write(air, 2 * ROTORS + h, v_z)
        mean = Vec3(
            groups.add_up(mean.x, select(there, v_x, 0.0)),
            groups.add_up(mean.y, select(there, v_y, 0.0)),
            groups.add_up(mean.z, select(there, v_z, 0.0)),
        )
        n = groups.add_up(n, select(there, 1.0 + 0.0 * x, 0.0))
        x_sum = groups.add_up(x_sum, select(there, x, 0.0))
        y_sum = groups.add_up(y_sum, select(there, y, 0.0))
    mean, middle = mean / n, Vec3(x_sum, y_sum, 0.0) / n
    xx, yy, xy, x_w, y_w, z_w = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for h in range(0, ROTORS, WIDE):
        there = groups.of(airframe.c_T, h) > 0.0
        x, y = groups.of(airframe.x, h) - middle.x, groups.of(airframe.y, h) - middle.y
        v_x = groups.read(air, h) - mean.x
        v_y = groups.read(air, ROTORS + h) - mean.y
        v_z = groups.read(air, 2 * ROTORS + h) - mean.z
        d_x = e1.x * v_x + e1.y * v_y + e1.z * v_z
        d_y = e2.x * v_x + e2.y * v_y + e2.z * v_z
        d_z = e3.x * v_x + e3.y * v_y + e3.z * v_z
        xx = groups.add_up(xx, select(there, x * x, 0.0))
        yy = groups.add_up(yy, select(there, y * y, 0.0))
        xy = groups.add_up(xy, select(there, x * y, 0.0))
        x_w = groups.add_up(x_w, select(there, y * d_z, 0.0))
        y_w = groups.add_up(y_w, select(there, -(x * d_z), 0.0))
        z_w = groups.add_up(z_w, select(there, x * d_y - y * d_x, 0.0))
    det = xx * yy - xy * xy
    w = Vec3((xx * x_w + xy * y_w) / det, (xy * x_w + yy * y_w) / det, z_w / (xx + yy))
    return mean - rotate(R_EB, cross(w, middle)), w


@kernel
def change_thrust(airframe, induced, Omega, at_hubs, others, v_E, w_B, R_EB, out, to):
    """Write the factor of thrust of each rotor to eight numbers of `out`, from number `to` on.

    Of the air at its hub and of its own motion.  induced : as of `induced_velocity`.  at_hubs : as of `meet`.
    others : velocity of other air, the same at all hubs, m/s, E.
    """
    e3, air, result = R_EB.e3, address_of(at_hubs), address_of(out)
    for h in range(0, ROTORS, WIDE):
        x, y = groups.of(airframe.x, h), groups.of(airframe.y, h)
        v_x = v_E.x - (groups.read(air, h) + others.x)
        v_y = v_E.y - (groups.read(air, ROTORS + h) + others.y)
        v_z = v_E.z - (groups.read(air, 2 * ROTORS + h) + others.z)
        through = (e3.x * v_x + e3.y * v_y + e3.z * v_z) + (w_B.x * y - w_B.y * x)
        v_h = groups.of(Omega, h) * groups.of(induced, h)
        groups.write(result, to + h, axial(through, v_h))


@kernel
def touches(of, airframe, origin, r_E, R_EB, radius):
    """Return true if the tip of a rotor is inside a building, or below the ground of the field."""
    for i in range(8):
        arm, c_T = hub(airframe, i)
        if c_T > 0.0:
            length = math.sqrt(arm.x * arm.x + arm.y * arm.y)
            out = 1.0 + radius / length if length > 0.0 else 1.0
            tip = origin + r_E + rotate(R_EB, out * arm)
            if tip.z < field.height(of, tip.x, tip.y):
                return True
    return False
