"""Sleep seen from outside: nothing that begins to run while it is looked for is missed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from gcs_tools.flight import asleep
from gcs_tools.flight.asleep import Sleepers
from tests.patience import until

BEGETS = Path(__file__).with_name("begets.py")
MOMENTS = 16  # of looking at one process twice, and more
LOOKS = 5


@pytest.fixture
def begets():
    """`begets(how)`: the program, which sleeps."""
    started = []

    def begun(how: str) -> subprocess.Popen[bytes]:
        program = subprocess.Popen(
            [sys.executable, "-SE", BEGETS, how], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            bufsize=0, start_new_session=True,
        )  # fmt: skip
        started.append(program)
        sleepers = Sleepers([program.pid])
        until(
            lambda: sleepers.have_slept() and len(sleepers.pids) == 1 + (how == "orphan"), "sleeps"
        )
        return program

    yield begun
    for program in started:
        with suppress(ProcessLookupError):  # ended, and seen by the test
            os.killpg(program.pid, signal.SIGKILL)
        program.communicate()


@pytest.mark.parametrize("how", ["child", "thread", "orphan"])
def test_a_process_that_begins_to_run_between_two_looks_is_seen(begets, monkeypatch, how):
    """After each of the files and folders that are read, in turn, something begins to run."""
    for moment in range(1, 1 + MOMENTS):
        with monkeypatch.context() as patched:
            slept = looks_after(begets(how), patched, moment)
        assert not any(slept), f"after {moment} reads"


def looks_after(
    program: subprocess.Popen[bytes], patched: pytest.MonkeyPatch, moment: int
) -> list[bool]:
    """Look for who sleeps while, after so many reads, something begins to run. Returns the looks from then on."""
    read, listed, reads = asleep._read, os.listdir, 0
    assert program.stdin is not None and program.stdout is not None
    heard, told = program.stdin, program.stdout

    def reads_one() -> None:
        nonlocal reads
        reads += 1
        if reads != moment:
            return
        heard.write(b"!")
        assert told.read(1) == b"!"
        first = f"/proc/{program.pid}/task/{program.pid}/status"
        until(lambda: asleep._state(read(first)) == b"S", "the program sleeps again")

    def reads_file(path: str) -> bytes:
        text = read(path)
        reads_one()
        return text

    def lists(path: str) -> list[str]:
        names = listed(path)
        reads_one()
        return names

    patched.setattr(asleep, "_read", reads_file)
    patched.setattr(os, "listdir", lists)
    sleepers = Sleepers([program.pid])
    while reads < moment:
        sleepers.have_slept()  # true only if all slept before it began to run
    return [sleepers.have_slept() for _ in range(LOOKS)]


def test_a_process_that_has_ended_sleeps(begets):
    program = begets("child")
    sleepers = Sleepers([program.pid])
    os.killpg(program.pid, signal.SIGKILL)
    until(sleepers.have_slept, "a zombie is asleep")
    assert sleepers.pids == set()
    program.communicate()
    until(sleepers.have_slept, "who is gone is asleep")
