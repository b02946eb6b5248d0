"""The adaptive laws: every estimate moves along the prediction error, inside its set.

Projection clips to a box after the step: for a diagonal gain that can only lower the
Lyapunov function while the truth is inside the box (the paper's Pr, in discrete time).
Mass and inertia are estimated as m_hat, J_hat (demanded, as printed) or through
1/m_hat, 1/J_hat (achieved), in which the dynamics are linear.
"""

from __future__ import annotations

from fcu.kernel.algebra import Vec3, clip, clip3, dot, maximum, minimum, select
from fcu.kernel.compile import kernel
from fcu.laws.mmrac.types import Estimates

LIFTS = 0.5  # of the least weight: with less thrust nothing is in the air


@kernel
def achieved(params, estimates, error, past):
    """The Estimates after the tick, of what was achieved in it."""
    m_hat = m_hat_achieved(params, estimates.m_hat, error.v_til, past.T_a)
    J_hat = J_hat_achieved(params, estimates.J_hat, error.w_til, past.tau_a)
    s_v = s_v_hat(params, estimates.s_v_hat, error.v_til)
    m_hat, s_v = leaked(params, m_hat, s_v, past.T_a)
    return with_turning(params, estimates, error, past, s_v, m_hat, J_hat)


@kernel
def demanded(params, estimates, error, past, memory):
    """The same as printed, of what was demanded."""
    m_hat = m_hat_demanded(params, estimates.m_hat, error.v_til, memory.f_c)
    J_hat = J_hat_demanded(params, estimates.J_hat, error.w_til, memory.f_wc)
    s_v = s_v_hat(params, estimates.s_v_hat, error.v_til)
    return with_turning(params, estimates, error, past, s_v, m_hat, J_hat)


@kernel
def with_turning(params, estimates, error, past, s_v, m_hat, J_hat):
    """The Estimates after the tick, of drag (m/s^2, E), mass and inertia after it."""
    e, Omega_m = error.w_til, past.Omega_m
    p, q, r = past.w.x, past.w.y, past.w.z
    return Estimates(
        s_v_hat=s_v,
        m_hat=m_hat,
        s_w_hat=s_w_hat(params, estimates.s_w_hat, e),
        J_hat=J_hat,
        c_p1_hat=c_hat(params, estimates.c_p1_hat, q * r, e.x),
        c_p2_hat=c_hat(params, estimates.c_p2_hat, q * Omega_m, e.x),
        c_q1_hat=c_hat(params, estimates.c_q1_hat, p * r, e.y),
        c_q2_hat=c_hat(params, estimates.c_q2_hat, p * Omega_m, e.y),
        c_r1_hat=c_hat(params, estimates.c_r1_hat, p * q, e.z),
    )


@kernel
def s_v_hat(params, s, e):
    """Drag force over mass (m/s^2, E) after the tick. Paper (38)."""
    limit = params.bounds.s_v_max
    return clip3(s + (params.h * params.gamma) * e, -limit, limit)  # (38) departure 7


@kernel
def leaked(params, m_hat, s, T_a):
    """Mass (kg) and s_v_hat (m/s^2, E) after drag upwards has leaked into the mass for a tick.

    T_a : achieved force, N, E.  Upwards T_a / m_hat + s_v_hat is all that is seen. It stays: of the
    drag goes over what the set of the mass takes.
    """
    bounds = params.bounds
    up, Lambda_hat = maximum(T_a.z, 0.0), 1.0 / m_hat
    rate = params.h * params.sigma_v / maximum(up, LIFTS * bounds.m_min * params.g)
    after = clip(Lambda_hat + rate * s.z, 1.0 / bounds.m_max, 1.0 / bounds.m_min)  # departure 18
    left = s.z - (after - Lambda_hat) * up
    leaks = params.sigma_v > 0.0
    return select(leaks, 1.0 / after, m_hat), Vec3(s.x, s.y, select(leaks, left, s.z))


@kernel
def m_hat_achieved(params, m, e, T_a):
    """Mass (kg) after the tick, through Lambda_hat = 1/m_hat. Paper (10) for Lambda."""
    bounds = params.bounds
    Lambda_hat = 1.0 / m + params.h * params.gamma_Lambda * dot(e, T_a)  # (10)
    return 1.0 / clip(Lambda_hat, 1.0 / bounds.m_max, 1.0 / bounds.m_min)  # departure 7, 11


@kernel
def m_hat_demanded(params, m, e, f_c):
    """Mass (kg) after the tick, as printed: f_c as demanded in it. Paper (38)."""
    bounds = params.bounds
    m_hat = m - params.h * params.gamma_m * dot(e, f_c)  # (38)
    return clip(m_hat, bounds.m_min, bounds.m_max)  # departure 7


@kernel
def s_w_hat(params, s, e):
    """Angular disturbance (rad/s^2, B) after the tick. Paper (45)."""
    limit = params.bounds.s_w_max
    return clip3(s + (params.h * params.gamma) * e, -limit, limit)  # (45) departure 7


@kernel
def J_hat_achieved(params, J, e, tau_a):
    """Inertia (kg m^2, three axes) after the tick, through 1/J_hat. Paper (10) for Lambda."""
    low, high = 1.0 / params.bounds.J_max, 1.0 / params.bounds.J_min
    rate = (params.h * params.gamma_LambdaJ) * (e * tau_a)  # (10) departure 11
    return Vec3(
        1.0 / clip(1.0 / J.x + rate.x, low, high),
        1.0 / clip(1.0 / J.y + rate.y, low, high),
        1.0 / clip(1.0 / J.z + rate.z, low, high),
    )  # departure 7


@kernel
def J_hat_demanded(params, J, e, f_wc):
    """Inertia (kg m^2, three axes) after the tick, as printed; from zero. Paper (45)."""
    J_hat = J - (params.h * params.gamma_J) * (f_wc * e)  # (45)
    return clip3(J_hat, params.bounds.J_min, params.bounds.J_max)  # departure 7


@kernel
def c_hat(params, c, regressor, e):
    """One coupling or gyroscopic coefficient after the tick. Paper (45)."""
    limit = params.bounds.c_max
    return clip(c + params.h * params.gamma_c * regressor * e, -limit, limit)  # (45) departure 7


@kernel
def held(bounds, estimates):
    """1 while an estimate is at the edge of the set that projection keeps it in, else 0."""
    m, J = estimates.m_hat, estimates.J_hat
    p = maximum(abs(estimates.c_p1_hat), abs(estimates.c_p2_hat))
    q = maximum(abs(estimates.c_q1_hat), abs(estimates.c_q2_hat))
    at_edge = (
        (greatest3(estimates.s_v_hat) >= bounds.s_v_max)
        | (greatest3(estimates.s_w_hat) >= bounds.s_w_max)
        | (m <= bounds.m_min * 1.000001)
        | (m >= bounds.m_max * 0.999999)
        | (minimum(minimum(J.x, J.y), J.z) <= bounds.J_min * 1.000001)
        | (greatest3(J) >= bounds.J_max * 0.999999)
        | (greatest3(Vec3(p, q, estimates.c_r1_hat)) >= bounds.c_max)
    )
    return select(at_edge, 1.0, 0.0)


@kernel
def greatest3(a):
    """The largest of the absolute values of a Vec3's components."""
    return maximum(maximum(abs(a.x), abs(a.y)), abs(a.z))
