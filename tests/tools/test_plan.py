"""`gcs plan`: what it shows of a plan file, and what it says without a vehicle."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import gcs_tools
from tests.command_line import gcs

SQUARE = Path(gcs_tools.__file__).parents[1] / "missions" / "square.plan"
RETURN = {"autoContinue": True, "command": 20, "doJumpId": 9, "frame": 2, "params": [0] * 7, "type": "SimpleItem"}  # fmt: skip


def test_what_is_left_out_is_null_in_json():
    done = gcs("plan", "show", SQUARE, "--json")
    assert done.exit_code == 0
    items = json.loads(done.stdout)["items"]
    assert items[2]["params"] == [0.0, 2.0, 0.0, None]
    assert (items[1]["height_m"], items[1]["speed_m_s"]) == (None, 4.0)


def test_a_speed_and_a_return_have_no_height_and_areas_are_counted(tmp_path):
    tables = json.loads(SQUARE.read_text())
    tables["mission"]["items"][-1] = RETURN
    path = tmp_path / "a.plan"
    path.write_text(json.dumps(tables))
    done = gcs("plan", "show", path)
    assert done.exit_code == 0
    lines = [line.split() for line in done.stdout.splitlines()]
    assert lines[1] == ["1", "DO_CHANGE_SPEED", "4.0", "m/s"]
    assert lines[2][-2:] == ["8.0", "m"]
    assert lines[6] == ["6", "NAV_RETURN_TO_LAUNCH"]
    assert "7 items; fence: 1 polygon, 1 circle; 1 rally point\n" in done.stdout


def test_a_plan_without_a_fence_says_so(tmp_path):
    tables = json.loads(SQUARE.read_text())
    del tables["geoFence"], tables["rallyPoints"]
    path = tmp_path / "a.plan"
    path.write_text(json.dumps(tables))
    assert "7 items; no fence; 0 rally points\n" in gcs("plan", "show", path).stdout


def test_a_plan_without_a_home_says_where_it_begins(tmp_path):
    tables = json.loads(SQUARE.read_text())
    home = json.loads(gcs("plan", "show", SQUARE, "--json").stdout)["home"]
    assert [home["lat_deg"], home["lon_deg"], home["alt_m"]] == tables["mission"][
        "plannedHomePosition"
    ]
    del tables["mission"]["plannedHomePosition"]
    path = tmp_path / "a.plan"
    path.write_text(json.dumps(tables))
    assert "The file has no home" in gcs("plan", "show", path).stdout
    assert json.loads(gcs("plan", "show", path, "--json").stdout)["home"] is None


@pytest.mark.parametrize(("options", "which"), [((), ""), (("--instance", 9), " as instance 9")])
def test_without_a_vehicle_an_upload_names_what_starts_one(monkeypatch, options, which):
    monkeypatch.setattr("fcu.interface.ports.running_instances", list)
    done = gcs("plan", "upload", SQUARE, "--timeout", 0, *options)
    assert done.exit_code == 3
    assert f"no vehicle is up on this machine{which} after 0 s (start one: gcs up" in done.stderr
