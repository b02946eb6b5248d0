"""What is asked for, looked at before it is flown: held against the reference model flown out."""

from __future__ import annotations

import math
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from fcu.guard import admission, foreseen, margin
from fcu.interface.airframe import believed
from fcu.interface.messages import Setpoint, VehicleState
from fcu.interface.status_texts import Code, Told, lacks, words
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import to_buffer
from fcu.kernel.rotations import from_euler
from fcu.laws.mmrac.reference_model import a_ref, advance
from fcu.laws.setpoint import carried
from fcu.parameters import Parameters
from fcu.process.settings import settings
from fcu.vehicle import plans
from fcu.vehicle.feasibility_check import FeasibilityCheck
from fcu.vehicle.modes import Mode
from fcu.vehicle.state_machine import StateMachine
from tests.laws.conftest import PAPER

ZERO = Vec3(0.0, 0.0, 0.0)
AT_REST = np.zeros(9)
AIRFRAME = believed()
LAW, GUARD = settings(*AIRFRAME, 500.0, {**PAPER, "guard": "refuse"})
HOVER = math.sqrt(9.81 / 8.2e-5)
ORIGIN = to_buffer(VehicleState(ZERO, ZERO, from_euler(0.0, 0.0, 0.0), ZERO, Rotors(*[HOVER] * 8)))


def at(r=ZERO, v=ZERO, a=ZERO):
    return Setpoint(r, v, a, 0.0, 0.0)


def flown_out(guard, law, way, reference):
    """Every tick of the way, in plain Python: the least condition, N.

    The vehicle follows with the lag of attitude and rates; a jump is flown with a wrong mass.
    """
    r, v = (np.array(reference[i : i + 3]) for i in (0, 3))
    r_m, v_m, a_m = r, v, np.array(reference[6:])
    attitude, rates, fades = (
        math.exp(-law.h * x) for x in (law.c_angle.y, law.c_rate.y, 0.5 * law.lambda_v)
    )
    known, worst = margin.known(guard, law), math.inf
    w = a = np.array(reference[6:])
    off = np.zeros(3)
    more = 1.0 if guard.policy else foreseen.hurry(law)
    adds = foreseen.closed(law)

    def condition(a_d):
        tracking = adds * margin.difference(known, float(np.linalg.norm(v)))
        return margin.condition(known, Vec3(*(more * a_d).tolist()), Vec3(*v.tolist()), tracking)

    for setpoint, for_s in way:
        n = round((16.0 if math.isinf(for_s) else for_s) / law.h)
        for k in range(n):
            now = carried(setpoint, k * law.h)
            change = np.array(a_ref(law, now, Vec3(*r_m.tolist()), Vec3(*v_m.tolist()))) - a_m
            most, aside = foreseen.fastest(guard, law, Vec3(*a_m.tolist()))
            change = change * min(1.0, law.h * most / max(np.linalg.norm(change), 1e-30))
            up = a_m + np.array([0.0, 0.0, law.g])
            across = change - (change @ up) / (up @ up) * up
            if (size := float(np.linalg.norm(across))) > law.h * aside:
                change = change - (1.0 - law.h * aside / size) * across
            a_m = a_m + change
            a_d = a_m - 2.0 * law.f_m * law.zeta_m * (v - v_m) - law.f_m**2 * (r - r_m)
            wrong = off + margin.FORGOTTEN * (a_d - a)
            worst = min(worst, condition(a_d + wrong), condition(a_d - wrong))
            w = a_d + attitude * (w - a_d)
            flown, a = a, w + rates * (a - w)
            off = fades * off + margin.FORGOTTEN * (a - flown)
            v, v_m = v + 0.5 * law.h * (flown + a), v_m + law.h * a_m
            r, r_m = r + law.h * v, r_m + law.h * v_m
    return worst


LED = plans.PlanLimits(2.0, 1.0, 1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("way", "reference"),
    [
        ([(at(Vec3(4.0, 7.0, 18.0)), math.inf)], AT_REST),
        (
            [(at(Vec3(0.0, 4.0, 0.0)), math.inf)],
            np.array([0.0, 0.0, 0.0, 3.0, 0.0, -1.0, 0.0, 0.0, 0.0]),
        ),
        ([(at(v=Vec3(7.0, 0.0, 0.0)), math.inf)], AT_REST),
        (admission.way_to(at(v=Vec3(3.0, 0.0, 0.0), a=Vec3(0.0, 4.0, 0.0))), AT_REST),
        (plans.through(ZERO, ZERO, [Vec3(6.0, 0.0, 3.0)], 0.0, LED), AT_REST),
        (plans.through(ZERO, ZERO, [Vec3(60.0, 0.0, 0.0)], 0.0, LED), AT_REST),
    ],
)
@pytest.mark.computes
def test_a_look_in_coarse_steps_sees_what_every_tick_of_the_way_holds(way, reference):
    law, guard = settings(*AIRFRAME, 100.0, {**PAPER, "guard": "warn"})
    expected = max(0.0, -flown_out(guard, law, way, reference))
    assert expected > 0.0 or len(way) != 1  # the steps are such that there is something to see
    assert admission.Look(guard, law).short(way, reference) == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize("a_m", [ZERO, Vec3(0.0, 0.0, -1.5), Vec3(3.0, 0.0, 2.0)])
@pytest.mark.computes
def test_a_check_that_refuses_looks_from_the_acceleration_there_is(a_m):
    law, guard = settings(*AIRFRAME, 100.0, {"guard": "refuse", "f_m": 1.0})
    for far in (0.5, 1.0, 2.0):
        way = [(at(Vec3(0.0, 0.0, far)), 3.0), (at(), math.inf)]  # and back: at its worst moment
        begins = np.array([0.0] * 6 + [*a_m])
        expected = max(0.0, -flown_out(guard, law, way, begins))
        found = admission.Look(guard, law).short(way, begins)
        assert found == pytest.approx(expected, rel=0.02, abs=1.0)


def test_what_would_swing_ever_farther_is_refused():
    """A reference model held to a jerk that is too slow for its f_m: in 40 s it is hundreds of metres off."""
    windy = {"guard": "refuse", "guard_wind_rate_m_s2": 40.0}  # nothing is left of the torque
    law, guard = settings(*AIRFRAME, 500.0, windy)
    look, admitted, lost = admission.Look(guard, law), 0, 0
    assert look.pace.jerk == 1.0
    for far, v_m, a_m in product((0.0, 0.1, 0.4), (0.0, 0.4, 0.8), (-0.5, 0.0, 0.5)):
        there, reference = at(Vec3(far, 0.0, 0.0)), np.array([0, 0, 0, v_m, 0, 0, a_m, 0, 0.0])
        fits = look.short([(there, math.inf)], reference) == 0.0
        admission.follow(to_buffer(guard), to_buffer(law), to_buffer(there), 20_000, reference)
        settles = abs(reference[0] - far) < 0.01
        assert settles or not fits
        admitted, lost = admitted + fits, lost + (not settles)
    assert admitted > 3
    assert lost > 10


@pytest.mark.parametrize("far", [0.3, 0.5])
def test_what_settles_is_seen_to_settle(far):
    """The reference is held to the jerk, not the vehicle, whose attitude lags behind it."""
    law, guard = settings(*AIRFRAME, 500.0, {"guard": "refuse", "f_m": 2.8})
    there, reference = at(Vec3(far, 0.0, 0.0)), AT_REST.copy()
    short = admission.Look(guard, law).short([(there, math.inf)], reference)
    admission.follow(to_buffer(guard), to_buffer(law), to_buffer(there), 5000, reference)
    assert abs(reference[0] - far) < 0.001
    assert short < 20.0


@pytest.mark.parametrize(("far", "is_over"), [(1.06, True), (1.1, False)])
@pytest.mark.computes
def test_a_swing_that_is_over_before_the_last_quarter_of_a_look_costs_nothing(far, is_over):
    """All that is missing then is what the way itself lacks, two newtons or so: it has been seen to an end."""
    windy = {"guard": "refuse", "guard_wind_rate_m_s2": 5.0, "f_m": 2.4}
    law, guard = settings(*AIRFRAME, 500.0, windy)
    way = [(at(Vec3(far, 0.0, 0.0)), math.inf)]
    own = -flown_out(guard, law, way, AT_REST)
    assert 0.0 < own < 3.0
    short = admission.Look(guard, law).short(way, AT_REST)
    assert (short < 3.0) is is_over
    assert is_over or short > 20.0


@pytest.mark.parametrize("f_m", [0.5, 1.0, 1.4, 1.8])
@pytest.mark.parametrize("towards", [Vec3(1.0, 0.0, 0.0), Vec3(0.0, -0.6, 0.8)])
def test_what_is_said_to_do_does_and_a_little_more_does_not(f_m, towards):
    look = admission.Look(GUARD, LAW._replace(f_m=f_m))
    far = 60.0
    asked = at(far * towards)
    short = look.short(admission.way_to(asked), AT_REST)
    lack = admission.lack_of(look, asked, short, AT_REST)
    assert (lack.far, lack.speed, lack.short) == (far, 0.0, short)
    assert words(lacks(*lack)).endswith(" m of it would do")
    fits = math.floor(10.0 * far * lack.part) / 10.0  # as it is told
    assert look.short(admission.way_to(at(fits * towards)), AT_REST) == 0.0
    finest = far / 2**admission.HALVINGS + 0.1
    assert look.short(admission.way_to(at((fits + finest) * towards)), AT_REST) > 0.0


def test_following_is_the_reference_model_tick_by_tick():
    reference, r, v = AT_REST.copy(), ZERO, ZERO
    asked = at(Vec3(1.0, 2.0, 3.0), v=Vec3(0.1, 0.0, 0.0))
    warned = to_buffer(GUARD._replace(policy=0.0))
    admission.follow(warned, to_buffer(LAW), to_buffer(asked), 250, reference)
    for k in range(250):
        r, v = advance(LAW, carried(asked, k * LAW.h), r, v)
    assert reference[:6] == pytest.approx([*r, *v], abs=1e-12)


# --- the vehicle


@pytest.fixture
def vehicle():
    """`vehicle(policy)`: armed in the air at the origin, with that guard."""

    def one(policy):
        params = Parameters(settings(*AIRFRAME, 500.0, {**PAPER, "guard": policy}), 1)
        flying = StateMachine(params, sim_only=True)
        flying.observe(ORIGIN, 0, 0.0)
        assert flying.arm(0, 0.0).granted
        return flying

    return one


FAR, NEAR = at(Vec3(30.0, 0.0, 0.0)), at(Vec3(2.0, 0.0, 0.0))


def test_a_check_looks_only_where_the_law_does_not_govern(vehicle):
    assert vehicle("govern").feasibility.short(FAR, AT_REST) == 0.0
    assert vehicle("warn").feasibility.short(FAR, AT_REST) > 100.0
    assert vehicle("refuse").feasibility.short(FAR, AT_REST) > 100.0
    assert vehicle("refuse").feasibility.short(NEAR, AT_REST) == 0.0


def test_below_the_position_level_nothing_is_refused(vehicle):
    assert vehicle("refuse").feasibility.short(FAR._replace(level=1.0), AT_REST) == 0.0


def test_the_same_is_told_once_until_another_is_flown(vehicle):
    check = vehicle("refuse").feasibility
    short = check.short(FAR, AT_REST)
    told = check.complaint(FAR, short, AT_REST)
    (lack,) = told.values
    assert (told.code, lack.code) == (Code.SETPOINT_REFUSED, Code.LACKS)
    assert lack.values[:2] == (Told(Code.WAY, (30.0,)), short)
    assert lack.values[2].code is Code.METRES_OF_IT and 0.0 < lack.values[2].values[0] < 30.0
    check.told(FAR, short)
    assert check.complaint(FAR, short, AT_REST) is None
    assert check.complaint(FAR._replace(r_c=Vec3(29.0, 0.0, 0.0)), short, AT_REST)
    assert check.short(NEAR, AT_REST) == 0.0
    assert check.complaint(FAR, short, AT_REST) == told


def test_a_velocity_is_told_as_such(vehicle):
    check = vehicle("warn").feasibility
    fast = at(v=Vec3(12.0, 0.0, 0.0))
    short = check.short(fast, AT_REST)
    asked = Told(Code.SPEED, (12.0,))
    assert check.complaint(fast, short, AT_REST) == Told(Code.SETPOINT_SHORT, (asked, short))


def test_a_moving_stream_is_warned_of_once_until_it_is_much_worse(vehicle):
    check = vehicle("warn").feasibility
    fast = at(v=Vec3(8.0, 0.0, 0.0))
    short = check.short(fast, AT_REST)
    assert check.complaint(fast, short, AT_REST)
    check.told(fast, short)
    assert check.short(at(v=Vec3(0.5, 0.0, 0.0)), AT_REST) == 0.0  # slow in between
    assert check.complaint(at(v=Vec3(0.0, 8.0, 0.0)), short, AT_REST) is None
    assert check.complaint(fast, 1.6 * short, AT_REST) is None  # the same to the number
    assert check.complaint(at(v=Vec3(12.0, 0.0, 0.0)), 1.6 * short, AT_REST)
    refusing = vehicle("refuse").feasibility
    refusing.told(fast, short)
    assert refusing.complaint(at(v=Vec3(0.0, 8.0, 0.0)), short, AT_REST)


@pytest.mark.parametrize("place", [1e9, 1e200, math.inf, math.nan])
def test_a_flight_that_has_diverged_is_looked_at_too(vehicle, place):
    check, reference = vehicle("refuse").feasibility, AT_REST.copy()
    reference[2] = place
    short = check.short(FAR, reference)
    assert short >= 0.0
    assert len(words(check.complaint(FAR, short, reference))) < 400


def offboard(vehicle, setpoint):
    for us in (0, 20_000):
        vehicle.script.take(setpoint, us, us * 1e-6)
    assert vehicle.select(Mode.OFFBOARD, 20_000, 0.02).granted


def test_what_a_script_says_and_is_not_flown_keeps_it_going_at_a_steady_velocity(vehicle):
    flying = vehicle("refuse")
    offboard(flying, at(v=Vec3(1.0, 0.0, 0.0), a=Vec3(0.5, 0.0, 0.0)))
    flying.keep_script(420_000, 0.42)
    assert flying.setpoint.a_c == ZERO
    assert flying.setpoint.v_c == Vec3(1.2, 0.0, 0.0)
    assert (flying.setpoint.r_c.x, flying.since_us) == (pytest.approx(0.44), 420_000)
    flown = flying.setpoint
    flying.keep_script(820_000, 0.82)
    assert flying.setpoint is flown
    assert not flying.script.lost(1_800_000, 1.8, flying.lost_us)


def test_an_attitude_does_not_go_on_without_its_script(vehicle):
    flying = vehicle("refuse")
    offboard(flying, at()._replace(level=1.0, T_c=80.0))
    flying.keep_script(420_000, 0.42)
    assert flying.script.lost(1_100_000, 1.1, flying.lost_us)


def test_a_place_to_go_to_is_denied_and_nothing_changed(vehicle):
    flying = vehicle("refuse")
    before, cruise = flying.setpoint, flying.cruise
    verdict = flying.reposition(Vec3(30.0, 0.0, 0.0), None, 40_000, 10.0)
    what, _, would_do = verdict.told.values
    assert (verdict.granted, verdict.told.code) == (False, Code.LACKS)
    assert what == Told(Code.WAY_LED, (30.0, 10.0))
    assert would_do.code is Code.PERCENT_LED
    part = math.floor(100.0 * would_do.values[0]) / 100.0  # as it is told
    assert (flying.setpoint, flying.cruise) == (before, cruise)
    led = flying._limits()
    for name, limit in (
        ("MPC_ACC_HOR", led.acceleration), ("MPC_ACC_UP_MAX", led.acceleration_up)
    ):  # fmt: skip
        assert flying._params.set(name, part * limit, True)
    assert flying.reposition(Vec3(30.0, 0.0, 0.0), None, 40_000, part * 10.0).granted


def test_the_same_place_is_warned_of(vehicle):
    verdict = vehicle("warn").reposition(Vec3(30.0, 0.0, 0.0), None, 40_000, 10.0)
    assert verdict.granted and verdict.told.code is Code.GOING_SHORT
    going = vehicle("govern").reposition(Vec3(30.0, 0.0, 0.0), None, 40_000)
    assert going.told == Told(Code.GOING, (30.0,))


def test_a_step_of_the_reference_generator_is_denied(vehicle):
    flying = vehicle("refuse")
    assert flying._params.set("REF_STEP_E", 20.0, True)
    verdict = flying.select(Mode.STEP, 40_000, 0.04)
    assert (verdict.granted, verdict.told.code) == (False, Code.LACKS)
    assert verdict.told.values[0] == Told(Code.WAY, (20.0,))
    assert flying.mode is Mode.HOLD
    assert flying._params.set("REF_STEP_E", 2.0, True)
    assert flying.select(Mode.STEP, 40_000, 0.04).granted


def test_what_the_vehicle_lays_down_by_itself_is_never_refused(vehicle):
    """Even where not a hover meets the condition."""
    flying = vehicle("refuse")
    assert flying._params.set("MR_GRD_WIND", 30.0, True)
    assert flying.feasibility.short(at(), AT_REST) > 0.0
    for mode in (Mode.LAND, Mode.RETURN, Mode.HOLD, Mode.POSITION):
        assert flying.select(mode, 40_000, 0.04).granted
    told = flying.feasibility.complaint(at(), 5.0, AT_REST)
    assert told == Told(Code.SETPOINT_REFUSED, (lacks(far=0.0, speed=0.0, short=5.0, part=0.0),))


def test_the_reference_is_the_law_s_once_there_is_one(vehicle):
    flying = vehicle("refuse")
    assert flying.reference.tolist() == [0.0] * 9
    flying.reference_model = np.arange(6.0)
    flying.reference_acceleration = np.array([6.0, 7.0, 8.0])
    assert flying.reference.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]


def test_in_the_air_what_is_demanded_now_is_known_too(vehicle):
    flying, whole = vehicle("refuse"), np.arange(27.0)
    flying.beginning = lambda: whole
    assert flying.reference is whole
    in_the_air = flying._landed
    flying._landed = SimpleNamespace(landed=True)  # the ground carries some of the weight
    assert flying.reference.tolist() == [0.0] * 9
    flying._landed = in_the_air
    offboard(flying, at()._replace(level=1.0, T_c=80.0))
    flying.fly_script(40_000)
    assert flying.setpoint.level == 1.0
    assert flying.reference.tolist() == [0.0] * 9


def test_what_is_admitted_is_reached_in_the_time_that_the_look_states():
    """With gains for which (34) held to the jerk swings ever farther from a few metres on, and a moving setpoint."""
    gains = {"f_m": 1.58, "zeta_m": 0.79, "c_angle": (12.1, 12.1, 3.0), "c_rate": (28.7, 28.7, 6.0)}
    law, guard = settings(
        *AIRFRAME, 500.0, {"guard": "refuse", "gamma": 2716.0, "guard_wind_m_s": 1.1, **gains}
    )
    look, admitted, swings = admission.Look(guard, law), 0, 0
    for far in np.geomspace(0.5, 16.0, 63):
        for speed in (0.0, 4.0):
            asked = at(Vec3(float(far), 0.0, 0.0), Vec3(0.0, speed, 0.0))
            found = look.tightest([(asked, math.inf)], np.zeros(9))
            reference = np.zeros(9)
            ticks = round(30.0 / law.h)
            admission.follow(to_buffer(guard), to_buffer(law), to_buffer(asked), ticks, reference)
            off = math.hypot(reference[0] - far, reference[1] - speed * 30.0)
            if found.margin >= 0.0:
                assert off < 0.01, (far, speed)
                assert 0.0 < found.arrives < 10.0
            admitted, swings = admitted + (found.margin >= 0.0), swings + (off > 0.3)
    assert admitted > 10
    assert swings > 10


def test_the_way_back_at_the_same_place_is_another_setpoint():
    check = FeasibilityCheck(
        Parameters(settings(*AIRFRAME, 500.0, {**PAPER, "guard": "refuse"}), 1)
    )
    there = at(r=Vec3(30.0, 0.0, 0.0), v=Vec3(3.0, 0.0, 0.0))
    check.told(there, 5.0)
    assert check.complaint(there, 5.0, AT_REST) is None
    assert check.complaint(there._replace(v_c=Vec3(-3.0, 0.0, 0.0)), 5.0, AT_REST) is not None
