"""Signals again and again, from one moment of a flight on: it ends as after one, and is kept.

Whoever presses Ctrl-C twice, or is told to end by a supervisor that asks again, loses nothing.
"""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
from pathlib import Path

import pytest

from gcs_tools.judging import result
from gcs_tools.recording import reader as recording

MANY, EVERY_S = 300, 0.01
LONG = ("--set", "flight.duration_s=3000", "--figure", "never")
SHORT = ("--set", "flight.duration_s=0.5")
WIRE, MEMORY = (
    pytest.param((), id="over the wire"),
    pytest.param(("--in-process",), id="in process"),
)
NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def storm(program) -> int:
    """The exit code of a program that is told to end every 10 ms, for 3 s at most."""
    for number in itertools.islice(itertools.cycle(NUMBERS), MANY):
        program.signal(number)
        try:
            return program.process.wait(EVERY_S)
        except subprocess.TimeoutExpired:
            continue
    return program.wait()


def kept(folder: Path) -> result.Result:
    """The result of a run, whose recording is whole."""
    assert recording.read(folder / "flight.mcap").complete
    return result.read(folder / "result.json")


def quiet(program) -> None:
    for word in ("Traceback", "ignored"):
        assert word not in program.text()


@pytest.mark.parametrize("how", [WIRE, MEMORY])
@pytest.mark.parametrize("mark", ["flight.mcap", "fcu.log", "plant.log"])
def test_a_storm_as_soon_as_a_file_is_made_ends_the_flight(fly, tmp_path, until, mark, how):
    program = fly("urban_step", *LONG, *how)
    until((tmp_path / "run" / mark).exists, mark)
    assert storm(program) == 130
    assert kept(tmp_path / "run").exit_code == 130
    quiet(program)


@pytest.mark.parametrize("how", [WIRE, MEMORY])
def test_a_storm_in_flight_ends_it_with_its_rows(fly, tmp_path, until, how):
    program = fly("urban_step", *LONG, *how)
    file = tmp_path / "run" / "flight.mcap"
    until(lambda: file.exists() and file.stat().st_size > 1 << 19, "a recording")
    assert storm(program) == 130
    left = kept(tmp_path / "run")
    assert (left.exit_code, left.ended) == (130, "aborted")
    assert left.ticks > 100
    quiet(program)


@pytest.mark.parametrize("how", [WIRE, MEMORY])
def test_once_a_flight_is_judged(fly, tmp_path, until, how):
    """While its figure is drawn; the result is that of the whole flight, interrupted."""
    program = fly("urban_step", *SHORT, *how)
    until((tmp_path / "run" / "result.json").exists, "a result")
    assert storm(program) == 130
    left = kept(tmp_path / "run")
    assert (left.exit_code, left.ended, left.error) == (130, "time", "interrupted")
    quiet(program)


@pytest.mark.parametrize("how", [WIRE, MEMORY])
@pytest.mark.parametrize("size", [0, 1 << 19])
def test_a_storm_over_flights_side_by_side_ends_all(fly, tmp_path, until, size, how):
    names = ("urban_step", "gust_step", "paper_nominal")
    program = fly(*names, "-j", 2, *LONG, *how)
    files = [tmp_path / "run" / name / "flight.mcap" for name in names[:2]]
    until(lambda: any(f.exists() and f.stat().st_size >= size for f in files), "a recording")
    assert storm(program) == 130
    for file in (tmp_path / "run").rglob("flight.mcap"):
        assert kept(file.parent).exit_code == 130
    assert not (tmp_path / "run" / "paper_nominal").exists()
    cut, left = (line.partition(": ")[2] for line in program.text().splitlines()[-2:])
    assert "urban_step" in cut and "paper_nominal" in left
    assert sorted(f"{cut}, {left}".split(", ")) == sorted(names)
    quiet(program)


def test_a_vehicle_that_is_up_is_stopped_as_ever(start, instance, alive, until):
    program = start("gcs_tools", "up", "--instance", instance, "--no-publish")
    program.says("ready: ")
    started = program.started().values()
    assert storm(program) == 0
    until(lambda: not any(map(alive, started)), "no orphan")
    quiet(program)


def test_a_compiler_is_interrupted_at_once(fly, tmp_path, until):
    """In process, where it is ours: a minute is too long to wait for."""
    cache = tmp_path / "cache"
    program = fly(
        "urban_step", *LONG, "--in-process", env={**os.environ, "XDG_CACHE_HOME": str(cache)}
    )
    until((tmp_path / "run" / "fcu.log").exists, "a flight that is about to compile")
    assert storm(program) == 130
    assert kept(tmp_path / "run").ticks == 0
    assert not list(cache.rglob("*together*"))


def test_a_terminal_that_is_closed_ends_a_flight_as_ctrl_c_does(fly, tmp_path, until):
    """What is then said reaches nobody, and changes nothing."""
    ours, its = os.openpty()
    program = fly("urban_step", *LONG, stdout=its, stderr=its)
    os.close(its)
    file = tmp_path / "run" / "flight.mcap"

    def is_recorded():
        os.set_blocking(ours, False)
        try:
            os.read(ours, 1 << 16)  # or its output would fill the terminal's buffer
        except BlockingIOError:
            pass
        return file.exists() and file.stat().st_size > 1 << 19

    until(is_recorded, "a recording")
    os.close(ours)
    program.signal(signal.SIGHUP)
    assert program.wait() == 130
    assert kept(tmp_path / "run").error == "interrupted"
