"""What is true of a vehicle: a file beside what is believed of it, and the middle of that without one.

The truth of a shipped airframe is `sitl_plant/airframes/NAME.toml`, that of a FILE.toml
`FILE.truth.toml` beside it. Every table and key of it may be left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from fcu.interface import airframe as airframes
from fcu.interface.airframe import (
    SHIPPED,
    Airframe,
    AirframeError,
    AirframeFile,
    airframe,
    digest,
    drag,
    is_number,
    load,
    number_in,
    wrong,
)
from fcu.interface.files.spelling import suggestion_or_list

HERE = Path(__file__).resolve().parents[1] / "airframes"
SUFFIX = ".truth.toml"  # in the place of .toml

# Where nothing is said: what makes an S1000 of an S1000, and its like in another size.
DRAG_TORQUE = 2.34  # over drag times the cube of the rotors' distance: 0.05 of 0.15 at 0.5225 m
GEAR, FOOTPRINT = 0.58, 0.44  # over that distance: 0.305 m and 0.23 m
STIFFNESS = 1000.0  # 1/s^2, over mass: 1 cm under the vehicle's weight
DAMPED = 0.71  # of the critical damping
FRICTION, IMPACT_M_S = 0.6, 3.0
CELL_OHM, CELL_OHM_AH = 0.001, 0.01  # of leads, and over capacity
EFFICIENCY, AVIONICS_W = 0.5, 5.0

_TABLES: dict[str, dict[str, tuple[float, float, str]]] = {  # least, greatest, unit
    "vehicle": {"mass_kg": (1e-3, 1e4, "kg")},
    "ground": {
        "gear_m": (1e-3, 20.0, "m"),
        "stiffness_n_m": (1e-2, 1e8, "N/m"),
        "damping_n_s_m": (0.0, 1e7, "N s/m"),
        "friction": (0.0, 10.0, ""),
        "footprint_m": (1e-3, 20.0, "m"),
        "impact_max_m_s": (0.01, 1000.0, "m/s"),
    },
    "battery": {
        "capacity_ah": (1e-3, 1e4, "A h"),
        "remaining": (0.0, 1.0, ""),
        "cells": (1, 100, ""),
        "resistance_ohm": (1e-6, 100.0, "ohm"),
        "efficiency": (0.01, 1.0, ""),
        "avionics_w": (0.0, 1e4, "W"),
    },
}
_AXES = {
    "inertia_kg_m2": (1e-9, 1e4, "kg m^2"),
    "drag": (0.0, 100.0, "N/(m/s)^2"),
    "drag_torque": (0.0, 100.0, "N m/(rad/s)^2"),
}


class Truth(NamedTuple):
    """Tables as those of a file in which everything is said, and where each value is from."""

    vehicle: Mapping[str, Any]
    rotors: Mapping[str, Any]
    ground: Mapping[str, float]
    battery: Mapping[str, float]
    origins: Mapping[tuple[str, str], str]  # (table, key) -> what a result calls its file
    source: str
    identity: str  # of its file, with the first digits of the hash of its text


def path_of(believed: AirframeFile) -> Path:
    """The file of what is true, whether it is there or not."""
    if SHIPPED.get(believed.name) == believed.path:
        return HERE / believed.path.name
    return believed.path.with_name(believed.name + SUFFIX)


def shown(path: Path) -> str:
    """What results call the file of a truth."""
    return f"sitl_plant/airframes/{path.name}" if path.parent == HERE else path.name


def truth(believed: AirframeFile) -> Truth:
    """What is true of an airframe. Raises AirframeError for a file that cannot be used."""
    path = path_of(believed)
    # `exists` is false for a link to itself, too: that one is to be said
    there = path.exists() or path.is_symlink()
    said = _checked(load(path), str(path)) if there else {}
    rotors = {**believed.tables["rotors"], **said.get("rotors", {})}
    for one, other in (("position_m", "angle_deg"), ("angle_deg", "position_m")):
        if one in said.get("rotors", {}):
            for key in (other, *(("radius_m",) if other == "angle_deg" else ())):
                rotors.pop(key, None)
    true = airframe(rotors, str(path))
    if true.n != believed.rotors.n:
        raise wrong(
            str(path), "rotors", "spin", f"{believed.rotors.n} numbers, as is believed",
            said["rotors"].get("spin"),
        )  # fmt: skip
    given = {**_like(believed, said, true)}
    origins, middle = {}, f"middle of {believed.path.name}"
    for table, values in given.items():
        for key in values:
            from_file = key in said.get(table, {})
            origins[table, key] = shown(path) if from_file else middle
        given[table] = {**values, **said.get(table, {})}
    for key in rotors:
        from_file = key in said.get("rotors", {})
        origins["rotors", key] = shown(path) if from_file else believed.path.name
    hashed = f" {digest(path)[:16]}" if there else ""
    identity = f"{shown(path) if there else middle}{hashed}"
    return Truth(rotors=rotors, origins=origins, source=str(path), identity=identity, **given)


def _like(
    believed: AirframeFile, said: Mapping[str, Any], true: Airframe
) -> dict[str, dict[str, Any]]:
    """What is true where nothing is said: the middle of what is believed, and what is alike."""
    source = str(believed.path)
    mass, inertia = airframes.body(believed.tables, source)
    c_D = said.get("vehicle", {}).get("drag", list(drag(believed.tables, source)))
    m = float(said.get("vehicle", {}).get("mass_kg", 0.5 * sum(mass)))
    n = true.n
    R = math.sqrt(sum(x * x + y * y for x, y in zip(true.x, true.y, strict=True)) / n)
    battery = {**believed.tables["battery"], **said.get("battery", {})}
    capacity = float(battery.get("capacity_ah", battery["capacity_mah"] / 1000.0))
    stiffness = STIFFNESS * m
    return {
        "vehicle": {
            "mass_kg": 0.5 * sum(mass),
            "inertia_kg_m2": [0.5 * sum(axis) for axis in inertia],
            "drag": c_D,
            "drag_torque": [DRAG_TORQUE * c * R**3 for c in c_D],
        },
        "ground": {
            "gear_m": GEAR * R,
            "stiffness_n_m": stiffness,
            "damping_n_s_m": DAMPED * 2.0 * math.sqrt(stiffness * m),
            "friction": FRICTION,
            "footprint_m": FOOTPRINT * R,
            "impact_max_m_s": IMPACT_M_S,
        },
        "battery": {
            "capacity_ah": capacity,
            "remaining": 1.0,
            "cells": float(battery["cells"]),
            "resistance_ohm": float(battery["cells"]) * (CELL_OHM + CELL_OHM_AH / capacity),
            "efficiency": EFFICIENCY,
            "avionics_w": AVIONICS_W,
        },
    }


def _checked(tables: Mapping[str, Any], source: str) -> Mapping[str, Any]:
    """The tables of a file. Raises AirframeError for what is not in the schema or out of range."""
    known = {
        "vehicle": (*_TABLES["vehicle"], *_AXES), "rotors": airframes.KEYS["rotors"],
        "ground": tuple(_TABLES["ground"]), "battery": tuple(_TABLES["battery"]),
    }  # fmt: skip
    for name, table in tables.items():
        if name not in known:
            raise AirframeError(f"{source}: {name}: no such table{suggestion_or_list(name, known)}")
        if not isinstance(table, dict):
            raise AirframeError(f"{source}: {name}: expected a table")
        for key in table:
            if key not in known[name]:
                raise AirframeError(
                    f"{source}: [{name}] {key}: no such key{suggestion_or_list(key, known[name])}"
                )
        for key in table.keys() & _TABLES.get(name, {}).keys():
            number_in(source, table, name, key, *_TABLES[name][key])
        for key in table.keys() & _AXES.keys():
            low, high, unit = _AXES[key]
            row = table[key]
            three = isinstance(row, list) and len(row) == 3
            if not three or not all(is_number(v, low, high) for v in row):
                raise wrong(
                    source, name, key, f"three numbers from {low:g} to {high:g} {unit}", row
                )
    return tables
