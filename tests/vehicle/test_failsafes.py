"""Failsafes of the state machine: each condition, and every pair of them, in both orders and at once."""

from __future__ import annotations

import itertools
import math

import pytest

from fcu.interface.airframe import believed
from fcu.interface.messages import Battery, VehicleState
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import to_buffer
from fcu.kernel.rotations import from_euler
from fcu.kernel.rows import column_of, slice_of
from fcu.laws import rotor_loss
from fcu.laws.rotor_loss import Fate
from fcu.parameters import Parameters
from fcu.process.settings import settings
from fcu.vehicle.conditions import LOOK_US, MODES, ROWS, SETTLED_US, Action, By, Condition, Watch
from fcu.vehicle.modes import Mode
from fcu.vehicle.setpoints import RATES
from fcu.vehicle.state_machine import Answer, StateMachine
from fcu.vehicle.sticks import Sticks, StickSource

TICK = 2000  # us
HIGH, ZERO = Vec3(0.0, 0.0, 20.0), Vec3(0.0, 0.0, 0.0)
HOVER = math.sqrt(8.0 * 9.81 / 8.0 / 8.2e-5)
OWNER = (1, 1), "here"
CONTRADICTED = column_of(Watch, "contradicted")


def state(roll=0.0, pitch=0.0, r_E=HIGH, Omega=HOVER):
    q = from_euler(math.radians(roll), math.radians(pitch), 0.3)
    return to_buffer(VehicleState(r_E, ZERO, q, ZERO, Rotors(*[Omega] * 8)))


@pytest.fixture
def params():
    return Parameters(settings(*believed(), 500.0), 1)


@pytest.fixture
def vehicle(params):
    """Armed in Hold, in the air."""
    made = StateMachine(params, sim_only=True)
    made.observe(state(), 0, 0.0)
    assert made.arm(0, 0.0).granted
    return made


def fly(vehicle, from_us, to_us, what=None):
    """(time, code) of what is told in the ticks from `from_us` to `to_us`."""
    return [
        (t_us, told.code)
        for t_us in range(from_us, to_us + 1, TICK)
        for told in vehicle.observe(
            moving(state() if what is None else what, t_us), t_us, t_us * 1e-6
        )
    ]


def moving(row, t_us):
    """The state, with a rotor's speed that is another at each tick, as in flight."""
    row = row.copy()
    row[slice_of(VehicleState, "Omega").stop - 1] += 1e-9 * t_us
    return row


# --- a ground station


@pytest.mark.parametrize(("act", "mode"), [(1, Mode.HOLD), (2, Mode.RETURN), (3, Mode.LAND)])
def test_a_ground_station_is_lost_at_the_look_after_its_time(vehicle, params, act, mode):
    params.set("NAV_DLL_ACT", float(act), True)
    params.set("COM_DL_LOSS_T", 5.0, True)
    vehicle.hear_station(100_000, 0.1)
    told = fly(vehicle, TICK, 5_200_000)
    first = told[0][0]
    assert 0 < first - 5_100_000 <= LOOK_US + TICK
    assert told == [(first, Code.STATION_LOST), (first, Code.FAILSAFE_MODE)]
    assert (vehicle.mode, vehicle.failsafe) == (mode, True)
    assert vehicle.hear_station(5_300_000, 5.3) == Told(Code.STATION_BACK)
    assert vehicle.hear_station(5_400_000, 5.4) is None
    assert vehicle.mode is mode  # latched until somebody chooses another
    again = [code for _, code in fly(vehicle, 5_402_000, 10_440_000)]
    assert Code.STATION_LOST in again


@pytest.mark.parametrize(("act", "terminated"), [(5, True), (6, False)])
def test_a_lost_station_may_stop_the_rotors(vehicle, params, act, terminated):
    params.set("NAV_DLL_ACT", float(act), True)
    vehicle.hear_station(0, 0.0)
    assert [code for _, code in fly(vehicle, TICK, 11_000_000)] == [
        Code.STATION_LOST, Code.FAILSAFE_STOPPED,
    ]  # fmt: skip
    assert (vehicle.armed, vehicle.terminated) == (False, terminated)


def test_by_default_nobody_misses_a_ground_station(vehicle):
    vehicle.hear_station(0, 0.0)
    assert fly(vehicle, TICK, 12_000_000) == []


def test_a_vehicle_that_needs_a_station_is_not_armed_without(params):
    vehicle = StateMachine(params, sim_only=True)
    vehicle.observe(state(), 0, 0.0)
    params.set("NAV_DLL_ACT", 2.0, False)
    assert vehicle.arm(0, 0.0) == Answer(False, Told(Code.NO_STATION))
    vehicle.hear_station(0, 0.0)
    assert vehicle.arm(10_000_000, 10.0).granted


def test_a_station_heard_by_the_wall_s_clock_is_not_lost_in_a_fast_simulation(params):
    vehicle = StateMachine(params)
    vehicle.observe(state(), 0, 0.0)
    vehicle.arm(0, 0.0)
    params.set("NAV_DLL_ACT", 2.0, True)
    vehicle.hear_station(0, 0.0)
    assert vehicle.observe(state(), 40_000_000, 5.0) == []
    assert vehicle.observe(state(), 100_000_000, 10.5)[0].code is Code.STATION_LOST


# --- sticks, in modes that they do not fly


@pytest.mark.parametrize(("bit", "mode"), [(2, Mode.HOLD), (4, Mode.OFFBOARD)])
def test_lost_sticks_end_a_mode_that_is_not_excepted(vehicle, params, bit, mode):
    def lose(excepted):
        params.set("COM_RCL_EXCEPT", float(excepted), True)
        at = lose.at
        for us in (at, at + 100_000):
            vehicle.script.take(vehicle.setpoint, us, us * 1e-6)
        vehicle.select(mode, at + 100_000, 0.0)
        vehicle.fly_by(Sticks(0.0, 0.0, 0.0, 0.0), StickSource.JOYSTICK, OWNER, at + 100_000, 0.0)
        lose.at += 700_000
        return fly(vehicle, at + 102_000, at + 690_000)

    lose.at = 0
    params.set("NAV_RCL_ACT", 3.0, True)
    params.set("COM_OF_LOSS_T", 5.0, True)
    assert lose(7) == lose(bit) == []
    told = lose(7 - bit)
    assert [code for _, code in told] == [Code.STICKS_LOST_MODE]
    assert 0 < told[0][0] - (1_500_000 + 500_000) <= LOOK_US + TICK
    assert vehicle.mode is Mode.LAND


def test_sticks_that_were_never_heard_are_not_missed(vehicle, params):
    params.set("COM_RCL_EXCEPT", 0.0, True)
    assert fly(vehicle, TICK, 3_000_000) == []


# --- attitude


@pytest.mark.parametrize("axis", ["roll", "pitch"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("breaker", [0.0, 121212.0])
@pytest.mark.computes
def test_an_attitude_is_lost_after_its_time(vehicle, params, axis, sign, breaker):
    params.set("CBRK_FLIGHTTERM", breaker, True)
    fly(vehicle, TICK, 4_000_000)
    tilted = state(**{axis: sign * 61.0})
    told = fly(vehicle, 4_002_000, 5_000_000, tilted)
    assert told[0][1] is Code.ATTITUDE_LOST
    assert 300_000 <= told[0][0] - 4_002_000 <= 300_000 + 2 * LOOK_US
    assert (len(told), vehicle.armed, vehicle.terminated) == (
        (2, False, True) if breaker == 0.0 else (1, True, False)
    )


def test_just_after_arming_a_lost_attitude_disarms(vehicle):
    told = fly(vehicle, TICK, 1_000_000, state(roll=70.0))
    assert [code for _, code in told] == [Code.ATTITUDE_LOST, Code.FAILSAFE_STOPPED]
    assert (vehicle.armed, vehicle.terminated) == (False, False)


@pytest.mark.parametrize(
    ("name", "value", "roll"),
    [("FD_FAIL_R", 0.0, 90.0), ("FD_FAIL_R", 80.0, 70.0), ("", 0.0, 59.0)],
)
def test_an_attitude_within_its_limit_is_not_lost(vehicle, params, name, value, roll):
    if name:
        params.set(name, value, True)
    assert fly(vehicle, TICK, 5_000_000, state(roll=roll)) == []


def test_a_tilt_that_is_over_in_time_is_not_lost(vehicle):
    assert fly(vehicle, TICK, 280_000, state(roll=80.0)) == []
    assert fly(vehicle, 282_000, 400_000) == []
    assert fly(vehicle, 402_000, 680_000, state(roll=80.0)) == []


def test_flight_by_body_rates_may_have_any_attitude(vehicle):
    by_rates = vehicle.setpoint._replace(level=RATES, T_c=80.0)
    for us in (0, 100_000):
        vehicle.script.take(by_rates, us, us * 1e-6)
    vehicle.select(Mode.OFFBOARD, 100_000, 0.0)
    assert fly(vehicle, 102_000, 1_000_000, state(roll=120.0)) == []


# --- the guard's beliefs


@pytest.mark.parametrize(("act", "mode"), [(1, Mode.HOLD), (2, Mode.LAND)])
def test_contradicted_beliefs_hold_or_land(vehicle, params, act, mode):
    params.set("MR_GUARD_ACT", float(act), True)
    vehicle.watch[CONTRADICTED] = 1.0
    told = fly(vehicle, TICK, 100_000)
    codes = [code for _, code in told]
    assert codes == [Code.BELIEFS_CONTRADICTED, Code.FAILSAFE_MODE]
    assert vehicle.mode is mode
    assert fly(vehicle, 102_000, 3_000_000) == []  # once a flight


def test_what_the_ground_has_contradicted_does_not_count_in_the_air(vehicle, params):
    params.set("MR_GUARD_ACT", 2.0, True)
    vehicle.watch[column_of(Watch, "aloft_us")] = 0.0
    vehicle.watch[CONTRADICTED] = 1.0
    told = fly(vehicle, TICK, round(SETTLED_US) + 100_000)
    assert 0 < told[0][0] - SETTLED_US <= LOOK_US + TICK


# --- the time in Hold before an action


def charge(vehicle, remaining):
    vehicle.battery = Battery(20.0, 10.0, 1.0, remaining, 1e5)


def test_a_return_waits_in_hold_and_then_goes_on(vehicle, params):
    params.set("COM_FAIL_ACT_T", 5.0, True)
    params.set("COM_LOW_BAT_ACT", 3.0, True)
    charge(vehicle, 0.06)
    told = fly(vehicle, TICK, 6_100_000)
    begins = told[0][0]
    assert [code for _, code in told] == [
        Code.BATTERY_CRITICAL, Code.FAILSAFE_LATER, Code.FAILSAFE_MODE,
    ]  # fmt: skip
    assert 0 <= told[-1][0] - begins - 5_000_000 <= LOOK_US
    assert vehicle.mode is Mode.RETURN


def test_a_mode_that_is_chosen_in_the_hold_is_flown_on(vehicle, params):
    params.set("COM_FAIL_ACT_T", 5.0, True)
    params.set("COM_LOW_BAT_ACT", 3.0, True)
    charge(vehicle, 0.06)
    fly(vehicle, TICK, 2_000_000)
    vehicle.select(Mode.POSITION, 2_000_000, 2.0)
    assert fly(vehicle, 2_002_000, 12_000_000) == []
    assert vehicle.mode is Mode.POSITION


def test_a_worse_condition_in_the_hold_is_what_follows_it(vehicle, params):
    params.set("COM_FAIL_ACT_T", 5.0, True)
    params.set("COM_LOW_BAT_ACT", 3.0, True)
    charge(vehicle, 0.06)
    fly(vehicle, TICK, 2_000_000)
    charge(vehicle, 0.03)  # an emergency: it lands
    fly(vehicle, 2_002_000, 10_000_000)
    assert vehicle.mode is Mode.LAND


def test_what_stops_rotors_does_not_wait(vehicle, params):
    params.set("COM_FAIL_ACT_T", 5.0, True)
    params.set("NAV_DLL_ACT", 5.0, True)
    vehicle.hear_station(0, 0.0)
    fly(vehicle, TICK, 10_100_000)
    assert vehicle.terminated


def test_a_lost_script_holds_first(vehicle, params):
    params.set("COM_FAIL_ACT_T", 2.0, True)
    params.set("COM_OBL_RC_ACT", 4.0, True)
    for us in (0, 100_000):
        vehicle.script.take(vehicle.setpoint, us, us * 1e-6)
    vehicle.select(Mode.OFFBOARD, 100_000, 0.0)
    told = fly(vehicle, 102_000, 5_000_000)
    assert [code for _, code in told] == [
        Code.OFFBOARD_LOST_MODE, Code.FAILSAFE_LATER, Code.FAILSAFE_MODE,
    ]  # fmt: skip
    assert vehicle.mode is Mode.LAND


# --- two at a time

ACTING = [
    (condition, value)
    for condition, row in ROWS.items()
    if isinstance(row.action, By)
    for value, action in row.action.actions.items()
    if Action.HOLD <= action < Action.STOP  # a controller that ends decides nothing more
]
PAIRS = [
    (one, other)
    for one, other in itertools.product(ACTING, ACTING)
    if ROWS[one[0]].action.parameter != ROWS[other[0]].action.parameter or one == other
]


def test_pairs_of_conditions_are_hundreds():
    assert len(PAIRS) > 300


@pytest.mark.parametrize("apart_us", [0, 200_000], ids=["at once", "apart"])
@pytest.mark.computes
def test_of_any_two_conditions_the_more_severe_wins(params, apart_us):
    """Rotors stop in the air by termination or disarming alone, and a mode never gives way to a milder one."""
    defaults = {name: params[name] for name in {ROWS[c].action.parameter for c, _ in ACTING}}
    for (one, act), (other, also) in PAIRS:
        for name, value in defaults.items():
            params.set(name, value, False)
        for condition, value in ((one, act), (other, also)):
            params.set(ROWS[condition].action.parameter, float(value), False)
        vehicle = StateMachine(params, sim_only=True)
        vehicle.observe(state(), 0, 0.0)
        vehicle.hear_station(0, 0.0)
        assert vehicle.arm(0, 0.0).granted
        fly(vehicle, TICK, 20_000)
        vehicle.find(one, (1.0, 2.0), 22_000)
        fly(vehicle, 22_000, 22_000 + apart_us)
        vehicle.find(other, (1.0, 2.0), 24_000 + apart_us)
        fly(vehicle, 24_000 + apart_us, 100_000 + apart_us)
        worst = max(ROWS[one].action(params), ROWS[other].action(params))
        case = one.name, act, other.name, also
        stops = worst >= Action.DISARM
        assert vehicle.armed == (not stops), case
        assert (
            vehicle.terminated
            == (
                Action.TERMINATE in (ROWS[one].action(params), ROWS[other].action(params))
                and (worst is Action.TERMINATE)
            )
            or ROWS[one].action(params) is Action.DISARM
        ), case
        if not stops:
            assert vehicle.mode is MODES[worst], case


@pytest.mark.parametrize("condition", [c for c, _ in dict(ACTING).items()], ids=lambda c: c.name)
@pytest.mark.computes
def test_on_the_ground_no_condition_leaves_anything_armed_for_long(params, condition):
    row = ROWS[condition]
    for value, action in row.action.actions.items():
        params.set(row.action.parameter, float(value), False)
        vehicle = StateMachine(params, sim_only=True)
        on_ground = state(r_E=Vec3(0.0, 0.0, 0.3), Omega=0.0)
        vehicle.observe(on_ground, 0, 0.0)
        vehicle.hear_station(0, 0.0)
        assert vehicle.arm(0, 0.0).granted
        fly(vehicle, TICK, 100_000, on_ground)
        vehicle.find(condition, (1.0, 2.0), 102_000)
        fly(vehicle, 102_000, 15_000_000, on_ground)
        assert not vehicle.armed, (value, action)


def test_a_condition_of_a_vehicle_that_is_disarmed_is_not_acted_on(params):
    vehicle = StateMachine(params, sim_only=True)
    vehicle.observe(state(), 0, 0.0)
    assert vehicle.find(Condition.STATE_LOST, (0.5,), 0) == []
    assert vehicle.mode is Mode.HOLD


# --- a rotor

WANTED, LOST = slice_of(Watch, "rotors.wanted"), slice_of(Watch, "rotors.lost")
LOSS_US = 1_000_000


def without(rotor, share=0.0):
    """A state in which a rotor has a share of its speed."""
    row = state()
    row[slice_of(VehicleState, "Omega").start + rotor - 1] *= share
    return row


def lose(vehicle, rotor=3, share=0.0, to_us=LOSS_US + 400_000):
    """(time, code) of what is told of a rotor that is slower than wanted from LOSS_US on."""
    vehicle.watch[WANTED] = 8.2e-5 * HOVER * HOVER
    assert fly(vehicle, TICK, LOSS_US) == []
    return fly(vehicle, LOSS_US + TICK, to_us, without(rotor, share))


@pytest.mark.parametrize(
    ("act", "mode"), [(0, None), (1, Mode.HOLD), (2, Mode.LAND), (3, Mode.RETURN)]
)
def test_a_rotor_that_stands_is_found_lost_after_its_time(vehicle, params, act, mode):
    params.set("CA_FAILURE_MODE", 0.0, True)
    params.set("COM_ACT_FAIL_ACT", float(act), True)
    if mode is Mode.HOLD:
        vehicle.select(Mode.POSITION, 0, 0.0)
    told = lose(vehicle)
    at_us, code = told[0]
    assert code is Code.ROTOR_LOST
    assert 100_000 <= at_us - LOSS_US <= 100_000 + 2 * LOOK_US
    acts = [] if mode is None else [Code.FAILSAFE_MODE]
    assert [code for _, code in told[1:]] == [*acts, Code.GUARD_VOID]
    assert vehicle.mode is (mode or Mode.HOLD)
    assert vehicle.lost_rotors == (3,)
    assert params.law.rotors.w == (1.0,) * 8
    assert not params.is_promised, "the vehicle is not the one that is believed in"


def test_a_rotor_that_is_slow_for_less_or_has_more_than_half_is_not_lost(vehicle):
    vehicle.watch[WANTED] = 8.2e-5 * HOVER * HOVER
    for t_us in range(TICK, 2_000_000, 150_000):
        fly(vehicle, t_us, t_us + 60_000, without(3))
        fly(vehicle, t_us + 60_000 + TICK, t_us + 150_000 - TICK)
    assert fly(vehicle, 2_200_000, 2_600_000, without(3, 0.51)) == []
    assert vehicle.lost_rotors == ()


@pytest.mark.parametrize("lag", [0.05, 0.25, 1.0])
def test_a_rotor_that_gains_speed_is_not_lost_however_long_it_lags(vehicle, lag):
    """The lag is the true one. Who believes another need not know it."""
    vehicle.watch[WANTED] = 8.2e-5 * HOVER * HOVER
    for t_us in range(TICK, 3_000_000, TICK):
        assert fly(vehicle, t_us, t_us, without(3, 1.0 - math.exp(-t_us * 1e-6 / lag))) == []
    assert vehicle.lost_rotors == ()


@pytest.mark.parametrize("turns", [lambda _: 0.0, lambda _: 0.3, lambda t: math.exp(-t / 0.25)])
def test_a_rotor_that_stands_turns_too_slowly_or_runs_down_is_lost(vehicle, turns):
    vehicle.watch[WANTED] = 8.2e-5 * HOVER * HOVER
    slow_us = next(t for t in range(0, 3_000_000, TICK) if turns(t * 1e-6) < 0.5)
    found = [
        (t_us, code) for t_us in range(TICK, 1_000_000, TICK)
        for _, code in fly(vehicle, t_us, t_us, without(3, turns(t_us * 1e-6)))
    ]  # fmt: skip
    (at_us, code), (_, warns) = found
    assert warns is Code.GUARD_VOID
    assert code == Code.ROTOR_LOST
    assert 100_000 <= at_us - slow_us <= 100_000 + 2 * LOOK_US


def test_a_state_that_stands_still_says_nothing_of_rotors(vehicle):
    """A rotor pauses for 60 ms, and within that the state freezes for 0.2 s: it is healthy."""
    vehicle.watch[WANTED] = 8.2e-5 * HOVER * HOVER
    frozen = moving(without(3), 1_060_000)
    for t_us in range(TICK, 3_000_000, TICK):
        row = moving(without(3) if 1_000_000 <= t_us < 1_060_000 else state(), t_us)
        if 1_060_000 <= t_us < 1_260_000:
            row = frozen
        assert not vehicle.observe(row, t_us, t_us * 1e-6)
    assert vehicle.lost_rotors == ()


def test_told_the_law_gives_it_no_work_and_flies_on(vehicle, params):
    whole = params.settings
    assert [code for _, code in lose(vehicle)] == [Code.ROTOR_LOST, Code.GUARD_VOID]
    assert (vehicle.mode, vehicle.armed) == (Mode.HOLD, True)
    assert params.law.rotors.w[2] == 0.0
    assert params.law.limits.T_max < whole.law.limits.T_max
    assert not params.is_promised
    assert params.guard.policy == whole.guard.policy
    of = ("top", "brake", "down")
    assert [getattr(params.guard, n) for n in of] == [getattr(whole.guard, n) for n in of]
    params.set("MR_F_M", 1.5, True)
    assert (params.law.f_m, params.law.rotors.w[2]) == (1.5, 0.0), "a parameter keeps the loss"
    back = vehicle.tell_rotor(3, lost=False)
    assert back == [Told(Code.ROTOR_BACK, (3,)), Told(Code.GUARD_BACK)]
    assert params.law.rotors == whole.law.rotors
    assert params.is_promised
    assert vehicle.lost_rotors == ()


def test_two_lost_rotors_of_eight_land_it_and_four_terminate_it(vehicle, params):
    fly(vehicle, TICK, LOSS_US)
    for rotor in (1, 5):
        vehicle.tell_rotor(rotor, lost=True)
    codes = [code for _, code in fly(vehicle, LOSS_US + TICK, LOSS_US + 2 * LOOK_US)]
    assert codes == [
        Code.ROTOR_LOST, Code.FAILSAFE_MODE, Code.GUARD_VOID, Code.ROTOR_LOST,
    ]  # fmt: skip
    assert vehicle.mode is Mode.LAND
    for rotor in (2, 3, 4, 6):
        vehicle.tell_rotor(rotor, lost=True)
    codes = [code for _, code in fly(vehicle, LOSS_US + 3 * LOOK_US, LOSS_US + 9 * LOOK_US)]
    assert Code.FAILSAFE_STOPPED in codes
    assert vehicle.terminated


def order(vehicle, *rotors, t_us=LOSS_US, lost=True):
    """Tell of rotors that are stopped or turn again, fly for two looks, and return the codes."""
    for rotor in rotors:
        vehicle.tell_rotor(rotor, lost=lost)
    return [code for _, code in fly(vehicle, t_us + TICK, t_us + (1 + len(rotors)) * LOOK_US)]


def test_a_share_that_is_asked_for_after_the_loss_is_acted_on(vehicle, params):
    params.set("CA_FAILURE_MODE", 0.0, True)
    order(vehicle, 1, 3)
    params.set("CA_FAILURE_MODE", 1.0, True)
    told = order(vehicle, t_us=LOSS_US + 10 * LOOK_US)
    assert told == [Code.ROTOR_LOST, Code.FAILSAFE_MODE]
    assert vehicle.mode is Mode.LAND
    assert params.law.rotors.w[0] == params.law.rotors.w[2] == 0.0
    assert vehicle.lost_rotors == (1, 3)
    params.set("MR_F_M", 1.5, True)
    assert order(vehicle, t_us=LOSS_US + 20 * LOOK_US) == [], "another parameter tells nothing"


def test_a_rotor_that_turns_again_takes_its_action_back(vehicle, params):
    order(vehicle, 1, 3)
    assert vehicle.mode is Mode.LAND
    back = vehicle.tell_rotor(3, lost=False)
    assert back == [Told(Code.ROTOR_BACK, (3,))], "another is lost: the guard promises nothing"
    assert order(vehicle, t_us=LOSS_US + 10 * LOOK_US) == []
    assert vehicle.mode is Mode.LAND, "it goes on until another mode is chosen"
    assert vehicle.select(Mode.HOLD, LOSS_US + 20 * LOOK_US, 0.0).granted
    # a milder action than Land is the most severe that is called for now
    assert vehicle.find(Condition.FENCE_BREACHED, (), LOSS_US + 20 * LOOK_US)
    assert vehicle.mode is Mode.HOLD


def test_a_vehicle_that_cannot_fly_on_does_not_wait_before_it_lands(vehicle, params):
    params.set("COM_FAIL_ACT_T", 5.0, True)
    params.set("COM_ACT_FAIL_ACT", 3.0, True)
    assert order(vehicle, 1) == [
        Code.ROTOR_LOST, Code.FAILSAFE_LATER, Code.GUARD_VOID,
    ], "it returns later"  # fmt: skip
    told = order(vehicle, 3, t_us=LOSS_US + 10 * LOOK_US)
    assert told == [Code.ROTOR_LOST, Code.FAILSAFE_MODE]
    assert vehicle.mode is Mode.LAND


def test_an_order_is_told_at_the_next_tick(vehicle, params):
    fly(vehicle, TICK, LOSS_US)
    vehicle.tell_rotor(7, lost=True)
    told = fly(vehicle, LOSS_US + TICK, LOSS_US + LOOK_US)
    assert told == [(LOSS_US + TICK, code) for code in (Code.ROTOR_LOST, Code.GUARD_VOID)]
    assert params.law.rotors.w[6] == 0.0


def test_a_vehicle_with_a_lost_rotor_is_not_armed(vehicle):
    lose(vehicle)
    vehicle.disarm(LOSS_US + 500_000, forced=True)
    assert vehicle.arm(LOSS_US + 600_000, 0.0) == Answer(False, Told(Code.ROTOR_IS_LOST, (3,)))
    vehicle.tell_rotor(3, lost=False)
    assert vehicle.arm(LOSS_US + 700_000, 0.0).granted


def test_what_each_loss_leaves_is_worked_out_before_the_flight(params, monkeypatch):
    """By the wall's clock the vehicle would wait for it in the air, for tens of ticks."""
    params.lose((3,))
    left = params.settings
    params.lose(())
    params.foresee()
    monkeypatch.setattr(rotor_loss, "without", None)
    for rotor in range(1, 9):
        assert params.lose((rotor,)) is Fate.FLIES
        assert params.law.rotors.w[rotor - 1] == 0.0
    params.lose((3,))
    assert params.settings == left


def test_a_reset_has_every_rotor_turn_again(params):
    whole = params.settings
    params.lose((2,))
    assert params.settings is not whole
    StateMachine(params, sim_only=True)
    assert params.settings is whole


# --- the charge for the way home


@pytest.mark.parametrize(("act", "mode"), [(0, Mode.HOLD), (1, Mode.HOLD), (3, Mode.RETURN)])
def test_a_charge_that_does_not_last_for_the_way_home_is_acted_on(params, act, mode):
    """200 m at 5 m/s and 20 m down take 69 s, with PX4's factor and margin 176 s."""
    params.set("COM_FLTT_LOW_ACT", float(act), True)
    vehicle = StateMachine(params, sim_only=True)
    vehicle.observe(state(), 0, 0.0)
    vehicle.arm(0, 0.0)
    vehicle.set_home(Vec3(200.0, 0.0, 0.0))
    full = params["BAT1_CAPACITY"] * 3.6 / 60.0  # s, at 60 A
    vehicle.battery = Battery(22.0, 60.0, 0.0, 300.0 / full, 0.0)
    assert fly(vehicle, TICK, 3_000_000) == []
    vehicle.battery = Battery(22.0, 60.0, 0.0, 150.0 / full, 0.0)
    told = fly(vehicle, 3_002_000, 6_000_000)
    assert [code for _, code in told] == {
        0: [], 1: [Code.FLIGHT_TIME_LOW], 3: [Code.FLIGHT_TIME_LOW, Code.FAILSAFE_MODE],
    }[act]  # fmt: skip
    assert all(1_000_000 <= at_us - 3_000_000 <= 2_000_000 + 2 * LOOK_US for at_us, _ in told)
    assert vehicle.mode is mode
    # the pilot's mode is flown, and the same charge does not act again
    assert vehicle.select(Mode.HOLD, 6_000_000, 0.0).granted
    assert fly(vehicle, 6_002_000, 12_000_000) == []
    assert vehicle.mode is Mode.HOLD
