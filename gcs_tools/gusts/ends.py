"""The ends of what is believed of a vehicle: at them, not between, a wind finds it weakest."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any, NamedTuple

from fcu.guard.stability import LAGS, rotor_lag
from fcu.interface.airframe import body
from fcu.kernel.algebra import Rotors, Vec3
from gcs_tools.flight.scenario import Scenario

DRAGS = {"all": (1.0, 1.0, 1.0), "vertical": (0.0, 0.0, 1.0), "level": (1.0, 1.0, 0.0)}


class End(NamedTuple):
    """One vehicle within what is believed."""

    mass_kg: float
    inertia_kg_m2: tuple[float, ...]  # body axes
    drag: tuple[float, ...]  # N/(m/s)^2, body axes
    rotor_lag_s: float

    @property
    def words(self) -> str:
        """For a column of a table."""
        along = next(
            (
                name
                for name, of in DRAGS.items()
                if tuple(map(bool, of)) == tuple(map(bool, self.drag))
            ),
            "none",
        )
        return f"{self.mass_kg:.3g} kg, drag {along}, lag {1e3 * self.rotor_lag_s:.3g} ms"

    @property
    def plant(self) -> dict[str, Any]:
        """Of a mission's [plant]."""
        return {name: list(v) if isinstance(v, tuple) else v for name, v in self._asdict().items()}


def ends(scene: Scenario) -> list[End]:
    """Every pair of mass and lag at their ends, with drag along all body axes, the vertical one or the level ones.

    The inertia is the greatest that is believed: of each torque it makes the least.
    """
    guard, lag = scene.guard, rotor_lag(scene.law)
    _, inertia = body(scene.airframe.tables, scene.airframe.name)
    return [
        End(
            mass_kg=float(m),
            inertia_kg_m2=tuple(float(most) for _, most in inertia),
            drag=tuple(float(guard.c_D * part) for part in drag),
            rotor_lag_s=round(float(part * lag), 6),
        )
        for m, drag, part in itertools.product(
            dict.fromkeys((guard.m_min, guard.m_max)), DRAGS.values(), LAGS
        )
    ]


def at(scene: Scenario, end: End) -> Scenario:
    """The scene flown by that vehicle, in still air."""
    params, start = scene.world.params, scene.world.start
    heavier, off = end.mass_kg / params.m, (end.mass_kg - params.m) * params.g
    sunk = 0.0 if any(start.Omega) else off / params.ground.stiffness  # where it stands on its gear
    still, lag = Vec3(0.0, 0.0, 0.0), end.rotor_lag_s
    world = scene.world._replace(
        start=start._replace(
            r_E=start.r_E - Vec3(0.0, 0.0, sunk),
            Omega=Rotors(*(math.sqrt(heavier) * Omega for Omega in start.Omega)),
        ),
        params=params._replace(
            m=end.mass_kg,
            m_after=end.mass_kg,
            J=Vec3(*end.inertia_kg_m2),
            c_D=Vec3(*end.drag),
            decay_half=math.exp(-0.5 * params.h / lag) if lag > 0.0 else 0.0,
            decay=math.exp(-params.h / lag) if lag > 0.0 else 0.0,
            wind=params.wind._replace(steady=still, amplitude=still, step=still),
        ),
    )
    return replace(scene, world=world, wind=None)
