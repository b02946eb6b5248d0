"""Standing, taking off, landing, crashing, and leaving the arena."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fcu.kernel.algebra import Quat, Rotors, Vec3
from fcu.kernel.rotations import matrix
from sitl_plant.physics import dynamics, ground
from sitl_plant.physics.parameters import start_state

ZERO = Vec3(0.0, 0.0, 0.0)
HOVER = math.sqrt(8.0 * 9.81 / 8.0 / 8.2e-5) / 552.2


@pytest.fixture
def params(plant):
    return plant(ground_z_m=-10.0)


@pytest.fixture
def standing(params):
    return start_state(params, {"on_ground": True})


def leaning(yaw, pitch, roll):
    """Attitude of angles in degrees."""
    q_EB = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True)
    return Quat(*q_EB.as_quat(scalar_first=True).tolist())


def height(params, state):
    """Of the gear's feet over the ground, m."""
    return state.r_E.z - params.ground.z - params.ground.gear


def test_a_vehicle_stands_still_on_its_gear(params, standing, fly, truth):
    end = fly(params, standing, 0.0, 5.0)
    np.testing.assert_allclose(end.r_E, standing.r_E, atol=1e-9)
    np.testing.assert_allclose(end.v_E, (0.0, 0.0, 0.0), atol=1e-9)
    assert height(params, end) == pytest.approx(-8.0 * 9.81 / 8000.0, abs=1e-9)
    record = truth(params, end)
    assert record.on_ground == 1.0
    assert record.ended == dynamics.FLYING


def test_a_standing_vehicle_does_not_creep_in_wind(plant, fly):
    """10 m/s push with 15 N; friction holds up to 0.6 of 78 N."""
    params = plant(wind={"steady_m_s": [8.0, 6.0, 0.0]}, ground_z_m=0.0)
    standing = start_state(params, {"on_ground": True})
    end = fly(params, standing, 0.0, 5.0)
    np.testing.assert_allclose(end.r_E, standing.r_E, atol=1e-9)
    pushed = standing._replace(v_E=Vec3(0.02, 0.0, 0.0))
    assert np.linalg.norm(fly(params, pushed, 0.0, 1.0).v_E) < 1e-9


def test_a_standing_vehicle_does_not_creep_in_changing_wind(plant, fly):
    wind = {"amplitude_m_s": [10.0, 7.0, 5.0], "frequency_rad_s": [1.5, 1.6, 1.7]}
    params = plant(wind=wind, ground_z_m=0.0)
    standing = start_state(params, {"on_ground": True})
    end = fly(params, standing, 0.0, 20.0)
    np.testing.assert_allclose(end.r_E[:2], standing.r_E[:2], atol=1e-6)


def test_a_storm_pushes_it_along(plant, fly):
    """20 m/s push with 60 N, against 47 N of friction."""
    params = plant(wind={"steady_m_s": [20.0, 0.0, 0.0]}, ground_z_m=0.0)
    end = fly(params, start_state(params, {"on_ground": True}), 0.0, 0.1)
    assert end.v_E.x == pytest.approx(0.1 * (60.0 - 0.6 * 78.48) / 8.0, rel=0.05)


def test_the_gear_rights_with_no_more_than_the_load_at_its_lever(params, standing):
    load, b, high = 8000.0 * 0.00981, params.ground.footprint, params.ground.gear
    for degrees in (6.0, 30.0, 36.9, 37.2, 45.0, 59.0):  # the gear tips at 37.02
        lean = math.radians(degrees)
        lever = b * math.cos(lean) - high * math.sin(lean)  # of the foot that is still down
        assert (lever > 0.0) == (degrees < 37.0)
        q_EB = leaning(0.0, degrees, 0.0)
        force, tau = ground.contact(
            params.ground, standing.r_E, standing.v_E, matrix(q_EB), ZERO, ZERO
        )
        assert force.z == pytest.approx(load)
        assert tau.y == pytest.approx(-load * lever)  # back towards level, or on
        assert (tau.x, tau.z) == pytest.approx((0.0, 0.0))


def test_what_leans_beyond_the_gears_tipping_angle_falls_over(params, standing, fly, truth):
    for degrees, verdict in ((36.0, dynamics.FLYING), (38.0, dynamics.CRASHED)):
        state = standing._replace(q_EB=leaning(0.0, degrees, 0.0))
        ended = dynamics.FLYING
        for _ in range(40):
            state = fly(params, state, 0.0, 0.05)
            ended = max(ended, truth(params, state).ended)
        assert ended == verdict


def test_a_torque_beyond_the_gears_lever_turns_it_over(params, standing, fly, truth):
    """Two rotors at full speed pitch with 46 N m; an 8 kg vehicle's feet resist with 18."""
    u = np.zeros(8)
    u[[4, 5]] = 1.0  # the tail's: nose down
    state, verdicts = standing, []
    for _ in range(200):
        state = fly(params, state, u, 0.01)
        verdicts.append(truth(params, state).ended)
        if verdicts[-1] != dynamics.FLYING:
            break
    assert verdicts[-1] == dynamics.CRASHED


@pytest.mark.parametrize(
    ("degrees", "verdict"),
    [(59.0, dynamics.FLYING), (61.0, dynamics.CRASHED), (180.0, dynamics.CRASHED)],
)
@pytest.mark.parametrize("axis", [0, 1])
def test_lying_on_its_side_or_back_is_a_crash(params, standing, truth, axis, degrees, verdict):
    angles = [0.0, 0.0, 0.0]
    angles[1 + axis] = degrees
    down = standing._replace(q_EB=leaning(*angles))
    assert truth(params, down).ended == verdict
    above = down._replace(r_E=down.r_E + Vec3(0.0, 0.0, 0.1))
    assert truth(params, above).ended == dynamics.FLYING


def test_a_slide_is_stopped_by_friction(params, standing, fly):
    end = fly(params, standing._replace(v_E=Vec3(1.0, 0.0, 0.0)), 0.0, 2.0)
    assert end.r_E.x == pytest.approx(1.0 / (2.0 * 0.6 * 9.81), rel=0.1)
    assert abs(end.v_E.x) < 1e-3


def test_a_leaning_vehicle_is_righted(params, standing, fly):
    end = fly(params, standing._replace(q_EB=leaning(20.0, 6.0, -5.0)), 0.0, 3.0)
    yaw, pitch, roll = Rotation.from_quat(end.q_EB, scalar_first=True).as_euler("ZYX", degrees=True)
    assert yaw == pytest.approx(20.0, abs=2.0)
    assert abs(pitch) < 0.1
    assert abs(roll) < 0.1


def test_more_thrust_than_weight_takes_off(params, standing, fly, truth):
    idle = fly(params, standing, 0.9 * HOVER, 2.0)
    assert truth(params, idle).on_ground == 1.0
    flying = fly(params, standing, 1.1 * HOVER, 1.0)
    assert truth(params, flying).on_ground == 0.0
    assert height(params, flying) > 0.5
    assert flying.v_E.z > 0.0


def test_a_slow_descent_with_stopped_rotors_lands(params, standing, fly, truth):
    Omega = Rotors(*[HOVER * 552.2] * 8)
    above = standing._replace(
        r_E=standing.r_E + Vec3(0.0, 0.0, 0.5), v_E=Vec3(0.0, 0.0, -0.5), Omega=Omega
    )
    near = fly(params, above, HOVER, 0.9)
    assert truth(params, near).on_ground == 0.0
    landed = fly(params, near, 0.0, 4.0)
    np.testing.assert_allclose(landed.r_E, standing.r_E, atol=1e-6)
    assert truth(params, landed).on_ground == 1.0
    assert truth(params, landed).ended == dynamics.FLYING


@pytest.mark.parametrize(("drop_m", "verdict"), [(0.40, dynamics.FLYING), (0.55, dynamics.CRASHED)])
def test_touching_down_faster_than_three_metres_a_second_is_a_crash(
    params, standing, fly, truth, drop_m, verdict
):
    """Dropped without rotors: 2.8 m/s and 3.3 m/s at the ground."""
    state = standing._replace(r_E=Vec3(0.0, 0.0, params.ground.z + params.ground.gear + drop_m))
    worst = dynamics.FLYING
    for _ in range(1000):
        state = fly(params, state, 0.0, params.h)
        worst = max(worst, truth(params, state).ended)
    assert worst == verdict


def test_below_the_ground_is_a_crash(params, standing, truth):
    buried = standing._replace(r_E=Vec3(0.0, 0.0, params.ground.z - 1.0))
    assert truth(params, buried).ended == dynamics.CRASHED


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("r_E", Vec3(0.0, 51.0, 0.0)),
        ("r_E", Vec3(math.nan, 0.0, 0.0)),
        ("v_E", Vec3(0.0, 0.0, math.nan)),
        ("w_B", Vec3(0.0, math.inf, 0.0)),
    ],
)
def test_outside_the_arena_or_not_a_number_is_diverged(plant, field, value):
    params = plant(arena_m=50.0)
    start = start_state(params)
    assert dynamics.ended(params, start, start.r_E) == dynamics.FLYING
    assert dynamics.ended(params, start._replace(**{field: value}), start.r_E) == dynamics.DIVERGED
