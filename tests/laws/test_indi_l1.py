"""INDI and L1 flown with a rigid body: levels, steps, pushes, and defaults of an airframe of any size."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.kernel.algebra import Vec3
from tests.laws.conftest import OCTO
from tests.laws.yardstick import at, flown, fly, hovering, small

LAWS = ["indi", "l1"]
W = 8.0 * 9.81


@pytest.fixture(scope="module", params=LAWS)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def law(name):
    return flown(name, OCTO)


def test_a_force_that_pulls_down_never_turns_it_over(law):
    _, _, outputs, _ = law.face.take_over(law.params, at(z=-1000.0), hovering(law.params))
    assert outputs.angles_c[:2] == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(("phi", "theta", "way"), [(0.1, 0.0, (0.0, -1.0)), (0.0, 0.1, (1.0, 0.0))])
@pytest.mark.computes
def test_an_attitude_is_taken_and_pushes_that_way(law, phi, theta, way):
    lying = at()._replace(level=1.0, tilt_c=Vec3(phi, theta, 0.0), T_c=W / math.cos(0.1))
    rows = fly(law, lying, 1.5)
    measured, _, outputs, _ = rows[-1]
    assert outputs.angles == pytest.approx((phi, theta, 0.0), abs=0.002)
    gained = np.array(measured.v_E) - np.array(rows[-101][0].v_E)
    assert gained[:2] == pytest.approx(9.81 * math.tan(0.1) * 0.2 * np.array(way), abs=0.01)


@pytest.mark.parametrize(("axis", "rate"), [("x", 0.3), ("y", -0.3), ("z", 0.3)])
@pytest.mark.computes
def test_a_body_rate_is_taken(law, axis, rate):
    turning = at()._replace(level=2.0, w_c=Vec3(0.0, 0.0, 0.0)._replace(**{axis: rate}), T_c=W)
    measured, _, _, _ = fly(law, turning, 1.5)[-1]
    assert getattr(measured.w_B, axis) == pytest.approx(rate, rel=0.02)


@pytest.mark.parametrize("light", [False, True])
@pytest.mark.parametrize("rate_hz", [250.0, 500.0])
@pytest.mark.computes
def test_with_its_defaults_a_vehicle_of_any_size_settles_at_a_step(name, light, rate_hz):
    """Three metres aside, two up and a quarter turn, with gains that follow from the airframe."""
    law = flown(name, small(OCTO) if light else OCTO, rate_hz)
    rows = fly(law, at(3.0, -1.0, 2.0, psi=0.5 * math.pi), 7.0, lag=0.02 if light else 0.05)
    r = np.array([row[0].r_E for row in rows])
    late = r[round(6.0 * rate_hz) :] - (3.0, -1.0, 2.0)
    assert np.abs(late).max() < 0.01
    assert (r.max(axis=0) < np.array([3.0, 0.02, 2.0]) + 0.3).all()  # overshoot
    assert rows[-1][2].angles.z == pytest.approx(0.5 * math.pi, abs=0.01)


@pytest.mark.computes
def test_a_steady_push_upwards_and_a_torque_leave_no_error(law):
    """The force is a fifth of the weight, the torque a twentieth of that about roll in hover."""
    rows = fly(law, at(), 6.0, lambda t: (Vec3(0.0, 0.0, 0.2 * W), Vec3(1.0, -1.0, 0.1)))
    measured, _, outputs, _ = rows[-1]
    assert np.abs(measured.r_E).max() < 0.002
    assert np.abs(outputs.angles).max() < 0.002
