"""PX4's own scenarios of failures that are injected, lost rotors and lost links, flown with PX4's limits.

The names are those of the test cases in PX4's test/mavsdk_tests and of failsafe_test.cpp (September 2026), the limits
stand in each. With `pytest -s` each prints what was measured: docs/failsafes.md has it in a table. Rotors and states
fail by MAVLink, in a whole vehicle with its simulator. Links are lost by a vehicle with law and plant.
"""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from fcu.interface import options
from fcu.interface.messages import Battery
from fcu.kernel.algebra import Vec3
from fcu.kernel.rows import slice_of
from fcu.mavlink.definitions import CommandId, MissionState, MissionType
from fcu.mavlink.failures import Type, Unit
from fcu.mavlink.geodesy import Origin, to_geodetic
from fcu.mavlink.plan_messages import PlanItem
from fcu.vehicle.modes import Mode
from fcu.vehicle.sticks import CENTERED, StickSource
from gcs_tools.flight.ground_script import Refused
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import from_tables
from sitl_plant.physics.types import PlantRecord
from tests.vehicle.test_px4_scenarios import Watched, print_row, to_line

RATE_HZ, LOOKS = 250, 10  # a second
ALTITUDE, LEG = 10.0, 20.0  # m
CORNERS = (LEG, 0.0), (LEG, LEG), (0.0, LEG)
ABOVE_HOME, WAYPOINT, WITHIN_S = 6, 16, 180.0
_R, _V = slice_of(PlantRecord, "state.r_E"), slice_of(PlantRecord, "state.v_E")

pytestmark = pytest.mark.slow  # flies


class Session(MemoryFlight):
    """A flight from the ground that a test leads by MAVLink, as PX4's testers do."""

    def __init__(self, lead, airframe, **parameters):
        tables = {
            "title": "One of PX4's scenarios.",
            "airframe": airframe,
            "flight": {
                "duration_s": 600.0, "rate_hz": RATE_HZ, "start": {"on_ground": True}, "ground_z_m": 0.0, "arena_m": 1000.0,
                "setpoints": [{"at_s": 0.0, "position_m": [0.0, 0.0, ALTITUDE]}],
            },
            "vehicle": {"params": {**parameters}},
        }  # fmt: skip
        super().__init__(scenario(from_tables("px4", tables)), None, (_drop, _drop))
        self._lead, self.tick, self.track = lead, 0, []

    def _log(self, stack, who):
        return lambda event: None

    def _arm(self, vehicle):
        vehicle.wait_ready()

    def _send_setpoints(self, vehicle):
        self.script = vehicle
        self.wait(0.1)
        self._lead(self)
        return False

    @property
    def now(self):
        return self._look_at(self.tick)

    def until(self, done, most_s):
        """The time until it is done, s. Fails after `most_s`."""
        since = self.tick
        while not done():
            assert (self.tick - since) / RATE_HZ <= most_s, f"not within {most_s} s"
            self.tick += RATE_HZ // LOOKS
            assert self._fly_to(self.tick), "the flight has ended"
            self.track.append(self.now.r_E)
        return (self.tick - since) / RATE_HZ

    def wait(self, seconds):
        end = self.tick + round(seconds * RATE_HZ)
        self.until(lambda: self.tick >= end, math.inf)

    def disarmed_s(self, most_s):
        return self.until(lambda: not self.now.flies, most_s)

    def up(self, altitude=ALTITUDE):
        self.script.arm()
        self.script.take_off(altitude)
        reached = lambda: abs(self.now.r_E.z - altitude) < 0.5 and math.hypot(*self.now.v_E) < 1.0  # noqa: E731
        self.until(reached, 60.0)

    def fail(self, type_, motor):
        self.script.command(CommandId.INJECT_FAILURE, Unit.MOTOR, type_, motor)

    def upload_square(self):
        origin = Origin(*options.ORIGIN)
        items = []
        for x, y in CORNERS:
            place = to_geodetic(origin, Vec3(x, y, 0.0))
            items.append(PlanItem(
                ABOVE_HOME, WAYPOINT, (0.0, 0.0, 0.0, math.nan), round(place.lat_deg * 1e7),
                round(place.lon_deg * 1e7), ALTITUDE,
            ))  # fmt: skip
        self.script.set_origin(origin)
        self.script.upload(MissionType.MISSION, items)

    def fly_square(self):
        """Its greatest distances from the legs and from its altitude, m."""
        self.script.start_mission()
        begun = len(self.track)
        self.until(lambda: self.script.mission_state().state == MissionState.COMPLETE, 500.0)
        flown = self.track[begun:]
        legs = [(0.0, 0.0), *CORNERS]
        ways = [(Vec3(*a, ALTITUDE), Vec3(*b, ALTITUDE)) for a, b in pairwise(legs)]
        off = max(min(to_line(r, *way) for way in ways) for r in flown)
        return off, max(abs(r.z - ALTITUDE) for r in flown)

    def keeps_the_square_and_returns(self, name, before=0.0):
        """PX4's limits of both. `before`: distance from the altitude that counts as the square's, m."""
        off, height = self.fly_square()
        assert off < 5.0
        assert max(before, height) < 4.0
        self.script.return_home()
        took = self.disarmed_s(WITHIN_S)
        assert self.off_home() < 5.0
        print_row(name, off_track_m=off, off_height_m=max(before, height), disarmed_s=took, off_home_m=self.off_home())  # fmt: skip

    def off_home(self):
        return math.hypot(self.now.r_E.x, self.now.r_E.y)


def _drop(_rows):
    """Keep no row."""


# --- Failure Injection


def test_failure_injection_is_rejected_mid_air_when_it_is_disabled():
    def lead(flight):
        flight.up()
        with pytest.raises(Refused, match="SYS_FAILURE_EN is 0"):
            flight.fail(Type.OFF, 1)
        flight.script.return_home()
        print_row("Reject mid-air when it is disabled", disarmed_s=flight.disarmed_s(WITHIN_S))

    Session(lead, "s1000").fly()


def test_failure_injection_is_rejected_before_arming():
    def lead(flight):
        with pytest.raises(Refused, match="SYS_FAILURE_EN is 0"):
            flight.fail(Type.OFF, 1)

    Session(lead, "s1000").fly()


# --- Control Allocation

FAILS = {"SYS_FAILURE_EN": 1.0, "CA_FAILURE_MODE": 1.0, "RTL_RETURN_ALT": ALTITUDE}


@pytest.mark.parametrize("airframe", ["s1000", "x8"])
def test_remove_one_motor(airframe):
    def lead(flight):
        flight.upload_square()
        flight.up()
        flight.fail(Type.OFF, 1)
        flight.wait(1.0)
        flight.keeps_the_square_and_returns(f"Remove one motor, {airframe}")

    Session(lead, airframe, **FAILS).fly()


def test_a_hexacopter_that_loses_one_motor_lands():
    """PX4's flies its square on with yaw left free, and returns. Ours lands where it is."""

    def lead(flight):
        flight.up()
        flight.fail(Type.OFF, 1)
        took = flight.disarmed_s(WITHIN_S)
        assert flight.off_home() < 5.0
        print_row("Remove one motor, hexa", disarmed_s=took, off_home_m=flight.off_home())

    Session(lead, "hexa", **FAILS).fly()


@pytest.mark.parametrize("motors", [(1, 2), (1, 5)], ids=["beside", "opposite"])
def test_remove_two_motors(motors):
    """PX4's flies its square on without two opposite ones of six, and is landed then. Ours lands at once."""

    def lead(flight):
        flight.up()
        for motor in motors:
            flight.fail(Type.OFF, motor)
            flight.wait(1.0)
        took = flight.disarmed_s(WITHIN_S)
        print_row(f"Remove two motors, {motors}", disarmed_s=took, off_home_m=flight.off_home())

    Session(lead, "s1000", **FAILS).fly()


@pytest.mark.parametrize(("airframe", "motors"), [("s1000", 8), ("x8", 8)])
def test_remove_and_restore_every_motor_once(airframe, motors):
    def lead(flight):
        flight.upload_square()
        flight.up()
        for motor in range(1, motors + 1):
            for type_ in (Type.OFF, Type.OK):
                flight.fail(type_, motor)
                flight.wait(1.0)
        before = max(abs(r.z - ALTITUDE) for r in flight.track[-20 * motors :])
        name = f"Remove and restore every motor once, {airframe}"
        flight.keeps_the_square_and_returns(name, before)

    Session(lead, airframe, **FAILS).fly()


def test_return_home_on_motor_failure():
    def lead(flight):
        flight.up()
        flight.fail(Type.OFF, 1)
        took = flight.disarmed_s(WITHIN_S)
        assert flight.off_home() < 5.0
        print_row("Return home on motor failure", disarmed_s=took, off_home_m=flight.off_home())

    Session(lead, "s1000", COM_ACT_FAIL_ACT=3.0, **FAILS).fly()


def test_terminate_on_motor_failure():
    def lead(flight):
        flight.up(100.0)
        flight.fail(Type.OFF, 1)
        took = flight.disarmed_s(2.0 + math.sqrt(100.0 * 2.0 / 10.0))
        print_row("Terminate on motor failure", disarmed_s=took)

    Session(lead, "s1000", COM_ACT_FAIL_ACT=4.0, **FAILS).fly()


# --- the position is lost


def test_land_on_gps_lost_during_mission():
    """PX4 is left with an attitude, and descends. Here the whole state is lost: the rotors stop."""

    def lead(flight):
        flight.upload_square()
        flight.up()
        flight.script.start_mission()
        flight.until(lambda: flight.script.plan_progress().item >= 1, 60.0)
        flight.script.command(CommandId.INJECT_FAILURE, Unit.VIO, Type.OFF, 0)
        took = flight.disarmed_s(30.0)
        print_row("Land on GPS lost during mission", disarmed_s=took, height_m=flight.now.r_E.z)

    Session(lead, "s1000", CBRK_FLIGHTTERM=0.0, **FAILS).fly()


# --- links: failsafe_test.cpp

OWNER = (1, 1), "here"
WAITS_S = 5.0  # COM_FAIL_ACT_T


class Linked(Watched):
    """Ten metres up in Position, with a pilot and a ground station for as long as they are heard."""

    def __init__(self, **parameters):
        super().__init__()
        self.pilot = self.station = True
        given = {
            "COM_FAIL_ACT_T": WAITS_S, "NAV_RCL_ACT": 2.0, "NAV_DLL_ACT": 3.0, "COM_DL_LOSS_T": 5.0,
            "COM_RCL_EXCEPT": 0.0, "MAN_ARM_GESTURE": 0.0, **parameters,
        }  # fmt: skip
        for name, value in given.items():
            self.params.set(name, value, False)
        self.heard_for(0.1)
        self.up(ALTITUDE)
        self.vehicle.set_home(
            self.vehicle.home._replace(x=100.0)
        )  # so that a return takes its time
        self.heard_for(0.1)
        assert self.vehicle.select(Mode.POSITION, self.t_us, 0.0).granted

    def fly(self, seconds, done=lambda: False):
        """On, while those who are there are heard ten times a second."""
        until = self.t_us + round(seconds * 1e6)
        while self.t_us < until and not done():
            self._speak()
            super().fly(min(0.1, (until - self.t_us) * 1e-6), done)

    def _speak(self):
        if getattr(self, "pilot", False):
            self.vehicle.fly_by(CENTERED, StickSource.JOYSTICK, OWNER, self.t_us, self.t_us * 1e-6)
        if getattr(self, "station", False):
            self.vehicle.hear_station(self.t_us, self.t_us * 1e-6)

    heard_for = fly  # where nothing is waited for

    def takes(self, mode, most_s):
        """The time until it flies a mode, s. Fails after `most_s`."""
        since = self.t_us
        self.fly(most_s, lambda: self.vehicle.mode is mode)
        assert self.vehicle.mode is mode, self.vehicle.mode
        return (self.t_us - since) * 1e-6


def test_general():
    flight = Linked()
    flight.heard_for(1.0)
    assert flight.vehicle.mode is Mode.POSITION
    flight.pilot = False
    held = flight.takes(Mode.HOLD, 1.0)
    returns = flight.takes(Mode.RETURN, 6.0)
    flight.station = False
    lands = flight.takes(Mode.LAND, 5.1 + WAITS_S)
    flight.station = True  # PX4's returns again: here a landing goes on until a mode is chosen
    flight.heard_for(0.5)
    assert flight.vehicle.mode is Mode.LAND
    flight.pilot = True
    flight.heard_for(0.5)
    assert flight.vehicle.mode is Mode.LAND
    assert flight.vehicle.select(Mode.ALTITUDE, flight.t_us, 0.0).granted
    flight.heard_for(1.0)
    assert (flight.vehicle.mode, flight.vehicle.failsafe) == (Mode.ALTITUDE, False)
    print_row("general", hold_s=held, return_s=returns, land_s=lands)


def test_battery_time_low_holds_and_then_returns():
    """The first half of can_takeover_degraded_failsafe: a pilot may take over then."""
    flight = Linked(COM_FLTT_LOW_ACT=3.0)
    full_s = flight.params["BAT1_CAPACITY"] * 3.6 / 60.0  # at 60 A
    flight.vehicle.battery = Battery(22.0, 60.0, 0.0, 60.0 / full_s, 0.0)
    held = flight.takes(Mode.HOLD, 3.0)
    returns = flight.takes(Mode.RETURN, 6.0)
    assert flight.vehicle.select(Mode.ALTITUDE, flight.t_us, 0.0).granted
    assert flight.vehicle.mode is Mode.ALTITUDE
    print_row("can_takeover_degraded_failsafe", hold_s=held, return_s=returns)


def test_no_immediate_takeover_when_failsafe_on_mode_switch():
    """PX4 enters Offboard without a stream, and holds. Here the mode is refused, and the old one goes on."""
    flight = Linked()
    answer = flight.vehicle.select(Mode.OFFBOARD, flight.t_us, 0.0)
    assert not answer.granted
    assert flight.vehicle.mode is Mode.POSITION


def test_skip_failsafe():
    flight = Linked()
    flight.vehicle.select(Mode.RETURN, flight.t_us, 0.0)
    flight.pilot = False
    flight.heard_for(2.0)
    assert flight.vehicle.mode is Mode.RETURN


def test_user_termination():
    flight = Linked(NAV_DLL_ACT=5.0, COM_FAIL_ACT_T=0.0)
    flight.station = False
    flight.fly(6.0, lambda: flight.vehicle.terminated)
    assert flight.vehicle.terminated
    flight.pilot = False
    flight.fly(0.4)
    assert flight.vehicle.terminated
    assert not flight.vehicle.armed
    assert not flight.vehicle.arm(flight.t_us, 0.0).granted
