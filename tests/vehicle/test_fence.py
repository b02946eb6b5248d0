"""The fence: how far a place is from its border, which ways are clear, and what a breach does."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest

from fcu.interface.status_texts import Code
from fcu.kernel.algebra import Vec3
from fcu.services.plan_items import MOST_ITEMS
from fcu.vehicle.areas import Disc, Polygon
from fcu.vehicle.fence import Breach, Fence, FenceLimits, Way
from fcu.vehicle.mission import Do, Step
from fcu.vehicle.modes import Mode
from tests.vehicle.flown import Flown, at
from tests.vehicle.test_mission import UP, Planned, go

SQUARE = Polygon(True, ((-20.0, -20.0), (20.0, -20.0), (20.0, 20.0), (-20.0, 20.0)))
POND = Disc(False, 10.0, 0.0, 4.0)


def depth(area, x, y):
    """How deep a place is in an area, below 0 outside, in plain Python."""
    if isinstance(area, Disc):
        return area.radius - math.hypot(x - area.x, y - area.y)
    nearest, within = math.inf, False
    for (ax, ay), (bx, by) in zip(area.corners, area.corners[1:] + area.corners[:1], strict=True):
        dx, dy = bx - ax, by - ay
        square = dx * dx + dy * dy
        part = max(0.0, min(1.0, ((x - ax) * dx + (y - ay) * dy) / square)) if square else 0.0
        nearest = min(nearest, math.hypot(x - ax - part * dx, y - ay - part * dy))
        if (ay > y) != (by > y) and x < ax + (y - ay) * dx / dy:
            within = not within
    return nearest if within else -nearest


def fence(*areas, limits=None):
    made = Fence()
    made.areas, made.limits = areas, limits or FenceLimits()
    return made


@pytest.mark.parametrize(
    ("areas", "limits", "place", "margin", "border"),
    [
        ((SQUARE,), None, (0.0, 0.0, 5.0), 20.0, Breach.BORDER),
        ((SQUARE,), None, (25.0, 0.0, 5.0), -5.0, Breach.BORDER),
        ((SQUARE,), None, (23.0, 24.0, 5.0), -5.0, Breach.BORDER),
        ((SQUARE, POND), None, (10.0, 0.0, 5.0), -4.0, Breach.BORDER),
        ((SQUARE, POND), None, (10.0, 7.0, 5.0), 3.0, Breach.BORDER),
        # two areas to stay inside: in both
        ((SQUARE, Disc(True, 30.0, 0.0, 12.0)), None, (30.0, 0.0, 5.0), -10.0, Breach.BORDER),
        ((SQUARE, Disc(True, 30.0, 0.0, 12.0)), None, (19.0, 0.0, 5.0), 1.0, Breach.BORDER),
        # a corner that is there twice
        (
            (Polygon(True, ((0.0, 0.0), (0.0, 0.0), (8.0, 0.0), (8.0, 8.0), (0.0, 8.0))),), None,
            (4.0, 3.0, 0.0), 3.0, Breach.BORDER,
        ),
        ((), FenceLimits(across=30.0, up=10.0), (0.0, 0.0, 12.0), -2.0, Breach.HIGHEST),
        ((), FenceLimits(across=30.0, up=10.0), (32.0, 0.0, 2.0), -2.0, Breach.BORDER),
    ],
)  # fmt: skip
def test_the_margin_of_a_place(areas, limits, place, margin, border):
    found = fence(*areas, limits=limits).margin(Vec3(*place))
    assert found.value == pytest.approx(margin)
    assert found.border is border


def test_without_a_fence_all_is_free():
    assert fence().margin(Vec3(1e6, 0.0, 1e6)).value == math.inf
    assert fence().is_clear(Vec3(0.0, 0.0, 0.0), Vec3(1e6, 0.0, 0.0))


def drawn(rng):
    """A fence of areas that may cross each other."""
    areas = []
    for _ in range(rng.randint(1, 4)):
        inclusion = rng.random() < 0.4
        if rng.random() < 0.5:
            areas.append(Disc(inclusion, rng.uniform(-30, 30), rng.uniform(-30, 30), rng.uniform(2, 25)))  # fmt: skip
        else:
            corners = [(rng.uniform(-40, 40), rng.uniform(-40, 40)) for _ in range(rng.randint(3, 7))]  # fmt: skip
            areas.append(Polygon(inclusion, tuple(corners)))
    return fence(*areas, limits=FenceLimits(rng.uniform(30, 60), rng.uniform(10, 30)))


@pytest.mark.parametrize("seed", range(40))
def test_the_margin_changes_by_no_more_than_the_place_moves(seed):
    rng = random.Random(seed)
    made = drawn(rng)
    for _ in range(200):
        a, b = (Vec3(*(rng.uniform(-50, 50) for _ in range(3))) for _ in range(2))
        assert abs(made.margin(a).value - made.margin(b).value) <= math.dist(a, b) + 1e-9


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.computes
def test_a_way_is_clear_if_every_place_on_it_is_inside(seed):
    rng = random.Random(seed)
    made = drawn(rng)
    for _ in range(20):
        a, b = (Vec3(*(rng.uniform(-40, 40) for _ in range(2)), 5.0) for _ in range(2))
        least = min(made.margin(a + (k / 1000.0) * (b - a)).value for k in range(1001))
        if least > 0.1:
            assert made.is_clear(a, b)
        elif least < 0.0:
            assert not made.is_clear(a, b)


def test_a_way_exactly_through_a_corner_is_not_clear():
    made = fence(Polygon(False, ((5.0, 0.0), (10.0, 5.0), (10.0, -5.0))))
    assert not made.is_clear(Vec3(5.0, -9.0, 0.0), Vec3(5.0, 9.0, 0.0))
    assert made.is_clear(Vec3(4.9, -9.0, 0.0), Vec3(4.9, 9.0, 0.0))


def test_a_way_stays_in_every_area_to_stay_inside():
    made = fence(
        Disc(True, 0.0, 0.0, 10.0),
        Polygon(True, ((5.0, -4.0), (30.0, -4.0), (30.0, 4.0), (5.0, 4.0))),
    )
    assert made.is_clear(Vec3(6.0, 0.0, 0.0), Vec3(9.0, 1.0, 0.0))
    assert not made.is_clear(Vec3(0.0, 0.0, 0.0), Vec3(9.0, 1.0, 0.0))
    assert not made.is_clear(Vec3(6.0, 0.0, 0.0), Vec3(25.0, 1.0, 0.0))


def test_a_way_along_a_border_or_through_two_sides_is_not_clear():
    square = Polygon(True, ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)))
    assert not fence(square).is_clear(Vec3(2.0, 0.0, 0.0), Vec3(8.0, 0.0, 0.0))
    away = fence(square._replace(inclusion=False))
    assert not away.is_clear(Vec3(-5.0, 5.0, 0.0), Vec3(15.0, 5.0, 0.0))
    assert not away.is_clear(Vec3(-5.0, 10.0, 0.0), Vec3(15.0, 10.0, 0.0))
    assert away.is_clear(Vec3(-5.0, 10.1, 0.0), Vec3(15.0, 10.1, 0.0))


def test_a_way_beside_a_border_is_clear_however_near_and_long_it_is():
    """Halving it looked at 360,000 places, and stalled the loop for 4 s."""
    wide = fence(
        Polygon(True, ((-9000.0, 0.1), (9000.0, 0.1), (9000.0, -9000.0), (-9000.0, -9000.0)))
    )
    assert wide.is_clear(Vec3(-8950.0, 0.0, 5.0), Vec3(8950.0, 0.0, 5.0))


@pytest.mark.parametrize("seed", range(40))
def test_the_margin_is_that_of_areas_and_limits_looked_at_one_by_one(seed):
    rng = random.Random(seed)
    made = drawn(rng)
    for _ in range(200):
        r = Vec3(*(rng.uniform(-50, 50) for _ in range(3)))
        deep = [depth(area, r.x, r.y) for area in made.areas if area.inclusion]
        away = [-depth(area, r.x, r.y) for area in made.areas if not area.inclusion]
        limits = made.limits.across - math.hypot(r.x, r.y), made.limits.up - r.z
        expected = min(*limits, *away, *deep)
        assert made.margin(r).value == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("seed", range(60))
@pytest.mark.computes
def test_a_circle_is_clear_if_every_place_on_it_is_inside(seed):
    rng = random.Random(seed)
    made = drawn(rng)
    for _ in range(20):
        center = Vec3(rng.uniform(-30, 30), rng.uniform(-30, 30), 5.0)
        radius = rng.choice([1.0, 5.0, 15.0, 30.0])
        angles = [2.0 * math.pi * k / 1000.0 for k in range(1000)]  # at most 0.19 m apart
        places = [center + Vec3(radius * math.cos(q), radius * math.sin(q), 0.0) for q in angles]
        least = min(made.margin(r).value for r in places)
        clear = made.first_outside([Way(center, center, radius)]) is None
        if least > 0.1:
            assert clear
        elif least < 0.0:
            assert not clear


@pytest.mark.parametrize("do", [Do.GO_TO, Do.CIRCLE])
def test_the_largest_plan_and_fence_are_taken(do):
    angles = [2.0 * math.pi * k / MOST_ITEMS for k in range(MOST_ITEMS)]
    corners = tuple((5000.0 * math.cos(q), 5000.0 * math.sin(q)) for q in angles)
    flight = Flown()
    flight.vehicle.take_fence((Polygon(True, corners),))
    steps = tuple(
        Step(do, Vec3(0.1 * k, float(k % 40), 5.0), radius=9.0) for k in range(MOST_ITEMS)
    )
    assert flight.vehicle.plan_outside(steps) is None


# --- the way around

ISLAND = Polygon(True, ((-100.0, -100.0), (100.0, -100.0), (100.0, 100.0), (-100.0, 100.0)))


def length(way):
    return sum(math.dist(a, b) for a, b in pairwise(way))


def least(made, way):
    """The least margin along a way."""
    places = [a + (k / 200.0) * (b - a) for a, b in pairwise(way) for k in range(201)]
    return min(made.margin(r).value for r in places)


def test_a_way_that_is_clear_is_straight():
    made = fence(SQUARE, POND)
    start, end = Vec3(-15.0, -10.0, 5.0), Vec3(15.0, -10.0, 5.0)
    assert made.way(start, end) == [end]
    assert fence().way(start, end) == [end]


def test_a_way_is_found_where_areas_to_stay_inside_lie_in_each_other_or_overlap():
    wall = Polygon(False, ((-2.0, -30.0), (2.0, -30.0), (2.0, 30.0), (-2.0, 30.0)))
    start, end = Vec3(-20.0, 0.0, 5.0), Vec3(20.0, 0.0, 5.0)
    for other in (Disc(True, 0.0, 0.0, 60.0), Disc(True, 0.0, 60.0, 120.0)):
        made = fence(ISLAND, other, wall)
        way = made.way(start, end)
        assert way is not None and len(way) > 1
        assert least(made, [start, *way]) >= 3.0 - 1e-9


def test_a_way_bends_around_what_lies_between_and_is_the_shortest():
    wall = Polygon(False, ((-2.0, -30.0), (2.0, -30.0), (2.0, 50.0), (-2.0, 50.0)))
    made = fence(ISLAND, wall)
    start, end = Vec3(-40.0, 0.0, 5.0), Vec3(40.0, 0.0, 5.0)
    way = made.way(start, end)
    assert way[-1] == end
    assert {r.z for r in way} == {5.0}
    assert least(made, [start, *way]) >= 3.0 - 1e-9
    by_corners = length([start, Vec3(-2.0, -30.0, 5.0), Vec3(2.0, -30.0, 5.0), end])
    assert by_corners < length([start, *way]) < by_corners + 6.0


def test_a_way_through_a_gap_keeps_less_and_through_none_is_not_there():
    def between(gap):
        walls = [Polygon(False, ((-2.0, y), (2.0, y), (2.0, end), (-2.0, end)))
                 for y, end in ((-120.0, -0.5 * gap), (0.5 * gap, 120.0))]  # fmt: skip
        return fence(ISLAND, *walls)

    start, end = Vec3(-40.0, 30.0, 5.0), Vec3(40.0, 30.0, 5.0)
    for gap, kept in ((8.0, 3.0), (3.0, 1.0)):
        way = between(gap).way(start, end)
        assert least(between(gap), [start, *way]) >= kept - 1e-9
    assert between(1.0).way(start, end) is None


def test_a_way_does_not_bend_farther_from_home_than_the_fence_allows():
    wall = Polygon(False, ((-2.0, -30.0), (2.0, -30.0), (2.0, 45.0), (-2.0, 45.0)))
    start, end = Vec3(-20.0, 20.0, 5.0), Vec3(20.0, 20.0, 5.0)
    assert fence(wall).way(start, end)[0].y > 45.0
    assert fence(wall, limits=FenceLimits(across=40.0)).way(start, end)[0].y < -30.0
    assert fence(wall, limits=FenceLimits(across=32.0)).way(start, end) is None


@pytest.mark.parametrize("near", [0.9, 0.5, 0.1, 0.001])
def test_a_way_begins_and_ends_nearer_to_a_border_than_it_keeps(near):
    """A vehicle that hovered half a metre beside a wall flew home through it."""
    wall = Polygon(False, ((15.0, -20.0), (30.0, -20.0), (30.0, 20.0), (15.0, 20.0)))
    made, beside, home = fence(wall), Vec3(30.0 + near, 0.0, 5.0), Vec3(0.0, 0.0, 5.0)
    for start, end in ((beside, home), (home, beside), (beside, Vec3(15.0 - near, 1.0, 5.0))):
        way = made.way(start, end)
        assert len(way) > 1
        assert least(made, [start, *way]) >= 0.9 * near
        assert least(made, way[:-1]) >= 3.0 - 1e-9


def test_a_way_from_outside_or_in_a_fence_of_many_corners_is_not_known():
    start, end = Vec3(-40.0, 0.0, 5.0), Vec3(40.0, 0.0, 5.0)
    assert fence(SQUARE).way(start, Vec3(0.0, 0.0, 5.0)) is None
    posts = [Disc(False, 6.0 * k, 0.0, 2.0) for k in range(-5, 6)]
    assert fence(*posts[:10]).way(start, end) is not None
    assert fence(*posts).way(start, end) is None


def reached(made, start, end, keeps):
    """Tell whether a chain of places 2 m apart, all with such a margin, leads from start to end."""

    def inside(k, m):
        return made.margin(Vec3(2.0 * k, 2.0 * m, 5.0)).value >= keeps

    goal = round(end.x / 2.0), round(end.y / 2.0)
    border = [(round(start.x / 2.0), round(start.y / 2.0))]
    seen = set(border)
    while border:
        k, m = border.pop()
        if (k, m) == goal:
            return True
        for there in ((k + 1, m), (k - 1, m), (k, m + 1), (k, m - 1)):
            if there not in seen and max(map(abs, there)) <= 50 and inside(*there):
                seen.add(there)
                border.append(there)
    return False


@pytest.mark.parametrize("seed", range(60))
def test_a_way_around_is_found_where_there_is_one_and_keeps_clear(seed):
    rng = random.Random(seed)
    areas = [ISLAND]
    for _ in range(rng.randint(2, 7)):
        x, y = rng.uniform(-60, 60), rng.uniform(-60, 60)
        if rng.random() < 0.4:
            areas.append(Disc(False, x, y, rng.uniform(5, 30)))
        else:
            angles = sorted(rng.uniform(0.0, 2.0 * math.pi) for _ in range(rng.randint(3, 6)))
            far = [rng.uniform(8, 45) for _ in angles]
            corners = [(x + r * math.cos(q), y + r * math.sin(q)) for q, r in zip(angles, far, strict=True)]  # fmt: skip
            areas.append(Polygon(False, tuple(corners)))
    made = fence(*areas)
    start, end = (Vec3(2.0 * rng.randint(-45, 45), side, 5.0) for side in (-90.0, 90.0))
    way = made.way(start, end)
    if way is None:
        assert not reached(made, start, end, 5.0)
        return
    assert least(made, [start, *way]) >= 1.0 - 1e-9
    assert way[-1] == end


@pytest.mark.computes
def test_a_return_flies_around_what_lies_between():
    flight = Planned(UP, go(20.0, 0.0, 5.0))
    flight.params.set("RTL_RETURN_ALT", 5.0, False)
    flight.vehicle.take_plan((UP, go(0.0, 12.0, 5.0), go(20.0, 12.0, 5.0), go(20.0, 0.0, 5.0)), 0)
    flight.vehicle.take_fence((POND,))
    flight.begin(90.0)
    assert flight.vehicle.mission.is_complete
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    flight.fly(120.0, lambda: not flight.vehicle.armed)
    assert not flight.vehicle.armed
    assert math.hypot(flight.r.x, flight.r.y) < 1.0
    assert flight.vehicle.fence.breaches == 0
    assert min(-depth(POND, r.x, r.y) for r in flight.track) > 2.0


@pytest.mark.computes
def test_a_return_without_a_way_around_flies_straight_and_says_so():
    wall = Polygon(False, ((8.0, -40.0), (12.0, -40.0), (12.0, 40.0), (8.0, 40.0)))
    flight = Planned(UP, go(20.0, 0.0, 5.0))
    flight.params.set("RTL_RETURN_ALT", 5.0, False)
    flight.params.set("GF_ACTION", 1.0, False)
    flight.begin(90.0)
    flight.vehicle.take_fence(
        (wall, SQUARE._replace(corners=tuple((1.2 * x, 1.2 * y) for x, y in SQUARE.corners)))
    )
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    flight.fly(120.0, lambda: not flight.vehicle.armed)
    assert Code.RETURN_STRAIGHT in flight.told
    assert math.hypot(flight.r.x, flight.r.y) < 1.0


# --- flown


def rushing(action, predicts=0.0, speed=5.0):
    """A script that flies east at the border of a square, and what the vehicle did."""
    flight = Flown()
    flight.params.set("GF_ACTION", float(action), False)
    flight.params.set("GF_PREDICT", predicts, False)
    flight.vehicle.take_fence((SQUARE,))
    flight.up(5.0)
    east = {"most": 0.0}

    def ask():
        east["most"] = max(east["most"], flight.r.x)
        return at(flight.r.x, 0.0, 5.3, Vec3(speed, 0.0, 0.0))

    vehicle = flight.vehicle
    for _ in range(2):
        vehicle.script.take(ask(), flight.t_us, flight.t_us * 1e-6)
    vehicle.select(Mode.OFFBOARD, flight.t_us, 0.0)
    flight.stream(ask, 60.0, lambda: vehicle.fence.breaches > 0)
    mode = vehicle.mode
    for _ in range(20):
        flight.fly(0.5)
        east["most"] = max(east["most"], flight.r.x)
    return flight, mode, east["most"]


@pytest.mark.parametrize(
    ("action", "mode"),
    [(0, Mode.OFFBOARD), (1, Mode.OFFBOARD), (2, Mode.HOLD), (3, Mode.RETURN), (5, Mode.LAND)],
)
@pytest.mark.computes
def test_a_breach_does_what_its_parameter_says(action, mode):
    flight, entered, _ = rushing(action)
    assert entered is mode
    assert flight.vehicle.fence.breaches >= 1
    assert (Code.FENCE_BREACHED in flight.told) == (action > 0)


@pytest.mark.computes
def test_a_fence_that_predicts_stops_the_vehicle_inside():
    *_, behind = rushing(2)
    flight, mode, inside = rushing(2, predicts=1.0)
    assert mode is Mode.HOLD
    assert inside < 20.5 < behind
    assert flight.vehicle.armed


@pytest.mark.computes
def test_a_breach_counts_once_until_the_vehicle_is_inside_again():
    flight, _, _ = rushing(3)
    flight.fly(60.0, lambda: not flight.vehicle.armed)
    assert flight.vehicle.fence.breaches == 1
    assert flight.told.count(Code.FENCE_BREACHED) == 1
    assert flight.told.count(Code.FENCE_INSIDE) == 1
    assert math.hypot(flight.r.x, flight.r.y) < 1.0


def test_a_vehicle_outside_its_fence_is_not_armed():
    flight = Flown()
    flight.fly(0.5)
    flight.vehicle.take_fence((Disc(True, 30.0, 0.0, 5.0),))
    answer = flight.vehicle.arm(flight.t_us, 0.0)
    assert (answer.granted, answer.told.code) == (False, Code.OUTSIDE_FENCE)


@pytest.mark.parametrize(
    ("steps", "item", "why"),
    [
        ((UP, go(0.0, 10.0, 5.0), go(30.0, 10.0, 5.0)), 2, Code.PLACE_OUTSIDE),
        ((UP, go(0.0, 10.0, 5.0), go(18.0, -10.0, 5.0)), 2, Code.WAY_OUTSIDE),
        ((UP, go(0.0, 10.0, 5.0), Step(Do.CIRCLE, Vec3(0.0, 12.0, 5.0), radius=9.0, value=1.0)), 2,
         Code.CIRCLE_OUTSIDE),
        ((UP, go(18.0, 5.0, 5.0), go(0.0, 9.0, 5.0), go(0.0, -9.0, 5.0), Step(Do.JUMP, to=1, times=1)),
         1, Code.WAY_OUTSIDE),
        ((UP, go(18.0, 10.0, 5.0), go(0.0, 10.0, 5.0)), None, None),
    ],
)  # fmt: skip
def test_a_plan_through_a_fence_is_not_flown(steps, item, why):
    flight = Planned()
    flight.vehicle.take_fence((SQUARE, POND))
    found = flight.vehicle.plan_outside(steps)
    assert (None if found is None else (found[0], found[1].code)) == (item and (item, why))
    flight.vehicle.take_plan(steps, flight.t_us)
    answer = flight.vehicle.start_plan(0, flight.t_us, 0.0)
    assert answer.granted == (item is None)


@pytest.mark.computes
def test_a_corner_is_not_rounded_into_an_exclusion():
    """The curve would cut across the post in the inside of the corner."""
    post = Disc(False, 17.2, 2.8, 1.5)
    corner = go(20.0, 0.0, 5.0, radius=9.0), go(20.0, 20.0, 5.0)
    assert any(depth(post, r.x, r.y) > 0.0 for r in _flown(*corner).track)
    flight = _flown(*corner, areas=(post,))
    assert flight.vehicle.mission.is_complete
    assert max(depth(post, r.x, r.y) for r in flight.track) < 0.0
    assert flight.vehicle.fence.breaches == 0


def _flown(*steps, areas=()):
    flight = Planned(UP, *steps)
    flight.vehicle.take_fence(areas)
    flight.begin(90.0)
    return flight


@pytest.mark.parametrize(("kind", "ends"), [(0.0, (9.0, 9.0)), (1.0, (9.0, 9.0))])
@pytest.mark.computes
def test_a_return_ends_at_the_nearest_rally_point(kind, ends):
    flight = Flown()
    flight.params.set("RTL_TYPE", kind, False)
    flight.vehicle.rally = (Vec3(-30.0, 0.0, 0.0), Vec3(9.0, 9.0, 0.0))
    flight.up(5.0)
    flight.vehicle.reposition(Vec3(12.0, 12.0, 5.0), None, flight.t_us)
    flight.fly(15.0)
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    flight.fly(90.0, lambda: not flight.vehicle.armed)
    assert not flight.vehicle.armed
    assert math.dist(flight.r[:2], ends) < 0.5


@pytest.mark.computes
def test_the_track_of_a_plan_inside_never_comes_closer_than_it_was_held_against():
    flight = _flown(go(15.0, 15.0, 5.0), go(-15.0, 15.0, 5.0), areas=(SQUARE,))
    assert flight.vehicle.mission.is_complete
    assert min(depth(SQUARE, r.x, r.y) for r in flight.track) > 4.0
    assert all(math.dist(a, b) < 0.1 for a, b in pairwise(flight.track))
