"""Rotations: Hamilton quaternions, their matrices, and Z-Y-X Euler angles.

`R_EB` takes components along the body axes to components along the Earth axes:
`v_E = R_EB v_B`. Angles are yaw psi, pitch theta, roll phi, in that order (Z-Y-X), so that
`R e3 = (c_psi s_th c_ph + s_psi s_ph, s_psi s_th c_ph - c_psi s_ph, c_th c_ph)`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fcu.kernel.algebra import Quat, Vec3, cross, dot
from fcu.kernel.compile import kernel


class Matrix(NamedTuple):
    """A rotation matrix by its columns: the target components of the source axes."""

    e1: Vec3
    e2: Vec3
    e3: Vec3


@kernel
def matrix(q):
    """Rotation matrix of a unit quaternion."""
    xx, yy, zz = q.x * q.x, q.y * q.y, q.z * q.z
    xy, xz, yz = q.x * q.y, q.x * q.z, q.y * q.z
    wx, wy, wz = q.w * q.x, q.w * q.y, q.w * q.z
    return Matrix(
        Vec3(1.0 - 2.0 * (yy + zz), 2.0 * (xy + wz), 2.0 * (xz - wy)),
        Vec3(2.0 * (xy - wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz + wx)),
        Vec3(2.0 * (xz + wy), 2.0 * (yz - wx), 1.0 - 2.0 * (xx + yy)),
    )


@kernel
def rotate(R, v):
    """`R v`: components along the target axes."""
    return v.x * R.e1 + v.y * R.e2 + v.z * R.e3


@kernel
def rotate_back(R, v):
    """`R^T v`: components along the source axes."""
    return Vec3(dot(R.e1, v), dot(R.e2, v), dot(R.e3, v))


@kernel
def conjugate(q):
    """The inverse of a unit quaternion."""
    return Quat(q.w, -q.x, -q.y, -q.z)


@kernel
def normalised(q):
    """`q` at unit length."""
    return (1.0 / math.sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z)) * q


@kernel
def quaternion_rate(q_EB, w_B):
    """Derivative of q_EB for a body rate w_B in rad/s: half of q times (0, w)."""
    return 0.5 * (q_EB * Quat(0.0, w_B.x, w_B.y, w_B.z))


@kernel
def euler(R):
    """Roll phi, pitch theta, yaw psi (rad) of a rotation matrix, as a Vec3."""
    cos_theta = math.sqrt(R.e2.z * R.e2.z + R.e3.z * R.e3.z)
    return Vec3(
        math.atan2(R.e2.z, R.e3.z),
        math.atan2(-R.e1.z, cos_theta),
        math.atan2(R.e1.y, R.e1.x),
    )


@kernel
def from_euler(phi, theta, psi):
    """Quaternion of yaw psi, then pitch theta, then roll phi (rad)."""
    cr, sr = math.cos(0.5 * phi), math.sin(0.5 * phi)
    cp, sp = math.cos(0.5 * theta), math.sin(0.5 * theta)
    cy, sy = math.cos(0.5 * psi), math.sin(0.5 * psi)
    return Quat(
        cy * cp * cr + sy * sp * sr,
        cy * cp * sr - sy * sp * cr,
        cy * sp * cr + sy * cp * sr,
        sy * cp * cr - cy * sp * sr,
    )


@kernel
def wrap(angle):
    """An angle in rad, brought into [-pi, pi)."""
    turn = 2.0 * math.pi
    return angle - turn * math.floor(angle / turn + 0.5)


@kernel
def small_rotation(v):
    """Unit quaternion of a small rotation vector (rad), to second order, normalised."""
    return normalised(Quat(1.0, 0.5 * v.x, 0.5 * v.y, 0.5 * v.z))


__all__ = [
    "Matrix", "conjugate", "cross", "euler", "from_euler", "matrix", "normalised",
    "quaternion_rate", "rotate", "rotate_back", "small_rotation", "wrap",
]  # fmt: skip
