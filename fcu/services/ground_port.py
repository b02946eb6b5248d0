"""A UDP port at which ground stations and scripts meet the vehicle, and each of their links.

Telemetry goes to one configured address from the start (ground tools listen, they do not ask)
and to whoever has sent a heartbeat. Whoever sends anything readable gets answers. Nobody can
take more of the loop's time than the budget, nor the place of one who still beats: when all are
taken, a newcomer is answered and no more.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from fcu.interface.link import HOST, Address, Datagrams
from fcu.mavlink.definitions import Packed, Result
from fcu.mavlink.ground_link import GroundCodec, GroundMessage
from fcu.mavlink.telemetry import Heartbeat

PEERS = 8  # beside the configured listener
GONE_S = 10.0  # wall: one who has not been heard for so long may be replaced
BUDGET = 32  # datagrams read at one go
RATE, BURST = 2000.0, 400.0  # datagrams of one sender a second, wall; and at once
_LONGEST = 65535
_FULL = 1400  # bytes of a datagram that messages are gathered in


class Bucket:
    """So much a second, so much at once; wall time."""

    def __init__(self, rate: float, burst: float) -> None:
        self._rate, self._burst, self._left, self._at = rate, burst, burst, 0.0

    def take(self, now: float) -> bool:
        """Whether there is one more."""
        self._left = min(self._burst, self._left + (now - self._at) * self._rate)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Acknowledged(NamedTuple):
    """A command that was carried out or refused, in case it is repeated."""

    command: int
    asked: bytes  # by whom, with which parameters
    result: Result
    at: float


class Link:
    """One conversation: with its own sequence numbers, streams and state of services."""

    def __init__(self, address: Address, codec: GroundCodec, now: float) -> None:
        self.address = address
        self.codec = codec
        self.hears_telemetry = False
        self.is_greeted = False
        self.has_rates = False
        self.streams: dict[int, list[float]] = {}  # message id: interval, next due (s)
        self.list_at: int | None = None  # the next parameter of a list that is being sent
        self.list_due = 0.0
        self.acknowledged: list[Acknowledged] = []  # the last few, the newest first
        self.heard = now
        self.spoken = Bucket(RATE, BURST)


class GroundPort:
    """One bound port, its configured listener and its peers."""

    def __init__(self, bound: Datagrams, listener_port: int, system_id: int) -> None:
        """`bound`: the socket, which is closed with this."""
        self._socket = bound
        self._socket.setblocking(False)
        self._system = system_id
        self._parser = GroundCodec(system_id)
        self.listener = Link((HOST, listener_port), GroundCodec(system_id), 0.0)
        self.listener.hears_telemetry = True
        self._peers: dict[Address, Link] = {}  # the least recent first
        self.dropped = self._parser.dropped  # by reason; also `over rate`

    def fileno(self) -> int:
        """For poll."""
        return self._socket.fileno()

    def receive(self, now: float) -> Iterator[tuple[GroundMessage, Link]]:
        """Messages that are waiting, with their links; at most BUDGET datagrams of them."""
        for _ in range(BUDGET):
            try:
                datagram, address = self._socket.recvfrom(_LONGEST)
            except BlockingIOError:
                return
            except OSError:  # a peer's port is closed: an ICMP refusal, not a datagram
                continue
            known = self.listener if address == self.listener.address else self._peers.get(address)
            if known is not None and not known.spoken.take(now):
                self.dropped["over rate"] += 1
                continue
            messages = self._parser.parse(datagram)
            if not messages:
                continue
            link = known or self._meet(address, now)
            for message in messages:
                if isinstance(message, Heartbeat) and not link.hears_telemetry:
                    link.hears_telemetry = True
                yield message, link
            link.heard = now
            if address in self._peers:  # the most recent is the last to go
                self._peers[address] = self._peers.pop(address)

    def _meet(self, address: Address, now: float) -> Link:
        """A new peer: in place of a stranger, or of one who is gone, if the table is full."""
        link = Link(address, GroundCodec(self._system), now)
        if len(self._peers) >= PEERS:
            places = (
                a for a, peer in self._peers.items()
                if not peer.hears_telemetry or now - peer.heard > GONE_S
            )  # fmt: skip
            place = next(places, None)
            if place is None:
                self.dropped["no place"] += 1
                return link
            del self._peers[place]
        self._peers[address] = link
        return link

    def links(self) -> Iterator[Link]:
        """Those that hear telemetry: the listener, and proven peers."""
        yield self.listener
        yield from (link for link in self._peers.values() if link.hears_telemetry)

    def everyone(self) -> list[Link]:
        """The listener and all peers."""
        return [self.listener, *self._peers.values()]

    def send(self, link: Link, *messages: Packed) -> None:
        """To one link, as few datagrams as they fit in; lost if nobody is there."""
        datagram = b""
        for message in messages:
            frame = link.codec.framed(message)
            if len(datagram) + len(frame) > _FULL:
                self._send(datagram, link.address)
                datagram = b""
            datagram += frame
        if datagram:
            self._send(datagram, link.address)

    def broadcast(self, *messages: Packed) -> None:
        """To everyone who hears telemetry."""
        for link in self.links():
            self.send(link, *messages)

    def _send(self, datagram: bytes, address: Address) -> None:
        try:
            self._socket.sendto(datagram, address)
        except OSError:
            pass

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()
