"""Setpoints in and near the ground, and landings: upright, slow, and where they were meant to be."""

from __future__ import annotations

import math

import pytest

from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.vehicle import landing
from fcu.vehicle.landing import Approach, TouchdownDetector
from fcu.vehicle.modes import Mode
from fcu.vehicle.plans import PlanLimits, Pose
from fcu.vehicle.sticks import Sticks, StickSource
from sitl_plant.physics import dynamics
from tests.vehicle.flown import ZERO, Flown, at

GUSTS = {
    "steady_m_s": [4.0, 2.0, 0.0],
    "amplitude_m_s": [3.0, 3.0, 1.0],
    "frequency_rad_s": [1.5, 1.6, 1.7],
}
LIMITS = PlanLimits(cruise=5.0, up=3.0, down=1.5, acceleration=3.0, acceleration_up=3.0)
GROUND = 0.3
INTO = Code.SETPOINT_INTO_GROUND


def is_down(flown):
    """Landed and disarmed by itself, upright all the time, and not hard."""
    assert flown.ended == dynamics.FLYING
    assert flown.told[-2:] == [Code.LANDED, Code.DISARMED_LANDED]
    assert flown.tilt_deg < 25.0
    assert flown.down_m_s < 1.0


def rests_on_it(flown):
    """Down by what was not meant as a landing, and disarmed: not as soft, but not fallen over."""
    assert flown.ended == dynamics.FLYING
    assert Code.LED_INTO_GROUND in flown.told
    assert flown.told[-2:] == [Code.LANDED, Code.DISARMED_LANDED]
    assert flown.tilt_deg < 35.0


@pytest.mark.slow
@pytest.mark.parametrize("wind", [None, GUSTS], ids=["still", "gusts"])
@pytest.mark.parametrize("to", [(1.0, 1.0, -0.7), (10.0, 5.0, -0.7), (0.0, 0.0, 0.0)])
def test_a_place_in_the_ground_is_landed_on(wind, to):
    flown = Flown(wind)
    flown.up(2.5)
    flown.stream(lambda: at(*to), 30.0, lambda: not flown.vehicle.armed)
    is_down(flown)
    assert INTO in flown.told
    assert math.dist(flown.r[:2], to[:2]) < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("v", [(1.0, 0.0, -0.5), (12.0, 0.0, -1.5), (0.0, 0.0, -1.5)])
def test_a_velocity_into_the_ground_ends_in_a_landing(v):
    flown = Flown(GUSTS)
    flown.up(5.0)

    def on():  # a velocity goes on from the setpoint that is flown
        return flown.vehicle.flown(flown.t_us)._replace(v_c=Vec3(*v), a_c=ZERO)

    flown.stream(on, 60.0, lambda: not flown.vehicle.armed)
    is_down(flown)


@pytest.mark.slow
def test_a_landing_in_gusts_stays_upright_for_as_long_as_it_is_armed():
    flown = Flown(GUSTS)
    flown.params.set("COM_DISARM_LAND", 20.0, False)
    flown.up(2.5)
    flown.stream(lambda: at(5.0, 3.0, 4.0), 3.0)  # it is still on its way there
    assert flown.vehicle.select(Mode.LAND, flown.t_us, 0.0).granted
    flown.fly(60.0, lambda: not flown.vehicle.armed)
    is_down(flown)


def test_a_landing_finds_a_ground_that_is_not_known():
    flown = Flown(GUSTS)
    flown.up(2.5)
    flown.vehicle._landed.ground = math.nan
    assert flown.vehicle.select(Mode.LAND, flown.t_us, 0.0).granted
    flown.fly(60.0, lambda: not flown.vehicle.armed)
    is_down(flown)


@pytest.mark.slow
def test_a_reposition_into_the_ground_ends_on_it():
    flown = Flown(GUSTS)
    flown.up(2.5)
    assert flown.vehicle.reposition(Vec3(5.0, 3.0, -3.0), None, flown.t_us).granted
    flown.fly(30.0, lambda: not flown.vehicle.armed)
    rests_on_it(flown)


def grounded():
    flown = Flown()
    flown.fly(0.5)
    assert flown.vehicle.arm(flown.t_us, 0.0).granted
    return flown


def test_a_reposition_from_the_ground_climbs_first():
    flown, to = grounded(), Vec3(12.0, -5.0, 4.0)
    assert flown.vehicle.reposition(to, None, flown.t_us).granted
    aside = 0.0
    for _ in range(400):
        flown.fly(0.05)
        if flown.r.z < 3.9:
            aside = max(aside, math.hypot(flown.r.x, flown.r.y))
    assert aside < 0.05
    assert math.dist(flown.r, to) < 0.05 and flown.vehicle.armed


@pytest.mark.parametrize(("up", "granted"), [(0.4, False), (-3.0, False), (0.6, True)])
def test_a_place_near_the_ground_is_not_flown_to_from_it(up, granted):
    """A vehicle sent to a place 2 cm up slid along the ground and tipped over."""
    flown = grounded()
    to = Vec3(20.0, 0.0, flown.r.z + up)
    answer = flown.vehicle.reposition(to, None, flown.t_us)
    assert answer.granted is granted
    if not granted:
        assert answer.told == Told(Code.PLACE_LOW, (pytest.approx(up),))
    assert flown.vehicle.reposition(Vec3(0.0, 0.0, 30.0), None, flown.t_us).granted


@pytest.mark.slow
def test_sticks_into_the_ground_end_on_it_and_up_again_in_the_air():
    flown = Flown()
    flown.up(2.5)
    assert flown.vehicle.select(Mode.POSITION, flown.t_us, 0.0).granted

    def stick(seconds, **sticks):
        until, sender = flown.t_us + seconds * 1e6, ((255, 190), "one")
        while flown.t_us < until and flown.vehicle.armed:
            at_s = flown.t_us * 1e-6
            flown.vehicle.fly_by(Sticks(**sticks), StickSource.JOYSTICK, sender, flown.t_us, at_s)
            flown.fly(0.05)

    flown.params.set("COM_DISARM_LAND", 5.0, armed=True)
    stick(8.0, pitch=0.4, throttle=-1.0)
    assert Code.LED_INTO_GROUND in flown.told
    stick(4.0, throttle=1.0)
    high = flown.r
    assert high.z > 2.0
    stick(4.0, pitch=1.0)  # along again, not only up
    assert flown.r.x > high.x + 2.0
    stick(30.0, pitch=0.4, throttle=-1.0)
    rests_on_it(flown)


@pytest.mark.slow
@pytest.mark.parametrize(("height", "to"), [(50.0, (80.0, 0.0, 0.9)), (90.0, (60.0, 0.0, 0.5))])
def test_a_long_step_to_a_place_near_the_ground_does_not_end_in_it(height, to):
    flown = Flown()
    flown.up(height)
    flown.stream(lambda: at(*to), 80.0)  # governed, it goes at some 4 m/s, and down at 1.4 m/s
    assert flown.ended == dynamics.FLYING
    assert flown.tilt_deg < 25.0
    assert flown.down_m_s < 0.5
    assert math.dist(flown.r, to) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("place", [True, False], ids=["a place", "a velocity"])
def test_a_setpoint_above_ends_a_landing(place):
    flown = Flown()
    flown.up(2.5)
    flown.stream(lambda: at(1.0, 1.0, -0.7), 30.0, lambda: Code.LANDED in flown.told)
    up = Vec3(0.0, 0.0, 1.0)

    def on():
        return at(2.0, 2.0, 3.0) if place else flown.vehicle.flown(flown.t_us)._replace(v_c=up)

    flown.stream(on, 5.0)
    assert flown.vehicle.armed
    assert flown.r.z > 2.5


def test_armed_on_the_ground_a_setpoint_in_it_does_not_move_the_vehicle():
    flown = Flown(GUSTS)
    flown.fly(0.5)
    assert flown.vehicle.arm(flown.t_us, 0.0).granted
    flown.stream(lambda: at(5.0, 0.0, -0.7), 10.0)
    assert flown.vehicle.armed
    assert flown.tilt_deg < 1.0
    assert math.dist(flown.r[:2], (0.0, 0.0)) < 0.05


# --- what is decided


def pose(z, v=ZERO):
    return Pose(Vec3(0.0, 0.0, z), v, 0.0)


@pytest.mark.parametrize(
    "asked",
    [
        at(5.0, 0.0, 0.4),
        at(0.0, 0.0, 0.0, Vec3(0.0, 0.0, 0.5)),  # out of the ground
        at(0.0, 0.0, 1.0, Vec3(2.0, 0.0, 0.0)),
        at(0.0, 0.0, 3.0, Vec3(2.0, 0.0, -1.0)),
        at(0.0, 0.0, -0.7)._replace(level=1.0),  # an attitude has no place
    ],
)
def test_what_does_not_lead_into_the_ground_is_flown_as_asked(asked):
    assert (
        landing.approach(Approach.AS_ASKED, asked, pose(2.5), GROUND, LIMITS) is Approach.AS_ASKED
    )


def test_where_the_ground_is_not_known_everything_is_flown_as_asked():
    fast = pose(2.5, Vec3(0.0, 0.0, -9.0))
    assert (
        landing.approach(Approach.AS_ASKED, at(1, 1, -7), fast, math.nan, LIMITS)
        is Approach.AS_ASKED
    )


def test_a_vehicle_held_up_by_a_gust_goes_on_sinking():
    sinking, seen = at(0.0, 0.0, 5.0, Vec3(0.0, 0.0, -0.7)), TouchdownDetector()
    looks = [seen.see(sinking, pose(5.0), GROUND, k * 20_000, model_z=-0.7) for k in range(30)]
    assert looks.index(True) * 20_000 == landing.ANYWHERE_US
    assert seen.done
    assert not seen.see(sinking, pose(5.0, Vec3(0.0, 0.0, -0.9)), GROUND, 400_000)
    assert seen.see(sinking, pose(4.9, Vec3(0.0, 0.0, -1.1)), GROUND, 420_000)
    assert not seen.done


def test_below_where_it_stood_there_is_no_ground_to_land_on():
    """Over a valley: lower than its place on the hill, with MR_SP_BELOW raised for it."""
    pose = Pose(Vec3(0.0, 0.0, GROUND - 5.0), ZERO, 0.0)
    asked = at(0.0, 0.0, GROUND - 5.0)
    assert landing.approach(Approach.AS_ASKED, asked, pose, GROUND, LIMITS) is Approach.AS_ASKED
    seen, sinking = TouchdownDetector(), asked._replace(v_c=Vec3(0.0, 0.0, -1.0))
    for k in range(20):  # held up by a gust for two fifths of a second
        seen.see(sinking, pose, GROUND, 20_000 * k, meant=False)
    assert not seen.done


def test_a_lazy_reference_that_lags_behind_is_not_a_ground():
    sinking, seen = at(0.0, 0.0, 5.0, Vec3(0.0, 0.0, -0.7)), TouchdownDetector()
    looks = [
        seen.see(sinking, pose(5.0), GROUND, k * 20_000, f_m=0.4, model_z=-0.7) for k in range(300)
    ]
    assert looks.index(True) * 20_000 == 5_000_000


@pytest.mark.parametrize(("below", "touches"), [(2.0, False), (2.2, True)])
def test_a_setpoint_far_below_leaves_a_model_behind_that_the_ground_leads(below, touches):
    """The lag of f_m = 1 rad/s at 0.7 m/s is 1.4 m."""
    sinking, seen = at(0.0, 0.0, 5.0 - below, Vec3(0.0, 0.0, -0.7)), TouchdownDetector()
    looks = [seen.see(sinking, pose(5.0), math.nan, k * 20_000, model_z=0.3) for k in range(40)]
    assert any(looks) is touches


@pytest.mark.parametrize(("slows_us", "for_us"), [(40_000, 60_000), (80_000, 300_000)])
def test_what_stops_a_vehicle_at_once_is_a_ground_that_is_not_known(slows_us, for_us):
    """From sinking as it should to standing still within 60 ms, which no air does, or slower."""
    sinking, seen = at(0.0, 0.0, 5.0, Vec3(0.0, 0.0, -0.7)), TouchdownDetector()

    def speed(t_us):
        return -0.7 if t_us < 0 else min(0.0, -0.48 * (1.0 - t_us / slows_us))

    def see(t_us):
        moves = pose(5.0, Vec3(0.0, 0.0, speed(t_us)))
        return seen.see(sinking, moves, math.nan, t_us + 200_000, model_z=-0.7)

    looks = range(-200_000, 600_000, 20_000)
    done = next(t_us for t_us in looks if see(t_us))
    assert done == pytest.approx(slows_us + for_us, abs=30_000)


def test_a_take_off_that_is_asked_for_on_the_way_down_is_no_touch_down():
    """It is still led down, and slowed."""
    slowed, seen = at(0, 0, GROUND, Vec3(0.0, 0.0, -0.6), Vec3(0.0, 0.0, 3.0)), TouchdownDetector()
    assert not any(seen.see(slowed, pose(GROUND), GROUND, k * 20_000, False) for k in range(30))


def test_the_highest_point_of_a_bounce_is_no_ground():
    sinking, seen = at(0.0, 0.0, 5.0, Vec3(0.0, 0.0, -0.7)), TouchdownDetector()
    speeds = [0.6 - 0.04 * k for k in range(20)]  # rising for 0.3 s, then falling
    for k, v in enumerate(speeds):
        seen.see(sinking, pose(5.0, Vec3(0.0, 0.0, v)), math.nan, k * 20_000, model_z=-0.7)
    assert not seen.done


@pytest.mark.parametrize(("above", "for_us"), [(0.05, 60_000), (0.7, 600_000)])
def test_without_a_model_air_that_rises_has_longer_to_pass_where_no_ground_is_known(above, for_us):
    sinking, seen = at(0.0, 0.0, GROUND, Vec3(0.0, 0.0, -0.7)), TouchdownDetector()
    looks = [seen.see(sinking, pose(GROUND + above), GROUND, k * 20_000) for k in range(50)]
    assert looks.index(True) * 20_000 == for_us


@pytest.mark.parametrize(("model_z", "touches"), [(0.14, False), (-0.1, False), (-0.7, True)])
def test_a_vehicle_that_does_as_its_reference_model_is_not_hindered(model_z, touches):
    """Behind a setpoint that sinks already, the model may still rise: no ground does that."""
    sinking, seen = at(0.0, 0.0, 5.0, Vec3(0.0, 0.0, -0.7)), TouchdownDetector()
    still = pose(5.0, Vec3(0.0, 0.0, 0.14))
    looks = [seen.see(sinking, still, GROUND, k * 20_000, model_z=model_z) for k in range(60)]
    assert any(looks) is touches


@pytest.mark.slow
def test_entering_offboard_with_a_setpoint_in_the_ground_is_told():
    flown = Flown(None)
    flown.up(2.5)
    flown.stream(lambda: at(0.0, 0.0, -0.7), 30.0, lambda: not flown.vehicle.armed)
    assert flown.told.count(INTO) == 1


def test_a_lazy_reference_model_has_longer_to_take_up_a_speed():
    assert landing.anywhere_us(landing.LAZY) == landing.ANYWHERE_US
    assert landing.anywhere_us(0.25) == 8_000_000
