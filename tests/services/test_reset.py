"""Who may reset the vehicle by a command, and when."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.interface.airframe import believed
from fcu.interface.messages import VehicleState
from fcu.interface.status_texts import Code, Told
from fcu.kernel.buffers import columns, size
from fcu.mavlink.definitions import CommandId, LandedState, Result, SystemStatus
from fcu.mavlink.framing import Source
from fcu.mavlink.geodesy import Origin
from fcu.mavlink.requests import Command
from fcu.parameters import Parameters
from fcu.process.settings import settings
from fcu.services.command_protocol import FORCE_REBOOT, Commands, Request
from fcu.services.status import landed_state, system_status
from fcu.vehicle.state_machine import Answer, StateMachine

FRAME_MISSION, GLOBAL = 2, 0


@pytest.fixture
def vehicle():
    state = np.zeros(size(VehicleState))
    state[columns(VehicleState).index("q_EB.w")] = 1.0
    made = StateMachine(Parameters(settings(*believed(), 500.0), 1))
    made.observe(state, 0, 0.0)
    return made


@pytest.fixture
def commands(vehicle):
    return Commands(vehicle, Origin(47.0, 8.0, 500.0), resets=True)


def asked(commands, first, sixth=0.0, system=1, frame=None):
    """(result, code) of PREFLIGHT_REBOOT_SHUTDOWN with parameters 1 and 6."""
    params = (first, 0.0, 0.0, 0.0, 0.0, sixth, 0.0)
    command = Command(Source(255, 190), system, 1, CommandId.REBOOT, params, frame, 0)
    result, told, _ = commands.answer(Request(command, 0, 0.0))
    return result, None if told is None else told.values[1].code


@pytest.mark.parametrize(("first", "resets"), [(1.0, True), (0.0, False)])
def test_disarmed_it_is_accepted(commands, first, resets):
    assert asked(commands, first) == (Result.ACCEPTED, None)
    assert commands.reset_asked is resets


@pytest.mark.parametrize(
    ("first", "system", "why"),
    [
        (2.0, 1, Code.RESETS_ONLY),
        (3.0, 1, Code.RESETS_ONLY),
        (math.nan, 1, Code.PARAMETER_NAN),
        (1.0, 0, Code.TO_NO_SYSTEM),
    ],
)
def test_commands_that_are_no_reset(commands, first, system, why):
    assert asked(commands, first, system=system) == (Result.DENIED, why)
    assert not commands.reset_asked


@pytest.mark.parametrize(
    ("sixth", "frame"),
    [(FORCE_REBOOT, None), (FORCE_REBOOT / 1e4, FRAME_MISSION), (FORCE_REBOOT / 1e7, GLOBAL)],
)
def test_armed_it_is_denied_unless_forced(vehicle, commands, sixth, frame):
    assert vehicle.arm(0, 0.0).granted
    for no_force in (0.0, math.nan, 1.0, 21196.0):
        assert asked(commands, 1.0, no_force, frame=frame) == (
            Result.DENIED, Code.ARMED_NOT_RESET,
        )  # fmt: skip
    assert not commands.reset_asked
    assert asked(commands, 1.0, sixth, frame=frame) == (Result.ACCEPTED, None)
    assert commands.reset_asked


def test_a_flight_that_is_recorded_is_not_reset(vehicle):
    commands = Commands(vehicle, Origin(47.0, 8.0, 500.0))
    assert asked(commands, 1.0) == (Result.DENIED, Code.ONE_FLIGHT)
    assert not commands.reset_asked


@pytest.mark.parametrize(
    ("how", "landed"),
    [(Code.CRASHED, LandedState.ON_GROUND), (Code.DIVERGED, LandedState.UNDEFINED)],
)
def test_a_vehicle_that_is_lost_can_only_be_reset(vehicle, commands, how, landed):
    assert vehicle.arm(0, 0.0).granted
    vehicle.end(Told(how), vehicle.state, 2000)
    assert not vehicle.armed and vehicle.setpoint is None
    assert system_status(vehicle) is SystemStatus.EMERGENCY
    assert landed_state(vehicle) is landed
    assert vehicle.arm(4000, 0.0) == Answer(False, Told(Code.HAS_ENDED))
    assert asked(commands, 1.0) == (Result.ACCEPTED, None)
