"""MAVLink frames: what a message looks like, a message packed, a datagram taken apart.

Layouts come from pymavlink's dialect, or from a declaration here where that has none; packing
and unpacking are by `struct`, several times faster than pymavlink's message objects. Numbers
never raise: integers are saturated to their type, floats to float32, and what is not a number
becomes 0 in an integer field, so that a diverging flight cannot crash its own telemetry.
"""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from fastcrc.crc16 import mcrf4xx

V1, V2 = 0xFE, 0xFD
SIGNED = 1  # incompatibility flag
FRAMES_AT_ONCE = 16  # of one datagram: no client sends more
_HEADER = struct.Struct("<BBBBBBBHB")  # marker, length, flags, flags, sequence, source, id
_HEADER_V1 = struct.Struct("<BBBBBB")
_CRC = struct.Struct("<H")
_SIGNATURE = 13
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


class Kind(NamedTuple):
    """A message: what its frame needs."""

    name: str
    id: int
    fields: tuple[Field, ...]
    layout: struct.Struct
    crc_extra: bytes

    @property
    def size(self) -> int:
        """Bytes of its payload before trailing zeros are trimmed."""
        return self.layout.size

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


class Packed(NamedTuple):
    """A message without its header: the same for every link."""

    kind: Kind
    payload: bytes  # trailing zeros trimmed


class Frame(NamedTuple):
    """A received message that is whole: its checksum is right."""

    kind: Kind
    payload: bytes  # of full length
    system: int
    component: int
    sequence: int
    version: int  # of MAVLink


def _kind(name: str, number: int, fields: list[Field], crc_extra: int) -> Kind:
    codes = "".join(f"{f.length}{f.code}" if f.length else f.code for f in fields)
    return Kind(name, number, tuple(fields), struct.Struct("<" + codes), bytes([crc_extra]))


def of(message: Any) -> Kind:
    """The kind of one of pymavlink's message classes."""
    fields = []
    lengths = dict(zip(message.ordered_fieldnames, message.array_lengths, strict=True))
    types = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    for name in message.ordered_fieldnames:
        fields.append(Field(name, _TYPES[types[name]][0], lengths[name]))
    return _kind(message.msgname, message.id, fields, message.crc_extra)


def declared(name: str, number: int, *declaration: str, extensions: tuple[str, ...] = ()) -> Kind:
    """A kind from the fields of its XML, such as "uint16_t counter" or "float[4] voltage".

    The order on the wire and CRC_EXTRA follow from them, as MAVLink's serialization guide says.
    """

    def parsed(text: str) -> tuple[str, str, int]:
        type_, field = text.split()
        base, _, count = type_.rstrip("]").partition("[")
        return base, field, int(count or 0)

    core = sorted(map(parsed, declaration), key=lambda f: -_TYPES[f[0]][1])
    crc = mcrf4xx(f"{name} ".encode())
    for base, field, count in core:
        crc = mcrf4xx(f"{base} {field} ".encode() + (bytes([count]) if count else b""), crc)
    fields = [Field(f, _TYPES[b][0], n) for b, f, n in (*core, *map(parsed, extensions))]
    return _kind(name, number, fields, (crc & 0xFF) ^ (crc >> 8))


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


def packed(kind: Kind, /, **values: Any) -> Packed:
    """A message of these fields; what is left out is 0. Raises KeyError for a name it has not."""
    row: list[Any] = []
    for name, code, count in kind.fields:
        value = values.pop(name, 0 if not count else b"" if code == "s" else ())
        if code == "s":
            row.append(bytes(value))
        elif count:
            given = [_number(code, x) for x in value][:count]
            row += given + [0] * (count - len(given))
        else:
            row.append(_number(code, value))
    if values:
        raise KeyError(f"{kind.name} has no {', '.join(values)}")
    return Packed(kind, kind.layout.pack(*row).rstrip(b"\0") or b"\0")


def framed(message: Packed, sequence: int, system: int, component: int) -> bytes:
    """A MAVLink 2 frame, unsigned."""
    kind, payload = message
    head = _HEADER.pack(
        V2, len(payload), 0, 0, sequence, system, component, kind.id & 0xFFFF, kind.id >> 16
    )
    frame = head + payload
    return frame + _CRC.pack(mcrf4xx(frame[1:] + kind.crc_extra))


def frames(
    datagram: bytes, kinds: Mapping[int, Kind], dropped: Counter[str], v1: bool = True,
    at_once: int = FRAMES_AT_ONCE,
) -> Iterator[Frame]:  # fmt: skip
    """The whole messages of one datagram that are of known kinds; others counted, by reason.

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
        kind = kinds.get(number)
        if flags & ~SIGNED:
            dropped["unknown flags"] += 1
        elif marker == V1 and not v1:
            dropped["MAVLink 1"] += 1
        elif kind is None:
            dropped["unknown message"] += 1
        elif system == 0:
            dropped["source 0"] += 1
        else:
            body = start + head
            crc = mcrf4xx(datagram[start + 1 : body + length] + kind.crc_extra)
            if crc != int.from_bytes(datagram[body + length : body + length + 2], "little"):
                dropped["wrong checksum"] += 1
                continue
            payload = datagram[body : body + length][: kind.size].ljust(kind.size, b"\0")
            yield Frame(kind, payload, system, component, sequence, 2 if marker == V2 else 1)
