"""From commanded angles to commanded body rates: Euler-angle backstepping. Paper (40)."""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3, clip, select
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import wrap
from fcu.laws.mmrac.approach import approach


@kernel
def tilt_rate(params, tilt_filter, angles_c):
    """Rate of the tilt command (rad/s; x roll, y pitch, z 0), 1 if it is clipped, and its filter
    one tick on (rad).

    The command is not differentiable in closed form; a low-pass of it is. As printed, nothing
    is fed forward.
    """
    b, h, limit = params.tilt_rate_bandwidth, params.h, params.tilt_rate_max
    phi_c, theta_c = angles_c.x, angles_c.y
    phi_f = (tilt_filter.x + h * b * phi_c) / (1.0 + h * b)
    theta_f = (tilt_filter.y + h * b * theta_c) / (1.0 + h * b)
    phi_dot, theta_dot = b * (phi_c - phi_f), b * (theta_c - theta_f)
    clipped = (abs(phi_dot) > limit) | (abs(theta_dot) > limit)
    rate = Vec3(clip(phi_dot, -limit, limit), clip(theta_dot, -limit, limit), 0.0)  # departure 15
    rate = params.achieved * rate
    return rate, params.achieved * select(clipped, 1.0, 0.0), Vec3(phi_f, theta_f, 0.0)


@kernel
def yaw_rate(params, e_psi, psi_dot_c):
    """Rate of yaw (rad/s) that closes a yaw error (rad), and 1 if a limit cut it.

    Yaw is the weak axis. The rate towards the command is one from which the believed yaw
    acceleration can stop in time: c e close to it, then a square root that joins it smoothly,
    whose own deceleration is that acceleration. As printed there is no limit.
    """
    c, a, top = params.c_angle.z, params.yaw_acceleration, params.yaw_rate_max
    closing = c * e_psi
    stops = approach(c, a, abs(e_psi))
    rate = psi_dot_c + clip(closing, -stops, stops)
    kept = clip(rate, -top, top)  # departure 16
    limited = (abs(closing) > stops) | (abs(rate) > top)
    as_printed = params.achieved < 0.5
    return (
        select(as_printed, psi_dot_c + closing, kept),
        select(as_printed, 0.0, select(limited, 1.0, 0.0)),
    )


@kernel
def w_c(params, R_EB, angles, angles_c, rates_c):
    """Commanded body rates p_c, q_c, r_c (rad/s), and 1 if a limit cut the rate of yaw.

    `angles` phi, theta, psi, those of R_EB; `angles_c` their commands (rad); `rates_c` the
    rates of the commands (rad/s). The printed brackets are differences of derivatives; angle
    feedback needs differences of angles, plus the command's own rate. Paper (40).
    """
    c = params.c_angle
    phi, theta = angles.x, angles.y
    phi_dot = rates_c.x + c.x * (angles_c.x - phi)
    theta_dot = rates_c.y + c.y * (angles_c.y - theta)
    psi_dot, limited = yaw_rate(params, wrap(angles_c.z - angles.z), rates_c.z)

    # of the angles, read off R_EB
    sin_theta = -R_EB.e1.z
    cos_theta = math.sqrt(R_EB.e2.z * R_EB.e2.z + R_EB.e3.z * R_EB.e3.z) + 1e-30
    sin_phi, cos_phi = R_EB.e2.z / cos_theta, R_EB.e3.z / cos_theta
    w_c = Vec3(
        phi_dot - psi_dot * sin_theta,
        theta_dot * cos_phi + psi_dot * sin_phi * cos_theta,
        -theta_dot * sin_phi + psi_dot * cos_phi * cos_theta,
    )  # (40) departure 2
    return w_c, limited
