"""Datagrams between processes on this machine: UDP on loopback, and a pair in memory.

Both ends have one face, `Link`. Neither blocks but in `wait`; a datagram that cannot be
delivered is lost, as on any network: whoever needs an answer asks again.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import socket
import struct
import sys
from collections import deque
from typing import Protocol

HOST = "127.0.0.1"
_RECEIVE_BYTES = 4096  # several times the longest datagram here
_STRANGERS_AT_ONCE = 1000
_DO_NOT_WAIT = getattr(socket, "MSG_DONTWAIT", 0)  # Windows has none: there nothing here blocks


class PortBusy(OSError):
    """Another process has the port. `port` and `link` say which."""

    def __init__(self, port: int, link: str) -> None:
        super().__init__(errno.EADDRINUSE, f"UDP port {port} ({link}) is in use by another process")
        self.port = port
        self.link = link


class Link(Protocol):
    """One end of a link."""

    def send(self, datagram: bytes) -> None:
        """Send one datagram, or lose it."""

    def receive(self) -> bytes | None:
        """The next datagram, or None if there is none now."""

    def wait(self, timeout_s: float) -> bool:
        """Block until there is something to receive, at most `timeout_s`; whether there is.

        `receive` may still return None: what woke it can be a peer's refusal.
        """

    def fileno(self) -> int:
        """The file descriptor to select on; -1 where there is none."""

    def close(self) -> None:
        """Give the port back."""


def exclusive_socket(port: int, link: str) -> socket.socket:
    """A UDP socket bound to a loopback port that nobody can share. Raises PortBusy."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows shares by default
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        sock.bind((HOST, port))
    except OSError as error:
        sock.close()
        if error.errno in (errno.EADDRINUSE, errno.EACCES):
            raise PortBusy(port, link) from error
        raise
    return sock


class UdpLink:
    """A UDP socket on loopback.

    With a `peer_port` only that peer is heard and sent to; it need not exist yet. Without
    one, whoever spoke last is the peer. A `bind_port` of 0 takes any free port.

    It is the kernel that tells the peer from strangers, so they cost the peer's datagrams
    neither time nor room. On Linux strangers go to a second socket, where they can be counted.
    """

    def __init__(self, bind_port: int, peer_port: int | None = None, name: str = "link") -> None:
        """`name` is what PortBusy calls the link. Raises PortBusy."""
        self._socket = exclusive_socket(bind_port, name)
        self._socket.setblocking(False)
        self._connected = peer_port is not None
        self._peer: tuple[str, int] | None = None
        if peer_port is not None:
            self._socket.connect((HOST, peer_port))
        self._elsewhere = self._beside() if self._connected else None
        self._strangers = 0

    def _beside(self) -> socket.socket | None:
        """A socket on the same port, to which goes what is not from the peer; Linux only.

        The port is shared for the moment of binding; then again nobody can share it.
        """
        if sys.platform != "linux":
            return None
        beside = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        beside.setblocking(False)
        both = (self._socket, beside)
        for sock in both:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        beside.bind((HOST, self.port))
        for sock in both:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)
        return beside

    def count_strangers(self) -> int:
        """Datagrams so far from others than the peer: dropped, and never received.

        Takes in what has come since the last call, but no more than the kernel kept.
        """
        if self._elsewhere is not None:
            with contextlib.suppress(BlockingIOError):
                for _ in range(_STRANGERS_AT_ONCE):
                    self._elsewhere.recv(1)
                    self._strangers += 1
        return self._strangers

    @property
    def port(self) -> int:
        """The port it is bound to."""
        bound: int = self._socket.getsockname()[1]
        return bound

    def send(self, datagram: bytes) -> None:
        """Send one datagram to the peer; lost if there is no peer, or no room."""
        try:
            self._send(datagram)
        except ConnectionRefusedError:
            # What raised is the refusal of an earlier datagram; this one has not gone out.
            with contextlib.suppress(ConnectionRefusedError, BlockingIOError):
                self._send(datagram)
        except BlockingIOError:
            pass

    def _send(self, datagram: bytes) -> None:
        if self._connected:
            self._socket.send(datagram, _DO_NOT_WAIT)
        elif self._peer is not None:
            self._socket.sendto(datagram, _DO_NOT_WAIT, self._peer)

    def receive(self) -> bytes | None:
        """The next datagram, or None if there is none now."""
        try:
            if self._connected:
                return self._socket.recv(_RECEIVE_BYTES, _DO_NOT_WAIT)
            datagram, self._peer = self._socket.recvfrom(_RECEIVE_BYTES, _DO_NOT_WAIT)
            return datagram
        except BlockingIOError:
            return None
        except (ConnectionRefusedError, ConnectionResetError):
            return self.receive()  # the peer was not up when we last sent; what is behind it?

    def wait(self, timeout_s: float) -> bool:
        """Block until there may be something to receive, at most `timeout_s`."""
        return bool(select.select((self._socket,), (), (), timeout_s)[0])

    def let_wait(self, timeout_s: float) -> None:
        """Let compiled code block on the descriptor for a datagram, at most `timeout_s`; POSIX only.

        What is called here still does not block.
        """
        seconds, left = divmod(timeout_s, 1.0)
        timeout = struct.pack("ll", int(seconds), int(1e6 * left))  # struct timeval
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeout)
        os.set_blocking(self._socket.fileno(), True)

    def fileno(self) -> int:
        """The socket's file descriptor; -1 once closed."""
        return self._socket.fileno()

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()
        if self._elsewhere is not None:
            self._elsewhere.close()


class MemoryLink:
    """One end of a pair in memory, for tests in one process: never loses, never waits."""

    def __init__(self, inbox: deque[bytes], outbox: deque[bytes]) -> None:
        self._inbox = inbox
        self._outbox = outbox

    def send(self, datagram: bytes) -> None:
        """Put one datagram in the other end's inbox."""
        self._outbox.append(datagram)

    def receive(self) -> bytes | None:
        """The next datagram, or None if there is none."""
        return self._inbox.popleft() if self._inbox else None

    def wait(self, timeout_s: float) -> bool:
        """Whether there is something to receive. Does not wait: nobody else could send."""
        return bool(self._inbox)

    def fileno(self) -> int:
        """-1: there is none."""
        return -1

    def close(self) -> None:
        """Forget what was not received."""
        self._inbox.clear()


def memory_pair() -> tuple[MemoryLink, MemoryLink]:
    """Two ends, each receiving what the other sends."""
    here: deque[bytes] = deque()
    there: deque[bytes] = deque()
    return MemoryLink(here, there), MemoryLink(there, here)
