"""What a ground station or script and the flight controller say to each other.

In the frames inside: Earth ENU, body FLU, SI. The numbers of the enumerations are MAVLink's
and, for modes, PX4's. `ground_wire` turns these into MAVLink and back.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Quat, Vec3

LOCAL_NED = 1  # the only coordinate frame in which a position setpoint is accepted

# Setpoint type masks: each bit takes a field out of use, except FORCE.
IGNORE_POSITION = 1 | 2 | 4
IGNORE_VELOCITY = 8 | 16 | 32
IGNORE_ACCELERATION = 64 | 128 | 256
FORCE = 512  # the acceleration fields are a force
IGNORE_YAW = 1024
IGNORE_YAW_RATE = 2048


class CommandId(IntEnum):
    """The MAV_CMD numbers that are understood here."""

    LAND = 21
    TAKEOFF = 22
    SET_MODE = 176
    ARM_DISARM = 400
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512


class Result(IntEnum):
    """MAV_RESULT: what became of a command."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5


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


class Source(NamedTuple):
    """Who sent a message."""

    system: int
    component: int


class Heartbeat(NamedTuple):
    """A system is alive. The modes mean something when it is an autopilot of PX4's kind."""

    source: Source
    type: int
    autopilot: int
    armed: bool
    main_mode: int
    sub_mode: int
    status: int


class Command(NamedTuple):
    """COMMAND_LONG or COMMAND_INT."""

    source: Source
    target_system: int  # 0: everyone
    target_component: int
    command: int  # a CommandId, or one not known here
    params: tuple[float, ...]  # seven; NaN: default. Positions in degrees (global) or m, as sent
    frame: int | None  # coordinate frame of params 5 to 7; None in COMMAND_LONG
    confirmation: int  # counts repeats; 0 in COMMAND_INT


class CommandAck(NamedTuple):
    """What became of a command."""

    source: Source
    target_system: int
    target_component: int
    command: int
    result: int
    progress: int  # percent; 255: unknown


class SetpointMessage(NamedTuple):
    """SET_POSITION_TARGET_LOCAL_NED.

    In `setpoint` an ignored velocity, acceleration or yaw rate is zero (a fixed position
    has none), an ignored position or yaw NaN: the receiver decides what to hold.
    """

    source: Source
    target_system: int
    target_component: int
    time_boot_ms: int
    type_mask: int
    frame: int
    setpoint: Setpoint
    numbers: bytes  # the eleven float32 fields as received: what the echo repeats
    refusal: str  # why it must not be flown; empty if it may

    def ignores(self, group: int) -> bool:
        """Whether a group, such as IGNORE_YAW, is out of use."""
        return self.type_mask & group == group


class PositionTarget(NamedTuple):
    """POSITION_TARGET_LOCAL_NED: the setpoint the controller has accepted."""

    source: Source
    time_boot_ms: int
    type_mask: int
    frame: int
    setpoint: Setpoint  # ignored fields as in SetpointMessage
    numbers: bytes  # equal to those of the setpoint sent, to the bit


class LocalPosition(NamedTuple):
    """LOCAL_POSITION_NED."""

    source: Source
    time_boot_ms: int
    r_E: Vec3  # m
    v_E: Vec3  # m/s


class Attitude(NamedTuple):
    """ATTITUDE_QUATERNION."""

    source: Source
    time_boot_ms: int
    q_EB: Quat
    w_B: Vec3  # rad/s


class ExtendedState(NamedTuple):
    """EXTENDED_SYS_STATE."""

    source: Source
    landed_state: int


class StatusText(NamedTuple):
    """STATUSTEXT: one chunk of a text."""

    source: Source
    severity: int
    text: str
    id: int  # the same in all chunks of a text; 0: this is the whole text
    chunk: int


GroundMessage = (
    Heartbeat
    | Command
    | CommandAck
    | SetpointMessage
    | PositionTarget
    | LocalPosition
    | Attitude
    | ExtendedState
    | StatusText
)
