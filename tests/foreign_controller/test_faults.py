"""A controller that misbehaves ends its flight with a named cause, in bounded time, and leaves nobody."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gcs_tools.flight.foreign_flight import command, names_instance, values
from gcs_tools.flight.user_command import filled
from gcs_tools.judging import result
from tests.patience import until
from tests.process.conftest import alive

HERE = Path(__file__).parent
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
HARMLESS = ("twice", "chatter", "leaves", "stubborn")


def _command(how: str, folder: Path) -> list[str]:
    words = f"{sys.executable} {HERE / 'misbehaving.py'} {{instance}} {how} {folder / how}.pids"
    own = ["--controller", words, "--controller-timeout", "4", "--out", str(folder / how)]
    fly = [sys.executable, "-m", "gcs_tools", "fly", str(HERE / "hover.toml")]
    return [*fly, *own, "--figure", "never", "--record", "light"]


@pytest.fixture
def fly(tmp_path):
    """`fly(how)`: one such flight, to its end; its exit code."""

    def once(how: str) -> int:
        with (tmp_path / f"{how}.out").open("wb") as out:
            process = subprocess.Popen(_command(how, tmp_path), stdout=out, stderr=out)
        try:
            until(lambda: process.poll() is not None, f"the end of {how}")
        finally:
            process.kill()
        return process.returncode

    def flown(how: str) -> int:
        """Begun again as long as other tests have all the instances."""
        code = once(how)
        while "all have a port in use" in (tmp_path / f"{how}.out").read_text():
            code = once(how)
        return code

    return flown


def _pids(folder: Path, how: str) -> list[int]:
    return [int(line) for line in (folder / f"{how}.pids").read_text().split()]


@pytest.mark.parametrize("how", FAULTS)
def test_a_fault_is_named_and_leaves_nobody(fly, tmp_path, how):
    code = fly(how)
    found = result.read(tmp_path / how / "result.json")
    assert (code, found.exit_code, found.ended, found.passed) == (3, 3, "aborted", False)
    for words in FAULTS[how]:
        assert words in found.error
    assert not any(map(alive, _pids(tmp_path, how)))
    if how == "talks":
        (log,) = (tmp_path / how).rglob("controller.log")
        assert log.stat().st_size == 64 << 20


@pytest.fixture(scope="module")
def well():
    """The hash of the flight of a controller that does as it should."""
    found: list[str] = []

    def told(fly, folder):
        if not found:
            assert fly("well") == 0
            found.append(result.read(folder / "well" / "result.json").trajectory_sha256)
        return found[0]

    return told


@pytest.mark.parametrize("how", HARMLESS)
def test_answers_that_are_repeated_or_too_many_change_no_bit(fly, tmp_path, well, how):
    expected = well(fly, tmp_path)
    code = fly(how)
    found = result.read(tmp_path / how / "result.json")
    assert (code, found.ended, found.trajectory_sha256) == (0, "time", expected)
    pids = _pids(tmp_path, how)
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
