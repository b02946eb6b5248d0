"""Follow Me: beside a target that moves, turns, stops, or falls silent."""

from __future__ import annotations

import math

import pytest

from fcu.interface.status_texts import Code
from fcu.kernel.algebra import Vec3
from fcu.vehicle.follow import AHEAD_S, Report, Target
from fcu.vehicle.modes import Mode
from sitl_plant.physics import dynamics
from tests.vehicle.flown import Flown

NAN = math.nan


def reports(target, *each):
    for at_us, x, v in each:
        target.take(Report(Vec3(x, 0.0, 0.0), None if v is None else Vec3(v, 0.0, 0.0)), at_us)


def test_a_target_moves_on_as_it_was_reported_for_a_while():
    target = Target()
    assert not target.known(0)
    reports(target, (0, 10.0, 2.0))
    assert target.at(500_000)[0].x == pytest.approx(11.0)
    far, v = target.at(2_900_000)
    assert (far.x, v.x) == (pytest.approx(10.0 + 2.0 * AHEAD_S), 0.0)
    assert target.known(3_000_000) and not target.known(3_000_001)


def test_a_target_without_a_speed_has_the_one_of_its_places():
    target = Target()
    reports(target, (0, 0.0, 0.0), (1_000_000, 3.0, 0.0))  # as MAVSDK's example says it
    assert target.at(1_000_000)[1].x == pytest.approx(3.0)
    reports(target, (2_000_000, 3.0, 0.0))
    assert target.at(2_000_000)[1].x == 0.0
    target = Target()
    reports(target, (0, 0.0, 3.0), (1_000_000, 3.0, 0.0))  # it says its speed, and has stopped
    assert target.at(1_000_000)[1].x == 0.0


class Follow(Flown):
    """A vehicle in mode Follow Me, 10 m up."""

    def __init__(self, **parameters):
        super().__init__()
        self.up(10.0)
        for name, value in parameters.items():
            self.params.set(name, value, armed=True)
        assert self.vehicle.select(Mode.FOLLOW, self.t_us, 0.0).granted

    def follow(self, seconds, place, velocity=lambda t: Vec3(0.0, 0.0, 0.0), every_s=0.5):
        """Fly beside a target whose place and velocity are functions of time, s."""
        began = self.t_us
        while self.t_us < began + seconds * 1e6:
            t = (self.t_us - began) * 1e-6
            self.vehicle.follow(Report(place(t), velocity(t)), self.t_us)
            self.fly(every_s)
            assert self.ended == dynamics.FLYING

    def beside(self, place):
        """East and north of the target, m."""
        return self.r.x - place.x, self.r.y - place.y

    @property
    def faces(self):
        """Yaw, rad."""
        return self.vehicle.pose().psi


def test_a_vehicle_without_a_target_stays():
    flown = Follow()
    before = flown.r
    flown.fly(5.0)
    assert flown.vehicle.mode is Mode.FOLLOW
    assert math.dist(flown.r, before) < 0.01


@pytest.mark.computes
def test_beside_a_target_at_rest_it_goes_to_its_distance_and_height_and_faces_it():
    flown = Follow(FLW_TGT_HT=12.0)
    place = Vec3(20.0, 15.0, 0.3)
    flown.follow(40.0, lambda t: place)
    east, north = flown.beside(place)
    assert math.hypot(east, north) == pytest.approx(8.0, abs=0.1)
    assert math.atan2(north, east) == pytest.approx(math.atan2(-15.0, -20.0), abs=0.05)
    assert flown.r.z == pytest.approx(12.3, abs=0.1)
    assert math.cos(flown.faces - math.atan2(-north, -east)) > 0.999


@pytest.mark.computes
def test_a_target_below_the_ground_is_followed_a_metre_above_home():
    """MAVSDK's example says 8 m below home, and FLW_TGT_HT is 8 m: the vehicle must not land."""
    flown = Follow(FLW_TGT_ALT_M=2.0)
    home = flown.vehicle.home.z
    place = Vec3(20.0, 15.0, home - 8.0)
    flown.follow(40.0, lambda t: place)
    assert flown.r.z - home == pytest.approx(1.0, abs=0.1)
    assert math.hypot(*flown.beside(place)) == pytest.approx(8.0, abs=0.1)
    assert flown.vehicle.mode is Mode.FOLLOW


@pytest.mark.parametrize(
    ("angle", "east", "north"), [(180.0, -8.0, 0.0), (90.0, 0.0, -8.0), (0.0, 8.0, 0.0)]
)
@pytest.mark.computes
def test_beside_a_target_that_moves_it_keeps_its_angle(angle, east, north):
    """The target goes east: behind it is west, to its right is south."""
    flown = Follow(FLW_TGT_FA=angle)
    place = lambda t: Vec3(1.5 * t, 5.0, 0.3)  # noqa: E731
    flown.follow(45.0, place, lambda t: Vec3(1.5, 0.0, 0.0))
    assert flown.beside(place(45.0)) == pytest.approx((east, north), abs=0.5)


@pytest.mark.computes
def test_a_target_that_stops_is_not_run_over():
    flown = Follow()
    stops = lambda t: Vec3(2.0 * min(t, 25.0), 0.0, 0.3)  # noqa: E731
    flown.follow(25.0, stops, lambda t: Vec3(2.0, 0.0, 0.0))
    least = math.inf
    for _ in range(30):
        flown.follow(0.5, lambda t: stops(25.0))
        least = min(least, math.hypot(*flown.beside(stops(25.0))))
    assert least > 5.0  # of 8
    assert math.hypot(*flown.beside(stops(25.0))) == pytest.approx(8.0, abs=0.2)


@pytest.mark.computes
def test_a_target_that_falls_silent_is_stopped_for():
    flown = Follow()
    place = lambda t: Vec3(2.0 * t, 0.0, 0.3)  # noqa: E731
    flown.follow(20.0, place, lambda t: Vec3(2.0, 0.0, 0.0))
    flown.fly(10.0)
    v = flown.vehicle.measured.v_E
    assert flown.vehicle.mode is Mode.FOLLOW
    assert math.hypot(v.x, v.y) < 0.05
    assert flown.r.x < place(20.0).x


@pytest.mark.computes
def test_following_is_no_faster_than_allowed():
    flown = Follow(FLW_TGT_MAX_VEL=1.0)
    fastest = 0.0
    for k in range(40):
        flown.follow(0.5, lambda t, k=k: Vec3(1.5 * k, 0.0, 0.3), lambda t: Vec3(3.0, 0.0, 0.0))
        v = flown.vehicle.measured.v_E
        fastest = max(fastest, math.hypot(v.x, v.y))
    assert 0.9 < fastest < 1.1


@pytest.mark.computes
def test_the_height_may_be_the_targets():
    flown = Follow(FLW_TGT_ALT_M=2.0)
    place = Vec3(10.0, 0.0, 6.0)
    flown.follow(25.0, lambda t: place)
    assert flown.r.z == pytest.approx(14.0, abs=0.1)


def test_on_the_ground_and_disarmed_there_is_no_following():
    flown = Flown()
    flown.fly(0.5)
    assert flown.vehicle.select(Mode.FOLLOW, flown.t_us, 0.0).granted
    assert flown.vehicle.arm(flown.t_us, 0.0).told.code is Code.MODE_NOT_TO_ARM
