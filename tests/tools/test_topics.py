"""What is on the bus, as a list; and the example of the docs."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path

import pytest

from fcu.interface import topics
from fcu.interface.ports import ports
from gcs_tools.live.topics import print_table
from gcs_tools.recording import events
from gcs_tools.recording.schema import TOPICS
from tests.process.conftest import claimed_instance

ROOT = Path(__file__).parents[2]


@pytest.mark.alone
def test_every_topic_is_listed_with_its_message_and_rate(replay, tool, instance):
    replay("--speed", "1", "--wait")
    found = tool("topics", "--for", "2")
    assert found["vehicle"] == str(ports(instance).system_id)
    assert set(found["topics"]) == {*TOPICS, events.TOPIC}
    within = f"m_mrac/{found['run']}/{found['vehicle']}"
    for topic in TOPICS.values():
        line = found["topics"][topic.name]
        assert line["key"] == within + topic.name
        assert line["message"] == f"{topic.message}Ticks"
        assert (line["lost"], line["unreadable"]) == (0, 0)
        if topic.name != "/fcu/params":
            assert 400.0 < line["rate_hz"] < 600.0


def test_of_two_vehicles_the_one_that_was_asked_for_is_met_and_named(
    replay, start, instance, recording
):
    replay("--speed", "0.1", "--wait")  # slow: both are there until a busy machine has looked
    with claimed_instance() as second:
        start(
            "gcs_tools", "replay", recording.path, "--instance", second, "--speed", "0.1", "--wait"
        ).says("replaying")
        asked, any_one = (
            start("gcs_tools", "topics", "--for", "2", *which)
            for which in (("--instance", second), ())
        )
        assert asked.wait() == 0, asked.text()
        one, other = (f"vehicle {ports(n).system_id}" for n in (second, instance))
        assert f"met {one}, run" in asked.err.read_text()
        assert other not in asked.err.read_text()
        assert any_one.wait() == 0, any_one.text()
        met, _, beside = any_one.err.read_text().partition("not met")
        assert met.count("met vehicle") == 1
        assert all(name in met + beside for name in (one, other))


def test_topics_says_when_no_vehicle_is_heard(start, instance):
    program = start("gcs_tools", "topics", "--instance", instance)
    program.says("waiting for instance")
    assert program.interrupted() == 130


@pytest.mark.alone
def test_the_table_is_for_people(replay, start, instance):
    replay("--speed", "1", "--wait")
    program = start("gcs_tools", "topics", "--instance", instance)
    assert program.wait() == 0
    assert re.search(r"fcu/law +FcuLawTicks +\d+", " ".join(program.out.read_text().split()))


@pytest.mark.parametrize("columns", ["60", "80"])
def test_no_column_of_the_table_is_cut(monkeypatch, capsys, columns):
    monkeypatch.setenv("COLUMNS", columns)
    long = "a_law_of_your_own_that_has_a_long_name"
    topic = {
        "ticks": 1000, "rate_hz": 500.0, "samples_hz": 50.0, "bytes_s": 1e6, "tick_bytes": 1234.0,
        "lost": 0, "unreadable": 0, "last_sequence": 123456789,
    }  # fmt: skip
    names = ("plant/truth", long)
    found = {name: {**topic, "key": name, "message": f"m_mrac.{name}Ticks"} for name in names}
    print_table({"vehicle": "1", "run": "r", "mission": None, "alive": [], "topics": found})
    out = capsys.readouterr().out
    assert "…" not in out
    assert re.search(rf"{long} +{long}Ticks +500\.0 +50\.0 +1000\.0 +1234 +0 +123456789", out)


def test_the_example_of_the_docs_reads_the_law(replay, instance, tmp_path):
    text = (ROOT / "docs" / "diagnostics.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (protoc,) = re.findall(r"`(protoc .*?)`", text, re.DOTALL)
    files = [str(p.relative_to(ROOT)) for p in (ROOT / "docs/schemas/m_mrac").glob("*.proto")]
    words = protoc.split()[1:-1]
    assert words == ["-I", "docs/schemas", "--python_out=."]
    words[-1] = f"--python_out={tmp_path}"
    subprocess.run(
        [sys.executable, "-m", "grpc_tools.protoc", *words, *files], cwd=ROOT, check=True
    )
    (tmp_path / "example.py").write_text(code.replace("7447", str(topics.port(instance))))
    replay("--speed", "1", "--wait").says("replaying")
    with subprocess.Popen(
        [sys.executable, "-u", "example.py"], cwd=tmp_path, stdout=subprocess.PIPE, text=True
    ) as example:
        assert example.stdout.readline() == "paper_nominal\n"
        first, second = (example.stdout.readline().split() for _ in range(2))
        example.kill()
    assert int(second[0]) == int(first[0]) + 1
    assert float(second[1]) == pytest.approx(float(first[1]) + 0.002)
    assert 4.0 < float(first[3]) < 12.0


def test_the_example_of_the_docs_reads_the_wind(replay, instance, tmp_path):
    text = (ROOT / "docs" / "wind.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (tmp_path / "example.py").write_text(code.replace("7447", str(topics.port(instance))))
    replay("--speed", "1", "--wait").says("replaying")
    with subprocess.Popen(
        [sys.executable, "-u", "-W", "error", "example.py"], cwd=tmp_path,
        stdout=subprocess.PIPE, text=True,
    ) as example:  # fmt: skip
        first, second = (example.stdout.readline().split() for _ in range(2))
        example.kill()
    assert float(second[0]) == pytest.approx(float(first[0]) + 0.002)
    assert all(-20.0 < float(number) < 20.0 for number in (first[3], first[6]))


def test_the_example_of_the_docs_waits_for_a_wind_until_the_vehicle_flies(
    start, instance, tmp_path
):
    text = (ROOT / "docs" / "wind.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (tmp_path / "example.py").write_text(code.replace("7447", str(topics.port(instance))))
    up = start("gcs_tools", "up", "--instance", instance, "--speed", 4)
    up.says("ready")
    with subprocess.Popen(
        [sys.executable, "-u", "example.py"], cwd=tmp_path, stdout=subprocess.PIPE, text=True
    ) as example:
        go = start("gcs_tools", "setpoint", 1, 0, 2, "--instance", instance)
        assert go.wait() == 0, go.text()
        first = example.stdout.readline().split()
        example.kill()
    assert float(first[0]) > 0.0
    assert all(math.isfinite(float(number)) for number in (first[3], first[6]))
