"""Events that processes write come back with codes and numbers. Free text says nothing to a program."""

import os

import pytest

from fcu.interface.event_log import (
    BEFORE_S,
    Event,
    as_json,
    as_line,
    event,
    line,
    of_json,
    read,
    write,
)
from fcu.interface.status_texts import Code, Told, lacks
from gcs_tools.recording.events import logged

REFUSED = Told(Code.SETPOINT_REFUSED, (lacks(far=30.0, speed=0.0, short=1e300, part=0.5),))


def test_events_of_both_processes_come_back(tmp_path):
    told = [
        event(-1.0, "info", "fcu", "instance 0: waiting for the plant"),
        event(12.5, "warning", "fcu", REFUSED),
        event(20.0, "error", "plant", Told(Code.FLIGHT_ENDED, ("hit the ground",))),
    ]
    for each in told:
        with (tmp_path / f"{each.who}.jsonl").open("a") as file:
            file.write(f"{as_line(each)}\n")
    with (tmp_path / "fcu.jsonl").open("a") as file:
        file.write('{"t": 13.0, "level": "warn')  # killed
    assert list(logged(tmp_path)) == [told[0]._replace(t=0.0), *told[1:]]
    (reason,) = told[1].values
    assert reason["code"] == "LACKS" and reason["values"][1] == 1e300


def test_a_flight_without_logs_has_no_events(tmp_path):
    assert list(logged(tmp_path)) == []


def test_people_read_the_same_event_as_programs(tmp_path, capfd):
    told = event(12.5, "warning", "fcu", Told(Code.SETPOINT_FAR, (12.0, 10.0)))
    with (tmp_path / "events").open("wb") as file:
        write(told, file.fileno())
    assert capfd.readouterr().err == f"{line(told)}\n"
    assert list(read(tmp_path / "events")) == [told]
    os.close(fd := os.open(tmp_path, os.O_RDONLY))
    write(told, fd)  # that cannot be written: no flight ends of it


def test_a_kind_is_without_its_numbers():
    def kind(*values):
        return event(1.0, "warning", "fcu", Told(Code.DENIED, values)).kind

    far, near = (Told(Code.ABOVE_LIMIT, ("position", limit, "m")) for limit in (2.0, 1.0))
    assert kind("Go", far) == kind("Go", near) != kind("Land", far)
    assert kind("Go", far) != kind("Go", Told(Code.FORCE))
    assert Event(1.0, "info", "12 m").kind != Event(1.0, "info", "13 m").kind  # free: never read


@pytest.mark.parametrize(
    "change",
    [
        {"t": float("nan")}, {"t": "1"}, {"t": True}, {"event": 5}, {"who": None}, {"code": 5},
        {"values": 5}, {"values": [None]}, {"values": [float("inf")]}, {"values": [[1.0]]},
        {"values": [{"code": "A"}]}, {"values": [{"code": "A", "values": 1}]},
    ],
)  # fmt: skip
def test_what_is_no_event_is_refused(change):
    with pytest.raises(ValueError, match="not an event"):
        of_json({**as_json(Event(1.0, "info", "x", "fcu")), **change})


def test_a_level_that_there_is_not_is_unknown():
    assert of_json({"t": 1.0, "level": "loud", "event": "x"}) == Event(1.0, "unknown", "x")


def test_what_is_not_finite_is_a_name():
    """JSON has no such numbers."""
    assert event(1.0, "info", "fcu", Told(Code.GOING, (float("nan"),))).values == ("nan",)


def test_what_happens_before_time_begins_has_no_time_in_its_line():
    before, first = (line(event(t, "info", "fcu", "ready")) for t in (BEFORE_S, 0.0))
    assert before.split() == ["-", "info", "fcu", "ready"]
    assert first.split() == ["0.000", "info", "fcu", "ready"]
