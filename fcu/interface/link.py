"""Datagrams between processes on this machine: UDP on loopback, and ports in memory.

Both kinds have one face, `Link`. Neither blocks but in `wait`; a datagram that cannot be
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
import time
from collections import deque
from pathlib import Path
from typing import Protocol

Address = tuple[str, int]

HOST = "127.0.0.1"
_RECEIVE_BYTES = 4096  # several times the longest datagram here
_STRANGERS_AT_ONCE = 1000
_MEMORY_ROOM = 1024  # datagrams that wait at a port in memory: about what a socket holds
_MEMORY_MOMENT_S = 1e-4  # wall: who waits in memory looks so often
_DO_NOT_WAIT = getattr(socket, "MSG_DONTWAIT", 0)  # Windows has none: there nothing here blocks
_IP_RECVERR = 11  # linux/in.h
_OF_ERRORS = getattr(socket, "MSG_ERRQUEUE", 0)


class PortBusy(OSError):
    """Another process has the port. `port` and `link` say which."""

    def __init__(self, port: int, link: str, kind: str = "UDP") -> None:
        text = f"{kind} port {port} ({link}) is in use by another process"
        super().__init__(errno.EADDRINUSE, text)
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


def listening_socket(port: int, link: str) -> socket.socket:
    """A TCP socket bound to a loopback port, to listen on. Raises PortBusy."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        if os.name == "posix":  # a port whose last connections are still winding up is free
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((HOST, port))
        sock.listen()
    except OSError as error:
        sock.close()
        if error.errno in (errno.EADDRINUSE, errno.EACCES):
            raise PortBusy(port, link, "TCP") from error
        raise
    return sock


def bound_ports() -> set[int] | None:
    """The UDP ports on loopback that are bound, by the kernel's table; None where it has none (Linux has).

    Nobody who is about to bind one of them notices.
    """
    try:
        lines = Path("/proc/net/udp").read_text().splitlines()[1:]
    except OSError:
        return None
    locals_ = (line.split()[1].split(":") for line in lines)
    ours = {socket.inet_aton(address) for address in (HOST, "0.0.0.0")}
    return {int(port, 16) for ip, port in locals_ if struct.pack("=I", int(ip, 16)) in ours}


def hear_refusals(sock: Datagrams) -> bool:
    """Have the kernel keep which addresses refuse what is sent to them; whether it does: Linux."""
    if not isinstance(sock, socket.socket) or sys.platform != "linux":
        return False
    sock.setsockopt(socket.IPPROTO_IP, _IP_RECVERR, 1)
    return True


def refusals(sock: Datagrams) -> list[Address]:
    """The addresses that have refused a datagram since the last call: nobody has these ports.

    `sock`: one for which `hear_refusals` is true.
    """
    assert isinstance(sock, socket.socket)
    found: list[Address] = []
    try:
        while True:
            found.append(sock.recvmsg(0, 0, _OF_ERRORS | _DO_NOT_WAIT)[3])
    except OSError:  # there is no more
        return found


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
        """A second socket on the same port, which receives packets from anyone but the peer (Linux only).

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


class Datagrams(Protocol):
    """A bound socket, as far as it is used here: a UDP socket, or one in memory."""

    def recvfrom(self, size: int, /) -> tuple[bytes, Address]:
        """The next datagram, and who sent it. Raises BlockingIOError when there is none."""

    def sendto(self, datagram: bytes, address: Address, /) -> int:
        """Send one datagram."""

    def setblocking(self, flag: bool, /) -> None:
        """Whether `recvfrom` waits."""

    def fileno(self) -> int:
        """The file descriptor to select on; -1 where there is none."""

    def close(self) -> None:
        """Give the port back."""


class MemoryNetwork:
    """Ports that only this process can reach: for a vehicle and its ground script in one process."""

    def __init__(self) -> None:
        self._sockets: dict[int, MemorySocket] = {}

    def socket(self, port: int, link: str) -> MemorySocket:
        """What `exclusive_socket` gives, in memory. Raises PortBusy."""
        if port in self._sockets:
            raise PortBusy(port, link)
        made = self._sockets[port] = MemorySocket(self, port)
        return made

    def link(self, port: int, peer_port: int, link: str) -> MemoryLink:
        """What `UdpLink` is, in memory. Raises PortBusy."""
        return MemoryLink(self.socket(port, link), (HOST, peer_port))

    def deliver(self, datagram: bytes, sender: int, port: int) -> None:
        """Lost when nobody has the port, or has room."""
        receiver = self._sockets.get(port)
        if receiver is not None and len(receiver.inbox) < _MEMORY_ROOM:
            receiver.inbox.append((datagram, (HOST, sender)))

    def release(self, port: int) -> None:
        """Give a port back."""
        self._sockets.pop(port, None)


class MemorySocket:
    """A port of a MemoryNetwork; it never waits."""

    def __init__(self, network: MemoryNetwork, port: int) -> None:
        self._network = network
        self._port = port
        self.inbox: deque[tuple[bytes, Address]] = deque()

    def recvfrom(self, _size: int, /) -> tuple[bytes, Address]:
        """The next datagram, and who sent it. Raises BlockingIOError when there is none."""
        if not self.inbox:
            raise BlockingIOError
        return self.inbox.popleft()

    def sendto(self, datagram: bytes, address: Address, /) -> int:
        """Send one datagram."""
        self._network.deliver(datagram, self._port, address[1])
        return len(datagram)

    def setblocking(self, _flag: bool, /) -> None:
        """Nothing here waits."""

    def fileno(self) -> int:
        """-1: there is none."""
        return -1

    def close(self) -> None:
        """Give the port back."""
        self.inbox.clear()
        self._network.release(self._port)


class MemoryLink:
    """A MemorySocket and one peer: a `Link`."""

    def __init__(self, own: MemorySocket, peer: Address) -> None:
        self._socket = own
        self._peer = peer

    def send(self, datagram: bytes) -> None:
        """Send one datagram to the peer; lost if there is no peer, or no room."""
        self._socket.sendto(datagram, self._peer)

    def receive(self) -> bytes | None:
        """The next datagram of the peer, or None if there is none now."""
        while self._socket.inbox:
            datagram, sender = self._socket.inbox.popleft()
            if sender == self._peer:
                return datagram
        return None

    def wait(self, timeout_s: float) -> bool:
        """Whether there is something to receive; if not, a moment has passed."""
        if not self._socket.inbox and timeout_s > 0.0:
            time.sleep(min(timeout_s, _MEMORY_MOMENT_S))
        return bool(self._socket.inbox)

    def fileno(self) -> int:
        """-1: there is none."""
        return -1

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()
