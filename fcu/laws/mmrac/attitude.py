"""From commanded angles to commanded body rates: Euler-angle backstepping. Paper (40)."""

from __future__ import annotations

import math
from typing import NamedTuple

from fcu.kernel.algebra import Vec3, clip, select
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import Matrix, euler, matrix, wrap
from fcu.laws.approach import approach


class Attitude(NamedTuple):
    """How the vehicle lies."""

    R_EB: Matrix
    angles: Vec3  # phi, theta, psi, rad
    cos_psi: float
    sin_psi: float


class Turn(NamedTuple):
    """How fast the vehicle is to turn."""

    w_c: Vec3  # commanded body rate, rad/s, B
    tilt_cut: float  # 1 if the tilt command moves faster than is fed forward
    yaw_cut: float  # 1 if a limit cuts the rate of yaw


@kernel
def measured(q_EB):
    """The Attitude of a quaternion."""
    R_EB = matrix(q_EB)
    cos_theta = math.sqrt(R_EB.e1.x * R_EB.e1.x + R_EB.e1.y * R_EB.e1.y) + 1e-30
    return Attitude(
        R_EB=R_EB,
        angles=euler(R_EB),
        cos_psi=R_EB.e1.x / cos_theta,
        sin_psi=R_EB.e1.y / cos_theta,
    )


@kernel
def filtered(params, tilt_filter, angles_c):
    """The low-passed tilt command (rad; x roll, y pitch, z 0) one tick on.

    The command is not differentiable in closed form; a low-pass of it is.
    """
    b, h = params.tilt_rate_bandwidth, params.h
    phi_f = (tilt_filter.x + h * b * angles_c.x) / (1.0 + h * b)
    theta_f = (tilt_filter.y + h * b * angles_c.y) / (1.0 + h * b)
    return Vec3(phi_f, theta_f, 0.0)


@kernel
def achieved(params, attitude, angles_c, tilt_filter, psi_dot_c):
    """The Turn that closes the error of the angles (rad), the command's own rate added.

    `tilt_filter` that of the command as of now, rad; `psi_dot_c` of the yaw command, rad/s.
    """
    angles, c = attitude.angles, params.c_angle
    b, limit = params.tilt_rate_bandwidth, params.tilt_rate_max
    phi_dot_c, theta_dot_c = b * (angles_c.x - tilt_filter.x), b * (angles_c.y - tilt_filter.y)
    cut = (abs(phi_dot_c) > limit) | (abs(theta_dot_c) > limit)
    phi_dot_c = clip(phi_dot_c, -limit, limit)  # departure 15
    theta_dot_c = clip(theta_dot_c, -limit, limit)  # departure 15
    psi_dot, limited = yaw_rate(params, wrap(angles_c.z - angles.z), psi_dot_c)
    rates = Vec3(
        phi_dot_c + c.x * (angles_c.x - angles.x),
        theta_dot_c + c.y * (angles_c.y - angles.y),
        psi_dot,
    )
    w_c = body_rates(attitude.R_EB, rates)
    return Turn(w_c=w_c, tilt_cut=select(cut, 1.0, 0.0), yaw_cut=limited)


@kernel
def demanded(params, attitude, angles_c, psi_dot_c):
    """The same as printed: nothing is fed forward for the tilt, and yaw has no limit."""
    angles, c = attitude.angles, params.c_angle
    rates = Vec3(
        c.x * (angles_c.x - angles.x),
        c.y * (angles_c.y - angles.y),
        psi_dot_c + c.z * wrap(angles_c.z - angles.z),
    )
    return Turn(w_c=body_rates(attitude.R_EB, rates), tilt_cut=0.0, yaw_cut=0.0)


@kernel
def yaw_rate(params, e_psi, psi_dot_c):
    """Rate of yaw (rad/s) that closes a yaw error (rad), and 1 if a limit cut it.

    Yaw is the weak axis. The rate towards the command is one from which the believed yaw
    acceleration can stop in time: c e close to it, then a square root that joins it smoothly,
    whose own deceleration is that acceleration.
    """
    c, a, top = params.c_angle.z, params.yaw_acceleration, params.yaw_rate_max
    closing = c * e_psi
    stops = approach(c, a, abs(e_psi))
    rate = psi_dot_c + clip(closing, -stops, stops)
    limited = (abs(closing) > stops) | (abs(rate) > top)
    return clip(rate, -top, top), select(limited, 1.0, 0.0)  # departure 16


@kernel
def body_rates(R_EB, rates):
    """Commanded body rates p_c, q_c, r_c (rad/s) for rates of the angles (rad/s).

    The printed brackets are differences of derivatives; angle feedback needs differences of
    angles, plus the command's own rate. Paper (40).
    """
    sin_theta = -R_EB.e1.z
    cos_theta = math.sqrt(R_EB.e2.z * R_EB.e2.z + R_EB.e3.z * R_EB.e3.z) + 1e-30
    sin_phi, cos_phi = R_EB.e2.z / cos_theta, R_EB.e3.z / cos_theta
    return Vec3(
        rates.x - rates.z * sin_theta,
        rates.y * cos_phi + rates.z * sin_phi * cos_theta,
        -rates.y * sin_phi + rates.z * cos_phi * cos_theta,
    )  # (40) departure 2
