"""Who may do what, when: the vehicle's answers, and what it flies then."""

from __future__ import annotations

import math

import pytest

from fcu.interface.airframe import believed
from fcu.interface.messages import Battery, Setpoint, VehicleState
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import to_buffer
from fcu.kernel.rotations import from_euler
from fcu.mavlink.definitions import LandedState, SystemStatus
from fcu.parameters import Parameters
from fcu.services.status import landed_state, system_status
from fcu.settings import settings
from fcu.vehicle.modes import Mode
from fcu.vehicle.plans import Pose
from fcu.vehicle.state_machine import Answer, StateMachine

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
            Told(Code.BATTERY_CRITICAL, (4.0,)),
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


def test_it_is_not_disarmed_in_flight_but_by_force(armed):
    assert armed.disarm(TICK) == refused(Code.IN_FLIGHT)
    assert armed.armed
    assert armed.disarm(TICK, forced=True).granted
    assert not armed.armed
    assert armed.setpoint is None


def test_termination_is_for_good(armed):
    assert armed.terminate(TICK).granted
    assert system_status(armed) is SystemStatus.EMERGENCY
    assert not armed.arm(TICK, 0.0).granted


def test_it_disarms_if_it_does_not_take_off(params):
    vehicle = StateMachine(params)
    ground = state(Vec3(0.0, 0.0, 0.3), Omega=0.0)
    vehicle.observe(ground, 0, 0.0)
    vehicle.arm(0, 0.0)
    said = fly(vehicle, TICK, 12_000_000, ground)
    assert [told for _, told in said] == [Told(Code.DISARMED_IDLE)]
    assert said[0][0] == pytest.approx(10_000_000, abs=20_000)


# --- modes


@pytest.mark.parametrize("mode", [Mode.LAND, Mode.RETURN, Mode.STEP, Mode.FIGURE_EIGHT])
def test_a_mode_that_flies_needs_a_vehicle_that_may(vehicle, mode):
    assert vehicle.select(mode, 0, 0.0) == refused(Code.NOT_ARMED)
    assert vehicle.mode is Mode.HOLD


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


def test_it_comes_to_rest_ahead_of_where_it_is(params):
    vehicle = StateMachine(params, sim_only=True)
    vehicle.observe(state(v_E=Vec3(3.0, 0.0, 0.0)), 0, 0.0)
    there = vehicle.stopping_place(0)
    assert (there.y, there.z) == pytest.approx((2.0, 3.0))
    assert there.x >= 1.0 + 3.0**2 / (2.0 * params["MPC_ACC_HOR"])


def test_taking_off_in_the_air_is_denied(armed):
    assert armed.take_off(None, TICK, 0.0) == refused(Code.NOT_GROUNDED)
    assert armed.mode is Mode.HOLD


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
     (6, Mode.HOLD, SystemStatus.EMERGENCY), (7, Mode.HOLD, SystemStatus.STANDBY)],
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
    assert armed.change_speed(50.0) == refused(Code.SPEED_RANGE, 50.0, 12.0)
    armed.reposition(HERE + Vec3(30.0, 0.0, 0.0), None, 0)
    armed.observe(state(), 5_000_000, 0.0)
    assert armed.setpoint.v_c.x == pytest.approx(2.0)


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


def test_sticks_move_it_in_position_mode_for_as_long_as_they_speak(armed):
    armed.move(Vec3(1.0, 0.0, 0.0), 0.0, 0)
    assert armed.setpoint.v_c == ZERO  # in hold they do nothing
    armed.select(Mode.POSITION, 0, 0.0)
    armed.move(Vec3(1.0, 0.0, 0.0), 0.2, TICK)
    assert (armed.setpoint.v_c, armed.setpoint.psi_dot_c) == (Vec3(1.0, 0.0, 0.0), 0.2)
    fly(armed, 2 * TICK, 600_000)
    assert (armed.setpoint.v_c, armed.setpoint.psi_dot_c) == (ZERO, 0.0)
    assert armed.setpoint.r_c.x == pytest.approx(HERE.x + 0.5)


def test_where_the_sticks_have_turned_it_stays(armed):
    armed.select(Mode.POSITION, 0, 0.0)
    before = armed.flown(0).psi_c
    armed.move(Vec3(0.0, 0.0, 0.0), 1.0, 0)
    fly(armed, TICK, 2_000_000)  # nobody speaks for longer than COM_RC_LOSS_T, half a second
    assert armed.flown(2_000_000).psi_c == pytest.approx(before + 0.5)


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
