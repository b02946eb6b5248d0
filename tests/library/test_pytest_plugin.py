"""The plugin for pytest, in a pytest of its own: missions are tests, and a vehicle is there for one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from tests.patience import with_room
from tests.process.conftest import alive

pytestmark = pytest.mark.slow  # starts processes

MISSION = """title = "A hover in still air."
[flight]
duration_s = 1.0
setpoints = [{ at_s = 0.0, position_m = [0.0, 0.0, 0.0] }]
[expect]
reference_error_max_m = LIMIT
reached = false
"""
TEST = """
import pytest
from pymavlink import mavutil

@pytest.mark.vehicle(speed=8)
def test_it_arms(vehicle):
    link = mavutil.mavlink_connection(vehicle.url)
    assert link.wait_heartbeat(timeout=30).get_srcSystem() == vehicle.system_id
    link.arducopter_arm()
    link.motors_armed_wait()
    assert vehicle.alive() and (vehicle.folder / "fcu.log").is_file()
    print("pid", vehicle.process.pid)
"""
HOLDS = """
import pathlib, time

def test_it_is_killed(vehicle):
    pathlib.Path("pid").write_text(str(vehicle.process.pid))
    time.sleep(600)
"""


def run_pytest(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-m", "pytest", "-q", "--rootdir", ".", *arguments]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=400)


@pytest.fixture
def missions(tmp_path: Path) -> Path:
    for name, limit in (("good", "0.05"), ("bad", "1e-9")):
        (tmp_path / f"{name}.toml").write_text(MISSION.replace("LIMIT", limit))
    return tmp_path


def test_missions_that_are_named_are_tests(missions):
    done = run_pytest(missions, "good.toml", "bad.toml", "--junit-xml", "j.xml")
    assert done.returncode == 1, done.stdout
    cases = ET.parse(missions / "j.xml").getroot().iter("testcase")
    failed = {case.get("name"): case.find("failure") for case in cases}
    assert failed["good"] is None and failed["bad"] is not None
    assert "reference_error_max_m" in (failed["bad"].text or "")
    assert "Traceback" not in done.stdout


def test_log_recording_and_figure_of_a_mission_are_kept_until_the_next_run(missions):
    """Nothing is kept if pytest has no cache."""
    assert run_pytest(missions, "-p", "no:cacheprovider", "bad.toml").returncode == 1
    assert sorted(path.name for path in missions.iterdir()) == ["bad.toml", "good.toml"]
    for _ in range(2):
        done = run_pytest(missions, "bad.toml")
        assert done.returncode == 1
        # where CI is set, pytest repeats all of it in its summary
        told = next(line for line in done.stdout.splitlines() if "log, recording" in line)
        folder = missions / ".pytest_cache" / "d" / "m-mrac" / "bad.toml-bad"
        assert told.endswith(str(folder))
        for name in ("flight.mcap", "flight.png", "fcu.log", "result.json"):
            assert (folder / name).stat().st_size > 0


def test_missions_are_found_by_the_configuration_alone(missions):
    (missions / "pytest.ini").write_text("[pytest]\nmmrac_missions = good.toml\n")
    done = run_pytest(missions, "--collect-only")
    assert [line for line in done.stdout.splitlines() if "::" in line] == ["good.toml::good"]
    (missions / "pytest.ini").write_text("[pytest]\n")
    assert run_pytest(missions, "--collect-only").returncode == 5  # nothing is collected


def test_a_mission_that_cannot_be_flown_is_a_failure_with_a_sentence(missions):
    (missions / "good.toml").write_text("title = 3\n")
    done = run_pytest(missions, "good.toml")
    assert done.returncode == 1
    assert "good.toml" in done.stdout and "title" in done.stdout and "Traceback" not in done.stdout


def test_a_test_talks_to_a_vehicle(tmp_path):
    (tmp_path / "test_one.py").write_text(TEST)

    def tested() -> tuple[int, str]:
        done = run_pytest(tmp_path, "-s")
        return done.returncode, done.stdout

    code, text = with_room(tested)
    assert code == 0, text
    pid = int(text.split("pid ")[1].split()[0])
    assert not alive(pid)


def test_a_vehicle_ends_with_a_pytest_that_is_killed(tmp_path):
    (tmp_path / "test_one.py").write_text(HOLDS)
    words = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-q", "--rootdir", "."]
    run = subprocess.Popen(
        words, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    until = time.monotonic() + 200.0
    while not (tmp_path / "pid").exists() and run.poll() is None and time.monotonic() < until:
        time.sleep(0.1)
    pid = int((tmp_path / "pid").read_text())
    assert alive(pid)
    os.kill(run.pid, signal.SIGKILL)
    run.wait()
    until = time.monotonic() + 30.0
    while alive(pid) and time.monotonic() < until:
        time.sleep(0.1)
    assert not alive(pid)
