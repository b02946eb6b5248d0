"""Thrust and torque to rotors and back; what gives way first; the inverted lag."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fcu.interface.airframe import airframe
from fcu.kernel.algebra import Rotors, Vec3, inverse8, total
from fcu.laws import allocation
from fcu.laws.actuation import rotor_lag
from fcu.laws.allocation import rotor_mean


def achieved(rotors, f):
    """Thrust and torque of rotor thrusts."""
    T, tau = allocation.achieved(rotors, inverse8(rotors.c_T) * f)
    return T, np.array(tau)


@pytest.fixture(scope="module")
def rotors(law):
    return law().rotors


@settings(max_examples=200, deadline=None)
@given(
    T=st.floats(60.0, 140.0),
    roll=st.floats(-5.0, 5.0),
    pitch=st.floats(-5.0, 5.0),
    yaw=st.floats(-0.3, 0.3),
)
def test_inside_the_limits_the_rotors_do_what_is_asked(rotors, T, roll, pitch, yaw):
    f, gave_up = allocation.allocate(rotors, T, Vec3(roll, pitch, yaw))
    T_achieved, tau = achieved(rotors, f)
    assert gave_up == (0.0, 0.0)
    assert T_achieved == pytest.approx(T, abs=1e-9)
    np.testing.assert_allclose(tau, (roll, pitch, yaw), atol=1e-9)


@settings(max_examples=500, deadline=None)
@given(
    T=st.floats(-100.0, 400.0),
    roll=st.floats(-60.0, 60.0),
    pitch=st.floats(-60.0, 60.0),
    yaw=st.floats(-20.0, 20.0),
)
@pytest.mark.computes
def test_the_priority_is_roll_and_pitch_then_thrust_then_yaw(rotors, T, roll, pitch, yaw):
    demanded = np.array([roll, pitch, yaw])
    f, gave_up = allocation.allocate(rotors, T, Vec3(roll, pitch, yaw))
    low, high = rotors.f_min, rotors.f_max
    assert low <= min(f)
    assert max(f) <= high
    T_achieved, tau = achieved(rotors, f)

    # roll and pitch: kept whenever their spread fits, else both by one factor
    tilting = np.array(allocation.tilted(rotors, T, Vec3(roll, pitch, yaw)))
    k_tilt = min(1.0, (high - low) / max(np.ptp(tilting), 1e-9))
    np.testing.assert_allclose(tau[:2], k_tilt * demanded[:2], atol=1e-8)

    # thrust: as near as roll and pitch leave room for
    tilting = k_tilt * tilting
    nearest = np.clip(T, 8.0 * (low - tilting.min()), 8.0 * (high - tilting.max()))
    assert T_achieved == pytest.approx(nearest, abs=1e-8)

    # yaw: the asked direction, never more than asked, and all of it if it fits
    assert tau[2] * yaw >= -1e-8
    assert abs(tau[2]) <= abs(yaw) + 1e-8
    whole = nearest / 8.0 + tilting + yaw * np.array(rotors.B_z)
    if whole.min() > low + 1e-9 and whole.max() < high - 1e-9:
        assert tau[2] == pytest.approx(yaw, abs=1e-8)

    shortfall = max(abs(T_achieved - T), np.abs(tau - demanded).max())
    if shortfall > 1e-6:
        assert 1.0 in (gave_up.torque, gave_up.yaw) or not 8.0 * low <= T <= 8.0 * high
    if np.abs(tau[:2] - demanded[:2]).max() > 1e-6:
        assert gave_up.torque == 1.0
    if abs(tau[2] - yaw) > 1e-6:
        assert gave_up.yaw == 1.0


def test_a_demand_beyond_every_limit_gives_up_yaw_first_then_thrust(rotors):
    f, gave_up = allocation.allocate(rotors, 190.0, Vec3(10.0, 0.0, 5.0))
    T, tau = achieved(rotors, f)
    assert gave_up == (1.0, 1.0)
    assert tau[0] == pytest.approx(10.0, abs=1e-9)
    assert 100.0 < T < 190.0
    assert tau[2] < 1.0


def test_no_yaw_is_given_up_where_none_is_asked_for(rotors):
    full = 8.0 * rotors.f_max
    assert allocation.allocate(rotors, full, Vec3(0.0, 0.0, 0.0))[1].yaw == 0.0
    assert allocation.allocate(rotors, full, Vec3(0.0, 0.0, 0.1))[1].yaw == 1.0


@pytest.mark.parametrize("name", ["B_x", "B_y", "B_z"])
def test_a_unit_torque_is_about_its_own_axis_and_lifts_nothing(rotors, name):
    thrust, tau = achieved(rotors, getattr(rotors, name))
    assert thrust == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(tau, np.eye(3)["xyz".index(name[-1])], atol=1e-12)


def test_full_speed_is_25_newtons_a_rotor(rotors):
    thrust, tau = allocation.achieved(rotors, Rotors(*[552.2**2] * 8))
    assert thrust == pytest.approx(200.0, abs=0.1)
    np.testing.assert_allclose(tau, (0.0, 0.0, 0.0), atol=1e-9)


def test_rotors_at_the_wanted_speed_are_told_to_stay(rotors):
    f = Rotors(5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0)
    Omega = np.sqrt(np.array(f) / np.array(rotors.c_T))
    u = allocation.speed_command(rotors, f, Rotors(*Omega.tolist()))
    np.testing.assert_allclose(np.array(u) * np.array(rotors.Omega_max), Omega, rtol=1e-14)


def test_the_inverted_lag_answers_in_the_chosen_time_not_in_its_own(law):
    """A 50 ms rotor at 500 Hz: after 10 ms, a third of the gap is left instead of four fifths."""
    rotors = law(rotor_lag_s=0.05, rotor_response_s=0.01).rotors
    wanted, start, decay = 320.0, 300.0, math.exp(-0.002 / 0.05)
    thrusts = wanted**2 * rotors.c_T
    Omega = Rotors(*[start] * 8)
    for _ in range(5):
        told = rotors.Omega_max * allocation.speed_command(rotors, thrusts, Omega)
        Omega = told + decay * (Omega - told)
    left = (wanted - Omega.r1) / (wanted - start)
    assert left == pytest.approx(math.exp(-1.0), abs=0.04)


def test_commands_stay_between_stop_and_full_speed(rotors):
    stopped, full = Rotors(*[0.0] * 8), rotors.Omega_max
    strong, weak = Rotors(*[rotors.f_max] * 8), Rotors(*[rotors.f_min] * 8)
    assert allocation.speed_command(rotors, strong, stopped) == Rotors(*[1.0] * 8)
    assert allocation.speed_command(rotors, weak, full) == Rotors(*[0.0] * 8)


@pytest.mark.parametrize(("h", "lag"), [(0.002, 0.05), (0.004, 0.02), (0.01, 0.01), (0.002, 10.0)])
def test_the_weights_of_a_tick_give_the_mean_of_a_first_order_lag(h, lag):
    """Weighted ends against the mean of the lag between them, sampled finely."""
    start, told = 300.0, 350.0
    t = (np.arange(100_000) + 0.5) * h / 100_000
    mean = np.mean(told + (start - told) * np.exp(-t / lag))
    end = told + (start - told) * math.exp(-h / lag)
    w = rotor_mean(h, lag)
    assert w * start + (1.0 - w) * end == pytest.approx(mean, abs=1e-5)


def test_a_rotor_without_lag_has_one_speed_in_a_tick(law):
    rotors = law(rotor_lag_s=0.0).rotors
    before, now = Rotors(*[100.0] * 8), Rotors(*[300.0] * 8)
    assert allocation.mean_squares(rotors, before, now) == Rotors(*[9e4] * 8)
    uneven = Rotors(300.0, *[0.0] * 7)
    assert allocation.mean_omega_m(rotors, before, uneven) == 300.0
    assert rotors.kappa == 1.0


@pytest.mark.parametrize("lag", [0.0005, 0.002, 0.02, 0.05, 0.3])
def test_a_lag_that_is_read_off_and_written_again_does_not_drift(law, lag):
    """It is the least of those that give a tick's weight to the bit."""
    params = law(rotor_lag_s=lag)
    found = rotor_lag(params)
    assert rotor_mean(params.h, found) == params.rotors.mean
    assert rotor_lag(law(rotor_lag_s=found)) == found


# --- of any airframe

SPIN = {4: [1, 1, -1, -1], 5: [1, -1, 1, -1, 1], 6: [1, -1, 1, -1, 1, -1], 8: [1, -1] * 4}
COMMON = {
    "thrust_coefficient": 1e-5, "torque_to_thrust_m": 0.016, "full_speed_rad_s": 1000.0,
    "lag_s": 0.03, "inertia_kg_m2": 1e-5,
}  # fmt: skip
CORNERS = [[0.2, -0.2], [-0.2, 0.2], [0.2, 0.2], [-0.2, -0.2]]
VEHICLES = {
    "quad": {"position_m": CORNERS, "spin": SPIN[4]},
    "ahead": {"position_m": [[x + 0.03, y] for x, y in CORNERS], "spin": SPIN[4]},
    "hexa": {"angle_deg": [30, 90, 150, 210, 270, 330], "radius_m": 0.3, "spin": SPIN[6]},
    "x8": {
        "position_m": [*([*c, 0.05] for c in CORNERS), *([*c, -0.05] for c in CORNERS)],
        "spin": [1, 1, -1, -1, -1, -1, 1, 1],
        "thrust_coefficient": [1e-5] * 4 + [0.8e-5] * 4,
    },
    "mixed": {
        "angle_deg": [0, 60, 120, 180, 240, 300], "radius_m": 0.3, "spin": SPIN[6],
        "full_speed_rad_s": [1000.0, 1000.0, 1000.0, 900.0, 1000.0, 1000.0],
    },
}  # fmt: skip


@pytest.fixture(params=VEHICLES, scope="module")
def any_rotors(request):
    made = airframe({**COMMON, **VEHICLES[request.param]})
    rotors = allocation.believed_rotors(made, 0.002, 0.03, f_min=math.nan, kappa=3.0)
    return rotors._replace(f_min=0.5)


@settings(max_examples=100, deadline=None)
@given(
    part=st.floats(0.3, 0.6),
    roll=st.floats(-0.5, 0.5),
    pitch=st.floats(-0.5, 0.5),
    yaw=st.floats(-0.02, 0.02),
)
@pytest.mark.computes
def test_rotors_of_any_airframe_do_what_is_asked(any_rotors, part, roll, pitch, yaw):
    T = part * any_rotors.W * any_rotors.f_max
    for safe in (1.0, 0.0):
        f, gave_up = allocation.allocate(any_rotors._replace(safe=safe), T, Vec3(roll, pitch, yaw))
        T_achieved, tau = achieved(any_rotors, f)
        assert gave_up == (0.0, 0.0)
        assert T_achieved == pytest.approx(T, abs=1e-9)
        np.testing.assert_allclose(tau, (roll, pitch, yaw), atol=1e-9)


@settings(max_examples=200, deadline=None)
@given(
    T=st.floats(-100.0, 300.0),
    tau=st.tuples(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0), st.floats(-5.0, 5.0)),
    safe=st.sampled_from([0.0, 1.0]),
)
@pytest.mark.computes
def test_rotors_of_any_airframe_keep_to_their_own_limits(any_rotors, T, tau, safe):
    rotors = any_rotors._replace(safe=safe)
    f, _ = allocation.allocate(rotors, T, Vec3(*tau))
    full = np.array(rotors.c_T) * np.array(rotors.Omega_max) ** 2
    assert (np.array(f) <= full + 1e-9).all()
    assert (np.array(f) >= rotors.f_min * np.array(rotors.w) - 1e-9).all()
    u = np.array(allocation.speed_command(rotors, f, Rotors(*[100.0] * 8)))
    absent = np.array(rotors.spin) == 0.0
    assert (np.array(f)[absent] == 0.0).all()
    assert (u[absent] == 0.0).all()
    assert np.isfinite(u).all()


def test_an_absent_rotor_gives_up_nothing_of_yaw():
    """At the greatest thrust but one newton there is room for a little torque about yaw."""
    quad = airframe({**COMMON, **VEHICLES["quad"]})
    rotors = allocation.believed_rotors(quad, 0.002, 0.03, f_min=0.5, kappa=3.0)
    tau = Vec3(0.0, 0.0, 0.01)
    f, gave_up = allocation.allocate(rotors, rotors.W * rotors.f_max - 1.0, tau)
    assert gave_up == (0.0, 0.0)
    assert achieved(rotors, f)[1][2] == pytest.approx(0.01, abs=1e-9)


def test_in_hover_a_rotor_nearer_to_the_centre_of_mass_carries_more():
    """Two in front at 0.23 m and two behind at 0.17 m: 17 to 23."""
    ahead = airframe({**COMMON, **VEHICLES["ahead"]})
    rotors = allocation.believed_rotors(ahead, 0.002, 0.03, f_min=0.5, kappa=3.0)
    f, _ = allocation.allocate(rotors, 20.0, Vec3(0.0, 0.0, 0.0))
    front, rear = 20.0 * 0.17 / 0.8, 20.0 * 0.23 / 0.8
    np.testing.assert_allclose(np.array(f)[:4], [front, rear, front, rear], rtol=1e-12)
    assert total(f) == pytest.approx(20.0, rel=1e-12)


def test_weights_of_a_symmetric_vehicle_are_one_to_the_bit(rotors):
    assert rotors.w == Rotors(*[1.0] * 8)
    assert (rotors.W, rotors.n) == (8.0, 8)


def test_plain_allocation_cuts_each_rotor_by_itself(rotors):
    """Where the safe one keeps roll and lowers thrust, the plain one gives part of both."""
    plain, asked = rotors._replace(safe=0.0), Vec3(10.0, 0.0, 0.0)
    f, gave_up = allocation.allocate(plain, 190.0, asked)
    T, tau = achieved(rotors, f)
    assert gave_up == (1.0, 0.0)
    whole = 190.0 / 8.0 + 10.0 * np.array(rotors.B_x)
    np.testing.assert_allclose(np.array(f), np.clip(whole, rotors.f_min, rotors.f_max), rtol=1e-12)
    safe_T, safe_tau = achieved(rotors, allocation.allocate(rotors, 190.0, asked)[0])
    assert safe_T < T
    assert tau[0] < safe_tau[0]
    _, gave_up = allocation.allocate(plain, 100.0, Vec3(0.0, 0.0, 5.0))
    assert gave_up == (0.0, 1.0)
