"""What becomes of a publisher, and who shouts at it, leaves the flight as it was, to the bit."""

from __future__ import annotations

import json
import os
import signal

import numpy as np
import pytest

from fcu.interface import publisher_feed, topics
from fcu.kernel.buffers import size
from fcu.kernel.rows import column_of
from fcu.laws import loader
from gcs_tools.live.publisher import FeedListener
from gcs_tools.live.recorder import GONE, OUT_OF_SIGHT
from gcs_tools.recording import reader as recording
from gcs_tools.recording.schema import FcuRow
from tests.bus.conftest import BOTH, LOCKSTEP, MEGABYTE, PACED, TICKS
from tests.patience import until


@BOTH
def test_a_publisher_that_is_suspended_for_good(recorded, quiet, speed):
    flight, recorder = recorded(*speed)
    os.kill(flight.publisher, signal.SIGSTOP)
    assert flight.trajectory() == quiet
    assert flight.unpublished("fcu") > 0
    assert "fcu" in flight.publisher_said
    said = recorder.ended()
    if said["end_seen"]:  # it had not been given up
        recorder.adds_up()
    else:
        assert said["ended"] == OUT_OF_SIGHT
    assert recording.read(recorder.out).complete


def test_a_publisher_that_is_killed(recorded, quiet):
    flight, recorder = recorded(*LOCKSTEP)
    os.kill(flight.publisher, signal.SIGKILL)
    assert flight.trajectory() == quiet
    assert "publisher was killed by signal 9" in flight.said
    assert recorder.ended()["ended"] == OUT_OF_SIGHT
    assert recording.read(recorder.out).complete


@pytest.mark.alone
def test_a_publisher_that_is_suspended_for_a_while(recorded, quiet):
    flight, recorder = recorded(*LOCKSTEP)
    pid = flight.publisher
    os.kill(pid, signal.SIGSTOP)
    flight.under_way(15 * MEGABYTE)
    os.kill(pid, signal.SIGCONT)
    assert not flight.is_over()
    assert flight.trajectory() == quiet
    found = recorder.adds_up()
    for who in ("fcu", "plant"):
        lost = flight.unpublished(who)
        assert 0 < lost <= TICKS - len(found.reports[f"/{who}/timing"])
        assert f"{lost} of {TICKS} ticks of the {who} came too fast" in flight.publisher_said
    last = found.reports["/fcu/timing"]
    told, after = last["timing.unpublished"][-1], TICKS - 1 - last["timing.sequence"][-1]
    assert told <= flight.unpublished("fcu") <= told + after  # of its own last ticks none can tell
    own = recording.read(flight.recording)
    assert own.complete
    assert len(own.fcu) == len(own.plant) == TICKS


@pytest.mark.alone  # a publisher waits a second of the wall's clock for who has waited for it
def test_waiting_for_a_publisher_gives_the_first_tick(start, record, instance):
    recorder = record(instance)
    recorder.waits()
    publisher = start("gcs_tools", "publish", "--instance", instance)
    publisher.says('"ready"')  # that is when a flight begins
    feed = publisher_feed.PublisherFeed(instance, "fcu", loader.load().identity)
    assert feed.find(0.0)
    row = np.zeros(size(FcuRow))
    for number in range(20):
        row[column_of(FcuRow, "timing.sequence")] = number
        feed.send(row)
    feed.close()
    assert publisher.interrupted() == 0
    said = recorder.ended()
    assert (said["ticks"], said["lost"], said["end_seen"]) == (20, {}, True)


@pytest.mark.alone
def test_a_publisher_that_is_started_anew(recorded, start, record, quiet, instance):
    flight, first = recorded(*PACED)
    os.kill(flight.publisher, signal.SIGKILL)
    anew = start("gcs_tools", "publish", "--instance", instance, "--run", "anew")
    second = record(instance)
    second.under_way()
    assert not flight.is_over()
    assert flight.trajectory() == quiet
    said = second.ended()  # although the publisher is still there
    assert (said["ended"], said["end_seen"]) == (GONE, True)
    assert said["ticks"] > 1000
    assert said["last_s"] == pytest.approx((TICKS - 1) * 0.002)
    assert first.ended()["ended"] == OUT_OF_SIGHT
    assert recording.read(second.out).metadata["run"] == "anew"
    assert anew.interrupted() == 0
    assert json.loads(anew.out.read_text().splitlines()[-1])["lost"] == {"fcu": 0, "plant": 0}


# --- those who shout


@pytest.mark.alone
@pytest.mark.parametrize("what", ["puts peer", "puts client", "queries peer", "bytes", "feed"])
def test_an_intruder(recorded, start, quiet, instance, what):
    flight, recorder = recorded(*PACED)
    kind, *mode = what.split()
    target = {"feed": [instance], "bytes": [topics.port(instance)]}
    keyed = [*mode, topics.port(instance), *flight.keys]
    intruder = start("tests.bus.intruder", kind, *target.get(kind, keyed))
    until(lambda: len(intruder.out.read_text().splitlines()) > 5, "an intruder")
    assert not flight.is_over()
    assert flight.trajectory() == quiet
    found = recorder.adds_up()
    assert len(found.fcu) > TICKS // 2
    if kind != "feed":
        assert flight.publisher_complained == []
        return
    assert "not published" in flight.publisher_said
    assert "Traceback" not in flight.publisher_said


def test_nobody_feeds_or_listens_to_another_user(instance, monkeypatch):
    feeds = FeedListener(instance, loader.load())
    fed = publisher_feed.PublisherFeed(instance, "fcu")
    theirs = os.getuid() + 1
    with monkeypatch.context() as patched:
        patched.setattr(os, "getuid", lambda: theirs)
        assert not fed.find(0.0)
    assert fed.find(10.0)
    with monkeypatch.context() as patched:
        patched.setattr(os, "getuid", lambda: theirs)
        feeds.accept()
    assert feeds.sources == []
    fed.close()
    feeds.close()


# --- a router


def test_a_router_that_is_restarted(fly, record, start, quiet, instance, tmp_path):
    port = topics.port(instance) + 1
    file = tmp_path / "client.json5"
    file.write_text(json.dumps({
        "mode": "client",
        "connect": {
            "endpoints": [f"tcp/127.0.0.1:{port}"],
            "retry": {"period_init_ms": 50, "period_max_ms": 50},
        },
        "scouting": {"multicast": {"enabled": False}},
    }))  # fmt: skip
    router = start("tests.bus.router", port)
    router.says("routes")
    recorder = record(None, "--zenoh", file)
    flight = fly(instance, "--zenoh", file, *PACED)
    recorder.under_way()
    router.kill()
    router = start("tests.bus.router", port)
    router.says("routes")
    assert not flight.is_over()
    assert flight.trajectory() == quiet
    assert recorder.adds_up().lost["/fcu/timing"] > 0
