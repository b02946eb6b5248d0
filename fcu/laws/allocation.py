"""From total thrust and torque to eight rotor speeds, and back from speeds to what they achieve.

When not everything fits, torque about roll and pitch comes first (it keeps the vehicle
upright), then total thrust, then torque about yaw.
"""

from __future__ import annotations

from typing import NamedTuple

from fcu.kernel.algebra import (
    Rotors,
    Vec3,
    clip,
    clip8,
    greatest,
    least,
    minimum,
    select,
    sqrt8,
    total,
)  # fmt: skip
from fcu.kernel.compile import kernel


class RotorParams(NamedTuple):
    """The rotors as they are believed to be, and how thrust and torque are shared among them."""

    x: Rotors  # positions forward of the centre of mass, m
    y: Rotors  # positions left of it, m
    spin: Rotors  # +1 counter-clockwise from above, -1 clockwise
    c_T: float  # thrust coefficient, N/(rad/s)^2
    k_Q: float  # drag torque over thrust, m
    Omega_max: float  # full speed, rad/s
    f_min: float  # N, least thrust allocated to a rotor
    f_max: float  # N, greatest thrust allocated to a rotor
    kappa: float  # speed command over wanted change of speed: h^-1 of (7)
    mean: float  # weight of the earlier sample in a tick's mean of speed or its square
    B_x: Rotors  # thrusts for one N m about body x, N
    B_y: Rotors  # about body y
    B_z: Rotors  # about body z


@kernel
def achieved(rotors, Omega2):
    """Thrust (N) and torque (N m, B) of rotor speeds squared, by the believed coefficients.

    Paper (32): T is the sum of the rotors' thrusts. A rotor's drag turns the body against
    its spin.
    """
    f = rotors.c_T * Omega2
    T = total(f)  # (32)
    tau = Vec3(total(rotors.y * f), -total(rotors.x * f), -rotors.k_Q * total(rotors.spin * f))
    return T, tau


@kernel
def omega_m(rotors, Omega):
    """Sum of rotor speeds signed by spin (rad/s), positive counter-clockwise. Paper (33)."""
    return total(rotors.spin * Omega)  # (33) departure 4


@kernel
def allocate(rotors, T, tau):
    """Rotor thrusts (N) for a total thrust (N) and torque (N m, B), and 1 if any was given up."""
    low, high = rotors.f_min, rotors.f_max

    # roll and pitch: scaled together, only if their spread alone does not fit
    tilting = tau.x * rotors.B_x + tau.y * rotors.B_y
    top, bottom = greatest(tilting), least(tilting)
    k_tilt = minimum(1.0, (high - low) / (top - bottom + 1e-12))
    tilting = k_tilt * tilting

    # thrust: moved as little as it takes for roll and pitch to fit
    share = T / 8.0
    kept = clip(share, low - k_tilt * bottom, high - k_tilt * top)
    f = Rotors(kept, kept, kept, kept, kept, kept, kept, kept) + tilting

    # yaw: what room is left
    yawing = tau.z * rotors.B_z
    k_yaw = minimum(1.0, room(f, yawing, low, high))
    f = clip8(f + k_yaw * yawing, low, high)

    gave_up = (k_tilt < 1.0) or (abs(kept - share) > 1e-9) or (k_yaw < 1.0)
    return f, select(gave_up, 1.0, 0.0)  # departure 8


@kernel
def room(f, change, low, high):
    """The largest multiple of `change` that keeps every rotor of f inside [low, high]."""
    return least(
        Rotors(
            room1(f.r1, change.r1, low, high), room1(f.r2, change.r2, low, high),
            room1(f.r3, change.r3, low, high), room1(f.r4, change.r4, low, high),
            room1(f.r5, change.r5, low, high), room1(f.r6, change.r6, low, high),
            room1(f.r7, change.r7, low, high), room1(f.r8, change.r8, low, high),
        )
    )  # fmt: skip


@kernel
def room1(f, change, low, high):
    """The same for one rotor."""
    left = select(change < 0.0, f - low, high - f)
    return left / (abs(change) + 1e-12)


@kernel
def speed_command(rotors, thrusts, Omega):
    """Commanded rotor speeds over full speed, 0 to 1, for thrusts (N) from speeds Omega (rad/s).

    The lag is inverted: a first-order rotor told Omega + kappa (wanted - Omega) gets there
    kappa times sooner. h^-1 of (7).
    """
    wanted = sqrt8((1.0 / rotors.c_T) * thrusts)
    command = Omega + rotors.kappa * (wanted - Omega)  # (7) departure 8
    return clip8((1.0 / rotors.Omega_max) * command, 0.0, 1.0)


@kernel
def mean_squares(rotors, Omega_prev, Omega):
    """Mean of rotor speeds squared over the last tick ((rad/s)^2), from its two ends."""
    w = rotors.mean
    return w * (Omega_prev * Omega_prev) + (1.0 - w) * (Omega * Omega)


@kernel
def mean_omega_m(rotors, Omega_prev, Omega):
    """Mean of omega_m over the last tick (rad/s), from its two ends."""
    w = rotors.mean
    return omega_m(rotors, w * Omega_prev + (1.0 - w) * Omega)
