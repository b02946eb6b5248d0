"""What a ground station or script and the flight controller say to each other.

In the frames inside: Earth ENU, body FLU, SI. `ground_wire` turns these into MAVLink and back;
the numbers they speak of are in `ground_numbers`.
"""

from __future__ import annotations

from typing import NamedTuple

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Quat, Vec3
from fcu.mavlink.geodesy import Geodetic


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
    """SET_POSITION_TARGET_LOCAL_NED or SET_POSITION_TARGET_GLOBAL_INT.

    `setpoint` has the axes of its frame: ENU, or forward-left-up of the heading in the body
    frames. In it an ignored velocity, acceleration or yaw rate is zero (a fixed position has
    none), an ignored position or yaw NaN: the receiver decides what to hold.
    """

    source: Source
    target_system: int
    target_component: int
    time_boot_ms: int
    type_mask: int
    frame: int
    setpoint: Setpoint
    geodetic: Geodetic | None  # the position, in the global frames
    numbers: bytes  # the eleven fields as received: what the echo repeats
    refusal: str  # why it must not be flown; empty if it may

    def ignores(self, group: int) -> bool:
        """Whether a group, such as IGNORE_YAW, is out of use."""
        return self.type_mask & group == group


class AttitudeSetpointMessage(NamedTuple):
    """SET_ATTITUDE_TARGET."""

    source: Source
    target_system: int
    target_component: int
    time_boot_ms: int
    type_mask: int
    q_EB: Quat  # level where it is ignored or refused
    w_B: Vec3  # rad/s; as received, even where it is ignored
    thrust: float  # of full thrust, 0 to 1
    refusal: str


class ManualControl(NamedTuple):
    """MANUAL_CONTROL: sticks, NaN where there is none."""

    source: Source
    target_system: int
    x: float  # forward, -1 to 1
    y: float  # right, -1 to 1
    z: float  # thrust, 0 to 1
    r: float  # yaw, clockwise, -1 to 1


class NotTaken(NamedTuple):
    """A message that asks for what this vehicle does not do: its sender is told so."""

    source: Source
    target_system: int
    target_component: int  # 0: all, or the message has none
    name: str


class SetMode(NamedTuple):
    """SET_MODE, which COMMAND_LONG has replaced."""

    source: Source
    target_system: int
    base_mode: int
    custom_mode: int


class ParamRequestList(NamedTuple):
    """PARAM_REQUEST_LIST."""

    source: Source
    target_system: int
    target_component: int


class ParamRequestRead(NamedTuple):
    """PARAM_REQUEST_READ: by its number, or by name where that is -1."""

    source: Source
    target_system: int
    target_component: int
    name: str
    number: int


class ParamSet(NamedTuple):
    """PARAM_SET."""

    source: Source
    target_system: int
    target_component: int
    name: str
    value: float  # of a float32
    type: int  # MAV_PARAM_TYPE


class ParamValue(NamedTuple):
    """PARAM_VALUE."""

    source: Source
    name: str
    value: float
    type: int
    number: int
    total: int


class StreamRequest(NamedTuple):
    """REQUEST_DATA_STREAM, which SET_MESSAGE_INTERVAL has replaced."""

    source: Source
    target_system: int
    target_component: int
    stream: int
    rate_hz: int
    start: bool


class Ping(NamedTuple):
    """PING; a target of 0: a request."""

    source: Source
    target_system: int
    time_usec: int
    sequence: int


class TimeSync(NamedTuple):
    """TIMESYNC; tc1 0: a request."""

    source: Source
    tc1: int
    ts1: int


class MissionMessage(NamedTuple):
    """One of the mission protocol.

    `kind`: REQUEST_LIST, COUNT, CLEAR_ALL, REQUEST, ITEM, SET_CURRENT or ACK.
    """

    source: Source
    target_system: int
    target_component: int
    kind: str
    sequence: int  # of the item it is about, from 0
    total: int  # of items announced
    mission_type: int


class FileTransfer(NamedTuple):
    """FILE_TRANSFER_PROTOCOL."""

    source: Source
    target_system: int
    target_component: int
    payload: bytes  # 251


class LogRequestList(NamedTuple):
    """LOG_REQUEST_LIST."""

    source: Source
    target_system: int
    target_component: int


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


class GlobalPosition(NamedTuple):
    """GLOBAL_POSITION_INT."""

    source: Source
    time_boot_ms: int
    place: Geodetic
    above_home: float  # m
    v_E: Vec3  # m/s
    psi: float  # of the nose, rad; NaN: not known


class HomePosition(NamedTuple):
    """HOME_POSITION."""

    source: Source
    place: Geodetic
    r_E: Vec3  # m


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


ADDRESSED = (  # a message that names its receiver
    Command | CommandAck | SetpointMessage | AttitudeSetpointMessage | ManualControl | SetMode | NotTaken
    | ParamRequestList | ParamRequestRead | ParamSet | StreamRequest | Ping | MissionMessage
    | FileTransfer | LogRequestList
)  # fmt: skip

GroundMessage = (
    ADDRESSED | Heartbeat | ParamValue | TimeSync | PositionTarget | LocalPosition | GlobalPosition
    | HomePosition | Attitude | ExtendedState | StatusText
)  # fmt: skip
