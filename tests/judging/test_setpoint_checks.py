"""Setpoints that stand are to be reached, and flown as asked for, unless a mission says otherwise."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import columns, size
from fcu.process.tick import Tick
from gcs_tools.judging.expectations import ExpectError, judge_each
from gcs_tools.judging.setpoint_checks import Standing, changed, standing
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.timeline import Timeline, timeline
from gcs_tools.recording.table import Table
from sitl_plant.physics.types import PlantRecord

RATE = 100
EIGHT = {"kind": "figure_eight", "size_m": [16.0, 8.0], "speed_max_m_s": 5.0}


def flight(*setpoints: list[float], **keys: Any) -> Timeline:
    return timeline(
        Flight.model_validate(
            {"duration_s": 20.0, "rate_hz": RATE, "setpoints": list(setpoints), **keys}
        )
    )


def rows(seconds: float) -> tuple[Table, Table]:
    """A vehicle that rests at the origin, and flies the setpoint there."""
    n = round(seconds * RATE)
    plant, fcu = np.zeros((n, size(PlantRecord))), np.zeros((n, size(Tick)))
    plant[:, 0] = fcu[:, 0] = np.arange(n) / RATE
    fcu[:, columns(Tick).index("engaged")] = 2.0
    return Table.of(PlantRecord, plant), Table.of(Tick, fcu)


def put(table: Table, name: str, value: float, *, from_s: float = 0.0) -> None:
    table.rows[round(from_s * RATE) :, table.names.index(name)] = value


def reached(standing: list[Standing], entry: Any = None, ended: str = "time") -> Any:
    expect = {} if entry is None else {"reached": entry}
    found = judge_each(expect, lambda *_: None, ended, standing=standing)
    return {line.name: line for line in found}.get("reached")


@pytest.mark.parametrize(
    ("seconds", "times"),
    [(20.0, [(0.0, 5.0), (9.0, 20.0)]), (14.0, [(0.0, 5.0), (9.0, 14.0)]), (13.9, [(0.0, 5.0)])],
)
def test_a_setpoint_counts_that_stands_for_five_seconds(seconds, times) -> None:
    """Setpoints of one place are one; the last one stands until the flight has ended."""
    told = flight([0.0, 0, 0, 0], [3.0, 0, 0, 0], [5.0, 1, 0, 0], [9.0, 2, 0, 0], [10.0, 2, 0, 0])
    found = standing(told, rows(seconds)[0])
    assert [(each.since_s, each.until_s) for each in found] == times


def test_the_vehicle_is_looked_at_at_the_end_of_a_setpoints_time() -> None:
    plant, _ = rows(20.0)
    put(plant, "state.r_E.x", 3.0)
    put(plant, "state.r_E.x", 0.4, from_s=9.99)  # the tick before the next setpoint
    put(plant, "state.r_E.x", 7.0, from_s=10.0)
    first, last = standing(flight([0.0, 0, 0, 0], [10.0, 7, 0, 4]), plant)
    assert (first.away_m, last.away_m) == (pytest.approx(0.4), 4.0)


def test_a_curve_never_stands() -> None:
    assert standing(flight(curve=EIGHT), rows(20.0)[0]) == []
    assert reached([]) is None


def far(away_m: float) -> Standing:
    return Standing(10.0, 20.0, Vec3(1000.0, 0.0, 0.0), away_m)


@pytest.mark.parametrize(
    ("away_m", "entry", "limit", "passed"),
    [
        (0.5, None, 0.5, True),
        (0.51, None, 0.5, False),
        (0.51, True, 0.5, False),
        (0.11, 0.1, 0.1, False),
        (0.51, 1, 1.0, True),
        (math.inf, None, 0.5, False),
    ],
)
def test_what_is_not_reached_fails_within_what_the_mission_says(away_m, entry, limit, passed):
    found = reached([far(0.0), far(away_m)], entry)
    assert (found.limit, found.passed) == (limit, passed)
    assert found.value == (away_m if math.isfinite(away_m) else None)


def test_a_failure_says_which_setpoint_where_the_vehicle_was_and_what_to_do() -> None:
    why = reached([far(953.2)]).why
    for part in ("of 10 s at (1000, 0, 0) m", "at 20 s", "953 m away", "[expect] reached"):
        assert part in why


@pytest.mark.parametrize(
    ("entry", "expect", "ended"),
    [(False, {}, "time"), (None, {"ended": "diverged"}, "diverged")],
)
def test_no_expectation_of_setpoints_gives_no_check(entry, expect, ended) -> None:
    expect = expect if entry is None else {**expect, "reached": entry}
    found = judge_each(expect, lambda *_: None, ended, standing=[far(953.2)])
    assert [line.name for line in found] == ["ended"]


def test_setpoints_that_never_stood_are_named_as_such() -> None:
    found = reached([], 0.1)
    assert (found.passed, found.value) == (False, None)
    assert "no setpoint stood for 5 s" in str(found)


@pytest.mark.parametrize("entry", [0.0, -1.0, math.inf, "no"])
def test_a_tolerance_is_a_distance(entry) -> None:
    with pytest.raises(ExpectError, match="expected true, false or a distance > 0 in m"):
        reached([far(0.0)], entry)


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("r_c.x", 110.0, "of 10 s, (1000, 0, 0) m, was flown as (110, 0, 0) m"),
        ("v_c.x", 1.0, "of 10 s, 0 m/s, was flown at 1 m/s"),
        ("psi_dot_c", 2.0, "of 10 s, 0 rad/s, was flown at 2 rad/s"),
    ],
)
def test_a_setpoint_that_is_flown_as_another_one_is_told_once(column, value, said) -> None:
    _, fcu = rows(20.0)
    put(fcu, "setpoint.r_c.x", 1000.0, from_s=10.0)
    put(fcu, f"setpoint.{column}", value, from_s=10.0)
    told = flight([0.0, 0, 0, 0], [10.0, 1000, 0, 0])
    (found,) = changed(told, fcu)
    assert said in str(found)
    swinging = flight(
        [0.0, 0, 0, 0], [10.0, 1000, 0, 0], yaw={"amplitude_rad": 0.0, "frequency_rad_s": 1.0}
    )
    assert [each.at_s for each in changed(swinging, fcu)] == [10.0]  # of those sent since


def test_a_setpoint_that_the_vehicle_does_not_hear_is_not_changed() -> None:
    _, fcu = rows(20.0)
    told = flight([0.0, 0, 0, 0], [10.0, 5, 0, 0], [15.0, 0, 0, 0])
    assert [each.at_s for each in changed(told, fcu)] == [10.0]
    assert changed(told, fcu, lambda tick: tick != round(10.0 * told.flight.rate_hz)) == []


def test_what_the_wire_rounds_is_as_asked_for() -> None:
    _, fcu = rows(20.0)
    place = 12345.678
    put(fcu, "setpoint.r_c.x", float(np.float32(place)))
    assert changed(flight([0.0, place, 0, 0]), fcu) == []


@pytest.mark.parametrize(
    ("entry", "limited", "passed"),
    [
        (None, False, None), (None, True, False), (False, False, True), (False, True, False),
        (True, True, True), (True, False, False),
    ],
)  # fmt: skip
def test_a_limited_setpoint_fails_unless_it_is_expected(entry, limited, passed) -> None:
    _, fcu = rows(20.0)
    put(fcu, "setpoint.r_c.x", 100.0 if limited else 1000.0)
    found = judge_each(
        {} if entry is None else {"limited": entry}, lambda *_: None, "time",
        changed=changed(flight([0.0, 1000, 0, 0]), fcu),
    )  # fmt: skip
    lines = {line.name: line for line in found}
    assert (lines["limited"].passed if "limited" in lines else None) == passed


def test_of_a_law_that_never_flew_nothing_was_changed() -> None:
    _, fcu = rows(20.0)
    put(fcu, "engaged", 0.0)
    put(fcu, "setpoint.r_c.x", 7.0)
    assert changed(flight([0.0, 0, 0, 0]), fcu) == []


def test_setpoints_that_a_lost_vehicle_never_came_to_are_missed() -> None:
    """The first one was reached, and the vehicle crashed before the second had stood, and before the third."""
    told = flight([0.0, 0, 0, 0], [7.0, 1, 0, 0], [13.0, 2, 0, 0])
    plant, _ = rows(9.0)
    assert len(standing(told, plant)) == 1
    first, *cut = standing(told, plant, was_cut=True)
    assert (first.away_m, first.was_cut) == (0.0, False)
    assert [(each.since_s, each.until_s, each.away_m) for each in cut] == [
        (7.0, 9.0, math.inf), (13.0, 9.0, math.inf),
    ]  # fmt: skip
    line = reached([first, *cut], 0.5, "crashed")
    assert line.is_missed
    assert "the flight ended at 9 s" in line.why
    assert reached([first], 0.5, "crashed").is_missed is False


def test_setpoints_too_short_to_count_are_not_missed_by_a_lost_vehicle() -> None:
    told = flight([0.0, 0, 0, 0], [17.0, 1, 0, 0])
    assert len(standing(told, rows(16.0)[0], was_cut=True)) == 1
