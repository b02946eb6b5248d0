"""What every shipped law has to do that is not the paper's: signs, hover, levels, limits and flags."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fcu.interface.airframe import airframe
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import to_buffer
from fcu.kernel.rotations import from_euler
from fcu.laws import loader, parameters
from tests.laws.conftest import OCTO
from tests.laws.values import TILTS

LAWS = ["px4", "se3", "indi", "l1"]
W = 8.0 * 9.81
HERE = (0.0, 0.0, 10.0)


@pytest.fixture(params=LAWS)
def name(request):
    return request.param


@pytest.fixture
def face(name):
    return loader.load(name).face


@pytest.fixture
def params(name, believed):
    return loader.load(name).settings.settings(believed, OCTO, 500.0).law


@pytest.fixture
def first(face, params):
    """Outputs, internals and rotor commands of a take-over."""

    def fly(setpoint, measured):
        _, command, outputs, internals = face.take_over(params, setpoint, measured)
        return outputs, internals, np.array(command.u)

    return fly


def lying(setpoint, phi=0.0, theta=0.0, T=W):
    return setpoint._replace(level=1.0, tilt_c=Vec3(phi, theta, 0.0), T_c=T)


def turning(setpoint, p=0.0, q=0.0, r=0.0, T=W):
    return setpoint._replace(level=2.0, w_c=Vec3(p, q, r), T_c=T)


def test_a_yardstick_hovers_at_its_setpoint(first, fixed, hover):
    outputs, internals, u = first(fixed(), hover())
    assert outputs.T_c == pytest.approx(W)
    assert outputs.T_achieved == pytest.approx(W)
    assert tuple(internals.tau_c) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert u == pytest.approx(np.full(8, math.sqrt(W / 8.0 / 8.2e-5) / 552.2))
    assert not any(outputs.saturation)


def test_the_first_tick_is_finite_at_every_level(face, params, fixed, hover):
    here = fixed((1.0, -2.0, 3.0), 1.0)
    for setpoint in (here, lying(here, 0.2, -0.1), turning(here, 0.3, 0.2, 0.1)):
        measured = hover((0.1, 0.2, 0.3), (1.0, -1.0, 0.5), (0.1, -0.2, 2.0), (0.1, 0.2, 0.3))
        state, command, outputs, internals = face.take_over(params, setpoint, measured)
        for value in (state, internals, command):
            assert np.isfinite(to_buffer(value)).all()
        for key in set(outputs._fields) - {"reference", "e_r"}:  # NaN: it has no reference
            assert np.isfinite(np.array(getattr(outputs, key))).all(), key


@pytest.mark.parametrize(("psi", "r_c", "phi_sign", "theta_sign"), TILTS)
def test_tilt_is_towards_the_setpoint_whatever_the_heading(
    first, fixed, hover, psi, r_c, phi_sign, theta_sign
):
    outputs, internals, _ = first(fixed(r_c, psi), hover(angles=(0.0, 0.0, psi)))
    phi_c, theta_c, _ = outputs.angles_c
    for angle, sign, torque in zip(
        (phi_c, theta_c), (phi_sign, theta_sign), internals.tau_c[:2], strict=True
    ):
        assert angle * sign > 0.05 if sign else abs(angle) < 1e-9
        assert torque * sign > 0.1 if sign else abs(torque) < 1e-9


def test_the_rotors_that_speed_up_are_the_right_ones(first, fixed, hover, believed):
    x, y, spin = (np.array(row) for row in (believed.x, believed.y, believed.spin))
    *_, ahead = first(fixed((0.5, 0.0, 0.0)), hover())
    assert ahead[x < 0.0].min() > ahead[x > 0.0].max()  # the rear lifts
    *_, right = first(fixed((0.0, -0.5, 0.0)), hover())
    assert right[y > 0.0].min() > right[y < 0.0].max()  # the left lifts
    *_, left_about = first(fixed(psi=0.1), hover())
    assert left_about[spin < 0.0].min() > left_about[spin > 0.0].max()  # the clockwise ones
    *_, up = first(fixed((0.0, 0.0, 0.2)), hover())
    *_, hold = first(fixed(), hover())
    assert np.all(up > hold)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("rate", [0.2, -0.2])
def test_torque_opposes_a_body_rate(first, fixed, hover, axis, rate):
    w = np.zeros(3)
    w[axis] = rate
    _, internals, _ = first(fixed(), hover(w=w))
    assert internals.tau_c[axis] * rate < 0.0


def test_velocity_and_acceleration_of_the_setpoint_are_fed_forward(name, first, fixed, hover):
    """At the setpoint, moving with it: the acceleration asked for is the setpoint's, and no other."""
    moving = fixed()._replace(v_c=Vec3(1.0, 0.5, 0.2), a_c=Vec3(0.8, -0.6, 0.4))
    outputs, *_ = first(moving, hover(v=(1.0, 0.5, 0.2)))
    phi_c, theta_c, psi_c = outputs.angles_c
    axis = Rotation.from_euler("ZYX", [psi_c, theta_c, phi_c]).as_matrix()[:, 2]
    a_x, a_y, a_z = 0.8, -0.6, 0.4
    if name == "indi":  # it has a gain of the error of acceleration, 0.5 and 0.3 upwards
        a_x, a_y, a_z = 1.5 * a_x, 1.5 * a_y, 1.3 * a_z
    g = 9.81 if name == "px4" else 9.81 + a_z  # PX4 leaves a_z out of the direction
    np.testing.assert_allclose(axis[:2] / axis[2], (a_x / g, a_y / g), rtol=1e-6)
    assert outputs.T_c == pytest.approx(8.0 * (9.81 + a_z), rel=0.01)


def test_a_turning_yaw_setpoint_is_turned_with(first, fixed, hover):
    outputs, *_ = first(fixed()._replace(psi_dot_c=0.3), hover())
    assert tuple(outputs.w_c) == pytest.approx((0.0, 0.0, 0.3), abs=1e-9)


def test_turned_with_the_world_it_does_the_same(face, params, fixed, hover):
    """Yaw equivariance: rotor commands do not know where east is."""
    rng = np.random.default_rng(4)
    for _ in range(20):
        r, v, w = rng.normal(size=(3, 3))
        angles, psi = rng.uniform(-0.4, 0.4, 3), rng.uniform(-3.0, 3.0)
        turn = Rotation.from_euler("z", psi)
        plain = face.take_over(params, fixed(), hover(r, v, angles, w))
        turned = face.take_over(
            params,
            fixed(psi=psi),
            hover(turn.apply(r), turn.apply(v), np.add(angles, (0.0, 0.0, psi)), w),
        )
        np.testing.assert_allclose(plain[1].u, turned[1].u, atol=1e-9)


# --- levels


def test_levels_enter_the_cascade_where_they_say(first, fixed, hover):
    here = fixed((5.0, 5.0, 5.0), 0.2)
    outputs, *_ = first(lying(here, 0.1, -0.2, 60.0), hover(angles=(0.1, -0.2, 0.2)))
    assert tuple(outputs.angles_c) == pytest.approx((0.1, -0.2, 0.2))
    assert tuple(outputs.w_c) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert outputs.T_c == 60.0
    outputs, internals, _ = first(turning(here, 0.3, -0.2, 0.1, 90.0), hover())
    assert tuple(outputs.w_c) == (0.3, -0.2, 0.1)
    assert outputs.T_c == 90.0
    assert np.sign(internals.tau_c).tolist() == [1.0, -1.0, 1.0]


def test_levels_keep_the_limits_and_say_so(first, fixed, hover):
    outputs, *_ = first(lying(fixed(), 2.0, -2.0, 500.0), hover())
    assert tuple(outputs.angles_c[:2]) == pytest.approx((0.25 * math.pi, -0.25 * math.pi))
    assert (outputs.T_c, outputs.saturation.thrust, outputs.saturation.tilt) == (200.0, 1.0, 1.0)
    outputs, *_ = first(turning(fixed(), T=-5.0), hover(angles=(1.2, 0.0, 0.0)))
    assert (outputs.T_c, outputs.saturation.thrust, outputs.saturation.tilt) == (5.0, 1.0, 0.0)


# --- limits


def test_limits_hold_whatever_is_asked_and_flags_tell_where(face, params, fixed, hover):
    """A flag is up exactly where the command is at its limit, or the rotors are."""
    rng = np.random.default_rng(8)
    seen = set()
    for _ in range(300):
        r_c = rng.normal(size=3) * rng.choice([0.1, 1.0, 30.0])
        measured = hover(
            (0, 0, 0), rng.normal(size=3), rng.uniform(-0.5, 0.5, 3), rng.normal(size=3) * 0.5
        )
        _, command, outputs, internals = face.take_over(params, fixed(r_c), measured)
        T, cut = outputs.T_c, outputs.saturation
        assert 5.0 <= T <= 200.0 + 1e-9
        assert max(abs(a) for a in outputs.angles_c[:2]) <= 0.25 * math.pi + 1e-9
        assert T not in (5.0, 200.0) or cut.thrust == 1.0
        phi_c, theta_c, _ = outputs.angles_c
        at_limit = math.acos(math.cos(phi_c) * math.cos(theta_c)) > 0.25 * math.pi - 1e-9
        assert not at_limit or cut.tilt == 1.0
        f, y, x = np.array(outputs.thrusts), np.array(params.rotors.y), np.array(params.rotors.x)
        given = np.array([(y * f).sum(), -(x * f).sum()])
        missed = not np.allclose(given, internals.tau_c[:2], atol=1e-6) or abs(f.sum() - T) > 1e-6
        assert missed == (cut.torque == 1.0)
        yaw = -0.0159 * (np.array(params.rotors.spin) * f).sum()
        assert (abs(yaw - internals.tau_c.z) > 1e-6) == (cut.yaw == 1.0)
        assert np.isfinite(command.u).all()
        seen.add(tuple(cut))
    assert all(any(flags[k] for flags in seen) for k in range(4))
    assert (0.0, 0.0, 0.0, 0.0) in seen


# --- defaults that follow from the airframe


def of_airframe(name, **changed):
    """Params of the octocopter with other inertia (times), lag (s) or torque (radius, times)."""
    rotors, vehicle = dict(OCTO["rotors"]), dict(OCTO["vehicle"])
    rotors["lag_s"] = changed.get("lag_s", rotors["lag_s"])
    rotors["radius_m"] *= changed.get("radius", 1.0)
    heavier = changed.get("inertia", 1.0)
    vehicle["inertia_kg_m2"] = [[heavier * v for v in ends] for ends in vehicle["inertia_kg_m2"]]
    tables = {**OCTO, "rotors": rotors, "vehicle": vehicle}
    return loader.load(name).settings.settings(airframe(rotors), tables, 500.0).law


def bandwidths(name, **changed):
    """Of the rate loop and of attitude about roll, 1/s."""
    params = of_airframe(name, **changed)
    if name == "indi":
        return params.K_w.x, params.K_xi.x / params.K_w.x
    if name == "l1":
        return params.k_w.x, params.k_R.x / params.k_w.x
    if name == "se3":
        return params.k_W_tilt, params.k_R_tilt / params.k_W_tilt
    J = changed.get("inertia", 1.0) * 0.3245
    return params.rate_k * params.rate_p * params.torque_unit.x / J, params.k_tilt


def test_slow_rotors_make_the_gains_slow(name):
    """A lag of 0.25 s, inverted to 50 ms: 0.4 of its inverse is 8 1/s, a seventh 2.9 1/s."""
    rates, attitude = bandwidths(name)
    slow, slower = bandwidths(name, lag_s=0.25)
    assert slow == pytest.approx(20.0 / 7.0 if name in ("indi", "l1") else 8.0)
    assert slow < 0.5 * rates
    assert slower < 0.5 * attitude


def test_scarce_torque_makes_the_gains_slow(name):
    rates, attitude = bandwidths(name)
    slow, slower = bandwidths(name, inertia=4.0)
    assert slow < 0.6 * rates
    assert slower < 0.6 * attitude


def test_plenty_of_torque_does_not_make_the_gains_faster_than_the_rotors(name):
    rates, _ = bandwidths(name, inertia=0.1)
    assert (14.0 if name in ("indi", "l1") else 30.0) < rates <= 40.0 + 1e-9
    assert of_airframe(name).m == 8.0


def test_every_gain_may_be_tuned_to_four_times_its_default_and_to_a_quarter(name, face, params):
    rows = [row for row in face.PARAMETERS if row.gain]
    assert len(rows) >= 7
    for row in rows:
        for number in row.get(params):
            assert number > 0.0, row.key
            assert row.low <= number / 4.0 and 4.0 * number <= row.high, row.key


def test_a_law_says_its_pace(name, params):
    pace = parameters.pace(loader.load(name).face, params, OCTO)
    assert pace.T_hover == pytest.approx(8.0 * 9.81)
    assert 0.5 < pace.f_m < 3.0 and 0.3 < pace.yaw_rate_max < 2.0


# --- flown


@pytest.mark.parametrize("rate_hz", [250.0, 500.0])
@pytest.mark.computes
def test_a_yardstick_holds_a_position_in_a_steady_wind(name, flight, fixed, rate_hz):
    wind = ["wind.steady_m_s=[5,-3,0]", "plant.mass_kg=7.5"]
    rows = flight([(0.0, fixed((1.0, 1.0, 2.0)))], 25.0, rate_hz, settings=wind, law=name)
    r = np.stack([rows["measured"]["r_E"][axis] for axis in "xyz"], axis=1)[rows["t"] > 23.0]
    assert np.abs(r - (1.0, 1.0, 2.0)).max() < 0.06


def test_a_quarter_turn_settles(name, flight, fixed):
    rows = flight([(0.0, fixed()), (2.0, fixed(psi=0.5 * math.pi))], 8.0, law=name)
    psi = np.degrees(rows["outputs"]["angles"]["z"])
    assert psi.max() < 90.0 + 25.0
    assert np.abs(psi[rows["t"] > 5.5] - 90.0).max() < 3.0


@pytest.mark.parametrize(("axis", "sign"), [("x", 1.0), ("x", -1.0), ("y", 1.0), ("y", -1.0)])
@pytest.mark.computes
def test_an_attitude_is_reached_and_the_rates_of_the_next_level_too(
    name, flight, fixed, axis, sign
):
    here = fixed((0.0, 0.0, 30.0))
    lies = lying(here)._replace(tilt_c=Vec3(0.0, 0.0, 0.0)._replace(**{axis: 0.2 * sign}))
    turns = turning(here)._replace(w_c=Vec3(0.0, 0.0, 0.0)._replace(**{axis: -0.3 * sign}))
    rows = flight([(0.0, here), (5.0, lies), (7.0, turns)], 8.0, law=name)
    angle, t = rows["outputs"]["angles"][axis], rows["t"]
    assert angle[np.searchsorted(t, 7.0) - 1] == pytest.approx(0.2 * sign, abs=0.02)
    late = t > 7.5
    slope = np.polyfit(t[late], angle[late], 1)[0]
    assert slope == pytest.approx(-0.3 * sign, rel=0.1)


def test_from_any_attitude_within_its_limits_it_comes_back(face, params, fixed, hover):
    """The torque about roll and pitch of a first tick turns towards level, up to 80 degrees."""
    for tilt in np.radians([20.0, 50.0, 80.0]):
        for about in np.linspace(0.0, 2.0 * math.pi, 9):
            axis = np.array([math.cos(about), math.sin(about), 0.0])
            x, y, z, w = Rotation.from_rotvec(tilt * axis).as_quat().tolist()
            measured = hover()._replace(q_EB=from_euler(0.0, 0.0, 0.0)._replace(w=w, x=x, y=y, z=z))
            _, _, _, internals = face.take_over(params, fixed(), measured)
            assert np.dot(internals.tau_c, axis) < 0.0
