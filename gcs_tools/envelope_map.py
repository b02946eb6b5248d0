"""The largest step that saturates nothing, measured in flight, against what the conditions say.

    python -m gcs_tools.envelope_map     draws docs/figures/envelope_map.png, prints the coverage

A vehicle that hovers is told to be elsewhere, as asked (`warn`). A step is safe if neither thrust
nor tilt meets its limit in any of the flights: in the paper's wind at six of its phases with the
paper's 8 kg; or with every belief of the guard at its ends, the lightest and the heaviest mass
in steady wind of the greatest speed from six sides, and in the paper's wind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.law import foreseen
from fcu.law.types import LawParams
from gcs_tools import rollout
from gcs_tools.guard_check import saturated
from gcs_tools.mission import from_tables
from gcs_tools.scenario import Scenario, scenario

Array = np.ndarray[Any, np.dtype[np.float64]]

WAYS = {
    "up": (0.0, 0.0, 1.0),
    "to the side": (1.0, 0.0, 0.0),
    "down": (0.0, 0.0, -1.0),
}
SIDES = [[s * (i == k) for i in range(3)] for k in range(3) for s in (12.0, -12.0)]
PAPER_WIND = {"amplitude_m_s": [7.2, 7.2, 5.7], "frequency_rad_s": [1.5, 1.6, 1.7]}
PHASES_S = tuple(2.0 + 0.7 * k for k in range(6))  # when the step comes
HOVER_S = 2.0  # before a step, in steady wind
MOST_M, CLOSE = 80.0, 0.02  # of a search: the largest step, and its accuracy


class World(NamedTuple):
    """One of the flights that a step has to be safe in."""

    mass: float  # kg
    wind: dict[str, Any]  # a mission's table
    at_s: float  # when the step comes


PAPER = [World(8.0, PAPER_WIND, at) for at in PHASES_S]
BELIEFS = [
    *(World(m, {"steady_m_s": side}, HOVER_S) for m, side in product((7.0, 9.0), SIDES)),
    *(World(m, PAPER_WIND, at) for m, at in product((7.0, 9.0), PHASES_S[::2])),
]


def flown(world: World, f_m: float, way: Sequence[float], step: float) -> Scenario:
    """A hover in a world, and a step (m) along `way`."""
    to = [step * x for x in way]
    tables = {
        "title": "A step.",
        "flight": {
            "duration_s": world.at_s + min(10.0, 5.0 / f_m),
            "ground_z_m": -1e4,
            "arena_m": 1e4,
            "setpoints": [[0.0, 0.0, 0.0, 0.0], [world.at_s, *to]],
        },
        "law": {"f_m": f_m, "guard": "warn", "m_hat_0": world.mass, "J_hat_0": 0.3},
        "plant": {"mass_kg": world.mass},
        "wind": world.wind,
        "expect": {},
    }
    return scenario(from_tables("step", tables))


def saturates(world: World, f_m: float, way: Sequence[float], step: float) -> bool:
    """Whether thrust or tilt meets a limit from the step on."""
    scene = flown(world, f_m, way, step)
    _, rows = rollout.fly(scene)
    begun = round(world.at_s * scene.rate_hz)
    return len(rows) < scene.ticks or bool(saturated(rows[begun:]).any())


def largest(holds: Callable[[float], bool]) -> float:
    """The largest step (m) up to MOST_M for which something holds, that holds for smaller ones."""
    if not holds(0.0):
        return 0.0
    low, high = 0.0, 1.0
    while high < MOST_M and holds(high):
        low, high = high, 2.0 * high
    if high > MOST_M:
        return MOST_M
    while high - low > CLOSE * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def safe_step(worlds: Sequence[World], f_m: float, way: Sequence[float]) -> float:
    """The largest step (m) that saturates in none of the worlds."""
    worst = list(worlds)

    def holds(step: float) -> bool:
        for world in worst:
            if saturates(world, f_m, way, step):
                worst.remove(world)
                worst.insert(0, world)  # it will be the first to tell the next time
                return False
        return True

    return largest(holds)


def holds_for(law: LawParams, way: Sequence[float], step: float) -> bool:
    """Whether the exact set along the reference has room for a step (m) from rest."""
    still = Vec3(0.0, 0.0, 0.0)
    to = Setpoint(Vec3(*(step * x for x in way)), still, still, 0.0, 0.0)
    return bool(foreseen.least(law._replace(h=0.005), to, still, still)[0] >= 0.0)


def condition_step(law: LawParams, way: Sequence[float]) -> float:
    """The largest step (m) from rest for which the guard's condition holds."""
    return largest(partial(holds_for, law, way))
