"""Once a law, `fcu.laws.seam` imports this module: what law and guard are told, and their table.

Constant in flight. A changed value is a new Settings.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from fcu.interface.airframe import Airframe
from fcu.interface.parameter import Conversion, Parameter, Part, Value, flat
from fcu.laws import parameters as of_law
from fcu.laws.face import Pace

from .flown import guard, law

Params = law.Params
GuardParams = guard.GuardParams


class Settings(NamedTuple):
    """Parameters of the law, and of the guard around it."""

    law: Params
    guard: GuardParams


def settings(
    believed: Airframe,
    airframe: Mapping[str, Any],
    rate_hz: float,
    chosen: Mapping[str, Any] | None = None,
) -> Settings:
    """Settings for an airframe and a control rate. Arguments as for `law_params` of fcu/laws/parameters.py.

    `chosen`: values of PARAMETERS. Raises ParameterError, AirframeError.
    """
    given, guards = dict(flat(chosen or {})), {row.key for row in guard.PARAMETERS}
    laws = {key: value for key, value in given.items() if key not in guards}
    params = of_law.law_params(law, believed, airframe, rate_hz, laws)
    rest = {key: value for key, value in given.items() if key in guards}
    return Settings(law=params, guard=guard.guard_params(airframe, params, rest))


def derived(settings: Settings) -> Settings:
    """Settings with what is worked out from what was chosen: to be asked for after a change."""
    return settings._replace(guard=guard.derived(settings.guard, settings.law))


def check(settings: Settings) -> None:
    """Raise ParameterError for values that the kernels cannot work with."""
    of_law.check(law, settings.law)
    guard.check(settings.guard, settings.law)


def printed(chosen: Mapping[str, Any], airframe: Mapping[str, Any]) -> Mapping[str, Value]:
    """The defaults that are others with what was chosen; `airframe`: the tables of its file."""
    return {**of_law.printed(law, chosen, airframe), **guard.printed(chosen)}


def pace(settings: Settings, airframe: Mapping[str, Any]) -> Pace:
    """What modes that lead the vehicle have to know of the law; `airframe`: the tables of its file."""
    return of_law.pace(law, settings.law, airframe)


# --- the tables of both, as one of Settings


def _of(name: str, rows: Iterable[Parameter]) -> Iterable[Parameter]:
    """Rows of what stands in the field `name` of Settings."""
    for row in rows:
        parts = tuple(
            Part(part.name, tuple(f"{name}.{field}" for field in part.fields), part.sentence)
            for part in row.parts
        )
        yield row._replace(
            mavlink=parts or row.mavlink,
            field=tuple(f"{name}.{field}" for field in row.fields),
            convert=None if row.convert is None else _within(name, row.convert),
        )


def _within(name: str, convert: Conversion) -> Conversion:
    """A conversion of the value in the field `name` of Settings."""

    def changed(settings: Settings, inner: Any) -> Settings:
        after = settings._replace(**{name: inner})
        return after._replace(guard=guard.followed(after.guard, settings.law, after.law))

    def get(settings: Settings) -> float:
        return convert.get(getattr(settings, name))

    def put(settings: Settings, number: float) -> Settings:
        return changed(settings, convert.put(getattr(settings, name), number))

    lead = convert.lead
    if lead is None:
        return Conversion(get, put)
    return Conversion(
        get, put, lambda s, number, tables: changed(s, lead(getattr(s, name), number, tables))
    )


PARAMETERS = (*_of("law", of_law.table(law)), *_of("guard", guard.PARAMETERS))
