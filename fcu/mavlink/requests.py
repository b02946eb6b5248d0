"""What ground stations and scripts ask of a vehicle, but for setpoints: each message, read and sent.

Each message is a value; `_name` reads it from the fields of the wire, and where a tool here sends
it, a function of its name in small letters builds it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from fcu.kernel.algebra import Vec3
from fcu.mavlink.definitions import GLOBAL_FRAMES, REAL32, Packed
from fcu.mavlink.definitions import message as _message
from fcu.mavlink.frames import enu_ned
from fcu.mavlink.framing import Source
from fcu.mavlink.geodesy import Origin
from fcu.mavlink.parameter_values import read
from fcu.mavlink.replies import printable

Fields = dict[str, Any]
_UNSET = 2**31 - 1  # COMMAND_INT's way of saying NaN
_NO_STICK = 2**15 - 1


def _from(f: Fields, source: Source) -> tuple[Source, int, int]:
    return source, f["target_system"], f["target_component"]


def _to(to: Source) -> dict[str, int]:
    return {"target_system": to.system, "target_component": to.component}


class Command(NamedTuple):
    """COMMAND_LONG or COMMAND_INT."""

    source: Source
    target_system: int  # 0: everyone
    target_component: int
    command: int  # a CommandId, or one not known here
    params: tuple[float, ...]  # seven; NaN: default. Positions in degrees (global) or m, as sent
    frame: int | None  # coordinate frame of params 5 to 7; None in COMMAND_LONG
    confirmation: int  # counts repeats; 0 in COMMAND_INT


def _command_long(f: Fields, source: Source) -> Command:
    params = tuple(f[f"param{n}"] for n in range(1, 8))
    return Command(*_from(f, source), f["command"], params, None, f["confirmation"])


def _command_int(f: Fields, source: Source) -> Command:
    scale = 1e7 if f["frame"] in GLOBAL_FRAMES else 1e4  # else m
    x, y = (math.nan if n == _UNSET else n / scale for n in (f["x"], f["y"]))
    params = (f["param1"], f["param2"], f["param3"], f["param4"], x, y, f["z"])
    return Command(*_from(f, source), f["command"], params, f["frame"], 0)


def command_long(
    to: Source, command: int, params: Sequence[float] = (), confirmation: int = 0
) -> Packed:
    """COMMAND_LONG; parameters not given are 0. Raises ValueError for more than seven."""
    if len(params) > 7:
        raise ValueError(f"a command has seven parameters, not {len(params)}")
    seven = {f"param{n}": float(p) for n, p in enumerate(params, start=1)}
    return _message("COMMAND_LONG", command=command, confirmation=confirmation, **seven, **_to(to))


def command_int(to: Source, command: int, frame: int, params: Sequence[float]) -> Packed:
    """COMMAND_INT of seven parameters; 5 and 6 in degrees (global frames) or m, NaN: unset."""
    scale = 1e7 if frame in GLOBAL_FRAMES else 1e4
    x, y = (_UNSET if math.isnan(p) else scale * p for p in params[4:6])
    four = {f"param{n}": float(p) for n, p in enumerate(params[:4], start=1)}
    return _message(
        "COMMAND_INT", command=command, frame=frame, x=x, y=y, z=params[6], **four, **_to(to)
    )


class ManualControl(NamedTuple):
    """MANUAL_CONTROL: sticks, NaN where there is none."""

    source: Source
    target_system: int
    x: float  # forward, -1 to 1
    y: float  # right, -1 to 1
    z: float  # thrust, 0 to 1
    r: float  # yaw, clockwise, -1 to 1


def _manual_control(f: Fields, source: Source) -> ManualControl:
    def stick(name: str, low: float) -> float:
        return math.nan if f[name] == _NO_STICK else max(low, min(1.0, f[name] * 1e-3))

    x, y, r = (stick(name, -1.0) for name in "xyr")
    return ManualControl(source, f["target"], x, y, stick("z", 0.0), r)


class ChannelsOverride(NamedTuple):
    """RC_CHANNELS_OVERRIDE: the first four channels of a radio, NaN where there is none."""

    source: Source
    target_system: int
    target_component: int
    channels: tuple[float, float, float, float]  # roll, pitch, throttle, yaw, -1 to 1


def _channels_override(f: Fields, source: Source) -> ChannelsOverride:
    def channel(n: int) -> float:
        us = f[f"chan{n}_raw"]  # 1000 to 2000; 0: given back to a radio; 65535: left out
        return math.nan if us in (0, 2**16 - 1) else max(-1.0, min(1.0, (us - 1500) / 500.0))

    return ChannelsOverride(*_from(f, source), (channel(1), channel(2), channel(3), channel(4)))


class FollowTarget(NamedTuple):
    """FOLLOW_TARGET: where a target is that is to be followed. It names no system."""

    source: Source
    target_system: int  # 0: everyone
    lat_deg: float
    lon_deg: float
    alt_m: float  # above the sea
    v_E: Vec3 | None  # m/s; None: not said


def _follow_target(f: Fields, source: Source) -> FollowTarget:
    v = enu_ned(Vec3(*f["vel"])) if f["est_capabilities"] & 2 else None
    place = f["lat"] / 1e7, f["lon"] / 1e7, f["alt"]
    return FollowTarget(source, 0, *place, v)


class NotTaken(NamedTuple):
    """A message that asks for what this vehicle does not do: its sender is told so."""

    source: Source
    target_system: int
    target_component: int  # 0: all, or the message has none
    name: str


def _not_taken(name: str) -> Callable[[Fields, Source], NotTaken]:
    def read(f: Fields, source: Source) -> NotTaken:
        return NotTaken(source, f["target_system"], f.get("target_component", 0), name)

    return read


class GlobalOrigin(NamedTuple):
    """SET_GPS_GLOBAL_ORIGIN: the place of local (0, 0, 0)."""

    source: Source
    target_system: int
    lat_deg: float
    lon_deg: float
    alt_m: float  # above the sea


def set_gps_global_origin(to: Source, origin: Origin) -> Packed:
    """SET_GPS_GLOBAL_ORIGIN."""
    return _message(
        "SET_GPS_GLOBAL_ORIGIN", target_system=to.system, latitude=1e7 * origin.lat_deg,
        longitude=1e7 * origin.lon_deg, altitude=1e3 * origin.alt_m,
    )  # fmt: skip


def _global_origin(f: Fields, source: Source) -> GlobalOrigin:
    place = f["latitude"] / 1e7, f["longitude"] / 1e7, f["altitude"] / 1e3
    return GlobalOrigin(source, f["target_system"], *place)


class SetMode(NamedTuple):
    """SET_MODE, which COMMAND_LONG has replaced."""

    source: Source
    target_system: int
    base_mode: int
    custom_mode: int


def _set_mode(f: Fields, source: Source) -> SetMode:
    return SetMode(source, f["target_system"], f["base_mode"], f["custom_mode"])


class ParamRequestList(NamedTuple):
    """PARAM_REQUEST_LIST."""

    source: Source
    target_system: int
    target_component: int


def _param_request_list(f: Fields, source: Source) -> ParamRequestList:
    return ParamRequestList(*_from(f, source))


def param_request_list(to: Source) -> Packed:
    """PARAM_REQUEST_LIST."""
    return _message("PARAM_REQUEST_LIST", **_to(to))


class ParamRequestRead(NamedTuple):
    """PARAM_REQUEST_READ: by its number, or by name where that is -1."""

    source: Source
    target_system: int
    target_component: int
    name: str
    number: int


def _param_request_read(f: Fields, source: Source) -> ParamRequestRead:
    return ParamRequestRead(*_from(f, source), printable(f["param_id"]), f["param_index"])


def param_request_read(to: Source, name: str) -> Packed:
    """PARAM_REQUEST_READ by name."""
    return _message("PARAM_REQUEST_READ", param_id=name.encode(), param_index=-1, **_to(to))


class ParamSet(NamedTuple):
    """PARAM_SET."""

    source: Source
    target_system: int
    target_component: int
    name: str
    value: float  # of a float32, or an INT32 in either encoding
    type: int  # MAV_PARAM_TYPE


def _param_set(f: Fields, source: Source) -> ParamSet:
    kind = f["param_type"]
    return ParamSet(*_from(f, source), printable(f["param_id"]), read(f["param_value"], kind), kind)


def param_set(to: Source, name: str, value: float) -> Packed:
    """PARAM_SET of a REAL32."""
    return _message(
        "PARAM_SET", param_id=name.encode(), param_value=value, param_type=REAL32, **_to(to)
    )


class StreamRequest(NamedTuple):
    """REQUEST_DATA_STREAM, which SET_MESSAGE_INTERVAL has replaced."""

    source: Source
    target_system: int
    target_component: int
    stream: int
    rate_hz: int
    start: bool


def _request_data_stream(f: Fields, source: Source) -> StreamRequest:
    start = f["start_stop"] == 1
    return StreamRequest(*_from(f, source), f["req_stream_id"], f["req_message_rate"], start)


class Ping(NamedTuple):
    """PING; a target of 0: a request."""

    source: Source
    target_system: int
    time_usec: int
    sequence: int


def _ping(f: Fields, source: Source) -> Ping:
    return Ping(source, f["target_system"], f["time_usec"], f["seq"])


class TimeSync(NamedTuple):
    """TIMESYNC; tc1 0: a request."""

    source: Source
    tc1: int
    ts1: int


def _timesync(f: Fields, source: Source) -> TimeSync:
    return TimeSync(source, f["tc1"], f["ts1"])


class FileTransfer(NamedTuple):
    """FILE_TRANSFER_PROTOCOL."""

    source: Source
    target_system: int
    target_component: int
    payload: bytes  # 251


def _file_transfer(f: Fields, source: Source) -> FileTransfer:
    return FileTransfer(*_from(f, source), bytes(f["payload"]))


class LogRequestList(NamedTuple):
    """LOG_REQUEST_LIST."""

    source: Source
    target_system: int
    target_component: int


def _log_request_list(f: Fields, source: Source) -> LogRequestList:
    return LogRequestList(*_from(f, source))


class LogRequestData(NamedTuple):
    """LOG_REQUEST_DATA."""

    source: Source
    target_system: int
    target_component: int
    number: int  # of the log
    offset: int  # bytes


def _log_request_data(f: Fields, source: Source) -> LogRequestData:
    return LogRequestData(*_from(f, source), f["id"], f["ofs"])


class SerialControl(NamedTuple):
    """SERIAL_CONTROL: what is typed into a console."""

    source: Source
    target_system: int  # 0: a sender that knows no target, or everyone
    target_component: int
    device: int
    flags: int


def _serial_control(f: Fields, source: Source) -> SerialControl:
    return SerialControl(*_from(f, source), f["device"], f["flags"])


class ExtendedParameter(NamedTuple):
    """One of the extended parameter protocol. `kind`: LIST, READ or SET."""

    source: Source
    target_system: int
    target_component: int
    kind: str
    name: str
    data: bytes  # the value to be set, as it came
    type: int


def _extended(kind: str) -> Callable[[Fields, Source], ExtendedParameter]:
    def read(f: Fields, source: Source) -> ExtendedParameter:
        return ExtendedParameter(
            *_from(f, source), kind, printable(f.get("param_id", b"")), f.get("param_value", b""),
            f.get("param_type", 0),
        )  # fmt: skip

    return read


Message = (
    Command | ManualControl | ChannelsOverride | FollowTarget | NotTaken | GlobalOrigin | SetMode | ParamRequestList | ParamRequestRead | ParamSet
    | StreamRequest | Ping | TimeSync | FileTransfer | LogRequestList
    | LogRequestData | SerialControl | ExtendedParameter
)  # fmt: skip
READERS: dict[str, Callable[[Fields, Source], Message]] = {
    "COMMAND_LONG": _command_long,
    "COMMAND_INT": _command_int,
    "MANUAL_CONTROL": _manual_control,
    "SET_MODE": _set_mode,
    "SET_GPS_GLOBAL_ORIGIN": _global_origin,
    "SET_ACTUATOR_CONTROL_TARGET": _not_taken("SET_ACTUATOR_CONTROL_TARGET"),
    "RC_CHANNELS_OVERRIDE": _channels_override,
    "FOLLOW_TARGET": _follow_target,
    "PARAM_REQUEST_LIST": _param_request_list,
    "PARAM_REQUEST_READ": _param_request_read,
    "PARAM_SET": _param_set,
    "REQUEST_DATA_STREAM": _request_data_stream,
    "PING": _ping,
    "TIMESYNC": _timesync,
    "FILE_TRANSFER_PROTOCOL": _file_transfer,
    "LOG_REQUEST_LIST": _log_request_list,
    "LOG_REQUEST_DATA": _log_request_data,
    "SERIAL_CONTROL": _serial_control,
    "PARAM_EXT_REQUEST_LIST": _extended("LIST"),
    "PARAM_EXT_REQUEST_READ": _extended("READ"),
    "PARAM_EXT_SET": _extended("SET"),
}
