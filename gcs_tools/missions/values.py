"""The values that a flight is flown with, each with where it came from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from fcu.interface.airframe import PINNED
from fcu.interface.files.toml_lines import KeyPath
from fcu.interface.parameter import default
from gcs_tools.missions.mission import Mission, Value
from sitl_plant.physics.truth import truth


def values_in_force(mission: Mission) -> dict[str, Value]:
    """Dotted key -> Value, of `airframe`, [flight], [law], [wind], [plant]; without keys that have no value.

    Of [vehicle.params] those that were chosen.
    """
    law = () if mission.controller else ("law",)  # it knows nothing of ours
    underneath = {**_of_law(mission), **_true(mission)}
    found = {"airframe": Value(mission.airframe.source, _origin(mission, ("airframe",)))}
    for table in ("flight", *law, "wind", "plant"):
        for path, value in _leaves((table,), getattr(mission, table)):
            own = Value(value, _origin(mission, path))
            used = underneath.get(path) if value is None else own
            if used is not None and used.value not in (None, ()):
                found[".".join(map(str, path))] = Value(_plain(used.value), used.origin)
    for name, value in mission.parameters.items():
        found[f"vehicle.params.{name}"] = Value(
            value, _origin(mission, ("vehicle", "params", name))
        )
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


def _of_law(mission: Mission) -> dict[KeyPath, Value]:
    """The defaults of the law's parameters."""
    found: dict[KeyPath, Value] = {("law", "module"): Value(mission.flown.name, "default")}
    tables, settings = mission.airframe.tables, mission.flown.settings
    file = mission.airframe.path.name
    instead = settings.printed(mission.given.get("law", {}), tables)
    for row in settings.PARAMETERS:
        if row.key:
            of_file = row.default is None or row.key in tables[PINNED]
            value = instead.get(row.key, default(row, tables))
            origin = file if of_file and row.key not in instead else "default"
            found["law", *row.key.split(".")] = Value(value, origin)
    return found


def _true(mission: Mission) -> dict[KeyPath, Value]:
    true = truth(mission.airframe)
    given: dict[KeyPath, Value] = {
        ("plant", name): Value(v, true.origins["vehicle", name]) for name, v in true.vehicle.items()
    }
    given["plant", "rotor_lag_s"] = Value(true.rotors["lag_s"], true.origins["rotors", "lag_s"])
    return given


def _plain(value: Any) -> Any:
    """Lists and dicts in place of tuples and tables."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", by_alias=True, exclude_none=True)
    return [_plain(item) for item in value] if isinstance(value, tuple | list) else value
