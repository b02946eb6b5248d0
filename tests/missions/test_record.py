"""What `--record` keeps of a flight: never another trajectory or verdict."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from mcap.reader import make_reader

import gcs_tools
from gcs_tools.flight.run import UsageError
from gcs_tools.judging.result import trajectory_sha256
from gcs_tools.recording import reader
from sitl_plant.physics.types import PlantRecord
from tests.patience import PATIENCE_S

MEGABYTE = 1e6
MODES = ("full", "light", "none")


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Folder and result of one flight of 20 s in process, by mode."""
    out = tmp_path_factory.mktemp("record")
    return {
        mode: (
            out / mode,
            gcs_tools.fly(
                "paper_nominal", in_process=True, out=out / mode, record=mode, figure="never"
            ),
        )
        for mode in MODES
    }


def test_hash_and_verdict_are_the_same_however_much_is_recorded(flown):
    results = [result for _, result in flown.values()]
    assert len({result.trajectory_sha256 for result in results}) == 1
    assert all(result.expectations == results[0].expectations for result in results)
    assert all(result.metrics == results[0].metrics for result in results)
    assert all(result.passed for result in results)


def test_a_full_recording_holds_the_trajectory_to_the_bit(flown):
    folder, result = flown["full"]
    plant = reader.read(folder / "flight.mcap").plant
    assert trajectory_sha256(plant.rows_of(PlantRecord)) == result.trajectory_sha256


def test_a_light_recording_is_small_and_no_recording_is_none(flown):
    sizes = {mode: folder / "flight.mcap" for mode, (folder, _) in flown.items()}
    assert sizes["light"].stat().st_size <= 6 * MEGABYTE < sizes["full"].stat().st_size
    assert not sizes["none"].exists()


def test_a_light_recording_holds_whole_ticks_and_the_last_one(flown):
    full, light = (reader.read(flown[mode][0] / "flight.mcap") for mode in ("full", "light"))
    assert light.complete and not light.lost
    for whole, some in ((full.plant, light.plant), (full.fcu, light.fcu)):
        kept = np.isin(whole["t"], some["t"])
        assert some.rows.tobytes() == whole.rows[kept].tobytes()
        assert some["t"][-1] == whole["t"][-1]
        assert np.diff(some["t"])[:-1] == pytest.approx(0.01)
    assert light.params == full.params


def test_a_stock_reader_reads_a_light_recording(flown):
    with (flown["light"][0] / "flight.mcap").open("rb") as stream:
        topics = [channel.topic for _, channel, _ in make_reader(stream).iter_messages()]
    assert {"/plant/truth", "/fcu/law", "/fcu/wind", "/fcu/params"} <= set(topics)
    assert topics.count("/plant/truth") == topics.count("/fcu/law") == 2001


def test_every_figure_is_drawn_of_a_light_recording(flown, tmp_path):
    numbers = {}
    for mode in ("full", "light"):
        done = subprocess.run(
            [sys.executable, "-m", "gcs_tools", "plot", flown[mode][0] / "flight.mcap", "--json",
             "--out", tmp_path / mode],
            capture_output=True, text=True, check=True, timeout=PATIENCE_S,
        )  # fmt: skip
        numbers[mode] = json.loads(done.stdout)
        assert ("one tick in 5" in done.stderr) == (mode == "light")
    assert numbers["light"].keys() == numbers["full"].keys()
    for name, drawn in numbers["light"].items():
        assert (drawn["path"] is None) == (numbers["full"][name]["path"] is None), name
    rms = [numbers[mode]["tracking"]["reference_error_rms_settled_m"] for mode in numbers]
    assert rms[1] == pytest.approx(rms[0], rel=0.01)


def test_a_flight_over_the_wire_is_recorded_light_and_ends_with_its_last_tick(tmp_path):
    settings = ("flight.duration_s=2.003",)
    flown = gcs_tools.fly(
        "paper_nominal", settings=settings, out=tmp_path / "run", record="light", figure="never"
    )
    recorded = reader.read(tmp_path / "run" / "flight.mcap")
    assert recorded.plant["t"][-1] == recorded.fcu["t"][-1] == flown.sim_time_s
    assert set(recorded.reports) >= {"/plant/timing", "/fcu/timing", "/fcu/wind"}


def test_an_unknown_mode_is_refused():
    with pytest.raises(UsageError, match="full, light, none"):
        gcs_tools.fly("paper_nominal", record="some")
