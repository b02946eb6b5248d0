"""The numbers of the enumerations are MAVLink's."""

from __future__ import annotations

import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.mavlink import enums as ours
from fcu.mavlink.asks import ACTIVE, GCS, NO_AUTOPILOT
from fcu.mavlink.enums import AutoMode, CommandId, MainMode, Sensor
from fcu.mavlink.telemetry import OCTOROTOR

COMMANDS = {
    CommandId.RETURN: "NAV_RETURN_TO_LAUNCH",
    CommandId.LAND: "NAV_LAND",
    CommandId.TAKEOFF: "NAV_TAKEOFF",
    CommandId.SET_MODE: "DO_SET_MODE",
    CommandId.CHANGE_SPEED: "DO_CHANGE_SPEED",
    CommandId.SET_HOME: "DO_SET_HOME",
    CommandId.FLIGHT_TERMINATION: "DO_FLIGHTTERMINATION",
    CommandId.REPOSITION: "DO_REPOSITION",
    CommandId.PAUSE_CONTINUE: "DO_PAUSE_CONTINUE",
    CommandId.PREFLIGHT_STORAGE: "PREFLIGHT_STORAGE",
    CommandId.ARM_DISARM: "COMPONENT_ARM_DISARM",
    CommandId.RUN_PREARM_CHECKS: "RUN_PREARM_CHECKS",
    CommandId.GET_HOME_POSITION: "GET_HOME_POSITION",
    CommandId.GET_MESSAGE_INTERVAL: "GET_MESSAGE_INTERVAL",
    CommandId.SET_MESSAGE_INTERVAL: "SET_MESSAGE_INTERVAL",
    CommandId.REQUEST_MESSAGE: "REQUEST_MESSAGE",
    CommandId.REQUEST_PROTOCOL_VERSION: "REQUEST_PROTOCOL_VERSION",
    CommandId.REQUEST_CAPABILITIES: "REQUEST_AUTOPILOT_CAPABILITIES",
}
SENSORS = {
    Sensor.GYRO: "3D_GYRO",
    Sensor.ACCEL: "3D_ACCEL",
    Sensor.MAG: "3D_MAG",
    Sensor.PRESSURE: "ABSOLUTE_PRESSURE",
    Sensor.GPS: "GPS",
    Sensor.MOTORS: "MOTOR_OUTPUTS",
    Sensor.BATTERY: "BATTERY",
}
MASKS = {
    ours.IGNORE_POSITION: ("X_IGNORE", "Y_IGNORE", "Z_IGNORE"),
    ours.IGNORE_VELOCITY: ("VX_IGNORE", "VY_IGNORE", "VZ_IGNORE"),
    ours.IGNORE_ACCELERATION: ("AX_IGNORE", "AY_IGNORE", "AZ_IGNORE"),
    ours.FORCE: ("FORCE_SET",),
    ours.IGNORE_YAW: ("YAW_IGNORE",),
    ours.IGNORE_YAW_RATE: ("YAW_RATE_IGNORE",),
}
ATTITUDE_MASKS = {
    ours.IGNORE_ROLL_RATE: "BODY_ROLL_RATE_IGNORE",
    ours.IGNORE_PITCH_RATE: "BODY_PITCH_RATE_IGNORE",
    ours.IGNORE_SPIN_RATE: "BODY_YAW_RATE_IGNORE",
    ours.IGNORE_THRUST: "THROTTLE_IGNORE",
    ours.IGNORE_ATTITUDE: "ATTITUDE_IGNORE",
}


NEWER = {ours.Result.CANCELLED, ours.Result.UNSUPPORTED_MAV_FRAME}  # than the dialect


def theirs(prefix, name):
    return getattr(mavlink, prefix + name)


def test_commands():
    # DO_SET_STANDARD_MODE is in development: 262, and not in the common dialect
    assert set(CommandId) - set(COMMANDS) == {CommandId.SET_STANDARD_MODE}
    assert CommandId.SET_STANDARD_MODE == 262
    for command, name in COMMANDS.items():
        assert command == theirs("MAV_CMD_", name)


@pytest.mark.parametrize(
    ("kind", "prefix", "other"),
    [
        (ours.Result, "MAV_RESULT_", {}),
        (ours.Severity, "MAV_SEVERITY_", {}),
        (ours.Frame, "MAV_FRAME_", {}),
        (ours.SystemStatus, "MAV_STATE_", {"UNINITIALISED": "UNINIT"}),
        (ours.LandedState, "MAV_LANDED_STATE_", {"TAKING_OFF": "TAKEOFF"}),
        (ours.Autopilot, "MAV_AUTOPILOT_", {}),
        (ours.Capability, "MAV_PROTOCOL_CAPABILITY_", {}),
    ],
)
def test_enumerations(kind, prefix, other):
    for member in set(kind) - NEWER:
        assert member == theirs(prefix, other.get(member.name, member.name)), member


def test_numbers_newer_than_the_dialect_are_the_standards():
    assert (ours.Result.CANCELLED, ours.Result.UNSUPPORTED_MAV_FRAME) == (6, 9)
    assert ours.THRUST_BODY == 32


def test_masks_and_sensors():
    for mask, names in MASKS.items():
        assert mask == sum(theirs("POSITION_TARGET_TYPEMASK_", name) for name in names)
    for mask, name in ATTITUDE_MASKS.items():
        assert mask == theirs("ATTITUDE_TARGET_TYPEMASK_", name)
    for sensor, name in SENSORS.items():
        assert sensor == theirs("MAV_SYS_STATUS_SENSOR_", name)
    assert theirs("MAV_SYS_STATUS_", "AHRS") == Sensor.AHRS
    assert theirs("MAV_SYS_STATUS_", "PREARM_CHECK") == Sensor.PREARM


def test_modes_are_px4s():
    assert [(m.name, m.value) for m in MainMode] == [
        ("MANUAL", 1), ("ALTITUDE", 2), ("POSITION", 3), ("AUTO", 4), ("ACRO", 5),
        ("OFFBOARD", 6), ("STABILIZED", 7),
    ]  # fmt: skip
    assert (AutoMode.TAKEOFF, AutoMode.LOITER, AutoMode.RETURN, AutoMode.LAND) == (2, 3, 5, 6)


def test_what_a_ground_station_and_an_octocopter_are():
    assert (GCS, NO_AUTOPILOT, ACTIVE, OCTOROTOR) == (
        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, mavlink.MAV_STATE_ACTIVE,
        mavlink.MAV_TYPE_OCTOROTOR,
    )  # fmt: skip
