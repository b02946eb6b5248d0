"""PX4's own scenarios of missions, fences and returns, flown by law and plant, with PX4's limits.

The names are those of the test cases in PX4's test/mavsdk_tests (September 2026), the limits stand in each. With
`pytest -s` each prints what was measured: docs/plans.md has it in a table.
"""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from fcu.kernel.algebra import Vec3
from fcu.vehicle.areas import Polygon
from fcu.vehicle.mission import Do, Step
from fcu.vehicle.modes import Mode
from tests.vehicle.test_mission import UP, Planned, go

HEIGHT = 10.0
RETURN = Step(Do.RETURN)
FRONT = 20.0  # m, of a leg of PX4's square


def square(height=HEIGHT, **more):
    corners = (FRONT, 0.0), (FRONT, FRONT), (0.0, FRONT)
    return UP, *(go(x, y, height, above_home=True, **more) for x, y in corners)


def to_line(r, a, b):
    """The distance of a place from the straight way between two, m."""
    ab, ar = [q - p for p, q in zip(a, b, strict=True)], [q - p for p, q in zip(a, r, strict=True)]
    far = sum(x * x for x in ab)
    part = max(0.0, min(1.0, sum(x * y for x, y in zip(ab, ar, strict=True)) / far)) if far else 0.0
    return math.dist(r, [p + part * x for p, x in zip(a, ab, strict=True)])


class Watched(Planned):
    """Also keeps the item that was flown at each look, and how fast the vehicle was."""

    def __init__(self, *steps):
        super().__init__(*steps)
        self.item, self.speed = [], []

    def _look(self):
        super()._look()
        if self.vehicle.setpoint is not None:
            self.item.append(self.vehicle.mission.current)
            self.speed.append(math.hypot(*self.state[3:5]))

    def disarmed_s(self, most):
        """The time from now until the rotors stop, s. Fails after `most`."""
        since = self.t_us
        self.fly(most, lambda: not self.vehicle.armed)
        assert not self.vehicle.armed, f"not disarmed within {most} s"
        return (self.t_us - since) * 1e-6

    def off_home(self):
        return math.hypot(self.r.x - self.vehicle.home.x, self.r.y - self.vehicle.home.y)


def print_row(name, **measured):
    print(f"\n{name}: " + ", ".join(f"{key} {value:.2f}" for key, value in measured.items()))


@pytest.mark.computes
def test_takeoff_and_land():
    flight = Watched()
    flight.up(5.0)
    flight.vehicle.select(Mode.LAND, flight.t_us, 0.0)
    took = flight.disarmed_s(180.0)
    assert flight.off_home() < 1.0
    print_row("Takeoff and Land", disarmed_s=took, off_home_m=flight.off_home())


@pytest.mark.computes
def test_fly_square_multicopter_missions_including_rtl():
    flight = Watched(*square(), RETURN)
    flight.begin(180.0, lambda: flight.vehicle.mode is Mode.RETURN)
    took = flight.disarmed_s(180.0)
    assert list(flight.vehicle.mission.reached) == [0, 1, 2, 3, 4]
    assert flight.off_home() < 1.0
    print_row("Fly square ... including RTL", disarmed_s=took, off_home_m=flight.off_home())


@pytest.mark.computes
def test_fly_square_multicopter_missions_with_manual_rtl():
    flight = Watched(*square(hold_s=1.0))
    flight.begin(180.0)
    places = [(step.place.x, step.place.y, step.place.z + flight.vehicle.home.z) for step in square()[1:]]  # fmt: skip
    off = max(
        to_line(r, places[k - 2], places[k - 1])
        for r, k in zip(flight.track, flight.item, strict=True) if 2 <= k <= 3
    )  # fmt: skip
    assert off < 5.0
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    took = flight.disarmed_s(180.0)
    assert flight.off_home() < 1.0
    print_row("Fly square ... with manual RTL", off_track_m=off, disarmed_s=took)


@pytest.mark.parametrize(("guard", "least"), [(0.0, 4.0), (1.0, 3.6)], ids=["warn", "govern"])
@pytest.mark.computes
def test_fly_straight_multicopter_mission(guard, least):
    """PX4 asks for 4 m/s at item 2. The guard that governs leads more slowly, for the wind that it believes in."""
    places = [(0.0, 20.0 * n, HEIGHT) for n in range(1, 5)]
    flight = Watched(UP, *(go(x, y, z, above_home=True) for x, y, z in places))
    flight.params.set("MPC_XY_CRUISE", 5.0, False)
    flight.params.set("MR_GUARD", guard, False)
    flight.begin(180.0)
    lines = [*pairwise(places)]
    off = max(
        to_line(Vec3(r.x, r.y, r.z - flight.vehicle.home.z), *lines[k - 2])
        for r, k in zip(flight.track, flight.item, strict=True) if 2 <= k <= 4
    )  # fmt: skip
    # of the middle of the way, which is flown through
    slowest = min(v for v, k in zip(flight.speed, flight.item, strict=True) if k == 3)
    assert off < 5.0
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    took = flight.disarmed_s(180.0)
    print_row("Fly straight ...", off_track_m=off, slowest_m_s=slowest, disarmed_s=took)
    assert slowest > least


@pytest.mark.computes
def test_mission_with_external_set_current_onto_a_do_jump_item():
    flight = Watched(
        UP, go(0.0, 100.0, 15.0), go(100.0, 100.0, 15.0), Step(Do.JUMP, to=1, times=1),
        Step(Do.LAND, Vec3(100.0, 100.0, 0.0)),
    )  # fmt: skip
    flight.begin(180.0, lambda: flight.vehicle.mission.current == 2)
    assert flight.vehicle.set_current(3, flight.t_us).granted
    took = flight.disarmed_s(240.0)
    assert flight.vehicle.mission.is_complete
    assert math.dist(flight.r[:2], (100.0, 100.0)) < 1.0
    print_row("... set-current onto a DO_JUMP item", disarmed_s=took)


@pytest.mark.computes
def test_recovers_after_missing_a_waypoint_during_a_home_altitude_change():
    ahead = [go(0.0, y, 20.0, above_home=True, radius=2.0) for y in (60.0, 100.0, 140.0)]
    flight = Watched(UP._replace(place=Vec3(math.nan, math.nan, 20.0)), *ahead, Step(Do.LAND))
    flight.params.set("MPC_XY_CRUISE", 10.0, False)
    flight.begin(180.0, lambda: flight.vehicle.mission.current == 2 and flight.r.y > 91.0)
    home = flight.vehicle.home
    flight.vehicle.set_home(home._replace(z=home.z - 5.0))
    flight.fly(60.0, lambda: flight.vehicle.mission.current > 2)
    assert flight.vehicle.mission.current > 2
    took = flight.disarmed_s(120.0)
    assert flight.vehicle.mission.is_complete
    beside = max(abs(r.x) for r in flight.track)
    assert beside < 2.0
    print_row("... home-altitude change", beside_m=beside, disarmed_s=took)


@pytest.mark.computes
def test_return_direct_with_geofence_obstruction():
    wall = Polygon(False, ((10.0, 20.0), (45.0, 20.0), (45.0, 30.0), (10.0, 30.0)))
    flight = Watched(UP, go(0.0, 60.0, HEIGHT), go(30.0, 60.0, HEIGHT), go(60.0, 60.0, HEIGHT))
    flight.params.set("GF_ACTION", 1.0, False)
    flight.vehicle.take_fence((wall,))
    flight.begin(180.0, lambda: flight.vehicle.mission.current == 3)
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    took = flight.disarmed_s(400.0)
    assert flight.vehicle.fence.breaches == 0
    assert flight.off_home() < 5.0
    print_row("Return direct with geofence ...", off_home_m=flight.off_home(), disarmed_s=took)


@pytest.mark.parametrize(
    ("rally", "to", "ends"),
    [((), (0.0, 0.0), (0.0, 0.0)), (((-100.0, 100.0),), (0.0, 0.0), (0.0, 0.0)),
     (((0.0, 75.0),), (0.0, 100.0), (0.0, 75.0))],
    ids=["no rally points", "home is closest", "home is not closest"],
)  # fmt: skip
@pytest.mark.computes
def test_return_to_the_closest_of_home_and_rally_points(rally, to, ends):
    """PX4's three cases of RTL_TYPE 6, without a battery that tells how long it lasts. A quarter of its distances."""
    flight = Watched(UP, go(*to, HEIGHT))
    flight.params.set("RTL_TYPE", 6.0, False)
    flight.vehicle.rally = tuple(Vec3(x, y, 0.0) for x, y in rally)
    flight.begin(120.0)
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    took = flight.disarmed_s(150.0)
    off = math.dist(flight.r[:2], ends)
    assert off < 5.0
    if ends != (0.0, 0.0):
        assert flight.off_home() > 20.0
    print_row("RTL_TYPE=6 ...", off_m=off, disarmed_s=took)
