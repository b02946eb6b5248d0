"""Euler angles and quaternions (x, y, z, w), as tf.transformations tells them."""

import numpy as np
from numpy import cos, sin


def quaternion_from_euler(roll, pitch, yaw, axes="sxyz"):
    """The quaternion of turns about the fixed axes x, y, z."""
    assert axes == "sxyz", axes
    half = np.array([roll, pitch, yaw]) / 2.0
    (cr, cp, cy), (sr, sp, sy) = cos(half), sin(half)
    return np.array(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )


def euler_from_quaternion(quaternion, axes="sxyz"):
    """Roll, pitch, yaw of a quaternion."""
    assert axes == "sxyz", axes
    x, y, z, w = quaternion
    return (
        np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
        np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )
