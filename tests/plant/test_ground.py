"""Standing, taking off, landing, crashing, and leaving the arena."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fcu.kernel.algebra import Quat, Rotors, Vec3
from sitl_plant.physics import dynamics
from sitl_plant.physics.parameters import start_state

HOVER = math.sqrt(8.0 * 9.81 / 8.0 / 8.2e-5) / 552.2


@pytest.fixture
def params(plant):
    return plant(ground_z_m=-10.0)


@pytest.fixture
def standing(params):
    return start_state(params, {"on_ground": True})


def height(params, state):
    """Of the gear's feet over the ground, m."""
    return state.r_E.z - params.ground.z - params.ground.gear


def test_it_stands_still_on_its_gear(params, standing, fly, truth):
    end = fly(params, standing, 0.0, 5.0)
    np.testing.assert_allclose(end.r_E, standing.r_E, atol=1e-9)
    np.testing.assert_allclose(end.v_E, (0.0, 0.0, 0.0), atol=1e-9)
    assert height(params, end) == pytest.approx(-8.0 * 9.81 / 8000.0, abs=1e-9)
    record = truth(params, end)
    assert record.on_ground == 1.0
    assert record.ended == dynamics.FLYING


def test_it_stands_in_wind(plant, fly):
    params = plant(wind={"steady_m_s": [8.0, 0.0, 0.0]}, ground_z_m=0.0)
    end = fly(params, start_state(params, {"on_ground": True}), 0.0, 5.0)
    assert 0.0 < end.r_E.x < 0.1  # friction is viscous near rest: it creeps


def test_a_slide_is_stopped_by_friction(params, standing, fly):
    end = fly(params, standing._replace(v_E=Vec3(1.0, 0.0, 0.0)), 0.0, 2.0)
    assert end.r_E.x == pytest.approx(1.0 / (2.0 * 0.6 * 9.81), rel=0.1)
    assert abs(end.v_E.x) < 1e-3


def test_a_leaning_vehicle_is_righted(params, standing, fly):
    leaning = Rotation.from_euler("ZYX", [20.0, 6.0, -5.0], degrees=True)
    q_EB = Quat(*leaning.as_quat(scalar_first=True).tolist())
    end = fly(params, standing._replace(q_EB=q_EB), 0.0, 3.0)
    yaw, pitch, roll = Rotation.from_quat(end.q_EB, scalar_first=True).as_euler("ZYX", degrees=True)
    assert yaw == pytest.approx(20.0, abs=2.0)
    assert abs(pitch) < 0.1
    assert abs(roll) < 0.1


def test_it_takes_off_with_more_thrust_than_weight(params, standing, fly, truth):
    idle = fly(params, standing, 0.9 * HOVER, 2.0)
    assert truth(params, idle).on_ground == 1.0
    flying = fly(params, standing, 1.1 * HOVER, 1.0)
    assert truth(params, flying).on_ground == 0.0
    assert height(params, flying) > 0.5
    assert flying.v_E.z > 0.0


def test_it_lands_when_it_comes_down_slowly_and_stops_its_rotors(params, standing, fly, truth):
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
