"""A recording whose writer was killed is made whole, and nothing is lost by trying."""

from __future__ import annotations

import numpy as np
import pytest
from mcap.reader import make_reader

from fcu.kernel.buffers import size
from fcu.process.tick import Tick
from gcs_tools.recording.reader import RecordingError, read
from gcs_tools.recording.repair import recover
from gcs_tools.recording.writer import RecordingWriter
from sitl_plant.physics.types import PlantRecord

N = 600


def rows(cls):
    made = np.random.default_rng(1).standard_normal((N, size(cls)))
    made[:, 0] = np.arange(N) * 2000 * 1e-6
    return made


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A recording of several chunks, its rows of the flight controller."""
    path = tmp_path_factory.mktemp("run") / "flight.mcap"
    fcu = rows(Tick)
    with RecordingWriter(path, {"mission": "paper_nominal"}) as recorder:
        for i in range(0, N, 100):
            recorder.add_plant(rows(PlantRecord)[i : i + 100])
            recorder.add_fcu(fcu[i : i + 100])
            recorder.flush()
    return path, fcu


def listed(path):
    """Messages that a reader finds by the index at the end of the file."""
    with path.open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_summary() is not None
        return sum(1 for _ in reader.iter_messages())


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.computes
def test_cut_anywhere_it_holds_every_whole_chunk_and_an_index(whole, tmp_path, seed):
    data = whole[0].read_bytes()
    after_one = len(data) // 4
    at = int(np.random.default_rng(seed).integers(after_one, len(data) - 1))
    cut = tmp_path / "flight.mcap"
    cut.write_bytes(data[:at])
    before = read(cut)
    assert not before.complete
    done = recover(cut)
    after = read(cut)
    assert after.complete
    assert not done.complete
    assert len(after.fcu) >= (N - 100) * at // len(data) - 100
    assert after.fcu.names == before.fcu.names
    assert after.fcu.rows.tobytes() == before.fcu.rows.tobytes()
    assert after.fcu.rows_of(Tick).tobytes() == whole[1][: len(after.fcu)].tobytes()
    assert after.metadata == {"mission": "paper_nominal"}
    assert listed(cut) == done.messages > 0
    assert recover(cut).complete  # and again: there is nothing to do


def test_a_whole_one_is_left_as_it_is(whole):
    data = whole[0].read_bytes()
    assert recover(whole[0]).complete
    assert whole[0].read_bytes() == data


def test_a_damage_is_not_cut_out_in_place(whole, tmp_path):
    data = bytearray(whole[0].read_bytes())
    data[len(data) // 2 : len(data) // 2 + 8] = b"garbage!"
    bad, out = tmp_path / "bad.mcap", tmp_path / "good.mcap"
    bad.write_bytes(data)
    with pytest.raises(RecordingError, match=r"damaged after .* s .*--out FILE"):
        recover(bad)
    assert bad.read_bytes() == data
    done = recover(bad, out)
    assert "decompressed" in done.damage or "crc" in done.damage  # as the garbage falls
    assert 0.0 < done.last_s < N * 0.002
    assert read(out).complete
    assert not [p for p in tmp_path.iterdir() if p not in (bad, out)]


@pytest.mark.parametrize("data", [b"", b"x", b"not a recording at all", b"\x89MCAP0\r\n"])
def test_what_holds_nothing_is_an_error_and_stays(tmp_path, data):
    path = tmp_path / "flight.mcap"
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"flight\.mcap: "):
        recover(path)
    assert path.read_bytes() == data


def test_what_cannot_be_read_or_written_is_named(whole, tmp_path):
    with pytest.raises(RecordingError, match="No such file"):
        recover(tmp_path / "nowhere.mcap")
    with pytest.raises(RecordingError, match="Is a directory"):
        recover(tmp_path)
    with pytest.raises(RecordingError, match="No such file"):
        recover(whole[0], tmp_path / "nowhere" / "out.mcap")


def test_a_flight_that_is_being_recorded_is_left_alone(tmp_path):
    path = tmp_path / "flight.mcap"
    with RecordingWriter(path, {}) as recorder:
        recorder.add_plant(rows(PlantRecord))
        recorder.flush()
        with pytest.raises(RecordingError, match="being recorded"):
            recover(path)
    assert recover(path).complete
