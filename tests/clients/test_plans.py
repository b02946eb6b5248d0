"""Real clients upload, fly, pause, jump, download and clear plans, fences and rally points."""

from __future__ import annotations

from pathlib import Path

import pytest

HERE = Path(__file__).parent


def test_mavsdk_flies_a_plan_inside_a_fence_and_returns_to_a_rally_point(vehicle, run):
    up = vehicle("--speed", "4")
    said = run(HERE / "plan_mavsdk.py", up.ports.script).splitlines()
    steps = [line for line in said if not line.startswith("refused")]
    assert steps == ["given back", "fenced", "rally", "started", "paused", "all", "cleared"]
    assert any(line.startswith("refused") for line in said)


@pytest.mark.parametrize("version", ["2", "1"])
def test_mavwp_flies_a_plan(vehicle, run, monkeypatch, version):
    monkeypatch.setenv("MAVLINK20", "1") if version == "2" else monkeypatch.delenv(
        "MAVLINK20", raising=False
    )
    up = vehicle("--speed", "4")
    said = run(HERE / "plan_mavwp.py", f"udpout:127.0.0.1:{up.ports.fcu_station}")
    assert said.splitlines() == ["given back", "landed"]
