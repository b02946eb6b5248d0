"""Missions whose flight is a plan of a ground station: over the wire and in one process."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

import gcs_tools
from gcs_tools.flight.plan_look import flown_way
from gcs_tools.missions import plan_file
from gcs_tools.recording.plans import PlanHistory
from tests.command_line import gcs

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


def test_a_plan_file_is_flown_and_recorded(tmp_path):
    flown = gcs_tools.fly(str(SQUARE), in_process=True, out=tmp_path / "run", figure="never")
    assert (flown.exit_code, flown.ended) == (0, "landed")
    plans = PlanHistory(gcs_tools.read(tmp_path / "run").events)
    seen = plans.at(30.0)
    assert (len(seen.mission), len(seen.fence), len(seen.rally)) == (7, 2, 1)
    assert seen.mission[3].at(seen.home)[:2] == pytest.approx((25.0, 25.0), abs=0.1)
    items = [item for _, item, _ in plans.steps()]
    assert items == sorted(items)
    assert items[-1] == 7
    # drawn over the same plan, the way begins at its home and passes its places
    way, notes = flown_way(tmp_path / "run" / "flight.mcap", plan_file.read(SQUARE))
    assert notes == []
    assert way[0] == pytest.approx((0.0, 0.0), abs=0.05)
    assert min(math.dist(r, (0.0, 25.0)) for r in way) < 0.3
    figure = tmp_path / "plan.png"
    assert (
        gcs("plan", "show", SQUARE, "--figure", figure, "--flight", tmp_path / "run").exit_code == 0
    )
    assert gcs("plan", "show", SQUARE, "--flight", tmp_path / "run").exit_code == 2
    assert figure.stat().st_size > 10_000


def test_items_of_a_plan_are_held_against_their_own_time(tmp_path):
    def flown(*settings):
        result = gcs_tools.fly(
            "plan_square", in_process=True, out=tmp_path / str(len(settings)), figure="never",
            settings=settings,
        )  # fmt: skip
        return {
            each.text: each for each in result.expectations if each.text.startswith("plan item")
        }

    met = flown("expect.items.6.took_s=60", "expect.items.1.took_s=0", "expect.items.0.took_s=60")
    assert len(met) == 6
    assert all(each.passed for each in met.values())
    lands = met["plan item 6 (NAV_LAND): took_s ≤ 60"]
    rounds = met["plan item 2 (NAV_WAYPOINT): passed_m ≤ 1.5"]
    assert 15.0 < lands.value < 40.0
    assert (
        1.2 < rounds.value < 1.45
    )  # the curve passes so far from the corner: a chord of 0.7 of 2 m
    missed = flown("expect.items.4.took_s=5", "expect.items.2.passed_m=1")
    texts = {name: (each.value, each.why) for name, each in missed.items() if each.is_missed}
    assert texts.keys() == {
        "plan item 4 (NAV_WAYPOINT): took_s ≤ 5", "plan item 2 (NAV_WAYPOINT): passed_m ≤ 1",
    }  # fmt: skip


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


def test_a_plan_with_a_return_in_its_middle_ends_with_the_return(tmp_path):
    """As QGroundControl and PX4 have it, what is behind a return is not flown."""
    tables = json.loads(SQUARE.read_text())
    tables["mission"]["items"][4].update(command=20, frame=2, params=[0, 0, 0, 0, 0, 0, 0])
    path = tmp_path / "a.plan"
    path.write_text(json.dumps(tables))
    assert (
        "Item 4 returns and lands: items 5 to 6 are not flown." in gcs("plan", "show", path).stdout
    )
    flown = gcs_tools.fly(str(path), in_process=True, out=tmp_path / "run", figure="never")
    assert (flown.ended, flown.exit_code) == ("landed", 0)


def test_a_flight_that_was_cut_or_flew_no_plan_says_so_over_one(tmp_path):
    gcs_tools.fly("gust_step", in_process=True, out=tmp_path / "run", figure="never")
    whole = tmp_path / "run" / "flight.mcap"
    _, notes = flown_way(whole, plan_file.read(SQUARE))
    assert len(notes) == 1
    assert "it flew no plan" in notes[0]
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    _, notes = flown_way(cut, plan_file.read(SQUARE))
    assert "the recording was cut" in notes[0]
    done = gcs("plan", "show", SQUARE, "--figure", tmp_path / "a.png", "--flight", cut)
    assert done.exit_code == 0
    assert "was cut" in done.stderr
