"""Time that is held for a script: it waits in simulation time, and twice flown it is the same flight."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcs_tools.flight import scenario
from gcs_tools.flight.asleep import Sleepers, has_ended
from gcs_tools.flight.held_clock import PYTHON, HeldClock
from gcs_tools.flight.run import UsageError, prepared
from tests.patience import PATIENCE_S, until

HERE = Path(__file__).parent
TICK_S = 0.002
HELD = 'flight.pace="held"'


@pytest.fixture
def clock():
    made = HeldClock()
    yield made
    made.close()


def held(clock: HeldClock, words: list[str], most_s: float = 60.0) -> tuple[str, float]:
    """Run a program whose time is held. Returns its output, and the time at its end, s."""
    environment = {**os.environ, **clock.environment()}
    with subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True) as program:
        sleepers, ticks, end = Sleepers([program.pid]), 0, time.monotonic() + PATIENCE_S
        while not has_ended(program.pid):
            assert time.monotonic() < end, "the program neither waits nor ends"
            if sleepers.have_slept() and not clock.wake(ticks * TICK_S):
                ticks += 1
                assert ticks * TICK_S < most_s
                clock.set(ticks * TICK_S)
        assert program.stdout is not None
        said = program.stdout.read()
    assert program.returncode == 0
    return said, ticks * TICK_S


def test_every_way_of_waiting_takes_simulation_time(clock):
    said, _ = held(clock, [sys.executable, str(HERE / "waits.py")])
    took = {line.rpartition(" ")[0]: float(line.rpartition(" ")[2]) for line in said.splitlines()}
    assert len(took) == 27
    assert {way: s for way, s in took.items() if not 0.5 <= s < 0.52} == {}


def test_a_program_that_waits_in_every_way_takes_the_same_time_twice():
    found = []
    for _ in range(2):
        clock = HeldClock()
        try:
            found.append(held(clock, [sys.executable, str(HERE / "waits.py")]))
        finally:
            clock.close()
    assert found[0] == found[1]


def test_who_waits_ends_with_the_clock():
    clock = HeldClock()
    environment = {**os.environ, **clock.environment()}
    with subprocess.Popen([sys.executable, str(HERE / "waits.py")], env=environment) as program:
        until(lambda: clock.heard or clock.wake(0.0), "the program is heard of")
        clock.close()
        assert program.wait(PATIENCE_S) == 1


def test_a_program_without_the_clock_is_left_alone():
    words = [
        sys.executable,
        "-c",
        "import time; print(time.time() > 1.77e9, time.sleep.__module__)",
    ]
    environment = {**os.environ, "PYTHONPATH": str(PYTHON)}
    said = subprocess.run(words, env=environment, capture_output=True, text=True, check=True).stdout
    assert said == "True time\n"


@pytest.mark.slow
def test_the_same_script_twice_is_the_same_flight_to_the_bit(fly):
    (code, first), (_, second) = fly(HELD), fly(HELD)
    assert (code, first.ended, first.error) == (0, "landed", None)
    assert first.script is not None and second.script is not None
    assert (first.script.failure, first.script.exit_code) == ("", 0)
    same = "trajectory_sha256", "sim_time_s", "ticks", "metrics"
    assert {k: getattr(first, k) for k in same} == {k: getattr(second, k) for k in same}
    assert first.script.ended_at_s == second.script.ended_at_s


@pytest.mark.slow
@pytest.mark.parametrize(("how", "failure", "code"), [
    ("fails", "script_exit", 1), ("crashes", "script_killed", 3), ("hangs", "script_timeout", 1),
    ("leaves", "script_left_processes", 1),
])  # fmt: skip
def test_a_failure_has_the_name_that_it_has_by_the_wall(fly, how, failure, code):
    misbehaves = f'flight.script="python hop.py {{url}} {how}"'
    found_code, found = fly(HELD, misbehaves, *(["flight.duration_s=3"] if how == "hangs" else []))
    assert found_code == code
    assert found.script is not None and found.script.failure == failure


def test_held_time_is_refused_in_words_where_it_is_not_to_be_had(monkeypatch):
    monkeypatch.setattr(scenario, "AVAILABLE", False)
    with pytest.raises(
        UsageError, match=r'pace = "held" needs Linux; "real" or "speed:N" fly here'
    ):
        prepared(str(HERE / "hop.toml"), settings=(HELD,))
