"""What an airframe is, to the controller that flies it and to the plant that stands in for it.

The schema is shared, the values never: the controller reads what it believes from
`fcu/airframes/s1000.toml`, the plant what is true from `sitl_plant/truth.toml`.
Frame: body Forward-Left-Up, origin at the centre of mass, rotors in the plane z = 0.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

from fcu.interface import input_file
from fcu.interface.input_file import TomlError
from fcu.kernel.algebra import Rotors, Vec3

MOST_BYTES = input_file.MIB // 4  # of a file
ROTORS = len(Rotors._fields)  # of every airframe that can be flown


class Airframe(NamedTuple):
    """Eight rotors and the limits of what they are asked for. SI units, angles in rad."""

    x: Rotors  # rotor positions forward of the centre of mass, m
    y: Rotors  # rotor positions left of it, m
    spin: Rotors  # +1 counter-clockwise from above (about +z body), -1 clockwise
    c_T: float  # thrust over rotor speed squared, N/(rad/s)^2
    k_Q: float  # drag torque over thrust, m
    Omega_max: float  # full rotor speed, rad/s
    rotor_lag: float  # first-order lag of rotor speed, s; may be zero
    J_m: float  # inertia of one rotor about its axis, kg m^2


Interval = tuple[float, float]  # least, greatest


class AirframeError(ValueError):
    """An airframe table that cannot be flown: says which key and what was expected."""


_NUMBERS = {
    "thrust_coefficient": "c_T",
    "torque_to_thrust_m": "k_Q",
    "full_speed_rad_s": "Omega_max",
    "lag_s": "rotor_lag",
    "inertia_kg_m2": "J_m",
}


def airframe(table: dict[str, Any], source: str = "airframe") -> Airframe:
    """Build an Airframe from the `[rotors]` table of an airframe TOML.

    Raises AirframeError naming `source` and the key, when one is missing or out of range.
    """
    for key in ("angle_deg", "spin", "radius_m", *_NUMBERS):
        if key not in table:
            raise AirframeError(f"{source}: [rotors] {key} is missing")
    angles, spins, radius = table["angle_deg"], table["spin"], table["radius_m"]
    for key, row in (("angle_deg", angles), ("spin", spins)):
        if not isinstance(row, list) or len(row) != ROTORS:
            raise AirframeError(f"{source}: [rotors] {key}: expected eight numbers, got {row!r}")
    if any(s not in (1, -1) for s in spins):
        raise AirframeError(f"{source}: [rotors] spin: expected 1 (ccw) or -1 (cw), got {spins}")
    numbers = {name: float(table[key]) for key, name in _NUMBERS.items()}
    for key, name in _NUMBERS.items():
        lowest = 0.0 if name in ("rotor_lag", "J_m") else 1e-12
        if not lowest <= numbers[name] < math.inf:
            raise AirframeError(f"{source}: [rotors] {key}: expected a positive number")
    return Airframe(
        x=Rotors(*[radius * math.cos(math.radians(a)) for a in angles]),
        y=Rotors(*[radius * math.sin(math.radians(a)) for a in angles]),
        spin=Rotors(*[float(s) for s in spins]),
        **numbers,
    )


OCTO = Path(__file__).resolve().parents[1] / "airframes" / "s1000.toml"


def believed(path: Path = OCTO) -> tuple[Airframe, dict[str, Any]]:
    """The airframe the controller believes it flies, and all tables of its file.

    Raises AirframeError.
    """
    tables = load(path)
    for table in ("rotors", "limits"):
        if table not in tables:
            raise AirframeError(f"{path}: [{table}] is missing")
    return airframe(tables["rotors"], str(path)), tables


def believed_drag(path: Path = OCTO) -> Vec3:
    """Drag coefficients, N/(m/s)^2, body axes: the wind that is shown hangs on them.

    Raises AirframeError.
    """
    table = load(path).get("air", {})
    drag = table.get("drag")
    if not (isinstance(drag, list) and len(drag) == 3):
        raise AirframeError(f"{path}: [air] drag: expected three numbers, got {drag!r}")
    if not all(isinstance(c, int | float) and 0.0 < c < 100.0 for c in drag):
        raise AirframeError(f"{path}: [air] drag: expected numbers from 0 to 100, got {drag!r}")
    return Vec3(*[float(c) for c in drag])


def believed_body(path: Path = OCTO) -> tuple[Interval, tuple[Interval, ...]]:
    """Mass (kg) and inertia about the body axes (kg m^2): least and greatest value of each.

    Raises AirframeError.
    """
    table = load(path).get("vehicle", {})
    rows = [table.get("mass_kg"), *(table.get("inertia_kg_m2") or [None] * 3)]
    for row in rows:
        numbers = isinstance(row, list) and all(isinstance(v, int | float) for v in row)
        if not numbers or len(row) != 2 or not 0.0 < row[0] <= row[1] < math.inf or len(rows) != 4:
            expected = "mass_kg: [least, greatest]; inertia_kg_m2: three of these"
            raise AirframeError(f"{path}: [vehicle] expected {expected}; got {row!r}")
    mass, *inertia = ((float(low), float(high)) for low, high in rows)
    return mass, tuple(inertia)


def load(path: Path) -> dict[str, Any]:
    """The tables of an airframe TOML. Raises AirframeError when it cannot be read."""
    try:
        return input_file.toml(input_file.text(path, MOST_BYTES))
    except OSError as error:
        raise AirframeError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise AirframeError(f"{path}: expected UTF-8 text ({error.reason})") from error
    except TomlError as error:
        where = path if error.line is None else f"{path}:{error.line}"
        raise AirframeError(f"{where}: {error}") from error
