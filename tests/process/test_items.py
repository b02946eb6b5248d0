"""Missions of items: flown as a ground script would, to their end, over the wire and in process alike."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import gcs_tools
from fcu.mavlink.definitions import CommandId
from fcu.mavlink.framing import Source
from fcu.services.command_protocol import FORCE
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.run import UsageError
from gcs_tools.flight.scenario import scenario
from gcs_tools.judging.recorded_flight import engaged_ticks
from gcs_tools.judging.result import Result
from gcs_tools.missions.mission import load
from gcs_tools.missions.timeline import ITEM_BEGUN, timeline
from gcs_tools.recording.reader import read

HEAD = """title = "Items."
[flight]
duration_s = 60.0
ground_z_m = 0.0
"""
GROUND = "start = { on_ground = true }\n"
STATION_PORT = 14599
UP = '{ kind = "take_off", height_m = 3.0 }'


def flown(
    folder: Path, *items: str, start: str = GROUND, more: str = "", **options: object
) -> Result:
    listed = "".join(f"    {item},\n" for item in items)
    mission = folder / "items.toml"
    mission.write_text(f"{HEAD}{start}items = [\n{listed}]\n{more}")
    options = {"in_process": True, "figure": "never", "record": "none", **options}
    return gcs_tools.fly(str(mission), out=folder / "run", **options)  # type: ignore[arg-type]


def by_text(result: Result) -> dict[str, object]:
    return {line.text.partition(" ≤")[0].partition(" ≥")[0]: line for line in result.expectations}


@pytest.mark.slow
def test_the_square_lands_and_is_the_same_over_the_wire(tmp_path: Path) -> None:
    results = [
        gcs_tools.fly("square_and_land", in_process=alone, out=tmp_path / name, figure="never")
        for name, alone in (("alone", True), ("wire", False))
    ]
    for result in results:
        assert result.passed, result.expectations
        assert result.ended == "landed"
        assert [each.kind for each in result.items] == [
            "take_off",
            "go_to",
            "follow",
            "hold",
            "land",
        ]
        begins = [each.began_s for each in result.items]
        assert begins[1:] == [each.ended_s for each in result.items[:-1]]
        assert result.items[-1].ended_s == result.ticks / result.rate_hz
    alone, wire = results
    assert alone.trajectory_sha256 == wire.trajectory_sha256
    assert alone.items == wire.items
    assert alone.metrics == wire.metrics


@pytest.mark.slow
def test_a_recording_tells_the_same_errors_as_its_flight(tmp_path: Path) -> None:
    result = gcs_tools.fly("square_and_land", in_process=True, out=tmp_path / "run", figure="never")
    recording = read(tmp_path / "run" / "flight.mcap")
    assert engaged_ticks(recording).metrics() == pytest.approx(result.metrics, rel=1e-12)
    told = [event.values for event in recording.events if event.code == ITEM_BEGUN]
    assert told == [
        (1, 5, "take_off", "take_off", 0.0, 0.0, 5.0),
        (2, 5, "go_to", "go_to", 10.0, 0.0, 6.0),
        (3, 5, "follow", "go_to", 10.0, 0.0, 6.0),
        (3, 5, "follow", "path", 0.0, 0.0, 6.0),
        (4, 5, "hold", "hold", 0.0, 0.0, 6.0),
        (5, 5, "land", "land"),
    ]


def test_a_return_ends_at_home_and_a_takeoff_follows(tmp_path: Path) -> None:
    result = flown(
        tmp_path, UP, '{ kind = "go_to", position_m = [8.0, 6.0, 4.0] }',
        '{ kind = "return", expect = { touchdown_m = 0.1, touchdown_m_s = 0.8 } }',
        '{ kind = "take_off", height_m = 4.0, expect = { took_s = 6.0 } }',
        '{ kind = "land", expect = { took_s = 12.0 } }',
        start=f"{GROUND[:-3]}, position_m = [2.0, 1.0, 0.0] }}\n",
    )  # fmt: skip
    assert result.passed, result.expectations
    assert len(by_text(result)) == 6
    assert result.ended == "landed"


@pytest.mark.parametrize("last", ["land", "hold"])
def test_rotors_that_are_stopped_in_the_air_end_no_landing(tmp_path: Path, last: str) -> None:
    """The controller is disarmed then, as after a landing."""
    item = '{ kind = "land" }' if last == "land" else '{ kind = "hold", for_s = 6.0 }'
    mission = tmp_path / "items.toml"
    mission.write_text(f'{HEAD}{GROUND}items = [{{ kind = "take_off", height_m = 0.8 }}, {item}]\n')
    drop = (lambda rows: None, lambda rows: None)
    stopped: list[float] = []

    def stop(time_s: float) -> None:
        begun = [] if flight._items is None else flight._items.begun
        if not stopped and len(begun) == 2 and time_s >= begun[1].tick / 500.0 + 0.3:
            stopped.append(time_s)
            vehicle = flight.meet(STATION_PORT, Source(254, 190))
            vehicle.command(CommandId.ARM_DISARM, 0.0, FORCE)

    flight = MemoryFlight(scenario(load(mission)), None, drop, stop)
    flown = flight.fly()
    assert stopped and (flown.ended, flown.arrived) == ("fell", False)


def test_items_begin_in_the_air_and_end_once_all_is_done(tmp_path: Path) -> None:
    start = "start = { position_m = [1.0, 2.0, 9.0], yaw_deg = 90.0 }\n"
    hold = '{ kind = "hold", for_s = 3.0, expect = { setpoint_error_max_m = 0.05 } }'
    result = flown(tmp_path, hold, start=start)
    assert result.passed, result.expectations
    assert (result.ended, result.items[0].ended_s) == ("done", 3.0)
    assert result.sim_time_s == pytest.approx(3.0, abs=0.003)


def test_what_comes_after_an_item_is_no_part_of_it(tmp_path: Path) -> None:
    """At the tick at which a hold ends the next setpoint is sent, 6 m away."""
    hold = '{ kind = "hold", for_s = 3.0, expect = { setpoint_error_max_m = 0.05 } }'
    there = '{ kind = "go_to", position_m = [6.0, 0.0, 5.0] }'
    result = flown(
        tmp_path, hold, there, hold, start="start = { position_m = [0.0, 0.0, 5.0] }\n",
        more="[expect]\nsetpoint_error_max_m = { at_least = 5.9 }\n",
    )  # fmt: skip
    first, second = (line for line in result.expectations if line.text.startswith("item "))
    assert first.passed and first.value < 1e-3
    assert second.value < 0.3


def test_a_recorded_track_is_flown(tmp_path: Path) -> None:
    t = np.arange(0.0, 14.01, 0.1)
    p = (
        2.0 * np.pi * (t / 14.0 - np.sin(2.0 * np.pi * t / 14.0) / (2.0 * np.pi))
    )  # from rest to rest
    rows = np.stack([t, 3.0 * np.cos(p) - 3.0, 3.0 * np.sin(p), 4.0 + 0.0 * t], axis=1)
    np.savetxt(
        tmp_path / "track.csv", rows, delimiter=",", header="t_s,x_m,y_m,z_m", comments="", fmt="%.4f"
    )  # fmt: skip
    follow = '{ kind = "follow", file = "track.csv", acceleration_m_s2 = 3.5'
    result = flown(tmp_path, UP, follow + ", expect = { setpoint_error_final_m = 0.2 } }")
    assert result.passed, result.expectations
    assert result.items[1].ended_s == pytest.approx(result.items[1].began_s + 14.0 + 3.0, abs=2.0)


def test_an_item_without_an_end_in_time_is_named(tmp_path: Path) -> None:
    far = '{ kind = "go_to", position_m = [60.0, 0.0, 4.0] }'
    land = '{ kind = "land", expect = { took_s = 20.0 } }'
    result = flown(tmp_path, UP, far, land, settings=["flight.duration_s=8"])
    assert (result.ended, result.exit_code) == ("time", 1)
    assert "Item 2 of 3 (go_to) had not ended: the vehicle was " in result.causes[0]
    missed = {line.name: line for line in result.expectations if not line.passed}
    assert missed["ended"].limit == "landed"
    assert missed["took_s"].why == "of item 3 (land): it never began"
    assert [each.ended_s is None for each in result.items] == [False, True, True]


def test_what_the_vehicle_refuses_ends_the_flight_with_its_reason(tmp_path: Path) -> None:
    empty = "[plant]\nbattery_remaining = 0.01\n"
    result = flown(tmp_path, UP, '{ kind = "land" }', more=empty)
    assert (result.ended, result.exit_code) == ("refused", 1)
    assert result.causes[0].startswith("Item 1 of 2 (take_off): ARM_DISARM refused: ")
    assert "battery" in result.causes[0].lower()


def test_a_refusal_may_be_what_is_expected(tmp_path: Path) -> None:
    empty = '[plant]\nbattery_remaining = 0.01\n[expect]\nended = "refused"\n'
    assert flown(tmp_path, UP, '{ kind = "land" }', more=empty).passed


def test_what_a_guard_would_refuse_is_known_before_the_flight(tmp_path: Path) -> None:
    far = '{ kind = "go_to", position_m = [9.0, 0.0, 4.0] }'
    with pytest.raises(UsageError, match="refused"):
        flown(tmp_path, UP, far, more='[law]\nguard = "refuse"\n')


def test_time_on_the_ground_counts_in_no_margin(tmp_path: Path) -> None:
    """On the ground motors idle at their least thrust, which is no margin at all."""
    result = flown(
        tmp_path, UP, '{ kind = "land" }', record="full",
        more="[expect]\nmargin_min_n = 10.0\nthrust_saturated_fraction = 0.0\n",
    )  # fmt: skip
    assert result.passed, result.expectations
    recording = read(tmp_path / "run" / "flight.mcap")
    flies = recording.fcu["engaged"] > 0.5
    margin = recording.fcu["guard.margin.force"][flies]
    assert np.nanmin(margin) < 10.0
    assert json.loads((tmp_path / "run" / "result.json").read_text())["items"][1]["kind"] == "land"


def test_what_is_told_of_no_item_asks_for_no_place() -> None:
    """A recording that was cut short may tell of no item."""
    flight = load("square_and_land").flight
    assert np.isnan(timeline(flight).positions_at(np.array([0.0, 5.0]))).all()
    assert list(timeline(flight).places()) == list(timeline(flight).sent()) == []


DEAD = "".join(
    f"[[plant.rotor_loss]]\nrotor = {i}\nat_s = 0.0\neffectiveness = 0.0\n" for i in range(1, 9)
)
HIGH = "start = { position_m = [0.0, 0.0, 60.0] }\n"


@pytest.mark.parametrize("for_s", [1.0, 2.5])
def test_a_vehicle_that_falls_does_not_hold(tmp_path: Path, for_s: float) -> None:
    result = flown(tmp_path, f'{{ kind = "hold", for_s = {for_s} }}', start=HIGH, more=DEAD)
    assert (result.ended, result.passed) == ("done", False)
    (missed,) = (line for line in result.expectations if not line.passed)
    assert missed.name == "reached"
    assert float(missed.value or 0.0) == pytest.approx(0.5 * 9.81 * for_s**2, rel=0.2)


def test_where_time_is_to_run_out_the_vehicle_is_where_it_was_sent(tmp_path: Path) -> None:
    heavy = '[plant]\nmass_kg = 40.0\n[expect]\nended = "time"\n'
    result = flown(tmp_path, UP, '{ kind = "land" }', more=heavy, settings=["flight.duration_s=8"])
    assert [line.name for line in result.expectations if not line.passed] == ["reached"]


FAST = (
    '{ kind = "follow", speed_m_s = 11.0, acceleration_m_s2 = 9.0,'
    " points_m = [[0, 0, 3], [10, 0, 3], [10, 10, 3], [0, 10, 3]]"
)


def test_a_path_is_to_be_followed_without_being_written(tmp_path: Path) -> None:
    """The guard flies it more gently, and the vehicle cuts what it cannot follow."""
    result = flown(tmp_path, UP, FAST + " }", '{ kind = "land" }')
    (missed,) = (line for line in result.expectations if not line.passed)
    assert missed.text == "item 2 (follow): setpoint_error_max_m ≤ 0.5 along its path"
    assert missed.value > 2.0
    assert any("The guard slowed item 2 (follow)" in cause for cause in result.causes)


def test_what_an_item_missed_is_told_with_where_its_time_went_and_its_error_was_greatest(
    tmp_path: Path,
) -> None:
    """A step of 5 m, which no vehicle flies in a second; then a hold and a landing."""
    near = '{ kind = "go_to", position_m = [4.0, 0.0, 6.0], within_m = 0.1'
    step = near + ", expect = { took_s = 1.0, setpoint_error_max_m = 0.1 } }"
    hold = '{ kind = "hold", for_s = 2.0, expect = { took_s = 1.0 } }'
    down = '{ kind = "land", expect = { took_s = 1.0 } }'
    result = flown(tmp_path, UP, step, hold, down)
    missed = [line for line in result.expectations if not line.passed]
    went, worst, held, landed = (line.why or "" for line in missed)
    assert "of item 2 (go_to): it was within 0.1 m of its end after " in went
    assert "greatest 0 s after its begin, 4.99 m" in worst
    assert "the step of the setpoint" in worst
    assert "a hold of 2 s" in held
    assert "of item 4 (land): it was on the ground after " in landed
    first, slow = (float(number) for number in re.findall(r"after (\S+) s", went))
    assert 1.0 < first <= slow == pytest.approx(missed[0].value, abs=0.01)


@pytest.mark.slow
def test_an_item_that_was_not_reached_is_told_with_its_distance(tmp_path: Path) -> None:
    """The plain cascade learns nothing: the wind holds it farther off than 2 cm."""
    law = Path(__file__).parents[1] / "own_law" / "plain_cascade.py"
    result = gcs_tools.fly(
        "take_off",
        law=str(law),
        settings=["flight.arrive.within_m=0.02", "flight.duration_s=15"],
        in_process=True,
        figure="never",
        record="none",
        out=tmp_path / "run",
    )
    assert result.ended == "time"
    (cause,) = (cause for cause in result.causes if "had not arrived" in cause)
    away, nearest = (float(number) for number in re.findall(r"(\S+) m[ f]", cause)[:2])
    assert 0.02 < nearest <= away < 0.2
    assert "within 0.02 m for 2 s" in cause


@pytest.mark.parametrize(
    ("expect", "more"),
    [(", expect = { setpoint_error_max_m = 20.0 }", ""), ("", "[expect]\nreached = false\n")],
)
def test_a_mission_may_expect_less_of_a_path(tmp_path: Path, expect: str, more: str) -> None:
    result = flown(tmp_path, UP, FAST + expect + " }", '{ kind = "land" }', more=more)
    assert result.passed, result.expectations


def test_a_law_without_a_reference_model_does_items(tmp_path: Path) -> None:
    law = Path(__file__).parents[1] / "own_law" / "plain_cascade.py"
    result = flown(tmp_path, UP, '{ kind = "land" }', law=str(law))
    assert result.passed, result.expectations


def test_in_process_a_crash_warns_of_no_more_than_over_the_wire(tmp_path: Path) -> None:
    crash = DEAD + '[expect]\nended = "crashed"\n'
    low = "start = { position_m = [0.0, 0.0, 4.0] }\n"
    result = flown(tmp_path, '{ kind = "hold", for_s = 5.0 }', start=low, more=crash)
    assert result.passed, result.expectations
    assert not [each for each in result.warnings if "gcs reset" in each.text]


@pytest.mark.parametrize("more", ["height_m = 0.5", "height_m = 3.0, within_m = 5.0"])
def test_what_never_leaves_the_ground_has_not_taken_off(tmp_path: Path, more: str) -> None:
    """It stands on its gear 0.3 m above the ground: so near is near enough for a low take-off."""
    up, hold = f'{{ kind = "take_off", {more} }}', '{ kind = "hold", for_s = 3.0 }'
    result = flown(
        tmp_path, up, hold, more="[plant]\nmass_kg = 40.0\n", settings=["flight.duration_s=6"]
    )
    assert (result.ended, result.passed) == ("time", False)
    assert result.items[0].ended_s is None
