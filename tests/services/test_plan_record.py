"""Plans as a recording tells them, and as they are read again."""

from __future__ import annotations

import math

import pytest

from fcu.interface import event_log
from fcu.interface.status_texts import Code
from fcu.services.plan_record import TOGETHER
from gcs_tools.recording.plans import PlanHistory, way
from tests.services.test_plan_protocol import (
    ACCEPTED,
    FENCE,
    MISSION,
    RALLY,
    Client,
    item,
    plan,
)

CIRCLE_OUT, POLYGON_IN, RALLY_POINT = 5004, 5001, 5100
TURNS, ROI = 18, 195


@pytest.fixture
def client():
    return Client()


def history(client, t=math.inf):
    """All that is read of what the log was told, by way of its lines of JSON."""
    told = [event_log.event((t_us or 0) * 1e-6, level, "fcu", said) for level, said, t_us in client.logged]  # fmt: skip
    return PlanHistory(event_log.of_json(event_log.as_json(each)) for each in told).at(t)


def idle(client, times=200):
    for _ in range(times):
        client.now += 0.01
        client.station.idle(0, client.now, client.now)


def corners(inclusion, *places):
    return [
        item(n, POLYGON_IN + (not inclusion), float(len(places)), east=x, north=y, frame=0, kind=1)
        for n, (x, y) in enumerate(places)
    ]


def test_plan_fence_rally_points_and_home_are_read_as_they_were_uploaded(client):
    square = (-50.0, -50.0), (50.0, -50.0), (50.0, 80.0), (-50.0, 80.0)
    fence = [*corners(True, *square), item(4, CIRCLE_OUT, 6.0, east=-30.0, frame=0, kind=1)]
    assert client.upload(fence, FENCE) == ACCEPTED
    assert client.upload([item(0, RALLY_POINT, east=7.0, north=-8.0, kind=2)], RALLY) == ACCEPTED
    assert client.upload(plan(5)) == ACCEPTED
    idle(client)
    seen = history(client)
    assert [each.command for each in seen.mission] == [
        "NAV_TAKEOFF", *3 * ["NAV_WAYPOINT"], "NAV_LAND",
    ]  # fmt: skip
    assert seen.home == (0.0, 0.0, 0.0)
    assert seen.mission[2].at(seen.home) == pytest.approx((6.0, 20.0, 10.0), abs=0.1)
    assert (seen.mission[2].x, seen.mission[2].frame) == (plan(5)[2].x, 6)
    (r,) = seen.rally
    assert r[:2] == pytest.approx((7.0, -8.0), abs=0.1)
    inside, outside = seen.fence
    assert inside.inclusion and not outside.inclusion
    assert inside.corners[2] == pytest.approx((50.0, 80.0), abs=0.3)
    assert {round(math.dist(r, (-30.0, 0.0)), 0) for r in outside.corners} == {6.0}
    assert way(seen)[-1].z == 0.0


def test_a_plan_of_many_items_is_told_in_small_parts_one_each_time(client):
    items = [item(n, north=0.1 * n) for n in range(10 * TOGETHER + 1)]
    assert client.upload(items) == ACCEPTED
    client.logged.clear()
    for _ in range(12):
        before = len(client.logged)
        idle(client, 1)
        parts = [told for _, told, _ in client.logged[before:] if told.code is Code.PLAN_ITEMS]
        assert len(parts) <= 1
    assert len(history(client).mission) == len(items)


def test_the_rest_is_told_when_the_vehicle_ends(client):
    items = [item(n, north=0.1 * n) for n in range(10 * TOGETHER)]
    assert client.upload(items) == ACCEPTED
    assert history(client).mission == ()
    client.station.close()
    assert len(history(client).mission) == len(items)


def test_progress_is_told_when_it_changes_and_no_text_is_sent(client):
    assert client.upload(plan(4)) == ACCEPTED
    idle(client)
    client.heard()
    client.vehicle.mission.done()
    idle(client, 3)
    assert history(client).current == 1
    assert history(client).progress == "item 1 of 0 to 3, NAV_WAYPOINT"
    assert [told for _, told, _ in client.logged if told.code is Code.PLAN_AT][1:] == [
        (Code.PLAN_AT, (1, 4, 0))
    ]
    assert not [m for m in client.heard() if m.get_type() == "STATUSTEXT"]


def test_what_is_cleared_is_gone(client):
    assert client.upload(plan(4)) == ACCEPTED
    assert client.upload([], MISSION) == ACCEPTED
    idle(client)
    assert (history(client).mission, history(client).progress) == ((), "")


def test_a_vehicle_without_a_plan_tells_nothing(client):
    client.vehicle.set_home(None)
    idle(client)
    assert client.logged == []


def test_events_that_are_none_of_ours_are_left_out():
    strange = [
        event_log.Event(0.0, "debug", "", "fcu", "PLAN_ITEMS", values)
        for values in ((), ("Mission",), ("Mission", 0.0, 0.0, 1.0, "a"), ("x", 1e9, 2.0, 3.0), ("Fence", "nan", 1, 2))
    ]  # fmt: skip
    strange.append(event_log.Event(0.0, "debug", "", "fcu", "PLAN_AT", ("here",)))
    assert PlanHistory(strange).at(1.0).mission == ()
