"""Yaw, the weak axis: a rate of yaw that the vehicle can stop from."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.kernel.algebra import Vec3
from fcu.kernel.rotations import from_euler
from fcu.laws.mmrac import attitude
from fcu.laws.mmrac import law as mmrac


def test_a_small_error_is_closed_in_proportion(law):
    """Below a/c^2, 0.0125 rad, nothing is cut, to the bit."""
    params = law()
    for e in (0.0, 1e-3, -0.004, 0.0124):
        assert attitude.yaw_rate(params, e, 0.25) == (0.25 + 10.0 * e, 0.0)


def test_a_large_error_is_closed_at_a_rate_that_can_be_stopped(law):
    """A square root of the error: along it yaw slows down at the believed acceleration."""
    params = law()._replace(yaw_rate_max=100.0)
    knee = params.yaw_acceleration / 10.0**2
    rate, limited = attitude.yaw_rate(params, knee, 0.0)
    assert rate == pytest.approx(10.0 * knee)  # joins the straight part
    for e in (0.02, 0.3, 2.0):
        rate, limited = attitude.yaw_rate(params, e, 0.0)
        nearer, _ = attitude.yaw_rate(params, e - 1e-6, 0.0)
        assert limited == 1.0
        assert rate * (rate - nearer) / 1e-6 == pytest.approx(params.yaw_acceleration, rel=1e-4)
        assert attitude.yaw_rate(params, -e, 0.0) == (-rate, 1.0)


def test_the_rate_of_yaw_stays_within_its_limit_with_the_setpoints_own(law):
    params = law()
    assert attitude.yaw_rate(params, 3.0, 0.5) == (params.yaw_rate_max, 1.0)
    assert attitude.yaw_rate(params, 0.0, -4.0) == (-params.yaw_rate_max, 1.0)
    assert attitude.yaw_rate(params, 0.0, 1.0) == (1.0, 0.0)


def test_as_printed_there_is_no_limit_and_a_limit_shows(law, hover, fixed):
    printed = law(prediction="demanded")
    level, there = attitude.measured(from_euler(0.0, 0.0, 0.0)), Vec3(0.0, 0.0, 2.0)
    turn = attitude.demanded(printed, level, there, 0.5)
    assert (turn.w_c.z, turn.yaw_cut) == (20.5, 0.0)
    for prediction, flag in (("demanded", 0.0), ("achieved", 1.0)):
        params = law(prediction=prediction)
        _, _, outputs, internals = mmrac.take_over(params, fixed(psi=1.5), hover())
        assert internals.flags.yaw_rate == flag
        assert outputs.w_c.z > 1.0


def test_the_short_way_round_at_the_limit(law, hover, fixed):
    measured = hover(angles=(0.0, 0.0, 3.0))
    _, _, outputs, _ = mmrac.take_over(law(), fixed(psi=-3.0), measured)
    assert 0.0 < outputs.w_c.z < 1.5


@pytest.mark.parametrize("rate_hz", [250.0, 500.0, 1000.0])
@pytest.mark.parametrize("wind", [False, True])
@pytest.mark.parametrize("degrees", [90.0, -30.0, 179.0])
@pytest.mark.computes
def test_a_step_in_yaw_does_not_swing_on(flight, fixed, rate_hz, wind, degrees):
    """Departure 16. Without it 90 degrees overshoot by 48 (in still air), 179 cost 1.3 m."""
    here, there = fixed((0.0, 0.0, 10.0)), fixed((0.0, 0.0, 10.0), math.radians(degrees))
    rows = flight([(0.0, here), (3.0, there)], 6.0, rate_hz, wind)
    after = rows[rows["t"] > 3.0]
    psi = np.degrees(np.unwrap(after["outputs"]["angles"]["z"])) * math.copysign(1.0, degrees)
    assert psi.max() < abs(degrees) + 1.0
    assert psi[-1] == pytest.approx(abs(degrees), abs=0.3)
    e_r = after["outputs"]["e_r"]
    assert np.sqrt(e_r["x"] ** 2 + e_r["y"] ** 2 + e_r["z"] ** 2).max() < 0.06


def test_a_vehicle_told_to_turn_turns_at_that_rate(flight, fixed):
    """Once it has caught up with the yaw it fell behind while getting up to speed."""
    here = fixed((0.0, 0.0, 10.0))
    rows = flight([(0.0, here), (2.0, here._replace(psi_dot_c=1.0))], 10.0)
    late = rows[rows["t"] > 5.0]
    assert late["measured"]["w_B"]["z"] == pytest.approx(np.ones(len(late)), abs=0.01)
    assert not late["internals"]["flags"]["yaw_rate"].any()
    psi = np.unwrap(late["outputs"]["angles"]["z"])
    assert psi[-1] - psi[0] == pytest.approx(late["t"][-1] - late["t"][0], abs=1e-3)
