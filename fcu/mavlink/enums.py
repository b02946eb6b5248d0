"""MAVLink's numbers: commands, results, frames, masks, modes (PX4's), sensors, capabilities."""

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


# Setpoint type masks: each bit takes a field out of use, except FORCE.
IGNORE_POSITION = 1 | 2 | 4
IGNORE_VELOCITY = 8 | 16 | 32
IGNORE_ACCELERATION = 64 | 128 | 256
FORCE = 512  # the acceleration fields are a force
IGNORE_YAW = 1024
IGNORE_YAW_RATE = 2048

# Attitude type masks
IGNORE_ROLL_RATE, IGNORE_PITCH_RATE, IGNORE_SPIN_RATE = 1, 2, 4
THRUST_BODY = 32  # thrust is a vector
IGNORE_THRUST = 64
IGNORE_ATTITUDE = 128


class Result(IntEnum):
    """MAV_RESULT: what became of a command."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6
    COMMAND_LONG_ONLY = 7
    COMMAND_INT_ONLY = 8
    UNSUPPORTED_MAV_FRAME = 9


class MainMode(IntEnum):
    """PX4's main flight modes."""

    MANUAL = 1
    ALTITUDE = 2
    POSITION = 3
    AUTO = 4
    ACRO = 5
    OFFBOARD = 6
    STABILIZED = 7


class AutoMode(IntEnum):
    """PX4's sub modes of MainMode.AUTO; 0 with any other."""

    NONE = 0
    READY = 1
    TAKEOFF = 2
    LOITER = 3
    MISSION = 4
    RETURN = 5
    LAND = 6
    FOLLOW = 8
    PRECISION_LAND = 9
    VTOL_TAKEOFF = 10


class SystemStatus(IntEnum):
    """MAV_STATE."""

    UNINITIALISED = 0
    BOOT = 1
    CALIBRATING = 2
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5
    EMERGENCY = 6


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKING_OFF = 3
    LANDING = 4


class Severity(IntEnum):
    """MAV_SEVERITY, as syslog's."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6
    DEBUG = 7


class Sensor(IntFlag):
    """MAV_SYS_STATUS_SENSOR, of those that clients look for."""

    GYRO = 1
    ACCEL = 2
    MAG = 4
    PRESSURE = 8
    GPS = 32
    MOTORS = 32768
    GEOFENCE = 1048576
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
