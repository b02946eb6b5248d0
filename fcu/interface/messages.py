"""What crosses the wire, in the paper's frames: Earth East-North-Up, body Forward-Left-Up, SI.

Hamilton quaternions, scalar first; yaw in rad from East, counter-clockwise. As pure as
the kernel: the law takes and returns these; `wire` turns them into MAVLink and back.
"""

from __future__ import annotations

from typing import NamedTuple

from fcu.kernel.algebra import Quat, Rotors, Vec3


class VehicleState(NamedTuple):
    """What the plant reports at one control tick: the controller's whole knowledge of it."""

    r_E: Vec3  # position, m, Earth
    v_E: Vec3  # velocity, m/s, Earth
    q_EB: Quat  # attitude, body to Earth
    w_B: Vec3  # body rate, rad/s, body
    Omega: Rotors  # rotor speeds, rad/s, unsigned


class Setpoint(NamedTuple):
    """Where to be: the reference model's input. A fixed position has zero v_c and a_c."""

    r_c: Vec3  # position, m, Earth
    v_c: Vec3  # its velocity, m/s, Earth
    a_c: Vec3  # its acceleration, m/s^2, Earth
    psi_c: float  # yaw, rad
    psi_dot_c: float  # yaw rate, rad/s


class RotorCommand(NamedTuple):
    """What the controller sends: commanded rotor speeds over full speed, 0 to 1."""

    u: Rotors
