"""The cascade entered at attitude and at body rates: signs, limits, and what is recorded."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import to_buffer
from fcu.kernel.rotations import from_euler, matrix
from fcu.laws.mmrac import attitude as attitudes
from fcu.laws.mmrac import entry, reference_model
from fcu.laws.mmrac import law as mmrac

W = 8.0 * 9.81
AWAY = (50.0, -60.0, 70.0)  # a position that none of this may lead to


@pytest.fixture
def attitude(fixed):
    """A setpoint of level 1."""

    def build(phi=0.0, theta=0.0, psi=0.0, T=W):
        return fixed(AWAY, psi)._replace(level=1.0, tilt_c=Vec3(phi, theta, 9.0), T_c=T)

    return build


@pytest.fixture
def rates(fixed):
    """A setpoint of level 2."""

    def build(p=0.0, q=0.0, r=0.0, T=W):
        return fixed(AWAY, 1.0)._replace(level=2.0, w_c=Vec3(p, q, r), T_c=T)

    return build


def first(law, setpoint, measured, **chosen):
    """Outputs, internals and command of a take-over with mass and inertia known."""
    _, command, outputs, internals = mmrac.take_over(
        law(m_hat_0=8.0, J_hat_0=0.4, **chosen), setpoint, measured
    )
    return outputs, internals, np.array(command.u)


@pytest.mark.parametrize("prediction", ["achieved", "demanded"])
@pytest.mark.parametrize("psi", [0.0, 2.0])
def test_roll_to_the_right_pushes_right_and_nose_down_pushes_ahead(
    law, attitude, hover, prediction, psi
):
    """Whatever the heading, and wherever r_c is."""
    ahead, right = (math.cos(psi), math.sin(psi), 0.0), (math.sin(psi), -math.cos(psi), 0.0)
    measured = hover(angles=(0.0, 0.0, psi))
    for setpoint, way in (
        (attitude(phi=0.2, psi=psi), right),
        (attitude(theta=0.2, psi=psi), ahead),
    ):
        outputs, internals, _ = first(law, setpoint, measured, prediction=prediction)
        assert np.dot(internals.demand.T_d, way) == pytest.approx(W * math.sin(0.2))
        assert internals.demand.T_d.z == pytest.approx(W * math.cos(0.2))
        assert outputs.T_c == W
        assert outputs.angles_c == (*setpoint.tilt_c[:2], psi)
        assert np.dot(outputs.w_c, (setpoint.tilt_c.x, setpoint.tilt_c.y, 0.0)) > 0.0


def test_roll_right_is_made_by_the_left_rotors_and_pitch_by_the_rear(
    law, attitude, hover, believed
):
    x, y = np.array(believed.x), np.array(believed.y)
    _, _, u = first(law, attitude(phi=0.1), hover())
    assert u[y > 0.0].min() > u[y < 0.0].max()
    _, _, u = first(law, attitude(theta=0.1), hover())
    assert u[x < 0.0].min() > u[x > 0.0].max()
    _, _, u = first(law, attitude(psi=0.1), hover())
    spin = np.array(believed.spin)
    assert u[spin < 0.0].min() > u[spin > 0.0].max()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_body_rate_is_turned_towards(law, rates, hover, axis):
    """From rest, and at that rate there is nothing to do; w_c is what was sent."""
    w = np.zeros(3)
    w[axis] = -0.3
    outputs, internals, _ = first(law, rates(*w), hover(angles=(0.3, -0.2, 1.0)))
    assert outputs.w_c == tuple(w)
    assert internals.demand.tau_d == pytest.approx(0.4 * 20.0 * w)
    _, internals, _ = first(law, rates(*w), hover(w=w))
    assert internals.demand.tau_d == pytest.approx((0.0, 0.0, 0.0))


@pytest.mark.parametrize("T", [40.0, W, 120.0])
def test_thrust_is_what_the_rotors_are_given(law, attitude, rates, hover, T):
    for setpoint in (attitude(T=T), rates(T=T)):
        outputs, _, _ = first(law, setpoint, hover())
        assert outputs.T_c == T
        assert sum(outputs.thrusts) == pytest.approx(T)
        assert outputs.saturation.thrust == 0.0


@pytest.mark.parametrize("prediction", ["achieved", "demanded"])
def test_thrust_and_tilt_are_held_at_their_limits_and_it_shows(
    law, attitude, rates, hover, prediction
):
    limits = law().limits
    for T, limit in ((-1.0, limits.T_min), (1e6, limits.T_max)):
        for setpoint in (attitude(T=T), rates(T=T)):
            outputs, _, _ = first(law, setpoint, hover(), prediction=prediction)
            assert (outputs.T_c, outputs.saturation.thrust) == (limit, 1.0)
    past = attitude(phi=-1.0, theta=1.2)
    outputs, _, _ = first(law, past, hover(), prediction=prediction)
    assert outputs.angles_c[:2] == (-limits.phi_star, limits.phi_star)
    assert outputs.saturation.tilt == 1.0
    within, _, _ = first(law, attitude(phi=0.7), hover(), prediction=prediction)
    assert within.saturation.tilt == 0.0  # though the position law would ask for more than it can
    outputs, turning, _ = first(law, past._replace(level=2.0), hover(), prediction=prediction)
    assert outputs.saturation.tilt == turning.flags.tilt_rate == turning.flags.yaw_rate == 0.0


def test_at_level_2_the_record_shows_the_attitude_there_is(law, rates, hover):
    angles = (0.9, -0.4, 2.0)
    measured = hover((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), angles)
    outputs, internals, _ = first(law, rates(T=60.0), measured)
    assert outputs.angles_c == pytest.approx(angles)
    expected = 60.0 * Rotation.from_euler("ZYX", angles[::-1]).as_matrix()[:, 2]
    np.testing.assert_allclose(internals.demand.T_d, expected, atol=1e-12)
    np.testing.assert_allclose(internals.demand.f_c, expected / 8.0, atol=1e-12)


def test_the_thrust_axis_is_that_of_the_rotation():
    rng = np.random.default_rng(39)
    for _ in range(100):
        phi, theta, psi = rng.uniform(-1.4, 1.4, 3).tolist()  # 80 degrees, the most allowed
        axis = entry.thrust_axis(phi, theta, math.cos(psi), math.sin(psi))
        np.testing.assert_allclose(axis, matrix(from_euler(phi, theta, psi)).e3, atol=1e-14)


def test_the_reference_follows_the_vehicle(law, attitude, rates, hover):
    measured = hover((1.0, 2.0, 3.0), (4.0, 5.0, -6.0))
    params = law(r_m_offset=[5.0, 5.0, 5.0])
    for setpoint in (attitude(), rates()):
        state, _, outputs, _ = mmrac.take_over(params, setpoint, measured)
        assert outputs.reference == (measured.r_E, measured.v_E)
        assert outputs.e_r == (0.0, 0.0, 0.0)
        assert state.reference.r_m == pytest.approx((1.008, 2.010, 2.988))
        assert state.reference.v_m == measured.v_E


def test_below_the_position_level_only_yaw_is_carried(attitude, rates):
    moving = {"v_c": Vec3(1.0, 2.0, 3.0), "a_c": Vec3(4.0, 5.0, 6.0), "psi_dot_c": 0.5}
    for setpoint in (
        attitude(phi=0.1, psi=0.2)._replace(**moving),
        rates(p=0.1)._replace(**moving),
    ):
        carried = reference_model.carried(setpoint, 2.0)
        assert carried == setpoint._replace(psi_c=setpoint.psi_c + 1.0)


def test_what_belongs_to_another_level_changes_nothing(law, fixed, attitude, rates, hover):
    """To the bit, commands and state: so a setpoint may leave the rest at anything finite."""
    params, measured = law(), hover((0.1, 0.2, 0.3), (0.3, 0.1, 0.0), (0.1, 0.2, 0.3))

    def outcome(setpoint):
        state, command, _, _ = mmrac.take_over(params, setpoint, measured)
        return to_buffer(state).tobytes() + to_buffer(command).tobytes()

    odd = Vec3(7.0, -8.0, 9.0)
    position = fixed((1.0, 2.0, 3.0))
    assert outcome(position._replace(tilt_c=odd, w_c=odd, T_c=-3.0)) == outcome(position)
    lying = attitude(0.1, 0.2, 0.3)
    assert outcome(lying._replace(r_c=odd, v_c=odd, a_c=odd, w_c=odd)) == outcome(lying)
    turning = rates(0.1, 0.2, 0.3)
    other = turning._replace(r_c=odd, v_c=odd, a_c=odd, tilt_c=odd, psi_c=1.7, psi_dot_c=3.0)
    assert outcome(other) == outcome(turning)


@pytest.mark.parametrize("level", [0.0, 1.0, 2.0])
def test_python_and_compiled_code_give_the_same_bits(law, attitude, hover, level):
    setpoint = attitude(0.1, -0.2, 0.3)._replace(level=level)
    lies = attitudes.measured(hover(angles=(0.3, 0.2, 0.1)).q_EB)
    estimates = mmrac.nothing_learnt(8.0, Vec3(0.3, 0.3, 0.3))
    arguments = (law().limits, estimates, setpoint, lies)
    plain, compiled = entry.given_force.py_func(*arguments), entry.given_force(*arguments)
    assert to_buffer(plain).tobytes() == to_buffer(compiled).tobytes()
