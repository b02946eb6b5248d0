"""What is asked for when a recording begins, and comes by itself too, is in it once."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.interface.event_log import Event, event
from fcu.interface.status_texts import Code, Told
from gcs_tools.live import standstill
from gcs_tools.live.recorder import BusRecorder
from gcs_tools.live.samples import Sample
from gcs_tools.live.standstill import Standstill, end_in, end_told
from gcs_tools.recording import events
from gcs_tools.recording.reader import read
from gcs_tools.recording.schema import TOPICS


def said(*numbers: int) -> Sample:
    messages = [events.encode(Event(float(n), "info", f"number {n}")) for n in numbers]
    sequence = np.array(numbers, np.uint64)
    return Sample(sequence, sequence * np.uint64(10**9), messages)


@pytest.mark.parametrize(
    ("before", "then", "there"),
    [
        ((4,), [(5,), (6,)], [4, 5, 6]),  # nothing overlaps
        ((4,), [(0, 1, 2, 3, 4)], [0, 1, 2, 3, 4]),  # it came with others before it
        ((4,), [(2, 3), (4, 5)], [2, 3, 4, 5]),
        ((4,), [], [4]),
    ],
)
def test_messages_are_recorded_in_their_order(tmp_path, before, then, there):
    path = tmp_path / "recorded.mcap"
    with BusRecorder(path, {}, TOPICS) as recorder:
        recorder.before(events.TOPIC, said(*before))
        for numbers in then:
            recorder.add(events.TOPIC, said(*numbers))
    assert [event.t for event in read(path).events] == there


def test_what_is_late_to_a_chunk_that_has_it_is_left_out(tmp_path, monkeypatch):
    path = tmp_path / "recorded.mcap"
    with BusRecorder(path, {}, TOPICS) as recorder:
        recorder.before(events.TOPIC, said(4))
        monkeypatch.setattr(recorder._file, "is_due", lambda pending: True)
        recorder.flush_if_due()
        recorder.add(events.TOPIC, said(3, 4, 5))
    assert [event.t for event in read(path).events] == [4, 5]


def told(*values, who="fcu"):
    return event(1.0, "warning", who, Told(*values))


CRASHED = told(Code.CRASHED).shown
LEFT = told(Code.FLIGHT_ENDED, ("left the arena",), who="plant")


@pytest.mark.parametrize(
    ("happened", "end"),
    [
        ([], ""),
        ([told(Code.ARMED), told(Code.CRASHED), told(Code.NOT_ARMED)], CRASHED),
        ([LEFT], LEFT.shown),
        ([told(Code.DIVERGED)], told(Code.DIVERGED).shown),
        ([told(Code.CRASHED), told(Code.RESET)], ""),
        ([told(Code.CRASHED)._replace(code="")], ""),  # free text says nothing to a program
    ],
)
def test_how_the_flight_ended_is_known_until_the_vehicle_is_reset(happened, end):
    assert end_told(happened) == end
    sample = said(*range(len(happened)))
    encoded = [*map(events.encode, happened)]
    assert end_in(Sample(sample.sequence, sample.time_ns, encoded), "") == end
    assert end_in(Sample(sample.sequence, sample.time_ns, [b"\xff"]), end) == end


def test_time_stands_once_it_has_not_changed_for_long_enough(monkeypatch):
    """The first tick of a vehicle that compiles may be long to come, unless a time is asked for."""
    now = [0.0]
    monkeypatch.setattr(standstill.time, "monotonic", lambda: now[0])
    still, asked = Standstill(None), Standstill(3.0)
    now[0] = 20.0
    assert not still.see(math.nan, "") and asked.see(math.nan, "")
    assert still.see(math.nan, CRASHED)
    assert not still.see(0.0, "") and not asked.see(0.0, "")
    now[0] = 22.9
    assert not asked.see(0.0, CRASHED) and not still.see(1.0, "")
    now[0] = 23.0
    assert asked.see(0.0, "")
    assert not asked.see(0.1, "")  # time runs again
    now[0] = 33.0
    assert still.see(1.0, "")
