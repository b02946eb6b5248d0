"""Commands as clients send them: places in COMMAND_LONG, and repetitions by their confirmation."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from fcu.interface.airframe import believed
from fcu.interface.messages import VehicleState
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import columns
from fcu.mavlink.definitions import CommandId, Result
from fcu.mavlink.failures import Signal, order
from fcu.mavlink.framing import Source
from fcu.mavlink.geodesy import Origin, to_geodetic
from fcu.mavlink.requests import Command
from fcu.parameters import Parameters
from fcu.process.settings import settings
from fcu.services.command_protocol import CommandProtocol, Commands, Request
from fcu.vehicle.modes import Mode
from fcu.vehicle.state_machine import StateMachine

ORIGIN, NAN = Origin(47.0, 8.0, 500.0), math.nan
GLOBAL, LONG = 0, None


@pytest.fixture
def vehicle():
    """Armed, and in the air."""
    names = columns(VehicleState)
    state = np.array([320.0 if name.startswith("Omega") else 0.0 for name in names])
    state[names.index("q_EB.w")] = 1.0
    made = StateMachine(Parameters(settings(*believed(), 500.0), 1))
    made.observe(state, 0, 0.0)
    assert made.arm(0, 0.0).granted
    return made


@pytest.fixture
def commands(vehicle):
    return Commands(vehicle, ORIGIN)


def verdict_of(commands, number, *params, frame=LONG):
    """Verdict on a command with so many parameters, the others 0."""
    seven = (*map(float, params), *[0.0] * (7 - len(params)))
    command = Command(Source(255, 190), 1, 1, number, seven, frame, 0)
    return commands.answer(Request(command, 0, 0.0))


def asked(commands, number, *params, frame=LONG):
    """(result, reason) of a command with so many parameters, the others 0."""
    result, told, _ = verdict_of(commands, number, *params, frame=frame)
    return result, told.values[1].code if told and told.code is Code.DENIED else None


def place(x, y, z):
    """Latitude and longitude in degrees and the height above the sea of a place, m, E."""
    return tuple(to_geodetic(ORIGIN, Vec3(x, y, z)))


@pytest.mark.parametrize("frame", [LONG, GLOBAL])
def test_a_landing_is_here_whatever_the_height(vehicle, commands, frame):
    for lat, lon, alt in ((0, 0, 0), (*place(3.0, 0.0, 0.0)[:2], 0), (NAN, NAN, NAN)):
        assert asked(commands, CommandId.LAND, 0, 0, 0, NAN, lat, lon, alt, frame=frame) == (
            Result.ACCEPTED, None,
        )  # fmt: skip
        assert vehicle.mode is Mode.LAND
        assert vehicle.select(Mode.HOLD, 0, 0.0).granted
    far = place(50.0, 0.0, 0.0)
    denied = asked(commands, CommandId.LAND, 0, 0, 0, NAN, *far, frame=frame)
    assert denied == (Result.DENIED, Code.LANDS_HERE)


@pytest.mark.parametrize("frame", [LONG, GLOBAL])
def test_a_place_is_flown_to_however_it_is_sent(vehicle, commands, frame):
    where = place(30.0, -20.0, 10.0)
    assert (
        asked(commands, CommandId.REPOSITION, -1, 1, 0, NAN, *where, frame=frame)[0]
        is Result.ACCEPTED
    )
    for t_us in range(0, 60_000_000, 20_000):
        vehicle.leader.advance(t_us)
    assert vehicle.setpoint.r_c == pytest.approx((30.0, -20.0, 10.0), abs=1e-3)


@pytest.mark.parametrize("frame", [LONG, GLOBAL])
@pytest.mark.parametrize("params", [(), (0, 0, 15, 90), (0, 0, 0, NAN, NAN, NAN, NAN)])
def test_loiter_holds_here_where_it_names_no_place(vehicle, commands, frame, params):
    assert vehicle.select(Mode.LAND, 0, 0.0).granted
    assert asked(commands, CommandId.LOITER, *params, frame=frame)[0] == Result.ACCEPTED
    assert vehicle.mode is Mode.HOLD


@pytest.mark.parametrize("frame", [LONG, GLOBAL])
def test_loiter_flies_to_the_place_that_it_names(vehicle, commands, frame):
    where = place(30.0, -20.0, 12.0)
    assert (
        asked(commands, CommandId.LOITER, 0, 0, 0, NAN, *where, frame=frame)[0] == Result.ACCEPTED
    )
    assert vehicle.mode is Mode.HOLD
    for t_us in range(0, 60_000_000, 20_000):
        vehicle.leader.advance(t_us)
    assert vehicle.setpoint.r_c == pytest.approx((30.0, -20.0, 12.0), abs=1e-3)
    half = (where[0], NAN, where[2])
    assert asked(commands, CommandId.LOITER, 0, 0, 0, NAN, *half, frame=frame) == (
        Result.DENIED, Code.NO_PLACE_NEAR,
    )  # fmt: skip
    far = place(30_000.0, 0.0, 12.0)
    assert asked(commands, CommandId.LOITER, 0, 0, 0, NAN, *far, frame=frame) == (
        Result.DENIED, Code.NO_PLACE_NEAR,
    )  # fmt: skip


@pytest.mark.parametrize("frame", [LONG, GLOBAL])
@pytest.mark.parametrize(
    ("radius", "speed", "way"), [(10.0, 2.0, -1.0), (-10.0, 2.0, 1.0), (10.0, -2.0, 1.0)]
)  # fmt: skip
def test_an_orbit_flies_round_its_place(vehicle, commands, frame, radius, speed, way):
    """Clockwise for a radius above 0, with the nose to the centre, at the speed that was asked for."""
    where = place(30.0, -20.0, 12.0)
    found = asked(commands, CommandId.ORBIT, radius, speed, 0, 0, *where, frame=frame)
    assert found == (Result.ACCEPTED, None)
    assert vehicle.mode is Mode.ORBIT
    for t_us in range(0, 60_000_000, 20_000):
        vehicle.leader.advance(t_us)
    flown = vehicle.setpoint
    x, y = flown.r_c.x - 30.0, flown.r_c.y + 20.0
    assert math.hypot(x, y) == pytest.approx(10.0, abs=1e-3)
    assert flown.r_c.z == pytest.approx(12.0, abs=1e-3)
    assert (x * flown.v_c.y - y * flown.v_c.x) / 10.0 == pytest.approx(2.0 * way, abs=1e-6)
    assert math.cos(flown.psi_c - math.atan2(-y, -x)) == pytest.approx(1.0, abs=1e-6)
    assert flown.psi_dot_c == pytest.approx(way * 0.2, abs=1e-9)


NEAR_HERE = (NAN, NAN, NAN)


def test_a_parameter_without_effect_is_told_and_hinders_nothing(commands, vehicle):
    """As PX4 takes it: a landing with a number in parameter 3 lands."""
    params = NAN, 0.0, 7.0, NAN, 0.0, 0.0, 0.0
    verdict = verdict_of(commands, CommandId.LAND, *params)
    assert (verdict.result, vehicle.mode) == (Result.ACCEPTED, Mode.LAND)
    assert verdict.unused == Told(Code.PARAMETER_UNUSED, ("Landing", 3))
    verdict = verdict_of(commands, CommandId.LAND)
    assert verdict.unused is None


@pytest.mark.parametrize(
    ("params", "code"),
    [
        ((0.5, 1.0, 0.0, 0.0, *NEAR_HERE), Code.ORBIT_RADIUS),
        ((1001.0, 1.0, 0.0, 0.0, *NEAR_HERE), Code.ORBIT_RADIUS),
        ((10.0, 0.0, 0.0, 0.0, *NEAR_HERE), Code.SPEED_RANGE),
        ((100.0, 100.0, 0.0, 0.0, *NEAR_HERE), Code.SPEED_RANGE),
        ((1.0, 2.5, 0.0, 0.0, *NEAR_HERE), Code.ASKS_TOO_MUCH),
        ((10.0, 1.0, 2.0, 0.0, *NEAR_HERE), Code.ORBIT_YAW),
        ((10.0, 1.0, 0.0, 0.0, *place(30_000.0, 0.0, 5.0)), Code.NO_PLACE_NEAR),
        ((math.inf, 1.0, 0.0, 0.0, *NEAR_HERE), Code.PARAMETER_NAN),
    ],
)
def test_an_orbit_that_cannot_be_flown_is_denied_and_changes_nothing(
    vehicle, commands, params, code
):
    before = vehicle.mode, vehicle.setpoint, vehicle.circle
    assert asked(commands, CommandId.ORBIT, *params, frame=GLOBAL) == (Result.DENIED, code)
    assert (vehicle.mode, vehicle.setpoint, vehicle.circle) == before


def test_an_orbit_begins_with_its_command_and_not_by_a_mode(vehicle, commands):
    for params in ((CommandId.SET_MODE, 1, 3, 1), (CommandId.SET_STANDARD_MODE, 2)):
        assert asked(commands, *params) == (Result.DENIED, Code.ORBIT_BY_COMMAND)
    asked(commands, CommandId.ORBIT, NAN, NAN, NAN, NAN, *NEAR_HERE, frame=GLOBAL)
    assert (vehicle.mode, vehicle.circle.radius, vehicle.circle.speed) == (Mode.ORBIT, 1.0, 1.0)


@pytest.mark.parametrize("frame", [LONG, GLOBAL])
def test_home_is_set_with_whatever_else_is_sent(vehicle, commands, frame):
    """MAVROS sends a yaw with it."""
    where = place(30.0, -20.0, 10.0)
    assert (
        asked(commands, CommandId.SET_HOME, 0, 0, 0, 90.0, *where, frame=frame)[0]
        is Result.ACCEPTED
    )
    assert vehicle.home == pytest.approx((30.0, -20.0, 10.0), abs=1e-3)


@pytest.mark.parametrize(("below_m", "why"), [(50.0, None), (200.0, Code.NO_HEIGHT_NEAR)])
def test_home_is_not_set_far_below_the_ground(commands, below_m, why):
    where = place(30.0, -20.0, -below_m)
    assert asked(commands, CommandId.SET_HOME, 0, 0, 0, 0, *where, frame=GLOBAL)[1] is why


def test_a_place_out_of_reach_is_not_a_matter_of_height(commands):
    where = place(30_000.0, 0.0, 10.0)
    denied = asked(commands, CommandId.SET_HOME, 0, 0, 0, 0, *where, frame=GLOBAL)
    assert denied == (Result.DENIED, Code.NO_PLACE_NEAR)


class Client:
    """Sends commands over one link, and hears how each is acknowledged."""

    def __init__(self, vehicle, commands):
        self._protocol = CommandProtocol(commands, frozenset(), vehicle, lambda *told: None)
        self._link, self._at = SimpleNamespace(acknowledged=[]), 0.0
        self.results = []

    def send(self, _link, *messages):
        self.results += messages

    def ask(self, number, *params, confirmation=0):
        seven = (*map(float, params), *[0.0] * (7 - len(params)))
        self._at += 0.1
        command = Command(Source(255, 190), 1, 1, number, seven, LONG, confirmation)
        self._protocol.take(self, self._link, command, 0, self._at)


@pytest.fixture
def client(vehicle, commands):
    return Client(vehicle, commands)


def test_a_client_that_always_confirms_arms_and_disarms_as_often_as_it_asks(vehicle, client):
    """MAVROS sends each command with confirmation 1."""
    for _ in range(3):
        client.ask(CommandId.ARM_DISARM, 0, 21196.0, confirmation=1)
        assert not vehicle.armed
        client.ask(CommandId.ARM_DISARM, 1, confirmation=1)
        assert vehicle.armed


def test_arming_needs_no_number_that_forces_it(vehicle, client):
    client.ask(CommandId.ARM_DISARM, 0, 21196.0)
    assert not vehicle.armed
    client.ask(CommandId.ARM_DISARM, 1, math.nan)
    assert vehicle.armed


def test_a_repetition_is_of_a_command_that_was_sent_with_a_lower_confirmation(vehicle, client):
    client.ask(CommandId.ARM_DISARM, 0, 21196.0)
    assert vehicle.arm(0, 0.0).granted  # by another client
    client.ask(CommandId.ARM_DISARM, 0, 21196.0, confirmation=1)
    assert vehicle.armed  # its answer was lost: it is not done again
    client.ask(CommandId.ARM_DISARM, 0, 21196.0)
    assert not vehicle.armed


def test_a_take_off_names_the_place_by_its_latitude_and_longitude_alone(vehicle, commands):
    """Its height may be above the sea or above home, wherever the origin is."""
    assert vehicle.disarm(0, forced=True).granted
    vehicle.state[columns(VehicleState).index("Omega.r1") :] = 0.0
    for t_us in range(0, 1_000_000, 20_000):
        vehicle.observe(vehicle.state, t_us, 0.0)
    here = place(0.0, 0.0, 0.0)[:2]
    for height in (10.0, 510.0):
        answered = asked(commands, CommandId.TAKEOFF, 0, 0, 0, NAN, *here, height, frame=GLOBAL)
        assert answered == (Result.ACCEPTED, None)


@pytest.mark.parametrize(
    ("params", "why"),
    [
        ((104, 1, 77), Code.FAILURE_RANGE), ((105, 1, 2, 0, 5), Code.FAILURE_RANGE),
        ((105, 1, 0, 0, 601), Code.FAILURE_RANGE), ((105, 1), Code.FAILURE_ENDLESS),
        ((105, 1, 0, 0, math.inf), Code.PARAMETER_NAN),
    ],
)  # fmt: skip
def test_a_failure_that_makes_no_sense_of_what_is_heard_is_denied(vehicle, commands, params, why):
    vehicle._params.set("SYS_FAILURE_EN", 1.0, True)
    assert asked(commands, CommandId.INJECT_FAILURE, *params) == (Result.DENIED, why)
    assert not any(commands.is_deaf(signal, 0) for signal in Signal)


def test_after_the_end_of_a_flight_everything_is_heard(vehicle, commands):
    """Simulation time stands then, and would end no failure."""
    vehicle._params.set("SYS_FAILURE_EN", 1.0, True)
    verdict = verdict_of(commands, CommandId.INJECT_FAILURE, 105, 1, 0, 0, 600)
    assert verdict.result is Result.ACCEPTED
    assert commands.is_deaf(Signal.MAVLINK_SIGNAL, 599_999_999)
    vehicle.end(Told(Code.CRASHED), vehicle.state, 0)
    assert not commands.is_deaf(Signal.MAVLINK_SIGNAL, 0)


def test_a_simulator_that_is_silent_leaves_nobody_unheard(vehicle, commands):
    """Simulation time stands for as long as it is: the loop says so (`Loop`)."""
    vehicle._params.set("SYS_FAILURE_EN", 1.0, True)
    for signal in Signal:
        verdict_of(commands, CommandId.INJECT_FAILURE, signal, 1, 0, 0, 600)
        assert commands.is_deaf(signal, 0)
    commands.hear_again()
    assert not any(commands.is_deaf(signal, 0) for signal in Signal)


@pytest.mark.parametrize("signal", Signal)
def test_infinity_makes_no_order_of_a_failure(signal):
    """Also where it comes from a foreign controller, past the checks of commands."""
    for n in range(5):
        params = [float(signal), 1.0, 0.0, 0.0, 0.0]
        params[n] = math.inf
        assert order(params) is None
