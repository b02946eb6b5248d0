"""What is asked for when a recording begins, and comes by itself too, is in it once."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_tools.live.recorder import BusRecorder
from gcs_tools.live.samples import Sample
from gcs_tools.recording import events
from gcs_tools.recording.events import Event
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
def test_in_the_order_in_which_it_was_said(tmp_path, before, then, there):
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
