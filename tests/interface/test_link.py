"""UDP on loopback, and the pair in memory."""

from __future__ import annotations

import socket
import sys

import pytest

from fcu.interface.link import HOST, Link, MemoryNetwork, PortBusy, UdpLink
from tests.patience import PATIENCE_S


@pytest.fixture
def opened():
    links: list[UdpLink] = []

    def open_link(bind_port=0, peer_port=None, name="link"):
        links.append(UdpLink(bind_port, peer_port, name))
        return links[-1]

    yield open_link
    for link in links:
        link.close()


def received(link):
    assert link.wait(PATIENCE_S)
    return link.receive()


def closed_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return sock.getsockname()[1]


def test_two_ends_hear_each_other(opened):
    a = opened()
    b = opened(0, a.port)
    b.send(b"state")
    assert received(a) == b"state"
    a.send(b"command")  # to whoever spoke last
    assert received(b) == b"command"


def test_receiving_does_not_block(opened):
    assert opened().receive() is None
    assert opened(0, closed_port()).receive() is None
    assert not opened().wait(0.0)


def test_sending_before_anyone_spoke_is_lost(opened):
    opened().send(b"hello")


def test_an_absent_peer_is_not_an_error(opened):
    link = opened(0, closed_port())
    for _ in range(3):
        link.send(b"anyone?")
        link.wait(0.0)
        assert link.receive() is None


def test_a_peer_may_come_later(opened):
    port = closed_port()
    early = opened(0, port)
    early.send(b"lost")
    late = opened(port, early.port)
    early.send(b"found")
    assert received(late) == b"found"
    late.send(b"answer")
    assert received(early) == b"answer"


def test_a_stranger_is_not_heard(opened):
    peer, stranger = opened(), opened()
    link = opened(0, peer.port)
    link.send(b"hello")
    assert received(peer) == b"hello"
    stranger._socket.sendto(b"stranger", ("127.0.0.1", link.port))
    peer.send(b"peer")
    assert received(link) == b"peer"
    assert link.receive() is None


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the kernel drops them uncounted")
def test_strangers_are_counted_and_cost_the_peer_no_room(opened):
    peer, stranger = opened(), opened()
    link = opened(0, peer.port)
    link.send(b"hello")
    assert received(peer) == b"hello"
    assert link.count_strangers() == 0
    for length in (0, 1, 300):
        stranger._socket.sendto(bytes(length), ("127.0.0.1", link.port))
    assert (link.count_strangers(), link.count_strangers()) == (3, 3)
    for _ in range(5000):  # far more than a socket has room for
        stranger._socket.sendto(bytes(1000), ("127.0.0.1", link.port))
    peer.send(b"peer")
    assert received(link) == b"peer"
    assert link.receive() is None
    assert link.count_strangers() > 10


def test_a_port_with_a_peer_cannot_be_shared_either(opened):
    link = opened(0, closed_port())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with pytest.raises(OSError, match="in use"):
            other.bind(("127.0.0.1", link.port))
    with pytest.raises(PortBusy):
        UdpLink(link.port)
    port = link.port
    link.close()
    assert opened(port).port == port


def test_a_busy_port_says_which_and_whose(opened):
    port = opened().port
    with pytest.raises(PortBusy, match=rf"{port} \(plant link\)") as caught:
        UdpLink(port, name="plant link")
    assert (caught.value.port, caught.value.link) == (port, "plant link")
    assert isinstance(caught.value, OSError)


def test_a_port_that_others_would_share_is_busy_too():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("127.0.0.1", 0))
        with pytest.raises(PortBusy):
            UdpLink(other.getsockname()[1])


def test_a_closed_port_can_be_had_again(opened):
    link = opened()
    port = link.port
    link.close()
    assert link.fileno() == -1
    assert opened(port).port == port


def test_only_loopback_is_bound(opened):
    assert opened()._socket.getsockname()[0] == "127.0.0.1"


def test_ports_in_memory_have_the_same_face():
    network = MemoryNetwork()
    a, b = network.link(1, 2, "a"), network.link(2, 1, "b")
    links: tuple[Link, Link] = (a, b)
    a.send(b"1")
    a.send(b"2")
    assert b.wait(0.0)
    assert [end.fileno() for end in links] == [-1, -1]
    assert (b.receive(), b.receive(), b.receive()) == (b"1", b"2", None)
    assert not b.wait(0.1)
    b.send(b"3")
    b.send(b"4")
    assert a.receive() == b"3"
    a.close()
    b.send(b"5")
    assert network.link(1, 2, "a").receive() is None


def test_a_port_in_memory_belongs_to_one_and_hears_its_peer_alone():
    network = MemoryNetwork()
    a, stranger = network.link(1, 2, "a"), network.socket(3, "stranger")
    with pytest.raises(PortBusy, match="port 3"):
        network.socket(3, "another")
    with pytest.raises(BlockingIOError):
        stranger.recvfrom(4096)
    stranger.sendto(b"who?", (HOST, 1))
    assert a.receive() is None
    a.send(b"nobody is there")
    network.socket(2, "b").sendto(b"me", (HOST, 1))
    assert a.receive() == b"me"


def test_a_port_in_memory_holds_no_more_than_a_socket():
    network = MemoryNetwork()
    a, b = network.link(1, 2, "a"), network.link(2, 1, "b")
    for k in range(5000):
        a.send(b"%d" % k)
    heard = 0
    while b.receive() is not None:
        heard += 1
    assert 100 < heard < 5000
