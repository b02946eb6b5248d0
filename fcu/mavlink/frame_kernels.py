"""MAVLink 2 frames in compiled code: the bytes of `framing`, for what is sent at every tick.

A buffer is uint8[n]. Numbers of more than one byte are little-endian, as on the wire.
"""

from __future__ import annotations

import numpy as np

from fcu.kernel.compile import kernel

HEADER, OVERHEAD = 10, 12  # bytes before the payload; and with the checksum behind it
_V2 = 0xFD


_AT_ONCE = 8  # bytes of a checksum: 0.21 us for 249 bytes, where a byte at a time takes 0.89 us


def _tables() -> np.ndarray:
    """uint16[n, 256]: what a byte contributes to the checksum with k bytes behind it, k < n."""
    tables = np.zeros((_AT_ONCE, 256), dtype=np.uint16)
    for byte in range(256):
        x = (byte ^ byte << 4) & 0xFF
        tables[0, byte] = (x << 8 ^ x << 3 ^ x >> 4) & 0xFFFF
    for k in range(1, _AT_ONCE):
        tables[k] = (tables[k - 1] >> 8) ^ tables[0, tables[k - 1] & 0xFF]
    return tables


_CRC = _tables()  # of CRC-16/MCRF4XX


@kernel
def _next(crc, byte):
    """The checksum with one byte more."""
    return (crc >> 8) ^ np.int64(_CRC[0, (crc ^ byte) & 0xFF])


@kernel
def checksum(buffer, first, end, extra):
    """CRC-16/MCRF4XX of buffer[first:end] and the byte `extra`."""
    crc, i = np.int64(0xFFFF), first
    while i + _AT_ONCE <= end:
        ahead = np.int64(_CRC[_AT_ONCE - 1, (crc ^ buffer[np.uintp(i)]) & 0xFF])
        ahead ^= np.int64(_CRC[_AT_ONCE - 2, (crc >> 8) ^ buffer[np.uintp(i + 1)]])
        for k in range(2, _AT_ONCE):
            ahead ^= np.int64(_CRC[_AT_ONCE - 1 - k, buffer[np.uintp(i + k)]])
        crc = ahead
        i += _AT_ONCE
    while i < end:
        crc = _next(crc, buffer[np.uintp(i)])
        i += 1
    return _next(crc, extra)


# An index without a sign is not counted from the end: what is copied by one can be vectorized.


@kernel
def put(buffer, at, value, size):
    """Write an integer as `size` bytes."""
    for i in range(size):
        buffer[np.uintp(at + i)] = (value >> (8 * i)) & 0xFF


@kernel
def get(buffer, at, size):
    """Read an integer of `size` bytes, below 2^63, without a sign."""
    value = np.int64(0)
    for i in range(size):
        value |= np.int64(buffer[np.uintp(at + i)]) << (8 * i)
    return value


@kernel
def copy(source, at, out, first, size):
    """Copy source[at : at + size] to out[first : first + size]."""
    for i in range(size):
        out[np.uintp(first + i)] = source[np.uintp(at + i)]


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
    there = min(end - body, out.size)
    copy(datagram, body, out, 0, there)
    for i in range(there, out.size):
        out[np.uintp(i)] = 0
    return end + 2
