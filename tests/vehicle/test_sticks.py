"""Sticks: whose are heard, their curves, and what they do to a vehicle in each mode."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from fcu.interface.airframe import believed
from fcu.interface.messages import VehicleState
from fcu.interface.status_texts import Code
from fcu.kernel.buffers import from_buffer
from fcu.kernel.rotations import euler, matrix
from fcu.kernel.rows import column
from fcu.parameters import Parameters
from fcu.process.settings import settings
from fcu.process.tick import Tick
from fcu.vehicle import sticks as curves
from fcu.vehicle.modes import BY_STICKS, BY_THRUST, Mode
from fcu.vehicle.sticks import Accepts, Gesture, StickInput, Sticks, StickSource
from sitl_plant.physics import dynamics
from tests.vehicle.flown import Flown

JOYSTICK, RADIO = StickSource.JOYSTICK, StickSource.RADIO
ONE, OTHER = ((255, 190), "one"), ((255, 190), "other")
LOW = Sticks(throttle=-1.0)


# --- whose are heard


def heard(accepts, *spoke, lost_us=500_000):
    """Return true for each of these (us, source, owner) that is heard, one after the other."""
    sticks, found = StickInput(sim_only=True), []
    for at_us, source, owner in spoke:
        counts = sticks.counts(source, owner, accepts, at_us, 0.0, lost_us)
        found.append(counts)
        if counts:
            sticks.take(LOW, source, owner, at_us, 0.0)
    return found


@pytest.mark.parametrize(
    ("accepts", "joystick", "radio", "radio_once_lost"),
    [
        (Accepts.RADIO, False, True, True), (Accepts.JOYSTICK, True, False, False),
        (Accepts.EITHER, True, False, True), (Accepts.FIRST, True, False, False),
        (Accepts.NEITHER, False, False, False),
    ],
)  # fmt: skip
def test_which_sources_are_heard(accepts, joystick, radio, radio_once_lost):
    spoke = (0, JOYSTICK, ONE), (100_000, RADIO, OTHER), (900_000, RADIO, OTHER)
    assert heard(accepts, *spoke) == [joystick, radio, radio_once_lost]


def test_another_joystick_is_heard_once_the_first_is_lost():
    spoke = (0, JOYSTICK, ONE), (500_000, JOYSTICK, OTHER), (500_001, JOYSTICK, OTHER)
    assert heard(Accepts.FIRST, *spoke) == [True, False, True]


def test_sticks_are_lost_by_simulation_time_and_by_the_wall():
    sticks = StickInput(sim_only=False)
    assert sticks.lost(0, 0.0, 500_000)
    sticks.take(LOW, JOYSTICK, ONE, 0, 0.0)
    assert not sticks.lost(10_000_000, 0.5, 500_000)
    assert not sticks.lost(500_000, 10.0, 500_000)
    assert sticks.lost(500_001, 0.500_001, 500_000)


# --- curves: numbers of PX4's functions (src/lib/mathlib/math/Functions.hpp)


def test_curves():
    assert [curves.past_dead_zone(x, 0.1) for x in (-1.0, -0.1, 0.05, 0.55, 1.0)] == pytest.approx(
        [-1.0, 0.0, 0.0, 0.5, 1.0]
    )
    assert [curves.expo(x, 0.6) for x in (-1.0, 0.0, 0.5, 1.0)] == pytest.approx(
        [-1.0, 0.0, 0.4 * 0.5 + 0.6 * 0.125, 1.0]
    )
    assert curves.superexpo(0.5, 0.69, 0.7) == pytest.approx(0.241_25 * 0.3 / 0.65)
    assert curves.superexpo(1.0, 0.69, 0.7) == pytest.approx(1.0)
    assert curves.within_circle(1.0, -1.0) == pytest.approx((math.sqrt(0.5), -math.sqrt(0.5)))
    assert curves.within_circle(0.3, 0.4) == (0.3, 0.4)


def test_the_middle_of_the_throttle_hovers_in_stabilized():
    p = Parameters(settings(*believed(), 500.0), 1)
    throttles = (-1.0, -0.5, 0.0, 0.5, 1.0)
    thrusts = [curves.thrust_curve(x, False, p) for x in throttles]
    assert thrusts == pytest.approx([0.08, 0.34, 0.6, 0.8, 1.0])
    assert curves.thrust_curve(-1.0, True, p) == 0.0
    p.set("MPC_THR_CURVE", 1.0, armed=False)
    thrusts = [curves.thrust_curve(x, False, p) for x in throttles]
    assert thrusts == pytest.approx([0.08, 0.31, 0.54, 0.77, 1.0])


# --- gestures


def test_a_gesture_is_held_for_a_while_and_counts_once():
    sticks = StickInput(sim_only=True)
    found = []
    for at_us in range(0, 3_000_000, 100_000):
        sticks.take(Sticks(yaw=1.0, throttle=-1.0), JOYSTICK, ONE, at_us, 0.0)
        found.append(sticks.gesture(1_000_000))
    assert [n for n, each in enumerate(found) if each] == [10]
    assert found[10] is Gesture.ARM


@pytest.mark.parametrize(
    "sticks",
    [
        Sticks(yaw=1.0, throttle=-0.8), Sticks(yaw=0.9, throttle=-1.0),
        Sticks(yaw=1.0, throttle=-1.0, roll=0.1), Sticks(yaw=-1.0, throttle=-1.0, pitch=-0.1),
    ],
)  # fmt: skip
def test_what_is_no_gesture(sticks):
    spoken = StickInput(sim_only=True)
    for at_us in (0, 2_000_000):
        spoken.take(sticks, JOYSTICK, ONE, at_us, 0.0)
        assert spoken.gesture(1_000_000) is None


# --- in flight


class Stick(Flown):
    """A vehicle that is flown by sticks, in still air."""

    def __init__(self, mode):
        super().__init__()
        self.fly(0.5)
        assert self.vehicle.select(mode, self.t_us, 0.0).granted

    def stick(self, seconds, done=lambda: False, **sticks):
        """Hold the sticks so for a while, at 20 Hz. What a gesture came to."""
        until, answer = self.t_us + round(seconds * 1e6), None
        while self.t_us < until and self.ended == dynamics.FLYING and not done():
            said = self.vehicle.fly_by(Sticks(**sticks), JOYSTICK, ONE, self.t_us, self.t_us * 1e-6)
            answer = said or answer
            self.fly(0.05)
        return answer

    def arm(self):
        self.stick(0.2, throttle=-1.0)
        return self.vehicle.arm(self.t_us, self.t_us * 1e-6)

    def lift(self):
        """Off the ground and at rest some metres up, in a mode that holds its height."""
        assert self.arm().granted
        self.stick(6.0, throttle=0.8)
        self.stick(4.0)

    @property
    def measured(self):
        return from_buffer(VehicleState, self.reported)

    @property
    def angles(self):
        return euler(matrix(self.measured.q_EB))


def raised(mode):
    """In the air and at rest, then flown by sticks in this mode."""
    flown = Stick(Mode.POSITION)
    flown.lift()
    if mode is not Mode.POSITION:
        assert flown.vehicle.select(mode, flown.t_us, flown.t_us * 1e-6).granted
    flown.params.set("COM_DISARM_LAND", -1.0, armed=True)
    return flown


def hover(mode):
    """Throttle that carries the vehicle about."""
    return {Mode.ACRO: 0.2}.get(mode, 0.0)


@pytest.mark.parametrize("mode", BY_STICKS)
@pytest.mark.computes
def test_directions(mode):
    """Forward, right, up and clockwise, whatever the heading."""
    flown = raised(mode)
    rates = mode is Mode.ACRO
    middle = hover(mode)
    flown.stick(0.3 if rates else 3.0, pitch=0.5, throttle=middle)
    assert flown.measured.v_E.x > 0.02 and abs(flown.measured.v_E.y) < 0.01
    assert flown.angles.y > 0.0
    flown = raised(mode)
    flown.stick(0.3 if rates else 3.0, roll=0.5, throttle=middle)
    assert flown.measured.v_E.y < -0.02 and abs(flown.measured.v_E.x) < 0.01
    flown = raised(mode)
    flown.stick(1.0, yaw=0.4 if rates else 1.0, throttle=middle)
    assert flown.angles.z < math.radians(-5.0)
    flown = raised(mode)
    before = flown.r.z
    flown.stick(3.0, throttle=1.0)
    assert flown.r.z > before + 1.0


@pytest.mark.parametrize("mode", [Mode.POSITION, Mode.ALTITUDE])
@pytest.mark.computes
def test_the_height_is_held_while_it_moves(mode):
    flown = raised(mode)
    before, off = flown.r.z, 0.0
    for sticks in ({"pitch": 1.0}, {"roll": -1.0}, {"pitch": -1.0, "roll": 1.0}, {}):
        for _ in range(40):
            flown.stick(0.05, **sticks)
            off = max(off, abs(flown.r.z - before))
    assert off < 0.2


def test_the_tilt_is_the_one_of_the_parameter_together_too():
    flown = raised(Mode.ALTITUDE)
    flown.params.set("MPC_MAN_TILT_MAX", 20.0, armed=True)
    flown.stick(2.0, pitch=1.0, roll=1.0)
    lean = math.degrees(math.acos(matrix(flown.measured.q_EB).e3.z))
    assert lean == pytest.approx(20.0, abs=0.3)


@pytest.mark.computes
def test_a_filtered_tilt_comes_later():
    leans = []
    for tau in (0.0, 1.0):
        flown = raised(Mode.STABILIZED)
        flown.params.set("MC_MAN_TILT_TAU", tau, armed=True)
        flown.stick(1.0, pitch=1.0)
        leans.append(flown.vehicle.setpoint.tilt_c.y)
    assert leans[0] == pytest.approx(math.radians(35.0))
    assert leans[1] == pytest.approx(math.radians(35.0) * (1.0 - math.exp(-1.0)), abs=0.02)


@pytest.mark.parametrize("mode", [Mode.POSITION, Mode.ALTITUDE])
def test_a_vehicle_stands_flat_until_the_throttle_is_above_65_percent(mode):
    flown = Stick(mode)
    assert flown.arm().granted
    stood = flown.r
    flown.stick(3.0, throttle=0.29, pitch=1.0, roll=-1.0, yaw=1.0)
    assert math.dist(flown.r[:2], stood[:2]) < 1e-3 and abs(flown.r.z - stood.z) < 0.01
    assert max(map(abs, flown.angles)) < 1e-3
    flown.stick(3.0, throttle=0.31)
    assert flown.r.z > flown.start[2] + 0.3


@pytest.mark.parametrize("mode", BY_THRUST)
@pytest.mark.computes
def test_a_vehicle_stands_flat_until_its_thrust_lifts_it(mode):
    flown = Stick(mode)
    assert flown.arm().granted
    stood = flown.r
    flown.stick(3.0, throttle=-0.1, pitch=1.0, yaw=1.0)
    assert math.dist(flown.r[:2], stood[:2]) < 1e-3 and abs(flown.r.z - stood.z) < 0.01
    assert max(map(abs, flown.angles)) < 1e-3
    flown.stick(2.0, throttle=0.4)
    assert flown.r.z > flown.start[2] + 0.5


@pytest.mark.parametrize("mode", [Mode.POSITION, Mode.ALTITUDE])
@pytest.mark.computes
def test_a_full_throttle_down_lands_it_gently(mode):
    flown = raised(mode)
    flown.params.set("MPC_Z_VEL_MAX_DN", 4.0, armed=True)
    flown.stick(40.0, lambda: flown.vehicle._landed.landed, throttle=-1.0)
    assert flown.ended == dynamics.FLYING
    assert flown.down_m_s < 0.75  # MPC_LAND_SPEED is 0.7
    flown.stick(1.0, throttle=-1.0)
    assert flown.tilt_deg < 3.0
    assert flown.vehicle.setpoint.T_c < 0.5 * flown.params.weight
    flown.stick(4.0, throttle=0.9)  # and up again
    assert flown.r.z > flown.start[2] + 0.5


@pytest.mark.computes
def test_after_a_landing_by_sticks_it_is_disarmed():
    flown = Stick(Mode.ALTITUDE)
    flown.lift()
    flown.stick(60.0, lambda: not flown.vehicle.armed, throttle=-1.0)
    assert not flown.vehicle.armed and flown.ended == dynamics.FLYING
    assert flown.told[-1] is Code.DISARMED_LANDED


# --- arming


@pytest.mark.parametrize("mode", BY_STICKS)
def test_a_throttle_that_is_not_low_prevents_arming(mode):
    flown = Stick(mode)
    flown.stick(0.1, throttle=0.3 if mode not in BY_THRUST else -0.5)
    answer = flown.vehicle.arm(flown.t_us, 0.0)
    why = Code.THROTTLE_NOT_LOW if mode in BY_THRUST else Code.THROTTLE_ABOVE_MIDDLE
    assert not answer.granted and answer.told.code is why
    assert flown.arm().granted


@pytest.mark.parametrize("mode", [each for each in BY_STICKS if each is not Mode.POSITION])
@pytest.mark.computes
def test_without_sticks_such_a_mode_is_chosen_and_not_armed(mode):
    flown = Stick(mode)
    assert flown.vehicle.mode is mode
    assert flown.vehicle.arm(flown.t_us, 0.0).told.code is Code.NO_STICKS
    up = Flown()
    up.up(2.0)
    answer = up.vehicle.select(mode, up.t_us, 0.0)
    assert not answer.granted and answer.told.code is Code.NO_STICKS
    assert up.vehicle.mode is Mode.HOLD


@pytest.mark.computes
def test_a_gesture_arms_and_disarms_on_the_ground_alone():
    flown = Stick(Mode.ALTITUDE)
    assert flown.stick(1.3, throttle=-1.0, yaw=1.0).told.code is Code.ARMED
    assert flown.vehicle.armed
    assert flown.stick(1.3, throttle=-1.0, yaw=-1.0).told.code is Code.DISARMED
    flown = raised(Mode.ALTITUDE)
    assert flown.stick(1.3, throttle=-1.0, yaw=-1.0).told.code is Code.IN_FLIGHT
    assert flown.vehicle.armed


def test_a_gesture_asks_for_a_mode_of_sticks_and_may_be_switched_off():
    flown = Stick(Mode.HOLD)
    answer = flown.stick(1.3, throttle=-1.0, yaw=1.0)
    assert answer.told.code is Code.MODE_WITHOUT_STICKS and not flown.vehicle.armed
    flown = Stick(Mode.ALTITUDE)
    flown.params.set("MAN_ARM_GESTURE", 0.0, armed=False)
    assert flown.stick(1.3, throttle=-1.0, yaw=1.0) is None
    assert not flown.vehicle.armed


# --- lost, and left


@pytest.mark.parametrize(
    ("action", "mode"), [(1.0, Mode.HOLD), (2.0, Mode.RETURN), (3.0, Mode.LAND)]
)
@pytest.mark.parametrize("flown_in", [Mode.POSITION, Mode.ALTITUDE, Mode.ACRO])
@pytest.mark.computes
def test_lost_sticks(flown_in, action, mode):
    flown = raised(flown_in)
    flown.params.set("NAV_RCL_ACT", action, armed=True)
    flown.stick(1.0, throttle=hover(flown_in))
    heard_us = flown.t_us - 50_000
    flown.fly(2.0, lambda: flown.vehicle.mode is not flown_in)
    assert flown.vehicle.mode is mode
    assert flown.told[-1] is Code.STICKS_LOST_MODE
    assert 500_000 < flown.t_us - heard_us <= 530_000
    assert flown.vehicle.failsafe


@pytest.mark.parametrize(("action", "terminated"), [(5.0, True), (6.0, False)])
@pytest.mark.computes
def test_lost_sticks_that_stop_the_rotors(action, terminated):
    flown = raised(Mode.STABILIZED)
    flown.params.set("NAV_RCL_ACT", action, armed=True)
    flown.stick(0.5)
    flown.fly(0.7)
    assert not flown.vehicle.armed
    assert flown.vehicle.terminated is terminated
    assert flown.told[-1] is Code.STICKS_LOST_STOPPED


def test_position_without_sticks_holds():
    flown = Flown()
    flown.up(3.0)
    assert flown.vehicle.select(Mode.POSITION, flown.t_us, 0.0).granted
    before = flown.r
    flown.fly(5.0)
    assert flown.vehicle.mode is Mode.POSITION and math.dist(flown.r, before) < 0.01


def leaves(mode, sticks, to=Mode.HOLD, seconds=3.0):
    """Fly by sticks, then in mode `to` until it rests: fastest backwards, and what saturated."""
    flown = raised(mode)
    flown.stick(seconds, **sticks)
    if to is not mode:
        assert flown.vehicle.select(to, flown.t_us, flown.t_us * 1e-6).granted
    v = flown.measured.v_E
    fast = math.hypot(v.x, v.y)
    found = SimpleNamespace(speed=fast, back=0.0, fell=0.0, cut_s=0.0, flown=flown)
    before = flown.r.z
    inside = False
    limits = flown.vehicle._limits()
    for _ in range(900):
        flown.stick(0.05) if to is mode else flown.fly(0.05)
        now = flown.measured.v_E
        found.back = max(found.back, -(now.x * v.x + now.y * v.y) / fast)
        found.fell = max(found.fell, before - flown.r.z)
        slow = math.hypot(now.x, now.y) < limits.cruise
        inside = inside or (slow and max(map(abs, flown.angles[:2])) < math.radians(10.0))
        cut = [
            column(Tick, flown.row, f"outputs.saturation.{n}") for n in ("thrust", "tilt", "torque")
        ]
        if inside and np.any(np.array(cut) > 0.5):
            found.cut_s += 0.05
    found.rests = flown.measured.v_E
    return found


@pytest.mark.slow
@pytest.mark.parametrize("mode", [Mode.ALTITUDE, Mode.STABILIZED, Mode.ACRO, Mode.POSITION])
def test_a_vehicle_stops_where_sticks_are_left(mode):
    """Once tilt and speed are those that the vehicle is led with, nothing saturates any more."""
    sticks = {"pitch": 0.25, "throttle": 0.2} if mode is Mode.ACRO else {"pitch": 1.0}
    if mode is Mode.STABILIZED:
        sticks["throttle"] = 0.25  # it would lose height otherwise
    found = leaves(mode, sticks, seconds=0.7 if mode is Mode.ACRO else 4.0)
    assert found.flown.ended == dynamics.FLYING
    assert math.hypot(*found.rests[:2]) < 0.3
    assert found.back < 0.3
    assert found.fell < 1.0
    assert found.cut_s == 0.0


@pytest.mark.slow
def test_sticks_let_go_stop_it():
    found = leaves(Mode.POSITION, {"pitch": 1.0}, Mode.POSITION, 8.0)
    assert math.hypot(*found.rests[:2]) < 0.01
    assert found.back < 0.15
    assert found.cut_s == 0.0
