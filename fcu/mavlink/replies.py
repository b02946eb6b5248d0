"""What the flight controller answers, and what is read of it: acknowledgements, parameters, texts.

Versions, modes and the answers of protocols that it does not have are here too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from fcu.mavlink.definitions import EXT_UNSUPPORTED, INT32, REAL32, SERIAL_REPLY, Packed
from fcu.mavlink.definitions import message as _message
from fcu.mavlink.framing import Source
from fcu.mavlink.parameter_values import bytewise, read

Fields = dict[str, Any]


def _to(to: Source) -> dict[str, int]:
    return {"target_system": to.system, "target_component": to.component}


def command_ack(command: int, result: int, to: Source, progress: int = 255) -> Packed:
    """COMMAND_ACK; `progress` in percent, 255 unknown."""
    return _message("COMMAND_ACK", command=command, result=result, progress=progress, **_to(to))


def param_value(name: str, value: float, index: int, count: int, integer: bool = False) -> Packed:
    """PARAM_VALUE, a REAL32, or an INT32 if `integer`, by its bytes."""
    packed = _message(
        "PARAM_VALUE", param_id=name.encode(), param_value=value,
        param_type=INT32 if integer else REAL32, param_count=count, param_index=index,
    )  # fmt: skip
    return bytewise(packed) if integer else packed


def param_error(to: Source, name: str, index: int, error: int) -> Packed:
    """PARAM_ERROR."""
    raw = name.encode("ascii", errors="replace")
    return _message("PARAM_ERROR", param_id=raw, param_index=index, error=error, **_to(to))


def current_mode(standard: int, custom: int, intended: int) -> Packed:
    """CURRENT_MODE."""
    return _message(
        "CURRENT_MODE", standard_mode=standard, custom_mode=custom, intended_custom_mode=intended
    )


def available_modes(
    count: int, index: int, standard: int, custom: int, properties: int, name: str
) -> Packed:
    """AVAILABLE_MODES: one of `count`, from 1."""
    return _message(
        "AVAILABLE_MODES", number_modes=count, mode_index=index, standard_mode=standard,
        custom_mode=custom, properties=properties, mode_name=name.encode(),
    )  # fmt: skip


def available_modes_monitor(sequence: int) -> Packed:
    """AVAILABLE_MODES_MONITOR: another number when the modes have changed."""
    return _message("AVAILABLE_MODES_MONITOR", seq=sequence)


def message_interval(number: int, interval_us: int) -> Packed:
    """MESSAGE_INTERVAL; -1: not sent."""
    return _message("MESSAGE_INTERVAL", message_id=number, interval_us=interval_us)


def timesync(tc1: int, ts1: int, to: Source) -> Packed:
    """TIMESYNC, ns."""
    return _message("TIMESYNC", tc1=tc1, ts1=ts1, **_to(to))


def ping(time_usec: int, sequence: int, to: Source) -> Packed:
    """PING, answered."""
    return _message("PING", time_usec=time_usec, seq=sequence, **_to(to))


def log_entry() -> Packed:
    """LOG_ENTRY of a vehicle without logs."""
    return _message("LOG_ENTRY")


def log_data(number: int, offset: int) -> Packed:
    """LOG_DATA of a log that is not there: no bytes."""
    return _message("LOG_DATA", id=number, ofs=offset, count=0)


def serial_control(device: int, text: str, to: Source) -> Packed:
    """SERIAL_CONTROL: what a console answers, at most 70 characters."""
    data = text.encode("ascii", errors="replace")[:70]
    return _message(
        "SERIAL_CONTROL", device=device, flags=SERIAL_REPLY, count=len(data), data=data, **_to(to)
    )


def no_extended_value(name: str) -> Packed:
    """PARAM_EXT_VALUE of a vehicle without extended parameters: one of none."""
    return _message("PARAM_EXT_VALUE", param_id=name.encode(), param_count=0, param_index=2**16 - 1)


def extended_refused(name: str, value: bytes, kind: int) -> Packed:
    """PARAM_EXT_ACK: an extended parameter that there is not was not set."""
    return _message(
        "PARAM_EXT_ACK", param_id=name.encode(), param_value=value, param_type=kind,
        param_result=EXT_UNSUPPORTED,
    )  # fmt: skip


def file_transfer(payload: bytes, to: Source) -> Packed:
    """FILE_TRANSFER_PROTOCOL."""
    return _message("FILE_TRANSFER_PROTOCOL", payload=payload, **_to(to))


def autopilot_version(
    capabilities: int, presented: int, version: int, hash8: bytes, uid: int
) -> Packed:
    """AUTOPILOT_VERSION: flight_sw_version as `presented`, and middleware_sw_version as `version`.

    `hash8` : eight bytes that tell builds apart.
    """
    return _message(
        "AUTOPILOT_VERSION", capabilities=capabilities, flight_sw_version=presented,
        middleware_sw_version=version, flight_custom_version=hash8, uid=uid,
    )  # fmt: skip


def protocol_version() -> Packed:
    """PROTOCOL_VERSION: MAVLink 2, 1 is understood."""
    return _message("PROTOCOL_VERSION", version=200, min_version=100, max_version=200)


def status_text(severity: int, brief: str) -> Packed:
    """STATUSTEXT of at most 50 characters. A character that is not ASCII becomes `?`."""
    raw = brief.encode("ascii", errors="replace").replace(b"\0", b"?")
    return _message("STATUSTEXT", severity=severity, text=raw)


# --- read back


def printable(raw: bytes) -> str:
    """A text of the wire; what cannot be printed becomes `?`: it may end up in a log."""
    text = raw.decode("ascii", errors="replace")
    return "".join(c if c.isprintable() else "?" for c in text)


class CommandAck(NamedTuple):
    """What became of a command."""

    source: Source
    target_system: int
    target_component: int
    command: int
    result: int
    progress: int  # percent; 255: unknown


def _command_ack(f: Fields, source: Source) -> CommandAck:
    return CommandAck(
        source, f["target_system"], f["target_component"], f["command"], f["result"], f["progress"]
    )


class ParamValue(NamedTuple):
    """PARAM_VALUE."""

    source: Source
    name: str
    value: float  # whatever its type and encoding
    type: int
    number: int
    total: int


def _param_value(f: Fields, source: Source) -> ParamValue:
    return ParamValue(
        source, printable(f["param_id"]), read(f["param_value"], f["param_type"]),
        f["param_type"], f["param_index"], f["param_count"],
    )  # fmt: skip


class StatusText(NamedTuple):
    """STATUSTEXT: one chunk of a text."""

    source: Source
    severity: int
    text: str
    id: int  # the same in all chunks of a text; 0: this is the whole text
    chunk: int


def _status_text(f: Fields, source: Source) -> StatusText:
    return StatusText(source, f["severity"], printable(f["text"]), f["id"], f["chunk_seq"])


Message = CommandAck | ParamValue | StatusText
READERS: dict[str, Callable[[Fields, Source], Message]] = {
    "COMMAND_ACK": _command_ack,
    "PARAM_VALUE": _param_value,
    "STATUSTEXT": _status_text,
}
