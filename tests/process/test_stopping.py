"""Who is asked to end and works is waited for; who does nothing is ended."""

from __future__ import annotations

import signal

import pytest

from gcs_tools.flight.processes import Child

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


def test_who_works_is_heard_to_the_end(child):
    works = child(WORKS)
    assert works.stop() == {"ended": "a test"}
    assert works.process.returncode == 0


def test_who_does_nothing_is_ended(child):
    ignores = child(IGNORES)
    assert ignores.stop() == {}
    assert ignores.process.returncode == -signal.SIGKILL
