"""What compiled code asks of the operating system: datagrams, what is ready, and the time.

Calls of libc, found by their names, so that compiled code is served from the cache (an address
kept in a ctypes pointer would not be). Every call answers with a negative number when it fails or
would block; why, Python finds out when it makes the call again. Where there is no libc to call,
`HAS_LIBC` is false, and nobody compiles what is below.
"""

from __future__ import annotations

import os
import socket
import time

import numpy as np
from numba import types

from fcu.kernel.compile import kernel

HAS_LIBC = os.name == "posix"
POLLED = np.dtype([("fd", "i4"), ("events", "i2"), ("happened", "i2")])  # struct pollfd

_DO_NOT_WAIT = getattr(socket, "MSG_DONTWAIT", 0)
_MONOTONIC = getattr(time, "CLOCK_MONOTONIC", 0)
_REALTIME = getattr(time, "CLOCK_REALTIME", 0)

_recv = types.ExternalFunction(
    "recv", types.intp(types.int32, types.uintp, types.uintp, types.int32)
)
_send = types.ExternalFunction(
    "send", types.intp(types.int32, types.uintp, types.uintp, types.int32)
)
_poll = types.ExternalFunction("poll", types.int32(types.uintp, types.uintp, types.int32))
_clock_gettime = types.ExternalFunction(
    "clock_gettime", types.int32(types.int32, types.uintp)
)  # fmt: skip


@kernel
def receive(fd, datagram, wait):
    """The next datagram into uint8[n]; its length, or a negative number if there is none.

    wait : block until there is one, for as long as the socket's own time-out.
    """
    flags = np.int32(0) if wait else np.int32(_DO_NOT_WAIT)
    return _recv(np.int32(fd), datagram.ctypes.data, np.uintp(datagram.size), flags)


@kernel
def send(fd, datagram, length):
    """Send the first `length` bytes, without waiting; negative if they have not gone out."""
    return _send(np.int32(fd), datagram.ctypes.data, np.uintp(length), np.int32(_DO_NOT_WAIT))


@kernel
def send_row(fd, row):
    """Send the bytes of a float64[n], without waiting; negative if they have not gone out."""
    return _send(np.int32(fd), row.ctypes.data, np.uintp(8 * row.size), np.int32(_DO_NOT_WAIT))


@kernel
def ready(polled, timeout_ms):
    """How many of the descriptors (POLLED[n], as int64[n]) are ready; negative: interrupted."""
    return _poll(polled.ctypes.data, np.uintp(polled.size), np.int32(timeout_ms))


@kernel
def monotonic(scratch):
    """`time.monotonic`, s.  scratch : int64[2]."""
    _clock_gettime(np.int32(_MONOTONIC), scratch.ctypes.data)
    return scratch[0] + 1e-9 * scratch[1]


@kernel
def since_1970(scratch):
    """`time.time`, s.  scratch : int64[2]."""
    _clock_gettime(np.int32(_REALTIME), scratch.ctypes.data)
    return scratch[0] + 1e-9 * scratch[1]


def polled(*fds: int) -> np.ndarray:
    """What `ready` asks about: whether there is something to read."""
    import select

    rows = np.zeros(len(fds), dtype=POLLED)
    rows["fd"], rows["events"] = fds, getattr(select, "POLLIN", 1)
    return rows.view(np.int64)
