"""Who is asked to end and works is waited for; who does nothing is ended."""

from __future__ import annotations

import os
import signal

import pytest

from gcs_tools.flight import processes
from gcs_tools.flight.processes import Child, InfrastructureError

BUSY_S = 2.0  # of processor time
WORKS = f"""
def stop(number, frame):
    until = time.process_time() + {BUSY_S}
    while time.process_time() < until:
        pass
    print(json.dumps({{"ended": "a test"}}), flush=True)
    os._exit(0)

signal.signal(signal.SIGTERM, stop)
"""
IGNORES = """
signal.signal(signal.SIGTERM, signal.SIG_IGN)
"""
BEGINS, GOES_ON = (
    "import json, os, signal, time\n",
    """
print(json.dumps({"ready": "a test"}), flush=True)
while True:
    signal.pause()
""",
)


@pytest.fixture
def child(tmp_path, monkeypatch):
    """`child(text)`: a program that has said that it is ready."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    children = []

    def begin(text: str) -> Child:
        (tmp_path / "asked_to_end.py").write_text(BEGINS + text + GOES_ON)
        children.append(Child("test", "asked_to_end", [], tmp_path / "test.log", ()))
        children[-1].wait_ready(lambda: None)
        return children[-1]

    yield begin
    for each in children:
        each.process.kill()


def test_a_process_that_works_is_heard_to_the_end(child):
    works = child(WORKS)
    assert works.stop() == {"ended": "a test"}
    assert works.process.returncode == 0


def test_a_process_that_does_nothing_is_ended(child):
    ignores = child(IGNORES)
    assert ignores.stop() == {}
    assert ignores.process.returncode == -signal.SIGKILL


def is_named(child):
    """Whether a look at it raises, and says why."""
    try:
        child.check_suspended()
    except InfrastructureError as error:
        return "SIGSTOP" in str(error)
    return False


def test_a_suspended_process_is_named_to_who_waits(child, monkeypatch, until):
    """A vehicle that is to become ready, an echo, a tick: none of them comes."""
    monkeypatch.setattr(processes, "HANGS_S", 0.2)
    suspended = child("")
    assert not is_named(suspended)
    os.kill(suspended.process.pid, signal.SIGSTOP)
    until(lambda: is_named(suspended), "who is suspended")
    os.kill(suspended.process.pid, signal.SIGCONT)
    until(lambda: not is_named(suspended), "one that goes on again")
    suspended.stop()


def test_a_moment_of_suspension_is_nothing(child, monkeypatch):
    brief = child("")
    with monkeypatch.context() as patch:
        for at_s, stopped, named in (
            (0.0, True, False), (0.9, False, False), (1.8, True, False), (2.7, True, False),
            (2.9, True, True), (3.0, False, False),
        ):  # fmt: skip
            patch.setattr(processes, "is_stopped", lambda pid, stopped=stopped: stopped)
            now = 100.0 + at_s * processes.HANGS_S
            patch.setattr(processes.time, "monotonic", lambda now=now: now)
            assert is_named(brief) == named
    brief.stop()
