"""The adaptive laws: every estimate moves along the prediction error, inside its set.

Projection clips to a box after the step: for a diagonal gain that can only lower the
Lyapunov function while the truth is inside the box (the paper's Pr, in discrete time).
Mass and inertia are estimated as m_hat, J_hat (demanded, as printed) or through
1/m_hat, 1/J_hat (achieved), in which the dynamics are linear.
"""

from __future__ import annotations

from fcu.kernel.algebra import Vec3, clip, clip3, dot, maximum, minimum, select
from fcu.kernel.compile import kernel


@kernel
def s_v_hat(params, state, e):
    """Drag force over mass (m/s^2, E) after the tick. Paper (38)."""
    limit = params.bounds.s_v_max
    return clip3(state.s_v_hat + (params.h * params.gamma) * e, -limit, limit)  # (38) departure 7


@kernel
def m_hat_achieved(params, state, e, T_a):
    """Mass (kg) after the tick, through Lambda_hat = 1/m_hat. Paper (10) for Lambda."""
    bounds = params.bounds
    Lambda_hat = 1.0 / state.m_hat + params.h * params.gamma_Lambda * dot(e, T_a)  # (10)
    return 1.0 / clip(Lambda_hat, 1.0 / bounds.m_max, 1.0 / bounds.m_min)  # departure 7, 11


@kernel
def m_hat_demanded(params, state, e):
    """Mass (kg) after the tick, as printed. Paper (38)."""
    bounds = params.bounds
    m_hat = state.m_hat - params.h * params.gamma_m * dot(e, state.f_c_prev)  # (38)
    return clip(m_hat, bounds.m_min, bounds.m_max)  # departure 7


@kernel
def s_w_hat(params, state, e):
    """Angular disturbance (rad/s^2, B) after the tick. Paper (45)."""
    limit = params.bounds.s_w_max
    return clip3(state.s_w_hat + (params.h * params.gamma) * e, -limit, limit)  # (45) departure 7


@kernel
def J_hat_achieved(params, state, e, tau_a):
    """Inertia (kg m^2, three axes) after the tick, through 1/J_hat. Paper (10) for Lambda."""
    low, high = 1.0 / params.bounds.J_max, 1.0 / params.bounds.J_min
    J = state.J_hat
    rate = (params.h * params.gamma_LambdaJ) * (e * tau_a)  # (10) departure 11
    return Vec3(
        1.0 / clip(1.0 / J.x + rate.x, low, high),
        1.0 / clip(1.0 / J.y + rate.y, low, high),
        1.0 / clip(1.0 / J.z + rate.z, low, high),
    )  # departure 7


@kernel
def J_hat_demanded(params, state, e):
    """Inertia (kg m^2, three axes) after the tick, as printed; from zero. Paper (45)."""
    J_hat = state.J_hat - (params.h * params.gamma_J) * (state.f_wc_prev * e)  # (45)
    return clip3(J_hat, params.bounds.J_min, params.bounds.J_max)  # departure 7


@kernel
def c_hat(params, c, regressor, e):
    """One coupling or gyroscopic coefficient after the tick. Paper (45)."""
    limit = params.bounds.c_max
    return clip(c + params.h * params.gamma_c * regressor * e, -limit, limit)  # (45) departure 7


@kernel
def held(params, state):
    """1 while an estimate is at the edge of the set that projection keeps it in, else 0."""
    bounds, m, J = params.bounds, state.m_hat, state.J_hat
    p = maximum(abs(state.c_p1_hat), abs(state.c_p2_hat))
    q = maximum(abs(state.c_q1_hat), abs(state.c_q2_hat))
    at_edge = (
        (greatest3(state.s_v_hat) >= bounds.s_v_max)
        | (greatest3(state.s_w_hat) >= bounds.s_w_max)
        | (m <= bounds.m_min * 1.000001)
        | (m >= bounds.m_max * 0.999999)
        | (minimum(minimum(J.x, J.y), J.z) <= bounds.J_min * 1.000001)
        | (greatest3(J) >= bounds.J_max * 0.999999)
        | (greatest3(Vec3(p, q, state.c_r1_hat)) >= bounds.c_max)
    )
    return select(at_edge, 1.0, 0.0)


@kernel
def greatest3(a):
    """The largest of the absolute values of a Vec3's components."""
    return maximum(maximum(abs(a.x), abs(a.y)), abs(a.z))
