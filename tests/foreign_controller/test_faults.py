"""A controller that misbehaves ends its flight with a named cause, in bounded time, and leaves nobody."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gcs_tools.flight.foreign_flight import command, filled, names_instance, values
from gcs_tools.judging import result
from tests.patience import until
from tests.process.conftest import alive

pytestmark = pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs Linux's /proc")

HERE = Path(__file__).parent
AT_A_TIME = 6  # flights: most of their time is somebody's patience
FAULTS = {  # how it misbehaves -> parts of the error
    "refuses": ("ended with exit code 1: nothing to fly today",),
    "absent": ("did not open UDP port", "within 4 s"),
    "dies": ("ended with exit code 7: the last word",),
    "killed": ("was ended by signal 9",),
    "talks": ("written more than 64 MiB",),
    "hangs": ("silent for 5 s", "docs/flight-controller-of-your-own.md"),
    "suspended": ("silent for 5 s", "stopped (SIGSTOP)"),
    "wrong_id": ("no valid answer for 5 s", "from system"),
    "nan": ("no valid answer for 5 s", "not a finite number"),
    "out_of_range": ("no valid answer for 5 s", "not between 0 and 1"),
    "checksum": ("no valid answer for 5 s", "wrong checksum"),
    "other_state": ("no answer for 5 s to the state of 198000 us", "to others"),
    "flood": ("no valid answer for 5 s",),
    "other_port": ("silent for 5 s", "from other ports than"),
    "answers_holds": ("answered a keep-alive",),
}
HARMLESS = ("well", "twice", "chatter", "leaves", "stubborn")


def _command(how: str, folder: Path) -> list[str]:
    words = f"{sys.executable} {HERE / 'misbehaving.py'} {{instance}} {how} {folder / how}.pids"
    own = ["--controller", words, "--controller-timeout", "4", "--out", str(folder / how)]
    fly = [sys.executable, "-m", "gcs_tools", "fly", str(HERE / "hover.toml")]
    return [*fly, *own, "--figure", "never", "--record", "light"]


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """The folder of all flights, and the exit code of each."""
    folder = tmp_path_factory.mktemp("faults")
    todo, flying, codes = [*FAULTS, *HARMLESS], {}, {}

    def step() -> bool:
        for how, process in list(flying.items()):
            if process.poll() is not None:
                codes[how] = process.returncode
                del flying[how]
        while todo and len(flying) < AT_A_TIME:
            how = todo.pop(0)
            with (folder / f"{how}.out").open("wb") as out:
                flying[how] = subprocess.Popen(_command(how, folder), stdout=out, stderr=out)
        return not flying

    try:
        until(step, "all flights")
    finally:
        for process in flying.values():
            process.kill()
    return folder, codes


def _pids(folder: Path, how: str) -> list[int]:
    return [int(line) for line in (folder / f"{how}.pids").read_text().split()]


@pytest.mark.parametrize("how", FAULTS)
def test_a_fault_is_named_and_leaves_nobody(flights, how):
    folder, codes = flights
    found = result.read(folder / how / "result.json")
    assert (codes[how], found.exit_code, found.ended, found.passed) == (3, 3, "aborted", False)
    for words in FAULTS[how]:
        assert words in found.error
    assert not any(map(alive, _pids(folder, how)))


@pytest.mark.parametrize("how", HARMLESS)
def test_answers_that_are_repeated_or_too_many_change_no_bit(flights, how):
    folder, codes = flights
    found, well = (result.read(folder / name / "result.json") for name in (how, "well"))
    assert (codes[how], found.ended) == (0, "time")
    assert found.trajectory_sha256 == well.trajectory_sha256
    pids = _pids(folder, how)
    assert len(pids) == (3 if how == "leaves" else 1)
    assert not any(map(alive, pids)), "also those in sessions of their own"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_runner_that_ends_takes_its_controller_with_it(start, tmp_path, number):
    pids = tmp_path / "leaves.pids"
    program = start(
        "gcs_tools", *_command("leaves", tmp_path)[3:], "--set", "flight.duration_s=600"
    )
    until(lambda: pids.exists() and len(pids.read_text().split()) == 3, "a controller")
    until(lambda: (tmp_path / "leaves" / "plant.log").exists(), "a plant")
    program.signal(number)
    assert program.wait() == (-9 if number == signal.SIGKILL else 130)
    until(lambda: not any(map(alive, _pids(tmp_path, "leaves"))), "no orphan")


def test_values_take_the_place_of_words_in_braces():
    told = values(3, 250.0, Path("a b.toml"))
    words = command("sh -c 'echo {print} ${HOME} {controller_port} {setpoint_port} {airframe}'")
    assert filled(words, told)[2] == "echo {print} ${HOME} 4663 14583 a b.toml"
    assert filled(("{system_id}", "{rate_hz}", "{plant_port}"), told) == ["4", "250", "4563"]
    assert names_instance(words) and not names_instance(("sh", "{airframe}", "{rate_hz}"))
