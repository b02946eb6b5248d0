"""The steps of prediction = "demanded": Section VII to the letter, at a fixed rate."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.kernel.algebra import Vec3
from fcu.laws.mmrac import adaptation, prediction
from fcu.laws.mmrac import law as mmrac
from fcu.laws.mmrac.prediction import Past

J_1 = 0.3245  # kg m^2, true
STILL = Past(*[Vec3(0.0, 0.0, 0.0)] * 4, 0.0)._replace(T_mean=0.0)


def vec3(row):
    return Vec3(*np.asarray(row, dtype=float).tolist())


def test_the_printed_velocity_predictor_holds_no_estimate(law, random_state):
    """(36): v_hat after the tick is v_hat + h (a_ref + lambda v_til), whatever s_v_hat is."""
    params, rng = law(prediction="demanded"), np.random.default_rng(36)
    for _ in range(50):
        _, predictor, estimates, _ = random_state(params, rng)
        v, a_ref = rng.normal(size=3), rng.normal(size=3) * 5.0
        f_c = vec3(a_ref - np.array(estimates.s_v_hat))
        v_til = np.array(prediction.velocity_demanded(params, predictor, estimates, vec3(v), f_c))
        v_hat = np.array(predictor.v_hat) + params.h * (a_ref + params.lambda_v * v_til)
        np.testing.assert_allclose(v - v_til, v_hat, rtol=0.0, atol=1e-14)


def test_the_printed_rate_step_holds_no_estimate_but_the_plants_reaction(law, random_state):
    """(41) at rest: e = e_minus / (1 + h lambda + h^2 gamma (1 + f^2/J)), J_implicit at least."""
    params, rng = law(prediction="demanded"), np.random.default_rng(41)
    h = params.h
    for _ in range(50):
        _, predictor, estimates, _ = random_state(params, rng)
        a, w, J_hat = rng.normal(size=3) * 5.0, rng.normal(size=3), rng.uniform(0.0, 0.5, 3)
        f = a - np.array(estimates.s_w_hat)
        estimates = estimates._replace(J_hat=vec3(J_hat))
        w_til = prediction.rates_demanded(params, predictor, estimates, vec3(w), STILL, vec3(f))
        e_minus = w - np.array(predictor.w_hat) - h * a
        reaction = f**2 / np.maximum(J_hat, params.J_implicit)
        divisor = 1.0 + h * params.lambda_w + h * h * params.gamma * (1.0 + reaction)
        np.testing.assert_allclose(w_til, e_minus / divisor, rtol=1e-13)


def printed_roll_axis(law, hover, implicit):
    """J_1_hat after 3 s of a 1 rad/s square wave of p_c at 1 kHz, printed law, from J_hat = 0.

    implicit : the step of `rates_demanded`; else explicit Euler, estimates along the old error.
    """
    params = law(rate_hz=1000.0, prediction="demanded")
    h, p, p_til = params.h, 0.0, 0.0
    _, predictor, estimates, _ = mmrac.beginning(params, hover())
    for k in range(3000):
        f = 20.0 * ((1.0 if k % 2000 < 1000 else -1.0) - p) - estimates.s_w_hat.x
        p_next = p + h * (estimates.J_hat.x * f) / J_1
        f_wc, w = vec3([f, 0.0, 0.0]), vec3([p_next, 0.0, 0.0])
        if implicit:
            e = prediction.rates_demanded(params, predictor, estimates, w, STILL, f_wc)
            p_til = e.x
        else:
            e = vec3([p_til, 0.0, 0.0])
            predicted = predictor.w_hat.x + h * (f + estimates.s_w_hat.x + params.lambda_w * p_til)
            p_til = p_next - predicted
        estimates = estimates._replace(
            J_hat=adaptation.J_hat_demanded(params, estimates.J_hat, e, f_wc),
            s_w_hat=adaptation.s_w_hat(params, estimates.s_w_hat, e),
        )
        predictor = predictor._replace(w_hat=vec3([p_next - p_til, 0.0, 0.0]))
        p = p_next
    return estimates.J_hat.x


@pytest.mark.computes
def test_the_printed_inertia_is_found_from_zero_and_an_explicit_step_loses_it(law, hover):
    assert printed_roll_axis(law, hover, implicit=True) == pytest.approx(J_1, rel=0.01)
    assert printed_roll_axis(law, hover, implicit=False) == law().bounds.J_max
