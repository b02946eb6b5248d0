"""Predictors and estimates: the closed form, the Lyapunov function, the sets of projection."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import columns, to_buffer
from fcu.laws.mmrac import adaptation, cascade, prediction
from fcu.laws.mmrac.types import Tick

G_E = np.array([0.0, 0.0, -9.81])


def vec3(row):
    return Vec3(*np.asarray(row, dtype=float).tolist())


@pytest.mark.parametrize("rate_hz", [100.0, 250.0, 500.0, 1000.0])
@pytest.mark.parametrize("gamma", [10.0, 1e3, 1e5])
def test_the_velocity_step_is_the_solution_of_seven_linear_equations(
    law, random_state, rate_hz, gamma
):
    """Unknowns after the tick: v_til, s_v_hat, 1/m_hat, each equation with the others implicit."""
    params, rng = law(rate_hz=rate_hz, gamma=gamma), np.random.default_rng(7)
    h = params.h
    for _ in range(20):
        state = random_state(params, rng)
        v, T_a = rng.normal(size=3), rng.normal(size=3) * 30.0 + (0.0, 0.0, 78.0)
        A, b = np.eye(7), np.zeros(7)
        A[:3, :3] *= 1.0 + h * params.lambda_v
        A[:3, 3:6] = h * np.eye(3)
        A[:3, 6] = h * T_a
        b[:3] = v - state.v_hat - h * G_E
        A[3:6, :3] = -h * params.gamma * np.eye(3)
        b[3:6] = state.s_v_hat
        A[6, :3] = -h * params.gamma_Lambda * T_a
        b[6] = 1.0 / state.m_hat
        solution = np.linalg.solve(A, b)

        v_til = prediction.velocity_achieved(params, state, vec3(v), vec3(T_a))
        scale = np.linalg.norm(solution)
        np.testing.assert_allclose(v_til, solution[:3], rtol=0.0, atol=1e-12 * scale)
        if np.all(np.abs(solution[3:6]) < params.bounds.s_v_max):
            s_v_hat = adaptation.s_v_hat(params, state, v_til)
            np.testing.assert_allclose(s_v_hat, solution[3:6], rtol=0.0, atol=1e-12 * scale)
        if 1.0 / params.bounds.m_max < solution[6] < 1.0 / params.bounds.m_min:
            m_hat = adaptation.m_hat_achieved(params, state, v_til, vec3(T_a))
            assert 1.0 / m_hat == pytest.approx(solution[6], rel=0.0, abs=1e-12 * scale)


@pytest.mark.parametrize("rate_hz", [100.0, 250.0, 500.0, 1000.0])
@pytest.mark.parametrize("gamma", [10.0, 1e3, 1e5])
def test_a_rate_step_is_the_solution_of_five_linear_equations(law, random_state, rate_hz, gamma):
    """Unknowns of the roll axis after the tick: p_til, s_p_hat, c_p1_hat, c_p2_hat, 1/J_1_hat."""
    params, rng = law(rate_hz=rate_hz, gamma=gamma), np.random.default_rng(5)
    h = params.h
    for _ in range(20):
        state = random_state(params, rng)
        w, w_mean, tau_a = (rng.normal(size=3) for _ in range(3))
        Omega_m = float(rng.normal() * 50.0)
        _, q, r = w_mean
        phi = np.array([1.0, q * r, q * Omega_m, tau_a[0]])
        gains = np.array([params.gamma, params.gamma_c, params.gamma_c, params.gamma_LambdaJ])
        old = [state.s_w_hat.x, state.c_p1_hat, state.c_p2_hat, 1.0 / state.J_hat.x]
        A, b = np.eye(5), np.array([w[0] - state.w_hat.x, *old])
        A[0, 0] += h * params.lambda_w
        A[0, 1:] = h * phi
        A[1:, 0] = -h * gains * phi
        solution = np.linalg.solve(A, b)

        w_til = prediction.rates_achieved(
            params, state, vec3(w), vec3(w_mean), Omega_m, vec3(tau_a)
        )
        estimates = [
            adaptation.s_w_hat(params, state, w_til).x,
            adaptation.c_hat(params, state.c_p1_hat, float(q * r), w_til.x),
            adaptation.c_hat(params, state.c_p2_hat, float(q * Omega_m), w_til.x),
            1.0 / adaptation.J_hat_achieved(params, state, w_til, vec3(tau_a)).x,
        ]
        scale = np.linalg.norm(solution)
        assert w_til.x == pytest.approx(solution[0], rel=0.0, abs=1e-12 * scale)
        b_ = params.bounds
        lowest = np.array([-b_.s_w_max, -b_.c_max, -b_.c_max, 1.0 / b_.J_max])
        highest = np.array([b_.s_w_max, b_.c_max, b_.c_max, 1.0 / b_.J_min])
        projected = np.clip(solution[1:], lowest, highest)
        np.testing.assert_allclose(estimates, projected, rtol=0.0, atol=1e-12 * scale)


M, J, J_M = 8.0, np.array([0.3245, 0.3245, 0.4616]), 2e-4
S_V, S_W = np.array([2.0, -1.5, 1.0]), np.array([3.0, -2.0, 1.0])
C = {
    "c_p1_hat": (J[1] - J[2]) / J[0],
    "c_p2_hat": -J_M / J[0],
    "c_q1_hat": (J[2] - J[0]) / J[1],
    "c_q2_hat": J_M / J[1],
    "c_r1_hat": (J[0] - J[1]) / J[2],
}


def matching_plant(params, rng, n):
    """n measurements (float64[n, 21]) of a plant that is the predictor with the true constants.

    v+ = v + h (T/m + s + g) and the same for each rate, with constant m, J, s. Attitude and
    rotor speeds jump at random, so that the regressors point everywhere.
    """
    h, x, y = params.h, np.array(params.x), np.array(params.y)
    spin = np.array(params.spin)
    attitudes = Rotation.from_rotvec(rng.normal(size=(n, 3)) * 0.4)
    Omega = np.sqrt(M * 9.81 / 8.0 / params.c_T) * rng.uniform(0.8, 1.2, (n, 8))
    v, w = np.zeros((n, 3)), np.zeros((n, 3))
    e3 = attitudes.as_matrix()[:, :, 2]
    for k in range(1, n):
        f = params.c_T * Omega[k] ** 2  # without lag, the speed of this tick's end held through it
        T_a = 0.5 * f.sum() * (e3[k - 1] + e3[k])
        tau_a = np.array([y @ f, -x @ f, -params.k_Q * (spin @ f)])
        v[k] = v[k - 1] + h * (T_a / M + S_V + G_E)
        Omega_m = spin @ Omega[k]
        w[k] = w[k - 1]
        for _ in range(60):  # the regressor is the mean rate over the tick: solved by iteration
            p, q, r = 0.5 * (w[k - 1] + w[k])
            known = (
                C["c_p1_hat"] * q * r + C["c_p2_hat"] * q * Omega_m,
                C["c_q1_hat"] * p * r + C["c_q2_hat"] * p * Omega_m,
                C["c_r1_hat"] * p * q,
            )
            w[k] = w[k - 1] + h * (np.array(known) + S_W + tau_a / J)
    return np.hstack([np.zeros((n, 3)), v, attitudes.as_quat(scalar_first=True), w, Omega])


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 500.0, 1000.0])
@pytest.mark.parametrize("gamma", [1e2, 1e3, 1e5])
def test_the_lyapunov_functions_do_not_grow(law, fixed, ticks, rate_hz, gamma):
    """V = |v_til|^2 + |s_til|^2/gamma + Lambda_til^2/gamma_Lambda, and its like for the rates."""
    params = law(rate_hz=rate_hz, gamma=gamma, rotor_lag_s=0.0)
    law_ticks, setpoint = ticks(params), to_buffer(fixed())
    V = []
    for measured in matching_plant(params, np.random.default_rng(38), 300):
        law_ticks.tick(measured, setpoint)
        state, shown = law_ticks.shown["state"], law_ticks.shown["internals"]
        v_til, w_til = three(shown["v_til"]), three(shown["w_til"])
        s_v_til, s_w_til = S_V - three(state["s_v_hat"]), S_W - three(state["s_w_hat"])
        Lambda_til = 1.0 / M - 1.0 / state["m_hat"]
        LambdaJ_til = 1.0 / J - 1.0 / three(state["J_hat"])
        c_til = np.array([true - state[name] for name, true in C.items()])
        V_v = v_til @ v_til + s_v_til @ s_v_til / gamma + Lambda_til**2 / params.gamma_Lambda
        V_w = w_til @ w_til + s_w_til @ s_w_til / gamma + c_til @ c_til / params.gamma_c
        V.append((V_v, V_w + LambdaJ_til @ LambdaJ_til / params.gamma_LambdaJ))
    V = np.array(V)
    growth = np.diff(V, axis=0) / V[0]
    assert growth.max() < 1e-12
    assert np.all(V[-1] < 0.9 * V[0])


def three(record):
    return np.array(record.tolist())


@pytest.mark.parametrize("rate_hz", [250.0, 1000.0])
def test_with_the_truth_estimated_the_prediction_is_exact(law, fixed, ticks, rate_hz):
    """Every mean over a tick is the plant's own, so no error arises to move an estimate."""
    params = law(rate_hz=rate_hz, rotor_lag_s=0.0)
    law_ticks, setpoint = ticks(params), to_buffer(fixed())
    plant = matching_plant(params, np.random.default_rng(41), 300)
    law_ticks.tick(plant[0], setpoint)
    for name, true in {"m_hat": M, "s_v_hat": S_V, "s_w_hat": S_W, "J_hat": J, **C}.items():
        law_ticks.remembered[name] = tuple(true) if np.ndim(true) else true
    for measured in plant[1:]:
        law_ticks.tick(measured, setpoint)
        shown = law_ticks.shown["internals"]
        np.testing.assert_allclose(three(shown["v_til"]), 0.0, atol=1e-13)
        np.testing.assert_allclose(three(shown["w_til"]), 0.0, atol=1e-12)


@pytest.mark.parametrize("prediction_form", ["achieved", "demanded"])
def test_more_acceleration_than_predicted_means_less_mass_and_inertia(law, hover, prediction_form):
    params = law(prediction=prediction_form, rotor_lag_s=0.0)
    state = cascade.take_over(params, hover())._replace(
        m_hat=8.0, J_hat=Vec3(0.4, 0.4, 0.4), f_c_prev=Vec3(0.0, 0.0, 9.81),
        f_wc_prev=Vec3(2.0, 2.0, 2.0),
    )  # fmt: skip
    faster = hover(v=(0.0, 0.0, 0.5), w=(0.5, 0.5, 0.5))
    rolling = 0.02 * np.array(params.y) - 0.02 * np.array(params.x) - 0.05 * np.array(params.spin)
    Omega = np.array(faster.Omega) * (1.0 + rolling)  # torque about all three axes
    after, v_til, w_til = cascade.adapt(
        state, params, faster._replace(Omega=type(faster.Omega)(*Omega.tolist()))
    )
    assert v_til.z > 0.0
    assert min(w_til) > 0.0
    assert after.m_hat < 8.0
    assert max(after.J_hat) < 0.4


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(0.01, 100.0))
@pytest.mark.parametrize("prediction_form", ["achieved", "demanded"])
def test_projection_keeps_every_estimate_in_its_set(
    law, hover, fixed, ticks, prediction_form, seed, size
):
    """Whatever is measured, jumping at random from tick to tick: 16 000 ticks in all."""
    params = law(prediction=prediction_form)
    law_ticks, rng, n = ticks(params), np.random.default_rng(seed), 1000
    measured = size * rng.normal(size=(n, 21))
    measured[:, 6:10] = Rotation.random(n, rng=rng).as_quat(scalar_first=True)
    measured[:, 13:] = rng.uniform(0.0, params.Omega_max, (n, 8))
    setpoint = to_buffer(fixed(size * rng.normal(size=3)))
    rows = np.empty((n, len(law_ticks.row)))
    for k in range(n):
        law_ticks.tick(measured[k], setpoint)
        rows[k] = law_ticks.row
    assert np.all(np.isfinite(rows))

    column, b = {name: rows[:, i] for i, name in enumerate(columns(Tick))}, params.bounds
    roundoff = 1e-12
    assert column["state.m_hat"].min() >= b.m_min - roundoff
    assert column["state.m_hat"].max() <= b.m_max + roundoff
    for name in ("s_v_hat", "s_w_hat", "J_hat"):
        three = np.stack([column[f"state.{name}.{axis}"] for axis in "xyz"])
        if name == "J_hat":
            assert three.min() >= b.J_min - roundoff
            assert three.max() <= b.J_max + roundoff
        else:
            assert np.abs(three).max() <= (b.s_v_max if name == "s_v_hat" else b.s_w_max)
    for name in ("c_p1_hat", "c_p2_hat", "c_q1_hat", "c_q2_hat", "c_r1_hat"):
        assert np.abs(column[f"state.{name}"]).max() <= b.c_max
    u = np.stack([column[f"command.u.r{i}"] for i in range(1, 9)])
    assert u.min() >= 0.0
    assert u.max() <= 1.0


def test_projection_is_shown_while_it_holds_an_estimate(law, hover, fixed, ticks):
    law_ticks = ticks(law())
    far = hover()._replace(v_E=Vec3(1e4, 0.0, 0.0))
    law_ticks.tick(to_buffer(hover()), to_buffer(fixed()))
    assert law_ticks.shown["internals"]["projected"] == 0.0
    law_ticks.tick(to_buffer(far), to_buffer(fixed()))
    assert law_ticks.shown["internals"]["projected"] == 1.0
    assert law_ticks.shown["state"]["s_v_hat"]["x"] == 30.0


def test_every_edge_of_every_set_is_shown(law, hover):
    params = law()
    inside, b = cascade.take_over(params, hover()), params.bounds
    assert adaptation.held(params, inside) == 0.0
    edges = {
        "m_hat": (b.m_min, b.m_max),
        "s_v_hat": (Vec3(0.0, -b.s_v_max, 0.0), Vec3(0.0, 0.0, b.s_v_max)),
        "s_w_hat": (Vec3(0.0, -b.s_w_max, 0.0), Vec3(0.0, 0.0, b.s_w_max)),
        "J_hat": (Vec3(0.1, b.J_min, 0.1), Vec3(0.1, 0.1, b.J_max)),
    }
    edges |= {c: (-b.c_max, b.c_max) for c in ("c_p1_hat", "c_p2_hat", "c_q1_hat", "c_q2_hat")}
    edges["c_r1_hat"] = (-b.c_max, b.c_max)
    for name, values in edges.items():
        for value in values:
            assert adaptation.held(params, inside._replace(**{name: value})) == 1.0, name


def test_the_printed_inertia_keeps_to_its_lower_bound(law, hover):
    params = law(prediction="demanded", bounds={"J_min": 0.05})
    state = cascade.take_over(params, hover())._replace(f_wc_prev=Vec3(1.0, 1.0, 1.0))
    assert adaptation.J_hat_demanded(params, state, Vec3(9.0, 9.0, 9.0)) == (0.05, 0.05, 0.05)
