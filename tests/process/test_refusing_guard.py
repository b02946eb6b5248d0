"""A guard that refuses loses no vehicle that leads itself: take-off, landing and the way home."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fcu.kernel.rows import column
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import from_tables
from sitl_plant.physics.types import PlantRecord

AWAY = {"kind": "return"}
DOWN = {"kind": "land"}


@pytest.mark.parametrize("end", [DOWN, AWAY], ids=["land", "return"])
@pytest.mark.parametrize("height_m", [1.0, 5.0])
def test_it_takes_off_and_lands_again(height_m: float, end: dict[str, Any]) -> None:
    """The reference is held to a jerk there, and what nobody looked ahead at swung ever farther."""
    mission = from_tables("refuses", {
        "title": "Up and down.",
        "flight": {
            "duration_s": 40.0, "ground_z_m": 0.0, "start": {"on_ground": True},
            "items": [{"kind": "take_off", "height_m": height_m}, {"kind": "hold", "for_s": 3.0}, end],
        },
        "law": {"guard": "refuse"},
    })  # fmt: skip
    flown = MemoryFlight(scenario(mission), None, (lambda rows: None, lambda rows: None)).fly()
    assert flown.ended == "landed"
    heights = column(PlantRecord, flown.plant, "state.r_E")[:, 2]
    assert height_m - 0.1 < heights.max() < height_m + 0.2
    assert column(PlantRecord, flown.plant, "state.v_E")[:, 2].min() > -1.2
    assert np.isfinite(heights).all()
