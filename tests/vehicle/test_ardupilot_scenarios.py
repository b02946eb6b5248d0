"""ArduPilot's own scenarios of missions, fences, rally points and returns, flown by law and plant, with its limits.

The names are those of ArduPilot's Tools/autotest/arducopter.py (commit 0003719). Distances are its own or a part of
them, limits its own. With `pytest -s` each prints what was measured: docs/plans.md has it in a table, and which of the
others are not flown and why.
"""

from __future__ import annotations

import math

import pytest

from fcu.interface.status_texts import Code
from fcu.kernel.algebra import Vec3
from fcu.mavlink.frames import heading
from fcu.vehicle.areas import Disc, Polygon
from fcu.vehicle.mission import Do, Step
from fcu.vehicle.modes import Mode
from tests.vehicle.flown import Flown, at
from tests.vehicle.test_mission import UP, go
from tests.vehicle.test_px4_scenarios import HEIGHT, RETURN, Watched, print_row, square

HOME = (0.0, 0.0)


def over_home(flight):
    """The height above home, m."""
    return flight.r.z - flight.vehicle.home.z


def speeds(flight, item, after_s=0.0):
    """The speeds while an item is flown, from so long after its begin on, m/s."""
    since = next(t for t, k in zip(flight.at_s, flight.item, strict=True) if k == item)
    found = zip(flight.at_s, flight.item, flight.speed, strict=True)
    return [v for t, k, v in found if k == item and t >= since + after_s]


def held_s(flight, item, low, high):
    """The longest time for which an item is flown at a speed in between, s."""
    longest, since = 0.0, None
    for t, k, v in zip(flight.at_s, flight.item, flight.speed, strict=True):
        if k == item and low <= v <= high:
            since = t if since is None else since
            longest = max(longest, t - since)
        else:
            since = None
    return longest


def degrees_of(psi):
    """A yaw as a heading, deg."""
    return math.degrees(heading(psi)) % 360.0


def turned_deg(flight):
    """The heading that the vehicle has, deg."""
    return degrees_of(flight.vehicle.pose().psi)


def between_deg(a, b):
    """The angle between two headings, deg."""
    return abs((a - b + 180.0) % 360.0 - 180.0)


# --- missions


@pytest.mark.computes
def test_fly_mission_twice_and_with_reset():
    """After a landing the plan begins anew, by itself and from an item that is set."""
    flight = Watched(*square(), Step(Do.LAND, Vec3(0.0, 0.0, 0.0)))
    off = []
    for k in range(3):
        if k == 2:
            assert flight.vehicle.set_current(0, flight.t_us).granted
        flight.begin(180.0)
        flight.disarmed_s(30.0)
        assert flight.vehicle.mission.last_reached == 4
        off.append(flight.off_home())
    assert max(off) < 1.0
    print_row("FlyMissionTwice, FlyMissionTwiceWithReset", off_home_m=max(off))


@pytest.mark.computes
def test_pause_continue():
    flight = Watched(*square(), RETURN)
    slowest_s = []
    for item, times in ((1, 1), (2, 1), (3, 2)):
        if item == 1:
            flight.begin(180.0, lambda: flight.vehicle.mission.current == 1)
        flight.fly(60.0, lambda item=item: flight.vehicle.mission.current == item)
        for _ in range(times):
            assert flight.vehicle.select(Mode.HOLD, flight.t_us, 0.0).granted
        since = flight.t_us
        flight.fly(30.0, lambda: math.hypot(*flight.state[3:5]) < 1.0)
        slowest_s.append((flight.t_us - since) * 1e-6)
        still = len(flight.speed)
        flight.fly(5.0)
        assert max(flight.speed[still:]) < 1.0
        for _ in range(times):
            assert flight.vehicle.select(Mode.MISSION, flight.t_us, 0.0).granted
    took = flight.disarmed_s(500.0)
    assert list(flight.vehicle.mission.reached) == [0, 1, 2, 3, 4]
    print_row("PAUSE_CONTINUE", below_1_m_s_after_s=max(slowest_s), disarmed_s=took)


@pytest.mark.computes
def test_do_change_speed():
    """Its fourth speed, 16 m/s, is above MPC_XY_VEL_MAX, and its third, 15 m/s, is flown as 12."""
    wanted = (4.0, 5.0), (12.0, 10.0), (10.0, 10.0)
    steps, x = [UP._replace(place=Vec3(math.nan, math.nan, HEIGHT))], 0.0
    for speed, for_s in wanted:
        x += speed * for_s + 150.0
        steps += [Step(Do.SPEED, value=speed), go(x, 0.0, HEIGHT, above_home=True)]
    flight = Watched(*steps)
    flight.params.set("MR_GUARD", 0.0, False)
    flight.params.set("MPC_XY_VEL_MAX", 12.0, False)
    flight.begin(240.0)
    held = [held_s(flight, 2 * k + 2, v - 0.5, v + 0.5) for k, (v, _) in enumerate(wanted)]
    for (_, least), found in zip(wanted, held, strict=True):
        assert found >= least
    print_row("DO_CHANGE_SPEED", **{f"at_{v:.0f}_m_s_s": s for (v, _), s in zip(wanted, held, strict=True)})  # fmt: skip


def circled(radius, center=HOME):
    """A flight of one turn round a circle, ten metres above the take-off."""
    circle = Step(Do.CIRCLE, Vec3(*center, 20.0), above_home=True, radius=radius, value=1.0)
    flight = Watched(UP._replace(place=Vec3(math.nan, math.nan, HEIGHT)), circle, RETURN)
    flight.params.set("MR_GUARD", 0.0, False)
    flight.params.set("MPC_XY_CRUISE", 5.0, False)
    flight.begin(300.0, lambda: flight.vehicle.mode is Mode.RETURN)
    return flight


@pytest.mark.parametrize(("name", "center"), [("", HOME), ("_off_center", (0.0, 30.0))])
@pytest.mark.computes
def test_mission_nav_loiter_turns(name, center):
    flight = circled(30.0, center)
    took = flight.disarmed_s(120.0)
    assert flight.off_home() < 1.0
    print_row(f"mission_NAV_LOITER_TURNS{name}", disarmed_s=took, off_home_m=flight.off_home())


@pytest.mark.computes
def test_mission_nav_loiter_turns_speed():
    """At its cruise speed for 5 s and more. The turn takes 0.6 to 2 times the circumference at it."""
    flight = circled(20.0)
    held = held_s(flight, 1, 4.0, 6.0)
    on = [t for t, k, r in zip(flight.at_s, flight.item, flight.track, strict=True) if k == 1 and abs(math.hypot(r.x, r.y) - 20.0) < 0.5]  # fmt: skip
    turn_s, expected_s = on[-1] - on[0], 2.0 * math.pi * 20.0 / 5.0
    assert held >= 5.0
    assert 0.6 * expected_s < turn_s < 2.0 * expected_s
    print_row("mission_NAV_LOITER_TURNS_speed", at_4_to_6_m_s_s=held, turn_s=turn_s)


@pytest.mark.computes
def test_mission_nav_loiter_turns_direction():
    """With a radius below 0 it turns counter-clockwise, once round within 80 deg."""
    flight = circled(-20.0, (0.0, 40.0))
    swept, last = 0.0, None
    for k, r in zip(flight.item, flight.track, strict=True):
        if k == 1 and abs(math.hypot(r.x, r.y - 40.0) - 20.0) < 0.5:
            bearing = degrees_of(math.atan2(r.y - 40.0, r.x))
            if last is not None:
                swept += (bearing - last + 180.0) % 360.0 - 180.0
            last = bearing
    assert abs(swept + 360.0) < 80.0
    print_row("mission_NAV_LOITER_TURNS_direction", swept_deg=swept)


@pytest.mark.computes
def test_mission_start():
    flight = Watched(UP._replace(place=Vec3(math.nan, math.nan, 30.0)), RETURN)
    took = []
    for _ in range(2):
        assert flight.vehicle.set_current(0, flight.t_us).granted
        flight.begin(60.0, lambda: over_home(flight) > 20.0)
        assert over_home(flight) > 20.0
        flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
        took.append(flight.disarmed_s(120.0))
    print_row("MISSION_START", disarmed_s=max(took))


def test_no_arm_without_mission_items_and_mission_index_validity():
    flight = Watched()
    answer = flight.vehicle.start_plan(-1, flight.t_us, 0.0)
    assert (answer.granted, answer.told.code) == (False, Code.NO_MISSION)
    assert flight.vehicle.mode is Mode.MISSION
    assert not flight.vehicle.armed
    assert not flight.vehicle.set_current(0, flight.t_us).granted
    flight.vehicle.take_plan(square(), flight.t_us)
    last = len(square()) - 1
    assert flight.vehicle.set_current(last, flight.t_us).granted
    assert not flight.vehicle.set_current(last + 1, flight.t_us).granted
    assert flight.vehicle.mission.current == last


def test_mav_cmd_nav_takeoff():
    flight = Flown()
    flight.up(5.0)
    heights = []
    for _ in range(50):
        flight.fly(0.1)
        heights.append(over_home(flight))
    assert all(4.5 < z < 5.5 for z in heights)
    print_row("MAV_CMD_NAV_TAKEOFF", lowest_m=min(heights), highest_m=max(heights))


@pytest.mark.computes
def test_clear_roi():
    """It faces home, south of it, and ahead again once there is no region of interest."""
    flight = Watched(
        UP, Step(Do.LOOK_AT, Vec3(0.0, 0.0, 0.0)), go(0.0, 40.0, HEIGHT), Step(Do.LOOK_AHEAD), go(0.0, 200.0, HEIGHT),
    )  # fmt: skip
    flight.begin(60.0, lambda: flight.r.y > 35.0)
    at_home = turned_deg(flight)
    flight.fly(60.0, lambda: flight.r.y > 150.0)  # it turns slowly
    ahead = turned_deg(flight)
    assert between_deg(at_home, 180.0) < 5.0
    assert between_deg(ahead, 0.0) < 5.0
    print_row("clear_roi", facing_home_deg=at_home, facing_ahead_deg=ahead)


@pytest.mark.computes
def test_mission_rtl_yaw_behaviour():
    """Its first half: the heading of the leg is kept on the way home, within 5 deg."""
    flight = Watched(UP, go(0.0, 40.0, HEIGHT, hold_s=1.0), RETURN)
    flight.begin(120.0, lambda: flight.vehicle.mode is Mode.RETURN)
    flight.disarmed_s(120.0)
    turned = turned_deg(flight)
    assert between_deg(turned, 0.0) < 5.0
    print_row("MissionRTLYawBehaviour", heading_deg=turned)


@pytest.mark.computes
def test_nav_delay():
    """By its idea: the delay is kept to within a second, and the vehicle stays where it is."""
    flight = Watched(UP, go(10.0, 0.0, HEIGHT), Step(Do.WAIT, hold_s=20.0), go(0.0, 0.0, HEIGHT))
    flight.begin(120.0)
    spans = [t for t, k in zip(flight.at_s, flight.item, strict=True) if k == 2]
    places = [r for r, k in zip(flight.track, flight.item, strict=True) if k == 2]
    took, off = spans[-1] - spans[0], max(math.dist(places[0], r) for r in places)
    assert abs(took - 20.0) < 1.0
    assert off < 1.0
    print_row("NavDelay", took_s=took, off_m=off)


@pytest.mark.computes
def test_mav_cmd_do_land_start():
    """The command leads to the landing of the plan, which is then flown."""
    flight = Watched(
        UP, go(0.0, 60.0, HEIGHT), Step(Do.LAND, Vec3(0.0, 60.0, 0.0)), Step(Do.LANDING_BEGINS),
        go(30.0, 0.0, HEIGHT), Step(Do.LAND, Vec3(30.0, -10.0, 0.0)),
    )  # fmt: skip
    flight.begin(60.0, lambda: flight.vehicle.mission.current == 1)
    assert flight.vehicle.start_plan(flight.vehicle.mission.landing, flight.t_us, 0.0).granted
    flight.fly(1.0)
    assert flight.vehicle.mission.current == 4
    took = flight.disarmed_s(180.0)
    off = math.dist(flight.r[:2], (30.0, -10.0))
    assert off < 1.0
    print_row("MAV_CMD_DO_LAND_START", disarmed_s=took, off_landing_m=off)


# --- returns and rally points


@pytest.mark.computes
def test_rtl_to_rally():
    """Its point, 50 m north and 25 m west, at its height, which here is that of every return: RTL_RETURN_ALT."""
    flight = Flown()
    flight.params.set("RTL_RETURN_ALT", 37.0, False)
    flight.params.set("RTL_TYPE", 1.0, False)
    flight.vehicle.rally = (Vec3(-25.0, 50.0, 0.0),)
    flight.up(10.0)
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    flight.fly(120.0, lambda: math.dist(flight.r[:2], (-25.0, 50.0)) < 1.0)
    height = over_home(flight)
    assert abs(height - 37.0) < 1.0
    flight.fly(60.0, lambda: over_home(flight) < 25.0)
    assert 20.0 < over_home(flight) < 25.0
    flight.vehicle.select(Mode.HOLD, flight.t_us, 0.0)
    flight.vehicle.rally = ()
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    flight.fly(240.0, lambda: not flight.vehicle.armed)
    off = math.dist(flight.r[:2], HOME)
    assert not flight.vehicle.armed
    assert off < 1.0
    print_row("RTL_TO_RALLY", over_rally_m=height, off_home_m=off)


@pytest.mark.computes
def test_a_pond_is_flown_around_on_the_way_to_a_rally_point():
    """RTL_TO_RALLY, with a fence between."""
    flight = Watched(UP, go(40.0, 0.0, HEIGHT))
    flight.vehicle.rally = (Vec3(40.0, 40.0, 0.0),)
    flight.vehicle.take_fence((Disc(False, 40.0, 20.0, 6.0),))
    flight.params.set("RTL_TYPE", 1.0, False)
    flight.begin(120.0)
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    flight.disarmed_s(180.0)
    assert math.dist(flight.r[:2], (40.0, 40.0)) < 1.0
    assert flight.vehicle.fence.breaches == 0


@pytest.mark.computes
def test_rtl_alt_final_m():
    """By its idea: the return ends over home, at RTL_DESCEND_ALT, with RTL_LAND_DELAY below 0."""
    flight = Watched(UP, go(20.0, 0.0, HEIGHT))
    flight.params.set("RTL_DESCEND_ALT", 7.0, False)
    flight.params.set("RTL_LAND_DELAY", -1.0, False)
    flight.begin(60.0)
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    flight.fly(60.0)
    assert flight.vehicle.armed
    height = over_home(flight)
    assert abs(height - 7.0) < 0.5
    assert flight.off_home() < 1.0
    print_row("RTL_ALT_FINAL_M", height_m=height, off_home_m=flight.off_home())


@pytest.mark.computes
def test_rtl_speed():
    """By its idea: the return is flown at the speed that is set."""
    flight = Watched(UP, go(80.0, 0.0, HEIGHT))
    flight.params.set("MR_GUARD", 0.0, False)
    flight.begin(90.0)
    flight.params.set("MPC_XY_CRUISE", 3.0, False)
    flight.params.set("RTL_RETURN_ALT", HEIGHT, False)
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    since = len(flight.speed)
    flight.fly(60.0, lambda: flight.off_home() < 20.0)
    middle = flight.speed[since:][-5000:]
    assert max(abs(v - 3.0) for v in middle) < 0.5
    print_row("RTLSpeed", slowest_m_s=min(middle), fastest_m_s=max(middle))


# --- fences


def breach(flight, fence, parameters=(), action=3.0):
    """A plan flown far away, round which a fence is put in flight. Returns the distance at its breach, m."""
    flight.params.set("GF_ACTION", action, False)
    flight.begin(120.0, lambda: flight.vehicle.mission.current == 2)
    for name, value in parameters:
        flight.params.set(name, value, False)
    flight.vehicle.take_fence(fence)
    flight.fly(120.0, lambda: flight.vehicle.fence.breaches > 0)
    assert flight.vehicle.fence.breaches == 1
    return flight.off_home()


FAR = (
    UP._replace(place=Vec3(math.nan, math.nan, 15.0)), go(-25.0, -25.0, 15.0, above_home=True),
    go(-100.0, -100.0, 15.0, above_home=True),
)  # fmt: skip


@pytest.mark.computes
def test_home_circle_inclusion_fence():
    """GF_MAX_HOR_DIST in place of ArduPilot's own item: a return, and without the fence the place is reached."""
    flight = Watched(*FAR)
    off = breach(flight, (), [("GF_MAX_HOR_DIST", 50.0)])
    assert flight.vehicle.mode is Mode.RETURN
    took = flight.disarmed_s(300.0)
    assert flight.off_home() < 1.0
    flight.params.set("GF_MAX_HOR_DIST", 0.0, False)
    flight.begin(180.0)
    missed = flight.nearest(-100.0, -100.0, 15.0 + flight.vehicle.home.z)
    assert missed < 5.0
    print_row("HomeCircleInclusionFence", breach_m=off, disarmed_s=took, then_missed_by_m=missed)


@pytest.mark.computes
def test_home_circle_inclusion_fence_set_home():
    flight = Flown()
    flight.params.set("GF_ACTION", 3.0, False)
    flight.params.set("GF_MAX_HOR_DIST", 50.0, False)
    flight.up(5.0)
    assert flight.vehicle.mode is Mode.HOLD
    flight.vehicle.set_home(flight.vehicle.home._replace(y=60.0))
    flight.fly(5.0)
    assert flight.vehicle.mode is Mode.RETURN
    flight.fly(180.0, lambda: not flight.vehicle.armed)
    off = math.dist(flight.r[:2], (0.0, 60.0))
    assert off < 1.0
    assert Code.FENCE_BREACHED in flight.told
    print_row("HomeCircleInclusionFence_SetHome", off_home_m=off)


@pytest.mark.computes
def test_home_circle_inclusion_fence_multiple_home_circle():
    flight = Watched(*FAR)
    off = breach(flight, (Disc(True, *HOME, 50.0), Disc(True, *HOME, 100.0)))
    assert 40.0 < off < 100.0
    assert flight.vehicle.mode is Mode.RETURN
    took = flight.disarmed_s(300.0)
    print_row("HomeCircleInclusionFence_MultipleHomeCircle", breach_m=off, disarmed_s=took)


def pushed(flight, ask, seconds, done):
    """A script that streams one setpoint after the other."""
    vehicle = flight.vehicle
    for _ in range(2):
        vehicle.script.take(ask(), flight.t_us, flight.t_us * 1e-6)
    assert vehicle.select(Mode.OFFBOARD, flight.t_us, 0.0).granted
    flight.stream(ask, seconds, done)


@pytest.mark.computes
def test_home_circle_inclusion_fence_avoidance():
    """GF_PREDICT in place of avoidance: it comes to rest within the circle of 20 m, above 17 m from home."""
    flight = Flown()
    flight.params.set("GF_ACTION", 2.0, False)
    flight.params.set("GF_PREDICT", 1.0, False)
    flight.vehicle.take_fence((Disc(True, *HOME, 20.0),))
    flight.up(10.0)

    def ask():
        return at(flight.r.x, 0.0, flight.r.z, Vec3(3.0, 0.0, 0.0))

    pushed(flight, ask, 60.0, lambda: flight.vehicle.mode is Mode.HOLD)
    off = []
    for _ in range(40):
        flight.fly(0.5)
        off.append(math.hypot(flight.r.x, flight.r.y))
    assert min(off[10:]) > 17.0
    assert max(off) < 21.0
    assert math.hypot(*flight.state[3:5]) < 0.5
    print_row("HomeCircleInclusionFence_Avoidance", farthest_m=max(off), rests_at_m=off[-1])


@pytest.mark.computes
def test_horizontal_fence():
    """Not armed outside. Led out by a script it returns, and is down at home within 180 s."""
    flight = Flown()
    flight.fly(0.5)
    flight.vehicle.take_fence((Polygon(True, ((500.0, 500.0), (600.0, 500.0), (550.0, 600.0))),))
    assert not flight.vehicle.arm(flight.t_us, 0.0).granted
    flight.vehicle.take_fence(())
    flight.params.set("GF_ACTION", 3.0, False)
    flight.params.set("GF_MAX_HOR_DIST", 30.0, False)
    flight.up(10.0)

    def ask():
        return at(flight.r.x, 0.0, flight.r.z, Vec3(5.0, 0.0, 0.0))

    pushed(flight, ask, 30.0, lambda: flight.vehicle.mode is Mode.RETURN)
    assert flight.vehicle.mode is Mode.RETURN
    since = flight.t_us
    flight.fly(180.0, lambda: not flight.vehicle.armed)
    took, off = (flight.t_us - since) * 1e-6, math.dist(flight.r[:2], HOME)
    assert not flight.vehicle.armed
    assert off < 10.0
    print_row("HorizontalFence", disarmed_s=took, off_home_m=off)


@pytest.mark.computes
def test_max_alt_fence():
    """Its second height, above home, at a third of it: breached within 5 m of the limit."""
    flight = Flown()
    flight.params.set("GF_ACTION", 3.0, False)
    flight.params.set("GF_MAX_VER_DIST", 33.0, False)
    flight.up(10.0)

    def ask():
        return at(0.0, 0.0, flight.r.z, Vec3(0.0, 0.0, 2.0))

    pushed(flight, ask, 60.0, lambda: flight.vehicle.mode is Mode.RETURN)
    height = over_home(flight)
    assert flight.vehicle.mode is Mode.RETURN
    assert abs(height - 33.0) < 5.0
    flight.fly(180.0, lambda: not flight.vehicle.armed)
    assert not flight.vehicle.armed
    print_row("MaxAltFence", breach_m=height)


def test_guided_reject_outside_fence():
    """By its idea: a place outside is refused in flight, and one inside is flown to."""
    flight = Flown()
    flight.vehicle.take_fence((Disc(True, *HOME, 20.0),))
    flight.up(10.0)
    answer = flight.vehicle.reposition(Vec3(30.0, 0.0, 10.0), None, flight.t_us)
    assert (answer.granted, answer.told.code) == (False, Code.PLACE_OUTSIDE)
    assert flight.vehicle.reposition(Vec3(10.0, 0.0, 10.0), None, flight.t_us).granted
