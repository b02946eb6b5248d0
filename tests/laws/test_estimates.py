"""Predictors and estimates: the closed form, the Lyapunov function, the sets of projection."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import columns, to_buffer
from fcu.laws.mmrac import adaptation, prediction
from fcu.laws.mmrac import law as mmrac
from fcu.laws.mmrac.prediction import Past
from fcu.laws.mmrac.types import PredictionError
from fcu.process.tick import Tick
from tests.laws.values import with_fields

G_E = np.array([0.0, 0.0, -9.81])


def vec3(row):
    return Vec3(*np.asarray(row, dtype=float).tolist())


@pytest.mark.parametrize("rate_hz", [100.0, 250.0, 500.0, 1000.0])
@pytest.mark.parametrize("gamma", [10.0, 1e3, 1e5])
@pytest.mark.computes
def test_the_velocity_step_is_the_solution_of_seven_linear_equations(
    law, random_state, rate_hz, gamma
):
    """Unknowns after the tick: v_til, s_v_hat, 1/m_hat, each equation with the others implicit."""
    params, rng = law(rate_hz=rate_hz, gamma=gamma), np.random.default_rng(7)
    h = params.h
    for _ in range(20):
        _, predictor, old, _ = random_state(params, rng)
        v, T_a = rng.normal(size=3), rng.normal(size=3) * 30.0 + (0.0, 0.0, 78.0)
        A, b = np.eye(7), np.zeros(7)
        A[:3, :3] *= 1.0 + h * params.lambda_v
        A[:3, 3:6] = h * np.eye(3)
        A[:3, 6] = h * T_a
        b[:3] = v - predictor.v_hat - h * G_E
        A[3:6, :3] = -h * params.gamma * np.eye(3)
        b[3:6] = old.s_v_hat
        A[6, :3] = -h * params.gamma_Lambda * T_a
        b[6] = 1.0 / old.m_hat
        solution = np.linalg.solve(A, b)

        v_til = prediction.velocity_achieved(params, predictor, old, vec3(v), vec3(T_a))
        scale = np.linalg.norm(solution)
        np.testing.assert_allclose(v_til, solution[:3], rtol=0.0, atol=1e-12 * scale)
        if np.all(np.abs(solution[3:6]) < params.bounds.s_v_max):
            s_v_hat = adaptation.s_v_hat(params, old.s_v_hat, v_til)
            np.testing.assert_allclose(s_v_hat, solution[3:6], rtol=0.0, atol=1e-12 * scale)
        if 1.0 / params.bounds.m_max < solution[6] < 1.0 / params.bounds.m_min:
            m_hat = adaptation.m_hat_achieved(params, old.m_hat, v_til, vec3(T_a))
            assert 1.0 / m_hat == pytest.approx(solution[6], rel=0.0, abs=1e-12 * scale)


@pytest.mark.parametrize("rate_hz", [100.0, 250.0, 500.0, 1000.0])
@pytest.mark.parametrize("gamma", [10.0, 1e3, 1e5])
@pytest.mark.computes
def test_a_rate_step_is_the_solution_of_five_linear_equations(law, random_state, rate_hz, gamma):
    """Unknowns of the roll axis after the tick: p_til, s_p_hat, c_p1_hat, c_p2_hat, 1/J_1_hat."""
    params, rng = law(rate_hz=rate_hz, gamma=gamma), np.random.default_rng(5)
    h = params.h
    for _ in range(20):
        _, predictor, old, _ = random_state(params, rng)
        w, w_mean, tau_a = (rng.normal(size=3) for _ in range(3))
        Omega_m = float(rng.normal() * 50.0)
        _, q, r = w_mean
        phi = np.array([1.0, q * r, q * Omega_m, tau_a[0]])
        gains = np.array([params.gamma, params.gamma_c, params.gamma_c, params.gamma_LambdaJ])
        unknown = [old.s_w_hat.x, old.c_p1_hat, old.c_p2_hat, 1.0 / old.J_hat.x]
        A, b = np.eye(5), np.array([w[0] - predictor.w_hat.x, *unknown])
        A[0, 0] += h * params.lambda_w
        A[0, 1:] = h * phi
        A[1:, 0] = -h * gains * phi
        solution = np.linalg.solve(A, b)

        past = Past(0.0, Vec3(0.0, 0.0, 0.0), vec3(tau_a), vec3(w_mean), Omega_m)
        w_til = prediction.rates_achieved(params, predictor, old, vec3(w), past)
        error = PredictionError(v_til=Vec3(0.0, 0.0, 0.0), w_til=w_til)
        new = adaptation.achieved(params, old, error, past)
        estimates = [new.s_w_hat.x, new.c_p1_hat, new.c_p2_hat, 1.0 / new.J_hat.x]
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
    h, rotors = params.h, params.rotors
    x, y, spin = (np.array(row) for row in (rotors.x, rotors.y, rotors.spin))
    attitudes = Rotation.from_rotvec(rng.normal(size=(n, 3)) * 0.4)
    Omega = np.sqrt(M * 9.81 / 8.0 / rotors.c_T.r1) * rng.uniform(0.8, 1.2, (n, 8))
    v, w = np.zeros((n, 3)), np.zeros((n, 3))
    e3 = attitudes.as_matrix()[:, :, 2]
    for k in range(1, n):
        f = (
            rotors.c_T.r1 * Omega[k] ** 2
        )  # without lag, the speed of this tick's end held through it
        T_a = 0.5 * f.sum() * (e3[k - 1] + e3[k])
        tau_a = np.array([y @ f, -x @ f, -rotors.k_Q * (spin @ f)])
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
@pytest.mark.computes
def test_the_lyapunov_functions_do_not_grow(settings_of, fixed, ticks, rate_hz, gamma):
    """V = |v_til|^2 + |s_til|^2/gamma + Lambda_til^2/gamma_Lambda, and its like for the rates."""
    settings = settings_of(rate_hz=rate_hz, gamma=gamma, rotor_lag_s=0.0)
    params, law_ticks, setpoint = settings.law, ticks(settings), to_buffer(fixed())
    V = []
    for measured in matching_plant(params, np.random.default_rng(38), 300):
        law_ticks.tick(measured, setpoint)
        state = law_ticks.shown["state"]["estimates"]
        shown = law_ticks.shown["internals"]["prediction"]
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
def test_with_the_truth_estimated_the_prediction_is_exact(settings_of, fixed, ticks, rate_hz):
    """Every mean over a tick is the plant's own, so no error arises to move an estimate."""
    settings = settings_of(rate_hz=rate_hz, rotor_lag_s=0.0)
    law_ticks, setpoint = ticks(settings), to_buffer(fixed())
    plant = matching_plant(settings.law, np.random.default_rng(41), 300)
    law_ticks.tick(plant[0], setpoint)
    for name, true in {"m_hat": M, "s_v_hat": S_V, "s_w_hat": S_W, "J_hat": J, **C}.items():
        law_ticks.remembered["law"]["estimates"][name] = tuple(true) if np.ndim(true) else true
    for measured in plant[1:]:
        law_ticks.tick(measured, setpoint)
        shown = law_ticks.shown["internals"]["prediction"]
        np.testing.assert_allclose(three(shown["v_til"]), 0.0, atol=1e-13)
        np.testing.assert_allclose(three(shown["w_til"]), 0.0, atol=1e-12)


@pytest.mark.parametrize("prediction_form", ["achieved", "demanded"])
def test_more_acceleration_than_predicted_means_less_mass_and_inertia(
    law, hover, fixed, prediction_form
):
    params = law(prediction=prediction_form, rotor_lag_s=0.0)
    state = with_fields(
        mmrac.beginning(params, hover()), m_hat=8.0, J_hat=Vec3(0.4, 0.4, 0.4),
        f_c=Vec3(0.0, 0.0, 9.81), f_wc=Vec3(2.0, 2.0, 2.0),
    )  # fmt: skip
    faster = hover(v=(0.0, 0.0, 0.5), w=(0.5, 0.5, 0.5))
    x, y, spin = (np.array(row) for row in params.rotors[:3])
    rolling = 0.02 * y - 0.02 * x - 0.05 * spin
    Omega = np.array(faster.Omega) * (1.0 + rolling)  # torque about all three axes
    measured = faster._replace(Omega=type(faster.Omega)(*Omega.tolist()))
    after, _, _, internals = mmrac.step(state, params, fixed(), measured)
    assert internals.prediction.v_til.z > 0.0
    assert min(internals.prediction.w_til) > 0.0
    assert after.estimates.m_hat < 8.0
    assert max(after.estimates.J_hat) < 0.4


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(0.01, 100.0))
@pytest.mark.parametrize("prediction_form", ["achieved", "demanded"])
@pytest.mark.computes
def test_projection_keeps_every_estimate_in_its_set(
    settings_of, hover, fixed, ticks, prediction_form, seed, size
):
    """Whatever is measured, jumping at random from tick to tick: 16 000 ticks in all."""
    settings = settings_of(prediction=prediction_form)
    params, law_ticks, rng, n = settings.law, ticks(settings), np.random.default_rng(seed), 1000
    measured = size * rng.normal(size=(n, 21))
    measured[:, 6:10] = Rotation.random(n, rng=rng).as_quat(scalar_first=True)
    measured[:, 13:] = rng.uniform(0.0, params.rotors.Omega_max.r1, (n, 8))
    setpoint = to_buffer(fixed(size * rng.normal(size=3)))
    rows = np.empty((n, len(law_ticks.row)))
    for k in range(n):
        law_ticks.tick(measured[k], setpoint)
        rows[k] = law_ticks.row
    assert np.all(np.isfinite(rows))

    column, b = {name: rows[:, i] for i, name in enumerate(columns(Tick))}, params.bounds
    roundoff = 1e-12
    assert column["state.estimates.m_hat"].min() >= b.m_min - roundoff
    assert column["state.estimates.m_hat"].max() <= b.m_max + roundoff
    for name in ("s_v_hat", "s_w_hat", "J_hat"):
        three = np.stack([column[f"state.estimates.{name}.{axis}"] for axis in "xyz"])
        if name == "J_hat":
            assert three.min() >= b.J_min - roundoff
            assert three.max() <= b.J_max + roundoff
        else:
            assert np.abs(three).max() <= (b.s_v_max if name == "s_v_hat" else b.s_w_max)
    for name in ("c_p1_hat", "c_p2_hat", "c_q1_hat", "c_q2_hat", "c_r1_hat"):
        assert np.abs(column[f"state.estimates.{name}"]).max() <= b.c_max
    u = np.stack([column[f"command.u.r{i}"] for i in range(1, 9)])
    assert u.min() >= 0.0
    assert u.max() <= 1.0


def test_projection_is_shown_while_it_holds_an_estimate(settings_of, hover, fixed, ticks):
    law_ticks = ticks(settings_of())
    far = hover()._replace(v_E=Vec3(1e4, 0.0, 0.0))
    law_ticks.tick(to_buffer(hover()), to_buffer(fixed()))
    assert law_ticks.shown["internals"]["flags"]["projected"] == 0.0
    law_ticks.tick(to_buffer(far), to_buffer(fixed()))
    assert law_ticks.shown["internals"]["flags"]["projected"] == 1.0
    assert law_ticks.shown["state"]["estimates"]["s_v_hat"]["x"] == 30.0


def test_every_edge_of_every_set_is_shown(law, hover):
    params = law()
    inside, b = mmrac.beginning(params, hover()).estimates, params.bounds
    assert adaptation.held(b, inside) == 0.0
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
            assert adaptation.held(b, inside._replace(**{name: value})) == 1.0, name


def test_the_printed_inertia_keeps_to_its_lower_bound(law, hover):
    params = law(prediction="demanded", bounds={"J_min": 0.05})
    J_hat = mmrac.beginning(params, hover()).estimates.J_hat
    e, f_wc = Vec3(9.0, 9.0, 9.0), Vec3(1.0, 1.0, 1.0)
    assert adaptation.J_hat_demanded(params, J_hat, e, f_wc) == (0.05, 0.05, 0.05)
