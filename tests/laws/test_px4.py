"""PX4's cascade against PX4's own unit tests: their inputs, and the numbers that they expect.

PositionControlTest, ControlMathTest, AttitudeControlTest and rate_control_test of PX4-Autopilot. Their
frames are north-east-down and forward-right-down; here y and z have the other sign.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fcu.kernel.algebra import Quat, Vec3
from fcu.kernel.rotations import euler, from_euler
from fcu.laws import loader
from fcu.laws.face import Limits
from tests.laws.conftest import OCTO

G = 9.81
ZERO = Vec3(0.0, 0.0, 0.0)
THRUST_MAX, MARGIN = 0.9, 0.3  # of PositionControlBasicTest


@pytest.fixture(scope="module")
def px4():
    return loader.load("px4").face


@pytest.fixture(scope="module")
def defaults(believed):
    """Params of the octocopter."""
    return loader.load("px4").settings.settings(believed, OCTO, 500.0).law


@pytest.fixture
def basic(defaults):
    """The set-up of PositionControlBasicTest. Thrust is normalised, so the mass is that of 0.5."""
    return defaults._replace(
        h=0.1, m=0.5 / G, limits=Limits(T_min=0.1, T_max=THRUST_MAX, phi_star=1.0),
        k_r_xy=1.0, k_r_z=1.0, v_max_xy=1.0, v_max_up=1.0, v_max_down=1.0,
        k_v_xy=20.0, k_v_z=20.0, k_i_xy=20.0, k_i_z=20.0, k_d_xy=20.0, k_d_z=20.0,
        thrust_margin=MARGIN / THRUST_MAX,
    )  # fmt: skip


def run(px4, params, fixed, r, v_int=ZERO):
    """(v_c, T_E, cut, tilted, v_int, roll and pitch and yaw) of a position setpoint, at rest at 0."""
    v_c = px4.commanded_velocity(params, fixed(r), ZERO)
    a_c = px4.acceleration(params, v_int, v_c, ZERO, ZERO)
    T_E, cut, tilted, after = px4.thrust(params, v_int, v_c, a_c)
    return v_c, np.array(T_E), cut, tilted, after, euler(px4.attitude_of(T_E, 0.0))


def test_position_direction(px4, basic, fixed):
    _, T_E, *_ = run(px4, basic, fixed, (0.1, 0.1, 0.1))
    assert np.all(T_E > 0.0)


@pytest.mark.parametrize("limit", [1.0, 0.5])
def test_tilt_limit(px4, basic, fixed, limit):
    params = basic._replace(limits=basic.limits._replace(phi_star=limit))
    _, T_E, _, tilted, *_ = run(px4, params, fixed, (10.0, 10.0, 0.0))
    tilt = math.acos(T_E[2] / np.linalg.norm(T_E))
    assert 0.9 * limit < tilt < limit + 1e-5
    assert tilted == 1.0


def test_velocity_limit(px4, basic, fixed):
    v_c, *_ = run(px4, basic, fixed, (10.0, 10.0, 10.0))
    assert math.hypot(v_c.x, v_c.y) == pytest.approx(1.0)
    assert v_c.z == pytest.approx(1.0)


def test_position_control_max_thrust_limit(px4, basic, fixed):
    _, T_E, cut, _, _, angles = run(px4, basic, fixed, (10.0, 10.0, 10.0))
    assert np.linalg.norm(T_E) == pytest.approx(THRUST_MAX)
    across = MARGIN / math.sqrt(2.0)
    assert T_E.tolist() == pytest.approx([across, across, math.sqrt(THRUST_MAX**2 - MARGIN**2)])
    assert abs(angles.x) == pytest.approx(math.asin(across / THRUST_MAX))
    assert cut == 1.0


def test_position_control_min_thrust_limit(px4, basic, fixed):
    _, T_E, cut, tilted, _, angles = run(px4, basic, fixed, (10.0, 0.0, -10.0))
    assert np.linalg.norm(T_E) == pytest.approx(0.1)
    assert angles == pytest.approx((0.0, 1.0, 0.0), abs=1e-9)  # ahead: nose down, as far as allowed
    assert (cut, tilted) == (1.0, 1.0)


def test_idle_thrust_input(px4, basic):
    T_E, *_ = px4.thrust(basic, ZERO, ZERO, Vec3(0.0, 0.0, -100.0))
    assert tuple(T_E) == pytest.approx((0.0, 0.0, 0.1))


def test_hover_thrust(px4, basic, fixed):
    params = basic._replace(m=0.6 / G)
    _, T_E, *_ = run(px4, params, fixed, (0.0, 0.0, 0.0))
    assert tuple(T_E) == pytest.approx((0.0, 0.0, 0.6))


def test_the_integral_does_not_grow_upwards_at_a_thrust_limit(px4, basic, fixed):
    *_, v_int, _ = run(px4, basic, fixed, (0.0, 0.0, -10.0))
    assert v_int.z == 0.0
    *_, v_int, _ = run(px4, basic._replace(k_v_z=1.0), fixed, (0.0, 0.0, 0.1))  # within the limits
    assert v_int.z == pytest.approx(0.1 * 20.0 * 0.1)


def test_the_integral_across_unwinds_what_was_not_produced(px4, basic, fixed):
    """Tracking anti-windup with a gain of 2/P: e - 2/P (asked - produced), integrated."""
    v_c, T_E, _, _, v_int, _ = run(px4, basic, fixed, (10.0, 0.0, 10.0))
    produced = T_E[0] * G / 0.5
    assert 20.0 * v_c.x > produced
    assert v_int.x == pytest.approx(0.1 * 20.0 * (v_c.x - 2.0 / 20.0 * (20.0 * v_c.x - produced)))


@pytest.mark.parametrize(
    ("body", "limit_deg", "expected"),
    [
        ((0.0, 0.0, 1.0), 45.0, (0.0, 0.0, 1.0)),
        ((0.0, 0.1, 1.0), 45.0, (0.0, 0.1, 1.0)),
        ((1.0, 0.0, 0.0), 45.0, (1.0, 0.0, 1.0)),
        ((0.0, 1.0, 0.0), 45.0, (0.0, 1.0, 1.0)),
        ((1.0, 1.0, 0.1), 10.0, None),
        ((1.0, 2.0, 0.2), 10.0, None),
        ((0.0, 0.0, -1.0), 45.0, None),
        ((0.001, 0.0, -1.0), 45.0, None),
    ],
)
def test_limit_tilt(px4, body, limit_deg, expected):
    found, _ = px4.within_tilt(Vec3(*body), math.radians(limit_deg))
    assert np.linalg.norm(found) == pytest.approx(1.0)
    if expected is not None:
        assert tuple(found) == pytest.approx(tuple(np.array(expected) / np.linalg.norm(expected)))
        return
    assert math.degrees(math.acos(found.z)) == pytest.approx(limit_deg, abs=1e-4)
    assert found.x * body[1] == pytest.approx(found.y * body[0])  # it turned about no other axis


@pytest.mark.parametrize(
    ("v0", "v1", "expected"),
    [
        ((5.0, 0.0), (0.0, -5.0), (5.0, 0.0)),
        ((0.0, 0.0), (0.0, -5.0), (0.0, -5.0)),
        ((0.5, 0.5), (0.5, -0.5), (1.0, 0.0)),
        ((4.0, 0.0), (0.0, -4.0), (4.0, -3.0)),
        ((4.0, 0.0), (4.0, 0.0), (5.0, 0.0)),
    ],
)
def test_constrain_xy_priorities(px4, v0, v1, expected):
    assert px4.within(*v0, *v1, 5.0) == pytest.approx(expected)


@pytest.mark.parametrize("yaw", [0.0, 0.5 * math.pi])
def test_throttle_attitude_mapping(px4, yaw):
    angles = euler(px4.attitude_of(Vec3(0.0, 0.0, 1.0), yaw))
    assert tuple(angles) == pytest.approx((0.0, 0.0, yaw), abs=1e-12)


# --- AttitudeControlTest

QUATERNIONS = [
    (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0),
    (0.698, 0.024, -0.681, -0.220), (-0.820, -0.313, 0.225, -0.423),
    (0.599, -0.172, 0.755, -0.204), (0.216, -0.662, 0.290, -0.656),
]  # fmt: skip


def quat(rotation):
    x, y, z, w = rotation.as_quat().tolist()
    return Quat(w, x, y, z)


@pytest.mark.parametrize("start", QUATERNIONS)
@pytest.mark.parametrize("goal", QUATERNIONS)
def test_attitude_control_convergence(px4, defaults, start, goal):
    """Turned by the commanded rate for 1 s at a time, it arrives, and the rate shrinks each time."""
    params = defaults._replace(
        k_tilt=0.5, k_yaw=0.3, yaw_weight=0.4, w_max_tilt=100.0, w_max_yaw=100.0
    )
    state, target = (Rotation.from_quat([*q[1:], q[0]]) for q in (start, goal))
    rate = math.inf
    for k in range(100):
        q = quat(state)
        q = -q if k % 2 else q  # it is the same attitude
        w_c = px4.commanded_rates(params, q, quat(target), 0.0)
        if np.linalg.norm(w_c) < 1e-7:
            break
        assert np.linalg.norm(w_c) < rate
        rate = np.linalg.norm(w_c)
        state = state * Rotation.from_rotvec(w_c)
    assert (state.inv() * target).magnitude() < 1e-6


@pytest.mark.parametrize(("weight", "expected"), [(0.4, 0.28), (0.0, 0.0)])
def test_yaw_weight_scaling(px4, defaults, weight, expected):
    params = defaults._replace(k_tilt=6.5, k_yaw=2.8, yaw_weight=weight, w_max_yaw=1000.0)
    level = Quat(1.0, 0.0, 0.0, 0.0)
    w_c = px4.commanded_rates(params, level, from_euler(0.0, 0.0, 0.1), 0.0)
    assert (w_c.x, w_c.y) == (0.0, 0.0)
    assert w_c.z == pytest.approx(expected, abs=1e-4)


def test_a_rate_of_yaw_is_fed_forward_about_the_vertical(px4, defaults):
    """Tilted by 0.5 rad, the rate of 0.5 rad/s about the vertical has parts about x and z."""
    q = from_euler(0.0, 0.5, 0.0)
    w_c = px4.commanded_rates(defaults, q, q, 0.5)
    assert tuple(w_c) == pytest.approx((-math.sin(0.5) * 0.5, 0.0, math.cos(0.5) * 0.5))


# --- rate_control_test


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_integrator_keeps_to_its_limit(px4, sign):
    value = 0.0
    for _ in range(1000):
        value = px4.integral(0.01, value, sign, 0.0, 0.3)
    assert value == pytest.approx(0.3 * sign, abs=1e-6)


def test_the_integrator_does_not_grow_where_torque_was_refused(px4):
    assert px4.integral(0.01, 0.1, 1.0, 0.2, 0.3) == 0.1
    assert px4.integral(0.01, 0.1, -1.0, 0.2, 0.3) < 0.1
    assert px4.integral(0.01, 0.1, -1.0, -0.2, 0.3) == 0.1


def test_large_errors_are_not_integrated(px4):
    """With 400 deg/s: below 10 % less at 100 deg/s, 25 % less at 200, nothing at 400."""
    gain = [
        px4.integral(1.0, 0.0, math.radians(e), 0.0, 100.0) / math.radians(e)
        for e in (100, 200, 400)
    ]
    assert gain == pytest.approx([0.9375, 0.75, 0.0])


# --- the translation of gains


def test_the_unit_of_torque_is_that_of_px4s_allocator(defaults):
    """On the octocopter: f_max sqrt(n/2)/|B| with |B| = 1/(r sqrt(n/2)), and f_max n k_Q."""
    f_max = 8.2e-5 * 552.2**2
    tilt, yaw = f_max * 2.0 * 0.5225 * 2.0, f_max * 8.0 * 0.0159
    assert tuple(defaults.torque_unit) == pytest.approx((tilt, tilt, yaw), rel=1e-9)
    loop = 0.15 * defaults.torque_unit.x / 0.3245
    assert loop == pytest.approx(24.0, rel=0.01)  # 1/s, of roll and pitch


def test_a_tick_remembers_what_it_measured_and_its_integrals(px4, defaults, fixed, hover):
    measured = hover(v=(0.3, -0.2, 0.1), w=(0.05, -0.04, 0.03))
    state = px4.take_over(defaults, fixed((1.0, 2.0, 3.0)), measured)[0]
    state, *_ = px4.step(state, defaults, fixed((1.0, 2.0, 3.0)), measured)
    after, _, _, told = px4.step(state, defaults, fixed((1.0, 2.0, 3.0)), measured)
    assert (after.v_E, after.w_B) == (measured.v_E, measured.w_B)
    a_c = px4.acceleration(defaults, state.v_int, told.v_c - measured.v_E, ZERO, ZERO)
    *_, v_int = px4.thrust(defaults, state.v_int, told.v_c - measured.v_E, a_c)
    assert after.v_int == pytest.approx(v_int)
    assert after.v_int != state.v_int
