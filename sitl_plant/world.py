"""What a plant is started with: its constants, where the flight begins, and what it reports.

Written as JSON by whoever starts the plant, so that every number it flies is on file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.airframe import load
from fcu.kernel.buffers import from_buffer, to_buffer
from sitl_plant.physics.parameters import plant_params, start_state, steps_per_tick
from sitl_plant.physics.types import PlantParams, PlantState

BELIEVED = Path(__file__).resolve().parents[1] / "fcu" / "octo.toml"


class World(NamedTuple):
    """Everything the plant needs to know."""

    params: PlantParams
    start: PlantState
    rate_hz: float
    seed: int
    noise_scale: np.ndarray  # float64[12]: one sigma of m, m/s, rad, rad/s, three each
    delay_ticks: int

    @property
    def steps(self) -> int:
        """Integration steps in a control period."""
        return steps_per_tick(self.rate_hz)


def world(
    rate_hz: float = 500.0,
    seed: int = 1,
    plant: Mapping[str, Any] | None = None,
    wind: Mapping[str, Any] | None = None,
    start: Mapping[str, Any] | None = None,
    ground_z_m: float = 0.0,
    arena_m: float = 1000.0,
) -> World:
    """A World from a mission's tables; without any, an S1000 standing on the ground."""
    plant = plant or {}
    params = plant_params(load(BELIEVED)["rotors"], rate_hz, plant, wind, ground_z_m, arena_m)
    noise = plant.get("noise") or {}
    sigma = (
        noise.get("position_m") or 0.0,
        noise.get("velocity_m_s") or 0.0,
        math.radians(noise.get("attitude_deg") or 0.0),
        noise.get("rate_rad_s") or 0.0,
    )
    return World(
        params=params,
        start=start_state(params, {"on_ground": True} if start is None else start),
        rate_hz=rate_hz,
        seed=seed,
        noise_scale=np.repeat(np.array(sigma, dtype=np.float64), 3),
        delay_ticks=round((plant.get("delay_s") or 0.0) * rate_hz),
    )


def write(world: World, path: Path) -> None:
    """As JSON; every float64 survives to the bit."""
    content = {
        "rate_hz": world.rate_hz,
        "seed": world.seed,
        "delay_ticks": world.delay_ticks,
        "noise_scale": world.noise_scale.tolist(),
        "start": to_buffer(world.start).tolist(),
        "params": to_buffer(world.params).tolist(),
    }
    path.write_text(json.dumps(content, allow_nan=False))


def read(path: Path) -> World:
    """What `write` wrote. Raises ValueError when it is not that, OSError when it is not there."""
    try:
        content = json.loads(path.read_text())
        return World(
            params=from_buffer(PlantParams, content["params"]),
            start=from_buffer(PlantState, content["start"]),
            rate_hz=float(content["rate_hz"]),
            seed=int(content["seed"]),
            noise_scale=np.array(content["noise_scale"], dtype=np.float64),
            delay_ticks=int(content["delay_ticks"]),
        )
    except (KeyError, TypeError, ValueError, StopIteration) as error:
        raise ValueError(f"{path}: not a plant's world ({error})") from error
