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
    said = run(Path(__file__).parent / script, up.ports.script)
    assert [line for line in said.splitlines() if line in STEPS] == STEPS
