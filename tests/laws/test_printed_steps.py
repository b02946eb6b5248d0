"""The steps of prediction = "demanded": Section VII to the letter, at a fixed rate."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.kernel.algebra import Vec3
from fcu.laws.mmrac import adaptation, cascade, prediction

J_1 = 0.3245  # kg m^2, true


def vec3(row):
    return Vec3(*np.asarray(row, dtype=float).tolist())


def test_the_printed_velocity_predictor_holds_no_estimate(law, random_state):
    """(36): v_hat after the tick is v_hat + h (a_ref + lambda v_til), whatever s_v_hat is."""
    params, rng = law(prediction="demanded"), np.random.default_rng(36)
    for _ in range(50):
        state = random_state(params, rng)
        v, a_ref = rng.normal(size=3), rng.normal(size=3) * 5.0
        state = state._replace(f_c_prev=vec3(a_ref - np.array(state.s_v_hat)))
        v_til = np.array(prediction.velocity_demanded(params, state, vec3(v)))
        v_hat = np.array(state.v_hat) + params.h * (a_ref + params.lambda_v * v_til)
        np.testing.assert_allclose(v - v_til, v_hat, rtol=0.0, atol=1e-14)


def test_the_printed_rate_step_holds_no_estimate_but_the_plants_reaction(law, random_state):
    """(41) at rest: e = e_minus / (1 + h lambda + h^2 gamma (1 + f^2/J)), J_implicit at least."""
    params, rng = law(prediction="demanded"), np.random.default_rng(41)
    h, still = params.h, Vec3(0.0, 0.0, 0.0)
    for _ in range(50):
        state = random_state(params, rng)
        a, w, J_hat = rng.normal(size=3) * 5.0, rng.normal(size=3), rng.uniform(0.0, 0.5, 3)
        f = a - np.array(state.s_w_hat)
        state = state._replace(f_wc_prev=vec3(f), J_hat=vec3(J_hat))
        w_til = prediction.rates_demanded(params, state, vec3(w), still, 0.0)
        e_minus = w - np.array(state.w_hat) - h * a
        reaction = f**2 / np.maximum(J_hat, params.J_implicit)
        divisor = 1.0 + h * params.lambda_w + h * h * params.gamma * (1.0 + reaction)
        np.testing.assert_allclose(w_til, e_minus / divisor, rtol=1e-13)


def printed_roll_axis(law, hover, implicit):
    """J_1_hat after 3 s of a 1 rad/s square wave of p_c at 1 kHz, printed law, from J_hat = 0.

    implicit : the step of `rates_demanded`; else explicit Euler, estimates along the old error.
    """
    params = law(rate_hz=1000.0, prediction="demanded")
    h, p, p_til, still = params.h, 0.0, 0.0, Vec3(0.0, 0.0, 0.0)
    state = cascade.take_over(params, hover())
    for k in range(3000):
        f = 20.0 * ((1.0 if k % 2000 < 1000 else -1.0) - p) - state.s_w_hat.x
        p_next = p + h * (state.J_hat.x * f) / J_1
        state = state._replace(f_wc_prev=vec3([f, 0.0, 0.0]))
        if implicit:
            e = prediction.rates_demanded(params, state, vec3([p_next, 0.0, 0.0]), still, 0.0)
            p_til = e.x
        else:
            e = vec3([p_til, 0.0, 0.0])
            predicted = state.w_hat.x + h * (f + state.s_w_hat.x + params.lambda_w * p_til)
            p_til = p_next - predicted
        state = state._replace(
            J_hat=adaptation.J_hat_demanded(params, state, e),
            s_w_hat=adaptation.s_w_hat(params, state, e),
            w_hat=vec3([p_next - p_til, 0.0, 0.0]),
        )
        p = p_next
    return state.J_hat.x


def test_the_printed_inertia_is_found_from_zero_and_an_explicit_step_loses_it(law, hover):
    assert printed_roll_axis(law, hover, implicit=True) == pytest.approx(J_1, rel=0.01)
    assert printed_roll_axis(law, hover, implicit=False) == law().bounds.J_max
