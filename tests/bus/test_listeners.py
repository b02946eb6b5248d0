"""Who listens, stalls, dies or has no room leaves the flight as it was, to the bit, and says so."""

from __future__ import annotations

import errno
import json
import os
import resource
import signal
import socket

import pytest

from fcu.interface import topics
from gcs_tools.live.recorder import GONE, OUT_OF_SIGHT
from gcs_tools.recording import reader as recording
from tests.bus.conftest import BOTH, LOCKSTEP, MEGABYTE, PACED, TICKS
from tests.process.conftest import claimed_instance


@BOTH
def test_a_flight_is_recorded_by_two_listeners(recorded, record, instance, quiet, speed):
    second = record(instance)
    second.waits()
    flight, recorder = recorded(*speed)
    assert flight.trajectory() == quiet
    assert len(second.adds_up().fcu) > 0
    found = recorder.adds_up()
    own = recording.read(flight.recording)
    assert own.complete
    assert len(own.fcu) == len(own.plant) == TICKS
    kept = {row.tobytes() for row in own.fcu.rows}
    assert {row.tobytes() for row in found.fcu.rows} <= kept


# --- no bus


def test_a_port_that_is_taken(fly, quiet, instance):
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("127.0.0.1", topics.port(instance)))
        other.listen()
        flight = fly(instance)
        assert flight.trajectory() == quiet
    assert f"tcp/127.0.0.1:{topics.port(instance)}: " in flight.said
    assert os.strerror(errno.EADDRINUSE) in flight.said


@pytest.mark.parametrize(
    ("config", "why"),
    [
        ("{", "zenoh.json5: "),
        (
            {"mode": "client", "connect": {"endpoints": ["tcp/127.0.0.1:1"]}},
            "no connection to tcp/127.0.0.1:1",
        ),
    ],
)
def test_recorder_says_that_zenoh_is_missing(fly, quiet, instance, tmp_path, config, why):
    file = tmp_path / "zenoh.json5"
    file.write_text(config if isinstance(config, str) else json.dumps(config))
    flight = fly(instance, "--zenoh", file)
    assert flight.trajectory() == quiet
    assert why in flight.said


# --- those who listen


def test_a_recorder_that_is_suspended_for_good(recorded, quiet):
    flight, recorder = recorded(*LOCKSTEP)
    recorder.program.signal(signal.SIGSTOP)
    assert flight.trajectory() == quiet
    recorder.program.signal(signal.SIGCONT)
    said = recorder.ended()
    assert (said["ended"], said["end_seen"]) == (OUT_OF_SIGHT, False)
    assert said["ticks"] < TICKS
    assert recording.read(recorder.out).complete


@pytest.mark.alone
@BOTH
def test_a_recorder_that_is_suspended_for_a_while(recorded, quiet, speed):
    """Lockstep: there is no room for what it does not take. Paced: it is given up, and comes back."""
    flight, recorder = recorded(*speed)
    recorder.program.signal(signal.SIGSTOP)
    flight.under_way(15 * MEGABYTE)
    recorder.program.signal(signal.SIGCONT)
    assert not flight.is_over()
    assert flight.trajectory() == quiet
    assert sum(recorder.adds_up().lost.values()) > 0
    own = recording.read(flight.recording)
    assert own.complete
    assert len(own.fcu) == len(own.plant) == TICKS


def test_a_recorder_that_is_killed(recorded, quiet):
    flight, recorder = recorded(*LOCKSTEP)
    recorder.killed()
    assert flight.trajectory() == quiet
    assert not recording.read(recorder.out).complete
    assert flight.publisher_complained == []


def test_a_recorder_without_room(fly, record, quiet, instance):
    def small_disk():
        resource.setrlimit(resource.RLIMIT_FSIZE, (MEGABYTE, MEGABYTE))

    recorder = record(instance, preexec_fn=small_disk)
    recorder.waits()
    flight = fly(instance, *PACED)
    assert recorder.program.wait() == 2
    assert not flight.is_over()
    assert f"{recorder.out}: {os.strerror(errno.EFBIG)}" in recorder.program.text()
    assert "ticks" in recorder.program.text()
    assert len(recording.read(recorder.out).fcu) > 100
    assert flight.trajectory() == quiet
    assert flight.publisher_complained == []


@pytest.mark.alone  # a publisher says for 0.6 s of the wall's clock that its flight has ended
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
        of_own = {
            row.tobytes() for row in own.reports["/plant/timing"].rows
        }  # wall times are in it
        rows = found.reports["/plant/timing"]
        assert {row.tobytes() for row in rows.rows} <= of_own


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
    assert said["last_s"] >= recording.read(flight.recording).fcu["t"][-1]
