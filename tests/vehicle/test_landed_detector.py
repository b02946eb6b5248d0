"""The landed detector, fed with states of vehicles in the air and on the ground."""

from __future__ import annotations

import math

import pytest

from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import to_buffer
from fcu.kernel.rotations import from_euler
from fcu.vehicle.landing import (
    HELD_FOR_US,
    LEANS_US,
    LandedDetector,
    LandedState,
    TouchdownDetector,
    resting,
    stands,
)
from fcu.vehicle.plans import Pose

C_T, WEIGHT, LOOK_US = 8.2e-5, 78.5, 20_000
STILL = Vec3(0.0, 0.0, 0.0)


def state(z, thrust, v=STILL):
    Omega = Rotors(*[math.sqrt(thrust / 8.0 / C_T)] * 8)
    return to_buffer(VehicleState(Vec3(0.0, 0.0, z), v, from_euler(0.0, 0.0, 0.0), STILL, Omega))


@pytest.fixture
def detector():
    return LandedDetector(Rotors(*[C_T] * 8), 49.0)


def looks(detector, n, *what, since_us=0):
    return [detector.see(state(*what), since_us + k * LOOK_US) for k in range(n)]


def test_the_detector_starts_on_the_ground_or_in_flight(detector):
    assert detector.see(state(0.3, 0.0), 0)
    assert not detector.has_flown
    flying = LandedDetector(Rotors(*[C_T] * 8), 49.0)
    assert not flying.see(state(20.0, WEIGHT), 0)
    assert flying.has_flown


def test_the_ground_is_where_it_has_stood_not_where_it_falls(detector):
    for k in range(50):
        t = k * LOOK_US * 1e-6
        detector.see(state(20.0 - 4.9 * t * t, 0.0, Vec3(0.0, 0.0, -9.8 * t)), k * LOOK_US)
    assert math.isnan(detector.ground)
    standing = LandedDetector(Rotors(*[C_T] * 8), 49.0)
    looks(standing, 6, 0.3, 0.0)
    assert standing.ground == 0.3


def test_a_vehicle_that_goes_up_at_once_has_left_the_ground_there(detector):
    detector.see(state(0.3, 0.0), 0)
    assert detector.see(state(0.4, 80.0, Vec3(0.0, 0.0, 0.6)), 20_000)
    assert math.isnan(detector.ground)
    assert not detector.see(state(0.5, 80.0, Vec3(0.0, 0.0, 0.9)), 40_000)
    assert detector.ground == 0.3


def test_a_vehicle_that_is_first_seen_on_its_way_up_has_left_no_ground_there(detector):
    for k in range(10):
        detector.see(state(20.0 + 0.06 * k, 0.0, Vec3(0.0, 0.0, 3.0)), k * LOOK_US)
    assert math.isnan(detector.ground)


def test_a_vehicle_that_pushes_is_on_the_ground_until_it_has_risen(detector):
    looks(detector, 5, 0.3, 0.0)
    assert all(looks(detector, 200, 0.3, 70.0))  # a script that takes its time to take off
    assert detector.see(state(0.4, 80.0, Vec3(0.0, 0.0, 0.3)), 0)
    assert not detector.see(state(0.46, 80.0, Vec3(0.0, 0.0, 0.4)), 0)


def test_hovering_low_and_long_is_not_landing(detector):
    looks(detector, 1, 0.3, 0.0)
    assert not any(looks(detector, 3000, 0.6, WEIGHT)[1:])


def test_falling_with_stopped_rotors_is_not_landing(detector):
    detector.see(state(20.0, WEIGHT), 0)
    assert not any(looks(detector, 100, 10.0, 5.0, Vec3(0.0, 0.0, -4.0)))


def test_at_rest_and_light_for_half_a_second_is_landing(detector):
    detector.see(state(20.0, WEIGHT), 0)
    looks(detector, 500, 5.0, WEIGHT)  # it learns what it weighs
    seen = looks(detector, 60, 0.3, 8.0, since_us=10_000_000)
    assert seen.index(True) * LOOK_US == HELD_FOR_US
    assert detector.has_flown


def test_a_bounce_starts_the_time_again(detector):
    detector.see(state(20.0, WEIGHT), 0)
    assert not any(looks(detector, 20, 0.3, 8.0))
    assert not detector.see(state(0.35, 60.0, Vec3(0.0, 0.0, 0.5)), 20 * LOOK_US)
    assert not any(looks(detector, 24, 0.3, 8.0, since_us=21 * LOOK_US))


@pytest.mark.parametrize(("part", "down", "lands"), [(0.6, 1.0, True), (0.6, 0.0, False), (0.95, 1.0, False)])  # fmt: skip
def test_what_has_come_down_lands_with_rotors_that_hold_it_level_on_a_slope(part, down, lands):
    """The thrust stands between that of light rotors and that of flight."""
    now = LandedState(
        T_flight=WEIGHT, since_us=math.nan, stood_at=math.nan, ground=0.0, landed=0.0, has_flown=1.0
    )
    Omega = Rotors(*[math.sqrt(part * WEIGHT / 8.0 / C_T)] * 8)
    seen = VehicleState(Vec3(0.0, 0.0, 1.3), STILL, from_euler(0.0, 0.0, 0.0), STILL, Omega)
    c_T, landed_us = Rotors(*[C_T] * 8), None
    for t_us in range(0, 2_000_000, LOOK_US):
        now = stands.py_func(now, down, c_T, seen, float(t_us))
        if now.landed and landed_us is None:
            landed_us = t_us
    assert landed_us == (LEANS_US if lands else None)
    assert now.T_flight > 0.9 * WEIGHT or not down


# --- whether it has come down


def meets(speeds, ground=math.nan):
    """Return for each of these vertical speeds whether it is down, after a descent at 0.7 m/s."""
    sinking = Setpoint(Vec3(0.0, 0.0, -3.0), Vec3(0.0, 0.0, -0.7), STILL, 0.0, 0.0)
    seen, z, found = TouchdownDetector(), 0.28, []
    for k, v in enumerate([-0.7] * 20 + speeds):
        z += v * LOOK_US * 1e-6
        flown = resting(sinking, 1.8) if seen.done else sinking
        seen.see(
            flown,
            Pose(Vec3(0.0, 0.0, z), Vec3(0.0, 0.0, v), 0.0),
            ground,
            k * LOOK_US,
            model_z=-0.7,
        )
        found.append(seen.done)
    return found[20:]


@pytest.mark.parametrize("ground", [math.nan, -2.0])  # a slope is higher than where it stood
@pytest.mark.parametrize("up", [1.2, 3.0])
def test_the_highest_point_of_a_jump_is_no_ground(up, ground):
    """It is slow there for long, and its setpoint sinks away: rotors that are cut are cut in the air."""
    jump, hangs = [0.6, *[up - 0.1 * k for k in range(round(up / 0.1))]], [0.1] * 20 + [-0.1] * 20
    sinks, rests = [-0.5] * 10, [-0.1] * 10
    down = meets(jump + hangs + sinks + rests, ground)
    assert not any(down[: -len(rests)])
    assert down[-1]


def test_what_is_thrown_up_again_has_not_come_down():
    assert meets([0.0] * 10)[-1]
    assert not meets([0.0] * 10 + [0.5, 1.1])[-1]
    assert meets([0.0] * 10 + [0.5, 0.9])[-1]
