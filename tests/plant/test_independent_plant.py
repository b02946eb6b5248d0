"""The plant against one written here from (32), (33) with numpy matrices and SciPy's DOP853."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from sitl_plant.physics.parameters import start_state

WIND = {
    "amplitude_m_s": [7.2, 7.2, 5.7],
    "frequency_rad_s": [1.5, 1.6, 1.7],
    "rotation_amplitude_rad_s": [0.7, 0.6, 0.5],
    "rotation_frequency_rad_s": [2.5, 2.4, 2.3],
}
M, G, C_D, C_TAU, LAG, J_M = 8.0, 9.81, 0.15, 0.05, 0.05, 2e-4
J = np.diag([0.3245, 0.3245, 0.4616])
C_T, C_Q, OMEGA_MAX = 8.2e-5, 0.0159 * 8.2e-5, 552.2
ANGLES = np.radians([22.5, -22.5, -67.5, -112.5, -157.5, 157.5, 112.5, 67.5])
ARMS = 0.5225 * np.stack([np.cos(ANGLES), np.sin(ANGLES), np.zeros(8)], axis=1)
SPIN = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
E3 = np.array([0.0, 0.0, 1.0])

# rotor speeds over full speed, each held for a quarter of a second: climb, roll, pitch, yaw
MANOEUVRE = [
    np.full(8, 0.66),
    0.64 + 0.02 * np.sign(ARMS[:, 1]),
    0.64 - 0.03 * np.sign(ARMS[:, 1]),
    0.64 + 0.03 * np.sign(ARMS[:, 0]),
    0.63 - 0.04 * np.sign(ARMS[:, 0]),
    0.63 + 0.05 * SPIN,
    0.62 - 0.04 * SPIN,
    np.linspace(0.58, 0.66, 8),
]


def cross_matrix(w):
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def derivative(t, y, u):
    """Of position, velocity, rotation matrix (row by row), body rate, rotor speeds."""
    v, R, w, Omega = y[3:6], y[6:15].reshape(3, 3), y[15:18], y[18:26]
    wind = np.array([7.2 * np.sin(1.5 * t), 7.2 * np.sin(1.6 * t), 5.7 * np.sin(1.7 * t)])
    air_rate = np.array([0.7 * np.sin(2.5 * t), 0.6 * np.sin(2.4 * t), 0.5 * np.sin(2.3 * t)])
    thrusts = C_T * Omega**2
    v_air_B, w_air = R.T @ (v - wind), w - air_rate
    drag_B = -C_D * v_air_B * np.abs(v_air_B)
    lift = sum(np.cross(arm, f * E3) for arm, f in zip(ARMS, thrusts, strict=True))
    reaction = -C_Q * np.sum(SPIN * Omega**2) * E3
    drag_torque = -C_TAU * w_air * np.abs(w_air)
    momentum = J @ w + J_M * np.sum(SPIN * Omega) * E3  # of the body, and of the rotors along z
    v_dot = R @ (thrusts.sum() * E3 + drag_B) / M - G * E3
    w_dot = np.linalg.solve(J, lift + reaction + drag_torque - np.cross(w, momentum))
    Omega_dot = (OMEGA_MAX * u - Omega) / LAG
    return np.concatenate([v, v_dot, (R @ cross_matrix(w)).ravel(), w_dot, Omega_dot])


@pytest.mark.computes
def test_two_seconds_of_manoeuvre_in_the_papers_wind_agree_to_1e_8(plant, fly):
    params = plant(wind=WIND)
    state = start_state(params, {"position_m": [1.0, 2.0, 3.0], "yaw_deg": 40.0})
    R = Rotation.from_quat(state.q_EB, scalar_first=True).as_matrix()
    y = np.concatenate([state.r_E, state.v_E, R.ravel(), state.w_B, state.Omega])
    for i, u in enumerate(MANOEUVRE):
        span = (0.25 * i, 0.25 * (i + 1))
        state = fly(params, state, u, 0.25, t=span[0])
        exact = solve_ivp(derivative, span, y, args=(u,), method="DOP853", rtol=1e-11, atol=1e-12)
        y = exact.y[:, -1]

    R = Rotation.from_quat(state.q_EB, scalar_first=True).as_matrix()
    np.testing.assert_allclose(state.r_E, y[:3], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(state.v_E, y[3:6], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(R.ravel(), y[6:15], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(state.w_B, y[15:18], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(state.Omega, y[18:], rtol=0.0, atol=1e-7)
    assert R[2, 2] < 0.95
    assert np.linalg.norm(y[15:18]) > 0.3
