"""What docs/paper.md says of the printed text: each slip by the smallest case that shows it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import fcu
from fcu.interface.airframe import airframe, load
from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Quat, Rotors, Vec3
from fcu.laws.mmrac import law as mmrac
from fcu.laws.mmrac.parameters import law_params

OCTO = load(Path(fcu.__file__).with_name("airframes") / "s1000.toml")
ZERO = Vec3(0.0, 0.0, 0.0)
M, G = 8.0, np.array([0.0, 0.0, -9.81])


@pytest.mark.parametrize(("prediction", "thrust"), [("demanded", 5.0), ("achieved", M * 9.81)])
def test_2_without_gravity_a_vehicle_that_knows_its_mass_starts_by_falling(prediction, thrust):
    believed = airframe(OCTO["rotors"], "s1000.toml")
    law = law_params(believed, OCTO, 500.0, {"prediction": prediction, "m_hat_0": M})
    resting = VehicleState(ZERO, ZERO, Quat(1.0, 0.0, 0.0, 0.0), ZERO, Rotors(*[345.8] * 8))
    _, _, outputs, _ = mmrac.take_over(law, Setpoint(ZERO, ZERO, ZERO, 0.0, 0.0), resting)
    assert outputs.T_c == pytest.approx(thrust)


def test_3_the_printed_tilt_turns_a_demand_by_a_quarter():
    """Force asked to the east, nose to the east: (39) as printed leans to the south."""
    T_x, T_y, T_z, psi = 30.0, 0.0, 80.0, 0.0
    phi_c = math.atan2(T_x * math.cos(psi) + T_y * math.sin(psi), T_z)
    theta_c = math.atan2(T_x * math.sin(psi) - T_y * math.cos(psi), T_z / math.cos(phi_c))
    axis = Rotation.from_euler("ZYX", [psi, theta_c, phi_c]).apply([0.0, 0.0, 1.0])
    assert axis[0] == pytest.approx(0.0, abs=1e-12)
    assert axis[1] < -0.3
    right = Rotation.from_euler("ZYX", [psi, phi_c, theta_c]).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(right * np.hypot(T_x, T_z), [T_x, T_y, T_z], atol=1e-12)


def test_4_a_standing_angle_error_asks_for_no_rate():
    """(40) as printed sees derivatives alone, and an error that stands has none."""
    phi, phi_c, phi_dot, phi_dot_c, c = 0.3, 0.0, 0.0, 0.0, 10.0
    assert c * (phi_dot_c - phi_dot) == 0.0
    assert c * (phi_c - phi) == pytest.approx(-3.0)


def pumped(rate, gamma=1000.0, W=100.0, h=1e-6, n=20_000):
    """Greatest |x - x_hat| of x' = -x + L u, u = -W, 0 or W, L in [0.1, 1] as fast as `rate`."""
    k = math.sqrt(gamma)
    x_til, L_hat, L, goal, greatest = 0.0, 0.0, 1.0, 1.0, 0.0
    for _ in range(n):
        if goal == L and (L - L_hat) * (1.0 if L == 1.0 else -1.0) <= 0.0:
            goal = 0.1 if L == 1.0 else 1.0
        L += math.copysign(min(rate * h, abs(goal - L)), goal - L)
        u = W * (1.0 if L == 1.0 else -1.0) if goal == L else 0.0
        x_til += h * (-(1.0 + k) * x_til + (L - L_hat) * u)
        L_hat = min(max(L_hat + h * gamma * x_til * u, -1.0), 1.0)
        greatest = max(greatest, abs(x_til))
    return greatest


def test_6_without_the_rate_of_Lambda_the_bound_20_is_exceeded():
    """Theta = d = 0, P = 1: as printed c = 4 lambda*^2; the missing term is 4 lambda* lambda_d*."""
    gamma, rate = 1000.0, 1e4
    measured = pumped(rate, gamma)
    printed = math.sqrt(4.0 / gamma)
    repaired = math.sqrt((4.0 + 4.0 * rate / (2.0 * math.sqrt(gamma))) / gamma)
    assert 2.0 * printed < measured < repaired


def test_7_an_upper_bound_of_Lambda_hides_a_demand_that_saturates():
    """x' = -x + r + L (u - r/L): the control that makes it the reference model is r/L."""
    L, lambda_max, r, v_max = 0.25, 1.0, 1.0, 2.0
    assert abs(r) / lambda_max <= v_max < abs(r / L)


def test_8_a_ball_of_the_printed_radius_holds_controls_that_saturate():
    v_max = np.array([1.0, 1.0])
    v = np.array([math.sqrt(2.0), 0.0])
    assert np.linalg.norm(v) <= math.sqrt(2.0) * v_max.max()
    assert (abs(v) > v_max).any()
    around = np.linspace(0.0, 2.0 * math.pi, 100)
    inside = v_max.min() * np.stack([np.cos(around), np.sin(around)])
    assert (abs(inside) <= v_max[:, None]).all()


def test_9_the_printed_theorem_admits_a_start_that_saturates():
    """x' = -x + u + x + d: K = L = 1, no adaptation (beta_1 = beta_2 = 0), v* = 1."""
    v_max, d_max, rho_1, rho_2 = 1.0, 0.4, 0.5, 0.9
    assert v_max - d_max - rho_1 > 0.0
    assert rho_2 <= d_max + rho_1  # as printed
    x_m, e = rho_1, rho_2  # the reference may be there, the error may be this
    assert abs(-(x_m + e) - d_max) > v_max
    assert abs(-(x_m + (v_max - d_max - rho_1)) - d_max) <= v_max  # repaired


def derivative_of_V(delta_u_in_predictor, rng):
    """V' of the printed law at a random state, and what it should be without and with Delta u."""
    v_til, f_c, delta_u, s_til = (rng.normal(size=3) * size for size in (1.0, 10.0, 50.0, 5.0))
    m_hat, lam, gamma = rng.uniform(2.0, 15.0), 30.0, 1000.0
    m_til = M - m_hat
    v_dot = (m_hat * f_c + delta_u) / M + s_til  # (35), less s_hat; (37)
    v_hat_dot = f_c + lam * v_til  # (36), less s_hat: a_ref = f_c + s_hat
    regressor = f_c
    if delta_u_in_predictor:
        v_hat_dot = v_hat_dot + delta_u / m_hat  # B Lambda_hat Delta u of (9)
        regressor = f_c + delta_u / m_hat
    s_til_dot, m_til_dot = -gamma * v_til, gamma * v_til @ regressor  # (38)
    V_dot = v_til @ (v_dot - v_hat_dot) + s_til @ s_til_dot / gamma
    V_dot += m_til * m_til_dot / (gamma * M)
    return V_dot, -lam * v_til @ v_til, v_til @ delta_u / M


def test_10_what_saturation_adds_to_the_derivative_of_V():
    rng = np.random.default_rng(36)
    for _ in range(1000):
        V_dot, damping, pushed = derivative_of_V(False, rng)
        assert V_dot == pytest.approx(damping + pushed, rel=1e-9, abs=1e-9)
        V_dot, damping, _ = derivative_of_V(True, rng)
        assert V_dot == pytest.approx(damping, rel=1e-9, abs=1e-9)


def test_11_a_demand_downwards_becomes_thrust_upwards():
    T = np.array([0.0, 0.0, -150.0])
    phi_c = np.clip(math.atan2(-T[1], T[2]), -math.pi / 4.0, math.pi / 4.0)
    achieved = np.linalg.norm(T) * Rotation.from_euler("ZYX", [0.0, 0.0, phi_c]).apply([0, 0, 1])
    assert achieved[2] > 100.0


@pytest.mark.parametrize("gamma", [1e2, 1e4, 1e6])
def test_12_with_k_the_root_of_gamma_28_does_not_shrink(gamma):
    gamma_A, lambda_A, lambda_P, c_1, k = 1.0, 1.0, 1.0, 4.0, math.sqrt(gamma)
    tracking = gamma_A * k / lambda_A * math.sqrt(c_1 / (gamma * lambda_P))
    assert tracking == pytest.approx(gamma_A / lambda_A * math.sqrt(c_1 / lambda_P))


def test_12_what_replaces_it_is_a_gain_of_1_03():
    """e'' + 2 zeta f e' + f^2 e = z: the integral of |impulse response|, times f^2."""
    zeta, f = 0.8, 1.4
    root = math.sqrt(1.0 - zeta * zeta)
    t = np.linspace(0.0, 30.0, 300_001)
    response = np.exp(-zeta * f * t) * np.sin(root * f * t) / (root * f)
    gain = np.trapezoid(abs(response), t) * f * f
    assert gain == pytest.approx(1.03, abs=0.005)


def left_over(L, theta, theta_hat, Y, projected):
    """What projection adds to half of V': it must not be positive. tr(.^T Lambda (Y - Pr))."""
    return float((theta - theta_hat) @ L @ (Y - projected))


def test_12_projection_to_a_ball_lets_V_grow_where_Lambda_is_no_multiple_of_one():
    n = np.array([0.5, math.sqrt(0.75)])  # the estimate, on the unit ball
    theta, Y = np.array([1.0, 0.0]), n  # the truth, on it too; the update points out
    ball = Y - n * (n @ Y)
    assert left_over(np.diag([1.0, 0.1]), theta, n, Y, ball) > 0.1
    assert left_over(0.3 * np.eye(2), theta, n, Y, ball) < 0.0


def test_12_projection_to_a_box_does_not_for_a_diagonal_Lambda():
    rng = np.random.default_rng(10)
    for _ in range(1000):
        L, Y = np.diag(rng.uniform(0.01, 1.0, 3)), rng.normal(size=3)
        theta, theta_hat = rng.uniform(-1.0, 1.0, (2, 3))
        at_edge = rng.random(3) < 0.5
        theta_hat[at_edge] = np.sign(theta_hat[at_edge])
        box = np.where(at_edge & (Y * theta_hat > 0.0), 0.0, Y)
        assert left_over(L, theta, theta_hat, Y, box) <= 0.0


def test_12_equation_42_read_from_left_to_right_is_another_torque():
    J, w = np.diag([0.3245, 0.3245, 0.4616]), np.array([1.0, 2.0, 3.0])
    meant = -np.linalg.inv(J) @ np.cross(w, J @ w)
    read = -np.cross(np.linalg.inv(J) @ w, J @ w)
    J_1, J_2, J_3 = np.diag(J)
    assert read[0] / meant[0] == pytest.approx(J_1 * (J_2 + J_3) / (J_2 * J_3))
    assert read[0] / meant[0] > 1.5


def test_13_the_setpoint_of_section_viii_does_not_satisfy_31_from_the_origin():
    r_c, zeta, limit = np.array([4.0, 7.0, 18.0]), 0.8, 200.0
    for f_m, demand in ((1.0, 231.6), (1.4, 382.2)):
        assert np.linalg.norm(M * (f_m**2 * r_c - G)) == pytest.approx(demand, abs=0.05)
        assert demand > limit
    K = M * math.sqrt(1.0 + 4.0 * zeta**2)  # f_m = 1
    left = K * np.linalg.norm(r_c) + M * 9.81  # of (31), from the setpoint, without wind
    assert left == pytest.approx(376.2, abs=0.05)
    assert left > math.sqrt(3.0) * limit  # the paper's own v*
    # only (22) itself, at the start, with that v*, separates the two flights
    assert 231.6 < math.sqrt(3.0) * limit < 382.2


def test_pomet_pralys_projection_ends_outside_the_set_that_its_bound_names():
    bound, margin, theta = 1.0, 0.1, 0.99
    for _ in range(20_000):
        p = (theta * theta - bound * bound) / (margin * margin + 2.0 * margin * bound)
        theta += 1e-3 * (1.0 - max(p, 0.0))
    assert theta == pytest.approx(bound + margin)


def test_the_regressor_of_Lambda_hat_is_delta_u():
    rng = np.random.default_rng(26)
    v, bound = rng.normal(size=(1000, 3)), 0.8  # (26): v = -Theta_hat f - d_hat
    u = np.clip(v, -bound, bound)
    regressor = u - v  # (10): u + Theta_hat f + d_hat
    unsaturated = (abs(v) <= bound).all(axis=1)
    assert 0 < unsaturated.sum() < 1000
    assert (regressor[unsaturated] == 0.0).all()
    assert (regressor[~unsaturated] != 0.0).any(axis=1).all()


def test_limits_of_roll_and_pitch_allow_a_tilt_of_60_degrees():
    axis = Rotation.from_euler("ZYX", [0.0, 45.0, 45.0], degrees=True).apply([0.0, 0.0, 1.0])
    assert math.degrees(math.acos(axis[2])) == pytest.approx(60.0)
    assert 200.0 * axis[2] == pytest.approx(100.0)
