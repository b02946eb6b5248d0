"""The room that a flight leaves before each limit of its actuators, in N, by what is demanded.

Four limits, each a room that is below zero where it is exceeded:

- `thrust_up`: of the demanded force to the greatest thrust,
- `thrust_down`: to the least thrust, or the least vertical force,
- `tilt`: to the cone of the greatest tilt,
- `torque`: of the total thrust, before roll and pitch take it from a rotor.

The demanded force is the law's before anything limits it, F (N, E). A room is the least
of a few that are affine in (F, T, tau), `facets`. Those of `thrust_up` and `thrust_down` touch it at one force alone: the
first lies above its room elsewhere, the second below.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from fcu.guard import margin
from fcu.kernel.rows import column
from fcu.process.tick import Tick
from gcs_tools.flight.scenario import Scenario

Rows = np.ndarray[Any, np.dtype[np.float64]]

LIMITS = ("thrust_up", "thrust_down", "tilt", "torque")
WAYS = 16  # directions of a tilt


class Facet(NamedTuple):
    """A room that is affine in an output: offset + gradient . output."""

    offset: float  # N
    gradient: Rows  # float64[6]

    def value(self, out: Rows) -> float:
        """Of an output float64[6], N."""
        return float(self.offset + self.gradient @ out)


def outputs(rows: Rows) -> Rows:
    """float64[n, 6] of rows of a Tick: demanded force (N, E), total thrust (N), torque about roll and pitch (N m)."""
    thrust = column(Tick, rows, "outputs.T_c") + column(Tick, rows, "state.memory.T_trim")
    force = column(Tick, rows, "internals.demand.T_0")
    torque = column(Tick, rows, "internals.demand.tau_d")[:, :2]
    return np.column_stack([force, thrust, torque])


def least_thrusts(scene: Scenario) -> Rows:
    """float64[n, 2], N/(N m): the least thrust for a torque about roll and pitch is the greatest of these times it.

    One row for each side of the polygon of `least_thrust`.
    """
    pairs = scene.law.rotors.pairs
    before, behind = (
        np.array([pairs.before_x, pairs.before_y]),
        np.array([pairs.behind_x, pairs.behind_y]),
    )
    n = int(np.count_nonzero(behind.any(axis=0)))
    return np.asarray((behind[:, :n] + np.roll(before[:, :n], -1, axis=1)).T)


def torque_room(scene: Scenario, out: Rows) -> Rows:
    """float64[n]: by how much (N) total thrust may move before roll and pitch take it from a rotor.

    Below zero the allocation has moved it, or has given up torque (`allocation.allocate`). Where both limits
    of a rotor are near, from a quarter to three quarters of full thrust, it may have with room left.
    """
    if len(out) == 0:
        return np.zeros(0)
    rotors = scene.law.rotors
    needed = least_thrusts(scene) @ out[:, 4:6].T
    low = out[:, 3] - rotors.W * rotors.f_min - needed.max(axis=0)
    high = rotors.W * rotors.f_max - out[:, 3] + needed.min(axis=0)
    return np.asarray(np.minimum(low, high))


def rooms(scene: Scenario, out: Rows) -> Rows:
    """float64[n, 4]: the room of each of LIMITS, N. What is not finite has none: -inf."""
    known = margin.known(scene.guard, scene.law)
    force = out[:, :3]
    size, aside = np.linalg.norm(force, axis=1), np.linalg.norm(force[:, :2], axis=1)
    found = np.column_stack([
        known.T_max - size,
        np.minimum(force[:, 2] - known.T_z_min, size - known.T_min),
        force[:, 2] * known.sin - aside * known.cos,
        torque_room(scene, out),
    ])  # fmt: skip
    return np.where(np.isfinite(found), found, -np.inf)


def facets(scene: Scenario, limit: str, out: Rows) -> list[Facet]:
    """The affine rooms of a limit, at an output float64[6]."""
    known, rotors = margin.known(scene.guard, scene.law), scene.law.rotors
    along = np.zeros(6)
    along[:3] = out[:3] / max(float(np.linalg.norm(out[:3])), 1e-9)
    if limit == "thrust_up":
        return [Facet(known.T_max, -along)]
    if limit == "thrust_down":
        up = np.zeros(6)
        up[2] = 1.0
        return [Facet(-known.T_z_min, up), Facet(-known.T_min, along)]
    if limit == "tilt":
        angles = 2.0 * math.pi / WAYS * np.arange(WAYS)
        return [
            Facet(
                0.0,
                np.array([-known.cos * math.cos(a), -known.cos * math.sin(a), known.sin, 0, 0, 0]),
            )
            for a in angles
        ]
    found = []
    for needed in least_thrusts(scene):
        found.append(Facet(-rotors.W * rotors.f_min, np.array([0, 0, 0, 1.0, *-needed])))
        found.append(Facet(rotors.W * rotors.f_max, np.array([0, 0, 0, -1.0, *needed])))
    return found
