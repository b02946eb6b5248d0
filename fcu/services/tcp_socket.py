"""MAVLink by TCP: the connections of scripts, with the face of a bound UDP socket.

A frame that has come whole is a datagram, and the address of the script's end says whose it is. Nothing
here waits for a client. A message for which a connection has no room is left out whole, as UDP leaves it
out: a script that reads nothing for a while keeps its connection and holds nobody up. A connection that has
not read for STALLED_S is cut. While all places are taken, a new connection is turned away.
"""

from __future__ import annotations

import selectors
import socket
import time
from collections import deque

from fcu.interface.link import Address, listening_socket
from fcu.mavlink.framing import next_frame

STALLED_S = 10.0  # wall
ROOM_BYTES = 1 << 18  # of messages that a client has not read yet
_AT_ONCE_BYTES = 4096  # read of one connection at a time

# The selector has a descriptor of its own, which a poll can wait for, on Linux and BSD.
AVAILABLE = hasattr(selectors.DefaultSelector, "fileno")


class _Connection:
    def __init__(self, sock: socket.socket, address: Address) -> None:
        self.socket = sock
        self.address = address
        self.received = bytearray()
        self.unsent = b""  # the rest of a message of which a part has gone out
        self.full_since: float | None = None  # wall: since when there has been no room


class TcpSocket:
    """A listening port and its connections."""

    def __init__(self, port: int, link: str, places: int) -> None:
        """`places`: how many connections there may be. Raises PortBusy."""
        self._listening = listening_socket(port, link)
        self._listening.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ROOM_BYTES)
        self._listening.listen(places)
        self._listening.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listening, selectors.EVENT_READ, None)
        self._places = places
        self._connections: dict[Address, _Connection] = {}
        self._unread: deque[_Connection] = deque()  # in whose bytes there may be a whole frame
        self._arrived: deque[Address] = deque()
        self._gone: list[Address] = []

    @property
    def is_waiting(self) -> bool:
        """True if `recvfrom` may have something of which the descriptor does not tell."""
        return bool(self._unread or self._arrived or self._gone)

    def recvfrom(self, _size: int, /) -> tuple[bytes, Address]:
        """The next frame and its sender. An empty frame: a new connection.

        Raises BlockingIOError when there is none, and ConnectionResetError when somebody has gone.
        """
        if not self.is_waiting:
            self._take_in()
        if self._gone:  # before an arrival, which may have its place
            raise ConnectionResetError
        if self._arrived:
            return b"", self._arrived.popleft()
        while self._unread:
            connection = self._unread.popleft()
            frame = next_frame(connection.received)
            if frame is not None:
                self._unread.append(connection)
                return frame, connection.address
        raise BlockingIOError

    def _take_in(self) -> None:
        for key, _ in self._selector.select(0):
            if key.data is None:
                self._accept()
            else:
                self._read(key.data)

    def _accept(self) -> None:
        try:
            sock, address = self._listening.accept()
        except OSError:  # who came has gone again
            return
        if len(self._connections) >= self._places:
            sock.close()
            return
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection = self._connections[address] = _Connection(sock, address)
        self._selector.register(sock, selectors.EVENT_READ, connection)
        self._arrived.append(address)

    def _read(self, connection: _Connection) -> None:
        try:
            received = connection.socket.recv(_AT_ONCE_BYTES)
        except BlockingIOError:
            return
        except OSError:
            received = b""
        if not received:
            self._cut(connection)
            return
        connection.received += received
        self._unread.append(connection)

    def _cut(self, connection: _Connection) -> None:
        self._selector.unregister(connection.socket)
        connection.socket.close()
        connection.received.clear()
        del self._connections[connection.address]
        self._gone.append(connection.address)

    def refusals(self) -> list[Address]:
        """The connections that have closed since the last call."""
        gone, self._gone = self._gone, []
        return gone

    def sendto(self, datagram: bytes, address: Address, /) -> int:
        """Send a message whole, or leave it out. Raises ConnectionRefusedError if nobody is there."""
        connection = self._connections.get(address)
        if connection is None:
            raise ConnectionRefusedError
        try:
            if connection.unsent:
                sent = connection.socket.send(connection.unsent)
                connection.unsent = connection.unsent[sent:]
            if not connection.unsent:
                sent = connection.socket.send(datagram)
                connection.unsent = datagram[sent:]
            if not connection.unsent:
                connection.full_since = None
                return len(datagram)
        except BlockingIOError:
            pass
        except OSError:
            self._cut(connection)
            raise ConnectionRefusedError from None
        now = time.monotonic()
        if connection.full_since is None:
            connection.full_since = now
        elif now - connection.full_since > STALLED_S:
            self._cut(connection)
            raise ConnectionRefusedError
        return len(datagram)

    def setblocking(self, _flag: bool, /) -> None:
        """Nothing here waits."""

    def fileno(self) -> int:
        """A descriptor that is readable when there is something to take in."""
        number: int = self._selector.fileno()
        return number

    @property
    def port(self) -> int:
        """The port that is listened on."""
        number: int = self._listening.getsockname()[1]
        return number

    def close(self) -> None:
        """Give the port back, and end every connection."""
        for connection in list(self._connections.values()):
            self._cut(connection)
        self._selector.close()
        self._listening.close()
