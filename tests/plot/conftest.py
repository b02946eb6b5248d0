"""Flights made up of rows whose numbers are known."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fcu.interface.airframe import believed
from fcu.kernel.buffers import columns, size, to_buffer
from fcu.kernel.rows import column
from fcu.process.settings import Settings, settings
from fcu.process.tick import Tick
from gcs_tools.recording.reader import VALUES, Recording
from gcs_tools.recording.schema import PLANT_TIMING, TIMING, TOPICS, WIND, FcuRow, PlantRow
from gcs_tools.recording.table import Table
from sitl_plant.physics.types import PlantRecord

RATE_HZ = 500.0
METADATA = {
    "mission": "made_up",
    "title": "A flight made up.",
    VALUES: json.dumps(
        {
            "plant.drag_torque": {"value": [0.05, 0.06, 0.07], "origin": "s1000.toml"},
            "plant.drag": {"value": [0.15, 0.15, 0.15], "origin": "s1000.toml"},
        }
    ),
}


@dataclass
class Made:
    """Whole rows of both sides, 500 a second, by column; zero where nothing was said."""

    seconds: float = 8.0
    metadata: dict[str, str] = field(default_factory=lambda: dict(METADATA))

    def __post_init__(self) -> None:
        n = round(self.seconds * RATE_HZ)
        self.plant, self.fcu = np.zeros((n, size(PlantRow))), np.zeros((n, size(FcuRow)))
        self.t = np.arange(n) / RATE_HZ
        self.plant[:, 0] = self.fcu[:, 0] = self.t
        self.set_fcu(engaged=2.0, **{"outputs.T_c": 80.0, "state.estimates.m_hat": 8.0})
        self.set_plant(m=8.0, **{"J.x": 0.3, "J.y": 0.3, "J.z": 0.5})
        self.set_fcu(**{f"state.estimates.J_hat.{axis}": 0.4 for axis in "xyz"})
        self.set_fcu(**{f"outputs.thrusts.r{i}": 10.0 for i in range(1, 9)})
        self.params = to_buffer(settings(*believed(), RATE_HZ))
        self.told = dict(zip(columns(Settings), self.params.tolist(), strict=True))

    def set_fcu(self, **values: Any) -> None:
        """Values of columns of Tick and Report: a number, or one for each tick."""
        for name, value in values.items():
            column(FcuRow, self.fcu, name)[:] = value

    def set_plant(self, **values: Any) -> None:
        """Values of columns of PlantRecord and PlantReport."""
        for name, value in values.items():
            column(PlantRow, self.plant, name)[:] = value

    def recording(self, path: Path = Path("made_up.mcap"), **changed: Any) -> Recording:
        """As if read from `path`; fields of Recording may be changed."""
        plant, fcu = Table.of(PlantRow, self.plant), Table.of(FcuRow, self.fcu)

        def of(rows: Table, topic: str) -> Table:
            names = TOPICS[topic].columns
            return Table(np.stack([rows[name] for name in names], axis=1), names)

        given: dict[str, Any] = {
            "path": path,
            "metadata": self.metadata,
            "plant": Table.of(PlantRecord, self.plant),
            "fcu": Table.of(Tick, self.fcu),
            "params": self.told,
            "events": [],
            "reports": {
                WIND: of(fcu, WIND),
                TIMING: of(fcu, TIMING),
                PLANT_TIMING: of(plant, PLANT_TIMING),
            },
            "topics": TOPICS,
            "lost": {},
            "complete": True,
        }
        return Recording(**{**given, **changed})


@pytest.fixture
def made() -> Made:
    """A flight of 8 s, settled at 5 s."""
    return Made()


@pytest.fixture
def make() -> Callable[..., Made]:
    """A flight of so many seconds."""
    return Made
