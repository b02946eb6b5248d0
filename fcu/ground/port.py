"""A UDP port at which ground stations and scripts meet the vehicle.

Telemetry goes to one configured address from the start (ground tools listen, they do not
ask) and to whoever has sent something readable, the most recent few.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator

from fcu.interface.ground_messages import GroundMessage
from fcu.interface.ground_wire import GroundCodec
from fcu.interface.link import HOST, exclusive_socket

Address = tuple[str, int]

PEERS = 8
BUDGET = 32  # datagrams read at one go: a flood must not hold up the loop
_LONGEST = 65535


class GroundPort:
    """One bound port, its configured listener and its recent peers."""

    def __init__(self, bind_port: int, listener_port: int, system_id: int, name: str) -> None:
        """Raises PortBusy, naming the port and `name`."""
        self._socket = exclusive_socket(bind_port, name)
        self._socket.setblocking(False)
        self._listener: Address = (HOST, listener_port)
        self._peers: OrderedDict[Address, None] = OrderedDict()
        self.codec = GroundCodec(system_id)

    def fileno(self) -> int:
        """For poll."""
        return self._socket.fileno()

    def receive(self) -> Iterator[tuple[GroundMessage, Address]]:
        """Messages that are waiting, with their senders; at most BUDGET datagrams of them."""
        for _ in range(BUDGET):
            try:
                datagram, address = self._socket.recvfrom(_LONGEST)
            except BlockingIOError:
                return
            except OSError:  # a peer's port is closed: an ICMP refusal, not a datagram
                continue
            messages = self.codec.parse(datagram)
            if messages and address != self._listener:
                self._peers[address] = None
                self._peers.move_to_end(address)
                if len(self._peers) > PEERS:
                    self._peers.popitem(last=False)
            for message in messages:
                yield message, address

    def broadcast(self, datagram: bytes) -> None:
        """To the listener and every recent peer."""
        self.send(datagram, self._listener)
        for address in self._peers:
            self.send(datagram, address)

    def send(self, datagram: bytes, address: Address) -> None:
        """To one address; lost if nobody is there."""
        try:
            self._socket.sendto(datagram, address)
        except OSError:
            pass

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()
