"""From total thrust and torque to rotor speeds, and back from speeds to what they achieve.

When not everything fits, torque about roll and pitch comes first (it keeps the vehicle
upright), then total thrust, then torque about yaw. Before thrust is moved for the sake of roll and
pitch, their torque is had in the way that takes the least from any rotor (`least_thrust`).

Rotors need not be alike, and a vehicle need not have eight. Each has a weight w, its share of a
hover without torque over the greatest such share: 1 of every rotor of a symmetric vehicle, 0 of one
that is absent. What is allocated is g, in N, and w g is what a rotor gives: so one least and one
greatest g hold for all, a rotor that carries less in hover keeps its share, and one that is absent is
never at a limit. The price is that a rotor of little weight is not used to its own full thrust.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fcu.interface.airframe import Airframe, effect, shares
from fcu.kernel.algebra import (
    Rotors,
    Vec3,
    clip,
    clip8,
    greatest,
    inverse8,
    least,
    maximum,
    minimum,
    select,
    sqrt8,
    total,
)  # fmt: skip
from fcu.kernel.compile import kernel
from fcu.laws import least_thrust
from fcu.laws.least_thrust import Pairs, outermost_pairs

# of the span of a rotor's thrust: so near its other limit the rotors are shared as the pseudo-inverse has it
FADES = 0.05
COUNTS = 0.02  # of the span of what torque asks of the rotors: what a rotor changes by, at least


class RotorParams(NamedTuple):
    """The rotors as they are believed to be, and how thrust and torque are shared among them."""

    x: Rotors  # positions forward of the centre of mass, m
    y: Rotors  # positions left of it, m
    spin: Rotors  # +1 counter-clockwise from above, -1 clockwise, 0 absent
    c_T: Rotors  # thrust coefficient, N/(rad/s)^2
    k_Q: float  # drag torque over thrust, m
    Omega_max: Rotors  # full speed, rad/s
    w: Rotors  # weight: share of a hover without torque over the greatest share; 0 absent
    W: float  # sum of the weights: the number of rotors, where these are alike
    f_min: float  # N, least thrust allocated to a rotor of weight 1
    f_max: float  # N, greatest thrust allocated to a rotor of weight 1
    safe: float  # 1: what does not fit is given up in order; 0: each rotor is cut by itself
    kappa: float  # speed command over wanted change of speed: h^-1 of (7)
    mean: float  # weight of the earlier sample in a tick's mean of speed or its square
    B_x: Rotors  # thrusts over weights for one N m about body x, N
    B_y: Rotors  # about body y
    B_z: Rotors  # about body z
    pairs: Pairs  # of rotors, by which the least total thrust gives a torque about roll and pitch

    @property
    def n(self) -> int:
        """How many rotors there are."""
        return sum(spin != 0.0 for spin in self.spin)


def rotor_mean(h: float, lag: float) -> float:
    """Weight of the earlier of two samples h apart in the mean of a first-order lag between them.

    One half for a slow rotor, nought for one without lag, whose speed is constant in a tick.
    """
    if lag <= 0.0:
        return 0.0
    ratio, decay = h / lag, math.exp(-h / lag)
    return 0.5 if ratio < 1e-4 else 1.0 / ratio - decay / (1.0 - decay)


def believed_rotors(
    believed: Airframe, h: float, lag: float, f_min: float, kappa: float, safe: float = 1.0
) -> RotorParams:
    """RotorParams of an airframe. h : control period, s.  lag : of the rotors, s.

    f_min : N, of a rotor of weight 1.
    """
    w, n = shares(believed), believed.n
    weights = np.array(w)[:n]
    inverse = np.linalg.pinv(effect(believed) * weights)  # torque does not change total thrust
    absent = [0.0] * (len(w) - n)
    B_x, B_y, B_z = (Rotors(*inverse[:, i].tolist(), *absent) for i in (1, 2, 3))
    full = [c_T * Omega**2 for c_T, Omega in zip(believed.c_T, believed.Omega_max, strict=True)]
    return RotorParams(
        x=believed.x,
        y=believed.y,
        spin=believed.spin,
        c_T=believed.c_T,
        k_Q=believed.k_Q,
        Omega_max=believed.Omega_max,
        w=w,
        W=float(weights.sum()),
        f_min=f_min,
        f_max=min(f / share for f, share in zip(full, w, strict=True) if share > 0.0),
        safe=safe,
        kappa=kappa,
        mean=rotor_mean(h, lag),
        B_x=B_x,
        B_y=B_y,
        B_z=B_z,
        pairs=outermost_pairs(believed.x, believed.y, believed.spin, range(n)),
    )


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


class GaveUp(NamedTuple):
    """What an allocation could not give, 1 each."""

    torque: float  # all of the torque about roll and pitch; or thrust, to give that
    yaw: float  # all of the torque about yaw


@kernel
def allocate(rotors, T, tau):
    """Rotor thrusts (N) for a total thrust (N) and torque (N m, B), and what was GaveUp."""
    if rotors.safe > 0.5:
        return safe_allocation(rotors, T, tau)
    return plain_allocation(rotors, T, tau)


@kernel
def safe_allocation(rotors, T, tau):
    """As `allocate`: roll and pitch first, then thrust, then yaw."""
    low, high = rotors.f_min, rotors.f_max

    # roll and pitch: scaled together, only if their spread alone does not fit
    tilting = tilted(rotors, T, tau)
    top, bottom = greatest(tilting), least(tilting)
    k_tilt = minimum(1.0, (high - low) / (top - bottom + 1e-12))
    tilting = k_tilt * tilting

    # thrust: moved as little as it takes for roll and pitch to fit
    share = T / rotors.W
    kept = clip(share, low - k_tilt * bottom, high - k_tilt * top)
    g = alike(kept) + tilting

    # yaw: what room is left
    yawing = tau.z * rotors.B_z
    k_yaw = select(leaves_yaw(rotors), 0.0, minimum(1.0, room(g, yawing, low, high)))
    g = clip8(g + k_yaw * yawing, low, high)

    moved = abs(kept - clip(share, low, high)) > 1e-9
    return rotors.w * g, GaveUp(
        torque=select((k_tilt < 1.0) | moved, 1.0, 0.0),
        yaw=select((k_yaw < 1.0) & (tau.z != 0.0), 1.0, 0.0),
    )  # departure 8


@kernel
def tilted(rotors, T, tau):
    """Thrusts over weights (N) that give the torque about roll and pitch, and lift nothing.

    Those of the pseudo-inverse, if they fit beside a total thrust T (N). Else as little of the way as it
    takes to those that take the least from any rotor: or, where a rotor's greatest thrust is in the way,
    to those that add the least. It ends where a rotor meets its other limit, and before the least and the
    greatest of them are too far apart for any thrust. Near either end it is given up by and by, so that no
    rotor jumps where the demand does not.
    """
    even = tau.x * rotors.B_x + tau.y * rotors.B_y
    low, high = rotors.f_min - T / rotors.W, rotors.f_max - T / rotors.W
    # what adds the least for a torque takes the least for the opposite one
    adds = greatest(even) > high
    sign = select(adds, -1.0, 1.0)
    low, high = select(adds, -high, low), select(adds, -low, high)
    f = least_thrust.thrusts(rotors.pairs, sign * tau.x, sign * tau.y)
    begin = sign * even
    way = inverse8(rotors.w) * f - alike(total(f) / rotors.W) - begin
    whole, end = high - low, begin + way
    apart, wider = greatest(begin) - least(begin), greatest(end) - least(end)
    part = minimum(
        lifting(begin, way, low, maximum(COUNTS * apart, 1e-12)), room_above(begin, way, high)
    )
    part = minimum(part, maximum(whole - apart, 0.0) / maximum(wider - apart, 1e-12))
    left = minimum(high - greatest(begin), whole - apart) / (FADES * whole)
    part = minimum(part, 1.0) * clip(left, 0.0, 1.0)
    return even + (sign * part) * way


@kernel
def plain_allocation(rotors, T, tau):
    """As `allocate`: the pseudo-inverse, then each rotor cut to its limits by itself.

    GaveUp: whether a rotor was cut without the torque about yaw, and whether all of that is there.
    """
    low, high = rotors.f_min, rotors.f_max
    g = alike(T / rotors.W) + tau.x * rotors.B_x + tau.y * rotors.B_y
    yawing = tau.z * rotors.B_z
    before, cut = clip8(g, low, high), clip8(g + yawing, low, high)
    return rotors.w * cut, GaveUp(
        torque=select(differs(rotors.w, before, g), 1.0, 0.0),
        yaw=select(
            differs(rotors.w, cut - before, yawing) | (leaves_yaw(rotors) & (tau.z != 0.0)),
            1.0,
            0.0,
        ),
    )


@kernel
def leaves_yaw(rotors):
    """Return true if no thrusts give torque about yaw: without some of its rotors a vehicle may leave it free."""
    return greatest(rotors.B_z) <= 0.0


@kernel
def alike(f):
    """The same of every rotor."""
    return Rotors(f, f, f, f, f, f, f, f)


@kernel
def differs(w, a, b):
    """Whether a rotor that is there has another value in a than in b."""
    off = w * (a - b)
    return (greatest(off) > 1e-9) | (least(off) < -1e-9)


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
def lifting(f, change, low, counts):
    """The least multiple of `change` that brings the rotors of f to no less than low. Nought if they are.

    counts : N, above 0: a rotor that changes by less, or downwards, is taken to change by that.
    """
    return greatest(
        Rotors(
            lifting1(f.r1, change.r1, low, counts), lifting1(f.r2, change.r2, low, counts),
            lifting1(f.r3, change.r3, low, counts), lifting1(f.r4, change.r4, low, counts),
            lifting1(f.r5, change.r5, low, counts), lifting1(f.r6, change.r6, low, counts),
            lifting1(f.r7, change.r7, low, counts), lifting1(f.r8, change.r8, low, counts),
        )
    )  # fmt: skip


@kernel
def lifting1(f, change, low, counts):
    """The same for one rotor."""
    return maximum(low - f, 0.0) / maximum(change, counts)


@kernel
def room_above(f, change, high):
    """The largest multiple of `change`, nought or more, that takes no rotor of f above high."""
    return least(
        Rotors(
            room_above1(f.r1, change.r1, high), room_above1(f.r2, change.r2, high),
            room_above1(f.r3, change.r3, high), room_above1(f.r4, change.r4, high),
            room_above1(f.r5, change.r5, high), room_above1(f.r6, change.r6, high),
            room_above1(f.r7, change.r7, high), room_above1(f.r8, change.r8, high),
        )
    )  # fmt: skip


@kernel
def room_above1(f, change, high):
    """The same for one rotor."""
    return maximum(high - f, 0.0) / maximum(change, 1e-12)


@kernel
def speed_command(rotors, thrusts, Omega):
    """Commanded rotor speeds over full speed, 0 to 1, for thrusts (N) from speeds Omega (rad/s).

    The lag is inverted: a first-order rotor told Omega + kappa (wanted - Omega) gets there
    kappa times sooner. h^-1 of (7).
    """
    wanted = sqrt8(inverse8(rotors.c_T) * thrusts)
    command = Omega + rotors.kappa * (wanted - Omega)  # (7) departure 8
    return clip8(inverse8(rotors.Omega_max) * command, 0.0, 1.0)


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
