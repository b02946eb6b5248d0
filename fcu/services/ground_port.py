"""A port at which ground stations and scripts meet the vehicle, and each of their links.

Telemetry goes to one configured address from the start (ground tools listen, they do not ask)
and to whoever has sent a heartbeat. Whoever sends anything readable gets answers. Every message is
a datagram of its own: clients read with buffers of 300 to 512 bytes, and lose what does not fit.
Nobody can take more of the loop's time than AT_ONCE_S, nor the place of one who still beats: when
all are taken, a newcomer is answered and no more. The listener and those who beat are read in turns,
a datagram each, and all others have one turn together: a flood keeps nobody else waiting for long.
A client that has sent MAVLink 1 alone is answered in MAVLink 1, without the messages that it cannot carry.
What a client has asked for ends with it: when its port refuses a datagram, or when it has beaten and
was silent for GONE_S.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Iterator
from typing import NamedTuple

from fcu.interface.link import HOST, Address, Datagrams, hear_refusals, refusals
from fcu.mavlink.definitions import Packed, Result
from fcu.mavlink.ground_link import GroundCodec, GroundMessage
from fcu.mavlink.plan_messages import PlanItem
from fcu.mavlink.telemetry import Heartbeat
from fcu.services.tcp_socket import TcpSocket

PEERS = 8  # beside the configured listener
GONE_S = 10.0  # wall: one who has not been heard for so long may be replaced
AT_ONCE_S = 0.3e-3  # wall: between two ticks a port takes so long, and the message in hand
TAKING_IN = 0.5  # part of that: how long datagrams are put where they wait for their turn
RATE, BURST = 2000.0, 400.0  # datagrams of one sender a second, wall; and at once
WAITING_BYTES = 1 << 17  # of datagrams of one sender that wait for their turn
_LONGEST = 65535


class Bucket:
    """So much a second, so much at once, of a clock that a reset may set back, s."""

    def __init__(self, rate: float, burst: float) -> None:
        self._rate, self._burst, self._left, self._at = rate, burst, burst, 0.0

    def take(self, now: float) -> bool:
        """Take one: False if there is none left."""
        passed = max(now - self._at, 0.0)
        self._left = min(self._burst, self._left + passed * self._rate)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Queue:
    """Datagrams of one sender, or of all strangers, that wait for their turn."""

    def __init__(self) -> None:
        self._datagrams: deque[tuple[bytes, Address]] = deque()
        self._bytes = 0
        self.senders: Counter[Address] = Counter()  # how many of each

    def __len__(self) -> int:
        return len(self._datagrams)

    def put(self, datagram: bytes, address: Address) -> bool:
        """Whether there is room for one more."""
        if len(self._datagrams) >= BURST or self._bytes + len(datagram) > WAITING_BYTES:
            return False
        self._datagrams.append((datagram, address))
        self._bytes += len(datagram)
        self.senders[address] += 1
        return True

    def get(self) -> tuple[bytes, Address]:
        """The first of them."""
        datagram, address = self._datagrams.popleft()
        self._bytes -= len(datagram)
        self.senders[address] -= 1
        if not self.senders[address]:
            del self.senders[address]
        return datagram, address


class Acknowledged(NamedTuple):
    """A command that was carried out or refused, in case it is repeated."""

    command: int
    asked: bytes  # by whom, with which parameters
    confirmation: int  # 0 of a first transmission
    result: Result
    at: float


class Link:
    """One conversation: with its own sequence numbers, streams and state of services."""

    def __init__(self, address: Address, codec: GroundCodec, now: float) -> None:
        self.address = address
        self.codec = codec
        self.hears_telemetry = False
        self.has_rates = False
        self.streams: dict[int, list[float]] = {}  # message id: interval, next due (s)
        self.list_at: int | None = None  # the next parameter of a list that is being sent
        self.list_due = 0.0
        self.acknowledged: list[Acknowledged] = []  # the last few, the newest first
        self.downloads: dict[int, tuple[PlanItem, ...]] = {}  # of plans: what its list was of
        self.told: set[str] = set()  # of which messages it was told that they are not taken
        self.beats = False  # has sent a heartbeat
        self.is_met = False  # has sent anything since it was new
        self.has_v2 = False  # has sent MAVLink 2 since it was new
        self.heard = now
        self.spoken = Bucket(RATE, BURST)
        self.unread = Queue()

    def renew(self) -> None:
        """Whoever was there has gone: the next one finds what they would find on a new link."""
        self.has_rates = self.beats = self.is_met = self.has_v2 = False
        self.codec.speaks_v1 = False
        self.streams = {}
        self.list_at = None
        self.acknowledged = []
        self.downloads = {}
        self.told = set()


class GroundPort:
    """One bound port, its configured listener and its peers."""

    def __init__(
        self, bound: Datagrams | TcpSocket, listener_port: int | None, system_id: int
    ) -> None:
        """`bound`: the socket, which is closed with this. `listener_port`: None without a listener."""
        self._socket = bound
        self._socket.setblocking(False)
        self._by_tcp = bound if isinstance(bound, TcpSocket) else None
        self._hears_refusals = self._by_tcp is not None or hear_refusals(bound)
        self._system = system_id
        self._parser = GroundCodec(system_id)
        self.listener = Link((HOST, listener_port or 0), GroundCodec(system_id), 0.0)
        self.listener.hears_telemetry = listener_port is not None
        self._peers: dict[Address, Link] = {}  # the least recent first
        self._strangers = Queue()
        self._turns: deque[Queue] = deque()  # those in which something waits, the next first
        self._waiting: deque[tuple[GroundMessage, Link]] = deque()  # of the last datagram
        self.dropped = self._parser.dropped  # by reason; also `over rate`
        self.heard = 0  # messages that were readable

    def fileno(self) -> int:
        """For poll."""
        return self._socket.fileno()

    @property
    def is_waiting(self) -> bool:
        """Whether there are messages to `receive`, of which `poll` does not know."""
        by_tcp = self._by_tcp is not None and self._by_tcp.is_waiting
        return bool(self._waiting or self._turns or by_tcp)

    def receive(self, now: float) -> Iterator[tuple[GroundMessage, Link]]:
        """Messages that are waiting, with their links, for at most AT_ONCE_S and one message more.

        The time is that of whoever takes them, too. What is left waits for the next call.
        """
        began = time.monotonic()
        until = began + AT_ONCE_S
        while self._take_in(now) and time.monotonic() < began + TAKING_IN * AT_ONCE_S:
            pass
        while self._waiting or self._read(now):
            if self._waiting:
                yield self._waiting.popleft()
            if time.monotonic() >= until:
                return

    def _take_in(self, now: float) -> bool:
        """Put a datagram where it waits for its turn; whether there was one."""
        try:
            datagram, address = self._socket.recvfrom(_LONGEST)
        except BlockingIOError:
            return False
        except OSError:  # a peer's port is closed: an ICMP refusal, not a datagram
            self._see_refusals()
            return True
        if self._by_tcp is not None and not datagram:  # a client that connects may only listen
            self._meet(address, now).hears_telemetry = True
            return True
        known = self._known(address)
        is_stranger = known is None or not known.hears_telemetry
        if (
            is_stranger or address in self._strangers.senders
        ):  # what it has sent first is read first
            queue = self._strangers
        else:
            assert known is not None
            queue = known.unread
        is_first = not queue
        if (known is not None and not known.spoken.take(now)) or not queue.put(datagram, address):
            self.dropped["over rate"] += 1
        elif is_first:
            self._turns.append(queue)
        return True

    def _known(self, address: Address) -> Link | None:
        return self.listener if address == self.listener.address else self._peers.get(address)

    def _read(self, now: float) -> bool:
        """Take the messages of the datagram whose turn it is; whether there was one."""
        if not self._turns:
            return False
        queue = self._turns.popleft()
        datagram, address = queue.get()
        if queue:
            self._turns.append(queue)
        messages = self._parser.parse(datagram)
        if not messages:
            return True
        self.heard += len(messages)
        link = self._known(address) or self._meet(address, now)
        if self._by_tcp is None and link.beats and now - link.heard > GONE_S:
            link.renew()
        if any(isinstance(message, Heartbeat) for message in messages):
            link.hears_telemetry = link.beats = True
        if self._parser.heard == 2:
            link.has_v2, link.codec.speaks_v1 = True, False
        elif not link.has_v2:
            link.codec.speaks_v1 = True
        link.heard, link.is_met = now, True
        self._waiting.extend((message, link) for message in messages)
        if address in self._peers:  # the most recent is the last to go
            self._peers[address] = self._peers.pop(address)
        return True

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

    def links(self) -> list[Link]:
        """Those that hear telemetry: the listener, and proven peers."""
        return [link for link in self.everyone() if link.hears_telemetry]

    def everyone(self) -> list[Link]:
        """The listener and all peers."""
        return [self.listener, *self._peers.values()]

    def send(self, link: Link, *messages: Packed) -> None:
        """To one link, a datagram a message, one right after the other; lost if nobody is there."""
        for datagram in filter(None, [link.codec.framed(message) for message in messages]):
            # an earlier datagram was refused, not this one: here, or at another's port
            if not self._send(datagram, link.address) and (
                link.address in self._see_refusals() or not self._send(datagram, link.address)
            ):
                return
        if messages:
            self._see_refusals()

    def broadcast(self, *messages: Packed) -> None:
        """To everyone who hears telemetry."""
        for link in self.links():
            self.send(link, *messages)

    def _send(self, datagram: bytes, address: Address) -> bool:
        """Whether it has gone out."""
        try:
            self._socket.sendto(datagram, address)
        except ConnectionRefusedError:
            return False
        except OSError:  # no room
            pass
        return True

    def _see_refusals(self) -> list[Address]:
        """Forget who is gone; the addresses whose ports have refused something."""
        if not self._hears_refusals:
            return []
        gone = refusals(self._socket) if self._by_tcp is None else self._by_tcp.refusals()
        for address in gone:
            if address == self.listener.address:
                if self.listener.is_met:
                    self.listener.renew()
            else:
                self._peers.pop(address, None)
        return gone

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()
