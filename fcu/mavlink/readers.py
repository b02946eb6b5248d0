"""Received MAVLink messages as the values of `ground_messages`: one reader a message.

`ground_wire` frames and checks; here fields change frame and unit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from fcu.kernel.algebra import Quat, Vec3
from fcu.kernel.rotations import normalised
from fcu.mavlink.enums import GLOBAL_FRAMES, IGNORE_ATTITUDE
from fcu.mavlink.fields import (
    NUMBERS,
    attitude,
    attitude_refusal,
    body,
    earth,
    heading,
    refusal,
    setpoint_of,
    turned_setpoint,
)
from fcu.mavlink.geodesy import Geodetic
from fcu.mavlink.ground_messages import (
    Attitude,
    AttitudeSetpointMessage,
    Command,
    CommandAck,
    ExtendedState,
    FileTransfer,
    GlobalPosition,
    GroundMessage,
    Heartbeat,
    HomePosition,
    LocalPosition,
    LogRequestList,
    ManualControl,
    MissionMessage,
    NotTaken,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    Ping,
    PositionTarget,
    SetMode,
    SetpointMessage,
    Source,
    StatusText,
    StreamRequest,
    TimeSync,
)

Fields = dict[str, Any]
_ARMED = 128  # HEARTBEAT.base_mode
# COMMAND_INT counts 1e-7 deg in these (10 and 11: above terrain), else 1e-4 m
_GLOBAL_COMMANDS = frozenset({*GLOBAL_FRAMES, 10, 11})
_UNSET = 2**31 - 1  # COMMAND_INT's way of saying NaN
_NO_STICK = 2**15 - 1
_NO_HEADING = 2**16 - 1


def _text(raw: bytes) -> str:
    text = raw.decode("ascii", errors="replace")
    return "".join(c if c.isprintable() else "?" for c in text)  # it may end up in a log


def _to(f: Fields, source: Source) -> tuple[Source, int, int]:
    return source, f["target_system"], f["target_component"]


def _heartbeat(f: Fields, source: Source) -> Heartbeat:
    mode = f["custom_mode"]
    return Heartbeat(
        source, f["type"], f["autopilot"], f["base_mode"] & _ARMED != 0,
        mode >> 16 & 0xFF, mode >> 24 & 0xFF, f["system_status"],
    )  # fmt: skip


def _command_long(f: Fields, source: Source) -> Command:
    params = tuple(f[f"param{n}"] for n in range(1, 8))
    return Command(*_to(f, source), f["command"], params, None, f["confirmation"])


def _command_int(f: Fields, source: Source) -> Command:
    scale = 1e7 if f["frame"] in _GLOBAL_COMMANDS else 1e4
    x, y = (math.nan if n == _UNSET else n / scale for n in (f["x"], f["y"]))
    params = (f["param1"], f["param2"], f["param3"], f["param4"], x, y, f["z"])
    return Command(*_to(f, source), f["command"], params, f["frame"], 0)


def _command_ack(f: Fields, source: Source) -> CommandAck:
    return CommandAck(*_to(f, source), f["command"], f["result"], f["progress"])


def _numbers(f: Fields, x: str, y: str, z: str) -> bytes:
    return NUMBERS.pack(
        f[x], f[y], f[z], f["vx"], f["vy"], f["vz"], f["afx"], f["afy"], f["afz"],
        f["yaw"], f["yaw_rate"],
    )  # fmt: skip


def _set_position_target(f: Fields, source: Source) -> SetpointMessage:
    numbers, mask, frame = _numbers(f, "x", "y", "z"), f["type_mask"], f["coordinate_frame"]
    why = refusal(numbers, mask, frame, None)
    if not why and frame in GLOBAL_FRAMES:
        why = f"frame {frame} is not for local positions"
    return SetpointMessage(
        *_to(f, source), f["time_boot_ms"], mask, frame,
        turned_setpoint(numbers, mask, frame), None, numbers, why,
    )  # fmt: skip


def _set_position_target_global(f: Fields, source: Source) -> SetpointMessage:
    numbers, mask = _numbers(f, "lat_int", "lon_int", "alt"), f["type_mask"]
    frame = f["coordinate_frame"]
    place = Geodetic(f["lat_int"] * 1e-7, f["lon_int"] * 1e-7, f["alt"])
    why = refusal(numbers, mask, frame, place)
    if not why and frame not in GLOBAL_FRAMES:
        why = f"frame {frame} is not for places on Earth"
    return SetpointMessage(
        *_to(f, source), f["time_boot_ms"], mask, frame,
        turned_setpoint(numbers, mask, frame), place, numbers, why,
    )  # fmt: skip


def _set_attitude_target(f: Fields, source: Source) -> AttitudeSetpointMessage:
    q, mask = Quat(*f["q"]), f["type_mask"]
    w = Vec3(f["body_roll_rate"], f["body_pitch_rate"], f["body_yaw_rate"])
    why = attitude_refusal(mask, q, w, f["thrust"])
    level = Quat(1.0, 0.0, 0.0, 0.0)
    q_EB = attitude(normalised(level if why or mask & IGNORE_ATTITUDE else q))
    return AttitudeSetpointMessage(
        *_to(f, source), f["time_boot_ms"], mask, q_EB, body(w), f["thrust"], why
    )  # fmt: skip


def _manual_control(f: Fields, source: Source) -> ManualControl:
    def stick(name: str, low: float) -> float:
        return math.nan if f[name] == _NO_STICK else max(low, min(1.0, f[name] * 1e-3))

    x, y, r = (stick(name, -1.0) for name in "xyr")
    return ManualControl(source, f["target"], x, y, stick("z", 0.0), r)


def _not_taken(name: str) -> Callable[[Fields, Source], NotTaken]:
    def read(f: Fields, source: Source) -> NotTaken:
        return NotTaken(source, f["target_system"], f.get("target_component", 0), name)

    return read


def _set_mode(f: Fields, source: Source) -> SetMode:
    return SetMode(source, f["target_system"], f["base_mode"], f["custom_mode"])


def _param_request_list(f: Fields, source: Source) -> ParamRequestList:
    return ParamRequestList(*_to(f, source))


def _param_request_read(f: Fields, source: Source) -> ParamRequestRead:
    return ParamRequestRead(*_to(f, source), _text(f["param_id"]), f["param_index"])


def _param_set(f: Fields, source: Source) -> ParamSet:
    return ParamSet(*_to(f, source), _text(f["param_id"]), f["param_value"], f["param_type"])


def _param_value(f: Fields, source: Source) -> ParamValue:
    return ParamValue(
        source, _text(f["param_id"]), f["param_value"], f["param_type"], f["param_index"],
        f["param_count"],
    )  # fmt: skip


def _request_data_stream(f: Fields, source: Source) -> StreamRequest:
    start = f["start_stop"] == 1
    return StreamRequest(*_to(f, source), f["req_stream_id"], f["req_message_rate"], start)


def _ping(f: Fields, source: Source) -> Ping:
    return Ping(source, f["target_system"], f["time_usec"], f["seq"])


def _timesync(f: Fields, source: Source) -> TimeSync:
    return TimeSync(source, f["tc1"], f["ts1"])


def _mission(kind: str) -> Callable[[Fields, Source], MissionMessage]:
    def read(f: Fields, source: Source) -> MissionMessage:
        return MissionMessage(
            *_to(f, source), kind, f.get("seq", 0), f.get("count", 0), f.get("mission_type", 0)
        )

    return read


def _file_transfer(f: Fields, source: Source) -> FileTransfer:
    return FileTransfer(*_to(f, source), bytes(f["payload"]))


def _log_request_list(f: Fields, source: Source) -> LogRequestList:
    return LogRequestList(*_to(f, source))


def _position_target(f: Fields, source: Source) -> PositionTarget:
    numbers, mask = _numbers(f, "x", "y", "z"), f["type_mask"]
    setpoint = setpoint_of(numbers, mask)
    return PositionTarget(source, f["time_boot_ms"], mask, f["coordinate_frame"], setpoint, numbers)


def _local_position(f: Fields, source: Source) -> LocalPosition:
    r, v = Vec3(f["x"], f["y"], f["z"]), Vec3(f["vx"], f["vy"], f["vz"])
    return LocalPosition(source, f["time_boot_ms"], earth(r), earth(v))


def _global_position(f: Fields, source: Source) -> GlobalPosition:
    place = Geodetic(f["lat"] * 1e-7, f["lon"] * 1e-7, f["alt"] * 1e-3)
    v = Vec3(f["vx"] * 1e-2, f["vy"] * 1e-2, f["vz"] * 1e-2)
    psi = math.nan if f["hdg"] == _NO_HEADING else heading(math.radians(f["hdg"] * 1e-2))
    above_home = f["relative_alt"] * 1e-3
    return GlobalPosition(source, f["time_boot_ms"], place, above_home, earth(v), psi)


def _home_position(f: Fields, source: Source) -> HomePosition:
    place = Geodetic(f["latitude"] * 1e-7, f["longitude"] * 1e-7, f["altitude"] * 1e-3)
    return HomePosition(source, place, earth(Vec3(f["x"], f["y"], f["z"])))


def _attitude(f: Fields, source: Source) -> Attitude:
    q_EB = normalised(attitude(Quat(f["q1"], f["q2"], f["q3"], f["q4"])))
    w_B = body(Vec3(f["rollspeed"], f["pitchspeed"], f["yawspeed"]))
    return Attitude(source, f["time_boot_ms"], q_EB, w_B)


def _extended_state(f: Fields, source: Source) -> ExtendedState:
    return ExtendedState(source, f["landed_state"])


def _status_text(f: Fields, source: Source) -> StatusText:
    return StatusText(source, f["severity"], _text(f["text"]), f["id"], f["chunk_seq"])


READERS: dict[str, Callable[[Fields, Source], GroundMessage]] = {
    "HEARTBEAT": _heartbeat,
    "COMMAND_LONG": _command_long,
    "COMMAND_INT": _command_int,
    "COMMAND_ACK": _command_ack,
    "SET_POSITION_TARGET_LOCAL_NED": _set_position_target,
    "SET_POSITION_TARGET_GLOBAL_INT": _set_position_target_global,
    "SET_ATTITUDE_TARGET": _set_attitude_target,
    "MANUAL_CONTROL": _manual_control,
    "SET_MODE": _set_mode,
    "SET_GPS_GLOBAL_ORIGIN": _not_taken("SET_GPS_GLOBAL_ORIGIN"),
    "SET_ACTUATOR_CONTROL_TARGET": _not_taken("SET_ACTUATOR_CONTROL_TARGET"),
    "PARAM_REQUEST_LIST": _param_request_list,
    "PARAM_REQUEST_READ": _param_request_read,
    "PARAM_SET": _param_set,
    "PARAM_VALUE": _param_value,
    "REQUEST_DATA_STREAM": _request_data_stream,
    "PING": _ping,
    "TIMESYNC": _timesync,
    "MISSION_REQUEST_LIST": _mission("REQUEST_LIST"),
    "MISSION_COUNT": _mission("COUNT"),
    "MISSION_CLEAR_ALL": _mission("CLEAR_ALL"),
    "MISSION_REQUEST": _mission("REQUEST"),
    "MISSION_REQUEST_INT": _mission("REQUEST"),
    "MISSION_ITEM": _mission("ITEM"),
    "MISSION_ITEM_INT": _mission("ITEM"),
    "MISSION_SET_CURRENT": _mission("SET_CURRENT"),
    "MISSION_ACK": _mission("ACK"),
    "FILE_TRANSFER_PROTOCOL": _file_transfer,
    "LOG_REQUEST_LIST": _log_request_list,
    "POSITION_TARGET_LOCAL_NED": _position_target,
    "LOCAL_POSITION_NED": _local_position,
    "GLOBAL_POSITION_INT": _global_position,
    "HOME_POSITION": _home_position,
    "ATTITUDE_QUATERNION": _attitude,
    "EXTENDED_SYS_STATE": _extended_state,
    "STATUSTEXT": _status_text,
}
