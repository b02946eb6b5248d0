"""MAVSDK, in both its Python packages, flies a vehicle from its first heartbeat to its landing."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from gcs_tools import fly

STEPS = ["took off", "there", "2 m/s east", "at the place", "landed at home"]


SCRIPTS = ("fly_mavsdk.py", "fly_mavsdk_grpc.py")
# both as another autopilot; as PX4 the one flies a mission below, and the other by TCP
FLOWN = [*((script, "generic", "s1000") for script in SCRIPTS), (SCRIPTS[0], "px4", "quad")]


@pytest.mark.parametrize(("script", "autopilot", "airframe"), FLOWN)
def test_a_whole_flight(vehicle, run, script, autopilot, airframe):
    up = vehicle("--speed", "4", "--autopilot", autopilot, "--airframe", airframe)
    address = f"udpin://127.0.0.1:{up.ports.script}" if "grpc" in script else up.ports.script
    said = run(Path(__file__).parent / script, address)
    assert [line for line in said.splitlines() if line in STEPS] == STEPS


def test_a_whole_flight_by_tcp(vehicle, run):
    up = vehicle("--speed", "4")
    script = Path(__file__).parent / "fly_mavsdk_grpc.py"
    said = run(script, f"tcpout://127.0.0.1:{up.ports.fcu_tcp}")
    assert [line for line in said.splitlines() if line in STEPS] == STEPS


def test_an_orbit_is_flown_on_its_circle(vehicle, run):
    up = vehicle("--speed", "4")
    said = run(Path(__file__).parent / "orbit_mavsdk.py", up.ports.script)
    (flown,) = (line for line in said.splitlines() if line.startswith("radius "))
    assert [float(each) for each in flown.split()[1:]] == pytest.approx([8.0] * 4, abs=0.1)


def test_a_target_is_followed_that_is_told_as_soon_as_the_mode_is_answered(vehicle, run):
    up = vehicle("--speed", "4")
    said = run(Path(__file__).parent / "follow_mavsdk.py", up.ports.script).splitlines()
    (beside,) = (line.split()[1:] for line in said if line.startswith("beside "))
    assert [float(each) for each in beside] == pytest.approx([10.0, 9.0], abs=0.4)
    assert said[-1] == "landed"


@pytest.mark.parametrize("script", ["sticks_mavsdk.py", "sticks_mavsdk_grpc.py"])
def test_a_flight_by_sticks_alone(vehicle, run, script):
    up = vehicle("--speed", "1")
    address = f"udpin://127.0.0.1:{up.ports.script}" if "grpc" in script else up.ports.script
    said = run(Path(__file__).parent / script, address).splitlines()
    steps = ["Position", "took off", "forward", "turned clockwise", "Altitude", "right", "landed"]
    assert [line for line in said if line in steps] == steps


def test_a_mission_runs_a_script_of_mavsdk(tmp_path):
    script = Path(__file__).parent / "fly_mavsdk.py"
    (tmp_path / "one.toml").write_text(
        'title = "A script flies by MAVSDK."\n[flight]\nduration_s = 300.0\nground_z_m = 0.0\n'
        f'start = {{ on_ground = true }}\nscript = "{sys.executable} {script} {{port}}"\npace = "speed:4"\n'
    )
    flown = fly(
        str(tmp_path / "one.toml"), out=tmp_path / "run", allow_commands=True, figure="never"
    )
    assert (flown.exit_code, flown.ended) == (0, "landed"), flown.error
    said = (tmp_path / "run" / "script.log").read_text().splitlines()
    assert [line for line in said if line in STEPS] == STEPS
