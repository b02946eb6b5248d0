"""Recorders that are killed leave every tick up to some moment, for other readers too."""

from __future__ import annotations

import json
import random
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from gcs_tools.recording import reader as recording
from tests.command_line import gcs
from tests.patience import until

READERS = Path(__file__).parents[1] / "readers"
AT_ONCE, TIMES = 5, 2
LEAST, MOST = 0.3, 3.0  # wall, s: how long a recorder lives after its first chunk


@pytest.fixture(scope="session")
def read_elsewhere():
    """`read_elsewhere(path)`: what the TypeScript implementation of MCAP finds in a file."""
    if shutil.which("node") is None:
        pytest.fail("node is missing: install Node.js 18 or later and npm (apt install nodejs npm)")
    if not (READERS / "node_modules").is_dir():
        pytest.fail("another reader of MCAP files is missing: run `make readers`")

    def read(path: Path) -> dict:
        done = subprocess.run(
            ["node", READERS / "read.mjs", path], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return read


def is_whole(path, read_elsewhere):
    """The recording at `path`, read by us and by others."""
    done = gcs("recover", path)
    assert done.exit_code == 0
    assert "whole again" in done.stdout
    ours, theirs = recording.read(path), read_elsewhere(path)
    assert ours.complete
    assert theirs["statistics"] == sum(t["messages"] for t in theirs["topics"].values())
    for topic, rows in {**ours.reports, "/plant/truth": ours.plant}.items():
        found = theirs["topics"][topic]
        assert found["messages"] == len(rows)
        assert found["last"]["t"] == rows["t"][-1]
        for key, row in (("first_ns", 0), ("last_ns", -1)):
            assert found[key] == round(rows["t"][row] * 1e9)
    assert theirs["topics"]["/fcu/law"]["messages"] >= len(ours.fcu) > 0
    return ours


def test_ten_that_are_killed(start, instance, unheard, record, read_elsewhere):
    """Of a replay, which waits for who listens: on a busy machine a flight would lose ticks."""
    unheard.trajectory()
    published = recording.read(unheard.recording).reports["/fcu/timing"]
    numbers = published["timing.sequence"]
    chosen = random.Random(11)
    for _ in range(TIMES):
        recorders = [record(instance) for _ in range(AT_ONCE)]
        for recorder in recorders:
            recorder.waits()
        replay = start(
            "gcs_tools", "replay", unheard.recording, "--instance", instance, "--speed", "0.5"
        )
        for recorder in recorders:
            recorder.under_way(1)
        began = time.monotonic()
        lives = sorted(chosen.uniform(LEAST, MOST) for _ in recorders)
        for recorder, life in zip(recorders, lives, strict=True):
            until(lambda end=began + life: time.monotonic() >= end, "its chosen moment")
            recorder.killed()
        replay.kill()
        for recorder in recorders:
            assert recorder.program.process.returncode == -signal.SIGKILL  # not over before
            found = is_whole(recorder.out, read_elsewhere).reports["/fcu/timing"]
            assert len(found) > 0
            assert (np.diff(found["timing.sequence"]) == 1.0).all()
            same = np.isin(numbers, found["timing.sequence"])
            assert np.array_equal(published.rows[same], found.rows, equal_nan=True)
