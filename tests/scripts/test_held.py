"""Time that is held for a script: it waits in simulation time, and twice flown it is the same flight."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcs_tools.flight import scenario
from gcs_tools.flight.asleep import Sleepers, has_ended
from gcs_tools.flight.asleep import work as of_processes
from gcs_tools.flight.held_clock import PYTHON, HeldClock
from gcs_tools.flight.held_flight import STANDS_S, Standing
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


def test_a_wait_ends_with_the_clock():
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


@pytest.mark.parametrize(
    ("work", "runs", "after_s"),
    [(0.01, True, None), (1.0, True, STANDS_S), (0.5, True, 2 * STANDS_S), (0.0, False, STANDS_S), (0.0, True, None)],
)  # fmt: skip
def test_a_script_is_late_by_what_it_works_or_if_it_does_nothing(work, runs, after_s):
    """Work is processor time a second of the wall's clock. A busy machine gives little, and ends no script."""
    wall_s = 0.0
    standing = Standing(lambda: (work * wall_s, runs), lambda: wall_s)
    late = []
    for wall_s in map(float, range(1000)):
        if standing.too_long():
            late.append(wall_s)
    assert late[:1] == ([] if after_s is None else [after_s + 1.0])
    standing.begin()
    assert not standing.too_long()


def test_the_work_of_a_program_and_its_children_is_counted():
    spins = "while True: pass"
    starts = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {spins!r}])"
    with subprocess.Popen([sys.executable, "-c", starts], start_new_session=True) as program:
        try:
            until(lambda: of_processes(program.pid)[0] > 1.0, "a second of work")
            assert of_processes(program.pid)[1]
        finally:
            os.killpg(program.pid, signal.SIGKILL)
    assert of_processes(program.pid) == (0.0, False)


@pytest.mark.slow
def test_the_same_script_twice_is_the_same_flight_to_the_bit(fly):
    short = 'flight.script="python hop.py {url} stops"'  # at 0.3 m: a whole hop takes far longer
    (code, first), (_, second) = fly(HELD, short), fly(HELD, short)
    assert (code, first.ended, first.error) == (1, "fell", None)
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
