"""The reference model's input, governed: the setpoint brought so near that the condition holds.

The reference model follows (34) with r_g in place of r_c. While nothing is to be limited r_g is
r_c, to the bit. Not in the paper; a reference governor in the sense of its [12].
"""

from __future__ import annotations

import math

from fcu.guard import margin, wrench
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3, clip, dot, maximum, minimum, norm, select, select3
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import wrap
from fcu.laws.approach import approach
from fcu.laws.mmrac.reference_model import a_ref

SLOWEST = 1.0  # m/s: as fast as this it goes whatever the condition says
LEAD = 0.3  # rad: so far the commanded yaw runs ahead of the vehicle at most
PART_LED = 0.1  # of the jerk, for what is fed forward; half of it is there for what closes a way
BRAKING = 0.6  # of the deceleration there is: the model lags behind the speed it is to have
PART_BRAKED = 0.4  # of what a jerk takes back: led with half of it, nothing fed forward


@kernel
def shortened(x, size):
    """A Vec3 of the same direction, no longer than `size`; itself if it is not."""
    length = norm(x)
    return select3(length > size, (size / (length + 1e-30)) * x, x)


@kernel
def speeds(known):
    """The greatest speed (m/s) of the reference, and the deceleration (m/s^2) it brakes with.

    Both from what hover leaves: at that speed, in the direction that suits worst, KEPT of the
    room is left, which brakes. Without a rotor they are those of the whole vehicle.
    """
    still = Vec3(0.0, 0.0, 0.0)
    R = margin.room(known, still, still)
    kept = margin.KEPT * R
    # c x^2 + z_0 + z_1 (x - w_max) = R - kept, with x = speed + w_max
    usable = R - kept - known.z_0 + known.z_1 * known.w_max - known.noise
    root = math.sqrt(known.z_1 * known.z_1 + 4.0 * known.c_D * maximum(usable, 0.0))
    x = (root - known.z_1) / (2.0 * known.c_D)
    # beyond it a tilt does not steer, or has no torque for a gust
    x = minimum(x, math.sqrt(minimum(known.lean, known.lean_turns) / known.c_D))
    top = maximum(x - known.w_max, SLOWEST)
    brake = (kept + 0.5 * known.c_D * (top + known.w_max) * top) / known.m_max
    whole = known.promises > 0.5
    return select(whole, top, known.top), select(whole, BRAKING * maximum(brake, 0.1), known.brake)


@kernel
def taken_back(brake, c, j):
    """Of a deceleration (m/s^2), as much as a jerk j (m/s^3) takes back where the speed fades with c (1/s).

    There the deceleration changes with c times itself. More than PART_BRAKED of j/c passes the setpoint, and more
    than j/c may swing about it without end.
    """
    return minimum(brake, PART_BRAKED * j / c)


@kernel
def sunk(known, v):
    """A velocity (m/s, E) that leads down no faster than a tilt steers there."""
    return Vec3(v.x, v.y, maximum(v.z, -maximum(margin.sinking(known), SLOWEST)))


@kernel
def led(law, known, a_c, v_m, j):
    """What of an acceleration (m/s^2, E) that is fed forward leads to no more than the greatest speeds.

    Towards one it fades as `approach` has it, with PART_LED of the jerk j (m/s^3).
    """
    top, _ = speeds(known)
    down = maximum(margin.sinking(known), SLOWEST)
    c, b, speed = 2.0 * law.f_m * law.zeta_m, PART_LED * j, norm(v_m)
    along = (1.0 / (speed + 1e-30)) * v_m
    beyond = maximum(dot(a_c, along) - approach(c, b, maximum(top - speed, 0.0)), 0.0)
    a = a_c - beyond * along
    return Vec3(a.x, a.y, maximum(a.z, -approach(c, b, maximum(down + v_m.z, 0.0))))


@kernel
def wanted(law, known, setpoint, r_m, v_m, j):
    """Acceleration (m/s^2, E) that takes the reference to the setpoint within speed and jerk.

    That of (34) near the setpoint and at low speed.
    """
    f_m, zeta_m = law.f_m, law.zeta_m
    top, brake = speeds(known)
    to_go = setpoint.r_c - r_m
    far = norm(to_go)
    c = f_m / (2.0 * zeta_m)
    brake = taken_back(brake, c, j)
    v_to = (approach(c, brake, far) / (far + 1e-30)) * to_go
    v_wanted = sunk(known, shortened(setpoint.v_c + v_to, top))
    short_by = v_wanted - v_m
    short = norm(short_by)
    change = approach(2.0 * f_m * zeta_m, 0.5 * j, short)
    given = led(law, known, setpoint.a_c, v_m, j)
    return given + (change / (short + 1e-30)) * short_by


@kernel
def first_root(a, b, c):
    """The least positive root of a s^2 + 2 b s + c, with c >= 0; 1 if there is none below it."""
    under = b * b - a * c
    below = math.sqrt(maximum(under, 0.0)) - b
    crosses = (under >= -1e-9 * (b * b)) & (below > c)  # c / below < 1; it may touch zero only
    return select(crosses, c / maximum(below, 1e-30), 1.0)


@kernel
def within(known, a, f_v, radius):
    """The largest part, up to 1, of acceleration a (m/s^2, E) whose demand is inside by `radius` (N).

    f_v : `dragging`, N, E.  That of no acceleration has to be inside.
    """
    part = 1.0
    for heavy in (0.0, 1.0):
        m = known.m_min + heavy * (known.m_max - known.m_min)
        hover, d = f_v + Vec3(0.0, 0.0, m * known.g), m * a
        # of the cone: sin T_z - radius against cos |T_xy|
        p_0, p_1 = known.sin * hover.z - radius, known.sin * d.z
        cos2 = known.cos * known.cos
        cone = first_root(
            p_1 * p_1 - cos2 * (d.x * d.x + d.y * d.y),
            p_0 * p_1 - cos2 * (hover.x * d.x + hover.y * d.y),
            maximum(p_0 * p_0 - cos2 * (hover.x * hover.x + hover.y * hover.y), 0.0),
        )
        # of the two spheres
        dd, hd, hh = dot(d, d), dot(hover, d), dot(hover, hover)
        most, least = known.T_top - radius, known.T_min + radius
        above = first_root(-dd, -hd, maximum(most * most - hh, 0.0))
        below = first_root(dd, hd, maximum(hh - least * least, 0.0))
        down = known.T_z_min + radius - hover.z
        floor = select(d.z < minimum(down, -1e-30), down / minimum(d.z, -1e-30), 1.0)
        part = minimum(part, minimum(minimum(cone, floor), minimum(above, below)))
    return part


@kernel
def inside(known, v_m, beta, a, closing):
    """Acceleration a (m/s^2, E) of the reference, or as much as the condition allows of a + closing.

    All of it without a rotor: the reference would go with a vehicle that is driven away.
    v_m : of the reference, m/s, E.  closing : m/s^2, E, what closes the tracking error.
    """
    f_v = margin.dragging(known, v_m)
    at_rest = margin.room(known, Vec3(0.0, 0.0, 0.0), f_v)
    radius = minimum(
        margin.allowance(known, v_m, beta), (1.0 - margin.KEPT) * maximum(at_rest, 0.0)
    )
    holds = (at_rest > 0.0) & (known.promises > 0.5)
    part = select(holds, within(known, a + closing, f_v, radius), 1.0)
    return part * (a + closing) - closing


@kernel
def governed(params, law, known, state, reference, setpoint, r, v, psi, T):
    """The setpoint the reference model is given, its acceleration (m/s^2, E), 1 if it is governed.

    What is kept inside the limits is the acceleration that is demanded of the vehicle, the
    reference's plus what closes the tracking error; the reference gives way.
    """
    f_m, zeta_m = law.f_m, law.zeta_m
    r_m, v_m = reference.r_m, reference.v_m
    plain = a_ref(law, setpoint, r_m, v_m)  # (34)
    if params.policy == 0.0:  # all lanes of a campaign share it
        return setpoint, plain, 0.0
    up = Vec3(state.a_m.x, state.a_m.y, state.a_m.z + law.g)
    if params.policy == 2.0:  # as `admission` looked ahead
        j = wrench.jerk_ahead(params, law, state.a_m.z)
        across = wrench.across_ahead(params, law, state.a_m, j)
        change = plain - state.a_m
        a_g = state.a_m + wrench.turned_to(change, up, j * law.h, across * law.h)
    else:
        j = wrench.jerk(params, law, T)
        most = j * law.h
        change = shortened(wanted(law, known, setpoint, r_m, v_m, j) - state.a_m, most)
        rising = dot(change, up) / (norm(up) * law.h + 1e-30)
        aside = wrench.jerk_across(params, law, T, j, rising) * law.h
        a = state.a_m + wrench.turned_to(change, up, most, aside)
        closing = -2.0 * f_m * zeta_m * (v - v_m) - f_m * f_m * (r - r_m)
        # beta grows with each change of a_m: room for it is made within the jerk, or it feeds itself
        a = inside(known, v_m, margin.left(state), a, closing)
        a = state.a_m + wrench.turned_to(a - state.a_m, up, most, aside)
        a_g = inside(known, v_m, 0.0, a, closing)
    limited = (norm(a_g - plain) > 1e-6) & (setpoint.level < 0.5)
    r_c, v_c, a_c = setpoint.r_c, setpoint.v_c, setpoint.a_c
    r_g = r_m + (a_g - a_c + 2.0 * f_m * zeta_m * (v_m - v_c)) / (f_m * f_m)  # (34) departure 17
    psi_g, psi_g_dot, _ = turned(params, law, state, setpoint, psi, T)
    given = Setpoint(
        r_c=select3(limited, r_g, r_c),
        v_c=v_c,
        a_c=a_c,
        psi_c=psi_g,
        psi_dot_c=psi_g_dot,
        level=setpoint.level,
        tilt_c=setpoint.tilt_c,
        w_c=setpoint.w_c,
        T_c=setpoint.T_c,
    )
    return given, select3(limited, a_g, plain), select(limited, 1.0, 0.0)


@kernel
def turned(params, law, state, setpoint, psi, T):
    """Yaw (rad) and its rate (rad/s) that are commanded, and 1 if they are not the setpoint's.

    Yaw is the weak axis: its command too gets no faster than the rotors' drag can turn.
    """
    h, c, top = law.h, law.c_angle.z, law.yaw_rate_max
    a = wrench.yaw_acceleration(params, law, T)
    psi_g = psi + clip(wrap(state.psi_g - psi), -LEAD, LEAD)
    e = wrap(setpoint.psi_c - psi_g)
    rate = clip(setpoint.psi_dot_c + math.copysign(approach(c, a, abs(e)), e), -top, top)
    rate = clip(rate, state.psi_g_dot - a * h, state.psi_g_dot + a * h)
    off = (abs(e) > 1e-6) | (abs(rate - setpoint.psi_dot_c) > 1e-6)
    limited = off & (params.policy != 0.0) & (setpoint.level < 0.5)
    return (
        select(limited, psi_g, setpoint.psi_c),
        select(limited, rate, setpoint.psi_dot_c),
        select(limited, 1.0, 0.0),
    )
