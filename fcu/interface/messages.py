"""What crosses the wire, in the paper's frames: Earth East-North-Up, body Forward-Left-Up, SI.

Hamilton quaternions, scalar first; yaw in rad from East, counter-clockwise. As pure as
the kernel: the law takes and returns these; `fcu.mavlink` turns them into MAVLink and back.
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
    """Where to be: the reference model's input. A fixed position has zero v_c and a_c.

    Or, below that, how to lie or to turn: `level` says where the cascade is entered, 0 position,
    1 attitude (roll, pitch, yaw) with thrust, 2 body rates with thrust. Inside compiled code,
    where the defaults are not known, every field is given.
    """

    r_c: Vec3  # position, m, Earth
    v_c: Vec3  # its velocity, m/s, Earth
    a_c: Vec3  # its acceleration, m/s^2, Earth
    psi_c: float  # yaw, rad (levels 0 and 1)
    psi_dot_c: float  # yaw rate, rad/s (levels 0 and 1)
    level: float = 0.0  # where the cascade is entered: 0 position, 1 attitude, 2 body rates
    tilt_c: Vec3 = Vec3(0.0, 0.0, 0.0)  # level 1: roll, pitch (x, y), rad; z unused
    w_c: Vec3 = Vec3(0.0, 0.0, 0.0)  # level 2: body rates, rad/s, body
    T_c: float = 0.0  # levels 1 and 2: total thrust, N


class RotorCommand(NamedTuple):
    """What the controller sends: commanded rotor speeds over full speed, 0 to 1."""

    u: Rotors


class Battery(NamedTuple):
    """What the plant reports of its battery, now and then: for ground stations, not for the law."""

    voltage: float  # V
    current: float  # A
    drawn_Ah: float  # A h, since the flight began
    remaining: float  # of its charge, 0 to 1
    energy_J: float  # J, drawn since the flight began


class PositionRequest(NamedTuple):
    """Where a script asks a vehicle to be, and how to move there. None, or NaN on an axis: left out."""

    r: Vec3 | None  # m
    v: Vec3 | None  # m/s
    a: Vec3 | None  # m/s^2
    psi: float | None  # rad
    psi_dot: float  # rad/s
    along_heading: bool = False  # v and a are forward, left, up of the heading; else Earth ENU
    from_here: bool = False  # r is from where the vehicle is; along its heading, psi is too


class AttitudeRequest(NamedTuple):
    """How a script asks a vehicle to lie, or to turn."""

    q_EB: Quat | None  # None: by its body rates alone
    w_B: Vec3  # rad/s; with an attitude 0 where it is left to the vehicle
    thrust: float  # of full thrust, 0 to 1
