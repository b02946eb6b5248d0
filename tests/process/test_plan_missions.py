"""Missions whose flight is a plan of a ground station: over the wire and in one process."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import gcs_tools

SQUARE = Path(gcs_tools.__file__).parents[1] / "missions" / "square.plan"


def test_over_the_wire_and_in_one_process_it_is_one_flight(tmp_path):
    hashes = set()
    for name in ("wire", "memory"):
        flown = gcs_tools.fly(
            "plan_square", in_process=name == "memory", out=tmp_path / name, figure="never"
        )
        assert (flown.passed, flown.ended) == (True, "landed"), flown.expectations
        hashes.add(flown.trajectory_sha256)
    assert len(hashes) == 1


def test_a_plan_file_is_flown(tmp_path):
    flown = gcs_tools.fly(str(SQUARE), in_process=True, out=tmp_path / "run", figure="never")
    assert (flown.exit_code, flown.ended) == (0, "landed")


@pytest.mark.parametrize(("changed", "said"), [("fence", "item 2"), ("command", "item 3")])
def test_a_plan_that_the_vehicle_refuses_says_its_item(tmp_path, changed, said):
    tables = json.loads(SQUARE.read_text())
    if changed == "fence":  # over the first leg
        tables["geoFence"]["circles"][0]["circle"]["center"] = [47.397742, 8.5457]
    else:
        tables["mission"]["items"][3]["command"] = 84
    path = tmp_path / "a.plan"
    path.write_text(json.dumps(tables))
    flown = gcs_tools.fly(str(path), in_process=True, out=tmp_path / "run", figure="never")
    assert (flown.ended, flown.exit_code) == ("refused", 1)
    assert said in str(flown.causes)


def test_a_plan_that_does_not_land_is_done_once_it_is_complete(tmp_path):
    tables = json.loads(SQUARE.read_text())
    del tables["mission"]["items"][-1]
    path = tmp_path / "a.plan"
    path.write_text(json.dumps(tables))
    flown = gcs_tools.fly(str(path), in_process=True, out=tmp_path / "run", figure="never")
    assert (flown.ended, flown.exit_code) == ("done", 0)
