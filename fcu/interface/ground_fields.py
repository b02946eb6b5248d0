"""The fields of the ground link's messages, to and from values in the frames inside.

`ground_wire` frames and checks messages; here their fields change frame and are saturated
to what their type holds. Readers take pymavlink's message objects.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

from fcu.interface.frames import (
    SetpointOnWire,
    attitude_enu_ned,
    enu_ned,
    flu_frd,
    setpoint_from_wire,
    setpoint_to_wire,
    single3,
    single4,
)
from fcu.interface.ground_messages import (
    FORCE,
    IGNORE_ACCELERATION,
    IGNORE_POSITION,
    IGNORE_VELOCITY,
    IGNORE_YAW,
    IGNORE_YAW_RATE,
    LOCAL_NED,
    Attitude,
    Command,
    CommandAck,
    ExtendedState,
    GroundMessage,
    Heartbeat,
    LocalPosition,
    PositionTarget,
    SetpointMessage,
    Source,
    StatusText,
)
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Quat, Vec3
from fcu.kernel.rotations import normalised

_NUMBERS = struct.Struct("<11f")
_GROUPS = {  # of a setpoint: which of the eleven fields each bit group takes out of use
    "position": (IGNORE_POSITION, slice(0, 3)),
    "velocity": (IGNORE_VELOCITY, slice(3, 6)),
    "acceleration": (IGNORE_ACCELERATION, slice(6, 9)),
    "yaw": (IGNORE_YAW, slice(9, 10)),
    "yaw rate": (IGNORE_YAW_RATE, slice(10, 11)),
}
_KNOWN_BITS = 0xFFF
_ARMED = 128  # HEARTBEAT.base_mode
_GLOBAL_FRAMES = (0, 3, 5, 6, 10, 11)  # COMMAND_INT counts 1e-7 deg in these, else 1e-4 m
_UNSET = 2**31 - 1  # COMMAND_INT's way of saying NaN


def whole(x: float, greatest: int) -> int:
    """`x` rounded to an integer field of 0 to `greatest`, saturated; NaN becomes 0."""
    return greatest if x >= greatest else round(max(0.0, x))  # max(0.0, NaN) is 0.0


def milliseconds(time_s: float) -> int:
    """A time in s as the uint32 of time_boot_ms."""
    return whole(1e3 * time_s, 2**32 - 1)


def _floats(v: Vec3) -> Vec3:
    # Exactly float, or the kernels are compiled anew for another type, in flight.
    return Vec3(float(v.x), float(v.y), float(v.z))


def earth_fields(v_E: Vec3) -> Vec3:
    """float32 NED fields of a vector in ENU."""
    fields: Vec3 = single3(enu_ned(_floats(v_E)))
    return fields


def body_fields(v_B: Vec3) -> Vec3:
    """float32 FRD fields of a vector in FLU."""
    fields: Vec3 = single3(flu_frd(_floats(v_B)))
    return fields


def attitude_fields(q_EB: Quat) -> Quat:
    """float32 NED/FRD fields of an attitude, w >= 0."""
    q = Quat(float(q_EB.w), float(q_EB.x), float(q_EB.y), float(q_EB.z))
    fields: Quat = single4(attitude_enu_ned(q))
    return fields


def setpoint_numbers(setpoint: Setpoint) -> bytes:
    """The eleven float32 fields that a setpoint becomes on the wire, as sent and echoed."""
    r, v, a, yaw, yaw_rate = setpoint_to_wire(
        Setpoint(
            _floats(setpoint.r_c),
            _floats(setpoint.v_c),
            _floats(setpoint.a_c),
            float(setpoint.psi_c),
            float(setpoint.psi_dot_c),
        )
    )
    return _NUMBERS.pack(*r, *v, *a, yaw, yaw_rate)


def setpoint_of(numbers: bytes, type_mask: int) -> Setpoint:
    """The setpoint in such fields; what the mask ignores is as SetpointMessage says."""
    f = _NUMBERS.unpack(numbers)
    setpoint: Setpoint = setpoint_from_wire(
        SetpointOnWire(Vec3(*f[0:3]), Vec3(*f[3:6]), Vec3(*f[6:9]), f[9], f[10])
    )
    nowhere, still = Vec3(math.nan, math.nan, math.nan), Vec3(0.0, 0.0, 0.0)
    return Setpoint(
        nowhere if type_mask & IGNORE_POSITION else setpoint.r_c,
        still if type_mask & IGNORE_VELOCITY else setpoint.v_c,
        still if type_mask & IGNORE_ACCELERATION else setpoint.a_c,
        math.nan if type_mask & IGNORE_YAW else setpoint.psi_c,
        0.0 if type_mask & IGNORE_YAW_RATE else setpoint.psi_dot_c,
    )


def refusal(numbers: bytes, type_mask: int, frame: int) -> str:
    """Why a received setpoint must not be flown; empty if it may."""
    if frame != LOCAL_NED:
        return f"setpoint frame {frame} is not supported, only LOCAL_NED"
    if type_mask & FORCE:
        return "force setpoints are not supported"
    if type_mask & ~_KNOWN_BITS:
        return f"setpoint type mask {type_mask:#x} has unknown bits"
    fields = _NUMBERS.unpack(numbers)
    for name, (bits, where) in _GROUPS.items():
        if type_mask & bits not in (0, bits):
            return f"setpoint ignores a part of its {name}"
        if not type_mask & bits and not all(map(math.isfinite, fields[where])):
            return f"setpoint {name} is not finite"
    return ""


def _target_numbers(m: Any) -> bytes:
    return _NUMBERS.pack(
        m.x, m.y, m.z, m.vx, m.vy, m.vz, m.afx, m.afy, m.afz, m.yaw, m.yaw_rate
    )  # fmt: skip


def _heartbeat(m: Any, source: Source) -> Heartbeat:
    main, sub = m.custom_mode >> 16 & 0xFF, m.custom_mode >> 24 & 0xFF
    armed = m.base_mode & _ARMED != 0
    return Heartbeat(source, m.type, m.autopilot, armed, main, sub, m.system_status)


def _command_long(m: Any, source: Source) -> Command:
    params = (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
    return Command(
        source, m.target_system, m.target_component, m.command, params, None, m.confirmation
    )


def _command_int(m: Any, source: Source) -> Command:
    scale = 1e7 if m.frame in _GLOBAL_FRAMES else 1e4
    x, y = (math.nan if n == _UNSET else n / scale for n in (m.x, m.y))
    params = (m.param1, m.param2, m.param3, m.param4, x, y, m.z)
    return Command(source, m.target_system, m.target_component, m.command, params, m.frame, 0)


def _command_ack(m: Any, source: Source) -> CommandAck:
    return CommandAck(
        source, m.target_system, m.target_component, m.command, m.result, m.progress
    )  # fmt: skip


def _set_position_target(m: Any, source: Source) -> SetpointMessage:
    numbers, mask, frame = _target_numbers(m), m.type_mask, m.coordinate_frame
    return SetpointMessage(
        source, m.target_system, m.target_component, m.time_boot_ms, mask, frame,
        setpoint_of(numbers, mask), numbers, refusal(numbers, mask, frame),
    )  # fmt: skip


def _position_target(m: Any, source: Source) -> PositionTarget:
    numbers, mask = _target_numbers(m), m.type_mask
    setpoint = setpoint_of(numbers, mask)
    return PositionTarget(source, m.time_boot_ms, mask, m.coordinate_frame, setpoint, numbers)


def _local_position(m: Any, source: Source) -> LocalPosition:
    r_E, v_E = enu_ned(Vec3(m.x, m.y, m.z)), enu_ned(Vec3(m.vx, m.vy, m.vz))
    return LocalPosition(source, m.time_boot_ms, r_E, v_E)


def _attitude(m: Any, source: Source) -> Attitude:
    q_EB = normalised(attitude_enu_ned(Quat(m.q1, m.q2, m.q3, m.q4)))
    w_B = flu_frd(Vec3(m.rollspeed, m.pitchspeed, m.yawspeed))
    return Attitude(source, m.time_boot_ms, q_EB, w_B)


def _extended_state(m: Any, source: Source) -> ExtendedState:
    return ExtendedState(source, m.landed_state)


def _status_text(m: Any, source: Source) -> StatusText:
    return StatusText(source, m.severity, m.text, m.id, m.chunk_seq)


READERS: dict[str, Callable[[Any, Source], GroundMessage]] = {
    "HEARTBEAT": _heartbeat,
    "COMMAND_LONG": _command_long,
    "COMMAND_INT": _command_int,
    "COMMAND_ACK": _command_ack,
    "SET_POSITION_TARGET_LOCAL_NED": _set_position_target,
    "POSITION_TARGET_LOCAL_NED": _position_target,
    "LOCAL_POSITION_NED": _local_position,
    "ATTITUDE_QUATERNION": _attitude,
    "EXTENDED_SYS_STATE": _extended_state,
    "STATUSTEXT": _status_text,
}
