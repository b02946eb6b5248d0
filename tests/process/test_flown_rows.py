"""What was flown is kept once, in order, whoever looks meanwhile."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_tools.flight.flown_rows import ROOM, FlownRows
from gcs_tools.recording.table import Table
from tests.attacks.outcome import run

WIDTH = 3
FLIGHT = "gcs", "fly", "paper_nominal", "--in-process", "--figure", "never", "--record", "none"


@pytest.mark.parametrize("expected", [0, 1, 100, 10**6])
def test_rows_are_kept_in_order_beyond_the_first_room_and_seen_ones_stay(expected):
    kept = FlownRows(WIDTH, expected)
    assert len(kept.rows) == len(kept.last) == 0
    wide = np.arange(5.0 * (2 * ROOM + 7)).reshape(-1, 5)
    parts = np.array_split(wide, 300)
    kept.append(parts[0])
    first = kept.rows
    seen = first.copy()
    for part in parts[1:]:
        kept.append(part)
    assert np.array_equal(kept.rows, wide[:, :WIDTH])
    assert np.array_equal(kept.last, wide[-1:, :WIDTH])
    assert np.array_equal(first, seen)


def test_consecutive_rows_of_a_table_are_not_copied():
    rows = np.arange(12.0).reshape(6, 2)
    table = Table(rows, ["a", "b"])
    for which in (np.array([1, 2, 3]), np.array([False, True, True, True, False, False])):
        assert np.shares_memory(table.take(which).rows, rows)
        assert np.array_equal(table.take(which).rows, rows[which])
    for which in (np.array([], int), np.array([3, 2]), np.array([0, 2]), np.array([1, 1])):
        assert np.array_equal(table.take(which).rows, rows[which])


def test_a_flight_takes_no_more_memory_than_what_was_flown_twice(tmp_path):
    """A tick is 233 numbers of 8 bytes; what is judged of them is copied once, at most."""

    def memory(duration_s):
        setting = f"flight.duration_s={duration_s}"
        done = run([*FLIGHT, "--set", setting, "--out", str(duration_s)], tmp_path, 60.0)
        assert done.code in (0, 1), done.said
        return done.memory

    run([*FLIGHT, "--set", "flight.duration_s=1", "--out", "compiled"], tmp_path, 600.0, 600.0)
    assert memory(160) - memory(20) < 140 * 500 * 233 * 8 * 2
