"""From commanded angles to commanded body rates: Euler-angle backstepping. Paper (40)."""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3, clip
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import wrap


@kernel
def tilt_rate(params, tilt_filter, phi_c, theta_c):
    """Rate of the tilt command (rad/s; x roll, y pitch, z 0) and its filter one tick on (rad).

    The command is not differentiable in closed form; a low-pass of it is. As printed, nothing
    is fed forward.
    """
    b, h, limit = params.tilt_rate_bandwidth, params.h, params.tilt_rate_max * params.achieved
    phi_f = (tilt_filter.x + h * b * phi_c) / (1.0 + h * b)
    theta_f = (tilt_filter.y + h * b * theta_c) / (1.0 + h * b)
    rate = Vec3(
        clip(b * (phi_c - phi_f), -limit, limit),
        clip(b * (theta_c - theta_f), -limit, limit),
        0.0,
    )  # departure 15
    return rate, Vec3(phi_f, theta_f, 0.0)


@kernel
def w_c(params, R_EB, angles, angles_c, rates_c):
    """Commanded body rates p_c, q_c, r_c (rad/s).

    `angles` phi, theta, psi, those of R_EB; `angles_c` their commands (rad); `rates_c` the
    rates of the commands (rad/s). The printed brackets are differences of derivatives; angle
    feedback needs differences of angles, plus the command's own rate. Paper (40).
    """
    c = params.c_angle
    phi, theta = angles.x, angles.y
    phi_dot = rates_c.x + c.x * (angles_c.x - phi)
    theta_dot = rates_c.y + c.y * (angles_c.y - theta)
    psi_dot = rates_c.z + c.z * wrap(angles_c.z - angles.z)

    # of the angles, read off R_EB
    sin_theta = -R_EB.e1.z
    cos_theta = math.sqrt(R_EB.e2.z * R_EB.e2.z + R_EB.e3.z * R_EB.e3.z) + 1e-30
    sin_phi, cos_phi = R_EB.e2.z / cos_theta, R_EB.e3.z / cos_theta
    return Vec3(
        phi_dot - psi_dot * sin_theta,
        theta_dot * cos_phi + psi_dot * sin_phi * cos_theta,
        -theta_dot * sin_phi + psi_dot * cos_phi * cos_theta,
    )  # (40) departure 2
