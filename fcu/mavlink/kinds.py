"""Every kind of message on the ground link: the dialect's, and those it leaves out."""

from __future__ import annotations

import pymavlink.dialects.v20.common as mavlink

from fcu.mavlink.framing import Kind, Packed, declared, of, packed

KINDS: dict[int, Kind] = {number: of(m) for number, m in mavlink.mavlink_map.items()}
_NAMED: dict[str, Kind] = {kind.name: kind for kind in KINDS.values()}
# Messages of the standard that the dialect leaves out, or did until lately; TIMESYNC, whose newer
# fields it leaves out; and ArduPilot's WIND.
for _kind in (
    declared(
        "TIMESYNC", 111, "int64_t tc1", "int64_t ts1",
        extensions=("uint8_t target_system", "uint8_t target_component"),
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
    KINDS[_kind.id] = _NAMED[_kind.name] = _kind


def command_name(number: int) -> str:
    """What a MAV_CMD is called, without its prefix."""
    entry = mavlink.enums["MAV_CMD"].get(number)
    return entry.name.removeprefix("MAV_CMD_") if entry else f"Command {number}"


def message(name: str, /, **fields: object) -> Packed:
    """A message by its name in the dialect; fields that are left out are 0."""
    return packed(_NAMED[name], **fields)
