"""What `gcs fly` refuses, with file, line and key, and what it hands back."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from tests import command_line
from tests.patience import PATIENCE_S

QUAD = Path(__file__).parents[1] / "own_airframe" / "quad.toml"
QUICK = ("--in-process", "--set", "flight.duration_s=0.5", "--figure", "never")
MISSION = """title = "A hover of half a second."
[flight]
duration_s = 0.5
setpoints = [{ at_s = 0.0, position_m = [0.0, 0.0, 0.0] }]
"""


@pytest.fixture
def gcs(tmp_path):
    """`gcs("fly", ...)`: exit code, standard output and standard error."""

    def run(*arguments):
        words = [sys.executable, "-m", "gcs_tools", *map(str, arguments)]
        done = subprocess.run(
            words, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=PATIENCE_S
        )
        assert "Traceback" not in done.stderr
        return done.returncode, done.stdout, done.stderr

    return run


@pytest.fixture
def refused(tmp_path, monkeypatch):
    """`refused("fly", ...)`: what it says on standard error, and does nothing; without a process."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        done = command_line.gcs(*arguments)
        assert (done.exit_code, done.stdout) == (2, "")
        return done.stderr

    return run


INTERRUPTED_WHILE_LOADED = """
import runpy, sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "click":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Finder())
runpy.run_module("gcs_tools", run_name="__main__")
"""


def test_interrupted_while_it_is_loaded_it_ends_as_ever():
    words = [sys.executable, "-c", INTERRUPTED_WHILE_LOADED]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert (done.returncode, done.stderr) == (130, "")


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_that_cannot_show_a_character_gets_a_plainer_one(
    gcs, tmp_path, monkeypatch, encoding
):
    monkeypatch.setenv("PYTHONIOENCODING", encoding)
    mission = MISSION.replace("hover of", "日 hover ≤") + "[expect]\nreference_error_max_m = 1.0\n"
    (tmp_path / "hover.toml").write_text(mission, encoding="utf-8")
    code, out, _ = gcs("fly", "hover.toml", *QUICK, "--figure", "never")
    assert code == 0
    assert "A ? hover <= half a second." in out
    assert "reference_error_max_m <= 1" in out


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("title = \n", ":1"),
        (MISSION + "[law]\nf_n = 1.0\n", ":6"),
        (MISSION + "[plant]\nmass_kg = -1.0\n", ":6"),
        (MISSION + "[law]\nf_m = 'fast'\n", ":6"),
        (MISSION + "[expect]\nreference_error_rms = 1.0\n", ":6"),
    ],
    ids=["no TOML", "unknown key", "out of range", "not a number", "no metric"],
)
def test_a_bad_mission_is_refused_with_its_line(refused, tmp_path, text, expected):
    (tmp_path / "bad.toml").write_text(text)
    assert f"bad.toml{expected}" in refused("fly", "bad.toml")
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("no_such_mission",), "no_such_mission"),
        (("paper_nominal", "--set", "law.f_n=1"), "law.f_n"),
        (("paper_nominal", "--set", "f_m"), "f_m"),
        (("paper_nominal", "--speed", "0"), "--speed"),
        (("paper_nominal", "--rate", "7"), "rate"),
        (("paper_fast", "--set", 'law.guard="refuse"'), "19.7 m"),
        (("paper_nominal", "--instance", "10"), "--instance"),
        ((), "MISSION"),
    ],
)
def test_a_bad_command_line_is_refused(refused, arguments, expected):
    assert expected in refused("fly", *arguments)


@pytest.mark.parametrize(
    ("name", "said"),
    [("envelop", "(did you mean envelope?)"), ("monitr", "(did you mean monitor?)"), ("xyzzy", "there are fly, ")],
)  # fmt: skip
def test_a_command_that_there_is_not_is_told_with_the_one_that_was_meant(refused, name, said):
    assert f"No such command '{name}'" in (told := refused(name, "paper_nominal"))
    assert said in told


@pytest.mark.parametrize("command", ["fly", "envelope"])
@pytest.mark.parametrize(
    ("name", "option"),
    [("my_pid.py", "--law"), ("none.py", "--law"), ("px4", "--law"), ("lab3.toml", "--airframe"), ("quad", "--airframe")],
)  # fmt: skip
def test_a_law_or_an_airframe_in_the_place_of_a_mission_is_told_with_its_option(
    refused, tmp_path, command, name, option
):
    (tmp_path / "my_pid.py").write_text("P = 1.0\n")
    (tmp_path / "lab3.toml").write_text(QUAD.read_text())
    (line,) = refused(command, name).splitlines()
    assert f"did you mean {option} {name}" in line


@pytest.mark.parametrize("text", ["[vehicle]\n[rotors]\n[flight]\n", "[vehicle]\n", "[", ""])
def test_a_mission_with_errors_is_still_told_by_its_errors(refused, tmp_path, text):
    (tmp_path / "mine.toml").write_text(text)
    told = refused("fly", "mine.toml")
    assert "mine.toml" in told
    assert "did you mean --" not in told


def test_equal_flights_of_several_seeds_are_told_once(gcs, tmp_path):
    (tmp_path / "hover.toml").write_text(MISSION)
    for noise, told in ((0.0, 1), (0.01, 0)):
        of = f"plant.noise.position_m={noise}"
        code, out, err = gcs(
            "fly", "hover.toml", "--seed", "1..3", *QUICK, "--set", of, "--out", of
        )
        assert (code, out.count("nothing is drawn")) == (0, 0)
        assert err.count("hover: nothing is drawn from the seed") == told
    assert "nothing is drawn" not in gcs("fly", "hover.toml", "--seed", "2", *QUICK)[2]


def test_a_file_in_the_place_of_the_folder_is_refused(refused, tmp_path):
    (tmp_path / "run").write_text("mine")
    assert "run: " in (told := refused("fly", "paper_nominal", "--out", "run", *QUICK))
    assert "a file" in told
    assert (tmp_path / "run").read_text() == "mine"


def test_a_pipe_is_refused_with_what_to_do(refused, tmp_path):
    """Also one that nobody writes to: it is not waited for."""
    os.mkfifo(tmp_path / "pipe")
    assert "pipe, which may never end: save it as a file" in " ".join(
        refused("fly", "./pipe").split()
    )


def test_a_folder_with_something_in_it_is_refused(refused, tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "mine").touch()
    for missions in (["paper_nominal"], ["paper_nominal", "noisy_state"]):
        assert "run: " in refused("fly", *missions, "--out", "run", *QUICK)
    assert [p.name for p in (tmp_path / "run").iterdir()] == ["mine"]


def test_of_several_missions_the_worst_counts(gcs, tmp_path):
    (tmp_path / "hover.toml").write_text(MISSION)
    code, out, _ = gcs(
        "fly", "hover.toml", "paper_nominal", "hover.toml", *QUICK,
        "--json", "--junit", "junit.xml", "--out", "run",
    )  # fmt: skip
    results = json.loads(out)
    assert code == 1
    assert [r["exit_code"] for r in results] == [0, 1, 0]  # too short for the second to settle
    folders = sorted(p.name for p in (tmp_path / "run").iterdir())
    assert folders == ["hover", "hover-1", "paper_nominal"]
    suite = ET.parse(tmp_path / "junit.xml").getroot()
    assert [suite.get(k) for k in ("tests", "failures", "errors")] == ["3", "1", "0"]
    failure = suite.find("testcase/failure")
    assert failure is not None
    assert "reference_error_rms_settled_m ≤ 0.03" in failure.text


def test_a_report_that_cannot_be_written_is_not_passed_over(gcs):
    code, _, err = gcs("fly", "gust_step", "--in-process", "--junit", "nowhere/junit.xml")
    assert code == 2  # before it flies
    assert "nowhere/junit.xml: " in err


def test_a_setpoint_needs_a_vehicle(refused, instance):
    assert refused("setpoint", 1, 2, 3, "--instance", instance, "--yaw-deg", "nan")


def test_make_help_lists_every_target():
    root = Path(__file__).parents[2]
    targets = re.search(r"^\.PHONY: (.*)$", (root / "Makefile").read_text(), re.MULTILINE)[1]
    listed = subprocess.run(
        ["make", "-s", "-C", root, "help"],
        capture_output=True,
        text=True,
        check=True,
        timeout=PATIENCE_S,
    ).stdout
    told = re.findall(r"^make ([\w-]+) +\w", listed, re.MULTILINE)
    assert sorted(told) == sorted(targets.split())
