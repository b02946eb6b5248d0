"""A mission file: TOML, validated, every refusal with its line, its key and what was expected."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from fcu.configuration import OCTO
from fcu.interface.airframe import load as load_airframe
from fcu.law.parameters import BOUNDS, DEFAULTS, PRINTED_BOUNDS
from gcs_tools.locate import explain
from gcs_tools.mission_schema import MissionFile

SHIPPED = (
    Path(__file__).resolve().parent / "missions",  # in a wheel
    Path(__file__).resolve().parents[1] / "missions",  # in a checkout
)


class MissionError(ValueError):
    """A mission that cannot be flown: file, line, key, what was expected."""


class Value(NamedTuple):
    """A value in force, and where it came from: default, octo.toml, mission or --set."""

    value: Any
    origin: str


class Mission:
    """A valid mission: its tables, its name, and where each value came from."""

    def __init__(self, name: str, source: str, tables: dict[str, Any], text: str = "") -> None:
        """Raises MissionError."""
        self.name = name
        self._source = source
        self._tables = tables
        self._text = text
        self._set: set[str] = set()
        try:
            self._file = MissionFile.model_validate(tables)
        except ValidationError as error:
            raise MissionError(explain(error, source, text, MissionFile)) from None
        self.title = self._file.title
        self.flight = self._file.flight
        self.law = self._file.law
        self.wind = self._file.wind
        self.plant = self._file.plant

    def expectations(self) -> dict[str, Any]:
        """The `[expect]` table: metric -> limit, or a table of limit and window."""
        return self._file.expect.model_dump(exclude_none=True, by_alias=True)

    def values_in_force(self) -> dict[str, Value]:
        """Dotted name -> value and origin, of everything that was flown."""
        found: dict[str, Value] = {}
        octo = load_airframe(OCTO)
        for table in ("rotors", "limits"):
            for key, value in octo[table].items():
                found[f"airframe.{table}.{key}"] = Value(value, "octo.toml")
        printed = self.law.prediction == "demanded"
        defaults = {
            **{f"law.{k}": v for k, v in DEFAULTS.items()},
            **{f"law.bounds.{k}": v for k, v in (PRINTED_BOUNDS if printed else BOUNDS).items()},
        }
        found.update({k: Value(v, "default") for k, v in defaults.items()})
        dumped = self._file.model_dump(exclude_none=True, by_alias=True)
        given = dict(flatten(self._tables))
        for table in ("flight", "law", "wind", "plant"):
            for key, value in flatten({table: dumped[table]}):
                if key in given or key not in found:
                    origin = "mission" if key in given else "default"
                    found[key] = Value(value, "--set" if self._is_set(key) else origin)
        return found

    def _is_set(self, key: str) -> bool:
        return any(key == name or key.startswith(f"{name}.") for name in self._set)

    def changed(self, key: str, value: Any) -> Mission:
        """This mission with one value replaced. Raises MissionError."""
        tables = _copied(self._tables)
        *path, last = key.split(".")
        at = tables
        for name in path:
            at = at.setdefault(name, {})
            if not isinstance(at, dict):
                raise MissionError(f"--set {key}: {name} is a value, not a table")
        at[last] = value
        changed = Mission(self.name, f"--set {key}", tables)
        changed._source, changed._text = self._source, self._text
        changed._set = {*self._set, key}
        return changed


def _copied(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _copied(v) for k, v in value.items()}
    return [_copied(v) for v in value] if isinstance(value, list) else value


def flatten(table: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Dotted name and value of every leaf of nested tables; arrays are leaves."""
    found: list[tuple[str, Any]] = []
    for key, value in table.items():
        name = f"{prefix}{key}"
        found += flatten(value, f"{name}.") if isinstance(value, dict) else [(name, value)]
    return found


def shipped() -> dict[str, Path]:
    """Name -> file of the missions that come with the package."""
    folders = [f for f in SHIPPED if f.is_dir()]
    return {p.stem: p for f in folders for p in sorted(f.glob("*.toml"))}


def load(name: str) -> Mission:
    """A mission by path, or by the name of a shipped one. Raises MissionError."""
    path = Path(name)
    if not path.suffix and not path.exists():
        known = shipped()
        if name not in known:
            raise MissionError(f"{name}: no such mission; shipped are {', '.join(sorted(known))}")
        path = known[name]
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise MissionError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise MissionError(f"{path}: not UTF-8 text (byte {error.start})") from None
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise MissionError(f"{path}: not TOML: {error}") from None
    return Mission(path.stem, str(path), tables, text)


def override(mission: Mission, setting: str) -> Mission:
    """`mission` with TABLE.KEY=VALUE applied. Raises MissionError.

    VALUE is read as TOML; what is not TOML is a word (`law.prediction=achieved`).
    """
    key, equals, text = setting.partition("=")
    key = key.strip()
    if not equals or "." not in key or not all(key.split(".")):
        raise MissionError(f"--set {setting}: expected TABLE.KEY=VALUE")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    return mission.changed(key, value)


