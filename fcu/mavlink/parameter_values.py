"""A parameter's value in the one field of PARAM_VALUE and PARAM_SET, which is a float.

A REAL32 is that float. An INT32 is its four bytes (PX4's way, `PARAM_ENCODE_BYTEWISE`) or the float
of its value (`PARAM_ENCODE_C_CAST`). Which of both a sender means shows: the bytes of an integer
below 2^29 are a float of less than 1, or none.
"""

from __future__ import annotations

import math
import struct

from fcu.mavlink.definitions import INT32, Packed

_FLOAT, _INTEGER = struct.Struct("<f"), struct.Struct("<i")


def read(value: float, kind: int) -> float:
    """The number that a field of MAV_PARAM_TYPE `kind` holds, in either encoding."""
    if kind != INT32 or abs(value) >= 1.0:
        return value
    number: int = _INTEGER.unpack(_FLOAT.pack(value))[0]
    return float(number)


def bytewise(message: Packed) -> Packed:
    """A PARAM_VALUE or PARAM_SET of a whole number, with its bytes in the place of the float."""
    at = message.definition.offset("param_value")
    payload = bytearray(message.payload)
    (value,) = _FLOAT.unpack_from(payload, at)
    whole = round(value) if math.isfinite(value) else 0
    _INTEGER.pack_into(payload, at, min(max(whole, -(2**31)), 2**31 - 1))
    return message._replace(payload=bytes(payload))
