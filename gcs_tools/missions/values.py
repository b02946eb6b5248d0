"""The values that a flight is flown with, each with where it came from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from fcu.interface.airframe import load
from fcu.laws.mmrac.parameters import BOUNDS, DEFAULTS, PRINTED_BOUNDS
from gcs_tools.missions.mission import Mission, Value
from gcs_tools.missions.toml_lines import KeyPath


def values_in_force(mission: Mission) -> dict[str, Value]:
    """Dotted key -> Value, of [flight], [law], [wind], [plant]; without keys that have no value."""
    underneath = {**_believed(), **_law_defaults(mission.law.prediction), **_true()}
    found = {}
    for table in ("flight", "law", "wind", "plant"):
        for path, value in _leaves((table,), getattr(mission, table)):
            origin = _origin(mission, path)
            if value is None:
                value, origin = underneath.get(path, Value(None, "default"))
            if value is not None and value != ():
                found[".".join(map(str, path))] = Value(_plain(value), origin)
    return found


def _leaves(path: KeyPath, table: BaseModel) -> Iterator[tuple[KeyPath, Any]]:
    for name in type(table).model_fields:
        value = getattr(table, name)
        if isinstance(value, BaseModel):
            yield from _leaves((*path, name), value)
        else:
            yield (*path, name), value


def _origin(mission: Mission, path: KeyPath) -> str:
    for length in range(len(path), 0, -1):
        if path[:length] in mission.changed:
            return mission.changed[path[:length]]
    table: Any = mission.given
    for name in path:
        if not isinstance(table, Mapping) or name not in table:
            return "default"
        table = table[name]
    return "mission"


def _law_defaults(prediction: str | None) -> dict[KeyPath, Value]:
    demanded = (prediction or DEFAULTS["prediction"]) == "demanded"
    bounds = PRINTED_BOUNDS if demanded else BOUNDS
    return {
        **{("law", name): Value(value, "default") for name, value in DEFAULTS.items()},
        **{("law", "bounds", name): Value(value, "default") for name, value in bounds.items()},
    }


def _believed() -> dict[KeyPath, Value]:
    tables = load(Path(str(files("fcu") / "airframes" / "s1000.toml")))
    given = {**tables["limits"], "rotor_lag_s": tables["rotors"]["lag_s"]}
    return {("law", name): Value(value, "s1000.toml") for name, value in given.items()}


def _true() -> dict[KeyPath, Value]:
    tables = load(Path(str(files("sitl_plant") / "truth.toml")))
    given = {("plant", name): Value(v, "truth.toml") for name, v in tables["vehicle"].items()}
    believed = _believed()[("law", "rotor_lag_s")]
    lag = tables["rotors"].get("lag_s")
    given["plant", "rotor_lag_s"] = believed if lag is None else Value(lag, "truth.toml")
    return given  # type: ignore[return-value]


def _plain(value: Any) -> Any:
    """Lists and dicts in place of tuples and tables."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", by_alias=True, exclude_none=True)
    return [_plain(item) for item in value] if isinstance(value, tuple | list) else value
