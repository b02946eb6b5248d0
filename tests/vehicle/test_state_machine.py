"""Who may do what, when: the vehicle's answers, and what it flies then."""

from __future__ import annotations

import math

import pytest

from fcu.interface.airframe import believed
from fcu.interface.messages import Battery, PositionRequest, Setpoint, VehicleState
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import to_buffer
from fcu.kernel.rotations import from_euler
from fcu.mavlink.definitions import LandedState, SystemStatus
from fcu.parameters import Parameters
from fcu.process.settings import settings
from fcu.services.status import landed_state, system_status
from fcu.vehicle import modes, plans
from fcu.vehicle.conditions import ROWS, Action, Always, Condition
from fcu.vehicle.modes import Mode
from fcu.vehicle.plans import Pose
from fcu.vehicle.setpoints import script_limits
from fcu.vehicle.state_machine import Answer, StateMachine
from fcu.vehicle.sticks import Sticks, StickSource

ZERO = Vec3(0.0, 0.0, 0.0)
HERE, YAW = Vec3(1.0, 2.0, 3.0), 0.7
THERE = Setpoint(Vec3(4.0, 5.0, 6.0), Vec3(1.0, 0.0, 0.0), Vec3(0.0, 1.0, 0.0), 0.2, 0.1)
TICK = 2000  # us
HOVER = math.sqrt(8.0 * 9.81 / 8.0 / 8.2e-5)


def state(r_E=HERE, v_E=ZERO, Omega=HOVER, roll=0.0):
    q = from_euler(roll, 0.0, YAW)
    return to_buffer(VehicleState(r_E, v_E, q, ZERO, Rotors(*[Omega] * 8)))


@pytest.fixture
def params():
    return Parameters(settings(*believed(), 500.0), 1)


@pytest.fixture
def vehicle(params):
    """Disarmed in the air, its state known; streams are lost by simulation time alone."""
    vehicle = StateMachine(params, sim_only=True)
    vehicle.observe(state(), 0, 0.0)
    return vehicle


@pytest.fixture
def armed(vehicle):
    assert vehicle.arm(0, 0.0).granted
    return vehicle


def stream(vehicle, *at_us, setpoint=THERE):
    """Setpoints that take effect at these times."""
    for us in at_us:
        vehicle.script.take(setpoint, us, us * 1e-6)
        vehicle.fly_script(us)


def fly(vehicle, from_us, to_us, what=None):
    """What is told in the ticks from `from_us` to `to_us`, with its time."""
    return [
        (t_us, told)
        for t_us in range(from_us, to_us + 1, TICK)
        for told in vehicle.observe(state() if what is None else what, t_us, t_us * 1e-6)
    ]


def refused(code, *values):
    return Answer(False, Told(code, values))


# --- arming


def test_before_the_plant_is_heard_nothing_is_possible(params):
    vehicle = StateMachine(params)
    assert system_status(vehicle) is SystemStatus.BOOT
    assert landed_state(vehicle) is LandedState.UNDEFINED
    assert vehicle.arm(0, 0.0) == refused(Code.NO_STATE)


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda v: v.observe(state(roll=0.5), 40_000, 0.0), Told(Code.TILTED, (25.0,))),
        (
            lambda v: setattr(v, "battery", Battery(20.0, 1.0, 14.4, 0.04, 1e6)),
            Told(Code.CHARGE_CRITICAL, (4.0,)),
        ),
        (lambda v: v.terminate(0), Told(Code.WAS_TERMINATED)),
        (
            lambda v: stream(v, 0, TICK) or v.select(Mode.OFFBOARD, TICK, 0.0),
            Told(Code.NO_STREAM),
        ),
    ],
)
def test_every_reason_against_arming_is_said(vehicle, spoil, why):
    spoil(vehicle)
    assert vehicle.arm(3_000_000, 3.0) == Answer(False, why)
    assert not vehicle.armed


def test_armed_it_holds_where_it_is(armed):
    assert system_status(armed) is SystemStatus.ACTIVE
    assert (armed.mode, armed.setpoint.r_c, armed.setpoint.v_c) == (Mode.HOLD, HERE, ZERO)
    assert armed.setpoint.psi_c == pytest.approx(YAW)


def test_arming_twice_changes_nothing(armed):
    before = armed.setpoint
    assert armed.arm(5_000_000, 5.0).granted
    assert armed.setpoint is before


def test_a_vehicle_in_flight_is_disarmed_by_force_alone(armed):
    assert armed.disarm(TICK) == refused(Code.IN_FLIGHT)
    assert armed.armed
    assert armed.disarm(TICK, forced=True).granted
    assert not armed.armed
    assert armed.setpoint is None


def test_termination_is_for_good(armed):
    assert armed.terminate(TICK).granted
    assert system_status(armed) is SystemStatus.FLIGHT_TERMINATION
    assert not armed.arm(TICK, 0.0).granted


def test_an_armed_vehicle_that_does_not_take_off_disarms(params):
    vehicle = StateMachine(params)
    ground = state(Vec3(0.0, 0.0, 0.3), Omega=0.0)
    vehicle.observe(ground, 0, 0.0)
    vehicle.arm(0, 0.0)
    said = fly(vehicle, TICK, 12_000_000, ground)
    assert [told for _, told in said] == [Told(Code.DISARMED_IDLE)]
    assert said[0][0] == pytest.approx(10_000_000, abs=20_000)


# --- modes


@pytest.mark.parametrize("mode", [each for each in Mode if each not in (Mode.ORBIT, Mode.OFFBOARD)])
@pytest.mark.computes
def test_a_disarmed_vehicle_may_be_put_into_any_mode(vehicle, mode):
    """Arming asks for what the mode needs then, and is denied in modes that begin in the air."""
    assert vehicle.select(mode, 0, 0.0).granted
    assert (vehicle.mode, vehicle.armed, vehicle.setpoint) == (mode, False, None)
    answer = vehicle.arm(0, 0.0)
    if mode in modes.ALOFT:
        assert answer == refused(Code.MODE_NOT_TO_ARM, mode.value)
    elif mode in modes.BY_STICKS and mode is not Mode.POSITION:
        assert answer == refused(Code.NO_STICKS)
    elif mode is Mode.TAKEOFF:
        assert answer == refused(Code.NOT_GROUNDED)
    elif mode is Mode.MISSION:
        assert answer == refused(Code.NO_MISSION)
    else:
        assert answer.granted


@pytest.mark.parametrize("mode", [Mode.RETURN, Mode.STEP, Mode.FIGURE_EIGHT, Mode.FOLLOW])
def test_a_mode_that_flies_needs_a_vehicle_in_the_air(grounded, mode):
    assert grounded.arm(2_000_000, 2.0).granted
    assert grounded.select(mode, 2_000_000, 2.0) == refused(Code.NOT_AIRBORNE)
    assert grounded.mode is Mode.HOLD


GROUND = Vec3(0.0, 0.0, 0.3)


@pytest.fixture
def grounded(params):
    """Disarmed on the ground."""
    vehicle = StateMachine(params, sim_only=True)
    fly(vehicle, 0, 2_000_000, state(GROUND, Omega=0.0))
    assert vehicle.on_ground
    return vehicle


def climbs(vehicle):
    """How far above here the plan that is flown ends, m."""
    end = 0.0
    for t_us in range(vehicle.since_us, vehicle.since_us + 30_000_000, 100_000):
        vehicle.leader.advance(t_us)
        end = vehicle.flown(t_us, Pose(vehicle.setpoint.r_c, ZERO, 0.0)).r_c.z
    return end - GROUND.z


@pytest.mark.parametrize(("to_z", "height"), [(None, 2.5), (4.3, 4.0)])
def test_a_takeoff_that_comes_first_is_flown_once_it_is_armed(grounded, to_z, height):
    """QGroundControl arms on the acknowledgement of a takeoff."""
    answer = grounded.take_off(to_z, 2_000_000, 2.0)
    assert answer == Answer(True, Told(Code.TAKES_OFF_ONCE_ARMED, (pytest.approx(height),)))
    assert (grounded.armed, grounded.mode, grounded.setpoint) == (False, Mode.TAKEOFF, None)
    assert grounded.arm(2_100_000, 2.1).granted
    assert grounded.mode is Mode.TAKEOFF
    assert climbs(grounded) == pytest.approx(height)


def test_mode_takeoff_that_comes_first_climbs_by_the_parameter(grounded):
    assert grounded.select(Mode.TAKEOFF, 2_000_000, 2.0).granted
    assert grounded.arm(2_100_000, 2.1).granted
    assert climbs(grounded) == pytest.approx(2.5)


def test_a_takeoff_that_waits_is_over_with_another_mode_or_a_disarming(grounded):
    for end in (
        lambda: grounded.select(Mode.HOLD, 2_000_000, 2.0),
        lambda: grounded.disarm(2_000_000),
    ):
        assert grounded.take_off(9.0, 2_000_000, 2.0).granted
        assert end().granted
        assert grounded.mode is Mode.HOLD
        assert grounded.select(Mode.TAKEOFF, 2_000_000, 2.0).granted
        assert grounded.arm(2_000_000, 2.0).granted
        assert climbs(grounded) == pytest.approx(2.5)
        assert grounded.disarm(2_000_000, forced=True).granted


def test_a_takeoff_that_waits_is_denied_where_it_cannot_be_flown_any_more(grounded):
    assert grounded.take_off(4.3, 2_000_000, 2.0).granted
    fly(grounded, 2_000_000, 4_000_000, state(Vec3(0.0, 0.0, 5.0), Omega=0.0))
    assert grounded.arm(4_000_000, 4.0) == refused(Code.TAKEOFF_HEIGHT, pytest.approx(-0.7))
    assert not grounded.armed


def test_a_turn_holds_where_it_comes_to_rest(armed):
    assert armed.turn(1.5, TICK).granted
    assert (armed.mode, armed.setpoint.r_c, armed.setpoint.psi_c) == (Mode.HOLD, HERE, 1.5)


def test_hold_comes_to_rest_ahead_of_where_the_vehicle_is(params):
    vehicle = StateMachine(params, sim_only=True)
    vehicle.observe(state(v_E=Vec3(3.0, 0.0, 0.0)), 0, 0.0)
    there = vehicle.stopping_place(0)
    assert (there.y, there.z) == pytest.approx((2.0, 3.0))
    assert there.x >= 1.0 + 3.0**2 / (2.0 * params["MPC_ACC_HOR"])


@pytest.mark.parametrize(("to_z", "ends"), [(None, 5.5), (13.0, 13.0), (1.0, 3.0)])
def test_a_take_off_in_the_air_climbs_on_or_holds(armed, to_z, ends):
    """As PX4: to MIS_TAKEOFF_ALT above home (3 m), to a height, or not at all from above it."""
    assert armed.take_off(to_z, TICK, 0.0).granted
    assert armed.mode is Mode.TAKEOFF
    for t_us in range(TICK, 30_000_000, 100_000):
        armed.leader.advance(t_us)
    assert armed.setpoint.r_c == pytest.approx(Vec3(HERE.x, HERE.y, ends))
    assert armed.setpoint.v_c == ZERO


def test_mode_takeoff_in_the_air_climbs_on(armed):
    assert armed.select(Mode.TAKEOFF, TICK, 0.0).granted
    assert armed.mode is Mode.TAKEOFF
    too_high = armed.take_off(1e4, TICK, 0.0)
    assert not too_high.granted and too_high.told.code is Code.TAKEOFF_HEIGHT


def test_offboard_needs_two_setpoints_at_most_half_a_second_apart(armed):
    why = Answer(False, Told(Code.NO_STREAM), later=True)
    assert armed.select(Mode.OFFBOARD, TICK, 0.0) == why
    stream(armed, TICK)
    assert armed.select(Mode.OFFBOARD, TICK, 0.0) == why
    stream(armed, TICK + 500_000 + TICK)  # too late, and by the wall too
    assert armed.select(Mode.OFFBOARD, TICK + 502_000, 0.6) == why
    stream(armed, TICK + 700_000)
    assert armed.select(Mode.OFFBOARD, TICK + 700_000, 0.7).granted
    assert armed.setpoint == THERE


def test_a_stream_that_one_clock_calls_close_is_a_stream(armed):
    armed.script.take(THERE, 0, 0.0)
    armed.script.take(THERE, 2_000_000, 0.1)  # twenty times real time
    assert armed.select(Mode.OFFBOARD, 2_000_000, 0.1).granted


def test_a_script_may_prepare_everything_before_it_arms(vehicle):
    stream(vehicle, 0, 0)
    assert vehicle.select(Mode.OFFBOARD, 0, 0.0).granted
    assert vehicle.arm(0, 0.0).granted
    assert (vehicle.setpoint, vehicle.since_us) == (THERE, 0)


def test_setpoints_are_flown_from_when_they_take_effect(armed):
    stream(armed, 0, TICK)
    armed.select(Mode.OFFBOARD, TICK, 0.0)
    nearer = THERE._replace(r_c=HERE)
    stream(armed, 5 * TICK, setpoint=nearer)
    assert (armed.setpoint, armed.since_us) == (nearer, 5 * TICK)


# --- the loss of a script


@pytest.mark.parametrize(
    ("action", "mode", "status"),
    [(0, Mode.POSITION, SystemStatus.CRITICAL), (3, Mode.RETURN, SystemStatus.CRITICAL),
     (4, Mode.LAND, SystemStatus.CRITICAL), (5, Mode.HOLD, SystemStatus.CRITICAL),
     (6, Mode.HOLD, SystemStatus.FLIGHT_TERMINATION), (7, Mode.HOLD, SystemStatus.STANDBY)],
)  # fmt: skip
def test_a_script_is_lost_to_the_tick_and_the_vehicle_does_what_it_was_told_to(
    armed, params, action, mode, status
):
    params.set("COM_OBL_RC_ACT", float(action), armed=True)
    stream(armed, 0, 100_000)
    armed.select(Mode.OFFBOARD, 100_000, 0.1)
    last = 100_000 + 1_000_000  # exactly COM_OF_LOSS_T old: not lost yet
    assert fly(armed, 102_000, last) == []
    assert armed.mode is Mode.OFFBOARD
    stopped = Told(Code.OFFBOARD_LOST_STOPPED, (1.0,))
    told = stopped if action >= 6 else Told(Code.OFFBOARD_LOST_MODE, (1.0, mode.value))
    assert fly(armed, last + TICK, last + TICK) == [(last + TICK, told)]
    assert (armed.mode, system_status(armed), armed.armed) == (mode, status, action < 6)


def test_a_setpoint_one_tick_before_its_time_keeps_the_stream(armed):
    stream(armed, 0, 100_000)
    armed.select(Mode.OFFBOARD, 100_000, 0.1)
    for k in range(1, 4):
        at = 100_000 + k * 1_000_000
        assert fly(armed, at - 998_000, at) == []
        stream(armed, at)
    assert armed.mode is Mode.OFFBOARD


def test_with_both_clocks_a_fast_simulation_does_not_lose_a_live_script(params):
    vehicle = StateMachine(params)
    vehicle.observe(state(), 0, 0.0)
    vehicle.arm(0, 0.0)
    stream(vehicle, 0, 0)
    vehicle.select(Mode.OFFBOARD, 0, 0.0)
    assert vehicle.observe(state(), 5_000_000, 0.5) == []  # ten times real time
    [told] = vehicle.observe(state(), 12_000_000, 1.1)
    assert told.code is Code.OFFBOARD_LOST_MODE


def test_a_lost_script_does_not_come_back_by_itself(armed):
    stream(armed, 0, 0)
    armed.select(Mode.OFFBOARD, 0, 0.0)
    fly(armed, TICK, 1_100_000)
    assert armed.mode is Mode.POSITION
    stream(armed, 1_200_000, 1_300_000)
    fly(armed, 1_302_000, 1_400_000)
    assert armed.mode is Mode.POSITION
    assert armed.select(Mode.OFFBOARD, 1_400_000, 1.4).granted
    assert system_status(armed) is SystemStatus.ACTIVE


# --- a battery that runs low


def drain(vehicle, remaining, from_us, seconds=1.5):
    """Codes that are told in the air with so much charge left."""
    vehicle.battery = Battery(20.0, 1.0, 14.4, remaining, 1e6)
    told = fly(vehicle, from_us, from_us + round(seconds * 1e6), state())
    return [told.code for _, told in told]


LEVELS = {0.14: Code.BATTERY_LOW, 0.06: Code.BATTERY_CRITICAL, 0.04: Code.BATTERY_EMERGENCY}


@pytest.mark.parametrize(
    ("action", "modes"),
    [
        (0, [Mode.HOLD, Mode.HOLD, Mode.HOLD]),
        (2, [Mode.HOLD, Mode.LAND, Mode.LAND]),
        (3, [Mode.HOLD, Mode.RETURN, Mode.LAND]),
    ],
)
def test_each_level_of_a_battery_is_told_once_and_acted_on(armed, params, action, modes):
    params.set("COM_LOW_BAT_ACT", float(action), armed=True)
    armed.set_home(HERE + Vec3(300.0, 0.0, 0.0))
    was, at_us = Mode.HOLD, 0
    for (remaining, code), mode in zip(LEVELS.items(), modes, strict=True):
        entered = [Code.FAILSAFE_MODE] if mode is not was else []
        assert drain(armed, remaining, at_us) == [code, *entered]
        assert drain(armed, remaining + 0.02, at_us + 2_000_000) == []  # a hair more
        assert drain(armed, remaining, at_us + 4_000_000) == []  # and again
        assert armed.mode is mode
        critical = mode is not Mode.HOLD
        expected = SystemStatus.CRITICAL if critical else SystemStatus.ACTIVE
        assert system_status(armed) is expected
        was, at_us = mode, at_us + 6_000_000


def test_a_battery_that_is_an_emergency_at_once_lands_without_a_return(armed, params):
    params.set("COM_LOW_BAT_ACT", 3.0, armed=True)
    assert drain(armed, 0.01, 0) == [Code.BATTERY_EMERGENCY, Code.FAILSAFE_MODE]
    assert armed.mode is Mode.LAND


def test_one_report_that_is_wrong_moves_nothing(armed, params):
    params.set("COM_LOW_BAT_ACT", 2.0, armed=True)
    assert drain(armed, 0.0, 0, 0.9) == []
    assert drain(armed, 0.9, 1_000_000) == []
    assert drain(armed, 0.0, 3_000_000, 0.9) == []
    assert armed.mode is Mode.HOLD


def test_a_second_counts_the_highest_charge_that_was_reported_in_it(armed, params):
    params.set("COM_LOW_BAT_ACT", 2.0, armed=True)
    assert drain(armed, 0.14, 0, 0.9) == []
    assert drain(armed, 0.0, 902_000, 0.3) == [Code.BATTERY_LOW]
    assert drain(armed, 0.14, 1_204_000) == []
    assert armed.mode is Mode.HOLD


def test_a_second_in_the_air_does_not_begin_on_the_ground(vehicle, params):
    on_ground = state(Vec3(1.0, 2.0, 0.0), Omega=0.0)
    fly(vehicle, 0, 1_000_000, on_ground)
    assert vehicle.arm(1_000_000, 1.0).granted
    vehicle.battery = Battery(20.0, 1.0, 14.4, 0.1, 1e6)
    assert Code.BATTERY_LOW not in [
        t.code for _, t in fly(vehicle, 1_002_000, 3_000_000, on_ground)
    ]
    assert vehicle.on_ground
    assert drain(vehicle, 0.1, 3_002_000, 0.9) == []
    assert drain(vehicle, 0.1, 3_904_000, 0.2) == [Code.BATTERY_LOW]


def test_a_take_off_is_refused_with_a_critical_charge(vehicle):
    on_ground = state(Vec3(1.0, 2.0, 0.0), Omega=0.0)
    fly(vehicle, 0, 1_000_000, on_ground)
    assert vehicle.arm(1_000_000, 1.0).granted
    vehicle.battery = Battery(20.0, 1.0, 14.4, 0.06, 1e6)
    refusal = refused(Code.CHARGE_CRITICAL, pytest.approx(6.0))
    assert vehicle.take_off(None, 1_000_000, 1.0) == refusal
    assert vehicle.select(Mode.TAKEOFF, 1_000_000, 1.0) == refusal
    assert vehicle.mode is Mode.HOLD


def test_a_critical_battery_does_not_end_a_landing(armed, params):
    params.set("COM_LOW_BAT_ACT", 3.0, armed=True)
    assert armed.select(Mode.LAND, 0, 0.0).granted
    assert drain(armed, 0.06, 0) == [Code.BATTERY_CRITICAL]
    assert armed.mode is Mode.LAND


def test_a_landing_of_a_script_goes_on_when_the_battery_is_critical(vehicle, params):
    params.set("COM_LOW_BAT_ACT", 3.0, armed=True)
    fly(vehicle, 0, 1_000_000, state(HERE - Vec3(0.0, 0.0, 0.8), Omega=0.0))
    assert vehicle.arm(1_000_000, 1.0).granted
    vehicle.set_home(HERE + Vec3(300.0, 0.0, 0.0))
    below = THERE._replace(r_c=HERE - Vec3(0.0, 0.0, 5.0), v_c=ZERO, a_c=ZERO, psi_dot_c=0.0)
    stream(vehicle, 1_000_000, 1_100_000, setpoint=below)
    assert vehicle.select(Mode.OFFBOARD, 1_100_000, 1.1).granted
    vehicle.battery = Battery(20.0, 1.0, 14.4, 0.06, 1e6)
    told, landing = [], []
    for t_us in range(1_200_000, 2_600_000, TICK):
        if t_us % 100_000 == 0:
            stream(vehicle, t_us, setpoint=below)
        falls = Vec3(0.0, 0.0, -0.3)
        sinking = state(HERE + (t_us * 1e-6 - 1.2) * falls, falls)
        told += [told.code for told in vehicle.observe(sinking, t_us, t_us * 1e-6)]
        landing.append(vehicle.is_landing)
    assert Code.BATTERY_CRITICAL in told
    assert all(landing[100:])
    assert vehicle.mode is Mode.LAND


@pytest.mark.parametrize(
    ("action", "mode"), [(0, Mode.POSITION), (3, Mode.LAND), (4, Mode.LAND), (5, Mode.HOLD)]
)
def test_a_script_that_is_lost_on_the_ground_it_has_met_leaves_the_vehicle_at_rest(
    vehicle, params, action, mode
):
    """Between touch-down and landed: a vehicle that held its position there would lean."""
    hindered = state(HERE + Vec3(0.0, 0.0, 0.3))
    params.set("COM_OBL_RC_ACT", float(action), armed=True)
    fly(vehicle, 0, 1_000_000, state(HERE, Omega=0.0))
    assert vehicle.arm(1_000_000, 1.0).granted
    vehicle.set_home(HERE + Vec3(300.0, 0.0, 0.0))
    below = THERE._replace(r_c=HERE - Vec3(0.0, 0.0, 5.0), v_c=ZERO, a_c=ZERO, psi_dot_c=0.0)
    stream(vehicle, 1_000_000, 1_100_000, setpoint=below)
    assert vehicle.select(Mode.OFFBOARD, 1_100_000, 1.1).granted
    for t_us in range(1_200_000, 2_400_000, TICK):
        if t_us % 100_000 == 0:
            stream(vehicle, t_us, setpoint=below)
        vehicle.observe(hindered, t_us, t_us * 1e-6)
    rests = vehicle.setpoint
    assert rests.level > 0.0  # no position is held
    assert not vehicle.on_ground
    told = fly(vehicle, 2_400_000, 3_500_000, hindered)
    assert Code.OFFBOARD_LOST_MODE in [told.code for _, told in told]
    assert (vehicle.mode, vehicle.setpoint) == (mode, rests)
    assert system_status(vehicle) is SystemStatus.CRITICAL


def test_a_pilot_takes_over_and_a_lost_script_returns_though_it_was_to_hold(armed, params):
    params.set("COM_LOW_BAT_ACT", 3.0, armed=True)
    drain(armed, 0.06, 0)
    stream(armed, 2_000_000, 2_100_000)
    assert armed.select(Mode.OFFBOARD, 2_100_000, 2.1).granted
    assert armed.mode is Mode.OFFBOARD
    assert system_status(armed) is SystemStatus.ACTIVE
    told = fly(armed, 3_102_000, 3_110_000)
    assert [(told.code, told.values[1]) for _, told in told] == [
        (Code.OFFBOARD_LOST_MODE, Mode.RETURN.value)
    ]
    assert armed.mode is Mode.RETURN
    assert system_status(armed) is SystemStatus.CRITICAL


def acts(monkeypatch, condition, action):
    """Have a condition take an action, whatever the parameters say."""
    monkeypatch.setitem(ROWS, condition, ROWS[condition]._replace(action=Always(action)))


def test_a_hold_ends_the_way_to_another_place_that_is_flown_in_hold(armed, monkeypatch):
    acts(monkeypatch, Condition.BATTERY_CRITICAL, Action.HOLD)
    assert armed.reposition(HERE + Vec3(100.0, 0.0, 0.0), None, 0).granted
    assert armed.mode is Mode.HOLD
    assert drain(armed, 0.06, 0) == [Code.BATTERY_CRITICAL, Code.FAILSAFE_MODE]
    fly(armed, 1_502_000, 20_000_000)
    assert plans.length(armed.led_to(20_000_000) - HERE) < 20.0


def test_a_pilot_who_has_taken_over_is_not_overruled_by_a_warning(armed, params, monkeypatch):
    acts(monkeypatch, Condition.BATTERY_EMERGENCY, Action.WARN)
    params.set("COM_LOW_BAT_ACT", 3.0, armed=True)
    armed.set_home(HERE + Vec3(300.0, 0.0, 0.0))
    drain(armed, 0.06, 0)
    assert armed.mode is Mode.RETURN
    assert armed.select(Mode.HOLD, 2_000_000, 2.0).granted
    assert drain(armed, 0.01, 2_002_000) == [Code.BATTERY_EMERGENCY]
    assert armed.mode is Mode.HOLD


def test_a_condition_with_no_action_is_not_told(armed, monkeypatch):
    acts(monkeypatch, Condition.BATTERY_LOW, Action.NONE)
    assert drain(armed, 0.1, 0) == []


def test_disarmed_or_on_the_ground_a_battery_is_not_acted_on_and_disarming_forgets(vehicle, params):
    params.set("COM_LOW_BAT_ACT", 2.0, armed=True)
    assert drain(vehicle, 0.1, 0) == []
    assert vehicle.arm(2_000_000, 2.0).granted
    assert drain(vehicle, 0.1, 2_000_000) == [Code.BATTERY_LOW]
    assert vehicle.disarm(4_000_000, forced=True).granted
    assert vehicle.arm(4_002_000, 4.0).granted
    assert drain(vehicle, 0.1, 4_004_000) == [Code.BATTERY_LOW]


# --- what is laid down


def test_a_reposition_leads_there_within_the_speed_and_holds(armed):
    to = HERE + Vec3(30.0, 0.0, 0.0)
    assert armed.reposition(to, None, 0).granted
    fastest = 0.0
    for t_us in range(0, 20_000_000, TICK):
        now = armed.flown(t_us)
        armed.observe(state(now.r_c, now.v_c), t_us, 0.0)
        fastest = max(fastest, now.v_c.x)
    assert math.dist(armed.setpoint.r_c, to) < 1e-4
    top = armed.feasibility.pace.top
    assert 3.0 < top < 5.0  # MPC_XY_CRUISE is more than the guard lets the reference follow
    assert fastest == pytest.approx(top, abs=0.01)


def test_speed_is_changed_within_its_limit(armed):
    assert armed.change_speed(2.0).granted
    assert armed.change_speed(0.05) == refused(Code.SPEED_RANGE, 0.05, 12.0)
    armed.reposition(HERE + Vec3(30.0, 0.0, 0.0), None, 0)
    armed.observe(state(), 5_000_000, 0.0)
    assert armed.setpoint.v_c.x == pytest.approx(2.0)


def test_a_speed_above_the_limit_is_limited_and_said(armed):
    told = Told(Code.SPEED_LIMITED, (50.0, 12.0))
    assert armed.change_speed(50.0) == Answer(True, told)
    assert armed.cruise == 12.0
    assert armed.change_speed(1.0).granted and armed.cruise == 1.0
    assert armed.change_speed(-1.0).granted and armed.cruise is None


def test_a_place_that_is_gone_to_too_fast_is_gone_to_at_the_limit_and_that_is_said(armed):
    answer = armed.reposition(HERE + Vec3(30.0, 0.0, 0.0), None, 0, speed=50.0)
    assert answer == Answer(True, Told(Code.SPEED_LIMITED, (50.0, 12.0)))


def test_a_return_climbs_goes_home_and_lands(armed):
    home = armed.home
    armed.observe(state(HERE + Vec3(20.0, 0.0, 0.0)), TICK, 0.0)
    armed.arm(TICK, 0.0)
    armed.select(Mode.HOLD, TICK, 0.0)
    armed.select(Mode.RETURN, TICK, 0.0)
    highest, said = 0.0, []
    for t_us in range(2 * TICK, 40_000_000, TICK):
        now = armed.flown(t_us)
        said += armed.observe(state(now.r_c, now.v_c), t_us, 0.0)
        highest = max(highest, now.r_c.z)
        if armed.mode is Mode.LAND:
            break
    assert said == [Told(Code.PLAN_COMPLETE, ("Return", "Land"))]
    assert highest == pytest.approx(home.z + 10.0, abs=0.01)
    assert math.dist(armed.flown(t_us).r_c[:2], home[:2]) < 1e-3


def return_home(armed, for_us):
    """Each height at which the setpoint rests above home, with the time that it does, s. Then the mode."""
    armed.observe(state(HERE + Vec3(20.0, 0.0, 0.0)), TICK, 0.0)
    armed.select(Mode.RETURN, TICK, 0.0)
    rests = {}
    for t_us in range(2 * TICK, for_us, TICK):
        now = armed.flown(t_us)
        armed.observe(state(now.r_c, now.v_c), t_us, 0.0)
        if armed.mode is not Mode.RETURN:
            break
        if now.v_c == ZERO:
            up = round(now.r_c.z - armed.home.z, 2)
            rests[up] = rests.get(up, 0.0) + TICK * 1e-6
    return rests, armed.mode


def test_a_return_waits_above_home_as_long_and_as_low_as_it_is_told(armed, params):
    assert params.set("RTL_DESCEND_ALT", 4.0, False) and params.set("RTL_LAND_DELAY", 6.0, False)
    rests, mode = return_home(armed, 60_000_000)
    settles = 4.0 / params.pace.f_m
    assert mode is Mode.LAND
    assert rests[4.0] == pytest.approx(6.0 + settles, abs=0.1)


@pytest.mark.computes
def test_a_return_that_is_told_to_wait_for_ever_does_not_land(armed, params):
    assert params.set("RTL_LAND_DELAY", -1.0, False)
    rests, mode = return_home(armed, 60_000_000)
    assert mode is Mode.RETURN
    assert rests[10.0] > 25.0


def test_a_take_off_is_as_fast_as_it_is_told(grounded, params):
    assert params.set("MPC_TKO_SPEED", 1.5, False)
    assert grounded.arm(2_000_000, 2.0).granted
    assert grounded.take_off(30.0, 2_000_000, 2.0).granted
    fastest = 0.0
    for t_us in range(2_000_000, 10_000_000, 100_000):
        grounded.leader.advance(t_us)
        flown = grounded.flown(t_us, Pose(grounded.setpoint.r_c, ZERO, 0.0))
        fastest = max(fastest, flown.v_c.z)
    assert fastest == pytest.approx(1.5)


def test_the_tilt_that_is_allowed_bounds_the_acceleration_across(armed, params):
    asked = params["MPC_ACC_HOR"]
    assert params.set("MPC_ACC_HOR", 8.0, False) and params.set("MPC_TILTMAX_AIR", 20.0, False)
    most = 9.80665 * math.tan(math.radians(20.0))
    assert asked < most < 8.0
    assert plans.limits(params, None).acceleration == pytest.approx(most)
    assert script_limits(params).across_acceleration == pytest.approx(most)


def test_sticks_move_it_in_position_mode_alone(armed):
    ahead = Sticks(pitch=1.0), StickSource.JOYSTICK, ((255, 190), "one")
    armed.fly_by(*ahead, 0, 0.0)
    assert armed.setpoint.v_c == ZERO and armed.setpoint.a_c == ZERO  # in hold they do nothing
    armed.select(Mode.POSITION, 0, 0.0)
    armed.fly_by(*ahead, TICK, 0.002)
    a = armed.setpoint.a_c
    assert math.hypot(a.x, a.y) == pytest.approx(armed.feasibility.pace.acceleration)
    assert math.atan2(a.y, a.x) == pytest.approx(YAW)


def test_a_figure_of_eight_that_is_too_tight_is_denied(armed, params):
    params.set("REF_8_SPEED", 10.0, armed=True)
    asks = pytest.approx(21.2, abs=0.05)
    assert armed.select(Mode.FIGURE_EIGHT, 0, 0.0) == refused(Code.ASKS_TOO_MUCH, asks, 3.0)
    assert armed.mode is Mode.HOLD


@pytest.mark.parametrize("mode", [Mode.STEP, Mode.FIGURE_EIGHT])
def test_a_generator_stops_first(armed, mode):
    armed.script.sim_only = True
    stream(armed, 0, 100_000, setpoint=THERE._replace(r_c=HERE, v_c=Vec3(5.0, 0.0, 0.0)))
    armed.select(Mode.OFFBOARD, 100_000, 0.1)
    armed.select(mode, 100_000, 0.1)
    assert armed.flown(100_000).v_c.x == pytest.approx(5.0, abs=0.3)
    fly(armed, 102_000, 1_000_000)
    assert 0.0 < armed.setpoint.v_c.x <= 5.3  # still braking
    a = armed.feasibility.pace.acceleration
    assert 0.5 < a < 3.0  # MPC_ACC_HOR is more than the guard leaves
    assert armed.setpoint.a_c.x == pytest.approx(-a, abs=0.01)


# --- the ground, after a flight


def test_after_a_landing_it_is_disarmed_after_the_time_that_is_set_and_no_sooner(vehicle, params):
    params.set("COM_DISARM_LAND", 2.0, armed=True)
    on_ground = state(Vec3(1.0, 2.0, 0.0), Omega=0.0)
    fly(vehicle, 0, 1_000_000, on_ground)
    assert vehicle.arm(1_000_000, 1.0).granted
    fly(vehicle, 1_002_000, 3_000_000, state(Vec3(1.0, 2.0, 3.0)))
    told = fly(vehicle, 3_002_000, 9_000_000, on_ground)
    (landed,) = (t_us for t_us, told in told if told.code is Code.LANDED)
    (disarmed,) = (t_us for t_us, told in told if told.code is Code.DISARMED_LANDED)
    assert disarmed - landed == pytest.approx(2_000_000, abs=40_000)
    times = vehicle.flight_times
    assert (times.number, times.armed_us, times.landed_us) == (1, 1_000_000, landed)
    assert 1_002_000 <= times.took_off_us < 2_000_000


def test_a_take_off_that_is_granted_after_a_landing_is_not_ended_by_the_wait_of_the_landing(
    vehicle, params
):
    params.set("COM_DISARM_LAND", 2.0, armed=True)
    on_ground = state(Vec3(1.0, 2.0, 0.0), Omega=0.0)
    fly(vehicle, 0, 1_000_000, on_ground)
    assert vehicle.arm(1_000_000, 1.0).granted
    fly(vehicle, 1_002_000, 3_000_000, state(Vec3(1.0, 2.0, 3.0)))
    t_us = 3_002_000
    while not vehicle.on_ground:
        vehicle.observe(on_ground, t_us, t_us * 1e-6)
        t_us += TICK
    fly(vehicle, t_us, t_us + 1_900_000, on_ground)
    t_us += 1_902_000
    assert vehicle.take_off(None, t_us, t_us * 1e-6).granted
    fly(vehicle, t_us, t_us + 300_000, on_ground)
    assert vehicle.armed


def test_a_velocity_goes_on_from_where_the_setpoint_is_by_now(armed):
    moving = THERE._replace(r_c=HERE, v_c=Vec3(1.0, 0.0, 0.0), a_c=ZERO, psi_dot_c=0.0)
    stream(armed, 10_000_000, 10_100_000, setpoint=moving)
    assert armed.select(Mode.OFFBOARD, 10_100_000, 10.1).granted
    armed.observe(state(HERE + Vec3(0.9, 0.0, 0.0)), 10_200_000, 10.2)
    asked = PositionRequest(None, Vec3(0.0, 1.0, 0.0), None, None, 0.0)
    made, told = armed.resolve(asked, 11_100_000)
    assert told is None
    assert made.r_c == pytest.approx(HERE + Vec3(1.0, 0.0, 0.0))
    assert made.v_c == Vec3(0.0, 1.0, 0.0)


@pytest.mark.parametrize("m_hat_0", [5.0, 8.0])
def test_thrust_at_mpc_thr_hover_carries_the_believed_mass_whatever_the_law_begins_with(m_hat_0):
    law, guard = settings(*believed(), 500.0)
    law = law._replace(initial=law.initial._replace(m_hat_0=m_hat_0))
    throttle = StateMachine(Parameters(type(settings(*believed(), 500.0))(law, guard), 1)).throttle
    assert throttle.force(0.6) == pytest.approx(8.0 * 9.81)
    assert throttle.of(throttle.force(0.9)) == pytest.approx(0.9)
