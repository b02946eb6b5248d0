"""What is done to diagnostics leaves the flight as it was, to the bit; and whoever loses says so."""

from __future__ import annotations

import json
import os
import resource
import signal
import socket

import pytest

from fcu.interface import feed, topics
from gcs_tools import recording
from gcs_tools.feeding import Feeds
from gcs_tools.recorded import GONE, OUT_OF_SIGHT
from tests.bus.conftest import LOCKSTEP, MEGABYTE, PACED, TICKS
from tests.process.conftest import claimed_instance, until

BOTH = pytest.mark.parametrize("speed", [LOCKSTEP, PACED], ids=["lockstep", "paced"])


@pytest.fixture
def recorded(fly, record, instance):
    """`recorded(*options)`: a flight under way and somebody who records it."""

    def begin(*options):
        recorder = record(instance)
        recorder.waits()
        flight = fly(instance, *options)
        recorder.under_way()
        flight.under_way()
        assert not flight.is_over()
        return flight, recorder

    return begin


@BOTH
def test_recorded(recorded, quiet, speed):
    flight, recorder = recorded(*speed)
    assert flight.trajectory() == quiet
    found = recorder.adds_up()
    own = recording.read(flight.recording)
    assert own.complete
    assert len(own.fcu) == len(own.plant) == TICKS
    if speed == PACED:
        assert found.lost == {}
        assert flight.publisher_said == ""
    kept = {row.tobytes() for row in own.fcu}
    assert {row.tobytes() for row in found.fcu} <= kept


# --- no bus


def test_a_port_that_is_taken(fly, quiet, instance):
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("127.0.0.1", topics.port(instance)))
        other.listen()
        flight = fly(instance)
        assert flight.trajectory() == quiet
    assert "flown without diagnostics: " in flight.said
    assert f"tcp/127.0.0.1:{topics.port(instance)}: " in flight.said
    assert "Address already in use" in flight.said


@pytest.mark.parametrize(
    ("config", "why"),
    [
        ("{", "zenoh.json5: not a Zenoh configuration"),
        (
            {"mode": "client", "connect": {"endpoints": ["tcp/127.0.0.1:1"]}},
            "no connection to tcp/127.0.0.1:1",
        ),
    ],
)
def test_no_zenoh(fly, quiet, instance, tmp_path, config, why):
    file = tmp_path / "zenoh.json5"
    file.write_text(config if isinstance(config, str) else json.dumps(config))
    flight = fly(instance, "--zenoh", file)
    assert flight.trajectory() == quiet
    assert "flown without diagnostics: " in flight.said
    assert why in flight.said


# --- those who listen


@BOTH
def test_a_recorder_that_is_suspended_for_good(recorded, quiet, speed):
    flight, recorder = recorded(*speed)
    recorder.program.signal(signal.SIGSTOP)
    assert flight.trajectory() == quiet
    recorder.program.signal(signal.SIGCONT)
    said = recorder.ended()
    assert (said["ended"], said["end_seen"]) == (OUT_OF_SIGHT, False)
    assert said["ticks"] < TICKS
    assert recording.read(recorder.out).complete


@BOTH
def test_a_recorder_that_is_suspended_for_a_while(recorded, quiet, speed):
    """Lockstep: there is no room for what it does not take. Paced: it is given up, and comes back."""
    flight, recorder = recorded(*speed)
    recorder.program.signal(signal.SIGSTOP)
    flight.under_way(15 * MEGABYTE)
    recorder.program.signal(signal.SIGCONT)
    assert not flight.is_over()
    assert flight.trajectory() == quiet
    assert recorder.adds_up().lost["/fcu/timing"] > 0
    own = recording.read(flight.recording)
    assert own.complete
    assert len(own.fcu) == len(own.plant) == TICKS


@BOTH
def test_a_recorder_that_is_killed(recorded, quiet, speed):
    flight, recorder = recorded(*speed)
    recorder.killed()
    assert flight.trajectory() == quiet
    assert not recording.read(recorder.out).complete
    assert flight.publisher_said == ""


def test_a_recorder_without_room(fly, record, quiet, instance):
    def small_disk():
        resource.setrlimit(resource.RLIMIT_FSIZE, (MEGABYTE, MEGABYTE))

    recorder = record(instance, preexec_fn=small_disk)
    recorder.waits()
    flight = fly(instance, *PACED)
    assert recorder.program.wait() == 2
    assert not flight.is_over()
    assert f"{recorder.out}: File too large" in recorder.program.text()
    assert "ticks" in recorder.program.text()
    assert len(recording.read(recorder.out).fcu) > 100
    assert flight.trajectory() == quiet
    assert flight.publisher_said == ""


def test_two_recorders(fly, record, quiet, instance):
    recorders = [record(instance), record(instance)]
    for recorder in recorders:
        recorder.waits()
    flight = fly(instance, *PACED)
    assert flight.trajectory() == quiet
    first, second = (recorder.adds_up() for recorder in recorders)
    assert first.lost == second.lost == {}


# --- the publisher


@BOTH
def test_a_publisher_that_is_suspended_for_good(recorded, quiet, speed):
    flight, recorder = recorded(*speed)
    os.kill(flight.publisher, signal.SIGSTOP)
    assert flight.trajectory() == quiet
    assert "ticks of the fcu" in flight.said
    assert "came too fast to be published" in flight.said
    assert "ticks of the fcu came too fast to be published" in flight.publisher_said
    said = recorder.ended()
    if said["end_seen"]:  # it had not been given up
        recorder.adds_up()
    else:
        assert said["ended"] == OUT_OF_SIGHT
    assert recording.read(recorder.out).complete


@BOTH
def test_a_publisher_that_is_killed(recorded, quiet, speed):
    flight, recorder = recorded(*speed)
    os.kill(flight.publisher, signal.SIGKILL)
    assert flight.trajectory() == quiet
    assert "the publisher was killed by signal 9, before the flight had ended" in flight.said
    assert recorder.ended()["ended"] == OUT_OF_SIGHT
    assert recording.read(recorder.out).complete


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
        assert 0 < lost <= found.lost[f"/{who}/timing"]
        assert f"{lost} of {TICKS} ticks of the {who} came too fast" in flight.publisher_said
    assert found.reports["/fcu/timing"][-1, -1] == flight.unpublished("fcu")
    own = recording.read(flight.recording)
    assert own.complete
    assert len(own.fcu) == len(own.plant) == TICKS


def test_a_publisher_that_is_started_anew(recorded, start, record, quiet, instance):
    flight, first = recorded(*PACED)
    os.kill(flight.publisher, signal.SIGKILL)
    anew = start("gcs_tools", "publish", "--instance", instance, "--run", "anew")
    second = record(instance)
    second.under_way()
    assert not flight.is_over()
    assert flight.trajectory() == quiet
    said = second.ended()  # although the publisher is still there
    assert (said["ended"], said["end_seen"], said["lost"]) == (GONE, True, {})
    assert said["ticks"] > 1000
    assert said["last_s"] == pytest.approx((TICKS - 1) * 0.002)
    assert first.ended()["ended"] == OUT_OF_SIGHT
    assert recording.read(second.out).metadata["run"] == "anew"
    assert anew.interrupted() == 0
    assert json.loads(anew.out.read_text().splitlines()[-1])["lost"] == {"fcu": 0, "plant": 0}


# --- those who shout


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
        assert flight.publisher_said == ""
        return
    assert "neither rows nor words of ours: not published" in flight.publisher_said
    assert "Traceback" not in flight.publisher_said


def test_nobody_feeds_or_listens_to_another_user(instance, monkeypatch):
    feeds, fed = Feeds(instance), feed.Feed(instance, "fcu")
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


# --- others


def test_two_flights_that_are_recorded_at_once(fly, record, quiet):
    with claimed_instance() as first, claimed_instance() as second:
        recorders = [record(first), record(second)]
        for recorder in recorders:
            recorder.waits()
        flights = [fly(first, *PACED), fly(second, *PACED, "--set", "flight.seed=5")]
        assert [flight.trajectory() for flight in flights] == [quiet] * 2
    for flight, recorder in zip(flights, recorders, strict=True):
        found, own = recorder.adds_up(), recording.read(flight.recording)
        assert found.metadata["run"] == flight.run.name
        assert found.metadata["seed"] == own.metadata["seed"]
        of_own = {row.tobytes() for row in own.reports["/plant/timing"]}  # wall times are in it
        rows = found.reports["/plant/timing"]
        assert {row.tobytes() for row in rows} <= of_own


def test_a_flight_without_room_for_its_own_recording(fly, record, instance):
    def small_disk():
        resource.setrlimit(resource.RLIMIT_FSIZE, (3 * MEGABYTE, 3 * MEGABYTE))

    recorder = record(instance)
    recorder.waits()
    flight = fly(instance, preexec_fn=small_disk)
    assert flight.program.wait() == 3
    assert "flight.mcap: File too large" in flight.said
    said = recorder.ended()
    assert (said["ended"], said["end_seen"]) == (GONE, True)
    assert said["last_s"] >= recording.read(flight.recording).fcu[-1, 0]
