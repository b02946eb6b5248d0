"""Who may do what, when: the supervisor's answers, and what it flies then."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.interface.ground_messages import LOCAL_NED, Command, SetpointMessage, Source
from fcu.interface.ground_numbers import (
    IGNORE_ACCELERATION,
    IGNORE_POSITION,
    IGNORE_VELOCITY,
    IGNORE_YAW,
    AutoMode,
    CommandId,
    LandedState,
    MainMode,
    Result,
    SystemStatus,
)
from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import to_buffer
from fcu.kernel.rotations import from_euler
from fcu.supervisor import FORCE_MAGIC, LAND_SPEED, Supervisor

SCRIPT = Source(245, 190)
ZERO = Vec3(0.0, 0.0, 0.0)
HERE, YAW = Vec3(1.0, 2.0, 3.0), 0.7
THERE = Setpoint(Vec3(4.0, 5.0, 6.0), Vec3(1.0, 0.0, 0.0), Vec3(0.0, 1.0, 0.0), 0.2, 0.1)
OFFBOARD = (1.0, float(MainMode.OFFBOARD))


def state(r_E=HERE, v_E=ZERO):
    still = Rotors(*[0.0] * 8)
    return to_buffer(VehicleState(r_E, v_E, from_euler(0.0, 0.0, YAW), ZERO, still))


def setpoint(what=THERE, mask=0, refusal=""):
    return SetpointMessage(SCRIPT, 1, 1, 0, mask, LOCAL_NED, what, b"", refusal)


@pytest.fixture
def vehicle():
    """Disarmed, its state known."""
    supervisor = Supervisor()
    supervisor.observe(state(), 1.0)
    return supervisor


@pytest.fixture
def tell():
    """`tell(vehicle, CommandId.LAND, t=2.0)`: its verdict."""

    def command(vehicle, what, *params, t=2.0):
        padded = tuple(map(float, params)) + (0.0,) * (7 - len(params))
        return vehicle.command(Command(SCRIPT, 1, 1, what, padded, None, 0), t)

    return command


@pytest.fixture
def armed(vehicle, tell):
    assert tell(vehicle, CommandId.ARM_DISARM, 1).result is Result.ACCEPTED
    return vehicle


def test_before_the_plant_is_heard_nothing_is_possible(tell):
    vehicle = Supervisor()
    assert vehicle.status is SystemStatus.BOOT
    verdict = tell(vehicle, CommandId.ARM_DISARM, 1)
    assert verdict.result is Result.DENIED
    assert verdict.text == "Arming denied: no state from the plant yet"


def test_armed_it_holds_where_it_is(armed):
    assert armed.status is SystemStatus.ACTIVE
    assert armed.setpoint.r_c == HERE
    assert armed.setpoint.psi_c == pytest.approx(YAW)
    assert (armed.setpoint.v_c, armed.set_at) == (ZERO, 2.0)


def test_arming_twice_changes_nothing(armed, tell):
    before = armed.setpoint
    assert tell(armed, CommandId.ARM_DISARM, 1, t=5.0).result is Result.ACCEPTED
    assert armed.setpoint is before


@pytest.mark.parametrize("wanted", [0.5, -1.0, math.nan])
def test_arming_is_one_or_nought(vehicle, tell, wanted):
    assert tell(vehicle, CommandId.ARM_DISARM, wanted).result is Result.DENIED
    assert not vehicle.armed


def test_it_is_not_disarmed_in_flight_but_by_force(armed, tell):
    verdict = tell(armed, CommandId.ARM_DISARM, 0)
    assert verdict.result is Result.DENIED
    assert "in flight" in verdict.text
    assert armed.armed
    assert tell(armed, CommandId.ARM_DISARM, 0, FORCE_MAGIC).result is Result.ACCEPTED
    assert not armed.armed
    assert armed.setpoint is None


def test_it_is_not_disarmed_on_its_way_down(armed, tell):
    tell(armed, CommandId.LAND)
    assert tell(armed, CommandId.ARM_DISARM, 0).result is Result.DENIED
    assert armed.armed


def test_offboard_needs_a_setpoint_first(armed, tell):
    verdict = tell(armed, CommandId.SET_MODE, *OFFBOARD)
    assert verdict.result is Result.TEMPORARILY_REJECTED
    assert verdict.text == "Offboard denied: no setpoint yet"
    assert armed.main_mode is MainMode.AUTO


def test_a_setpoint_is_flown_in_offboard_from_when_it_was_sent(armed, tell):
    assert armed.offer(setpoint(), 3.0).result is Result.ACCEPTED
    assert armed.setpoint.r_c == HERE
    assert tell(armed, CommandId.SET_MODE, *OFFBOARD, t=4.0).result is Result.ACCEPTED
    assert (armed.setpoint, armed.set_at) == (THERE, 3.0)
    nearer = THERE._replace(r_c=HERE)
    armed.offer(setpoint(nearer), 5.0)
    assert (armed.setpoint, armed.set_at) == (nearer, 5.0)
    assert armed.landed_state is LandedState.IN_AIR


def test_a_script_may_prepare_everything_before_it_arms(vehicle, tell):
    vehicle.offer(setpoint(), 0.0)
    tell(vehicle, CommandId.SET_MODE, *OFFBOARD, t=0.0)
    assert tell(vehicle, CommandId.ARM_DISARM, 1, t=0.0).result is Result.ACCEPTED
    assert (vehicle.setpoint, vehicle.set_at) == (THERE, 0.0)


def test_ignored_fields_are_rest_and_the_yaw_that_is_flown(armed):
    armed.offer(setpoint(mask=IGNORE_VELOCITY | IGNORE_ACCELERATION | IGNORE_YAW), 3.0)
    assert armed.offered == Setpoint(THERE.r_c, ZERO, ZERO, armed.setpoint.psi_c, 0.0)


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (setpoint(refusal="frame 9: expected LOCAL_NED"), "frame 9"),
        (setpoint(mask=IGNORE_POSITION), "no position"),
    ],
)
def test_a_setpoint_that_cannot_be_flown_is_refused_with_its_reason(armed, message, why):
    verdict = armed.offer(message, 3.0)
    assert verdict.result is Result.DENIED
    assert why in verdict.text
    assert armed.offered is None


@pytest.mark.parametrize(("asked", "up"), [(4.0, 4.0), (math.nan, 2.5), (0.0, 2.5)])
def test_takeoff_climbs_and_then_holds(armed, tell, asked, up):
    assert tell(armed, CommandId.TAKEOFF, *[0.0] * 6, asked).result is Result.ACCEPTED
    assert armed.setpoint.r_c == HERE + Vec3(0.0, 0.0, up)
    assert armed.landed_state is LandedState.TAKING_OFF
    assert armed.observe(state(), 2.1) == ""
    there = HERE + Vec3(0.0, 0.0, up - 0.1)
    assert armed.observe(state(there), 4.0) == "Takeoff complete, holding"
    assert armed.sub_mode is AutoMode.LOITER
    assert armed.setpoint.r_c == HERE + Vec3(0.0, 0.0, up)


@pytest.mark.parametrize("height", [-1.0, 101.0, math.inf])
def test_takeoff_has_bounds(armed, tell, height):
    verdict = tell(armed, CommandId.TAKEOFF, *[0.0] * 6, height)
    assert verdict.result is Result.DENIED
    assert "at most 100 m" in verdict.text


@pytest.mark.parametrize("what", [CommandId.TAKEOFF, CommandId.LAND])
def test_disarmed_it_goes_nowhere(vehicle, tell, what):
    verdict = tell(vehicle, what)
    assert verdict.result is Result.DENIED
    assert "not armed" in verdict.text


def test_it_lands_where_the_ground_stops_it_and_disarms(armed, tell):
    assert tell(armed, CommandId.LAND, t=10.0).result is Result.ACCEPTED
    assert armed.setpoint.v_c == Vec3(0.0, 0.0, -LAND_SPEED)
    assert armed.landed_state is LandedState.LANDING
    sinking = Vec3(0.0, 0.0, -LAND_SPEED)
    for t in (10.5, 11.0, 12.0):  # it follows
        at = HERE + Vec3(0.0, 0.0, -LAND_SPEED * (t - 10.0))
        assert armed.observe(state(at, sinking), t) == ""
    ground = HERE + Vec3(0.0, 0.0, -LAND_SPEED * 2.0)
    assert armed.observe(state(ground), 13.0) == ""  # stands, for the first time
    assert armed.observe(state(ground, sinking), 13.5) == ""  # no, it does not
    assert armed.observe(state(ground), 14.0) == ""
    assert armed.observe(state(ground), 14.9) == ""
    assert armed.observe(state(ground), 15.0) == "Landed, disarmed"
    assert not armed.armed
    assert armed.landed_state is LandedState.ON_GROUND


def test_hold_stops_where_it_is(armed, tell):
    armed.offer(setpoint(), 3.0)
    tell(armed, CommandId.SET_MODE, *OFFBOARD)
    verdict = tell(armed, CommandId.SET_MODE, 1.0, MainMode.AUTO, AutoMode.LOITER, t=4.0)
    assert verdict.result is Result.ACCEPTED
    assert (armed.setpoint.r_c, armed.set_at) == (HERE, 4.0)


def test_what_is_not_supported_is_said_to_be(armed, tell):
    assert tell(armed, CommandId.SET_MODE, 1.0, MainMode.ACRO).result is Result.UNSUPPORTED
    assert tell(armed, 31337).result is Result.UNSUPPORTED
    assert np.array_equal(armed.state, state())
