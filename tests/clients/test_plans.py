"""Real clients upload, fly, pause, jump, download and clear plans, fences and rally points."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.clients.plan_table import ACTIONS, CLIENTS, PlanRunner
from tests.process.conftest import claimed_instance

HERE = Path(__file__).parent


def test_mavsdk_flies_a_plan_inside_a_fence_and_returns_to_a_rally_point(vehicle, run):
    up = vehicle("--speed", "4")
    said = run(HERE / "plan_mavsdk.py", up.ports.script).splitlines()
    steps = [line for line in said if not line.startswith("refused")]
    assert steps == ["given back", "fenced", "rally", "started", "paused", "all", "cleared"]
    assert any(line.startswith("refused") for line in said)


def test_mavsdks_own_system_tests_of_missions_and_fences_pass(vehicle, run):
    up = vehicle()
    said = run(HERE / "plan_mavsdk_system.py", up.ports.script).splitlines()
    assert said == [
        "mission_changed", "mission_raw_upload", "mission_raw_upload_empty",
        "mission_upload_cancellation", "mission_download_cancellation", "geofence_download",
    ]  # fmt: skip


@pytest.mark.parametrize("version", ["2", "1"])
def test_mavwp_flies_a_plan(vehicle, run, monkeypatch, version):
    monkeypatch.setenv("MAVLINK20", "1") if version == "2" else monkeypatch.delenv(
        "MAVLINK20", raising=False
    )
    up = vehicle("--speed", "4")
    more = ["kinds"] if version == "2" else []
    said = run(HERE / "plan_mavwp.py", f"udpout:127.0.0.1:{up.ports.fcu_station}", *more)
    stored = ["fenced", "rally"] if more else []
    flown = ["started", "paused", "resumed", "jumped", "landed", "cleared"]
    assert said.splitlines() == ["given back", *stored, *flown]


INSTALLED = "MAVSDK 4 (package mavsdk-grpc)", "MAVProxy, typed in", "MAVROS, its plugins' messages"


@pytest.mark.parametrize("name", INSTALLED)
def test_a_client_of_the_table_does_what_it_has(tmp_path, name):
    """Judged by the vehicle's recording, as in the table of docs/plans.md."""
    client = next(client for client in CLIENTS if client.name == name)
    with claimed_instance() as instance:
        runner = PlanRunner(tmp_path, {}, Path(), instance, network=False)
        did, said = runner.fly(client)
    assert did == set(ACTIONS), said
