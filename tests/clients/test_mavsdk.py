"""MAVSDK, in both its Python packages, flies a vehicle from its first heartbeat to its landing."""

from __future__ import annotations

from pathlib import Path

import pytest

STEPS = ["took off", "there", "2 m/s east", "at the place", "landed at home"]


SCRIPTS = ("fly_mavsdk.py", "fly_mavsdk_grpc.py")
FLOWN = [
    *((script, autopilot, "s1000") for script in SCRIPTS for autopilot in ("px4", "generic")),
    (SCRIPTS[0], "px4", "quad"),
]


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
