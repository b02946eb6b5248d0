"""How fast a vehicle can be made, from the tables of its airframe file. For the defaults of gains.

Gains are rates, and an airframe sets the scale of them. What limits them, from the rotors upwards:

    alpha = tau_hover/J                         authority: torque there is beside hover, over inertia
    c_max = sqrt(2 alpha/STEP)                  what the torque suffices for
    rho   = max(lag/QUICKER, QUICKEST, ROTOR/c_max)  what the rotors' lag is made to look like (s)
    c_q   = min(ROTOR/rho, c_max)               rates, of roll and pitch
    c_r   = min(YAW c_q, sqrt(2 alpha_z/STEP_YAW))  and of yaw
    c_theta = c_q/2                             angles; the same of yaw
    f     = c_theta/POSITION                    position

- The rotors. Noise of the measured speeds and of the commands passes multiplied by lag/rho, and the
  rotors oscillate from tick to tick where that is too much for the control rate: hence QUICKER, and
  QUICKEST for the ticks of a control rate of 500 Hz; nor is rho shorter than the rates have use for.
- The lag. A first-order lag rho takes atan(c_q rho) of the phase margin of the rates: 8 degrees with
  ROTOR.
- The torque. With c_theta = c_q/2, which damps the angle loop by 0.7, a step phi of the commanded tilt
  asks for an angular acceleration of c_q c_theta phi = c_q^2 phi/2. A step of STEP asks for all there is.
- The position. A force is there when attitude and rates have followed, after 1/c_theta + 1/c_q =
  3/(2 c_theta). A position loop of frequency f and damping 0.8 has 2 x 0.8 x 3/2 f/c_theta = 0.7 of that
  lag in its own time scale with POSITION, half of where it begins to swing (fcu/guard/README.md).

A wind is as strong for a vehicle as its drag is heavy: `wind` is the one whose drag is CARRIED of the
least weight, and no more than the paper's.

Torque beside hover is that about one axis, without torque about another and with thrust as it is: until a
rotor is at its least or greatest thrust (`fcu.laws.allocation`). Every function takes the tables of an
airframe file, `believed(path)[1]`, and gives SI units; vectors are along the body axes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.airframe import G as G
from fcu.interface.airframe import airframe, effect, full_thrust, shares
from fcu.kernel.algebra import Vec3

Tables = Mapping[str, Any]

QUICKER = 5.0  # times, that a rotor is made to look quicker than it is
QUICKEST = 0.005  # s
ROTOR = 1.0 / 7.0  # of 1/rho, that the rates are fast
STEP = 0.5  # rad, of the tilt, that takes all torque
STEP_YAW = 0.15  # rad, of yaw, which has little
YAW = 3.0 / 7.0  # of roll and pitch, that yaw is fast at most
POSITION = 3.5  # times slower than attitude
CARRIED = 0.2  # of the least weight: the drag of the greatest wind
STORM = 12.0  # m/s: the paper's wind is up to 11.7
GUSTS = (
    5.0 / 3.0
)  # 1/s, the greatest rate of a wind over its greatest speed: the paper's, 20 over 12


def mass(tables: Tables) -> float:
    """The middle of what is believed, kg."""
    least, most = tables["vehicle"]["mass_kg"]
    return 0.5 * (float(least) + float(most))


def inertia(tables: Tables) -> Vec3:
    """The middle of what is believed, kg m^2."""
    return Vec3(*[0.5 * (float(a) + float(b)) for a, b in tables["vehicle"]["inertia_kg_m2"]])


def hover_thrust(tables: Tables) -> float:
    """The weight of the middle mass, N."""
    return mass(tables) * G


def thrust_to_weight(tables: Tables) -> float:
    """The greatest total thrust of a level hover, over `hover_thrust`."""
    most = min(float(tables["limits"]["thrust_max_n"]), full_thrust(airframe(tables["rotors"])))
    return most / hover_thrust(tables)


def tilt_max(tables: Tables) -> float:
    """The greatest roll and pitch, rad."""
    return math.radians(float(tables["limits"]["tilt_max_deg"]))


class _Allocated(NamedTuple):
    """Rotor thrusts over their weights (`fcu.laws.allocation`): of hover, and for torque."""

    hover: float  # N
    least: float  # N
    most: float  # N
    B: Any  # float64[n, 3], for one N m about each axis, 1/m


def _allocated(tables: Tables) -> _Allocated:
    of = airframe(tables["rotors"])
    w = np.array(shares(of))[: of.n]
    full = np.array(of.c_T)[: of.n] * np.array(of.Omega_max)[: of.n] ** 2
    return _Allocated(
        hover=hover_thrust(tables) / float(w.sum()),
        least=float(tables["limits"]["thrust_min_n"]) / float(w.sum()),
        most=float((full / w).min()),
        B=np.linalg.pinv(effect(of) * w)[:, 1:],
    )


def hover_speeds(tables: Tables) -> tuple[float, ...]:
    """Speeds (rad/s) of the rotors there are, in a level hover of the middle mass."""
    of = airframe(tables["rotors"])
    w = np.array(shares(of))[: of.n]
    thrusts = hover_thrust(tables) * w / w.sum()
    return tuple(float(v) for v in np.sqrt(thrusts / np.array(of.c_T)[: of.n]))


def hover_throttle(tables: Tables) -> float:
    """The greatest speed of a rotor in hover, over its full speed."""
    of = airframe(tables["rotors"])
    full = np.array(of.Omega_max)[: of.n]
    return float((np.array(hover_speeds(tables)) / full).max())


def torque(tables: Tables) -> Vec3:
    """Torque (N m) that there is beside a level hover of the middle mass, about one axis at a time."""
    g = _allocated(tables)
    room = max(min(g.hover - g.least, g.most - g.hover), 0.0)
    return Vec3(*[room / float(np.abs(g.B[:, axis]).max()) for axis in range(3)])


def authority(tables: Tables) -> Vec3:
    """Angular acceleration (rad/s^2) that there is beside hover, about one axis at a time."""
    tau, J = torque(tables), inertia(tables)
    return Vec3(tau.x / J.x, tau.y / J.y, tau.z / J.z)


def rotor_response(tables: Tables) -> float:
    """rho (s): what the lag of the rotors is made to look like; the lag stays where that is less."""
    lag = float(tables["rotors"]["lag_s"])
    return max(lag / QUICKER, QUICKEST, ROTOR / _of_torque(tables))


def _of_torque(tables: Tables) -> float:
    """c_max (1/s): the gain of the rates of roll and pitch that their torque suffices for."""
    alpha = authority(tables)
    return math.sqrt(2.0 * min(alpha.x, alpha.y) / STEP)


def rate_bandwidth(tables: Tables) -> Vec3:
    """c_q, c_q and c_r (1/s): the fastest sensible gain of the body rates; roll and pitch alike."""
    tilt = min(ROTOR / rotor_response(tables), _of_torque(tables))
    yaw = math.sqrt(2.0 * authority(tables).z / STEP_YAW)
    return Vec3(tilt, tilt, min(YAW * tilt, yaw))


def attitude_bandwidth(tables: Tables) -> Vec3:
    """c_theta, c_theta and c_psi (1/s): the fastest sensible gain of the angles."""
    c = rate_bandwidth(tables)
    return Vec3(0.5 * c.x, 0.5 * c.y, 0.5 * c.z)


def position_bandwidth(tables: Tables) -> float:
    """f (rad/s): the fastest sensible natural frequency of a position loop."""
    fastest: float = attitude_bandwidth(tables).x / POSITION
    return fastest


def brake(tables: Tables) -> float:
    """Half of what the greatest tilt gives, m/s^2: what a setpoint is approached with."""
    return 0.5 * G * math.tan(tilt_max(tables))


def yaw_acceleration(tables: Tables) -> float:
    """Half of the authority about yaw, rad/s^2: what yaw is believed to slow down with."""
    return 0.5 * authority(tables).z


def wind(tables: Tables) -> float:
    """The greatest wind (m/s) that a vehicle is expected to be flown in."""
    drag = CARRIED * float(tables["vehicle"]["mass_kg"][0]) * G
    return min(STORM, math.sqrt(drag / max(float(c) for c in tables["air"]["drag"])))
