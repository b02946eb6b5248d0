"""A flight that was over before its items were: which of them had not ended, and where the vehicle was."""

from __future__ import annotations

import numpy as np

from fcu.kernel.buffers import columns, size
from gcs_tools.judging.item_checks import unfinished
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.timeline import Begun, PlanProgress
from gcs_tools.recording.table import Table
from sitl_plant.physics.types import PlantRecord

FLIGHT = Flight.model_validate({
    "start": {"on_ground": True}, "ground_z_m": 0.0, "duration_s": 60.0,
    "items": [
        {"kind": "take_off", "height_m": 3.0},
        {"kind": "go_to", "position_m": [4.0, 0.0, 3.0], "yaw_deg": 0.0},
        {"kind": "land"},
    ],
})  # fmt: skip
AT, SPEED = (1.0, 0.0, 3.0), 0.25


def plant():
    """The vehicle 3 m before its second place, at 0.25 m/s."""
    rows = np.zeros((2, size(PlantRecord)))
    names = columns(PlantRecord)
    first = names.index("state.r_E.x")
    rows[:, first : first + 3] = AT
    rows[:, names.index("state.v_E.x")] = SPEED
    return Table.of(PlantRecord, rows)


def test_no_item_is_told_of_a_flight_that_began_none():
    assert unfinished(FLIGHT, (), plant()) == ""


def test_the_last_item_that_was_begun_is_told_with_the_way_left():
    begun = (Begun(0, 0, (0.0, 0.0, 3.0)), Begun(1, 500, (4.0, 0.0, 3.0)))
    said = unfinished(FLIGHT, begun, plant())
    assert "2 of 3 (go_to)" in said
    assert "3 m away at 0.25 m/s" in said


def test_of_a_plan_its_item_is_told():
    said = unfinished(FLIGHT, (Begun(1, 500, None, PlanProgress(4, 7, False)),), plant())
    assert "the vehicle was at item 4 of the plan, whose last is 6." in said


def test_of_a_landing_no_way_is_told():
    said = unfinished(FLIGHT, (Begun(2, 900, None),), plant())
    assert "3 of 3 (land)" in said and "away" not in said
