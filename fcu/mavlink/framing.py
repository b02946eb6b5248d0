"""MAVLink frames: a message framed, an expected one taken, a datagram taken apart.

The one framer of all links. Lockstep waits for it at every tick.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from fastcrc.crc16 import mcrf4xx

from fcu.mavlink.definitions import Definition

V1, V2 = 0xFE, 0xFD
LAST_OF_V1 = 255  # the greatest number of a message in MAVLink 1
SIGNED = 1  # incompatibility flag
FRAMES_AT_ONCE = 16  # of one datagram: no client sends more
_HEADER = struct.Struct("<BBBBBBBHB")  # marker, length, flags, flags, sequence, source, id
_CRC = struct.Struct("<H")
_OVERHEAD = _HEADER.size + _CRC.size
_OVERHEAD_V1 = 8
_SIGNATURE = 13


class Source(NamedTuple):
    """Who sent a message."""

    system: int
    component: int


class Frame(NamedTuple):
    """A received message that is whole: its checksum is right."""

    definition: Definition
    payload: bytes  # of full length
    source: Source
    sequence: int
    version: int  # of MAVLink


class WireError(ValueError):
    """A datagram that is not what its link carries."""


def framed(
    definition: Definition, payload: bytes, sequence: int, system: int, component: int
) -> bytes:
    """A MAVLink 2 frame, unsigned; the payload's trailing zeros are trimmed."""
    payload = payload.rstrip(b"\0") or b"\0"  # MAVLink 2 sends at least one byte
    number = definition.id
    head = _HEADER.pack(
        V2, len(payload), 0, 0, sequence, system, component, number & 0xFFFF, number >> 16
    )
    frame = head + payload
    return frame + _CRC.pack(mcrf4xx(frame[1:] + definition.crc_extra))


def framed_v1(
    definition: Definition, payload: bytes, sequence: int, system: int, component: int
) -> bytes | None:
    """A MAVLink 1 frame, without the extensions. None for a message that MAVLink 1 cannot number."""
    if definition.id > LAST_OF_V1:
        return None
    size = definition.core_size
    frame = bytes([V1, size, sequence, system, component, definition.id]) + payload[:size]
    return frame + _CRC.pack(mcrf4xx(frame[1:] + definition.crc_extra))


def _checked(datagram: bytes, start: int, body: int, end: int, of: Definition) -> bytes | None:
    """The payload of full length of the frame from `start`; None if its checksum is wrong."""
    crc = mcrf4xx(datagram[start + 1 : end] + of.crc_extra)
    if crc != datagram[end] | datagram[end + 1] << 8:
        return None
    # Longer than we know it: a newer dialect's extension, which MAVLink 2 has us ignore.
    return datagram[body:end][: of.size].ljust(of.size, b"\0")


def expected(
    of: Definition, datagram: bytes, start: int, system: int, component: int
) -> tuple[bytes, int]:
    """Payload of the message at `start`, zeros restored, and where the next one begins.

    Raises WireError unless it is this message, unsigned, from this sender.
    """
    if len(datagram) < start + _OVERHEAD:
        raise WireError(f"no {of.name} in {len(datagram)} bytes")
    marker, length, incompatible, _, _, sender, part, low, high = _HEADER.unpack_from(
        datagram, start
    )
    if marker != V2 or incompatible:
        raise WireError("not an unsigned MAVLink 2 message")
    if low | high << 16 != of.id:
        raise WireError(f"message {low | high << 16} where {of.name} was expected")
    if sender != system or part != component:
        raise WireError(f"from system {sender} component {part}, not {system}")
    body = start + _HEADER.size
    end = body + length
    if len(datagram) < end + _CRC.size:
        raise WireError(f"{of.name} is truncated")
    payload = _checked(datagram, start, body, end, of)
    if payload is None:
        raise WireError(f"{of.name} has a wrong checksum")
    return payload, end + _CRC.size


def next_frame(received: bytearray) -> bytes | None:
    """Take the first whole frame from the bytes of a stream, good or bad. None until it is there.

    Bytes before the mark of a frame are dropped.
    """
    marks = [at for at in (received.find(V1), received.find(V2)) if at >= 0]
    del received[: min(marks, default=len(received))]
    if len(received) < 3:
        return None
    overhead = _OVERHEAD if received[0] == V2 else _OVERHEAD_V1
    signature = _SIGNATURE if received[0] == V2 and received[2] & SIGNED else 0
    end = overhead + received[1] + signature
    if len(received) < end:
        return None
    frame = bytes(received[:end])
    del received[:end]
    return frame


def frames(
    datagram: bytes, known: Mapping[int, Definition], dropped: Counter[str], v1: bool = True,
    at_once: int = FRAMES_AT_ONCE,
) -> Iterator[Frame]:  # fmt: skip
    """The whole messages of one datagram that are known; others counted, by reason.

    Of its frames, good or bad, the first `at_once` are looked at; `v1`: MAVLink 1 is accepted.

    Never raises, and carries nothing over from one datagram to the next. After bytes that are
    no frame the rest of a datagram is dropped: where the next one begins cannot be known.
    """
    at, left = 0, at_once
    while at < len(datagram):
        if left == 0:
            dropped["over budget"] += 1
            return
        left -= 1
        marker = datagram[at]
        if marker == V2:
            head, overhead = 10, 12
        elif marker == V1:
            head, overhead = 6, 8
        else:
            dropped["not MAVLink"] += 1
            return
        if at + head > len(datagram):
            dropped["truncated"] += 1
            return
        length = datagram[at + 1]
        flags = datagram[at + 2] if marker == V2 else 0
        start, end = at, at + overhead + length + (_SIGNATURE if flags & SIGNED else 0)
        if end > len(datagram):
            dropped["truncated"] += 1
            return
        at = end
        if marker == V2:
            sequence, system, component = datagram[start + 4 : start + 7]
            number = int.from_bytes(datagram[start + 7 : start + 10], "little")
        else:
            sequence, system, component, number = datagram[start + 2 : start + 6]
        definition = known.get(number)
        if flags & ~SIGNED:
            dropped["unknown flags"] += 1
        elif marker == V1 and not v1:
            dropped["MAVLink 1"] += 1
        elif definition is None:
            dropped["unknown message"] += 1
        elif system == 0:
            dropped["source 0"] += 1
        else:
            body = start + head
            payload = _checked(datagram, start, body, body + length, definition)
            if payload is None:
                dropped["wrong checksum"] += 1
                continue
            version = 2 if marker == V2 else 1
            yield Frame(definition, payload, Source(system, component), sequence, version)
