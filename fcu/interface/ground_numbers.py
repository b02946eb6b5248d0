"""Numbers of MAVLink that the vehicle understands: commands, frames, sensors, capabilities."""

from __future__ import annotations

from enum import IntEnum, IntFlag


class CommandId(IntEnum):
    """The MAV_CMD numbers that are understood here."""

    RETURN = 20
    LAND = 21
    TAKEOFF = 22
    SET_MODE = 176
    CHANGE_SPEED = 178
    SET_HOME = 179
    FLIGHT_TERMINATION = 185
    REPOSITION = 192
    PAUSE_CONTINUE = 193
    PREFLIGHT_STORAGE = 245
    SET_STANDARD_MODE = 262
    ARM_DISARM = 400
    RUN_PREARM_CHECKS = 401
    GET_HOME_POSITION = 410
    GET_MESSAGE_INTERVAL = 510
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512
    REQUEST_PROTOCOL_VERSION = 519
    REQUEST_CAPABILITIES = 520


class Frame(IntEnum):
    """MAV_FRAME, of those that setpoints and commands come in."""

    GLOBAL = 0
    LOCAL_NED = 1
    GLOBAL_RELATIVE_ALT = 3
    GLOBAL_INT = 5
    GLOBAL_RELATIVE_ALT_INT = 6
    LOCAL_OFFSET_NED = 7
    BODY_NED = 8
    BODY_OFFSET_NED = 9
    BODY_FRD = 12


# velocity and acceleration along the heading, not along North
BODY_FRAMES = frozenset({Frame.BODY_NED, Frame.BODY_OFFSET_NED, Frame.BODY_FRD})
# position and yaw from where the vehicle is; along the heading too
OFFSET_FRAMES = frozenset({Frame.BODY_OFFSET_NED, Frame.BODY_FRD})
GLOBAL_FRAMES = frozenset(
    {Frame.GLOBAL, Frame.GLOBAL_RELATIVE_ALT, Frame.GLOBAL_INT, Frame.GLOBAL_RELATIVE_ALT_INT}
)
# height above home, not above the sea
RELATIVE_FRAMES = frozenset({Frame.GLOBAL_RELATIVE_ALT, Frame.GLOBAL_RELATIVE_ALT_INT})


class Sensor(IntFlag):
    """MAV_SYS_STATUS_SENSOR, of those that clients look for."""

    GYRO = 1
    ACCEL = 2
    MAG = 4
    PRESSURE = 8
    GPS = 32
    MOTORS = 32768
    AHRS = 2097152
    BATTERY = 33554432
    PREARM = 268435456


class Capability(IntFlag):
    """MAV_PROTOCOL_CAPABILITY, of what works here."""

    MISSION_INT = 4
    COMMAND_INT = 8
    PARAM_ENCODE_C_CAST = 131072
    SET_ATTITUDE_TARGET = 64
    SET_POSITION_TARGET_LOCAL_NED = 128
    SET_POSITION_TARGET_GLOBAL_INT = 256
    FLIGHT_TERMINATION = 2048
    MAVLINK2 = 8192


class Autopilot(IntEnum):
    """MAV_AUTOPILOT: as what the vehicle presents itself."""

    GENERIC = 0
    PX4 = 12
