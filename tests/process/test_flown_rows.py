"""What was flown is kept once, in order, whoever looks meanwhile."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from gcs_tools.flight.flown_rows import ROOM, FlownRows
from gcs_tools.recording.spilled_rows import LARGE, STRETCH, file_of
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
    assert table.take([2])["a"].tolist() == [4.0]
    assert table.take([-1, 0])["b"].tolist() == [11.0, 1.0]
    assert len(table.take([])) == 0
    for which in (np.array([], int), np.array([3, 2]), np.array([0, 2]), np.array([1, 1])):
        assert np.array_equal(table.take(which).rows, rows[which])


def test_rows_of_a_long_flight_are_in_a_file_and_the_same():
    wide = 200
    expected = LARGE // (8 * wide) + 2 * STRETCH
    kept, rows = FlownRows(wide, expected), np.random.default_rng(1).random((4096, wide))
    kept.append(rows)
    assert file_of(kept.rows) is not None
    first = kept.rows
    for k in range(1, 6):
        kept.append(k + rows)
    assert np.array_equal(first, rows)
    assert np.array_equal(kept.rows, np.concatenate([k + rows for k in range(6)]))
    table = Table(kept.rows, [f"a.{i}" for i in range(wide)])
    one = table.take(slice(4000, 5000))["a.7"]
    assert np.array_equal(one, kept.rows[4000:5000, 7])
    assert file_of(one) is None
    assert np.array_equal(table["a"], kept.rows)
    some = np.arange(len(kept)) % 3 == 1
    apart = table.take(some).take(slice(7, 4000))
    assert np.array_equal(apart["a.7"], kept.rows[some, 7][7:4000])
    assert np.array_equal(
        apart.take(np.array([True, False] * 1996 + [False]))["a.7"], apart["a.7"][:-1:2]
    )
    assert np.array_equal(apart["a"], kept.rows[some][7:4000])
    with pytest.raises(EOFError, match="end of their file"):
        file_of(kept.rows)[0].read(8 * wide * expected, np.empty(1))
    more = np.zeros((expected - len(kept) + 1, wide))
    kept.append(more)  # one more than was expected
    assert file_of(kept.rows) is None
    assert np.array_equal(kept.rows[:4096], rows)
    assert len(kept) == expected + 1


FULL = """
import resource
import numpy as np
from gcs_tools.flight.flown_rows import FlownRows
resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, 1 << 20))
kept = FlownRows(300, 100_000)
for k in range(10):
    kept.append(np.full((512, 300), float(k)))
assert (kept.rows[:, 7] == np.repeat(np.arange(10.0), 512)).all()
"""


def test_where_files_cannot_grow_rows_stay_in_memory(tmp_path):
    done = subprocess.run([sys.executable, "-c", FULL], cwd=tmp_path, check=False, timeout=60.0)
    assert done.returncode == 0


def test_a_long_flight_takes_hardly_more_memory_than_a_short_one(tmp_path):
    """A tick is 233 numbers of 8 bytes, of which a few columns are in memory at a time."""

    def memory(duration_s):
        setting = f"flight.duration_s={duration_s}"
        done = run([*FLIGHT, "--set", setting, "--out", str(duration_s)], tmp_path, 60.0)
        assert done.code in (0, 1), done.said
        return done.memory

    run([*FLIGHT, "--set", "flight.duration_s=1", "--out", "compiled"], tmp_path, 600.0, 600.0)
    assert memory(400) - memory(20) < 100e6  # all that was flown takes 354 MB
