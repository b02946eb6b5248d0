"""What a way will ask of the actuators, from what is demanded now. Not in the paper.

The demand of the moment holds weight and drag of the moment already, known without error. What
follows differs from it by what the way adds and by what the air may do in the meantime: at first
less than all that the air could ever do, which is what the prior condition (`foreseen`) allows for.
README.md, "From the present demand".
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fcu.guard import margin, wrench
from fcu.guard.foreseen import closing, fading
from fcu.guard.margin import Doubted
from fcu.kernel.algebra import Vec3, clip, dot, maximum, minimum, norm, select
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import euler, matrix, wrap
from fcu.laws.mmrac import position

# How fast drag turns with the body axes that it acts along, over its greatest: the supremum of
# |d f/d phi| / (c u^2) of quadratic drag along three axes, coefficients from 0 to c.
TURNS = 2.0 / math.sqrt(3.0)
LEVEL = 0.1  # m/s^2: what descends slower is taken as level


class Present(NamedTuple):
    """The vehicle under its law, at the moment a way is looked along; with `told` 0, not known."""

    T_0: Vec3  # demanded force before anything limits it, N, E
    a_d: Vec3  # acceleration that it is to give, by the estimates, m/s^2, E
    r: Vec3  # where the vehicle is at the next tick, as its reference model is, m, E
    v: Vec3  # its velocity, m/s, E
    up: Vec3  # its thrust axis, E
    psi: float  # its yaw, rad
    unturned: float  # control difference left of the reference's changes, N, as of GuardState
    unflown: float
    beta: float  # and of take-over
    told: float  # 1 if all this is known


class Beginning(NamedTuple):
    """Where a look along a way begins: of the reference model, and of the vehicle."""

    r_m: Vec3  # m, E
    v_m: Vec3  # m/s, E
    a_m: Vec3  # m/s^2, E
    present: Present


class Since(NamedTuple):
    """What has come since, at a point of a way."""

    t: float  # s
    e: Vec3  # tracking error that there was, as it dies out, m, E
    e_dot: Vec3  # m/s, E
    a_d: Vec3  # acceleration demanded at the last step, m/s^2, E
    changed: Doubted  # m/s^2, E, of changes of it
    gain: float  # L1 norm of `foreseen.closed`, up to now
    x: float  # its response to an impulse of z: position (s), and velocity
    x_dot: float
    left: Doubted  # N, of what the Present has


@kernel
def seen(law, law_state, guard_state, measured):
    """The Present after a tick.

    law : Params.  law_state, guard_state : after the tick.  measured : VehicleState that it saw.
    `told` is 0 before the law has flown a tick, and while it flies no position.
    """
    estimates, f_c = law_state.estimates, law_state.memory.f_c
    return Present(
        T_0=estimates.m_hat * f_c,
        a_d=position.a_d(law, f_c, estimates.s_v_hat),
        r=measured.r_E + law.h * measured.v_E,
        v=measured.v_E,
        up=law_state.memory.e3,
        psi=euler(matrix(measured.q_EB)).z,
        unturned=guard_state.unturned,
        unflown=guard_state.unflown,
        beta=guard_state.beta,
        told=select(f_c.z > 0.0, law.achieved, 0.0),
    )


@kernel
def beginning(law, law_state, guard_state, measured):
    """The Beginning after a tick; arguments as of `seen`."""
    reference = law_state.reference
    return Beginning(
        r_m=reference.r_m,
        v_m=reference.v_m,
        a_m=guard_state.a_m,
        present=seen(law, law_state, guard_state, measured),
    )


@kernel
def begun(law, present, r_m, a_m):
    """The Since of a way that begins where the reference is at r_m (m, E), with a_m (m/s^2, E).

    a_d = a_m - 2 zeta f e' - f^2 e: with e and a_d known, so is e'.
    """
    zero = Vec3(0.0, 0.0, 0.0)
    e, damping = present.r - r_m, 2.0 * law.f_m * law.zeta_m
    e_dot = (a_m - present.a_d - (law.f_m * law.f_m) * e) / damping
    return Since(
        t=0.0, e=e, e_dot=e_dot, a_d=present.a_d,
        changed=Doubted(unturned=zero, unflown=zero, beta=zero),
        gain=0.0, x=0.0, x_dot=1.0,
        left=Doubted(unturned=present.unturned, unflown=present.unflown, beta=present.beta),
    )  # fmt: skip


@kernel
def gone_on(law, since, a_m):
    """The Since a step later, where the reference accelerates with a_m (m/s^2, E)."""
    h = law.h
    a_d = a_m + closing(law, since.e, since.e_dot)
    e_dot = since.e_dot + h * closing(law, since.e, since.e_dot)
    x_dot = since.x_dot + h * closing(law, since.x, since.x_dot)
    return Since(
        t=since.t + h,
        e=since.e + h * e_dot,
        e_dot=e_dot,
        a_d=a_d,
        changed=margin.changed(fading(law, since.changed, 1.0, 1.0), a_d - since.a_d),
        gain=since.gain + h * abs(closing(law, since.x, since.x_dot)),
        x=since.x + h * x_dot,
        x_dot=x_dot,
        left=fading(law, since.left, 1.0 - margin.FORGOTTEN, margin.PEAK),
    )


@kernel
def least(known, bounds, since, more, per_kg, fixed, radius):
    """Least distance (N) of m per_kg + fixed to the limits, less a radius (N), of all masses.

    And of all m_hat that the law may have (Bounds): what is not flown, or not learnt yet, of the changes
    of the demand is made with it.
    """
    worst, changed = math.inf, more * margin.left(since.changed)
    for heavy in (0.0, 1.0):
        m = known.m_min + heavy * (known.m_max - known.m_min)
        T = m * per_kg + fixed
        below = T + (bounds.m_min - m) * changed
        above = T + (bounds.m_max - m) * changed
        top = known.T_top - maximum(norm(below), norm(above))
        inside = minimum(margin.distance(known, below), margin.distance(known, above))
        worst = minimum(worst, minimum(inside, top))
    return worst - radius


@kernel
def drift(known, present, drag, dv, blown, v, turn):
    """Ball (centre and radius, N, E) that the change of what drag takes lies in since the present.

    drag : N, at most, now.  dv : m/s, E, change of velocity, to v.  blown : m/s, change of the wind at
    most.  turn : rad, change of attitude at most.  Along each body axis sqrt(|f|/c) changes no faster
    than the air does past the vehicle, whatever its coefficient: g du with 0 <= g <= G is all that comes.
    """
    was, fast = norm(present.v) + known.w_max, norm(v) + known.w_max
    air = minimum(math.sqrt(drag / known.c_D), was)
    G = known.c_D * (air + minimum(air + norm(dv) + blown, fast))
    turned = known.c_D * (was * was) * minimum(TURNS * turn, 1.0)
    return (0.5 * G) * dv, G * (0.5 * norm(dv) + blown) + turned


@kernel
def common(p_kg, p, R, q_kg, q, S, light, heavy):
    """Ball that holds what two balls have in common: m c_kg + c, radius, for masses light to heavy.

    About m p_kg + p with radius R, and m q_kg + q with S.  For any part from 0 to 1 a point in both
    is within sqrt(part R^2 + (1 - part) S^2 - part (1 - part) D^2) of the mean of their centres, D
    apart: that of the least such radius, with the mass for which D is least.
    """
    n_kg, n = p_kg - q_kg, p - q
    m = clip(-dot(n_kg, n) / maximum(dot(n_kg, n_kg), 1e-9), light, heavy)
    apart = m * n_kg + n
    D2 = dot(apart, apart)
    part = clip(0.5 + 0.5 * (S * S - R * R) / maximum(D2, 1e-9), 0.0, 1.0)
    inner2 = part * (R * R) + (1.0 - part) * (S * S) - part * (1.0 - part) * D2
    return (
        part * p_kg + (1.0 - part) * q_kg,
        part * p + (1.0 - part) * q,
        math.sqrt(maximum(inner2, 0.0)),
    )


@kernel
def turns(params, law, present, since, change):
    """Whether the rotors turn the demand as fast as the way does, by what is demanded now.

    change : of the reference's acceleration in this step, m/s^2, E.  With the thrust that a descent leaves of the least that
    `wrench.jerk_ahead` counts on, or of that of now, if that is less.
    """
    a, g = since.a_d, law.g
    down = minimum(a.z + LEVEL, 0.0)
    light = params.m_min * (g + down) - wrench.lifted(params)
    now = present.T_0.z + params.m_min * minimum(a.z - present.a_d.z + LEVEL, 0.0)
    n = Vec3(a.x, a.y, a.z + g)
    across = change - (dot(change, n) / maximum(dot(n, n), 1e-9)) * n
    T = maximum(minimum(light, now), 0.0)
    return norm(across) <= 1.001 * law.h * wrench.jerk(params, law, T)


@kernel
def condition(params, law, known, present, since, v, psi_c, more, adds):
    """By how much (N) the demand at a point of a way stays inside, from the present demand.

    v : of the vehicle there without the tracking error there was, m/s, E.  psi_c : rad, yaw that is
    asked for.  more : `hurry`.  adds : `closed`.  The demand lies in the ball that the beliefs leave,
    and in the one that the air may have left since, so in what both have in common: the largest of the
    three margins holds.
    """
    g, v_t = Vec3(0.0, 0.0, known.g), v + since.e_dot
    lasting = margin.difference(known, norm(v_t))
    forced = minimum(since.gain * margin.SETTLES / margin.LASTS, adds) * lasting

    # what is believed, whatever the air does
    p_kg, p = more * since.a_d + g, margin.dragging(known, v_t)
    left = margin.left(since.left)
    R = margin.allowance(known, v_t, left) + forced

    # from now: the drag there is, of the mass for which it is greatest, and what becomes of it
    before = margin.difference(known, norm(present.v)) + margin.left(present)
    hover = present.a_d + g
    light = norm(present.T_0 - known.m_min * hover)
    heavy = norm(present.T_0 - known.m_max * hover)
    drag, dv = maximum(light, heavy) + before, v_t - present.v
    blown = minimum(params.w_dot_max * since.t, 2.0 * known.w_max)
    q_kg = more * (since.a_d - present.a_d)
    centre, radius = drift(known, present, drag, dv, blown, v_t, 0.0)
    q = present.T_0 + centre
    S = radius + before + lasting + left + forced
    middle = 0.5 * (known.m_min + known.m_max) * q_kg + q
    cosine = dot(middle, present.up) / maximum(norm(middle), 1e-9)
    tilted = math.acos(clip(cosine, -1.0, 1.0)) + math.atan2(S, norm(middle))
    turn = tilted + abs(wrap(psi_c - present.psi))
    _, turning = drift(known, present, drag, dv, blown, v_t, turn)
    S += turning - radius

    c_kg, c, both = common(p_kg, p, R, q_kg, q, S, known.m_min, known.m_max)
    inside = maximum(
        maximum(
            least(known, law.bounds, since, more, p_kg, p, R),
            least(known, law.bounds, since, more, q_kg, q, S),
        ),
        least(known, law.bounds, since, more, c_kg, c, both),
    )
    return minimum(inside, margin.steering(known, v_t))
