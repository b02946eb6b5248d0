"""A plan's steps, flown by law and plant: where it goes, how fast, what it tells."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from fcu.interface.status_texts import Code
from fcu.kernel.algebra import Vec3
from fcu.vehicle.mission import Do, Step
from fcu.vehicle.mission_flight import AT_A_TIME, MissionFlight, corner_of, leg_of
from fcu.vehicle.modes import Mode
from fcu.vehicle.plans import STILL, PlanLimits, length
from tests.vehicle.flown import Flown


def go(x, y, z, **more):
    return Step(Do.GO_TO, Vec3(x, y, z), **more)


UP = Step(Do.TAKE_OFF, Vec3(math.nan, math.nan, 5.0), above_home=True)
LAND = Step(Do.LAND)


class Planned(Flown):
    """Flies a plan from the ground, and keeps where it was, where it was led and its heading."""

    def __init__(self, *steps, wind=None):
        super().__init__(wind)
        self.track, self.led, self.at_s, self.psi = [], [], [], []
        self.fly(0.5)
        self.vehicle.take_plan(steps, self.t_us)
        self.ground = self.r.z

    def _look(self):
        super()._look()
        if self.vehicle.setpoint is not None:
            self.track.append(self.r)
            self.led.append(self.vehicle.flown(self.t_us).v_c)
            self.at_s.append(self.t_us * 1e-6)

    def begin(self, seconds, done=None):
        assert self.vehicle.start_plan(-1, self.t_us, 0.0).granted
        self.fly(seconds, done or (lambda: self.vehicle.mission.is_complete))

    def nearest(self, x, y, z):
        return min(math.dist(r, (x, y, z)) for r in self.track)


@pytest.mark.computes
def test_a_plan_takes_off_goes_round_its_corners_and_lands_where_it_says():
    z = 5.0
    flight = Planned(
        UP, go(20.0, 0.0, z), go(20.0, 20.0, z), go(0.0, 20.0, z),
        Step(Do.LAND, Vec3(3.0, 17.0, math.nan)),
    )  # fmt: skip
    flight.begin(120.0)
    mission = flight.vehicle.mission
    assert mission.is_complete
    assert list(mission.reached) == [0, 1, 2, 3, 4]
    for corner in ((20.0, 0.0), (20.0, 20.0)):
        assert flight.nearest(*corner, z) < 2.0
    assert math.dist(flight.r[:2], (3.0, 17.0)) < 0.5
    flight.fly(5.0, lambda: not flight.vehicle.armed)
    assert not flight.vehicle.armed
    assert flight.vehicle.mode is Mode.HOLD
    assert Code.MISSION_COMPLETE in flight.told


@pytest.mark.computes
def test_speed_is_kept_through_a_corner_and_not_where_it_holds():
    z = 5.0
    corner = go(30.0, 0.0, z), go(30.0, 30.0, z)
    speeds = {}
    for hold_s in (0.0, 1.0):
        flight = Planned(UP, corner[0]._replace(hold_s=hold_s), corner[1])
        flight.begin(90.0)
        near = [
            math.hypot(v.x, v.y) for r, v in zip(flight.track, flight.led, strict=True)
            if math.dist(r, (30.0, 0.0, z)) < 3.0
        ]  # fmt: skip
        speeds[hold_s] = min(near)
    assert speeds[0.0] > 1.5
    assert speeds[1.0] == 0.0
    print(speeds)


@pytest.mark.computes
def test_a_place_in_the_ground_is_flown_above_it():
    flight = Planned(UP, go(8.0, 0.0, -3.0), go(8.0, 8.0, 4.0))
    flight.begin(60.0)
    assert flight.vehicle.mission.is_complete
    assert min(r.z for r in flight.track[1500:]) > flight.ground + 0.2
    assert Code.LED_INTO_GROUND not in flight.told


def test_a_long_curve_is_held_against_the_fence_all_along():
    """With eight chords it would lie a metre beside them."""
    led = PlanLimits(12.0, 3.0, 1.5, 3.0, 2.0)
    leg = leg_of(Vec3(0.0, 0.0, 5.0), Vec3(300.0, 0.0, 5.0), led)
    onward = leg_of(Vec3(300.0, 0.0, 5.0), Vec3(300.0, 300.0, 5.0), led)
    corner = corner_of(leg, onward, 150.0, 140.0, led)
    asked = []
    sees = SimpleNamespace(is_clear=lambda a, b: asked.append((a, b)) or True)
    flight = MissionFlight(None, sees, SimpleNamespace(r_E=STILL, psi=0.0))
    assert flight._is_clear(leg, corner, Vec3(300.0, 0.0, 5.0))
    assert length(corner.acceleration) * (corner.for_s / len(asked)) ** 2 / 8.0 <= 0.01


@pytest.mark.computes
def test_what_follows_a_distance_is_done_that_far_from_the_next_place():
    """CONDITION_DISTANCE: the speed changes on the way, and the vehicle does not stop for it."""
    near = Step(Do.NEAR, value=20.0), Step(Do.SPEED, value=2.0)
    flight = Planned(UP, go(10.0, 0.0, 5.0), *near, go(60.0, 0.0, 5.0), go(60.0, 20.0, 5.0))
    flight.params.set("MR_GUARD", 0.0, False)
    flight.begin(90.0)
    assert flight.vehicle.mission.is_complete
    assert list(flight.vehicle.mission.reached) == [0, 1, 2, 3, 4, 5]
    led = [(r.x, v.x) for r, v in zip(flight.track, flight.led, strict=True) if r.y < 1.0]
    assert max(v for x, v in led if 15.0 < x < 35.0) > 4.0
    on_the_way = [v for x, v in led if 41.0 < x < 55.0]
    assert max(on_the_way) < 2.0 + 1e-9
    assert min(on_the_way) > 1.0


@pytest.mark.computes
def test_a_distance_that_is_met_takes_no_time_and_one_before_the_take_off_neither():
    near = Step(Do.NEAR, value=50.0), Step(Do.SPEED, value=2.0)
    flight = Planned(
        Step(Do.NEAR, value=1.0), UP, *near, go(20.0, 0.0, 8.0), Step(Do.NEAR, value=3.0)
    )
    flight.begin(90.0)
    assert flight.vehicle.mission.is_complete
    led = max(math.hypot(v.x, v.y) for v in flight.led)
    assert 1.9 < led < 2.01  # a piece may be flown a tick too long


@pytest.mark.computes
def test_a_turn_behind_a_distance_is_made_where_it_is_met():
    turn = Step(Do.NEAR, value=10.0), Step(Do.TURN, value=math.pi)
    flight = Planned(UP, go(5.0, 0.0, 5.0), *turn, go(40.0, 0.0, 5.0))
    flight.begin(90.0)
    slow = [r.x for r, v in zip(flight.track, flight.led, strict=True) if v == STILL and r.x > 8.0]
    assert min(abs(x - 30.0) for x in slow) < 0.3
    assert not [x for x in slow if 8.0 < x < 29.0]


def test_items_that_take_no_time_are_done_a_few_at_a_tick():
    """A tick has no time for a long row of them. The vehicle waits at rest meanwhile."""
    row = [Step(Do.NEAR, value=1e4), Step(Do.NOTHING), Step(Do.TURN, value=0.0)] * 20
    flight = Planned(*row, UP, *row, go(3.0, 0.0, 5.0))
    mission, done, most = flight.vehicle.mission, [0], 0
    whole = mission.done

    def count():
        done[0] += 1
        whole()

    mission.done = count
    assert flight.vehicle.start_plan(-1, flight.t_us, 0.0).granted
    while not mission.is_complete and flight.t_us < 60e6:
        most, done[0] = max(most, done[0]), 0
        flight.fly(0.004)
    assert mission.is_complete
    assert most <= AT_A_TIME
    assert flight.nearest(3.0, 0.0, 5.0) < 0.5
