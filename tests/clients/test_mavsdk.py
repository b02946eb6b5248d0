"""MAVSDK, in both its Python packages, flies a vehicle from its first heartbeat to its landing."""

from __future__ import annotations

from pathlib import Path

import pytest

STEPS = ["took off", "there", "2 m/s east", "at the place", "landed at home"]


@pytest.mark.parametrize("script", ["fly_mavsdk.py", "fly_mavsdk_grpc.py"])
@pytest.mark.parametrize("autopilot", ["px4", "generic"])
def test_a_whole_flight(vehicle, run, script, autopilot):
    up = vehicle("--speed", "4", "--autopilot", autopilot)
    said = run(Path(__file__).parent / script, up.ports.script)
    assert [line for line in said.splitlines() if line in STEPS] == STEPS
