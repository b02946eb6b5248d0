"""What strangers send and what files become: counted or named, never a traceback."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from mcap.writer import Writer

from fcu.interface.event_log import Event
from gcs_tools.live.recorder import Latency
from gcs_tools.live.samples import Sample, SampleError, describe, described
from gcs_tools.live.subscriber import _object
from gcs_tools.pictures.follower import Follower
from gcs_tools.recording import events
from gcs_tools.recording.layout import encode
from gcs_tools.recording.reader import RecordingError, read
from gcs_tools.recording.schema import TIMING, TOPICS
from tests.command_line import gcs


def sample(*messages: bytes) -> Sample:
    sequence = np.arange(len(messages), dtype=np.uint64)
    return Sample(sequence, sequence, list(messages))


def test_a_level_that_there_is_not_is_unknown():
    message = events._message_class(events.schema())(level=-7, message="x")
    (event,) = events.decode(events.schema(), [message.SerializeToString()])
    assert event == Event(0.0, "unknown", "x")


@pytest.mark.parametrize(
    ("topic", "data"),
    [("/events", b"\xff\xff"), ("/fcu/measured", b"short"), ("/plant/truth", b"")],
)
def test_what_is_no_message_of_its_topic_is_counted(topic, data):
    vehicle = SimpleNamespace(
        about={}, topics=TOPICS, latest=lambda: [(topic, sample(data))], take=list
    )
    assert Follower(vehicle).unusable == (
        1 if topic != "/fcu/measured" else 0
    )  # which it does not read


def test_a_time_that_is_none_has_no_age():
    timing, latency = TOPICS[TIMING], Latency(TOPICS[TIMING])
    latency.see(sample(*encode(timing.layout, np.full((1, len(timing.columns)), np.nan))))
    assert latency.percentile(50.0) is None


def test_a_vehicle_describes_its_topics():
    assert described(describe(TOPICS)) == TOPICS


@pytest.mark.parametrize(
    "data",
    [
        b"[" * 100_000, b"\xff", b"[]", b'{"/x": 3}', b'{"/x": {"message": "M", "schema": 3}}',
        b'{"/x": {"message": "M", "schema": "AA"}}', b'{"/x": {"message": "M", "own": 5}}',
    ],
)  # fmt: skip
def test_what_describes_no_topic_is_refused(data):
    with pytest.raises(SampleError):
        described(data)


@pytest.mark.parametrize("data", [b"[" * 100_000, b"\xff", b"[]", b"3", b'"x"', b"{"])
def test_what_is_no_object_says_nothing(data):
    assert _object(data) == {}


def test_a_recording_with_any_byte_changed_is_read_or_refused(recording, tmp_path):
    """Also where no checksum is: records that contradict each other."""
    whole, path = recording.path.read_bytes()[:80_000], tmp_path / "changed.mcap"
    random = np.random.default_rng(1)
    said = []
    for at in random.integers(0, 40_000, 60):  # header, schemas, channels
        changed = bytearray(whole)
        changed[at] ^= int(random.integers(1, 256))
        path.write_bytes(changed)
        try:
            read(path)
        except RecordingError as error:
            said.append(str(error))
    assert len(said) > 5
    assert all(words.startswith(f"{path}: ") for words in said)


def test_another_programs_file_is_named(tmp_path):
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    with pytest.raises(RecordingError, match="not a recording of a flight"):
        read(path)


def test_what_a_terminal_would_act_on_is_not_shown():
    told = b'{"title": "a\\u001b[2Jb\\ud800", "values": {"x\\n": ["\\u0007"]}}'
    mark = "\N{REPLACEMENT CHARACTER}"
    assert _object(told) == {"title": f"a{mark}[2Jb{mark}", "values": {f"x{mark}": [mark]}}


@pytest.mark.parametrize("option", ["--from", "--to"])
@pytest.mark.parametrize("value", ["nan", "-inf", "1e305", "-1"])
def test_a_time_that_is_none_is_refused(recording, option, value):
    done = gcs("replay", recording.path, option, value)
    assert done.exit_code == 2
    assert "expected 0 to 1e+07 s" in done.stderr


EVIL = r"\u001b]0;owned\u0007\u009b31m\u202e"
MISSION = 'title = "A hover."\n[flight]\nduration_s = 0.5\nsetpoints = [[0.0, 0.0, 0.0, 0.0]]\n'


@pytest.mark.parametrize("text", [
    f'{MISSION}"{EVIL}" = 1', f'{MISSION}["{EVIL}"]\na = 1', f'{MISSION}["a\\nerror: x"]\na = 1',
    f'{MISSION}[expect]\n"{EVIL}" = 1', f'{MISSION}[vehicle.params]\n"{EVIL}" = 1', f'{MISSION}[law]\n"{EVIL}" = 1',
    f'{MISSION}[wind]\nfile = "{EVIL}.csv"', f'{MISSION}[wind]\nfile = "{EVIL}.parquet"',
    f'{MISSION}[wind]\nfield = {{ file = "{EVIL}" }}', f'{MISSION}[law]\nmodule = "{EVIL}.py"',
    f'{MISSION}[law]\nmodule = "{EVIL}"', f'airframe = "{EVIL}.toml"\n{MISSION}',
    MISSION.replace("setpoints", f'plan = "{EVIL}.plan"\nx'), MISSION.replace("A hover.", EVIL),
])  # fmt: skip
def test_names_and_keys_of_a_mission_reach_no_terminal_as_they_are(tmp_path, text):
    path = tmp_path / "x.toml"
    path.write_text(text + "\n")
    for command in ("envelope", "fly"):
        done = gcs(command, path)
        assert done.exit_code == 2
        assert all(line.isprintable() for line in done.stderr.split("\n"))
        assert "\nerror: x" not in done.stderr


@pytest.mark.parametrize("text", [
    'set = { "XX" = 1 }', 'mission = "XX"', 'mission = "XX.toml"', '[draw]\n"plant.XX" = { uniform = [0.0, 1.0] }',
    '[draw]\n"XX" = { uniform = [0.0, 1.0] }', 'laws = ["XX"]', 'laws = ["XX.py"]', 'airframe = "XX.toml"', '"XX" = 1',
])  # fmt: skip
def test_names_and_keys_of_a_campaign_reach_no_terminal_as_they_are(tmp_path, text):
    mission = "" if text.startswith("mission") else 'mission = "noisy_state"\n'
    path = tmp_path / "x.toml"
    path.write_text(
        f'title = "Does it?"\nflights = 2\nfly = "law"\n{mission}{text.replace("XX", EVIL)}\n'
    )
    done = gcs("campaign", path, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert all(line.isprintable() for line in done.stderr.split("\n"))
