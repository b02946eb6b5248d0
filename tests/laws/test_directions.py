"""The sign of everything the law commands."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fcu.kernel.algebra import Vec3
from fcu.kernel.rotations import from_euler
from fcu.laws import allocation
from fcu.laws.mmrac import attitude, position, prediction, rates
from fcu.laws.mmrac import law as mmrac
from tests.laws.values import TILTS


def first(law, fixed, measured, r=(0.0, 0.0, 0.0), psi=0.0, **chosen):
    """Outputs, internals and command of a take-over with mass and inertia known."""
    params = law(**{"m_hat_0": 8.0, "J_hat_0": 0.4, **chosen})
    _, command, outputs, internals = mmrac.take_over(params, fixed(r, psi), measured)
    return outputs, internals, np.array(command.u)


@pytest.mark.parametrize("prediction_form", ["achieved", "demanded"])
def test_a_setpoint_north_east_up_asks_force_north_east_up(law, fixed, hover, prediction_form):
    params = law(prediction=prediction_form)
    r_c = (1.0, 2.0, 3.0)
    _, _, told, there = mmrac.take_over(params, fixed(r_c), hover())
    _, _, told_here, here = mmrac.take_over(params, fixed(), hover())
    assert np.all(np.array(there.demand.T_d) - np.array(here.demand.T_d) > 0.0)
    assert told.T_c > told_here.T_c
    phi_c, theta_c, _ = told.angles_c
    assert theta_c > 0.0  # nose east: pitch (about left, nose down) flies east
    assert phi_c < 0.0  # roll left flies north


@pytest.mark.parametrize(("psi", "r_c", "phi_sign", "theta_sign"), TILTS)
def test_tilt_is_towards_the_setpoint_whatever_the_heading(
    law, fixed, hover, psi, r_c, phi_sign, theta_sign
):
    outputs, _, _ = first(law, fixed, hover(angles=(0.0, 0.0, psi)), r_c, psi)
    phi_c, theta_c, _ = outputs.angles_c
    assert phi_c * phi_sign > 0.1 if phi_sign else abs(phi_c) < 1e-9
    assert theta_c * theta_sign > 0.1 if theta_sign else abs(theta_c) < 1e-9


def test_the_commanded_tilt_points_the_thrust_axis_along_the_demand(law):
    params, rng = law(), np.random.default_rng(39)
    for _ in range(200):
        T_d = np.array([*rng.uniform(-60.0, 60.0, 2), rng.uniform(90.0, 150.0)])
        psi = rng.uniform(-math.pi, math.pi)
        phi_c, theta_c, clipped = position.tilt(
            params.limits.phi_star, Vec3(*T_d.tolist()), math.cos(psi), math.sin(psi)
        )
        assert clipped == 0.0
        e3 = Rotation.from_euler("ZYX", [psi, theta_c, phi_c]).as_matrix()[:, 2]
        np.testing.assert_allclose(e3, T_d / np.linalg.norm(T_d), atol=1e-12)


def test_tilt_commands_are_held_at_45_degrees(law):
    phi_star = law().limits.phi_star
    phi_c, theta_c, clipped = position.tilt(phi_star, Vec3(500.0, -600.0, 20.0), 1.0, 0.0)
    assert (phi_c, theta_c, clipped) == (math.radians(45.0), math.radians(45.0), 1.0)


def test_a_setpoint_ahead_lowers_the_nose_with_the_rear_rotors(law, fixed, hover, believed):
    _, internals, u = first(law, fixed, hover(), (2.0, 0.0, 0.0))
    assert internals.demand.tau_d.y > 0.0
    rear = np.array(believed.x) < 0.0
    assert u[rear].min() > u[~rear].max()


def test_a_setpoint_to_the_right_lowers_the_right_with_the_left_rotors(law, fixed, hover, believed):
    _, internals, u = first(law, fixed, hover(), (0.0, -2.0, 0.0))
    assert internals.demand.tau_d.x > 0.0
    left = np.array(believed.y) > 0.0
    assert u[left].min() > u[~left].max()


def test_a_yaw_command_to_the_left_spins_up_the_clockwise_rotors(law, fixed, hover, believed):
    _, internals, u = first(law, fixed, hover(), psi=0.1)
    assert internals.demand.tau_d.z > 0.0
    clockwise = np.array(believed.spin) < 0.0
    assert u[clockwise].min() > u[~clockwise].max()


def test_a_setpoint_above_speeds_every_rotor_up(law, fixed, hover):
    _, _, up = first(law, fixed, hover(), (0.0, 0.0, 1.0))
    _, _, hold = first(law, fixed, hover())
    assert np.all(up > hold)


def test_yaw_takes_the_short_way_round(law):
    params = law(prediction="demanded")  # without a limit of the rate of yaw
    lies = attitude.measured(from_euler(0.0, 0.0, 3.1))
    turn = attitude.demanded(params, lies, Vec3(0.0, 0.0, -3.1), 0.0)
    assert turn.w_c.z == pytest.approx(10.0 * (2.0 * math.pi - 6.2), abs=1e-12)


def test_body_rate_commands_are_the_kinematics_of_the_angle_rates():
    """The body rate is that at which the angles move at those rates."""
    rng, h = np.random.default_rng(40), 1e-6
    for _ in range(50):
        phi, theta, psi = (rng.uniform(-0.75, 0.75, 3) * (1.0, 1.0, 4.0)).tolist()
        rates = rng.normal(size=3)
        R_EB = attitude.measured(from_euler(phi, theta, psi)).R_EB
        w_c = attitude.body_rates(R_EB, Vec3(*rates.tolist()))
        ends = [
            Rotation.from_euler("ZYX", (np.array([phi, theta, psi]) + k * h * rates)[::-1])
            for k in (-1, 1)
        ]
        w_B = (ends[0].inv() * ends[1]).as_rotvec() / (2.0 * h)
        np.testing.assert_allclose(w_c, w_B, atol=1e-8)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_torque_opposes_a_body_rate(law, fixed, hover, axis):
    w = np.zeros(3)
    w[axis] = 0.5
    _, internals, _ = first(law, fixed, hover(w=w))
    assert internals.demand.tau_d[axis] < 0.0


def test_estimated_couplings_have_the_signs_of_a_rigid_body():
    """With the true coefficients in place, `couplings` is what the rigid body does. Paper (43)."""
    J, J_m = np.array([0.3, 0.4, 0.6]), 2e-4
    estimates = mmrac.nothing_learnt(8.0, Vec3(*J.tolist()))._replace(
        c_p1_hat=(J[1] - J[2]) / J[0],
        c_p2_hat=-J_m / J[0],
        c_q1_hat=(J[2] - J[0]) / J[1],
        c_q2_hat=J_m / J[1],
        c_r1_hat=(J[0] - J[1]) / J[2],
    )
    w, Omega_m = np.array([0.7, -1.1, 0.4]), 300.0
    spin_momentum = J_m * Omega_m * np.array([0.0, 0.0, 1.0])
    expected = -np.cross(w, J * w + spin_momentum) / J
    np.testing.assert_allclose(
        prediction.couplings(estimates, Vec3(*w.tolist()), Omega_m), expected, atol=1e-15
    )


def test_rotor_speeds_sum_by_spin(law, hover):
    rotors = law().rotors
    Omega = hover().Omega
    assert allocation.omega_m(rotors, Omega) == 0.0
    faster = Omega._replace(r1=Omega.r1 + 10.0)  # rotor 1 turns counter-clockwise
    assert allocation.omega_m(rotors, faster) == pytest.approx(10.0, abs=1e-9)


def test_a_drag_estimate_is_leaned_into(law, fixed, hover):
    """An estimated push to the east is answered by a demand to the west."""
    params, measured = law(m_hat_0=8.0), hover()
    estimates = mmrac.beginning(params, measured).estimates._replace(s_v_hat=Vec3(1.5, 0.0, 0.0))
    lies = attitude.measured(measured.q_EB)
    force = position.achieved(params, estimates, fixed(), measured, lies)
    assert force.f_c == pytest.approx((-1.5, 0.0, 9.81))


def test_a_turning_yaw_setpoint_is_turned_with(law, fixed, hover):
    """At the right yaw, the body-rate command is the setpoint's own yaw rate."""
    setpoint = fixed()._replace(psi_dot_c=0.3)
    _, _, outputs, _ = mmrac.take_over(law(), setpoint, hover())
    assert outputs.w_c.z == pytest.approx(0.3, abs=1e-12)


def test_an_angular_disturbance_is_opposed(law, fixed, hover):
    params = law()
    measured, still = hover(), Vec3(0.0, 0.0, 0.0)
    estimates = mmrac.beginning(params, measured).estimates._replace(s_w_hat=Vec3(1.0, 2.0, 3.0))
    f_wc = rates.f_wc(params.c_rate, estimates, still, still, 0.0)
    assert f_wc == (-1.0, -2.0, -3.0)
    rolling = estimates._replace(s_w_hat=still, c_r1_hat=0.5)
    f_wc = rates.f_wc(params.c_rate, rolling, Vec3(1.0, 2.0, 0.0), Vec3(1.0, 2.0, 0.0), 0.0)
    assert f_wc == (0.0, 0.0, -1.0)
