"""Between the frames inside (Earth ENU, body FLU) and the wire's (Earth NED, body FRD).

E is Earth East-North-Up, B is body Forward-Left-Up; N is Earth North-East-Down, F is body
Forward-Right-Down. Each map here is its own inverse, so one serves both ways; each is written
once, as a kernel, and `earth`, `body`, `heading` and `attitude` are the same for plain Python.

`through_the_wire` and its companion are what a value becomes by being sent: the wire carries
float32. The plant link encodes and decodes with these same kernels, so a flight in one process
and one over UDP see the same bits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fcu.interface.messages import RotorCommand, VehicleState
from fcu.kernel.algebra import Quat, Rotors, Vec3, as_float32, select
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import matrix, normalised, rotate, rotate_back, wrap

FLOAT32_MAX = float(np.finfo(np.float32).max)


class StateOnWire(NamedTuple):
    """What ODOMETRY and ACTUATOR_OUTPUT_STATUS carry, in the order of their fields."""

    r_N: Vec3  # position, m
    q_NF: Quat  # attitude, body FRD to Earth NED
    v_F: Vec3  # velocity, m/s, in body axes
    w_F: Vec3  # body rate, rad/s
    Omega: Rotors  # rotor speeds, rad/s


@kernel
def limited(x, low, high):
    """`x` held inside [low, high]. NaN stays NaN: it is for the receiver to refuse."""
    return select(x > high, high, select(x < low, low, x))


@kernel
def single(x):
    """The float64 value of `x` as a float32 field carries it: saturated, then rounded."""
    return as_float32(limited(x, -FLOAT32_MAX, FLOAT32_MAX))


@kernel
def single3(a):
    """`single` of each component of a Vec3."""
    return Vec3(single(a.x), single(a.y), single(a.z))


@kernel
def single4(q):
    """`single` of each component of a Quat."""
    return Quat(single(q.w), single(q.x), single(q.y), single(q.z))


@kernel
def single8(a):
    """`single` of each rotor's value."""
    return Rotors(
        single(a.r1), single(a.r2), single(a.r3), single(a.r4),
        single(a.r5), single(a.r6), single(a.r7), single(a.r8),
    )  # fmt: skip


@kernel
def magnitude8(a):
    """Absolute value of each rotor's speed: the wire signs it by the rotor's spin."""
    return Rotors(
        abs(a.r1), abs(a.r2), abs(a.r3), abs(a.r4), abs(a.r5), abs(a.r6), abs(a.r7), abs(a.r8)
    )


@kernel
def enu_ned(v):
    """A vector's NED components from its ENU ones, or ENU from NED."""
    return Vec3(v.y, v.x, -v.z)


@kernel
def flu_frd(v):
    """A vector's FRD components from its FLU ones, or FLU from FRD."""
    return Vec3(v.x, -v.y, -v.z)


@kernel
def canonical(q):
    """Of the two quaternions of one rotation, the one with w >= 0."""
    sign = select(q.w >= 0.0, 1.0, -1.0)
    return sign * q


@kernel
def attitude_enu_ned(q):
    """q_NF (FRD to NED) from q_EB (FLU to ENU), or q_EB from q_NF; w >= 0.

    It is p q i: i turns half a turn about forward, p half a turn about the line midway
    between North and East; written out, up to the sign.
    """
    s = math.sqrt(0.5)
    return canonical(Quat(s * (q.w + q.z), s * (q.x + q.y), s * (q.x - q.y), s * (q.w - q.z)))


@kernel
def yaw_enu_ned(psi):
    """Yaw from North, clockwise, of yaw from East, counter-clockwise, or back; in [-pi, pi)."""
    return wrap(0.5 * math.pi - np.fmod(psi, 2.0 * math.pi))


def _plain(function):
    """A kernel as plain Python: of an exchange of axes, which no call into compiled code is worth."""
    return function.py_func


earth = _plain(enu_ned)
body = _plain(flu_frd)


def heading(psi):
    """`yaw_enu_ned` of any number."""
    return float(yaw_enu_ned(float(psi)))


def attitude(q):
    """`attitude_enu_ned` of a Quat of any numbers: of floats alone, or it is compiled anew."""
    return attitude_enu_ned(Quat(float(q.w), float(q.x), float(q.y), float(q.z)))


@kernel
def state_to_wire(state):
    """StateOnWire of a VehicleState; rotor speeds are still without the sign of their spin."""
    v_E = state.v_E
    v_E = Vec3(
        limited(v_E.x, -FLOAT32_MAX, FLOAT32_MAX),
        limited(v_E.y, -FLOAT32_MAX, FLOAT32_MAX),
        limited(v_E.z, -FLOAT32_MAX, FLOAT32_MAX),
    )  # before it is rotated, so that an infinite velocity does not become NaN
    return StateOnWire(
        single3(enu_ned(state.r_E)),
        single4(attitude_enu_ned(state.q_EB)),
        single3(flu_frd(rotate_back(matrix(state.q_EB), v_E))),
        single3(flu_frd(state.w_B)),
        single8(state.Omega),
    )


@kernel
def state_from_wire(fields):
    """VehicleState of a received StateOnWire, the attitude brought back to unit length."""
    q_EB = normalised(attitude_enu_ned(fields.q_NF))
    return VehicleState(
        enu_ned(fields.r_N),
        rotate(matrix(q_EB), flu_frd(fields.v_F)),
        q_EB,
        flu_frd(fields.w_F),
        magnitude8(fields.Omega),
    )


@kernel
def through_the_wire(state):
    """The VehicleState that the flight controller decodes when the plant sends `state`."""
    return state_from_wire(state_to_wire(state))


@kernel
def state_in_flight(state, spin):
    """The StateOnWire of a VehicleState as it is sent: rotor speeds signed by spin, none of a rotor absent.

    spin : Rotors.
    """
    sent = state_to_wire(state)
    return StateOnWire(sent.r_N, sent.q_NF, sent.v_F, sent.w_F, spin * sent.Omega)


@kernel
def command_through_the_wire(command):
    """The RotorCommand that the plant decodes: held inside [0, 1], as float32."""
    u = command.u
    return RotorCommand(
        Rotors(
            single(limited(u.r1, 0.0, 1.0)), single(limited(u.r2, 0.0, 1.0)),
            single(limited(u.r3, 0.0, 1.0)), single(limited(u.r4, 0.0, 1.0)),
            single(limited(u.r5, 0.0, 1.0)), single(limited(u.r6, 0.0, 1.0)),
            single(limited(u.r7, 0.0, 1.0)), single(limited(u.r8, 0.0, 1.0)),
        )
    )  # fmt: skip
