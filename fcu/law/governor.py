"""The reference model's input, governed: the setpoint brought so near that the condition holds.

The reference model follows (34) with r_g in place of r_c. While nothing is to be limited r_g is
r_c, to the bit. Not in the paper; a reference governor in the sense of its [12].
"""

from __future__ import annotations

import math

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3, clip, maximum, minimum, norm, select, select3
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import wrap
from fcu.law import margin
from fcu.law.approach import approach
from fcu.law.reference_model import a_ref

HALVINGS = 16
SLOWEST = 1.0  # m/s: as fast as this it goes whatever the condition says
BRAKING = 0.6  # of the deceleration there is: the model lags behind the speed it is to have


@kernel
def shortened(x, size):
    """A Vec3 of the same direction, no longer than `size`; itself if it is not."""
    length = norm(x)
    return select3(length > size, (size / (length + 1e-30)) * x, x)


@kernel
def speeds(params):
    """The greatest speed (m/s) of the reference, and the deceleration (m/s^2) it brakes with.

    Both from what hover leaves: at that speed, in the direction that suits worst, KEPT of the
    room is left, which brakes.
    """
    guard = params.guard
    still = Vec3(0.0, 0.0, 0.0)
    R = margin.room(params, still, still)
    kept = margin.KEPT * R
    # c x (w_max + share (x - w_max)) + difference = R - kept, with x = speed + w_max
    share = 0.5 * (1.0 + math.cos(params.phi_star))
    slope = margin.difference(params, 1.0) - margin.difference(params, 0.0)
    a = guard.c_D * share
    b = guard.c_D * (1.0 - share) * guard.w_max + slope
    usable = R - kept - margin.difference(params, 0.0) + slope * guard.w_max
    x = (math.sqrt(b * b + 4.0 * a * maximum(usable, 0.0)) - b) / (2.0 * a)
    top = maximum(x - guard.w_max, SLOWEST)
    brake = (kept + 0.5 * guard.c_D * (top + guard.w_max) * top) / guard.m_max
    return top, BRAKING * maximum(brake, 0.1)


@kernel
def wanted(params, setpoint, r_m, v_m):
    """Acceleration (m/s^2, E) that takes the reference to the setpoint within speed and jerk.

    That of (34) near the setpoint and at low speed.
    """
    f_m, zeta_m = params.f_m, params.zeta_m
    top, brake = speeds(params)
    to_go = setpoint.r_c - r_m
    far = norm(to_go)
    c = f_m / (2.0 * zeta_m)
    v_to = (approach(c, brake, far) / (far + 1e-30)) * to_go
    v_wanted = shortened(setpoint.v_c + v_to, top)
    short_by = v_wanted - v_m
    short = norm(short_by)
    change = approach(2.0 * f_m * zeta_m, 0.5 * params.guard.jerk, short)
    return setpoint.a_c + (change / (short + 1e-30)) * short_by


@kernel
def within(params, a, f_v, radius):
    """The largest part of acceleration a (m/s^2, E) whose demand is inside by `radius` (N)."""
    fits = margin.room(params, a, f_v) >= radius
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        inside = margin.room(params, middle * a, f_v) >= radius
        low, high = select(inside, middle, low), select(inside, high, middle)
    return select(fits, 1.0, low)


@kernel
def governed(params, state, setpoint, r, v):
    """The setpoint the reference model is given, its acceleration (m/s^2, E), 1 if it is governed.

    What is kept inside the limits is the acceleration that is demanded of the vehicle, the
    reference's plus what closes the tracking error; the reference gives way.
    """
    f_m, zeta_m, h = params.f_m, params.zeta_m, params.h
    r_m, v_m = state.r_m, state.v_m
    plain = a_ref(params, setpoint, r_m, v_m)  # (34)
    a_wanted = wanted(params, setpoint, r_m, v_m)
    a = state.a_m + shortened(a_wanted - state.a_m, params.guard.jerk * h)
    closing = -2.0 * f_m * zeta_m * (v - v_m) - f_m * f_m * (r - r_m)
    f_v = margin.dragging(params, v_m)
    at_rest = margin.room(params, Vec3(0.0, 0.0, 0.0), f_v)
    radius = minimum(
        margin.allowance(params, v_m, state.beta), (1.0 - margin.KEPT) * maximum(at_rest, 0.0)
    )
    part = within(params, a + closing, f_v, radius)
    a_g = part * (a + closing) - closing
    limited = (norm(a_g - plain) > 1e-6) & (params.guard.policy == 1.0) & (setpoint.level < 0.5)
    r_c, v_c, a_c = setpoint.r_c, setpoint.v_c, setpoint.a_c
    r_g = r_m + (a_g - a_c + 2.0 * f_m * zeta_m * (v_m - v_c)) / (f_m * f_m)  # (34) departure 17
    psi_g, psi_g_dot, _ = turned(params, state, setpoint)
    given = Setpoint(
        select3(limited, r_g, r_c), v_c, a_c, psi_g, psi_g_dot, setpoint.level,
        setpoint.tilt_c, setpoint.w_c, setpoint.T_c,
    )  # fmt: skip
    return given, select3(limited, a_g, plain), select(limited, 1.0, 0.0)


@kernel
def turned(params, state, setpoint):
    """Yaw (rad) and its rate (rad/s) that are commanded, and 1 if they are not the setpoint's.

    Yaw is the weak axis: its command too gets no faster than the rotors' drag can turn.
    """
    h, c, a, top = params.h, params.c_angle.z, params.yaw_acceleration, params.yaw_rate_max
    e = wrap(setpoint.psi_c - state.psi_g)
    rate = clip(setpoint.psi_dot_c + math.copysign(approach(c, a, abs(e)), e), -top, top)
    rate = clip(rate, state.psi_g_dot - a * h, state.psi_g_dot + a * h)
    off = (abs(e) > 1e-6) | (abs(rate - setpoint.psi_dot_c) > 1e-6)
    limited = off & (params.guard.policy == 1.0) & (setpoint.level < 0.5)
    return (
        select(limited, state.psi_g, setpoint.psi_c),
        select(limited, rate, setpoint.psi_dot_c),
        select(limited, 1.0, 0.0),
    )
