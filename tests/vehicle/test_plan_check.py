"""The look along a plan before it is taken: its findings, its parts, and the answers that follow."""

from __future__ import annotations

import math

import pytest

from fcu.interface.status_texts import Code
from fcu.kernel.algebra import Vec3
from fcu.vehicle import plan_check
from fcu.vehicle.mission import Do, Mission, Step
from fcu.vehicle.plan_check import AT_A_TIME, TOGETHER, along
from fcu.vehicle.plans import STILL, Pose
from tests.vehicle.test_mission import UP, Planned, go

WARN, GOVERN, REFUSE = 0.0, 1.0, 2.0
SLOW = {"MPC_XY_CRUISE": 2.0, "MPC_ACC_HOR": 0.5}
SQUARE = UP, go(20.0, 0.0, 5.0), go(20.0, 20.0, 5.0), go(0.0, 20.0, 8.0), Step(Do.LAND)


@pytest.fixture
def flight():
    made = Planned()
    made.set = lambda **values: [made.params.set(n, v, False) for n, v in values.items()]
    return made


def margins(flight, *steps):
    """The least margin of each item that is looked at, N."""
    vehicle, found = flight.vehicle, {}
    for each in along(steps, vehicle._ground(vehicle.pose()), vehicle.feasibility.look_anyhow):
        if each is not None:
            found[each.item] = min(found.get(each.item, math.inf), each.tightest.margin)
    return found


def looked(flight, *steps):
    """The last Shortfall of a plan. None: it fits."""
    found = [each for each in flight.vehicle.look_along(steps) if each is not None]
    return found[-1] if found else None


def test_each_leg_is_what_a_flight_to_its_end_would_be(flight):
    """From rest to rest a leg of a plan and a reposition are one way, and have one margin."""
    flight.set(MR_GUARD=REFUSE, **SLOW)
    (found,) = margins(flight, UP, go(20.0, 0.0, 5.0, stops=True)).values()
    vehicle, here = flight.vehicle, Pose(Vec3(0.0, 0.0, 5.3), STILL, 0.0)
    z = here.r_E.z
    led = vehicle._limits()
    import numpy as np

    from fcu.vehicle.plans import through

    reference = np.array([0.0, 0.0, z, *6 * [0.0]])
    same = vehicle.feasibility.look_anyhow.tightest(
        through(here.r_E, STILL, [Vec3(20.0, 0.0, z)], 0.0, led), reference
    )
    assert found == pytest.approx(same.margin, abs=0.3)


def test_a_corner_flown_through_and_a_fast_leg_lack_more(flight):
    flight.set(MR_GUARD=WARN)
    fast = margins(flight, *SQUARE)
    flight.set(**SLOW)
    slow = margins(flight, *SQUARE)
    assert fast.keys() == slow.keys() == {1, 2, 3}
    assert all(fast[k] < 0.0 < slow[k] for k in slow)
    # a speed of the plan counts from its item on
    part = margins(flight, *SQUARE[:2], Step(Do.SPEED, value=9.0), *SQUARE[2:])
    assert part[1] > 0.0
    assert part[3] < slow[3]


def test_a_plan_that_does_not_fit_is_refused_or_told_of_with_its_item(flight):
    flight.set(MR_GUARD=REFUSE, MPC_XY_CRUISE=2.0, MPC_ACC_HOR=2.0)
    lack = looked(
        flight,
        UP,
        go(3.0, 0.0, 5.0),
        Step(Do.SPEED, value=12.0),
        go(90.0, 0.0, 5.0),
        go(90.0, 90.0, 5.0),
    )
    assert lack.reason.code is Code.ITEM_SHORT
    flight.set(MR_GUARD=WARN)
    worst = looked(
        flight, *SQUARE, UP, go(90.0, 0.0, 5.0), Step(Do.SPEED, value=12.0), go(-90.0, 0.0, 5.0)
    )
    assert worst.item == 8
    flight.set(**SLOW)
    assert looked(flight, *SQUARE) is None
    flight.set(MR_GUARD=REFUSE)
    assert looked(flight, *SQUARE) is None


def test_nobody_looks_where_the_guard_governs(flight):
    flight.set(MR_GUARD=GOVERN, MPC_XY_CRUISE=12.0)
    assert [*flight.vehicle.look_along(SQUARE)] == []


def test_what_has_no_end_ends_the_look(flight):
    flight.set(**SLOW)
    legs = UP, go(20.0, 0.0, 5.0)
    for last in (Step(Do.LOITER, Vec3(20.0, 9.0, 5.0)), Step(Do.RETURN)):
        found = margins(flight, *legs, last, go(0.0, 0.0, 5.0))
        assert max(found) <= 2
    # a jump without end is passed over, a circle of 1000 turns is looked at for some seconds
    assert set(margins(flight, *legs, Step(Do.JUMP, times=-1, to=1))) == {1}
    circle = Step(Do.CIRCLE, Vec3(0.0, 0.0, 5.0), radius=1000.0, value=1000.0)
    assert (
        len(
            [
                *along(
                    (UP, circle),
                    flight.vehicle._ground(flight.vehicle.pose()),
                    flight.vehicle.feasibility.look_anyhow,
                )
            ]
        )
        < 100
    )
    assert TOGETHER <= 50


def test_behind_a_landing_the_plan_goes_on_from_the_ground(flight):
    flight.set(**SLOW)
    found = margins(flight, *SQUARE, UP, go(-20.0, 20.0, 5.0))
    assert set(found) == {1, 2, 3, 6}


def test_the_look_leaves_the_plan_that_is_flown_as_it_is(flight):
    flight.vehicle.take_plan(SQUARE, flight.t_us)
    before = flight.vehicle.mission.steps, flight.vehicle.mission.current, flight.vehicle.cruise
    margins(
        flight, UP, Step(Do.SPEED, value=1.0), Step(Do.HOME, Vec3(5.0, 5.0, 0.0)), go(9.0, 9.0, 9.0)
    )
    assert (
        flight.vehicle.mission.steps,
        flight.vehicle.mission.current,
        flight.vehicle.cruise,
    ) == before
    assert flight.vehicle.home != (5.0, 5.0, 0.0)


def test_a_jump_back_is_looked_at_as_it_will_be_flown(flight):
    """The way back, and the steps before it at the speed that the plan has come to."""
    flight.set(MR_GUARD=REFUSE, **SLOW)
    there = UP, go(5.0, 0.0, 5.0), go(60.0, 0.0, 5.0)
    fast = Step(Do.SPEED, value=12.0)
    assert looked(flight, *there, fast) is None
    lack = looked(flight, *there, fast, Step(Do.JUMP, to=1, times=3))
    assert lack is not None
    assert lack.item == 1
    assert looked(flight, *there, Step(Do.JUMP, to=1, times=3)) is None
    assert looked(flight, *there, fast, Step(Do.JUMP, to=1, times=0)) is None


def test_what_a_jump_ahead_always_skips_is_not_looked_at(flight):
    flight.set(MR_GUARD=REFUSE, **SLOW)
    skipped = Step(Do.SPEED, value=12.0), go(90.0, 0.0, 5.0), Step(Do.SPEED, value=2.0)
    ahead = Step(Do.JUMP, to=5, times=-1)
    plan = UP, ahead, *skipped, go(5.0, 0.0, 5.0)
    assert looked(flight, *plan) is None
    assert looked(flight, *plan[:1], ahead._replace(times=0), *plan[2:]).item == 3


def test_a_look_at_jumps_in_jumps_ends(flight):
    flight.set(**SLOW)
    jumps = [Step(Do.JUMP, to=1, times=9) for _ in range(700)]
    found = margins(flight, UP, go(20.0, 0.0, 5.0), go(0.0, 5.0, 5.0), *jumps)
    assert set(found) == {1, 2}


@pytest.fixture
def walked(monkeypatch):
    """Counts the items that are walked: done, or made ready."""
    counted, done, ready = [0], Mission.done, plan_check._Laid._looked

    def counts(whole, cost):
        def counting(*arguments):
            counted[0] += cost
            return whole(*arguments)

        return counting

    monkeypatch.setattr(Mission, "done", counts(done, 1.0))
    monkeypatch.setattr(plan_check._Laid, "_looked", counts(ready, 0.25))
    return counted


NOWHERE = {
    "distances": [Step(Do.NEAR, value=1e4)] * 1998,
    "turns": [Step(Do.TURN, value=1.0)] * 1998,
    "jumps": [Step(Do.JUMP, to=1, times=1)] * 1998,
    "landings where it is": [Step(Do.TAKE_OFF), Step(Do.LAND)] * 999,
}


@pytest.mark.parametrize("steps", NOWHERE.values(), ids=NOWHERE)
@pytest.mark.computes
def test_a_look_pauses_at_items_that_take_no_time(flight, walked, steps):
    flight.set(**SLOW)
    vehicle = flight.vehicle
    look = along((UP, *steps), vehicle._ground(vehicle.pose()), vehicle.feasibility.look_anyhow)
    most, before = 0.0, walked[0]
    for _ in look:
        most, before = max(most, walked[0] - before), walked[0]
    most = max(most, walked[0] - before)
    assert walked[0] > 1998
    assert most <= 2.0 * AT_A_TIME


@pytest.mark.computes
def test_a_guard_that_changes_again_and_again_costs_little_each_time(flight, walked):
    flight.set(MR_GUARD=GOVERN, **SLOW)
    flight.vehicle.take_plan((UP, *NOWHERE["distances"]), flight.t_us)
    for policy in (REFUSE, WARN) * 5:
        flight.set(MR_GUARD=policy)
        before = walked[0]
        assert flight.vehicle.look_again() is None
        assert walked[0] - before <= 2.0 * AT_A_TIME


def again(flight):
    """Finish another look. Returns what is told of it, and after how many parts."""
    for part in range(1000):
        told = flight.vehicle.look_again()
        if told is not None or flight.vehicle._again is None:
            return told, part
    raise AssertionError("the look has no end")


def test_a_guard_that_begins_to_refuse_looks_at_the_plan_there_is(flight):
    fast = UP, go(5.0, 0.0, 5.0), Step(Do.SPEED, value=12.0), go(90.0, 0.0, 5.0), Step(Do.LAND)
    flight.set(MR_GUARD=GOVERN)
    flight.vehicle.take_plan(fast, flight.t_us)
    assert again(flight) == (None, 0)
    flight.set(MR_GUARD=REFUSE)
    early = flight.vehicle.start_plan(-1, flight.t_us, 0.0)
    assert (early.granted, early.told.code) == (False, Code.PLAN_IN_LOOK)
    told, _ = again(flight)
    assert told.code is Code.DENIED
    late = flight.vehicle.start_plan(-1, flight.t_us, 0.0)
    assert (late.granted, late.told.code, late.told.values[0]) == (False, Code.ITEM, 3)
    assert again(flight) == (None, 0)
    flight.set(MR_GUARD=WARN)
    told, _ = again(flight)
    assert (told.code, told.values[0]) == (Code.PLAN_SHORT, 3)
    assert flight.vehicle.start_plan(-1, flight.t_us, 0.0).granted


def test_a_guard_that_begins_to_refuse_lets_what_fits_be_flown(flight):
    flight.set(MR_GUARD=GOVERN, **SLOW)
    flight.vehicle.take_plan(SQUARE, flight.t_us)
    flight.set(MR_GUARD=REFUSE)
    assert again(flight)[0] is None
    assert flight.vehicle.start_plan(-1, flight.t_us, 0.0).granted
