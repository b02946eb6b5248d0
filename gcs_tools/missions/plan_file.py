"""Plans in files: QGroundControl's .plan (JSON) and the .waypoints text of MAVProxy and others.

A file becomes the items that a ground station uploads for it: the mission, the fence and the rally
points. A complex item of QGroundControl (a survey) is flown by the simple items that it holds.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fcu.interface.files import input_file, toml_file
from fcu.interface.files.toml_file import FileError
from fcu.mavlink.plan_messages import PlanItem, item_of

SUFFIXES = (".plan", ".waypoints")
MOST_BYTES = 8 * input_file.MIB
MOST_ITEMS = 2000
HEADER, VERSION = "QGC WPL", "110"
WAYPOINT, LAND, RETURN, TAKEOFF, JUMP, SPEED = 16, 21, 20, 22, 177, 178
_WAITS = {16, 19, 93, 112}  # items whose parameter 1 is a time, s
_GLOBAL, _GLOBAL_INT = 0, 5
_IN, _OUT, _DISC_IN, _DISC_OUT, _RALLY = 5001, 5002, 5003, 5004, 5100
_AIMED = 195  # DO_SET_ROI_LOCATION: a place that is faced
_PLACED = {16, 17, 18, 19, 21, 22, 31, _AIMED}
PLAN_VERSION, MISSION_VERSION = 1, 2  # of QGroundControl, which reads no other
_LEVELS = 20  # of complex items inside one another
_MOST = 1e9  # of any number, as in mission files
_DIGITS = 20  # of a whole number that may be meant; Python reads no more than 4300
_LEADING = 92  # MAV_CMD up to NAV_GUIDED_ENABLE; the next, NAV_DELAY, waits
_BOUND = f"expected a number from {-_MOST:g} to {_MOST:g}"


class PlanError(input_file.PlainError):
    """A plan file that cannot be read: where, and why."""


@dataclass(frozen=True)
class Home:
    """The place at which a plan is meant to begin."""

    lat_deg: float
    lon_deg: float
    alt_m: float | None  # above the sea; None: the file does not say


@dataclass(frozen=True)
class PlanFile:
    """All that a ground station uploads for a file."""

    mission: tuple[PlanItem, ...]
    fence: tuple[PlanItem, ...]
    rally: tuple[PlanItem, ...]
    home: Home | None

    @property
    def leads(self) -> bool:
        """Tell whether an item of it leads the vehicle: without one it would never leave the ground."""
        return any(item.command <= _LEADING for item in self.mission)

    @property
    def lands(self) -> bool:
        """Tell whether the plan ends on the ground."""
        end = self.returns
        if end is not None:
            return True
        flown = [item.command for item in self.mission if item.command < 100]
        return bool(flown) and flown[-1] == LAND

    @property
    def returns(self) -> int | None:
        """The number of the return that ends the plan: items behind it are not flown. None: no return, or jumps over it."""
        first = next((n for n, item in enumerate(self.mission) if item.command == RETURN), None)
        if first is None:
            return None
        jumps = (item for item in self.mission[:first] if item.command == JUMP)
        return None if any(item.params[0] > first for item in jumps) else first

    def places(self) -> Iterator[tuple[int, float, float, float, int]]:
        """Of each item of the mission with a place: its number, latitude, longitude, height, frame."""
        for number, item in enumerate(self.mission):
            if item.command in _PLACED and (item.x, item.y) != (0, 0) and item.x < 2**31 - 1:
                yield number, item.x * 1e-7, item.y * 1e-7, item.z, item.frame

    def flown_to(self) -> frozenset[int]:
        """The numbers of items to whose place the vehicle flies."""
        return frozenset(n for n, *_ in self.places() if self.mission[n].command != _AIMED)

    @property
    def begin(self) -> Home:
        """The place where the vehicle is to stand: home, or below the first place. Raises PlanError."""
        if self.home is not None:
            return self.home
        for _, lat, lon, _, _ in self.places():
            return Home(lat, lon, None)
        raise PlanError("no item has a place")

    @property
    def reach_m(self) -> float:
        """The distance from its begin to which it leads at most, m."""
        home = self.begin
        return max((_apart(home, lat, lon) for _, lat, lon, _, _ in self.places()), default=0.0)

    @property
    def most_s(self) -> float:
        """A time in which a vehicle has flown it, without jumps back, s: far more than it takes."""
        home, way = self.begin, 0.0
        lat_0, lon_0, z_0 = home.lat_deg, home.lon_deg, 0.0
        for _, lat, lon, z, _ in self.places():
            way += _apart(Home(lat_0, lon_0, None), lat, lon) + min(abs(z - z_0), 1000.0)
            lat_0, lon_0, z_0 = lat, lon, z
        way += _apart(home, lat_0, lon_0)
        again = 1 + sum(max(0.0, item.params[1]) for item in self.mission if item.command == JUMP)
        slowest = min(
            (
                item.params[1]
                for item in self.mission
                if item.command == SPEED and item.params[1] > 0
            ),
            default=2.0,
        )
        holds = sum(max(0.0, item.params[0]) for item in self.mission if item.command in _WAITS)
        return (
            way / min(2.0, max(slowest, 1e-3)) + holds + 8.0 * len(self.mission)
        ) * again + 120.0


def _apart(home: Home, lat: float, lon: float) -> float:
    north = math.radians(lat - home.lat_deg) * 6_371_000.0
    east = math.radians(lon - home.lon_deg) * 6_371_000.0 * math.cos(math.radians(lat))
    return math.hypot(north, east)


def is_plan(name: str | Path) -> bool:
    """Tell whether a name is that of a plan file."""
    return str(name).endswith(SUFFIXES)


def looks_like_one(text: str) -> bool:
    """Tell whether a text, whatever the name of its file, is that of a plan."""
    return text.startswith(HEADER) or '"fileType": "Plan"' in text[:10_000]


def read(path: Path) -> PlanFile:
    """The items of a file. Raises PlanError, with what is wrong and where.

    A byte order mark at its begin, as editors on Windows write it, is passed over.
    """
    try:
        text = toml_file.text_of(path, MOST_BYTES).removeprefix(input_file.MARK)
    except FileError as error:
        raise PlanError(str(error)) from error
    try:
        return _waypoints(text) if text.startswith(HEADER) else _plan(text)
    except PlanError as error:
        raise PlanError(f"{path}{error}") from None


# --- .waypoints


def _waypoints(text: str) -> PlanFile:
    """Lines of twelve numbers behind a header. An absolute waypoint with number 0 is home, as MAVProxy has it."""
    items: list[PlanItem] = []
    home: Home | None = None
    dropped = 0
    version = text.partition("\n")[0].removeprefix(HEADER).strip()
    if version != VERSION:
        raise PlanError(f":1: expected {HEADER} {VERSION}, got version {version[:20] or 'none'}")
    for number, line in enumerate(text.splitlines(), start=1):
        if number == 1 or not line.strip() or line.startswith("#"):
            continue
        cells = line.split()
        if len(cells) != 12:
            raise PlanError(f":{number}: expected 12 numbers, got {len(cells)}")
        try:
            cells_f = [float(cell) for cell in cells]
        except ValueError:
            raise PlanError(f":{number}: expected 12 numbers") from None
        for column, value in enumerate(cells_f, start=1):
            if abs(value) > _MOST:
                raise PlanError(f":{number}: {_BOUND} in column {column}")
        whole = (cells_f[0], cells_f[2], cells_f[3], cells_f[11])
        if not all(value == value and abs(value) < 1e6 and value == int(value) for value in whole):
            raise PlanError(f":{number}: expected whole numbers in columns 1, 3, 4 and 12")
        sequence, frame, command = int(cells_f[0]), int(cells_f[2]), int(cells_f[3])
        if sequence != len(items) + dropped:
            raise PlanError(f":{number}: expected item {len(items) + dropped}, got {sequence}")
        if sequence == 0 and command == WAYPOINT and frame == _GLOBAL:
            lat, lon, alt = cells_f[8:11]
            if not all(map(math.isfinite, (lat, lon, alt))):
                raise PlanError(f":{number}: expected a place of home")
            home, dropped = Home(lat, lon, alt), 1
            continue
        params = cells_f[4:11]
        if command == JUMP:
            params[0] -= dropped
        items.append(item_of(frame, command, tuple(params), cells_f[11] != 0.0))
        _check_total(items, f":{number}")
    if not items:
        raise PlanError(": expected items, got none")
    return PlanFile(tuple(items), (), (), home)


def _check_total(items: list[PlanItem], where: str) -> None:
    if len(items) > MOST_ITEMS:
        raise PlanError(f"{where}: more than {MOST_ITEMS} items")


# --- .plan


def _plan(text: str) -> PlanFile:
    try:
        tables = json.loads(text, parse_int=_whole)
    except (ValueError, RecursionError) as error:
        line = f":{error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        what = error.msg if isinstance(error, json.JSONDecodeError) else "too deep"
        raise PlanError(
            f"{line}: expected JSON of QGroundControl, or {HEADER} {VERSION}: {what}"
        ) from None
    if not isinstance(tables, dict) or tables.get("fileType") != "Plan":
        raise PlanError(': expected a plan of QGroundControl ("fileType": "Plan")')
    _check_version(tables, PLAN_VERSION, "")
    mission = _table(tables, "mission", "")
    _check_version(mission, MISSION_VERSION, ".mission")
    entries = list(_simple(_list(mission, "items", ".mission"), ".mission.items", 0))
    numbers: dict[float, int] = {}  # of items, by the number that a jump names
    for i, (where, entry) in enumerate(entries):
        if "doJumpId" in entry:
            number = entry["doJumpId"]
            if not _is_number(number) or number != int(number):
                raise PlanError(f": {where}.doJumpId: expected a whole number")
            numbers.setdefault(float(number), i)
    items = []
    for where, entry in entries:
        items.append(_item(entry, where, numbers))
        _check_total(items, where)
    if not items:
        raise PlanError(": .mission.items: expected items, got none")
    return PlanFile(
        tuple(items),
        tuple(_fence(tables["geoFence"])) if "geoFence" in tables else (),
        tuple(_rally(tables["rallyPoints"])) if "rallyPoints" in tables else (),
        _home(mission),
    )


def _check_version(table: dict[str, Any], expected: int, where: str) -> None:
    version = table.get("version", expected)
    if version != expected:
        raise PlanError(f": {where}.version: expected {expected}, got {json.dumps(version)[:40]}")


def _whole(digits: str) -> int | float:
    """A whole number of JSON, of any length: a long one is told as too large, with its place."""
    return int(digits) if len(digits) <= _DIGITS else float(digits)


def _table(of: Any, key: str, where: str) -> dict[str, Any]:
    found = of.get(key) if isinstance(of, dict) else None
    if not isinstance(found, dict):
        raise PlanError(f": {where}.{key}: expected a table")
    return found


def _list(of: Any, key: str, where: str) -> list[Any]:
    found = of.get(key, []) if isinstance(of, dict) else None
    if not isinstance(found, list):
        raise PlanError(f": {where}.{key}: expected a list")
    return found


def _numbers(value: Any, total: int, where: str, null: bool = False) -> tuple[float, ...]:
    """So many numbers. `null`: one may be left out, and is NaN."""
    if not isinstance(value, list) or len(value) != total:
        raise PlanError(f": {where}: expected {total} numbers")
    for n, each in enumerate(value):
        if isinstance(each, int | float) and abs(each) > _MOST:
            raise PlanError(f": {where}[{n}]: {_BOUND}")
        if not _is_number(each) and not (null and each is None):
            raise PlanError(f": {where}: expected {total} numbers")
    return tuple(math.nan if each is None else float(each) for each in value)


def _is_number(value: Any) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and abs(value) <= _MOST  # which NaN is not


def _simple(items: list[Any], where: str, level: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """The simple items of a list, and of the complex ones in it, each with where it stands."""
    if level > _LEVELS:
        raise PlanError(f": {where}: complex items too deep in one another")
    for n, entry in enumerate(items):
        here = f"{where}[{n}]"
        if not isinstance(entry, dict):
            raise PlanError(f": {here}: expected a table")
        if entry.get("type") == "SimpleItem":
            yield here, entry
            continue
        if entry.get("type") != "ComplexItem":
            raise PlanError(f": {here}.type: expected SimpleItem or ComplexItem")
        inside = entry.get("TransectStyleComplexItem", entry)
        held = inside.get("Items") if isinstance(inside, dict) else None
        if not isinstance(held, list):
            kind = str(entry.get("complexItemType"))[:40]
            raise PlanError(f": {here}: a complex item ({kind!a}) without the items it is flown by")
        yield from _simple(held, f"{here}.Items", level + 1)


def _item(entry: dict[str, Any], where: str, numbers: dict[float, int]) -> PlanItem:
    frame, command = entry.get("frame"), entry.get("command")
    for name, value, most in (("frame", frame, 255), ("command", command, 65535)):
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
            raise PlanError(f": {where}.{name}: expected a whole number, 0 to {most}")
    assert isinstance(frame, int) and isinstance(command, int)
    params = list(_numbers(entry.get("params"), 7, f"{where}.params", null=True))
    if command == JUMP:
        to = numbers.get(params[0])
        if to is None:
            raise PlanError(f": {where}.params[0]: expected the doJumpId of an item")
        params[0] = float(to)
    auto = entry.get("autoContinue", True)
    if not isinstance(auto, bool):
        raise PlanError(f": {where}.autoContinue: expected true or false")
    return item_of(frame, command, tuple(params), auto)


def _home(mission: dict[str, Any]) -> Home | None:
    if "plannedHomePosition" not in mission:
        return None
    where = ".mission.plannedHomePosition"
    given = mission["plannedHomePosition"]
    if isinstance(given, list) and len(given) == 3 and given[2] is None:
        lat, lon = _numbers(given[:2], 2, where)
        return Home(lat, lon, None)
    lat, lon, alt = _numbers(given, 3, where)
    return Home(lat, lon, alt)


def _fence(fence: Any) -> Iterator[PlanItem]:
    for n, area in enumerate(_list(fence, "polygons", ".geoFence")):
        where = f".geoFence.polygons[{n}]"
        corners = _list(area, "polygon", where)
        if len(corners) < 3:
            raise PlanError(f": {where}.polygon: expected 3 corners or more, got {len(corners)}")
        for corner in corners:
            lat, lon = _numbers(corner, 2, f"{where}.polygon")
            command = _IN if _inclusion(area, where) else _OUT
            params = (float(len(corners)), 0.0, 0.0, 0.0, lat, lon, 0.0)
            yield item_of(_GLOBAL, command, params)
    for n, area in enumerate(_list(fence, "circles", ".geoFence")):
        where = f".geoFence.circles[{n}]"
        circle = _table(area, "circle", where)
        lat, lon = _numbers(circle.get("center"), 2, f"{where}.circle.center")
        (radius,) = _numbers([circle.get("radius")], 1, f"{where}.circle.radius")
        command = _DISC_IN if _inclusion(area, where) else _DISC_OUT
        yield item_of(_GLOBAL, command, (radius, 0.0, 0.0, 0.0, lat, lon, 0.0))


def _inclusion(area: Any, where: str) -> bool:
    found = area.get("inclusion")
    if not isinstance(found, bool):
        raise PlanError(f": {where}.inclusion: expected true or false")
    return found


def _rally(rally: Any) -> Iterator[PlanItem]:
    for n, point in enumerate(_list(rally, "points", ".rallyPoints")):
        lat, lon, alt = _numbers(point, 3, f".rallyPoints.points[{n}]")
        yield item_of(3, _RALLY, (0.0, 0.0, 0.0, 0.0, lat, lon, alt))
