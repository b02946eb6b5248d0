"""What comes to a publisher that no flying process of this version sends is refused, and said."""

from __future__ import annotations

import json
import socket
import time

import numpy as np
import pytest

from fcu.interface import publisher_feed
from fcu.interface.event_log import Event
from fcu.interface.ports import ports
from fcu.kernel.buffers import size
from fcu.kernel.rows import column_of
from fcu.laws import loader
from gcs_tools.live import bus, samples
from gcs_tools.live.publisher import (
    HELLO_S,
    SOURCES,
    FeedListener,
    PublishedVehicle,
    Publisher,
    about,
)
from gcs_tools.recording.schema import TOPICS, FcuRow, ParamsRow, PlantRow
from tests.bus import intruder
from tests.patience import PATIENCE_S, until

T, SEQUENCE = (column_of(FcuRow, name) for name in ("t", "timing.sequence"))
LAW = loader.load()
HELLO = json.dumps({"hello": "fcu", "dropped": 3, "law": LAW.identity}).encode()
RESET = json.dumps({"reset": "fcu"}).encode() + b" "
assert len(HELLO) % 8 and len(RESET) % 8


def row(number, t=0.0):
    found = np.zeros(size(FcuRow))
    found[[T, SEQUENCE]] = t, number
    return found.tobytes()


@pytest.fixture
def publisher(instance):
    feeds = FeedListener(instance, LAW)
    with bus.session(bus.for_publisher(instance, "feeding")) as session:
        vehicle = PublishedVehicle(session, str(ports(instance).system_id), TOPICS, LAW)
        vehicle.about = about("feeding", instance, LAW, {})
        yield Publisher(feeds, vehicle, LAW, None)
    feeds.close()


@pytest.fixture
def connected(publisher, instance):
    """`connected()`: somebody who feeds."""
    sockets = []

    def connect(*datagrams):
        one = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        one.settimeout(PATIENCE_S)
        one.connect(publisher_feed.address(instance))
        for datagram in datagrams:
            one.send(datagram)
        sockets.append(one)
        return one

    yield connect
    for one in sockets:
        one.close()


def is_hung_up_on(one):
    try:
        return one.recv(1) == b""
    except ConnectionResetError:  # with what it has sent unread
        return True


def params(t, h):
    found = np.ones(size(ParamsRow))
    found[[column_of(ParamsRow, "t"), column_of(ParamsRow, "law.h")]] = t, h
    return found.tobytes()


LIES = {
    "no hello": [row(0)],
    "hello twice": [HELLO, HELLO],
    "another length": [HELLO, bytes(8)],
    "no number": [HELLO, row(np.nan)],
    "a number below 0": [HELLO, row(-1.0)],
    "a number too large": [HELLO, row(1e300)],
    "no time": [HELLO, row(0, np.nan)],
    "a time below 0": [HELLO, row(0, -1.0)],
    "a time too large": [HELLO, row(0, 1e300)],
    "a number twice": [HELLO, row(5), row(5)],
    "a number that goes back": [HELLO, row(5), row(4)],
    "a reset of nobody": [RESET],
    "parameters at no time": [HELLO, params(np.nan, 0.002)],
    "parameters at too large a time": [HELLO, params(1e300, 0.002)],
    "parameters without a period": [HELLO, params(0.0, 0.0)],
    **{
        f"said {w[:30].decode()}": [w]
        for w in intruder.words()
        if w.strip() != intruder.HELLO.encode()
    },
}


@pytest.mark.parametrize("datagrams", LIES.values(), ids=LIES.keys())
def test_false_reports_are_refused(publisher, connected, capfd, datagrams):
    honest = connected(HELLO.replace(b"fcu", b"plant") + b" ", bytes(8 * size(PlantRow)))
    publisher.pass_on()
    liar = connected(*datagrams)
    publisher.pass_on()
    assert is_hung_up_on(liar)
    assert ": not published" in capfd.readouterr().err
    publisher.pass_on()
    assert publisher.published == {"fcu": 0, "plant": 1}
    honest.send(b"{}")
    publisher.pass_on()
    assert is_hung_up_on(honest)  # only now


def test_rows_begin_again_after_a_reset_and_none_is_lost(publisher, connected):
    connected(HELLO, row(0), row(1, 0.002), RESET, row(0), RESET, row(0), row(1, 0.002))
    while publisher.pass_on():
        pass
    assert publisher.published["fcu"] == 5
    assert publisher.lost["fcu"] == 0


def test_a_second_of_a_kind_is_refused(publisher, connected, capfd):
    connected(HELLO, row(0))
    publisher.pass_on()
    second = connected(HELLO, row(0))
    publisher.pass_on()
    assert is_hung_up_on(second)
    assert "another fcu" in capfd.readouterr().err
    assert publisher.published["fcu"] == 1


def test_a_silent_connection_is_hung_up_on(publisher, connected, monkeypatch):
    now = [time.monotonic()]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    silent = connected()
    silent.settimeout(0.0)
    publisher.pass_on()
    now[0] += HELLO_S
    publisher.pass_on()
    with pytest.raises(BlockingIOError):
        silent.recv(1)
    now[0] += 0.01
    publisher.pass_on()
    silent.settimeout(PATIENCE_S)
    assert silent.recv(1) == b""


def test_no_more_than_some_are_heard(publisher, connected):
    for _ in range(SOURCES):
        connected()
    publisher.pass_on()
    one_more = connected()
    publisher.pass_on()
    assert is_hung_up_on(one_more)


def test_what_was_dropped_is_counted(publisher, connected):
    bye = json.dumps({"bye": "fcu", "dropped": 10}).encode()
    connected(HELLO, row(5), row(6), row(9), bye if len(bye) % 8 else bye + b" ")
    publisher.pass_on()
    assert (publisher.published["fcu"], publisher.lost["fcu"]) == (3, 7)  # 10 - 3 of before


def test_numbers_go_on_when_a_process_is_started_anew(publisher, connected, instance):
    with bus.session(bus.for_tool(instance)) as session:
        heard = session.declare_subscriber("m_mrac/*/*/fcu/timing", handler=bus.channel())
        until(publisher._vehicle.is_heard, "somebody who listens")
        for _ in range(2):
            one = connected(HELLO, row(0), row(1))
            publisher.pass_on()
            one.close()
            publisher.pass_on()
        found = [
            samples.unpack(heard.recv().payload.to_bytes()).sequence.tolist() for _ in range(2)
        ]
    assert found == [[0, 1], [2, 3]]


def test_words_go_through_when_rows_do_not(instance):
    feeds = FeedListener(instance, LAW)
    fed = publisher_feed.PublisherFeed(instance, "fcu", LAW.identity)
    assert fed.find(0.0)
    n = 0
    while not fed.dropped:
        fed.send(np.frombuffer(row(n)))
        n += 1
    fed.event(Event(1.0, "info", "still heard", "fcu"))
    fed.close()
    feeds.accept()
    [source] = feeds.sources
    said, rows = [], 0
    while not source.ended:
        taken = source.take()
        said += taken.said
        rows += len(taken.rows)
    assert (rows, source.lost) == (n - 1, 1)
    assert [*said[0], *said[1], *said[2]] == [
        "hello", "pid", "law", "dropped", "t", "level", "who", "event", "bye", "dropped",
    ]  # fmt: skip
    feeds.close()


def test_rows_that_compiled_code_could_not_send_are_counted_while_somebody_is_there(instance):
    feeds = FeedListener(instance, LAW)
    fed = publisher_feed.PublisherFeed(instance, "fcu", LAW.identity)
    assert fed.find(0.0)
    fed.missed(3, None)
    assert fed.dropped == 3
    fed.missed(2, np.frombuffer(row(4)))  # there is room for the last
    assert fed.dropped == 4
    feeds.accept()
    feeds.hang_up(feeds.sources[0])
    fed.missed(2, np.frombuffer(row(6)))
    assert (fed.dropped, fed.fileno()) == (4, -1)
    feeds.close()
