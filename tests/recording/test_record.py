"""What is recorded is read back to the bit, by us and by others, also after a sudden end."""

import math
import signal
import subprocess
import sys
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.reader import make_reader
from mcap.writer import Writer

from fcu.interface.event_log import Event, event
from fcu.interface.messages import VehicleState
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import columns, size
from fcu.kernel.rows import column
from fcu.process.settings import Settings
from fcu.process.tick import Tick
from gcs_tools.judging.recorded_flight import flight_of
from gcs_tools.missions.mission import load
from gcs_tools.missions.timeline import ITEM_BEGUN, read_begun
from gcs_tools.recording import events, old_names, schema
from gcs_tools.recording.layout import encode
from gcs_tools.recording.mcap_file import RecordingFile, block_of
from gcs_tools.recording.reader import RecordingError, messages, read, values_told
from gcs_tools.recording.schema import TOPICS, Declaration, FcuRow, Kinds, PlantRow, topic_of
from gcs_tools.recording.table import Rows, Table
from gcs_tools.recording.writer import RecordingWriter
from sitl_plant.physics.types import PlantRecord

ROOT = Path(__file__).parents[2]


def any_rows(n: int, cls: Any, seed: int = 1) -> Rows:
    """Rows of every kind of bit pattern, at 500 Hz; `cls`: what is in a row."""
    bits = np.random.default_rng(seed).integers(0, 2**64, (n, size(cls)), dtype=np.uint64)
    rows = bits.view(np.float64)
    kinds = [0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324]
    rows[:, 1 : 1 + len(kinds)] = kinds[: rows.shape[1] - 1]
    rows[:, 0] = np.arange(n) * 2000 * 1e-6
    return rows


def same_bits(a: Table, cls: Any, b: Rows) -> bool:
    """Whether a table has what the first columns of rows have, a value of `cls`."""
    found = a.rows_of(cls)
    return len(found) == len(b) and found.tobytes() == b[:, : size(cls)].tobytes()


def reported(rows: Rows, cls: Any, topic: str) -> Table:
    """What whole rows say of a topic."""
    names, whole = TOPICS[topic].columns, Table.of(cls, rows)
    return Table(np.stack([whole[name] for name in names], axis=1), names)


def write(path: Path, n: int, batch: int = 50) -> tuple[Rows, Rows]:
    """Whole rows, with their reports."""
    plant, fcu = any_rows(n, PlantRow), any_rows(n, FcuRow)
    with RecordingWriter(path, {"mission": "paper_nominal"}) as recorder:
        for i in range(0, n, batch):
            recorder.add_plant(plant[i : i + batch])
            recorder.add_fcu(fcu[i : i + batch])
    return plant, fcu


@pytest.mark.parametrize("batch", [1, 7, 1000])
def test_every_bit_comes_back(tmp_path: Path, batch: int) -> None:
    path = tmp_path / "flight.mcap"
    plant, fcu = write(path, 500, batch)
    recording = read(path)
    assert recording.complete and not recording.lost
    assert same_bits(recording.plant, PlantRecord, plant)
    assert same_bits(recording.fcu, Tick, fcu)
    assert recording.reports.keys() == {"/plant/timing", "/fcu/wind", "/fcu/status", "/fcu/timing"}
    for topic, found in recording.reports.items():
        rows, cls = (plant, PlantRow) if topic == "/plant/timing" else (fcu, FcuRow)
        expected = reported(rows, cls, topic)
        assert found.names == expected.names
        assert found.rows.tobytes() == expected.rows.tobytes()
    assert recording.params is None
    assert recording.metadata == {"mission": "paper_nominal"}


def test_what_was_written_is_known_to_the_byte(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    with RecordingWriter(path, {}) as recorder:
        recorder.add_plant(any_rows(1000, PlantRow))
    data = path.read_bytes()
    assert recorder.written == (len(data), zlib.crc32(data))


def test_parameters_and_events_come_back(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    told = any_rows(1, Settings)[0]
    why = Told(Code.ABOVE_LIMIT, ("position", -0.0, "m"))
    lost = event(2.002, "warning", "fcu", Told(Code.DENIED, ("Take-off: now", why)))
    taken_over = Event(0.5, "info", "take-over")
    with RecordingWriter(path, {}) as recorder:
        recorder.set_params(told)
        for each in (lost, taken_over):
            recorder.event(each)
        with pytest.raises(ValueError, match="already"):
            recorder.set_params(told)
        with pytest.raises(ValueError, match="level loud"):
            recorder.event(Event(0.0, "loud", ""))
    recording = read(path)
    assert recording.params is not None
    values = [recording.params[name] for name in columns(Settings)]
    assert np.array(values).tobytes() == told.tobytes()
    assert recording.events == [taken_over, lost]
    (_, reason) = recording.events[1].values
    assert reason["code"] == "ABOVE_LIMIT" and math.copysign(1.0, reason["values"][1]) == -1.0


@pytest.mark.slow
def test_other_readers_read_a_recording_through_its_schemas(tmp_path: Path) -> None:
    """mcap's own indexed reader and google.protobuf, knowing nothing of this project."""
    path = tmp_path / "flight.mcap"
    plant, fcu = write(path, 400)
    seen = dict.fromkeys(TOPICS, 0)
    classes: dict[str, Any] = {}
    last_time = 0
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for found, channel, message in reader.iter_messages():
            assert found is not None
            if found.name not in classes:
                pool = DescriptorPool()
                for proto in FileDescriptorSet.FromString(found.data).file:
                    pool.AddSerializedFile(proto.SerializeToString())
                classes[found.name] = GetMessageClass(pool.FindMessageTypeByName(found.name))
            decoded = classes[found.name].FromString(message.data)
            topic, k = TOPICS[channel.topic], seen[channel.topic]
            seen[channel.topic] += 1
            assert message.log_time == message.publish_time == k * 2_000_000 >= last_time
            assert message.sequence == k
            last_time = message.log_time
            cls, row = (PlantRow, plant[k]) if "/plant/" in topic.name else (FcuRow, fcu[k])
            for name in topic.columns:
                value = decoded
                for part in name.removeprefix(topic.prefix).split("."):
                    value = getattr(value, part)
                assert np.float64(value).tobytes() == column(cls, row, name).tobytes(), name
    assert seen == {name: 400 if name != schema.PARAMS else 0 for name in TOPICS}


def test_a_chunk_is_written_when_a_second_has_passed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, rows = tmp_path / "flight.mcap", any_rows(3, PlantRecord)
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    recorder = RecordingWriter(path, {})
    recorder.add_plant(rows[:1])
    assert len(read(path).plant) == 0
    now[0] += 1.0
    recorder.add_plant(rows[1:2])
    recording = read(path)
    assert same_bits(recording.plant, PlantRecord, rows[:2])
    assert not recording.complete
    recorder.close()
    recorder.close()  # a second call does nothing


KILLED = """
import sys
import time
from pathlib import Path
from gcs_tools.recording.writer import RecordingWriter
from tests.recording.test_record import PlantRecord, Tick, any_rows

recorder = RecordingWriter(Path(sys.argv[1]), {"mission": "killed"})
recorder.add_plant(any_rows(600, PlantRecord)[:300])
recorder.add_fcu(any_rows(600, Tick)[:300])
recorder.flush()
recorder.add_plant(any_rows(600, PlantRecord)[300:301])
print("recording", flush=True)
sys.stdin.read()
"""


@pytest.mark.slow
def test_a_killed_recorder_leaves_what_it_had_written(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path)],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"recording\n"
        process.kill()
    assert process.returncode == -signal.SIGKILL
    recording = read(path)
    assert not recording.complete
    assert same_bits(recording.plant, PlantRecord, any_rows(600, PlantRecord)[:300])
    assert same_bits(recording.fcu, Tick, any_rows(600, Tick)[:300])
    assert recording.metadata == {"mission": "killed"}


FULL = """
import resource, sys
from pathlib import Path
from gcs_tools.recording.writer import RecordingWriter
from gcs_tools.recording.reader import RecordingError
from tests.recording.test_record import PlantRecord, Tick, any_rows

plant, fcu = any_rows(2000, PlantRecord), any_rows(2000, Tick)
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
with RecordingWriter(Path(sys.argv[1]), {}) as recorder:
    try:
        for i in range(0, 2000, 50):
            recorder.add_plant(plant[i : i + 50])
            recorder.add_fcu(fcu[i : i + 50])
        recorder.flush()  # a thread writes: it may be told here alone
    except RecordingError as error:
        print(error)
    recorder.close()
"""


@pytest.mark.slow
def test_a_full_disk_is_named_and_leaves_whole_chunks(tmp_path: Path) -> None:
    pytest.importorskip("resource", reason="file size limits are POSIX")
    path = tmp_path / "flight.mcap"
    process = subprocess.run(
        [sys.executable, "-c", FULL, str(path)], cwd=ROOT, capture_output=True, text=True
    )
    assert process.stdout == f"{path}: File too large\n", process.stderr
    assert process.stderr.endswith(f"RecordingError: {path}: File too large\n")  # of close()
    assert path.stat().st_size == 1_000_000
    recording = read(path)
    n = len(recording.plant)
    assert 100 <= n < 2000 and not recording.complete
    assert same_bits(recording.plant, PlantRecord, any_rows(2000, PlantRecord)[:n])
    assert same_bits(recording.fcu, Tick, any_rows(2000, Tick)[: len(recording.fcu)])


@pytest.mark.slow
def test_cut_anywhere_it_gives_the_ticks_before_the_cut(tmp_path: Path) -> None:
    path, cut = tmp_path / "flight.mcap", tmp_path / "cut.mcap"
    plant, fcu = write(path, 400)
    data = path.read_bytes()
    lengths = []
    for end in range(40_000, len(data), 4801):
        cut.write_bytes(data[:end])
        recording = read(cut)
        n, m = len(recording.plant), len(recording.fcu)
        assert not recording.complete
        assert same_bits(recording.plant, PlantRecord, plant[:n])
        assert same_bits(recording.fcu, Tick, fcu[:m])
        lengths.append(n)
    assert lengths == sorted(lengths) and lengths[0] == 0 < lengths[-1] == 400


def test_refusals_name_the_file_and_the_reason(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    with pytest.raises(RecordingError, match=r"flight.mcap: No such file"):
        read(path)
    with pytest.raises(RecordingError, match=r"nowhere.*No such file"):
        RecordingWriter(tmp_path / "nowhere" / "flight.mcap", {})
    write(path, 100)
    with pytest.raises(RecordingError, match=r"flight.mcap: File exists"):
        RecordingWriter(path, {})
    whole = path.read_bytes()
    for content, reason in ((b"", "not a recording"), (b"a text, not", ".*not a valid MCAP")):
        path.write_bytes(content)
        with pytest.raises(RecordingError, match=f"flight.mcap: {reason}"):
            read(path)
    damaged = bytearray(whole)
    damaged[len(whole) // 2] ^= 1  # in the chunk
    path.write_bytes(damaged)
    with pytest.raises(RecordingError, match=r"flight.mcap"):
        read(path)
    version = b"schema_version\x01\x00\x00\x00"  # a name, and the length of its value
    path.write_bytes(whole.replace(version + b"5", version + b"9"))
    with pytest.raises(RecordingError, match=r"recording version 9; this program reads 5"):
        read(path)


@pytest.mark.parametrize("version", ["1", "3"])
def test_a_recording_from_before_the_first_release_is_refused(tmp_path: Path, version: str) -> None:
    path = tmp_path / "flight.mcap"
    text = Path(__file__).with_name("version_4.mcap").read_bytes()
    key = b"schema_version\x01\x00\x00\x00"
    assert key + b"4" in text
    path.write_bytes(text.replace(key + b"4", key + version.encode()))
    with pytest.raises(RecordingError, match=f"recording version {version}; this program reads 5"):
        read(path)


def test_version_4_told_events_and_values_in_sentences() -> None:
    """Five ticks of square_and_land, and all of its events."""
    path = Path(__file__).with_name("version_4.mcap")
    recording, square = read(path), load("square_and_land").flight
    values = values_told(recording.metadata)
    assert values["flight.duration_s"] == 90.0 and values["law.module"] == "mmrac"
    assert values["wind.steady_m_s"] == [4.0, 2.0, 0.0]
    assert not any(name.startswith(("flight.", "law.")) for name in recording.metadata)
    assert recording.metadata["mission"] == "square_and_land"
    flight = flight_of(recording.metadata)
    assert flight is not None and [*map(type, flight.items)] == [*map(type, square.items)]
    assert flight.ground_z_m == square.ground_z_m and flight.start == square.start
    begun = read_begun(flight, recording.events)
    assert [each.leg for each in begun] == [0, 1, 2, 3, 4, 5]
    assert [each.place and each.place.z for each in begun] == [5.0, 6.0, 6.0, 6.0, 6.0, None]
    assert begun[1].tick > 0
    beside = [event for event in recording.events if event.code != ITEM_BEGUN]
    assert {event.who for event in beside} == {"fcu"} and not any(e.code for e in beside)
    metadata, topics, found = messages(path)
    assert metadata == recording.metadata and topics == recording.topics
    assert events.decode(events.schema(), found[events.TOPIC].data) == recording.events


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("fcu: Crashed: hit the ground (gcs reset puts it back)", Code.CRASHED),
        ("fcu: Lost: left the arena (gcs reset puts it back)", Code.DIVERGED),
        ("fcu: Reset: at the start, time begins again", Code.RESET),
        ("plant: the flight ended: the vehicle hit the ground", Code.FLIGHT_ENDED),
    ],
)
def test_what_older_recordings_told_of_an_end_has_its_code(text: str, code: Code) -> None:
    told = old_names.of_event(Event(1.0, "warning", text))
    assert told.code == code.name and told.shown == text
    assert old_names.of_event(told._replace(who="", text="fcu: Armed")).code == ""


class Estimates(NamedTuple):
    """What a law of somebody's own remembers."""

    bias: Vec3  # what it thinks pulls, m/s^2, E
    count: float  # ticks so far


class OwnTick(NamedTuple):
    """What it tells of a tick."""

    t: float
    measured: VehicleState
    state: Estimates
    engaged: float


class OwnParams(NamedTuple):
    """What it is told."""

    h: float  # control period, s
    gain: float


class Record(NamedTuple):
    """A later plant's truth."""

    t: float
    m: float  # mass in force, kg
    humidity: float  # of the air, 0 to 1


def test_a_recording_describes_itself(tmp_path: Path) -> None:
    """Of another law and a later plant: read, and replayed, without their NamedTuples."""
    path, kinds = tmp_path / "flight.mcap", Kinds(OwnTick, OwnParams, Record)
    plant, fcu = any_rows(20, Record), any_rows(20, OwnTick)
    with RecordingWriter(path, {"law": "own"}, kinds) as recorder:
        recorder.set_params(np.array([0.002, 3.0]))
        recorder.add_plant(plant)
        recorder.add_fcu(fcu)
    recording = read(path)
    assert recording.params == {"h": 0.002, "gain": 3.0}
    assert same_bits(recording.fcu, OwnTick, fcu)
    assert same_bits(recording.plant, Record, plant)  # with what this version does not know
    assert np.isnan(recording.plant["T"]).all()  # and without what it knows
    assert "state.estimates.m_hat" not in recording.fcu
    comments = recording.topics["/fcu/law"].comments
    assert comments["state.bias.y"] == "what it thinks pulls, m/s^2, E"
    assert comments["state.count"] == "ticks so far"
    _, topics, found = messages(path)
    assert topics == kinds.topics == recording.topics
    assert topics["/plant/truth"].columns == columns(Record)
    assert found["/plant/truth"].encoding == "application/protobuf;m_mrac.PlantTruthTicks"
    assert len(found["/plant/truth"].data) == 20


class Gust(NamedTuple):
    """What a later plant tells beside."""

    w: float  # m/s
    extent: float  # m


def test_a_topic_that_nobody_knows_is_read(tmp_path: Path) -> None:
    path, gusts = tmp_path / "flight.mcap", any_rows(3, Record)
    later = topic_of(Declaration("/plant/gusts", "PlantGusts", Gust, "", ("t",), "gusts."))
    file = RecordingFile(path, {"mission": "later"})
    for topic in (*TOPICS.values(), later):
        channel = file.add_channel(*topic[:3], topic.metadata)
    numbers = np.arange(3, dtype=np.uint64)
    file.write([block_of(channel, numbers, numbers, encode(later.layout, gusts))])
    file.add_channel(events.TOPIC, events.MESSAGE, events.schema())
    file.finish()
    file.close()
    found = read(path).reports["/plant/gusts"]
    assert found.names == ("t", "gusts.w", "gusts.extent")
    assert found.rows.tobytes() == gusts.tobytes()


def test_rows_that_are_none_are_refused(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "flight.mcap", {}) as recorder:
        with pytest.raises(ValueError, match=rf"expected float64 \(n, {size(PlantRecord)}\)"):
            recorder.add_plant(np.zeros((2, 40)))
        with pytest.raises(ValueError, match="not a simulation time: nan"):
            recorder.add_plant(np.full((1, size(PlantRecord)), np.nan))


def rewrite(source: Path, to: Path, keep: Callable[[str, int], bool]) -> None:
    """Copy a recording with mcap's own writer, message by message, as other tools do."""
    with source.open("rb") as file, to.open("wb") as out:
        reader, writer = make_reader(file), Writer(out)
        writer.start()
        summary = reader.get_summary()
        assert summary is not None
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        numbers = {}
        for number, channel in summary.channels.items():
            found = summary.schemas[channel.schema_id]
            kind = writer.register_schema(found.name, found.encoding, found.data)
            numbers[number] = writer.register_channel(channel.topic, "protobuf", kind)
        for _, channel, message in reader.iter_messages():
            if keep(channel.topic, message.sequence):
                writer.add_message(
                    numbers[channel.id], message.log_time, message.data,
                    message.publish_time, message.sequence,
                )  # fmt: skip
        writer.finish()  # type: ignore[no-untyped-call]


def test_a_copy_by_another_tool_is_read(tmp_path: Path) -> None:
    plant, fcu = write(tmp_path / "flight.mcap", 300)
    rewrite(tmp_path / "flight.mcap", tmp_path / "copy.mcap", lambda topic, k: True)
    recording = read(tmp_path / "copy.mcap")
    assert same_bits(recording.plant, PlantRecord, plant)
    assert same_bits(recording.fcu, Tick, fcu)


@pytest.mark.parametrize(
    ("lost", "reason"),
    [
        (("/plant/truth", 7), "/plant/truth: tick 7 is missing"),
        (("/fcu/law", 99), "/fcu/law .* not of the same ticks"),
    ],
)
def test_a_missing_tick_is_not_passed_over(
    tmp_path: Path, lost: tuple[str, int], reason: str
) -> None:
    write(tmp_path / "flight.mcap", 100)
    rewrite(tmp_path / "flight.mcap", tmp_path / "copy.mcap", lambda *message: message != lost)
    with pytest.raises(RecordingError, match=reason):
        read(tmp_path / "copy.mcap")
