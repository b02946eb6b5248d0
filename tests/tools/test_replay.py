"""What was recorded goes back onto the bus, and comes off it as it was."""

from __future__ import annotations

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from gcs_tools.recording.reader import read
from tests.command_line import gcs


def same(a, b):
    return a.names == b.names and a.rows.tobytes() == b.rows.tobytes()


def test_a_replay_recorded_is_the_recording(recording, replay, tool, recorded):
    sent = replay("--speed", "max", "--wait")
    said = tool("record", recorded)
    assert sent.wait() == 0
    assert (said["ticks"], said["lost"], said["ended"]) == (3000, {}, "the vehicle is gone")
    found = read(recorded)
    assert same(found.plant, recording.plant) and same(found.fcu, recording.fcu)
    assert found.params == recording.params
    assert found.reports.keys() == recording.reports.keys()
    assert all(same(found.reports[topic], rows) for topic, rows in recording.reports.items())
    assert found.events == recording.events != []
    assert found.metadata["mission"] == "paper_nominal"
    assert said["latency_p50_s"] is None  # its ticks are old


def test_a_part_of_it(recording, replay, tool, recorded):
    replay("--speed", "max", "--wait", "--from", "1", "--to", "2.5")
    said = tool("record", recorded)
    assert (said["first_s"], said["last_s"]) == (1.0, 2.5)
    found = read(recorded)
    t = recording.fcu["t"]
    assert same(found.fcu, recording.fcu.take((t >= 1.0 - 1e-9) & (t <= 2.5 + 1e-9)))
    assert found.params == recording.params  # told before, and still in force


def test_replay_keeps_time(replay, tool, recorded):
    replay("--speed", "0.5", "--wait")
    seen = tool("monitor", "--after", "2")
    assert 0.0 < seen["time_s"] < 5.9  # under way: not all of it at once
    assert seen["status"] == "offboard, armed"


@pytest.mark.parametrize(
    ("content", "why"),
    [(None, "No such file"), (b"", "not a recording"), (b"\x89MCAP0\r\n", "not a recording")],
)
def test_what_cannot_be_read_is_named(tmp_path, content, why):
    path = tmp_path / "bad.mcap"
    if content is not None:
        path.write_bytes(content)
    done = gcs("replay", path)
    assert done.exit_code == 2
    assert f"{path}: " in done.stderr and why in done.stderr


def test_a_time_that_it_does_not_have_is_named(replay):
    program = replay("--from", "100")
    assert program.wait() == 2
    assert "nothing from 100" in program.text()


@pytest.mark.parametrize("name", ["", "/", "fcu//law", "/fcu/*", "fcu/law/"])
def test_a_topic_that_is_no_key_is_named(recording, tmp_path, name):
    path = tmp_path / "renamed.mcap"
    with recording.path.open("rb") as file, path.open("wb") as out:
        found, writer = make_reader(file), Writer(out)
        writer.start()
        for each in found.iter_metadata():
            writer.add_metadata(each.name, each.metadata)
        schema, channel, message = next(found.iter_messages(topics=["/fcu/law"]))
        number = writer.register_schema(schema.name, schema.encoding, schema.data)
        to = writer.register_channel(name, channel.message_encoding, number, channel.metadata)
        writer.add_message(to, message.log_time, message.data, message.publish_time)
        writer.finish()
    done = gcs("replay", path)
    assert done.exit_code == 2
    assert f"{path}: topic {name!r}" in done.stderr


def test_replay_is_interrupted(replay, until):
    program = replay("--loop")
    program.says("replaying")
    assert program.interrupted() == 0


def test_time_on_the_wire_is_whole_nanoseconds(recording):
    ns = np.rint(recording.fcu["t"] * 1e9)
    assert (ns % 2_000_000 == 0).all()
