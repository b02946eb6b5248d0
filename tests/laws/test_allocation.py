"""Thrust and torque to eight rotors and back; what gives way first; the inverted lag."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fcu.kernel.algebra import Rotors, Vec3
from fcu.laws import allocation
from fcu.laws.allocation import rotor_mean


def achieved(rotors, f):
    """Thrust and torque of rotor thrusts."""
    T, tau = allocation.achieved(rotors, (1.0 / rotors.c_T) * f)
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
def test_the_priority_is_roll_and_pitch_then_thrust_then_yaw(rotors, T, roll, pitch, yaw):
    demanded = np.array([roll, pitch, yaw])
    f, gave_up = allocation.allocate(rotors, T, Vec3(roll, pitch, yaw))
    low, high = rotors.f_min, rotors.f_max
    assert low <= min(f)
    assert max(f) <= high
    T_achieved, tau = achieved(rotors, f)

    # roll and pitch: kept whenever their spread fits, else both by one factor
    spread = np.ptp(roll * np.array(rotors.B_x) + pitch * np.array(rotors.B_y))
    k_tilt = min(1.0, (high - low) / max(spread, 1e-9))
    np.testing.assert_allclose(tau[:2], k_tilt * demanded[:2], atol=1e-8)

    # thrust: as near as roll and pitch leave room for
    tilting = k_tilt * (roll * np.array(rotors.B_x) + pitch * np.array(rotors.B_y))
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
    Omega = np.sqrt(np.array(f) / rotors.c_T)
    u = allocation.speed_command(rotors, f, Rotors(*Omega.tolist()))
    np.testing.assert_allclose(np.array(u) * rotors.Omega_max, Omega, rtol=1e-14)


def test_the_inverted_lag_answers_in_the_chosen_time_not_in_its_own(law):
    """A 50 ms rotor at 500 Hz: after 10 ms, a third of the gap is left instead of four fifths."""
    rotors = law(rotor_lag_s=0.05, rotor_response_s=0.01).rotors
    wanted, start, decay = 320.0, 300.0, math.exp(-0.002 / 0.05)
    thrusts = Rotors(*[rotors.c_T * wanted**2] * 8)
    Omega = Rotors(*[start] * 8)
    for _ in range(5):
        told = rotors.Omega_max * allocation.speed_command(rotors, thrusts, Omega)
        Omega = told + decay * (Omega - told)
    left = (wanted - Omega.r1) / (wanted - start)
    assert left == pytest.approx(math.exp(-1.0), abs=0.04)


def test_commands_stay_between_stop_and_full_speed(rotors):
    stopped, full = Rotors(*[0.0] * 8), Rotors(*[rotors.Omega_max] * 8)
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
