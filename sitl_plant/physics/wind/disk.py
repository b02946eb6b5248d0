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

from fcu.kernel.algebra import Vec3, cross
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import rotate, rotate_back
from sitl_plant.physics.wind import field

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
    if v_h <= 0.0:
        return 1.0
    return 1.0 - SENSITIVITY * max(min(speed / v_h, 1.0), -1.0)


@kernel
def hub(airframe, i):
    """Position (m, B) of rotor i, and its thrust coefficient."""
    return Vec3(airframe.x[i], airframe.y[i], 0.0), airframe.c_T[i]


@kernel
def meet(of, airframe, origin, scale, r_E, R_EB, k, f, hubs, at_hubs):
    """Velocity (m/s, E) and rotation (rad/s, B) of the air about a vehicle.

    of : Field.  origin : of the mission, in the field (m).  scale : of its velocities.
    k, f : as of `field.time_in`.  hubs, at_hubs : float64[8, 3], to be filled: place of each hub
    in the field (m), and velocity of the air there, m/s, E.
    """
    for i in range(8):
        arm, _ = hub(airframe, i)
        at = origin + r_E + rotate(R_EB, arm)
        hubs[i, 0], hubs[i, 1], hubs[i, 2] = at.x, at.y, at.z
    field.sample_all(of, hubs, 8, k, f, at_hubs)
    mean, middle, n = Vec3(0.0, 0.0, 0.0), Vec3(0.0, 0.0, 0.0), 0
    for i in range(8):
        arm, c_T = hub(airframe, i)
        if c_T > 0.0:
            v = scale * Vec3(at_hubs[i, 0], at_hubs[i, 1], at_hubs[i, 2])
            at_hubs[i, 0], at_hubs[i, 1], at_hubs[i, 2] = v.x, v.y, v.z
            mean, middle, n = mean + v, middle + arm, n + 1
    mean, middle = mean / float(n), middle / float(n)
    xx, yy, xy, x_w, y_w, z_w = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(8):
        arm, c_T = hub(airframe, i)
        if c_T > 0.0:
            v = Vec3(at_hubs[i, 0], at_hubs[i, 1], at_hubs[i, 2])
            d, p = rotate_back(R_EB, v - mean), arm - middle
            xx, yy, xy = xx + p.x * p.x, yy + p.y * p.y, xy + p.x * p.y
            x_w += p.y * d.z
            y_w -= p.x * d.z
            z_w += p.x * d.y - p.y * d.x
    det = xx * yy - xy * xy
    w = Vec3((xx * x_w + xy * y_w) / det, (xy * x_w + yy * y_w) / det, z_w / (xx + yy))
    return mean - rotate(R_EB, cross(w, middle)), w


@kernel
def thrust_factor(airframe, i, v_h, at_hubs, v_E, w_B, R_EB):
    """Factor of the thrust of rotor i, of the air at its hub and of its own motion.  v_h : as of `axial`."""
    arm, _ = hub(airframe, i)
    v_air = Vec3(at_hubs[i, 0], at_hubs[i, 1], at_hubs[i, 2])
    through = rotate_back(R_EB, v_E - v_air) + cross(w_B, arm)
    return axial(through.z, v_h)


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
