"""MAVSDK, in both its Python packages, flies a vehicle from its first heartbeat to its landing."""

from __future__ import annotations

from pathlib import Path

import pytest

STEPS = ["took off", "there", "2 m/s east", "at the place", "landed at home"]


@pytest.mark.parametrize("script", ["fly_mavsdk.py", "fly_mavsdk_grpc.py"])
@pytest.mark.parametrize(
    ("autopilot", "airframe"), [("px4", "s1000"), ("generic", "s1000"), ("px4", "quad")]
)
def test_a_whole_flight(vehicle, run, script, autopilot, airframe):
    up = vehicle("--speed", "4", "--autopilot", autopilot, "--airframe", airframe)
    said = run(Path(__file__).parent / script, up.ports.script)
    assert [line for line in said.splitlines() if line in STEPS] == STEPS
