"""The end of a return and the way there, by RTL_TYPE: decided, and flown by law and plant."""

from __future__ import annotations

import math

import pytest

from fcu.interface.messages import Battery
from fcu.kernel.algebra import Vec3
from fcu.vehicle.areas import Disc
from fcu.vehicle.mission import Do, Mission, Step
from fcu.vehicle.modes import Mode
from fcu.vehicle.returning import Ending, ReturnType, ending
from tests.vehicle.test_mission import UP, Planned, go

HOME = Vec3(1.0, 2.0, 0.5)
MARK, SPEED = Step(Do.LANDING_BEGINS), Step(Do.SPEED, value=3.0)
LAND = Step(Do.LAND, Vec3(30.0, 40.0, 0.0), above_home=True)
OUT, ON, IN = go(10.0, 0.0, 6.0), go(30.0, 0.0, 8.0, above_home=True), go(30.0, 30.0, 4.0)
RALLY = (Vec3(-20.0, 0.0, 99.0),)
A, B, C = Vec3(10.0, 0.0, 6.0), Vec3(30.0, 0.0, 8.5), Vec3(30.0, 30.0, 4.0)
LANDED = Vec3(30.0, 40.0, 0.5)
START = Vec3(1.0, 2.0, 5.5)  # of the take-off


def end(kind, here, *steps, rally=(), current=0, flown=False):
    mission = Mission()
    mission.replace(steps)
    mission.current = current
    return ending(ReturnType(kind), Vec3(*here), HOME, rally, mission, flown)


@pytest.mark.parametrize(
    ("kind", "here", "found"),
    [
        # the nearest of home and rally points
        (0, (0.0, 0.0, 5.0), Ending(HOME)),
        (0, (-15.0, 0.0, 5.0), Ending(Vec3(-20.0, 0.0, 0.5))),
        (0, (30.0, 38.0, 5.0), Ending(HOME)),
        # of rally points and the plan's landing, by its landing and not where that begins
        (1, (0.0, 0.0, 5.0), Ending(Vec3(-20.0, 0.0, 0.5))),
        (1, (29.0, 1.0, 5.0), Ending(LANDED, (C,))),
        # of all of these
        (3, (2.0, 2.0, 5.0), Ending(HOME)),
        (3, (-15.0, 0.0, 5.0), Ending(Vec3(-20.0, 0.0, 0.5))),
        (3, (30.0, 38.0, 5.0), Ending(LANDED, (C,))),
    ],
)
def test_a_return_ends_at_the_nearest_place_that_its_type_allows(kind, here, found):
    assert end(kind, here, UP, OUT, SPEED, ON, MARK, IN, LAND, rally=RALLY) == found


@pytest.mark.parametrize(
    ("rally", "here", "found"),
    [
        (Vec3(9.0, 2.0, 0.0), (9.0, 2.0, 5.0), HOME),  # within 10 m of home: it is home
        (Vec3(21.0, 2.0, 0.0), (11.9, 2.0, 5.0), HOME),  # nearer by less than 2 m
        (Vec3(21.0, 2.0, 0.0), (12.1, 2.0, 5.0), Vec3(21.0, 2.0, 0.5)),
    ],
)
def test_a_rally_point_is_taken_if_it_is_clearly_nearer_and_not_at_home(rally, here, found):
    assert end(0, here, rally=(rally,)) == Ending(found)


def test_out_of_another_mode_a_landing_that_is_near_is_landed_at_without_the_plan():
    steps = UP, OUT, ON, IN, LAND
    assert end(2, (29.0, 40.0, 8.0), *steps) == Ending(LANDED, straight=False)
    assert end(2, (30.0, 29.0, 5.0), *steps) == Ending(LANDED, (C,), straight=False)


def test_without_a_mark_the_landing_of_a_plan_is_its_first_landing():
    assert end(1, (0.0, 0.0, 5.0), UP, OUT, ON, LAND) == Ending(LANDED)
    assert end(1, (0.0, 0.0, 5.0), UP, OUT, ON) == Ending(HOME)
    # a mark behind which nothing lands is none
    assert end(1, (0.0, 0.0, 5.0), UP, OUT, MARK, ON) == Ending(HOME)


def test_along_a_plan_it_goes_on_to_the_landing_from_the_current_step():
    plan = UP, OUT, SPEED, ON, MARK, IN, LAND
    found = end(2, (20.0, 0.0, 7.0), *plan, rally=RALLY, current=3, flown=True)
    assert found == Ending(LANDED, (B, C), straight=False)
    # not in mode Mission: from the nearest place
    found = end(2, (9.0, 1.0, 7.0), *plan, current=6)
    assert found == Ending(LANDED, (A, B, C), straight=False)
    # behind the landing: its landing once more
    assert end(2, (0.0, 0.0, 5.0), *plan, ON, current=7, flown=True) == Ending(
        LANDED, (C,), straight=False
    )


def test_along_a_plan_without_a_landing_it_goes_back_and_home():
    plan = UP, OUT, SPEED, ON, IN
    found = end(2, (30.0, 15.0, 7.0), *plan, rally=RALLY, current=4, flown=True)
    assert found == Ending(HOME, (B, A, START), straight=False)
    found = end(2, (29.0, 29.0, 7.0), *plan, current=0)
    assert found == Ending(HOME, (C, B, A, START), straight=False)
    assert end(2, (9.0, 9.0, 9.0)) == Ending(HOME)
    assert end(2, (9.0, 9.0, 9.0), SPEED) == Ending(HOME)


# --- flown


def returned(kind, *steps, until, fence=()):
    """A flight of a plan that is broken off `until` its current step is this one, and returns."""
    flight = Planned(*steps)
    flight.params.set("RTL_TYPE", float(kind), False)
    flight.params.set("RTL_RETURN_ALT", 9.0, False)
    flight.vehicle.take_fence(fence)
    flight.begin(90.0, lambda: flight.vehicle.mission.current == until)
    flight.fly(1.0)
    flight.track.clear()
    assert flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0).granted
    flight.fly(150.0, lambda: not flight.vehicle.armed)
    assert not flight.vehicle.armed
    return flight


WAY = UP, go(15.0, 0.0, 5.0), go(15.0, 15.0, 6.0), go(0.0, 15.0, 5.0)


@pytest.mark.computes
def test_back_along_the_plan_is_flown_place_by_place():
    flight = returned(2, *WAY, until=3)
    assert flight.nearest(15.0, 15.0, 6.0) < 0.3
    assert flight.nearest(15.0, 0.0, 5.0) < 0.3
    assert math.hypot(flight.r.x, flight.r.y) < 0.5
    assert max(r.z for r in flight.track) < 7.0  # it does not climb to RTL_RETURN_ALT


@pytest.mark.computes
def test_on_along_the_plan_to_its_landing_passes_over_holds():
    steps = (*WAY[:3], WAY[3]._replace(hold_s=60.0), Step(Do.WAIT, hold_s=60.0), Step(Do.LAND, Vec3(-5.0, 15.0, 0.0)))  # fmt: skip
    flight = returned(2, *steps, until=2)
    assert flight.nearest(15.0, 15.0, 6.0) < 0.3
    assert flight.nearest(0.0, 15.0, 5.0) < 0.3
    assert math.dist(flight.r[:2], (-5.0, 15.0)) < 0.5
    assert flight.t_us < 90e6


@pytest.mark.computes
def test_straight_to_the_landing_of_the_plan_at_the_height_of_a_return():
    steps = (*WAY, Step(Do.LANDING_BEGINS), go(-10.0, 10.0, 4.0), Step(Do.LAND, Vec3(-10.0, 0.0, 0.0)))  # fmt: skip
    flight = returned(3, *steps, until=3)
    assert math.dist(flight.r[:2], (0.0, 0.0)) < 0.5  # home was nearer
    flight = returned(1, *steps, until=3)
    assert max(r.z for r in flight.track) > 8.9
    assert flight.nearest(-10.0, 10.0, 4.0) < 0.3
    assert math.dist(flight.r[:2], (-10.0, 0.0)) < 0.5


@pytest.mark.computes
def test_the_way_to_the_plan_goes_around_what_the_fence_forbids():
    """In Hold beside the plan: the way to its nearest place leads through the pond."""
    flight = Planned(UP, go(15.0, 0.0, 5.0), go(15.0, 20.0, 5.0))
    flight.params.set("RTL_TYPE", 2.0, False)
    flight.begin(90.0)
    flight.vehicle.reposition(Vec3(27.0, 20.0, 5.0), None, flight.t_us)
    flight.fly(15.0)
    pond = Disc(False, 21.0, 20.0, 3.0)
    flight.vehicle.take_fence((pond,))
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    flight.fly(150.0, lambda: not flight.vehicle.armed)
    assert flight.vehicle.fence.breaches == 0
    assert flight.nearest(15.0, 20.0, 5.0) < 0.3
    assert math.hypot(flight.r.x, flight.r.y) < 0.5


@pytest.mark.parametrize(
    ("current", "found"),
    [(1, Ending(HOME, (START,), straight=False)), (2, Ending(HOME, (A, START), straight=False)),
     (3, Ending(LANDED, (B, C), straight=False)), (5, Ending(LANDED, (C,), straight=False))],
)  # fmt: skip
def test_the_shorter_of_both_ways_along_a_plan_is_counted_in_items(current, found):
    """RTL_TYPE 4: 4 items to the mark less those behind are fewer than those behind, or not."""
    steps = UP, OUT, SPEED, ON, MARK, IN, LAND
    assert end(4, (10.0, 0.0, 6.0), *steps, current=current, flown=True, rally=RALLY) == found


def test_without_a_landing_the_shorter_way_is_back():
    assert end(4, (30.0, 0.0, 8.0), UP, OUT, ON, current=2, flown=True) == Ending(HOME, (A, START), straight=False)  # fmt: skip
    assert end(4, (30.0, 0.0, 8.0)) == Ending(HOME)


def test_rally_points_alone_and_without_any_where_it_is():
    """RTL_TYPE 5: also one at home, and no landing of the plan."""
    at_home = Vec3(3.0, 2.0, 0.0)
    steps = UP, OUT, ON, MARK, IN, LAND
    assert end(5, (0.0, 0.0, 5.0), *steps, rally=(*RALLY, at_home)) == Ending(Vec3(3.0, 2.0, 0.5))
    assert end(5, (30.0, 38.0, 5.0), *steps) == Ending(Vec3(30.0, 38.0, 0.5))


@pytest.mark.parametrize(
    ("lasts", "here", "found"),
    [(True, (-19.0, 0.0, 5.0), HOME), (False, (2.0, 2.0, 5.0), Vec3(-20.0, 0.0, 0.5)),
     (None, (-19.0, 0.0, 5.0), Vec3(-20.0, 0.0, 0.5)), (None, (2.0, 2.0, 5.0), HOME)],
)  # fmt: skip
def test_home_is_returned_to_while_the_charge_lasts(lasts, here, found):
    """RTL_TYPE 6. Without a rally point it is home in any case."""
    chosen = ending(ReturnType.CHARGE, Vec3(*here), HOME, RALLY, Mission(), False, lasts)
    assert chosen == Ending(found)
    assert ending(ReturnType.CHARGE, Vec3(*here), HOME, (), Mission(), False, lasts) == Ending(HOME)


@pytest.mark.parametrize(("remaining", "ends"), [(0.9, (0.0, 0.0)), (0.02, (0.0, 60.0))])
@pytest.mark.computes
def test_a_return_by_charge_is_flown_home_or_to_the_rally_point(remaining, ends):
    """At 30 A a full battery lasts for half an hour. A return takes PX4's 100 s and more."""
    flight = Planned(UP, go(0.0, 80.0, 5.0))
    flight.params.set("RTL_TYPE", 6.0, False)
    flight.params.set("BAT1_CAPACITY", 15_000.0, False)
    flight.vehicle.rally = (Vec3(0.0, 60.0, 0.0),)
    flight.begin(90.0)
    flight.vehicle.battery = Battery(voltage=22.0, current=30.0, drawn_Ah=1.0, remaining=remaining, energy_J=1e4)  # fmt: skip
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    flight.vehicle.battery = None
    flight.fly(180.0, lambda: not flight.vehicle.armed)
    assert math.dist(flight.r[:2], ends) < 0.5
