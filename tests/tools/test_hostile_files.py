"""Files that are not what their names promise: each command says so, soon and in little memory."""

from __future__ import annotations

import json
import os
import resource
import struct
import subprocess
import sys
import xml.etree.ElementTree as ET

import lz4.frame
import pytest
import zstandard
from mcap.writer import CompressionType, Writer

from fcu.interface.airframe import believed
from fcu.interface.files import input_file
from fcu.interface.files.toml_lines import lines
from fcu.laws.loader import LawError
from fcu.laws.loader import load as load_law
from fcu.parameters import Parameters, ParamsFileError
from fcu.process.settings import settings
from gcs_tools.missions.mission import MissionError, load
from gcs_tools.recording import records
from gcs_tools.recording.reader import RecordingError, read
from gcs_tools.recording.repair import recover
from tests.command_line import gcs

HOVER = """title = "A hover of half a second."
[flight]
duration_s = 0.5
setpoints = [[0.0, 0.0, 0.0, 0.0]]
"""
MOST_BYTES = 500_000_000  # of memory, for anything here
WITHIN_S = 20  # of processor time: a start of Python is a part of it
BRACKETS, DIGITS = "[" * 5000, "9" * 5000


def _folder(path):
    path.mkdir()


def _link(path):
    path.symlink_to(path)


def _sparse(path):
    with path.open("wb") as file:
        file.truncate(1 << 30)


def _sparse_after_a_head(path):
    with path.open("wb") as file:
        file.write(b"\x89MCAP0\r\n" + struct.pack("<BQ", 1, 1 << 29))
        file.truncate(1 << 30)


NO_FILES = {
    "zeros": lambda path: path.symlink_to("/dev/zero"), "pipe": os.mkfifo, "folder": _folder,
    "link": _link, "sparse": _sparse, "sparse after a head": _sparse_after_a_head,
    "brackets": lambda path: path.write_text(BRACKETS),
    "not UTF-8": lambda path: path.write_bytes(b"\xff\xfe" * 100),
}  # fmt: skip
TEXTS = {
    "brackets": f"x = {BRACKETS}{']' * 5000}\n{HOVER}",
    "tables": f"x = {'{a=' * 5000}1{'}' * 5000}\n{HOVER}",
    "33 arrays": f"x = {'[' * 33}{']' * 33}\n{HOVER}",
    "digits": f"{HOVER}\n[law]\nf_m = {DIGITS}\n",
    "hexadecimal": f"{HOVER}\n[law]\nf_m = 0x{DIGITS}\n",
    "dots": f"{'a.' * 500_000}b = 1\n{HOVER}",
    "quoted dots": f"{chr(34)}a{chr(34)}." * 300_000 + f"b = 1\n{HOVER}",
    "dots after five quotes": f'x = {{ a = """b""""", {"a." * 200_000}b = 1 }}\n{HOVER}',
    "byte order mark": f"\ufeff{HOVER}",
}
LONG = 400_000  # characters: whoever looks from each at all that follow takes minutes
LONG_TEXTS = {
    "text": f'title = "{"a" * LONG}"',
    "literal text": f"title = '{'a-' * LONG}'",
    "text of lines": f'title = """{chr(34)}{"a.b" * (LONG // 3)}"""',
    "key": f"{'k' * LONG} = 1",
    "quoted key": f'"{"k" * LONG}" = 1',
    "digits": f"x = 0.{'1' * LONG}",
    "array": f"x = [{'1.5, ' * (LONG // 5)}]",
}


def limited():
    resource.setrlimit(resource.RLIMIT_AS, (8 * MOST_BYTES, 8 * MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (WITHIN_S, WITHIN_S))


# the most memory since it was started: getrusage tells that of whoever forked it, if that is more
USED = """
import sys
from pathlib import Path
from gcs_tools.__main__ import main
try:
    main(prog_name="gcs")
finally:
    status = Path("/proc/self/status").read_text()
    print(1024 * int(status.split("VmHWM:")[1].split()[0]))
"""

READ = """
import sys
from fcu.interface.files.input_file import toml
from fcu.interface.files.toml_lines import lines
text = sys.stdin.read()
print(len(toml(text)), lines(text).popitem()[1])
"""


@pytest.mark.parametrize("kind", NO_FILES)
@pytest.mark.parametrize(
    "words", ["fly X --in-process", "envelope X", "up X", "plot X", "recover X", "view X --no-open",
              "replay X", "fly gust_step --in-process --law X", "topics --zenoh X"],
)  # fmt: skip
def test_what_is_no_such_file_is_named_soon_and_in_little_memory(tmp_path, kind, words):
    name = "x.py" if "--law" in words else "x.json5" if "--zenoh" in words else "x.toml"
    NO_FILES[kind](tmp_path / name)
    done = subprocess.run(
        [sys.executable, "-c", USED, *words.replace("X", name).split()], cwd=tmp_path,
        capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL, preexec_fn=limited,
        timeout=180,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert name in done.stderr
    assert "Traceback" not in done.stderr
    assert int(done.stdout.split()[-1]) < MOST_BYTES
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    "words", ["fly", "campaign", "campaign paper_noise --out", "compare mmrac se3 --missions", "replay", "plot", "view", "recover", "record", "recover x.mcap --out",
              "envelope", "fly gust_step --junit", "up --params"],
)  # fmt: skip
def test_a_name_that_no_file_can_have_is_named(words):
    name = "a" * 5000
    done = gcs(*words.split(), name)
    assert done.exit_code == 2
    assert name in done.stderr


@pytest.mark.parametrize(
    "name", ["a" * 5000, "a" * 5000 + ".toml", "a/" + "a" * 5000, "a\\u0000.toml"]
)
def test_a_mission_that_no_file_can_be_is_exit_code_2_in_a_campaign(tmp_path, name):
    path = tmp_path / "x.toml"
    path.write_text(f'title = "x"\nmission = "{name}"\nflights = 1\n')
    done = gcs("campaign", path, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert f"{path}:2: mission: a" in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("suffix", [".py", ".toml"])
def test_a_law_and_an_airframe_that_no_file_can_be_are_told_with_their_line(tmp_path, suffix):
    line = f'airframe = "{"a" * 5000}.toml"' if suffix == ".toml" else ""
    law = f'[law]\nmodule = "{"a" * 5000}.py"\n' if suffix == ".py" else ""
    path = tmp_path / "x.toml"
    path.write_text(f"{line}\n{HOVER}{law}")
    for command in ("fly", "envelope"):
        done = gcs(command, path)
        assert done.exit_code == 2
        assert f"{path}:{7 if law else 1}: " in done.stderr


def test_the_longest_name_of_a_file_can_be_flown(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / f"{'a' * 250}.toml"
    path.write_text(HOVER)
    assert gcs("fly", path, "--in-process", "--figure", "never").exit_code == 0


@pytest.mark.parametrize("kind", TEXTS)
def test_a_mission_that_would_exhaust_its_reader_is_rejected(tmp_path, kind):
    path = tmp_path / "bad.toml"
    path.write_text(TEXTS[kind], encoding="utf-8")
    with pytest.raises(MissionError, match=r"bad\.toml.*expected"):
        load(path)


@pytest.mark.parametrize("kind", LONG_TEXTS)
def test_what_is_long_is_read_at_once(kind):
    """In a process of its own, of so much processor time and no more."""
    done = subprocess.run(
        [sys.executable, "-c", READ], input=LONG_TEXTS[kind], capture_output=True, text=True,
        check=False, preexec_fn=limited, timeout=180,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "1 1\n"), done.stderr


@pytest.mark.parametrize("text", ['\\"', '"""a', "'''a", '"\\\n', "'a\n"])
def test_texts_without_an_end_are_searched_once(text):
    """In a process of its own, of so much processor time and no more."""
    done = subprocess.run(
        [sys.executable, "-c", READ], input=text * (LONG // len(text)), capture_output=True, text=True,
        check=False, preexec_fn=limited, timeout=180,
    )  # fmt: skip
    assert "TomlError" in done.stderr, done.returncode


@pytest.mark.parametrize("value", [f"{BRACKETS}{']' * 5000}", DIGITS, f"0x{DIGITS}"])
def test_a_setting_that_would_exhaust_its_reader_is_rejected(value):
    with pytest.raises(MissionError, match="--set"):
        load("gust_step", [f"law.f_m={value}"])


def test_a_mission_with_many_faults_tells_some_of_them_and_how_many_more(tmp_path):
    path = tmp_path / "bad.toml"
    rows = "{ at_s = 0.0, position_m = [0.0] },\n" * 5000
    path.write_text(HOVER.replace("[[0.0, 0.0, 0.0, 0.0]]", f"[{rows}]"))
    with pytest.raises(MissionError) as found:
        load(path)
    told = str(found.value).splitlines()
    assert len(told) < 30
    assert "4980 more" in told[-1]


def test_lines_are_counted_once(monkeypatch):
    """Ten times the setpoints take ten times the characters that are looked at, not a hundred."""

    class Counting(str):
        looked_at = 0

        def count(self, mark, start, end):
            Counting.looked_at += end - start
            return str.count(self, mark, start, end)

    text = Counting("a = [\n" + "[0.0, 0.0, 0.0, 0.0],\n" * 1000 + "]\n")
    found = lines(text)
    assert found["a", 999] == 1001
    assert Counting.looked_at < 3 * len(text)


def test_of_several_missions_the_good_ones_fly_and_the_bad_ones_are_named(tmp_path):
    (tmp_path / "bad.toml").write_text("title = \n")
    (tmp_path / "hover.toml").write_text(HOVER)
    bad, good = tmp_path / "bad.toml", tmp_path / "hover.toml"
    done = gcs(
        "fly", bad, good, "no_such_mission", "--in-process", "--json", "--out", tmp_path / "run",
        "--junit", tmp_path / "junit.xml",
    )  # fmt: skip
    assert done.exit_code == 2
    told = json.loads(done.stdout)
    assert [(each["exit_code"], each["ended"]) for each in told] == [
        (2, "rejected"), (0, "time"), (2, "rejected"),
    ]  # fmt: skip
    assert "bad.toml:1: " in told[0]["error"]
    assert [p.name for p in (tmp_path / "run").iterdir()] == ["hover"]
    suite = ET.parse(tmp_path / "junit.xml").getroot()
    assert [suite.get(k) for k in ("tests", "failures", "errors")] == ["3", "0", "2"]
    said = gcs("fly", bad, good, "--in-process", "--figure", "never", "--out", tmp_path / "again")
    assert said.exit_code == 2
    assert "bad.toml:1: " in said.stderr
    assert "1 of 2 passed" in said.stdout


def test_a_law_and_a_file_of_parameters_are_read_up_to_a_size(tmp_path):
    law, params = tmp_path / "law.py", tmp_path / "x.params"
    _sparse(law)
    with pytest.raises(LawError, match="larger than 1 MiB"):
        load_law(str(law))
    params.write_text(f"MR_FM = {BRACKETS}")
    with pytest.raises(ParamsFileError, match="expected"):
        Parameters(settings(*believed(), 500.0), 1, params)


def _bomb(path, compression, message=b"\0" * 4_000_000):
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, chunk_size=1)
        writer.start()
        schema = writer.register_schema("M", "protobuf", b"")
        channel = writer.register_channel("/x", "protobuf", schema)
        writer.add_message(channel, 0, message, 0)
        writer.finish()


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize("open_it", [read, lambda path: recover(path, path.with_suffix(".new"))])
def test_a_recording_unpacks_to_no_more_than_it_may(tmp_path, compression, open_it):
    path = tmp_path / "bomb.mcap"
    _bomb(path, compression)
    assert path.stat().st_size * records.TIMES < 4_000_000
    with pytest.raises(RecordingError, match=f"more than {records.TIMES} times its size"):
        open_it(path)


@pytest.mark.parametrize("pack", [lz4.frame.compress, zstandard.compress])
def test_a_chunk_that_says_less_than_it_unpacks_to_is_damaged(tmp_path, pack):
    path = tmp_path / "bomb.mcap"
    packed, name = pack(b"\0" * 50_000_000), b"lz4" if pack is lz4.frame.compress else b"zstd"
    chunk = struct.pack("<QQQI", 0, 0, 1000, 0) + struct.pack("<I", len(name)) + name
    chunk += struct.pack("<Q", len(packed)) + packed
    header = struct.pack("<BQII", 1, 8, 0, 0)
    head = b"\x89MCAP0\r\n" + header
    path.write_bytes(head + struct.pack("<BQ", 6, len(chunk)) + chunk)
    with pytest.raises(RecordingError, match="the size that it says"):
        read(path)


def test_a_text_is_read_with_either_end_of_line(tmp_path):
    path = tmp_path / "x.toml"
    path.write_bytes(HOVER.replace("\n", "\r\n").encode())
    assert load(path).flight.duration_s == 0.5
    assert input_file.text(path, 1000) == HOVER
