"""The World of a simulator: constants, start state, noise and delay of reports."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.airframe import AirframeFile, read
from fcu.interface.messages import VehicleState
from sitl_plant.physics.parameters import plant_params, start_state, steps_per_tick
from sitl_plant.physics.truth import truth
from sitl_plant.physics.types import PlantParams


class Noise(NamedTuple):
    """Standard deviation, by axis, of the white noise added to the reported state at each tick."""

    position: float  # m
    velocity: float  # m/s
    attitude: float  # rad
    rate: float  # rad/s


class World(NamedTuple):
    """All inputs of the simulator. All leaves are floats, so that JSON can hold them."""

    params: PlantParams
    start: VehicleState
    noise: Noise
    rate_hz: float
    seed: float  # of the noise, a whole number
    delay_ticks: float  # delay of the reported state, a whole number of ticks

    @property
    def steps(self) -> int:
        """Integration steps per control period."""
        return steps_per_tick(self.rate_hz)

    @property
    def noise_scale(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """float64[12]: standard deviation of each noise value that `report` adds."""
        return np.repeat(np.array(self.noise), 3)


def world(
    rate_hz: float = 500.0,
    seed: int = 1,
    plant: Mapping[str, Any] | None = None,
    wind: Mapping[str, Any] | None = None,
    start: Mapping[str, Any] | None = None,
    ground_z_m: float = 0.0,
    arena_m: float = 1000.0,
    airframe: AirframeFile | None = None,
) -> World:
    """A World from the tables of a mission (default: on the ground in still air).

    airframe : what is believed of the vehicle, by which its truth is found; None: an S1000.

    Raises AirframeError.
    """
    plant = plant or {}
    params = plant_params(truth(airframe or read()), rate_hz, plant, wind, ground_z_m, arena_m)
    noise = plant.get("noise") or {}
    return World(
        params=params,
        start=start_state(params, {"on_ground": True} if start is None else start),
        noise=Noise(
            position=noise.get("position_m") or 0.0,
            velocity=noise.get("velocity_m_s") or 0.0,
            attitude=math.radians(noise.get("attitude_deg") or 0.0),
            rate=noise.get("rate_rad_s") or 0.0,
        ),
        rate_hz=float(rate_hz),
        seed=float(seed),
        delay_ticks=float(round((plant.get("delay_s") or 0.0) * rate_hz)),
    )
