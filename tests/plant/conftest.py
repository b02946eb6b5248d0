"""The plant as it is simulated: the octocopter, still air and ground far below unless named."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fcu.interface.airframe import read
from fcu.interface.messages import RotorCommand, VehicleState
from fcu.kernel.algebra import Rotors
from fcu.kernel.buffers import from_buffer, size, to_buffer
from fcu.kernel.rows import view
from sitl_plant.physics import tick
from sitl_plant.physics.parameters import plant_params
from sitl_plant.physics.truth import truth as true_of
from sitl_plant.physics.types import PlantParams, PlantRecord

TRUTH = true_of(read())


@pytest.fixture(scope="session")
def plant() -> Callable[..., PlantParams]:
    """PlantParams: `plant(drag=[0, 0, 0])`, `plant(wind={...}, ground_z_m=0.0)`; steps of 1 ms."""

    def build(
        wind: Any = None, ground_z_m: float = -1e5, arena_m: float = 1e6, **differs: Any
    ) -> PlantParams:
        return plant_params(TRUTH, 1000.0, differs, wind, ground_z_m, arena_m)

    return build


@pytest.fixture(scope="session")
def fly() -> Callable[..., VehicleState]:
    """The state after `seconds` under one command (rotor speeds over full speed)."""

    def run(
        params: PlantParams, state: VehicleState, u: Any, seconds: float, t: float = 0.0
    ) -> VehicleState:
        buffer = to_buffer(state)
        tick.advance(
            to_buffer(params), buffer, np.zeros(2), command(u), t, round(seconds / params.h)
        )
        return from_buffer(VehicleState, buffer)

    return run


@pytest.fixture(scope="session")
def truth() -> Callable[..., Any]:
    """The PlantRecord (as a NamedTuple) of a state at a time."""

    def observe(params: PlantParams, state: VehicleState, t: float = 0.0) -> PlantRecord:
        row, buffer = np.zeros(size(PlantRecord)), to_buffer(state)
        tick.observe(to_buffer(params), buffer, np.zeros(2), t, buffer, row)
        assert view(PlantRecord, row).t == t
        return from_buffer(PlantRecord, row)

    return observe


def command(u: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """A RotorCommand buffer from one number for all rotors, or eight."""
    return to_buffer(RotorCommand(Rotors(*np.broadcast_to(u, 8).astype(float).tolist())))
