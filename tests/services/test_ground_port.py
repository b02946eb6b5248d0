"""A port of ground stations: what it sends to whom, who is there, and how long it may read."""

from __future__ import annotations

import socket

import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.link import MemoryNetwork, exclusive_socket
from fcu.mavlink.definitions import message
from fcu.services import ground_port
from fcu.services.ground_port import GONE_S, Bucket, GroundPort

SYSTEM = 1


@pytest.fixture
def client():
    """`client()`: a socket on a port of its own; `client(port)`: on that one."""
    opened = []

    def one(port=0):
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.bind(("127.0.0.1", port))
        sock.setblocking(False)
        opened.append(sock)
        return sock

    yield one
    for each in opened:
        each.close()


@pytest.fixture
def port(client):
    """A port, and its listener."""
    listener = client()
    made = GroundPort(exclusive_socket(0, "test"), listener.getsockname()[1], SYSTEM)
    yield made, listener
    made.close()


def said(message, system=255):
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
    return message.pack(mav)


BEAT = said(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
PING = said(mavlink.MAVLink_ping_message(7, 7, 0, 0))


def speak(port, sock, datagram, now=0.0):
    sock.sendto(datagram, ("127.0.0.1", port._socket.getsockname()[1]))
    return list(port.receive(now))


V1_BEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(
    mavlink.MAVLink(None, srcSystem=255, srcComponent=190), force_mavlink1=True
)


def versions(port, link, sock):
    """The first bytes of two messages that are sent to a link: HEARTBEAT, and one beyond MAVLink 1."""
    port.send(link, message("HEARTBEAT"), message("CURRENT_MODE"))
    return [sock.recv(300)[0] for _ in range(2 if not link.codec.speaks_v1 else 1)]


def test_a_client_of_mavlink_1_is_answered_in_it_until_its_first_mavlink_2(port, client):
    made, listener = port
    sock = client()
    ((_, link),) = speak(made, sock, V1_BEAT)
    assert versions(made, link, sock) == [0xFE]
    with pytest.raises(BlockingIOError):
        sock.recv(300)  # CURRENT_MODE, 436, was left out
    assert versions(made, made.listener, listener) == [0xFD, 0xFD]  # has sent nothing
    speak(made, sock, BEAT)
    assert versions(made, link, sock) == [0xFD, 0xFD]
    speak(made, sock, V1_BEAT)
    assert versions(made, link, sock) == [0xFD, 0xFD]  # it has shown that it reads them


def test_a_newcomer_on_a_port_that_was_left_finds_a_new_link(port, client):
    made, _ = port
    sock = client()
    ((_, link),) = speak(made, sock, BEAT)
    speak(made, sock, V1_BEAT, now=GONE_S + 1.0)
    assert versions(made, link, sock) == [0xFE]


@pytest.mark.parametrize("size", [296, 512])
def test_a_client_with_a_short_buffer_loses_nothing(port, size):
    """296: MAVROS (libmavconn, `MsgBuffer::MAX_SIZE`); 512: gomavlib (`bufferSize`)."""
    made, listener = port
    sent = [
        *[message("PARAM_VALUE", param_id=b"MR_GAMMA", param_index=i) for i in range(11)],
        *[message("DEBUG_FLOAT_ARRAY", data=[1.0] * 58) for _ in range(11)],
    ]
    made.send(made.listener, *sent)
    parser = mavlink.MAVLink(None)
    heard = []
    for _ in sent:
        heard += parser.parse_buffer(listener.recv(size))
    assert [m.get_seq() for m in heard] == list(range(22))
    with pytest.raises(BlockingIOError):
        listener.recv(size)


def test_what_a_client_has_asked_for_ends_when_its_port_is_closed(port, client):
    made, listener = port
    speak(made, listener, BEAT)
    made.listener.has_rates, made.listener.streams = True, {30: [1.0, 0.0]}
    made.send(made.listener, message("PING"))
    assert made.listener.streams  # it is there
    number = listener.getsockname()[1]
    listener.close()
    made.send(made.listener, message("PING"))
    after = client(number)
    assert not made.listener.has_rates
    assert not made.listener.streams
    made.send(made.listener, message("PING"))
    assert after.recv(512)


def test_a_peer_whose_port_is_closed_has_no_place_any_more(port, client):
    made, _ = port
    peer, other = client(), client()
    speak(made, peer, BEAT)
    speak(made, other, BEAT)
    peer.close()
    made.broadcast(message("PING"), message("PING"))
    made.broadcast(message("PING"), message("PING"))
    assert [link.address for link in made.links()] == [made.listener.address, other.getsockname()]
    assert [other.recv(512)[4] for _ in range(4)] == [0, 1, 2, 3]  # it has missed none


def test_nobody_at_the_listeners_port_costs_the_others_nothing(port, client):
    made, listener = port
    listener.close()
    other = client()
    speak(made, other, BEAT)
    made.broadcast(*[message("PING")] * 5)
    made.broadcast(*[message("PING")] * 5)
    assert [other.recv(512)[4] for _ in range(10)] == list(range(10))


@pytest.mark.parametrize(("silent_s", "kept"), [(GONE_S, True), (GONE_S + 1.0, False)])
def test_a_client_that_beat_and_fell_silent_finds_a_new_link(port, silent_s, kept):
    made, listener = port
    speak(made, listener, BEAT, 100.0)
    made.listener.has_rates, made.listener.streams = True, {30: [1.0, 0.0]}
    speak(made, listener, BEAT, 100.0 + silent_s)
    assert bool(made.listener.streams) == kept


def test_a_client_that_never_beats_keeps_its_rates(port):
    made, listener = port
    speak(made, listener, PING, 100.0)
    made.listener.has_rates, made.listener.streams = True, {30: [1.0, 0.0]}
    speak(made, listener, PING, 200.0)
    assert made.listener.streams


class Clock:
    """A clock of which a message takes so long."""

    def __init__(self, message_s):
        self.at, self.message_s = 0.0, message_s

    def monotonic(self):
        return self.at


@pytest.mark.parametrize(
    "bind", [exclusive_socket, lambda n, name: MemoryNetwork().socket(5, name)]
)
def test_between_two_ticks_messages_take_a_time_and_not_a_number(monkeypatch, client, bind):
    """A tenth of the time each: eleven are read; what is left is read later, in its order."""
    clock = Clock(0.1 * ground_port.AT_ONCE_S * 1.001)
    monkeypatch.setattr(ground_port, "time", clock)
    made, sender = GroundPort(bind(0, "test"), 9, SYSTEM), client()
    pings = [said(mavlink.MAVLink_ping_message(7, n, 0, 0)) for n in range(40)]
    datagrams = [b"".join(pings[n : n + 16]) for n in (0, 16, 32)]
    for datagram in datagrams:
        if hasattr(made._socket, "inbox"):
            made._socket.inbox.append((datagram, ("127.0.0.1", 7)))
        else:
            sender.sendto(datagram, made._socket.getsockname())
    read = []
    for count in (10, 20, 30, 40):
        for each, _ in made.receive(0.0):
            read.append(each.sequence)
            clock.at += clock.message_s
        assert len(read) == count
        assert made.is_waiting == (count in (10, 20, 30))
    assert read == list(range(40))
    assert not list(made.receive(0.0))
    made.close()


def crowded(made, client, n):
    """Clients that beat, and one of them that is there already when the others send a lot."""
    true, *others = [client() for _ in range(n)]
    for each in (true, *others):
        speak(made, each, BEAT)
    return true, others


def numbered(made, sock, numbers):
    for n in numbers:
        ping = said(mavlink.MAVLink_ping_message(7, n, 0, 0))
        sock.sendto(ping, ("127.0.0.1", made._socket.getsockname()[1]))


@pytest.mark.parametrize("who", ["strangers", "peers"])
def test_a_flood_keeps_nobody_else_waiting(monkeypatch, port, client, who):
    """One message fits between two ticks: those who beat have a turn each, strangers one in all."""
    made, _ = port
    true, others = crowded(made, client, 4)
    if who == "strangers":
        others = [client() for _ in range(30)]
    for k in range(3):
        for each in others:
            numbered(made, each, [1000 + k])
    numbered(made, true, [1, 2])
    clock = Clock(0.0)
    monkeypatch.setattr(ground_port, "time", clock)
    read = []
    while {1, 2} - set(read):
        for each, _ in made.receive(0.0):
            read.append(each.sequence)
            clock.at += ground_port.AT_ONCE_S
    turns = 2 if who == "strangers" else 4
    assert len(read) <= 2 * turns


def test_what_a_newcomer_sends_is_read_in_its_order(monkeypatch, port, client):
    """Also what it sent while it was a stranger, and has not been read yet."""
    made, _ = port
    newcomer = client()
    clock = Clock(0.0)
    monkeypatch.setattr(ground_port, "time", clock)

    def taken():
        got = []
        for each, _ in made.receive(0.0):
            got.append(getattr(each, "sequence", "beat"))
            clock.at += ground_port.AT_ONCE_S
        return got

    newcomer.sendto(BEAT, ("127.0.0.1", made._socket.getsockname()[1]))
    numbered(made, newcomer, [1, 2])
    assert taken() == ["beat"]
    numbered(made, newcomer, [3])
    assert [*taken(), *taken(), *taken()] == [1, 2, 3]
    numbered(made, newcomer, [4])
    assert taken() == [4]
    assert not made.is_waiting


@pytest.mark.parametrize("size", [40, 60_000])
def test_what_waits_for_its_turn_takes_no_more_than_its_room(monkeypatch, port, client, size):
    made, _ = port
    clock = Clock(0.0)
    monkeypatch.setattr(ground_port, "time", clock)
    monkeypatch.setattr(ground_port, "AT_ONCE_S", 1e-9)
    sender = client()
    sender.sendto(b"\0" * size, made._socket.getsockname())
    for _ in range(2000):
        clock.at = 0.0
        made._take_in(0.0)
        sender.sendto(b"\0" * size, made._socket.getsockname())
    waiting = made._strangers
    assert len(waiting) <= ground_port.BURST
    assert len(waiting) * size <= ground_port.WAITING_BYTES
    assert made.dropped["over rate"] >= 1500


def test_a_clock_that_is_set_back_takes_nothing_away():
    bucket = Bucket(10.0, 5.0)
    assert all(bucket.take(100.0) for _ in range(4))
    assert bucket.take(0.0)
    assert not bucket.take(0.0)
    assert bucket.take(0.1)
