"""Where the body that a mission flies is not the one that its controller believes in.

A flight with another mass or inertia is allowed: it tests how a law copes. It is told, since it is as
often an oversight: a mission that sets the mass of one vehicle, flown with another.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from fcu.interface.airframe import Interval, body
from gcs_tools.missions.mission import Mission, Value

CLOSE = 1e-9  # relative: an end of an interval is inside it
MASSES = ("plant.mass_kg", "plant.mass_change.mass_kg")
INERTIA = "plant.inertia_kg_m2"


def unbelieved(mission: Mission) -> str:
    """The mass (kg) and inertia (kg m^2) that fly and are not believed, in one sentence; empty: none.

    Believed is `[vehicle]` of the airframe file, of the mass the mission's `guard_mass_kg` where it is
    set. A `mass_ratio` changes any vehicle alike, and is never told.
    """
    values = mission.values_in_force()
    found = [*_masses(mission, values), *inertias(mission, values)]
    if not found:
        return ""
    return f"the simulated vehicle is outside what the controller assumes: {'; '.join(found)}"


def _masses(mission: Mission, values: Mapping[str, Value]) -> Iterator[str]:
    believed, _ = body(mission.airframe.tables, mission.airframe.name)
    source = f"{mission.airframe.name} assumes"
    if not mission.controller and (told := getattr(mission.law, "guard_mass_kg", None)):
        believed, source = told, "law.guard_mass_kg says"
    for key in MASSES:
        if key in values and not _is_in(float(values[key].value), believed):
            yield _told(key, values[key], source, believed, "kg")


def inertias(mission: Mission, values: Mapping[str, Value] | None = None) -> Iterator[str]:
    """What is believed of the inertia about an axis and is not true of what flies, in words.

    values : in force; None: the mission's.
    """
    _, believed = body(mission.airframe.tables, mission.airframe.name)
    value = (mission.values_in_force() if values is None else values)[INERTIA]
    for axis, own, within in zip("xyz", value.value, believed, strict=True):
        if not _is_in(float(own), within):
            about = Value(own, value.origin)
            source = f"{mission.airframe.name} assumes"
            yield _told(f"{INERTIA} about {axis}", about, source, within, "kg m^2")


def _is_in(value: float, within: Interval) -> bool:
    least, most = within
    inside = least <= value <= most
    return inside or any(math.isclose(value, end, rel_tol=CLOSE) for end in within)


def _told(key: str, value: Value, source: str, within: Interval, unit: str) -> str:
    least, most = within
    return f"{key} is {value.value:.4g} {unit} ({value.origin}), {source} {least:.4g} to {most:.4g}"
