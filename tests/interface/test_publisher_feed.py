"""Rows and words on their way to a publisher that does not read."""

from __future__ import annotations

import json

import numpy as np
import pytest

from fcu.interface import publisher_feed
from fcu.interface.event_log import event
from fcu.interface.publisher_feed import PublisherFeed

pytestmark = pytest.mark.skipif(not publisher_feed.SUPPORTED, reason="no such socket here")
WIDTH = 50


@pytest.fixture
def met(monkeypatch):
    """A feed, and the publisher's end of its connection."""
    monkeypatch.setattr(publisher_feed, "address", lambda instance: "\0m-mrac/feed/of-a-test")
    monkeypatch.setattr(publisher_feed, "ROOM_BYTES", 1 << 15)
    listener = publisher_feed.listen(0)
    feed = PublisherFeed(0, "fcu", "of a test")
    assert feed.find(0.0)
    connected, _ = listener.accept()
    connected.setblocking(False)
    yield feed, connected
    feed.close()
    connected.close()
    listener.close()


def read(connected):
    """Take all that is there: how many rows, and what was said, each with the rows before it."""
    rows, said = 0, []
    while True:
        try:
            data = connected.recv(publisher_feed.GREATEST_BYTES)
        except BlockingIOError:
            return rows, said
        if len(data) % 8:
            said.append((rows, json.loads(data)))
        else:
            rows += 1


def test_a_word_gets_through_when_rows_do_not(met):
    """A part of the room is kept for words, and rows are dropped and counted before they take it."""
    feed, connected = met
    sent = 0
    while not feed.dropped:
        feed.send(np.zeros(WIDTH))
        sent += 1
    feed.event(event(1.5, "warning", "fcu", "a rotor has failed"))
    feed.send(np.zeros(WIDTH))
    assert feed.dropped == 2  # what is kept is not for rows, after a word either
    rows, said = read(connected)
    assert rows == sent - 1
    (at_first, hello), (at_last, warned) = said
    assert (at_first, hello["hello"], hello["dropped"]) == (0, "fcu", 0)
    assert (at_last, warned["t"]) == (rows, 1.5)
    assert "a rotor has failed" in warned.values()


def test_a_publisher_that_reads_again_has_all_the_room_again(met):
    feed, connected = met
    for _ in range(3):
        before = feed.dropped
        sent = 0
        while feed.dropped == before:
            feed.send(np.zeros(WIDTH))
            sent += 1
        assert sent > 10
        feed.say({"dropped": feed.dropped})
        rows, said = read(connected)
        assert rows == sent - 1
        assert said[-1][1] == {"dropped": feed.dropped}
