"""What an airframe is, to the controller that flies it and to the plant that stands in for it.

The schema is shared, the values never: the controller reads what it believes from a file of
`fcu/airframes/`, the plant what is true from one of `sitl_plant/airframes/`.
Frame: body Forward-Left-Up, origin at the centre of mass, every rotor pushing along +z.
docs/airframes.md describes the file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.files import input_file, toml_file
from fcu.interface.files.spelling import suggestion_or_list
from fcu.interface.files.toml_file import FileError, TomlFile
from fcu.interface.files.toml_lines import KeyPath
from fcu.interface.files.toml_lines import lines as toml_lines
from fcu.kernel.algebra import Rotors, Vec3

ROTORS = len(Rotors._fields)  # columns of every row; an airframe may have fewer rotors
FEWEST = 4  # rotors
G = 9.81  # m/s^2, of the paper: what laws believe and the plant's is
STANDARD_GRAVITY = 9.80665  # m/s^2, of PX4: what its parameters of tilt and acceleration mean
HOVERS = 1.2  # full thrust over the greatest believed weight, at least
APART = 1e-3  # least singular value of what the rotors do over the greatest, each axis scaled to 1
LEAST_SHARE = 0.02  # of the load of the most loaded rotor in hover


class Airframe(NamedTuple):
    """Four to eight rotors. SI units, angles in rad.

    A rotor that is absent has nought in every column: the last ones, where there are fewer than eight.
    """

    x: Rotors  # rotor positions forward of the centre of mass, m
    y: Rotors  # left of it, m
    z: Rotors  # above it, m: for pictures, thrust is along z
    spin: Rotors  # +1 counter-clockwise from above (about +z body), -1 clockwise, 0 absent
    c_T: Rotors  # thrust over rotor speed squared, N/(rad/s)^2
    k_Q: float  # drag torque over thrust, m
    Omega_max: Rotors  # full rotor speed, rad/s
    rotor_lag: float  # first-order lag of rotor speed, s; may be zero
    J_m: float  # inertia of one rotor about its axis, kg m^2

    @property
    def n(self) -> int:
        """How many rotors there are."""
        return sum(spin != 0.0 for spin in self.spin)


Interval = tuple[float, float]  # least, greatest


class AirframeError(input_file.PlainError):
    """An airframe that cannot be flown: file, line if known, table, key, what was expected and got."""

    def __init__(self, said: str, at: KeyPath = ()) -> None:
        """`said` begins with the file; `at`: where in it."""
        super().__init__(said)
        self.at = at


# --- one table


def wrong(source: str, table: str, key: str, expected: str, got: Any) -> AirframeError:
    """An error to raise of the value of a key."""
    said = f"{source}: [{table}] {key}: expected {expected}, got {input_file.shown(got)}"
    return AirframeError(said, (table, key))


def missing(source: str, table: str, key: str, instead: str = "") -> AirframeError:
    """An error to raise of a key that has to be there."""
    return AirframeError(f"{source}: [{table}] {key} is missing{instead}", (table,))


def is_number(value: Any, low: float, high: float) -> bool:
    """Whether a value of a file is a number in a range; NaN is none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high


# The ranges are those of vehicles that somebody could carry, or be carried by.
_ONE = {  # key of [rotors] -> field, range, unit
    "torque_to_thrust_m": ("k_Q", 1e-6, 1.0, "m"),
    "lag_s": ("rotor_lag", 0.0, 1.0, "s"),
    "inertia_kg_m2": ("J_m", 0.0, 1.0, "kg m^2"),
}
_EACH = {  # the same, of one number, or one a rotor
    "thrust_coefficient": ("c_T", 1e-12, 1.0, "N/(rad/s)^2"),
    "full_speed_rad_s": ("Omega_max", 1.0, 1e5, "rad/s"),
}
_PLACED, _ARMS = ("position_m",), ("angle_deg", "radius_m")
_FARTHEST = 20.0  # m, of a rotor


def airframe(table: Mapping[str, Any], source: str = "airframe") -> Airframe:
    """Build an Airframe from the `[rotors]` table of an airframe TOML.

    Raises AirframeError naming `source` and the key, when one is missing or out of range, and when
    the rotors give no torque about an axis or cannot carry the vehicle level.
    """

    def bad(key: str, expected: str, got: Any) -> AirframeError:
        return wrong(source, "rotors", key, expected, got)

    places = "position_m" in table
    for key in ("spin", *(_PLACED if places else _ARMS), *_EACH, *_ONE):
        if key not in table:
            instead = ", or position_m in its place" if key == "angle_deg" else ""
            raise missing(source, "rotors", key, instead)
    if places and (also := [key for key in _ARMS if key in table]):
        said = "expected either position_m, or angle_deg and radius_m, got both"
        raise AirframeError(f"{source}: [rotors] {also[0]}: {said}", ("rotors", also[0]))
    spins = table["spin"]
    if not isinstance(spins, list) or not FEWEST <= len(spins) <= ROTORS:
        raise bad("spin", f"{FEWEST} to {ROTORS} numbers, one a rotor", spins)
    if not all(is_number(spin, -1, 1) and abs(spin) == 1 for spin in spins):
        raise bad("spin", "1 (counter-clockwise from above) or -1 (clockwise) each", spins)
    n = len(spins)

    def several(key: str, low: float, high: float, unit: str) -> list[float]:
        row = table[key]
        row = row if isinstance(row, list) else [row] * n
        if len(row) != n or not all(is_number(v, low, high) for v in row):
            each = f"a number from {low:g} to {high:g} {unit}, or {n} of them, one a rotor"
            raise bad(key, each, table[key])
        return [float(v) for v in row]

    if places:
        points = table["position_m"]
        if not isinstance(points, list) or len(points) != n:
            raise bad("position_m", f"{n} places [x, y] or [x, y, z], one a rotor", points)
        for point in points:
            fits = isinstance(point, list) and len(point) in (2, 3)
            if not fits or not all(is_number(v, -_FARTHEST, _FARTHEST) for v in point):
                span = f"-{_FARTHEST:g} to {_FARTHEST:g} m"
                raise bad("position_m", f"[x, y] or [x, y, z], each from {span}", point)
        x, y, z = ([float((*point, 0.0)[i]) for point in points] for i in range(3))
    else:
        angles, radius = table["angle_deg"], table["radius_m"]
        fits = isinstance(angles, list) and len(angles) == n
        if not fits or not all(is_number(a, -360.0, 360.0) for a in angles):
            raise bad("angle_deg", f"{n} numbers from -360 to 360, one a rotor", angles)
        if not is_number(radius, 1e-3, _FARTHEST):
            raise bad("radius_m", f"a number from 0.001 to {_FARTHEST:g} m", radius)
        x = [radius * math.cos(math.radians(a)) for a in angles]
        y = [radius * math.sin(math.radians(a)) for a in angles]
        z = [0.0] * n
    for key, (_, low, high, unit) in _ONE.items():
        if not is_number(table[key], low, high):
            raise bad(key, f"a number from {low:g} to {high:g} {unit}", table[key])
    rows: dict[str, Any] = {
        field: _rotors(several(key, low, high, unit))
        for key, (field, low, high, unit) in _EACH.items()
    }
    numbers: dict[str, Any] = {field: float(table[key]) for key, (field, *_) in _ONE.items()}
    made = Airframe(
        x=_rotors(x),
        y=_rotors(y),
        z=_rotors(z),
        spin=_rotors([float(spin) for spin in spins]),
        **rows,
        **numbers,
    )
    _check_axes(made, source)
    shares(made, source)
    return made


def _rotors(row: list[float]) -> Rotors:
    return Rotors(*row, *[0.0] * (ROTORS - len(row)))


# --- what the rotors do together


def effect(of: Airframe) -> np.ndarray[Any, np.dtype[np.float64]]:
    """float64[4, n]: total thrust (N) and torque (N m, B) of one newton of each rotor there is."""
    there = np.array(of.spin) != 0.0
    x, y, spin = (np.array(row)[there] for row in (of.x, of.y, of.spin))
    return np.stack([np.ones(len(spin)), y, -x, -of.k_Q * spin])


def _check_axes(of: Airframe, source: str) -> None:
    """Raise AirframeError for rotors that do not give thrust and torque about each axis apart."""
    what = effect(of)
    rows = what / np.maximum(np.abs(what).max(axis=1, keepdims=True), 1e-12)
    sizes = np.linalg.svd(rows, compute_uv=False)
    if sizes[-1] >= APART * sizes[0]:
        return

    def rank(matrix: Any) -> int:
        return int(np.linalg.matrix_rank(matrix, tol=APART * sizes[0]))

    names = ("thrust", "torque about roll", "torque about pitch", "torque about yaw")
    bound = [name for i, name in enumerate(names) if rank(np.delete(rows, i, 0)) == rank(rows)]
    fault = (
        f"these give no {bound[0]}"
        if len(bound) == 1
        else f"here {' and '.join(bound)} go together"
    )
    raise AirframeError(
        f"{source}: [rotors] cannot be flown: expected rotors that give thrust and torque about roll,"
        f" pitch and yaw each apart from the others; {fault}",
        ("rotors",),
    )


def even_hover(
    effect: np.ndarray[Any, np.dtype[np.float64]], full: np.ndarray[Any, np.dtype[np.float64]]
) -> np.ndarray[Any, np.dtype[np.float64]]:
    """float64[n]: the rotors' thrusts (N) in a hover of one newton without torque, or the nearest to it.

    effect : float64[4, n], as `effect` gives it, or without yaw its first three rows.  full : float64[n],
    full thrusts, N. Where the choice is free, the loads (thrust over full thrust) are as equal as they can be.
    """
    loads = effect * full  # of a load of 1 each
    even = np.full(len(full), 1.0 / full.sum())
    lacking = np.eye(len(loads))[0] - loads @ even
    thrusts: np.ndarray[Any, np.dtype[np.float64]] = full * (even + np.linalg.pinv(loads) @ lacking)
    return thrusts


def shares(of: Airframe, source: str = "airframe") -> Rotors:
    """Each rotor's share of a hover without torque, over the greatest share; 0 of an absent rotor.

    Exactly 1 of every rotor of a symmetric vehicle. Where the choice is free, the loads (thrust over
    full thrust) are as equal as they can be. Raises AirframeError if a rotor would have to pull down.
    """
    each = even_hover(effect(of), np.array(of.c_T)[: of.n] * np.array(of.Omega_max)[: of.n] ** 2)
    share = each / each.max()
    if share.min() < LEAST_SHARE:
        raise AirframeError(
            f"{source}: [rotors] cannot be flown: rotor {int(share.argmin()) + 1} would carry nothing"
            " of a level hover; expected rotors around the centre of mass, as many clockwise as"
            " counter-clockwise by their thrust",
            ("rotors",),
        )
    share[share > 1.0 - 1e-9] = 1.0
    return _rotors(share.tolist())


def full_thrust(of: Airframe) -> float:
    """Greatest total thrust (N) of a level hover: until the rotor that is nearest to it is at full speed."""
    share = np.array(shares(of))[: of.n]
    full = np.array(of.c_T)[: of.n] * np.array(of.Omega_max)[: of.n] ** 2
    return float(share.sum() * (full / share).min())


# --- the file

HERE = Path(__file__).resolve().parents[1] / "airframes"
OCTO = HERE / "s1000.toml"
SHIPPED = {file.stem: file for file in sorted(HERE.glob("*.toml"))}

KEYS: dict[str, tuple[str, ...]] = {  # by table
    "vehicle": ("mass_kg", "inertia_kg_m2"),
    "mavlink": ("type", "autostart"),
    "rotors": ("spin", *_PLACED, *_ARMS, *_EACH, *_ONE),
    "limits": ("thrust_min_n", "thrust_max_n", "tilt_max_deg"),
    "air": ("drag",),
    "battery": ("cells", "capacity_mah"),
}
LAW = "law"  # [law.NAME]: values of a law's parameters
PINNED = "pinned"  # and those of the law that is flown, among the tables that it reads
# By the number of rotors: MAV_TYPE (43: multirotor, 15: six or eight are 13 and 14), PX4's number.
_MAVLINK = {4: (2, 4001), 5: (43, 0), 6: (13, 6001), 7: (43, 0), 8: (14, 8001)}


def _span(low: float, high: float, unit: str) -> str:
    return f"from {low:g} to {high:g} {unit}".rstrip()


def number_in(source: str, table: Mapping[str, Any], name: str, key: str, *span: Any) -> float:
    """The number of a key. span : least, greatest, unit.  Raises AirframeError."""
    low, high, unit = span
    if key not in table:
        raise missing(source, name, key)
    if not is_number(table[key], low, high):
        raise wrong(source, name, key, f"a number {_span(low, high, unit)}", table[key])
    return float(table[key])


def body(tables: Mapping[str, Any], source: str) -> tuple[Interval, tuple[Interval, ...]]:
    """Mass (kg) and inertia about the body axes (kg m^2): least and greatest value of each.

    Raises AirframeError.
    """
    table = tables["vehicle"]
    for key in KEYS["vehicle"]:
        if key not in table:
            raise missing(source, "vehicle", key)

    def ends(row: Any, low: float, high: float) -> bool:
        two = isinstance(row, list) and len(row) == 2
        return two and all(is_number(v, low, high) for v in row) and row[0] <= row[1]

    mass, inertia = table["mass_kg"], table["inertia_kg_m2"]
    if not ends(mass, 1e-3, 1e4):
        expected = f"[least, greatest], each {_span(1e-3, 1e4, 'kg')}"
        raise wrong(source, "vehicle", "mass_kg", expected, mass)
    three = isinstance(inertia, list) and len(inertia) == 3
    if not three or not all(ends(row, 1e-9, 1e4) for row in inertia):
        expected = f"three of [least, greatest], each {_span(1e-9, 1e4, 'kg m^2')}"
        raise wrong(source, "vehicle", "inertia_kg_m2", expected, inertia)
    least, most = mass
    return (float(least), float(most)), tuple((float(a), float(b)) for a, b in inertia)


def drag(tables: Mapping[str, Any], source: str) -> Vec3:
    """Drag coefficients, N/(m/s)^2, body axes: the wind that is shown hangs on them.

    Raises AirframeError.
    """
    row = tables.get("air", {}).get("drag")
    three = isinstance(row, list) and len(row) == 3
    if not three or not all(is_number(c, 1e-9, 100.0) for c in row):
        raise wrong(source, "air", "drag", "three numbers above 0, up to 100 N/(m/s)^2", row)
    return Vec3(*[float(c) for c in row])


def checked(tables: dict[str, Any], source: str) -> tuple[Airframe, dict[str, Any]]:
    """The airframe of the tables of a file, and these with what follows by default.

    Raises AirframeError for what cannot be flown, and for a table or a key that there is none of.
    """
    for name, table in tables.items():
        if name != LAW and name not in KEYS:
            known = suggestion_or_list(name, (*KEYS, LAW))
            raise AirframeError(
                f"{source}: {input_file.shown(name)[1:-1]}: no such table{known}", (name,)
            )
        if not isinstance(table, dict):
            said = f"{source}: {name}: expected a table, got {input_file.shown(table)}"
            raise AirframeError(said, (name,))
        for key in table if name != LAW else ():
            if key not in KEYS[name]:
                known = suggestion_or_list(key, KEYS[name])
                said = f"{source}: [{name}] {input_file.shown(key)[1:-1]}: no such key{known}"
                raise AirframeError(said, (name, key))
    for name in ("vehicle", "rotors", "limits", "air", "battery"):
        if name not in tables:
            raise AirframeError(f"{source}: [{name}] is missing")
    made = airframe(tables["rotors"], source)
    (_, heaviest), _ = body(tables, source)
    drag(tables, source)
    limits, battery, mavlink = tables["limits"], tables["battery"], tables.get("mavlink", {})
    least = number_in(source, limits, "limits", "thrust_min_n", 0.0, 1e6, "N")
    most = number_in(source, limits, "limits", "thrust_max_n", 1e-3, 1e6, "N")
    number_in(source, limits, "limits", "tilt_max_deg", 1.0, 89.0, "deg")
    number_in(source, battery, "battery", "cells", 1, 100, "")
    number_in(source, battery, "battery", "capacity_mah", 1.0, 1e7, "mAh")
    kind, autostart = _MAVLINK[made.n]
    for key, high in (("type", 255), ("autostart", 9999999)):
        if key in mavlink and not (is_number(mavlink[key], 0, high) and mavlink[key] % 1 == 0):
            raise wrong(source, "mavlink", key, f"a whole number from 0 to {high}", mavlink[key])
    given = min(most, full_thrust(made))
    needed = HOVERS * heaviest * G
    if given < needed:
        whose = "[limits] thrust_max_n" if most < full_thrust(made) else "the rotors"
        raise AirframeError(
            f"{source}: cannot hover: {whose} give {given:.3g} N; expected {needed:.3g} N or more,"
            f" {HOVERS:g} times the weight of the {heaviest:g} kg of [vehicle] mass_kg",
            ("limits", "thrust_max_n") if most < full_thrust(made) else ("rotors",),
        )
    if least >= most:
        raise wrong(source, "limits", "thrust_min_n", f"less than thrust_max_n, {most:g} N", least)
    (lightest, _), _ = body(tables, source)
    if least >= lightest * G:
        weight = f"less than the weight of the {lightest:g} kg of [vehicle] mass_kg, {lightest * G:.3g} N"
        raise wrong(source, "limits", "thrust_min_n", weight, least)
    return made, {**tables, "mavlink": {"type": kind, "autostart": autostart, **mavlink}}


@dataclass(frozen=True)
class AirframeFile:
    """An airframe file that may be flown."""

    path: Path
    sha256: str  # of its text
    rotors: Airframe
    tables: Mapping[str, Any]  # with what follows by default
    text: str

    @property
    def name(self) -> str:
        """Of a shipped airframe, or of the file without its folder and suffix."""
        return self.path.name.removesuffix(".toml")

    @property
    def source(self) -> str:
        """By what it is found from anywhere: its name, or its whole path."""
        return self.name if self.path == SHIPPED.get(self.name) else str(self.path)

    @property
    def identity(self) -> str:
        """Its name and the first digits of the hash of its text."""
        return f"{self.name} {self.sha256[:16]}"

    @property
    def drag(self) -> Vec3:
        """Believed drag coefficients, N/(m/s)^2, body axes."""
        return drag(self.tables, str(self.path))

    @cached_property
    def lines(self) -> dict[KeyPath, int]:
        """Line of each table and key."""
        return toml_lines(self.text)


def find(name_or_file: str, folder: Path | None = None) -> Path:
    """The file of a shipped airframe, or a FILE.toml, relative to `folder` or the working directory.

    Raises AirframeError.
    """
    if name_or_file in SHIPPED:
        return SHIPPED[name_or_file]
    if not name_or_file.endswith(".toml"):
        known = suggestion_or_list(name_or_file, SHIPPED)
        raise AirframeError(
            f"{input_file.shown(name_or_file)[1:-1]}: no such airframe{known}"
            " (a file of yours ends with .toml)"
        )
    return ((folder or Path()) / name_or_file).absolute()


def read(path: Path = OCTO) -> AirframeFile:
    """An airframe file. Raises AirframeError, with the line where there is one."""
    file = _read(path)
    try:
        made, tables = checked(file.tables, str(path))
    except AirframeError as error:
        said = str(error).removeprefix(str(path))
        raise AirframeError(f"{file.where(*error.at)}{said}", error.at) from error
    return AirframeFile(path, file.sha256, made, tables, file.text)


def digest(path: Path) -> str:
    """The hash of the text of a file, in hex. Raises AirframeError."""
    return _read(path).sha256


def believed(path: Path = OCTO) -> tuple[Airframe, dict[str, Any]]:
    """The airframe the controller believes it flies, and all tables of its file.

    Raises AirframeError.
    """
    file = read(path)
    return file.rotors, dict(file.tables)


def believed_drag(path: Path = OCTO) -> Vec3:
    """Drag coefficients, N/(m/s)^2, body axes. Raises AirframeError."""
    return drag(believed(path)[1], str(path))


def believed_body(path: Path = OCTO) -> tuple[Interval, tuple[Interval, ...]]:
    """Mass (kg) and inertia about the body axes (kg m^2): least and greatest value of each.

    Raises AirframeError.
    """
    return body(believed(path)[1], str(path))


def load(path: Path) -> dict[str, Any]:
    """The tables of an airframe TOML. Raises AirframeError when it cannot be read."""
    return _read(path).tables


def _read(path: Path) -> TomlFile:
    try:
        return toml_file.read(path)
    except FileError as error:
        raise AirframeError(str(error)) from error
