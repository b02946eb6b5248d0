"""Ticks that compiled code does by itself: as Python would have done them, to the bit, and nearly all."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.interface.messages import Battery, VehicleState
from fcu.interface.status_texts import Code
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import size, to_buffer
from fcu.kernel.rows import column_of
from fcu.vehicle.conditions import NO_MODEL, Condition, look
from fcu.vehicle.modes import Mode
from fcu.vehicle.position_filter import PositionFilter, quiet
from fcu.vehicle.state_machine import StateMachine
from tests.vehicle.flown import ZERO, Flown, at

H, TICK_US = 0.002, 2000


class Both:
    """Two of a kind: what is asked of one is asked of the other, with the same answer."""

    def __init__(self, one, other):
        self.__dict__.update(one=one, other=other)

    def __getattr__(self, name):
        one, other = getattr(self.one, name), getattr(self.other, name)
        if not callable(one):
            return one

        def asked(*args, **kwargs):
            answer = one(*args, **kwargs)
            assert repr(other(*args, **kwargs)) == repr(answer)
            return answer

        return asked


class Vehicles(Both):
    """One is observed at every tick, the other only where a look has found something."""

    def __init__(self, params):
        super().__init__(StateMachine(params, True), StateMachine(params, True))
        self.__dict__.update(script=Both(self.one.script, self.other.script), quiet=[], charge=None)

    def observe(self, state, t_us, wall_s):
        one, other = self.one, self.other
        flown = at(0.0, 0.0, 0.0) if other.setpoint is None else other.setpoint
        age, remaining = (t_us - other.since_us) * 1e-6, math.nan
        if self.charge is not None:
            remaining = self.charge(t_us)
            one.battery = other.battery = Battery(22.0, 10.0, 0.0, remaining, 0.0)
        found = look(other.watch, state, NO_MODEL, to_buffer(flown), age, remaining, float(t_us))
        is_quiet = found == Condition.NOTHING
        told = [] if is_quiet else other.observe(state, t_us, wall_s)
        self.quiet.append(is_quiet)
        assert told == one.observe(state, t_us, wall_s)
        for name in ("armed", "mode", "setpoint", "since_us", "_approach", "terminated", "home"):
            assert repr(getattr(one, name)) == repr(getattr(other, name)), (name, t_us)
        assert one.watch.tobytes() == other.watch.tobytes(), t_us
        return told


@pytest.fixture
def flown():
    flown = Flown()
    flown.vehicle = Vehicles(flown.params)
    return flown


def share(flown, since=0):
    return np.mean(flown.vehicle.quiet[since:])


@pytest.mark.computes
def test_a_cruise_in_offboard_and_a_hold_are_quiet(flown):
    flown.up(10.0)
    flown.stream(lambda: at(3.0, 2.0, 9.0), 1.0)
    since = len(flown.vehicle.quiet)
    flown.stream(lambda: at(5.0, 3.0, 9.0), 20.0)
    assert share(flown, since) >= 0.99
    flown.vehicle.select(Mode.HOLD, flown.t_us, 0.0)
    since = len(flown.vehicle.quiet)
    flown.fly(10.0)
    assert share(flown, since) >= 0.99


@pytest.mark.computes
def test_a_stream_that_is_lost_a_return_and_its_landing(flown):
    flown.params.set("COM_OBL_RC_ACT", 3.0, False)
    flown.up(3.0)
    flown.stream(lambda: at(4.0, 0.0, 4.0), 4.0)
    flown.fly(60.0, lambda: not flown.vehicle.armed)
    assert Code.OFFBOARD_LOST_MODE in flown.told
    assert flown.told[-2:] == [Code.LANDED, Code.DISARMED_LANDED]


@pytest.mark.computes
def test_setpoints_near_the_ground_and_in_it(flown):
    flown.up(2.5)
    flown.stream(lambda: at(4.0, 0.0, -0.7), 2.0)  # raised
    flown.stream(lambda: at(4.0, 0.0, 0.34), 4.0)
    fall = Vec3(0.0, 0.0, -0.5)
    flown.stream(lambda: flown.vehicle.flown(flown.t_us)._replace(v_c=fall, a_c=ZERO), 3.0)
    flown.stream(lambda: at(1.0, 1.0, -0.7), 30.0, lambda: not flown.vehicle.armed)
    assert flown.told[-1] is Code.DISARMED_LANDED


@pytest.mark.computes
def test_a_reposition_into_the_ground_and_idling_on_it(flown):
    flown.fly(0.5)
    flown.vehicle.arm(flown.t_us, 0.0)
    flown.fly(12.0, lambda: not flown.vehicle.armed)
    assert flown.told[-1] is Code.DISARMED_IDLE
    flown.up(2.5)
    flown.vehicle.reposition(Vec3(3.0, 0.0, -3.0), None, flown.t_us)
    flown.fly(30.0, lambda: not flown.vehicle.armed)
    assert Code.LED_INTO_GROUND in flown.told


@pytest.mark.computes
def test_a_battery_that_runs_low_returns_and_lands(flown):
    """It falls by 2 % a second, and each report is off by up to 1 %."""
    random = np.random.default_rng(1)
    flown.params.set("COM_LOW_BAT_ACT", 3.0, False)
    flown.up(3.0)
    flown.stream(lambda: at(4.0, 0.0, 4.0), 4.0)
    began = flown.t_us
    flown.vehicle.__dict__["charge"] = lambda t_us: (
        0.2 - 2e-8 * (t_us - began) + 0.01 * random.uniform(-1.0, 1.0)
    )
    flown.fly(60.0, lambda: not flown.vehicle.armed)
    levels = Code.BATTERY_LOW, Code.BATTERY_CRITICAL, Code.BATTERY_EMERGENCY
    assert [code for code in flown.told if code in levels] == list(levels)
    assert flown.told[-2:] == [Code.LANDED, Code.DISARMED_LANDED]


@pytest.mark.parametrize("kind", ["noise", "jump", "stuck"])
def test_a_quiet_position_filter_changes_no_byte(kind):
    random = np.random.default_rng(5)
    one, other = PositionFilter(), PositionFilter()
    state = np.zeros(size(VehicleState))
    quiets = []
    for k in range(1, 3000):
        state[:] = 0.0 if kind == "stuck" and k > 500 else 0.1 * random.standard_normal(state.size)
        if kind == "jump" and 700 < k < 900:
            state[column_of(VehicleState, "r_E.x")] += 50.0
        t_us = k * TICK_US
        before = other.buffer.copy()
        is_quiet = quiet(other.buffer, state, H, float(t_us))
        if not is_quiet:
            assert other.buffer.tobytes() == before.tobytes()
        told = [] if is_quiet else list(other.pass_on(state, H, t_us))
        assert told == list(one.pass_on(state, H, t_us))
        assert one.buffer.tobytes() == other.buffer.tobytes()
        quiets.append(is_quiet)
    loud = {"noise": 0, "jump": 200, "stuck": 1}[kind]
    assert len(quiets) - sum(quiets) == loud
