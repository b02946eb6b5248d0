"""Several missions at a time: in order, in one line at the end, and nobody left behind."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest

from gcs_tools.judging import result

SLOW_FIRST = ("paper_nominal", "gust_step", "noisy_state")
LONG = ("--set", "flight.duration_s=3000")
HOVER = """title = "A hover."
[flight]
duration_s = {duration_s}
setpoints = [{{ at_s = 0.0, position_m = [0.0, 0.0, 0.0] }}]
[expect]
reference_error_max_m = {most_m}
"""


@pytest.fixture
def hover(tmp_path):
    """`hover("a", 3.0)`: the file of a mission that lasts so long, and passes or not."""

    def write(name, duration_s, passes=True):
        file = tmp_path / f"{name}.toml"
        file.write_text(HOVER.format(duration_s=duration_s, most_m=1.0 if passes else 1e-9))
        return file

    return write


def descendants(pid):
    """Pids of all that a process has started, and they."""
    parents = {}
    for entry in Path("/proc").iterdir():
        try:
            parents[int(entry.name)] = int(
                (entry / "stat").read_text().rpartition(")")[2].split()[1]
            )
        except (OSError, ValueError, IndexError):
            continue
    found, more = set(), {pid}
    while more:
        more = {child for child, parent in parents.items() if parent in more}
        found |= more
    return found


def named(pids, name):
    found = set()
    for pid in pids:
        try:
            found |= {pid} if Path(f"/proc/{pid}/comm").read_text().strip() == name else set()
        except OSError:
            continue
    return found


@pytest.fixture
def two_in_flight(fly, tmp_path, until):
    """A runner of two long flights, both recorded for a while, and all that it has started."""

    def started(*arguments):
        program = fly("paper_nominal", "gust_step", "-j", 2, *LONG, *arguments)
        files = [tmp_path / "run" / name / "flight.mcap" for name in ("paper_nominal", "gust_step")]
        until(lambda: all(f.exists() and f.stat().st_size > 1 << 19 for f in files), "recordings")
        pids = descendants(program.pid)
        assert len(named(pids, "fcu")) == len(named(pids, "sitl_plant")) == 2, program.text()
        return program, pids

    return started


@pytest.mark.parametrize("how", [(), ("--in-process",)], ids=["over the wire", "in process"])
def test_verdicts_come_in_the_order_of_the_missions(fly, hover, tmp_path, how):
    missions = hover("last", 20.0), hover("first", 0.5), hover("middle", 5.0, passes=False)
    program = fly(*missions, "-j", 3, *how)
    assert program.wait() == 1, program.text()
    lines = program.out.read_text().splitlines()
    runs = [Path(line.rpartition(" ")[2]).name for line in lines if "run in" in line]
    assert runs == ["last", "first", "middle"]
    assert lines[-1].startswith("2 of 3 passed in ")
    drawn = sorted(file.parent.name for file in (tmp_path / "run").glob("*/flight.png"))
    assert drawn == ["middle"]  # the one that failed


def test_json_is_in_the_order_of_the_missions_and_the_flights_are_the_same(fly, start, tmp_path):
    short = ("--json", "--set", "flight.duration_s=3", "--figure", "never")
    program = fly(*SLOW_FIRST, "-j", 3, *short)
    program.wait()
    found = json.loads(program.out.read_text())
    assert [each["mission"] for each in found] == list(SLOW_FIRST)
    alone = start("gcs_tools", "fly", *SLOW_FIRST, "-j", 1, "--in-process", *short)
    alone.wait()
    one_by_one = json.loads(alone.out.read_text())
    key = "trajectory_sha256"
    assert [each[key] for each in found] == [each[key] for each in one_by_one]
    for name in SLOW_FIRST:
        assert result.read(tmp_path / "run" / name / "result.json").mission == name


@pytest.mark.parametrize(
    ("figure", "drawn"),
    [("always", ["fails", "passes"]), ("failed", ["fails"]), ("never", [])],
)
def test_figures_are_drawn_of_the_flights_asked_for(fly, hover, tmp_path, figure, drawn):
    missions = hover("passes", 0.5), hover("fails", 0.5, passes=False)
    program = fly(*missions, "--in-process", "--figure", figure)
    assert program.wait() == 1
    assert sorted(f.parent.name for f in (tmp_path / "run").glob("*/flight.png")) == drawn


def test_the_verdict_of_one_flight_is_told_before_its_figure_is_drawn(fly, hover, tmp_path):
    """Where the figure cannot be drawn, the verdict has been told all the same."""
    (tmp_path / "run").mkdir()
    blocked = tmp_path / "blocked" / "matplotlib.py"
    blocked.parent.mkdir()
    blocked.write_text("raise OSError(28, 'no room for a figure')\n")
    program = fly(
        hover("one", 0.5), "--in-process", env={**os.environ, "PYTHONPATH": str(blocked.parent)}
    )
    assert program.wait() == 3
    assert "run in" in program.out.read_text()
    assert "no room for a figure" in program.err.read_text()
    left = result.read(tmp_path / "run" / "result.json")
    assert "no room for a figure" in left.error
    assert all(line.passed for line in left.expectations)


def test_a_killed_runner_leaves_no_flight(two_in_flight, until, alive):
    program, pids = two_in_flight()
    program.signal(signal.SIGKILL)
    program.wait()
    until(lambda: not any(map(alive, pids)), "no orphan")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_every_flight_and_keeps_what_was_flown(
    two_in_flight, until, alive, tmp_path, number
):
    program, pids = two_in_flight()
    program.signal(number)
    assert program.wait() == 130
    until(lambda: not any(map(alive, pids)), "no orphan")
    for name in ("paper_nominal", "gust_step"):
        left = result.read(tmp_path / "run" / name / "result.json")
        assert (left.exit_code, left.ended) == (130, "aborted")
        assert left.ticks > 100
    assert "Traceback" not in program.text()


def test_of_missions_in_turn_those_that_did_not_fly_are_told(fly, tmp_path, until):
    program = fly("gust_step", "paper_nominal", "noisy_state", "-j", 1, "--in-process", *LONG)
    file = tmp_path / "run" / "gust_step" / "flight.mcap"
    until(lambda: file.exists() and file.stat().st_size > 1 << 19, "a recording")
    assert program.interrupted() == 130
    told = program.out.read_text().splitlines()[-2:]
    assert told == ["interrupted: gust_step", "not flown: paper_nominal, noisy_state"]


def test_a_flight_that_is_killed_is_told_and_the_others_fly_on(
    two_in_flight, until, alive, tmp_path
):
    program, pids = two_in_flight("--json")
    victim = min(named(pids, "gcs fly"))
    os.kill(victim, signal.SIGKILL)
    files = [tmp_path / "run" / name / "flight.mcap" for name in ("paper_nominal", "gust_step")]
    until(lambda: not alive(victim), "the end of a flight")
    before = [file.stat().st_size for file in files]
    until(lambda: files[1].stat().st_size > before[1] + (1 << 19), "the other's recording")
    assert program.interrupted() == 130
    until(lambda: not any(map(alive, pids)), "no orphan")
    first, second = json.loads(program.out.read_text())
    assert "signal 9" in first["error"]
    assert (first["exit_code"], second["ended"]) == (3, "aborted")


def test_an_instance_flies_one_mission_at_a_time(fly):
    program = fly("paper_nominal", "gust_step", "-j", 2, "--instance", 3)
    assert program.wait() == 2
    assert "one mission at a time" in program.text()
