"""MAVLink 2 frames in compiled code: the bytes of `framing`, for what is sent at every tick.

A buffer is uint8[n]. Numbers of more than one byte are little-endian, as on the wire.
"""

from __future__ import annotations

import numpy as np

from fcu.kernel.compile import kernel

HEADER, OVERHEAD = 10, 12  # bytes before the payload; and with the checksum behind it
_V2 = 0xFD


def _table() -> np.ndarray:
    table = np.zeros(256, dtype=np.uint16)
    for byte in range(256):
        x = (byte ^ byte << 4) & 0xFF
        table[byte] = (x << 8 ^ x << 3 ^ x >> 4) & 0xFFFF
    return table


_CRC = _table()  # of CRC-16/MCRF4XX, a byte at a time


@kernel
def checksum(buffer, first, end, extra):
    """CRC-16/MCRF4XX of buffer[first:end] and the byte `extra`."""
    crc = np.uint16(0xFFFF)
    for i in range(first, end):
        crc = np.uint16((crc >> 8) ^ _CRC[(crc ^ buffer[i]) & 0xFF])
    return np.int64((crc >> 8) ^ _CRC[(crc ^ extra) & 0xFF])


@kernel
def put(buffer, at, value, size):
    """Write an integer as `size` bytes."""
    for i in range(size):
        buffer[at + i] = (value >> (8 * i)) & 0xFF


@kernel
def get(buffer, at, size):
    """Read an integer of `size` bytes, below 2^63, without a sign."""
    value = np.int64(0)
    for i in range(size):
        value |= np.int64(buffer[at + i]) << (8 * i)
    return value


@kernel
def get_signed(buffer, at, size):
    """Read an integer of `size` bytes (fewer than eight) with a sign."""
    value = get(buffer, at, size)
    return value - (np.int64(1) << (8 * size)) if buffer[at + size - 1] & 0x80 else value


@kernel
def frame(buffer, at, size, sequence, system, component, number, extra):
    """Frame the payload of `size` bytes that stands HEADER bytes behind `at`; where it ends.

    Trailing zeros are trimmed, but for the first byte.  number, extra : of its definition.
    """
    body = at + HEADER
    length = size
    while length > 1 and buffer[body + length - 1] == 0:
        length -= 1
    buffer[at], buffer[at + 1], buffer[at + 2], buffer[at + 3] = _V2, length, 0, 0
    buffer[at + 4], buffer[at + 5], buffer[at + 6] = sequence & 0xFF, system, component
    put(buffer, at + 7, number, 3)
    end = body + length
    put(buffer, end, checksum(buffer, at + 1, end, extra), 2)
    return end + 2


@kernel
def payload(datagram, at, length, system, component, number, extra, out):
    """Copy the payload of the frame at `at` to `out`, trimmed zeros restored; where it ends.

    datagram : of `length` bytes.  out : uint8[n], its full size.
    0: there is no whole, unsigned MAVLink 2 message of this number from this sender.
    """
    if length < at + OVERHEAD or datagram[at] != _V2 or datagram[at + 2] != 0:
        return 0
    body = at + HEADER
    end = body + datagram[at + 1]
    if get(datagram, at + 7, 3) != number or length < end + 2:
        return 0
    if datagram[at + 5] != system or datagram[at + 6] != component:
        return 0
    if checksum(datagram, at + 1, end, extra) != get(datagram, end, 2):
        return 0
    for i in range(out.size):
        out[i] = datagram[body + i] if body + i < end else 0
    return end + 2
