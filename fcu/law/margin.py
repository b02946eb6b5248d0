"""How far a demand is from the actuators' limits, and whether it stays inside whatever comes.

The actuators reach the forces T (N, E) with T_min <= |T| <= T_max and a tilt below phi*, for
every heading. On a path with acceleration a and velocity v the law demands

    T = m (a + g e3) - f_D + m z

with drag f_D and the control difference m z of (30). Mass and wind are not known; bounds of
them are (Guard). A demand is safe if m (a + g e3) + f_v lies inside by the radius `allowance`:
f_v is the half of the drag that goes with v, the radius all the rest.
"""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3, maximum, minimum, norm
from fcu.kernel.compile import kernel

# L1 norm of the control difference for lambda = sqrt(gamma), a damping ratio of one half:
# its supremum is N_HALF / sqrt(gamma) times that of the disturbance's rate (README).
N_HALF = 1.7131374
PEAK_HALF = 1.1547005  # 1 / sqrt(1 - zeta^2): peak of its response to an initial difference
FORGOTTEN = 0.3  # part of the mass that m_hat may be off by when the reference changes
KEPT = 0.1  # part of the room at a standstill that is never given away


@kernel
def distance(params, T):
    """From a force T (N, E) to the boundary of what the actuators reach; negative outside.

    Exact inside; outside no farther than it says. The set is the one the law keeps to
    (departure 13): tilt within a cone of phi_star, thrust within [T_min, T_max].
    """
    aside = math.sqrt(T.x * T.x + T.y * T.y)
    size = math.sqrt(aside * aside + T.z * T.z)
    cone = T.z * math.sin(params.phi_star) - aside * math.cos(params.phi_star)
    return minimum(cone, minimum(params.T_max - size, size - params.T_min))


@kernel
def tilt_left(params, T):
    """From the tilt of a force to the tilt limit, rad; negative outside."""
    return params.phi_star - math.atan2(math.sqrt(T.x * T.x + T.y * T.y), T.z)


@kernel
def dragging(params, v):
    """The half of the drag (N, E) that goes with velocity v (m/s, E), against it taken positive.

    Drag is -D (v - w) with D = diag(c_i |v_i - w_i|) in some axes, 0 <= D <= c (|v| + w_max):
    D v lies in a ball about this vector, of the same radius.
    """
    guard = params.guard
    return (0.5 * guard.c_D * (norm(v) + guard.w_max)) * v


@kernel
def difference(params, speed):
    """Bound (N) of the control difference m z once its start is forgotten. Paper (30), beta_2.

    speed : m/s.  What drives it is the rate of drag over mass, and what the reference's jerk
    makes of a mass that is not known.
    """
    guard = params.guard
    drag_rate = 2.0 * guard.c_D * (speed + guard.w_max) * (guard.w_dot_max + 0.5 * params.g)
    rate = drag_rate + FORGOTTEN * guard.m_max * guard.jerk
    return N_HALF * rate / math.sqrt(params.gamma)  # (30)


@kernel
def allowance(params, v, beta):
    """Radius (N) of what is not known of the demand at velocity v (m/s, E).

    beta : what is left of the control difference at take-over, N.
    """
    guard = params.guard
    speed = norm(v)
    drag = guard.c_D * (speed + guard.w_max) * (guard.w_max + 0.5 * speed)
    return drag + difference(params, speed) + beta


@kernel
def beta_1(params):
    """Control difference (N) at take-over at most. Paper (30), beta_1.

    Weight that m_hat leaves out, drag that s_v_hat does, and a predictor that starts wrong.
    """
    guard = params.guard
    m_0 = params.m_hat_0
    off = maximum(abs(guard.m_max - m_0), abs(guard.m_min - m_0))
    wrong = guard.m_max * math.sqrt(params.gamma) * norm(params.v_hat_offset)
    return PEAK_HALF * (off * params.g + guard.c_D * guard.w_max * guard.w_max + wrong)  # (30)


@kernel
def faded(params, beta):
    """`beta` (N) a tick later: it decays with nu_1 = lambda/2. Paper (30)."""
    return beta / (1.0 + 0.5 * params.h * params.lambda_v)  # (30)


@kernel
def room(params, a, f_v):
    """Distance (N) of m (a + g e3) + f_v to the limits, of the worse mass.

    a : m/s^2, E.  f_v : `dragging`, N, E.
    """
    guard = params.guard
    up = Vec3(a.x, a.y, a.z + params.g)
    return minimum(
        distance(params, guard.m_min * up + f_v), distance(params, guard.m_max * up + f_v)
    )


@kernel
def condition(params, a, v, beta):
    """By how much (N) the demand of acceleration a at velocity v stays inside, whatever comes.

    The exact set along the reference: what the guard uses. Above zero the demand saturates
    nothing while the beliefs hold.
    """
    return room(params, a, dragging(params, v)) - allowance(params, v, beta)
