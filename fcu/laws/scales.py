"""How fast a vehicle can be made, from the tables of its airframe file. For the defaults of gains."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from fcu.interface.airframe import airframe
from fcu.kernel.algebra import Vec3

Tables = Mapping[str, Any]

G = 9.81  # m/s^2
QUICKER = 5.0  # times, that a rotor is made to look quicker than it is
QUICKEST = 0.005  # s
ROTOR = 1.0 / 7.0  # of the rotors' response, that the rates are fast
STEP = 0.5  # rad, of the tilt, that takes all torque
STEP_YAW = 0.15  # rad, of yaw, which has little
YAW = 3.0 / 7.0  # of roll and pitch, that yaw is fast at most


def mass(tables: Tables) -> float:
    """The middle of what is believed, kg."""
    return float(np.mean(tables["vehicle"]["mass_kg"]))


def inertia(tables: Tables) -> Vec3:
    """The middle of what is believed, kg m^2."""
    return Vec3(*np.mean(tables["vehicle"]["inertia_kg_m2"], axis=1).tolist())


def authority(tables: Tables) -> Vec3:
    """Angular acceleration (rad/s^2) that there is beside hover, about one axis at a time."""
    body = airframe(dict(tables["rotors"]))
    f_max = np.broadcast_to(np.array(body.c_T) * np.array(body.Omega_max) ** 2, len(body.x))
    here = f_max > 0.0
    x, y, spin = (np.array(row)[here] for row in (body.x, body.y, body.spin))
    n = int(here.sum())
    inverse = np.linalg.pinv(np.stack([np.ones(n), y, -x, -body.k_Q * spin]))
    hover, least = G * mass(tables) / n, float(tables["limits"]["thrust_min_n"]) / n
    room = max(min(hover - least, float(f_max[here].min()) - hover), 0.0)
    torque = Vec3(*[room / float(np.abs(inverse[:, i]).max()) for i in (1, 2, 3)])
    alpha: Vec3 = torque / inertia(tables)
    return alpha


def rotor_response(tables: Tables) -> float:
    """What the lag of the rotors is made to look like, s."""
    most = ROTOR / _of_torque(tables)
    return max(float(tables["rotors"]["lag_s"]) / QUICKER, QUICKEST, most)


def _of_torque(tables: Tables) -> float:
    alpha = authority(tables)
    return math.sqrt(2.0 * min(alpha.x, alpha.y) / STEP)


def rate_bandwidth(tables: Tables) -> Vec3:
    """The fastest sensible gain of the body rates, 1/s; roll and pitch alike."""
    tilt = min(ROTOR / rotor_response(tables), _of_torque(tables))
    yaw = math.sqrt(2.0 * authority(tables).z / STEP_YAW)
    return Vec3(tilt, tilt, min(YAW * tilt, yaw))


def attitude_bandwidth(tables: Tables) -> Vec3:
    """The fastest sensible gain of the angles, 1/s."""
    half: Vec3 = 0.5 * rate_bandwidth(tables)
    return half
