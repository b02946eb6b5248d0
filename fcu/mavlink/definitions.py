"""Every message and number of MAVLink that is used here, from pymavlink's dialect.

A message that the dialect leaves out is declared; the numbers are the dialect's own, but for
those of the standard that are newer. Packing and unpacking are by `struct`, several times faster
than pymavlink's message objects. Numbers never raise: integers are saturated to their type,
floats to float32, and what is not a number becomes 0 in an integer field, so that a diverging
flight cannot crash its own telemetry. Nobody else imports the dialect.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Iterator
from enum import IntEnum, IntFlag
from typing import Any, NamedTuple

import pymavlink.dialects.v20.common as mavlink
from fastcrc.crc16 import mcrf4xx

FLOAT32_MAX = 3.4028234663852886e38

_TYPES = {  # of the XML: struct code, size
    "char": ("s", 1), "uint8_t": ("B", 1), "int8_t": ("b", 1), "uint8_t_mavlink_version": ("B", 1),
    "uint16_t": ("H", 2), "int16_t": ("h", 2), "uint32_t": ("I", 4), "int32_t": ("i", 4),
    "float": ("f", 4), "uint64_t": ("Q", 8), "int64_t": ("q", 8), "double": ("d", 8),
}  # fmt: skip


class Field(NamedTuple):
    """One field of a message, in the order of the wire."""

    name: str
    code: str  # of struct
    length: int  # of an array, or characters; 0: a single number


class Definition(NamedTuple):
    """A message: what its frame needs."""

    name: str
    id: int
    fields: tuple[Field, ...]
    layout: struct.Struct
    crc_extra: bytes
    size: int  # bytes of its payload before trailing zeros are trimmed
    core_size: int  # bytes of that without the extensions, which MAVLink 1 does not have

    def offset(self, name: str) -> int:
        """The byte of the payload at which a field begins. Raises ValueError if it has none."""
        before = [f.name for f in self.fields].index(name)
        codes = "".join(f"{f.length}{f.code}" if f.length else f.code for f in self.fields[:before])
        return struct.calcsize("<" + codes)

    def unpack(self, payload: bytes) -> dict[str, Any]:
        """Fields of a payload of full length; characters as bytes up to the first NUL."""
        numbers = self.layout.unpack(payload)
        out: dict[str, Any] = {}
        at = 0
        for name, code, count in self.fields:
            if code == "s":
                out[name] = numbers[at].split(b"\0", 1)[0]
                at += 1
            elif count:
                out[name] = numbers[at : at + count]
                at += count
            else:
                out[name] = numbers[at]
                at += 1
        return out


def _codes(fields: list[Field]) -> str:
    return "<" + "".join(f"{f.length}{f.code}" if f.length else f.code for f in fields)


def _definition(
    name: str, number: int, fields: list[Field], crc_extra: int, core: int
) -> Definition:
    """`core`: how many of the fields are no extensions."""
    layout, core_size = struct.Struct(_codes(fields)), struct.calcsize(_codes(fields[:core]))
    return Definition(
        name, number, tuple(fields), layout, bytes([crc_extra]), layout.size, core_size
    )


def _crc_extra(name: str, fields: Iterable[tuple[str, str, int]]) -> Iterator[int]:
    """CRC_EXTRA of a message that ends after each of its fields: type, name and length of each."""
    crc = mcrf4xx(f"{name} ".encode())
    for base, field, count in fields:
        crc = mcrf4xx(f"{base} {field} ".encode() + (bytes([count]) if count else b""), crc)
        yield (crc & 0xFF) ^ (crc >> 8)


def of(message: Any) -> Definition:
    """The definition of one of pymavlink's message classes."""
    fields = []
    lengths = dict(zip(message.ordered_fieldnames, message.array_lengths, strict=True))
    types = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    for name in message.ordered_fieldnames:
        fields.append(Field(name, _TYPES[types[name]][0], lengths[name]))
    spelled = [(_spelled(types[f.name]), f.name, f.length) for f in fields]
    # The dialect does not say which fields are extensions. CRC_EXTRA is of the others.
    ends = [
        n
        for n, crc in enumerate(_crc_extra(message.msgname, spelled), 1)
        if crc == message.crc_extra
    ]
    return _definition(message.msgname, message.id, fields, message.crc_extra, ends[-1])


def _spelled(type_: str) -> str:
    """A type as CRC_EXTRA counts it."""
    return "uint8_t" if type_ == "uint8_t_mavlink_version" else type_


def declared(
    name: str, number: int, *declaration: str, extensions: tuple[str, ...] = ()
) -> Definition:
    """A definition from the fields of its XML, such as "uint16_t counter" or "float[4] voltage".

    The order on the wire and CRC_EXTRA follow from them, as MAVLink's serialization guide says.
    """

    def parsed(text: str) -> tuple[str, str, int]:
        type_, field = text.split()
        base, _, count = type_.rstrip("]").partition("[")
        return base, field, int(count or 0)

    core = sorted(map(parsed, declaration), key=lambda f: -_TYPES[f[0]][1])
    *_, crc_extra = _crc_extra(name, core)
    fields = [Field(f, _TYPES[b][0], n) for b, f, n in (*core, *map(parsed, extensions))]
    return _definition(name, number, fields, crc_extra, len(core))


_RANGES = {
    "B": (0, 2**8 - 1), "b": (-(2**7), 2**7 - 1), "H": (0, 2**16 - 1), "h": (-(2**15), 2**15 - 1),
    "I": (0, 2**32 - 1), "i": (-(2**31), 2**31 - 1), "Q": (0, 2**64 - 1), "q": (-(2**63), 2**63 - 1),
}  # fmt: skip


def _float(x: float) -> float:
    return x if -FLOAT32_MAX <= x <= FLOAT32_MAX or x != x else math.copysign(FLOAT32_MAX, x)


def _number(code: str, x: float) -> float:
    if code == "f":
        return _float(x)
    if code == "d":
        return x
    low, high = _RANGES[code]
    if x != x:
        return 0
    return high if x >= high else low if x <= low else round(x)


class Packed(NamedTuple):
    """A message without its frame: the same for every link."""

    definition: Definition
    payload: bytes  # of full length


def packed(definition: Definition, /, **values: Any) -> Packed:
    """A message of these fields; what is left out is 0. Raises KeyError for a name it has not."""
    row: list[Any] = []
    for name, code, count in definition.fields:
        value = values.pop(name, 0 if not count else b"" if code == "s" else ())
        if code == "s":
            row.append(bytes(value))
        elif count:
            given = [_number(code, x) for x in value][:count]
            row += given + [0] * (count - len(given))
        else:
            row.append(_number(code, value))
    if values:
        raise KeyError(f"{definition.name} has no {', '.join(values)}")
    return Packed(definition, definition.layout.pack(*row))


# --- messages

DEFINITIONS: dict[int, Definition] = {n: of(m) for n, m in mavlink.mavlink_map.items()}
_NAMED = {definition.name: definition for definition in DEFINITIONS.values()}
# Messages of the standard that the dialect leaves out, or did until lately; TIMESYNC and
# SERIAL_CONTROL and those of plans, whose newer fields it leaves out; and ArduPilot's WIND.
for _each in (
    declared(
        "TIMESYNC", 111, "int64_t tc1", "int64_t ts1",
        extensions=("uint8_t target_system", "uint8_t target_component"),
    ),
    declared(
        "MISSION_CURRENT", 42, "uint16_t seq",
        extensions=(
            "uint16_t total", "uint8_t mission_state", "uint8_t mission_mode",
            "uint32_t mission_id", "uint32_t fence_id", "uint32_t rally_points_id",
        ),
    ),
    declared(
        "MISSION_COUNT", 44, "uint8_t target_system", "uint8_t target_component", "uint16_t count",
        extensions=("uint8_t mission_type", "uint32_t opaque_id"),
    ),
    declared(
        "MISSION_ACK", 47, "uint8_t target_system", "uint8_t target_component", "uint8_t type",
        extensions=("uint8_t mission_type", "uint32_t opaque_id"),
    ),
    declared("WIND", 168, "float direction", "float speed", "float speed_z"),
    declared(
        "ESC_INFO", 290, "uint8_t index", "uint64_t time_usec", "uint16_t counter", "uint8_t count",
        "uint8_t connection_type", "uint8_t info", "uint16_t[4] failure_flags",
        "uint32_t[4] error_count", "int16_t[4] temperature",
    ),
    declared(
        "ESC_STATUS", 291, "uint8_t index", "uint64_t time_usec", "int32_t[4] rpm",
        "float[4] voltage", "float[4] current",
    ),
    declared(
        "PROTOCOL_VERSION", 300, "uint16_t version", "uint16_t min_version",
        "uint16_t max_version", "uint8_t[8] spec_version_hash", "uint8_t[8] library_version_hash",
    ),
    declared(
        "SERIAL_CONTROL", 126, "uint8_t device", "uint8_t flags", "uint16_t timeout",
        "uint32_t baudrate", "uint8_t count", "uint8_t[70] data",
        extensions=("uint8_t target_system", "uint8_t target_component"),
    ),
    declared(
        "PARAM_ERROR", 345, "uint8_t target_system", "uint8_t target_component",
        "char[16] param_id", "int16_t param_index", "uint8_t error",
    ),
    declared(
        "AVAILABLE_MODES", 435, "uint8_t number_modes", "uint8_t mode_index",
        "uint8_t standard_mode", "uint32_t custom_mode", "uint32_t properties", "char[35] mode_name",
    ),
    declared(
        "CURRENT_MODE", 436, "uint8_t standard_mode", "uint32_t custom_mode",
        "uint32_t intended_custom_mode",
    ),
    declared("AVAILABLE_MODES_MONITOR", 437, "uint8_t seq"),
):  # fmt: skip
    DEFINITIONS[_each.id] = _NAMED[_each.name] = _each


def command_name(number: int) -> str:
    """What a MAV_CMD is called, without its prefix."""
    entry = mavlink.enums["MAV_CMD"].get(number)
    return entry.name.removeprefix("MAV_CMD_") if entry else f"Command {number}"


def definition(name: str) -> Definition:
    """A message by its name in the dialect. Raises KeyError."""
    return _NAMED[name]


def message(name: str, /, **fields: object) -> Packed:
    """A message by its name in the dialect; fields that are left out are 0."""
    return packed(_NAMED[name], **fields)


# --- numbers


class CommandId(IntEnum):
    """The MAV_CMD numbers that are understood here."""

    LOITER = mavlink.MAV_CMD_NAV_LOITER_UNLIM
    RETURN = mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH
    LAND = mavlink.MAV_CMD_NAV_LAND
    TAKEOFF = mavlink.MAV_CMD_NAV_TAKEOFF
    SET_MODE = mavlink.MAV_CMD_DO_SET_MODE
    CHANGE_SPEED = mavlink.MAV_CMD_DO_CHANGE_SPEED
    SET_HOME = mavlink.MAV_CMD_DO_SET_HOME
    FLIGHT_TERMINATION = mavlink.MAV_CMD_DO_FLIGHTTERMINATION
    REPOSITION = mavlink.MAV_CMD_DO_REPOSITION
    ORBIT = mavlink.MAV_CMD_DO_ORBIT
    MISSION_START = mavlink.MAV_CMD_MISSION_START
    SET_MISSION_CURRENT = 224  # newer than some releases of the dialect
    LAND_START = mavlink.MAV_CMD_DO_LAND_START
    PAUSE_CONTINUE = mavlink.MAV_CMD_DO_PAUSE_CONTINUE
    PREFLIGHT_STORAGE = mavlink.MAV_CMD_PREFLIGHT_STORAGE
    REBOOT = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
    SET_STANDARD_MODE = 262  # newer than some releases of the dialect
    ARM_DISARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    INJECT_FAILURE = 420  # newer than some releases of the dialect
    RUN_PREARM_CHECKS = mavlink.MAV_CMD_RUN_PREARM_CHECKS
    GET_HOME_POSITION = mavlink.MAV_CMD_GET_HOME_POSITION
    GET_MESSAGE_INTERVAL = mavlink.MAV_CMD_GET_MESSAGE_INTERVAL
    SET_MESSAGE_INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    REQUEST_MESSAGE = mavlink.MAV_CMD_REQUEST_MESSAGE
    REQUEST_PROTOCOL_VERSION = mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION
    REQUEST_CAPABILITIES = mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES


class Frame(IntEnum):
    """MAV_FRAME, of those that setpoints and commands come in."""

    GLOBAL = mavlink.MAV_FRAME_GLOBAL
    LOCAL_NED = mavlink.MAV_FRAME_LOCAL_NED
    GLOBAL_RELATIVE_ALT = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    GLOBAL_INT = mavlink.MAV_FRAME_GLOBAL_INT
    GLOBAL_RELATIVE_ALT_INT = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    LOCAL_OFFSET_NED = mavlink.MAV_FRAME_LOCAL_OFFSET_NED
    BODY_NED = mavlink.MAV_FRAME_BODY_NED
    BODY_OFFSET_NED = mavlink.MAV_FRAME_BODY_OFFSET_NED
    GLOBAL_TERRAIN_ALT = mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT
    GLOBAL_TERRAIN_ALT_INT = mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT
    BODY_FRD = mavlink.MAV_FRAME_BODY_FRD


# velocity and acceleration along the heading, not along North
BODY_FRAMES = frozenset({Frame.BODY_NED, Frame.BODY_OFFSET_NED, Frame.BODY_FRD})
# position and yaw from where the vehicle is; along the heading too
OFFSET_FRAMES = frozenset({Frame.BODY_OFFSET_NED, Frame.BODY_FRD})
GLOBAL_FRAMES = frozenset(
    {
        Frame.GLOBAL,
        Frame.GLOBAL_RELATIVE_ALT,
        Frame.GLOBAL_TERRAIN_ALT,
        Frame.GLOBAL_INT,
        Frame.GLOBAL_RELATIVE_ALT_INT,
        Frame.GLOBAL_TERRAIN_ALT_INT,
    }
)
MISSION_FRAME: int = mavlink.MAV_FRAME_MISSION  # of items of a plan without a place
# height above home, not above the sea; terrain is taken to be flat, at the height of home
RELATIVE_FRAMES = GLOBAL_FRAMES - {Frame.GLOBAL, Frame.GLOBAL_INT}


# Setpoint type masks: each bit takes a field out of use, except FORCE.
IGNORE_POSITION: int = (
    mavlink.POSITION_TARGET_TYPEMASK_X_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Z_IGNORE
)
IGNORE_VELOCITY: int = (
    mavlink.POSITION_TARGET_TYPEMASK_VX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_VY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_VZ_IGNORE
)
IGNORE_ACCELERATION: int = (
    mavlink.POSITION_TARGET_TYPEMASK_AX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AZ_IGNORE
)
FORCE: int = mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET  # the acceleration fields are a force
IGNORE_YAW: int = mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
IGNORE_YAW_RATE: int = mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE

# Attitude type masks
IGNORE_ROLL_RATE: int = mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
IGNORE_PITCH_RATE: int = mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
IGNORE_SPIN_RATE: int = mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
THRUST_BODY = 32  # thrust is a vector; newer than the dialect
IGNORE_THRUST: int = mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE
IGNORE_ATTITUDE: int = mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE


class Result(IntEnum):
    """MAV_RESULT: what became of a command."""

    ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
    TEMPORARILY_REJECTED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    DENIED = mavlink.MAV_RESULT_DENIED
    UNSUPPORTED = mavlink.MAV_RESULT_UNSUPPORTED
    FAILED = mavlink.MAV_RESULT_FAILED
    IN_PROGRESS = mavlink.MAV_RESULT_IN_PROGRESS
    CANCELLED = 6  # newer than the dialect
    COMMAND_LONG_ONLY = mavlink.MAV_RESULT_COMMAND_LONG_ONLY
    COMMAND_INT_ONLY = mavlink.MAV_RESULT_COMMAND_INT_ONLY
    UNSUPPORTED_MAV_FRAME = 9  # newer than the dialect


class SystemStatus(IntEnum):
    """MAV_STATE."""

    UNINITIALISED = mavlink.MAV_STATE_UNINIT
    BOOT = mavlink.MAV_STATE_BOOT
    CALIBRATING = mavlink.MAV_STATE_CALIBRATING
    STANDBY = mavlink.MAV_STATE_STANDBY
    ACTIVE = mavlink.MAV_STATE_ACTIVE
    CRITICAL = mavlink.MAV_STATE_CRITICAL
    EMERGENCY = mavlink.MAV_STATE_EMERGENCY
    FLIGHT_TERMINATION = mavlink.MAV_STATE_FLIGHT_TERMINATION


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    UNDEFINED = mavlink.MAV_LANDED_STATE_UNDEFINED
    ON_GROUND = mavlink.MAV_LANDED_STATE_ON_GROUND
    IN_AIR = mavlink.MAV_LANDED_STATE_IN_AIR
    TAKING_OFF = mavlink.MAV_LANDED_STATE_TAKEOFF
    LANDING = mavlink.MAV_LANDED_STATE_LANDING


class Severity(IntEnum):
    """MAV_SEVERITY, as syslog's."""

    EMERGENCY = mavlink.MAV_SEVERITY_EMERGENCY
    ALERT = mavlink.MAV_SEVERITY_ALERT
    CRITICAL = mavlink.MAV_SEVERITY_CRITICAL
    ERROR = mavlink.MAV_SEVERITY_ERROR
    WARNING = mavlink.MAV_SEVERITY_WARNING
    NOTICE = mavlink.MAV_SEVERITY_NOTICE
    INFO = mavlink.MAV_SEVERITY_INFO
    DEBUG = mavlink.MAV_SEVERITY_DEBUG


class Sensor(IntFlag):
    """MAV_SYS_STATUS_SENSOR, of those that clients look for."""

    GYRO = mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    ACCEL = mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    MAG = mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    PRESSURE = mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    GPS = mavlink.MAV_SYS_STATUS_SENSOR_GPS
    MOTORS = mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    AHRS = mavlink.MAV_SYS_STATUS_AHRS
    BATTERY = mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
    PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK
    GEOFENCE = mavlink.MAV_SYS_STATUS_GEOFENCE


class Capability(IntFlag):
    """MAV_PROTOCOL_CAPABILITY, of what works here."""

    MISSION_INT = mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    COMMAND_INT = mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    PARAM_ENCODE_BYTEWISE = 16  # newer than some releases of the dialect
    SET_ATTITUDE_TARGET = mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    SET_POSITION_TARGET_LOCAL_NED = mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    SET_POSITION_TARGET_GLOBAL_INT = mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    FLIGHT_TERMINATION = mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    MAVLINK2 = mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    MISSION_FENCE = mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    MISSION_RALLY = mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY


class Autopilot(IntEnum):
    """MAV_AUTOPILOT: as what the vehicle presents itself."""

    GENERIC = mavlink.MAV_AUTOPILOT_GENERIC
    PX4 = mavlink.MAV_AUTOPILOT_PX4


class ModeFlag(IntFlag):
    """MAV_MODE_FLAG, of HEARTBEAT.base_mode."""

    CUSTOM = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    MANUAL_INPUT = mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    AUTO = mavlink.MAV_MODE_FLAG_AUTO_ENABLED
    GUIDED = mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
    STABILIZE = mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED


class Estimated(IntFlag):
    """ESTIMATOR_STATUS_FLAGS: what of the state is known."""

    ATTITUDE = mavlink.ESTIMATOR_ATTITUDE
    VELOCITY_ACROSS = mavlink.ESTIMATOR_VELOCITY_HORIZ
    VELOCITY_UP = mavlink.ESTIMATOR_VELOCITY_VERT
    POSITION_RELATIVE = mavlink.ESTIMATOR_POS_HORIZ_REL
    POSITION = mavlink.ESTIMATOR_POS_HORIZ_ABS
    HEIGHT = mavlink.ESTIMATOR_POS_VERT_ABS
    PREDICTS_RELATIVE = mavlink.ESTIMATOR_PRED_POS_HORIZ_REL
    PREDICTS_POSITION = mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
    POSITION_JUMPS = mavlink.ESTIMATOR_GPS_GLITCH


class MissionResult(IntEnum):
    """MAV_MISSION_RESULT."""

    ACCEPTED = mavlink.MAV_MISSION_ACCEPTED
    ERROR = mavlink.MAV_MISSION_ERROR
    UNSUPPORTED_FRAME = mavlink.MAV_MISSION_UNSUPPORTED_FRAME
    UNSUPPORTED = mavlink.MAV_MISSION_UNSUPPORTED
    NO_SPACE = mavlink.MAV_MISSION_NO_SPACE
    INVALID = mavlink.MAV_MISSION_INVALID
    INVALID_PARAM1 = mavlink.MAV_MISSION_INVALID_PARAM1
    INVALID_PARAM2 = mavlink.MAV_MISSION_INVALID_PARAM2
    INVALID_PARAM3 = mavlink.MAV_MISSION_INVALID_PARAM3
    INVALID_PARAM4 = mavlink.MAV_MISSION_INVALID_PARAM4
    INVALID_PARAM5 = mavlink.MAV_MISSION_INVALID_PARAM5_X
    INVALID_PARAM6 = mavlink.MAV_MISSION_INVALID_PARAM6_Y
    INVALID_PARAM7 = mavlink.MAV_MISSION_INVALID_PARAM7
    INVALID_SEQUENCE = mavlink.MAV_MISSION_INVALID_SEQUENCE
    DENIED = mavlink.MAV_MISSION_DENIED
    CANCELLED = mavlink.MAV_MISSION_OPERATION_CANCELLED


class MissionType(IntEnum):
    """MAV_MISSION_TYPE."""

    MISSION = mavlink.MAV_MISSION_TYPE_MISSION
    FENCE = mavlink.MAV_MISSION_TYPE_FENCE
    RALLY = mavlink.MAV_MISSION_TYPE_RALLY
    ALL = mavlink.MAV_MISSION_TYPE_ALL


class MissionState(IntEnum):
    """MISSION_STATE, newer than some releases of the dialect."""

    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


class ItemCommand(IntEnum):
    """MAV_CMD of the items of plans, fences and rally points that are understood here."""

    WAYPOINT = mavlink.MAV_CMD_NAV_WAYPOINT
    LOITER_UNLIM = mavlink.MAV_CMD_NAV_LOITER_UNLIM
    LOITER_TURNS = mavlink.MAV_CMD_NAV_LOITER_TURNS
    LOITER_TIME = mavlink.MAV_CMD_NAV_LOITER_TIME
    RETURN = mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH
    LAND = mavlink.MAV_CMD_NAV_LAND
    TAKEOFF = mavlink.MAV_CMD_NAV_TAKEOFF
    LOITER_TO_ALT = mavlink.MAV_CMD_NAV_LOITER_TO_ALT
    DELAY = mavlink.MAV_CMD_NAV_DELAY
    CONDITION_DELAY = mavlink.MAV_CMD_CONDITION_DELAY
    CONDITION_DISTANCE = mavlink.MAV_CMD_CONDITION_DISTANCE
    CONDITION_YAW = mavlink.MAV_CMD_CONDITION_YAW
    JUMP = mavlink.MAV_CMD_DO_JUMP
    CHANGE_SPEED = mavlink.MAV_CMD_DO_CHANGE_SPEED
    SET_HOME = mavlink.MAV_CMD_DO_SET_HOME
    LAND_START = mavlink.MAV_CMD_DO_LAND_START
    ROI_LOCATION = mavlink.MAV_CMD_DO_SET_ROI_LOCATION
    ROI_NONE = mavlink.MAV_CMD_DO_SET_ROI_NONE
    ROI = mavlink.MAV_CMD_DO_SET_ROI
    FENCE_POLYGON_IN = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    FENCE_POLYGON_OUT = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
    FENCE_CIRCLE_IN = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
    FENCE_CIRCLE_OUT = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
    FENCE_RETURN_POINT = mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT
    RALLY_POINT = mavlink.MAV_CMD_NAV_RALLY_POINT


# Items of cameras, gimbals, servos and the like: taken, kept and passed over.
PASSED_OVER = frozenset(
    getattr(mavlink, f"MAV_CMD_{name}", fallback)
    for name, fallback in {
        "DO_SET_SERVO": 183, "DO_REPEAT_SERVO": 184, "DO_SET_RELAY": 181, "DO_REPEAT_RELAY": 182,
        "DO_CONTROL_VIDEO": 200, "DO_DIGICAM_CONFIGURE": 202, "DO_DIGICAM_CONTROL": 203,
        "DO_MOUNT_CONFIGURE": 204, "DO_MOUNT_CONTROL": 205, "DO_SET_CAM_TRIGG_DIST": 206,
        "DO_SET_CAM_TRIGG_INTERVAL": 214, "DO_SET_ACTUATOR": 187, "DO_GRIPPER": 211,
        "DO_WINCH": 42600, "DO_TRIGGER_CONTROL": 2003, "DO_GIMBAL_MANAGER_PITCHYAW": 1000,
        "DO_GIMBAL_MANAGER_CONFIGURE": 1001, "DO_SET_ROI_WPNEXT_OFFSET": 196,
        "IMAGE_START_CAPTURE": 2000, "IMAGE_STOP_CAPTURE": 2001, "VIDEO_START_CAPTURE": 2500,
        "VIDEO_STOP_CAPTURE": 2501, "SET_CAMERA_MODE": 530, "SET_CAMERA_ZOOM": 531,
        "SET_CAMERA_FOCUS": 532, "SET_CAMERA_SOURCE": 534, "OBLIQUE_SURVEY": 260,
    }.items()
)  # fmt: skip


class ParameterError(IntEnum):
    """MAV_PARAM_ERROR; newer than some releases of the dialect."""

    DOES_NOT_EXIST = 1
    VALUE_OUT_OF_RANGE = 2
    PERMISSION_DENIED = 3
    READ_ONLY = 5
    TYPE_MISMATCH = 7


GCS: int = mavlink.MAV_TYPE_GCS
NO_AUTOPILOT: int = mavlink.MAV_AUTOPILOT_INVALID
AUTOPILOT: int = mavlink.MAV_COMP_ID_AUTOPILOT1
FENCE_MITIGATE_NONE: int = mavlink.FENCE_MITIGATE_NONE
INT32: int = mavlink.MAV_PARAM_TYPE_INT32
REAL32: int = mavlink.MAV_PARAM_TYPE_REAL32
# newer than some releases of the dialect
LOCKSTEP = 1  # HIL_ACTUATOR_CONTROLS.flags
AUTO_MODE = 4  # MAV_MODE_PROPERTY
SERIAL_REPLY: int = mavlink.SERIAL_CONTROL_FLAG_REPLY
SERIAL_RESPOND: int = mavlink.SERIAL_CONTROL_FLAG_RESPOND
EXT_UNSUPPORTED: int = mavlink.PARAM_ACK_VALUE_UNSUPPORTED
