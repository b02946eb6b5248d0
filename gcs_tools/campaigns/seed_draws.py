"""What a seed draws of a mission, alike for every law: noise, wind, and the vehicle within what is believed.

    flown = sampled(mission, procedure.draws, Stream.TEST, 17)

A drawn mission is a mission: its values in force say what was drawn, and `gcs fly --set` flies it again.
The numbers depend on stream, seed and the mission's name alone, so that laws meet the same flights, and
seeds of one stream never meet those of another.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, Self

import numpy as np

from fcu.interface.airframe import AirframeFile, Interval, body
from gcs_tools.campaigns import draws as campaign_draws
from gcs_tools.campaigns.draws import SEED, DrawError
from gcs_tools.campaigns.procedure import Draws
from gcs_tools.missions.mission import Mission, with_values


class Stream(IntEnum):
    """What flights are for. Each has random numbers of its own."""

    TEST = 0
    TRAINING = 1
    VALIDATION = 2


class Beliefs(NamedTuple):
    """What the airframe file believes of the vehicle."""

    mass: Interval  # kg
    inertia: tuple[Interval, ...]  # kg m^2, about the body axes
    lag: float  # of the rotors, s

    @classmethod
    def of(cls, airframe: AirframeFile) -> Self:
        """Of an airframe file. Raises AirframeError."""
        mass, inertia = body(airframe.tables, airframe.source)
        return cls(mass, inertia, airframe.rotors.rotor_lag)


def sampled(mission: Mission, draws: Draws, stream: Stream, seed: int) -> Mission:
    """The mission as a seed draws it; with seed 0 as written. Raises MissionError, AirframeError."""
    if seed == 0:
        return mission
    values = numbers(mission.name, Beliefs.of(mission.airframe), draws, stream, seed)
    kept = said(mission)
    return with_values(mission, {k: v for k, v in values.items() if k not in kept}, f"seed {seed}")


def said(mission: Mission) -> frozenset[str]:
    """Return the keys under [plant] that the mission gives itself, which no seed draws."""
    own: Any = mission.given.get("plant", {})
    return frozenset(f"plant.{key}" for key in own)


def numbers(
    name: str, beliefs: Beliefs, draws: Draws, stream: Stream, seed: int
) -> Mapping[str, Any]:
    """Dotted keys of a mission, and what a seed draws for each."""
    of_mission = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    random = np.random.default_rng([int(stream), seed, of_mission])
    turn = 2.0 * math.pi
    noise = int(random.integers(1, 2**53))
    mass, across, upright, lag, azimuth = random.uniform(size=5).tolist()
    phases = (turn * random.uniform(size=6)).tolist()
    x, y, z = beliefs.inertia
    return {
        "flight.seed": noise,
        "plant.mass_kg": _between(mass, beliefs.mass),
        "plant.inertia_kg_m2": [_between(across, x), _between(across, y), _between(upright, z)],
        "plant.rotor_lag_s": beliefs.lag * _between(lag, draws.rotor_lag),
        "wind.azimuth_deg": 360.0 * azimuth,
        "wind.phase_rad": phases[:3],
        "wind.rotation_phase_rad": phases[3:],
    }


def _between(part: float, ends: Interval) -> float:
    low, high = ends
    return low + part * (high - low)


@dataclass(frozen=True)
class SeedDraws(campaign_draws.Draws):
    """The draws of a campaign with [seeds]: its flight n is the one of seed `seed` + n."""

    mission: str = ""  # its name, which draws too
    beliefs: Beliefs | None = None
    draws: Draws | None = None
    kept: frozenset[str] = frozenset()  # keys that the mission gives itself

    @classmethod
    def of(cls, mission: Mission, draws: Draws, first: int, n: int) -> Self:
        """Of a mission as it is flown, from its first seed on. Raises AirframeError."""
        return cls(
            campaign_draws.RANDOM, first, n, (), (), False, mission=mission.name,
            beliefs=Beliefs.of(mission.airframe), draws=draws, kept=said(mission),
        )  # fmt: skip

    @property
    def names(self) -> tuple[str, ...]:
        """The drawn quantities: each number of an array by itself."""
        return tuple(name for name, _ in _flat(self._drawn(1)))

    def quantities(self, number: int) -> dict[str, Any]:
        """What a flight draws. Seed 0 draws nothing."""
        return dict(_flat(self._drawn(self.seed + number)))

    def values(
        self, number: int, quantities: Mapping[str, Any], base: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Dotted keys of a mission, and their values: the noise's seed among them."""
        return self._numbers(self.seed + number)

    def _drawn(self, seed: int) -> dict[str, Any]:
        return {key: value for key, value in self._numbers(seed).items() if key != SEED}

    def _numbers(self, seed: int) -> dict[str, Any]:
        if seed == 0:
            return {}
        if self.beliefs is None or self.draws is None:
            raise DrawError("[seeds]: no airframe to draw a vehicle from")
        drawn = numbers(self.mission, self.beliefs, self.draws, Stream.TEST, seed)
        return {key: value for key, value in drawn.items() if key not in self.kept}


def _flat(values: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Name and value of each number, KEY[0] for the first one of an array."""
    for key, value in values.items():
        if isinstance(value, list):
            yield from ((f"{key}[{i}]", each) for i, each in enumerate(value))
        else:
            yield key, value
