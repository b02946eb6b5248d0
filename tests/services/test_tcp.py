"""MAVLink by TCP: who connects is met, frames are put together, and no client holds another one up."""

from __future__ import annotations

import socket

import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.link import PortBusy
from fcu.mavlink.definitions import message
from fcu.services import tcp_socket
from fcu.services.ground_port import BURST, PEERS, GroundPort
from fcu.services.tcp_socket import ROOM_BYTES, TcpSocket
from tests.patience import PATIENCE_S

SYSTEM = 1


class Met:
    """A port, and the clients that connect to it."""

    def __init__(self):
        self.socket = TcpSocket(0, "test", PEERS)
        self.port = GroundPort(self.socket, None, SYSTEM)
        self.clients = []

    def connect(self):
        client = socket.create_connection(("127.0.0.1", self.socket.port))
        client.settimeout(PATIENCE_S)
        self.clients.append(client)
        return client

    def hear(self, n, now=0.0):
        """Collect the next n messages, with their links."""
        heard = []
        while len(heard) < n:
            heard += self.port.receive(now)
        return heard

    def until(self, condition):
        """Serve the port until a condition holds."""
        while not condition():
            assert not list(self.port.receive(0.0))

    def close(self):
        for client in self.clients:
            client.close()
        self.port.close()


@pytest.fixture
def met():
    made = Met()
    yield made
    made.close()


def ping(sequence):
    mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    return mavlink.MAVLink_ping_message(7, sequence, 0, 0).pack(mav)


def read(client, n):
    """The next n messages that a client reads."""
    mav, messages = mavlink.MAVLink(None), []
    while len(messages) < n:
        received = client.recv(4096)
        assert received
        messages += mav.parse_buffer(bytearray(received)) or []
    return messages


def test_a_connection_hears_telemetry_without_a_word(met):
    client = met.connect()
    met.until(met.port.links)
    met.port.broadcast(message("HEARTBEAT", type=14))
    assert read(client, 1)[0].type == 14


def test_a_frame_in_pieces_is_one_message_and_bytes_before_it_are_none(met):
    client = met.connect()
    frame = b"hello\r\n" + ping(5) + ping(6)
    for at in range(len(frame)):
        client.sendall(frame[at : at + 1])
    (first, link), (second, other) = met.hear(2)
    assert (first.sequence, second.sequence, link) == (5, 6, other)


def test_clients_are_told_apart(met):
    one, another = met.connect(), met.connect()
    met.until(lambda: len(met.port.links()) == 2)
    one.sendall(ping(1))
    ((_, link),) = met.hear(1)
    met.port.send(link, message("HEARTBEAT", type=1))
    another.sendall(ping(2))
    ((_, other),) = met.hear(1)
    met.port.send(other, message("HEARTBEAT", type=2))
    assert (read(one, 1)[0].type, read(another, 1)[0].type) == (1, 2)


def fill(met, link):
    """Send until a client that does not read has no room, and go on for as much again."""
    (connection,) = (c for c in met.socket._connections.values() if c.address == link.address)
    sent = 0
    while connection.full_since is None:
        met.port.send(link, message("ATTITUDE", time_boot_ms=sent))
        sent += 1
        assert sent < 100 * ROOM_BYTES
    for _ in range(sent):
        met.port.send(link, message("ATTITUDE", time_boot_ms=sent))
    return sent


@pytest.mark.computes
def test_a_client_that_does_not_read_loses_whole_messages_and_holds_nobody_up(met):
    slow, quick = met.connect(), met.connect()
    met.until(lambda: len(met.port.links()) == 2)
    slow.sendall(ping(1))
    ((_, link),) = met.hear(1)
    sent = fill(met, link)
    quick.sendall(ping(2))
    ((heard, _),) = met.hear(1)
    assert heard.sequence == 2
    times = [m.time_boot_ms for m in read(slow, sent - 1) if m.get_type() == "ATTITUDE"]
    assert times == list(range(len(times)))  # each whole, none out of its order
    assert len(times) >= sent - 1


def test_a_place_is_for_one_and_free_again_when_its_client_has_gone(met):
    clients = [met.connect() for _ in range(PEERS)]
    met.until(lambda: len(met.port.links()) == PEERS)
    late = met.connect()
    met.until(lambda: not met.socket.is_waiting)
    for _ in range(3):
        list(met.port.receive(0.0))
    assert late.recv(100) == b""  # turned away
    assert len(met.port.links()) == PEERS
    clients[0].close()
    met.until(lambda: len(met.port.links()) == PEERS - 1)
    next_one = met.connect()
    met.until(lambda: len(met.port.links()) == PEERS)
    next_one.sendall(ping(3))
    assert len(met.hear(1)) == 1


@pytest.mark.computes
def test_a_client_that_has_not_read_for_long_is_cut(met, monkeypatch):
    slow, quick = met.connect(), met.connect()
    met.until(lambda: len(met.port.links()) == 2)
    slow.sendall(ping(1))
    ((_, link),) = met.hear(1)
    fill(met, link)
    assert link in met.port.links()
    monkeypatch.setattr(tcp_socket, "STALLED_S", 0.0)
    met.port.send(link, message("ATTITUDE", time_boot_ms=0))
    met.until(lambda: len(met.port.links()) == 1)
    assert link not in met.port.links()
    quick.sendall(ping(2))
    ((heard, _),) = met.hear(1)
    assert heard.sequence == 2


def test_a_flood_of_one_is_bounded_and_another_is_heard(met):
    flood, other = met.connect(), met.connect()
    flood.sendall(b"".join(ping(0) for _ in range(3 * int(BURST))))
    other.sendall(ping(9))
    heard = []
    while not any(m.sequence == 9 for m in heard):
        heard += [m for m, _ in met.port.receive(0.0)]
    while met.port.is_waiting or met.port.dropped["over rate"] < 2 * BURST:
        heard += [m for m, _ in met.port.receive(0.0)]
    assert len(heard) <= BURST + 1


def test_what_is_waiting_is_told_by_the_descriptor_or_by_the_port(met):
    client = met.connect()
    client.sendall(b"".join(map(ping, range(20))))
    heard = []
    while len(heard) < 20:
        if not met.port.is_waiting:
            assert met.socket._selector.select(PATIENCE_S)
        heard += [m.sequence for m, _ in met.port.receive(0.0)]
    assert heard == list(range(20))


def test_a_port_that_another_listens_on_is_busy(met):
    with pytest.raises(PortBusy, match="TCP port"):
        TcpSocket(met.socket.port, "another", PEERS)
