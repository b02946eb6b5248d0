"""What every law tells of a tick, and what it keeps to, whatever it remembers and computes.

Shell, telemetry, metrics and plots build on these alone. SI units; E is Earth East-North-Up, B is
body Forward-Left-Up.
"""

from __future__ import annotations

from typing import NamedTuple

from fcu.interface.messages import RotorCommand, Setpoint, VehicleState
from fcu.kernel.algebra import Rotors, Vec3


class Limits(NamedTuple):
    """What the law asks of the actuators at most."""

    T_min: float  # least total thrust, N
    T_max: float  # greatest total thrust, N
    phi_star: float  # greatest roll, and greatest pitch, rad


class Pace(NamedTuple):
    """What modes that lead the vehicle have to know of the law."""

    f_m: float  # natural frequency with which it follows a setpoint, rad/s
    yaw_rate_max: float  # fastest yaw that it may be asked for, rad/s
    T_hover: float  # total thrust that hover is expected to take, N


class Reference(NamedTuple):
    """The reference model; NaN for a law that has none."""

    r_m: Vec3  # its position, m, E
    v_m: Vec3  # its velocity, m/s, E


class Saturation(NamedTuple):
    """What was cut, 1 while it is."""

    thrust: float  # the total thrust command, by a limit
    tilt: float  # the roll or pitch command, by the tilt limit
    torque: float  # that about roll and pitch, or thrust for its sake, by the allocation
    yaw: float  # the torque about yaw, by the allocation


class Outputs(NamedTuple):
    """What one tick of a law asks for, and what is achieved."""

    reference: Reference  # at this tick
    e_r: Vec3  # position minus reference, m, E
    T_c: float  # commanded total thrust, N
    T_achieved: float  # achieved total thrust, N
    angles: Vec3  # phi, theta, psi, rad
    angles_c: Vec3  # phi_c, theta_c, psi_c, rad
    w_c: Vec3  # commanded body rate, rad/s, B
    thrusts: Rotors  # allocated rotor thrusts, N
    saturation: Saturation


IDLE, TAKE_OVER, FLYING = 0.0, 1.0, 2.0  # whether a law flies: not, from this tick on, as before


class SharedTick(NamedTuple):
    """What the Tick of every law begins with: for whoever reads ticks and knows no law."""

    t: float  # simulation time, s
    measured: VehicleState
    setpoint: Setpoint  # as asked for: extrapolated to this tick
    command: RotorCommand
    engaged: float  # 0 idle, 1 take-over at this tick, 2 flying the law
    outputs: Outputs
