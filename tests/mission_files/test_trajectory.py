"""What a mission tells the vehicle over time."""

import math

import numpy as np
import pytest

from fcu.kernel.algebra import Vec3
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.trajectory import (
    last_change_s,
    positions_at,
    setpoint_at,
    setpoint_times,
)

EIGHT = {"kind": "figure_eight", "centre_m": [1.0, 2.0, 3.0], "size_m": [24.0, 12.0]}


def flight(**keys):
    return Flight.model_validate({"duration_s": 40.0, **keys})


def steps(*times, **keys):
    return flight(setpoints=[[t, float(i), 0.0, 0.0] for i, t in enumerate(times)], **keys)


@pytest.mark.parametrize("rate", [100, 250, 400, 500, 625, 1000])
def test_a_step_is_sent_at_the_first_tick_at_or_after_its_time_and_holds_there(rate):
    told = steps(0.0, 5.0, 7.0011, rate_hz=rate)
    sent = setpoint_times(told)
    assert sent == [0, math.ceil(5.0 * rate), math.ceil(7.0011 * rate)]
    for i, k in enumerate(sent[1:], start=1):
        assert setpoint_at(told, (k - 1) / rate).r_c.x == i - 1
        assert setpoint_at(told, k / rate).r_c.x == i


@pytest.mark.parametrize(
    "told",
    [steps(0.0, 5.0, 7.0011), flight(curve={**EIGHT, "period_s": 7.0})],
    ids=["steps", "curve"],
)
def test_positions_of_many_times_are_those_of_each(told):
    t = np.arange(4000) / 400.0
    each = np.array([setpoint_at(told, float(time_s)).r_c for time_s in t])
    np.testing.assert_allclose(positions_at(told, t), each, rtol=0.0, atol=1e-12)


def test_a_step_rests():
    assert setpoint_at(steps(0.0, 5.0), 6.0)[1:5] == (Vec3(0, 0, 0), Vec3(0, 0, 0), 0.0, 0.0)


def test_settling_counts_from_the_last_step_and_for_a_curve_from_the_start():
    assert last_change_s(steps(0.0, 5.0, 9.0)) == 9.0
    assert last_change_s(flight(curve={**EIGHT, "period_s": 20.0})) == 0.0


def test_a_moving_setpoint_is_streamed_evenly_and_only_while_the_flight_lasts():
    told = steps(
        0.0, 5.005, rate_hz=500, stream_hz=50, yaw={"amplitude_rad": 0.5, "frequency_rad_s": 0.5}
    )
    sent = setpoint_times(told)
    assert sent == sorted({*range(0, 20000, 10), 2503})
    uneven = setpoint_times(flight(rate_hz=125, stream_hz=50, curve={**EIGHT, "period_s": 20.0}))
    assert set(np.diff(uneven)) == {2, 3}
    assert len(uneven) == 40 * 50


def test_yaw_starts_as_the_vehicle_stands_unless_told():
    standing = {"yaw_deg": 90.0}
    assert setpoint_at(steps(0.0, start=standing), 1.0).psi_c == math.radians(90.0)
    assert setpoint_at(steps(0.0, start=standing, yaw_deg=0.0), 1.0).psi_c == 0.0


def test_a_swinging_yaw_carries_its_own_rate():
    told = steps(0.0, yaw={"amplitude_rad": 0.5, "frequency_rad_s": 0.5}, yaw_deg=10.0)
    assert setpoint_at(told, 0.0).psi_c == math.radians(10.0)
    slope = (setpoint_at(told, 3.001).psi_c - setpoint_at(told, 2.999).psi_c) / 0.002
    assert setpoint_at(told, 3.0).psi_dot_c == pytest.approx(slope, abs=1e-7)


@pytest.mark.parametrize("ramp_s", [0.0, 4.0])
def test_velocity_and_acceleration_of_the_eight_are_its_derivatives(ramp_s):
    told = flight(curve={**EIGHT, "speed_max_m_s": 5.0, "ramp_s": ramp_s})
    h = 1e-4
    for t in np.arange(0.05, 39.0, 0.37):
        before, here, after = (setpoint_at(told, t + d) for d in (-h, 0.0, h))
        v = (np.array(after.r_c) - np.array(before.r_c)) / (2.0 * h)
        a = (np.array(after.v_c) - np.array(before.v_c)) / (2.0 * h)
        assert here.v_c == pytest.approx(v, abs=1e-6)
        assert here.a_c == pytest.approx(a, abs=1e-6)


def test_the_eight_begins_at_its_centre_from_rest():
    at_0 = setpoint_at(flight(curve={**EIGHT, "speed_max_m_s": 5.0, "ramp_s": 4.0}), 0.0)
    assert at_0.r_c == (1.0, 2.0, 3.0)
    assert at_0.v_c == (0.0, 0.0, 0.0)
    assert at_0.a_c == (0.0, 0.0, 0.0)


def test_the_eight_has_the_size_and_the_speed_asked_for():
    told = flight(curve={**EIGHT, "speed_max_m_s": 5.0, "ramp_s": 4.0})
    flown = [setpoint_at(told, t) for t in np.arange(0.0, 40.0, 0.002)]
    r, v = np.array([s.r_c for s in flown]), np.array([s.v_c for s in flown])
    assert np.ptp(r, axis=0) == pytest.approx([24.0, 12.0, 0.0], abs=1e-4)
    assert np.linalg.norm(v, axis=1).max() == pytest.approx(5.0, abs=1e-4)


def test_a_period_brings_the_eight_round():
    told = flight(curve={**EIGHT, "period_s": 10.0, "ramp_s": 2.0})
    assert setpoint_at(told, 15.0).r_c == pytest.approx(setpoint_at(told, 5.0).r_c, abs=1e-9)
