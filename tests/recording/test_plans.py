"""When each item of a plan was flown, by the events of a recording."""

from __future__ import annotations

import pytest

from fcu.interface.event_log import Event
from gcs_tools.recording.plans import PlanHistory


def spans(*told, since=0.0, until=100.0):
    """`told`: time, next item, last that was done."""
    events = [Event(t, "debug", "", "fcu", "PLAN_AT", (k, 6.0, done)) for t, k, done in told]
    return PlanHistory(events).spans(since, until)


@pytest.mark.parametrize(
    ("told", "found"),
    [
        # one after the other; the last is not done
        ([(0, 0, -1), (3, 1, 0), (5, 2, 1)], {0: (0, 3), 1: (3, 5), 2: (5, None)}),
        # an item that takes no time is done as it begins
        ([(0, 0, -1), (3, 2, 1)], {0: (0, 3), 1: (3, 3), 2: (3, None)}),
        # item 1 jumps over 2 and 3, which are never flown
        ([(0, 0, -1), (3, 4, 1)], {0: (0, 3), 1: (3, 3), 4: (3, None)}),
        # item 2 jumps back to 0: its first time counts
        ([(0, 0, -1), (3, 1, 0), (5, 0, 2), (9, 1, 0)],
         {0: (0, 3), 1: (3, 5), 2: (5, 5)}),
        # a client has item 4 flown in the middle of item 1
        ([(0, 0, -1), (3, 1, 0), (5, 4, 0), (9, 5, 4)],
         {0: (0, 3), 1: (3, None), 4: (5, 9), 5: (9, None)}),
    ],
)  # fmt: skip
def test_each_item_has_its_time(told, found):
    assert spans(*told) == found


def test_what_was_told_before_and_behind_is_left_out():
    told = (0, 0, -1), (3, 1, 0), (5, 2, 1), (8, 3, 2)
    assert spans(*told, since=4.0, until=6.0) == {2: (5, None)}
