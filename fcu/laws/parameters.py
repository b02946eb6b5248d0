"""Parameters of any law: its table, Params from it, and what the law says of them.

`law` is the module of a law. What it does not say comes from its table, the airframe and the rate.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import ModuleType
from typing import Any

from fcu.interface.airframe import Airframe, AirframeError, G
from fcu.interface.parameter import (
    Parameter,
    ParameterError,
    Part,
    Value,
    blank,
    filled,
    flat,
    values,
    with_field,
)
from fcu.interface.parameter import check as check_rows
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import field_type, fields
from fcu.laws import actuation
from fcu.laws.allocation import believed_rotors
from fcu.laws.face import Limits, Pace

MOST = 16  # characters in a name of MAVLink
TAKEN = ("module", "guard")  # keys of [law] that are not the law's
FILLED = ("h", "limits", "rotors")  # fields of Params that are no rows of the table

SHARED = actuation.rows("CA_ROTOR_RESP")


def own(law: ModuleType) -> tuple[Parameter, ...]:
    """The law's own table."""
    return tuple(getattr(law, "PARAMETERS", ()))


def shared(law: ModuleType) -> tuple[Parameter, ...]:
    """Rows that every law has, but for those that its own table has under names of its own."""
    keys = {row.key for row in own(law)}
    return tuple(row for row in SHARED if row.key not in keys)


def table(law: ModuleType) -> tuple[Parameter, ...]:
    """All parameters of a law."""
    return (*own(law), *shared(law))


def check_table(law: ModuleType) -> None:
    """Raise ParameterError for a table that no mission, or no ground station, could use."""
    for row in own(law):
        _check_row(row)
    rows = (*own(law), *SHARED)
    names = [part.name for row in rows for part in row.parts]
    keys = [row.key for row in rows]
    for row in own(law):
        where = f"PARAMETERS: {row.key or row.mavlink!r}"
        bad = [
            n for n in (part.name for part in row.parts) if not _is_name(n) or names.count(n) > 1
        ]
        if bad:
            raise ParameterError(
                f"{where}: {bad[0]!r}: expected a name of its own, of at most {MOST} characters"
                " from A-Z, a-z, 0-9 and _"
            )
        if keys.count(row.key) > 1 or row.key in TAKEN:
            raise ParameterError(f"{where}: expected a key of its own, none of {', '.join(TAKEN)}")
        for path in row.fields:
            if path.partition(".")[0] in FILLED:
                raise ParameterError(f"{where}: {path} is filled in, from rate and airframe")
            if (kind := field_type(law.Params, path)) is Vec3:
                raise ParameterError(
                    f"{where}: Params.{path} is a Vec3: add axes=True to this row (three numbers, or one"
                    " for all three)"
                )
            if kind is not float:
                raise ParameterError(f"{where}: expected Params.{path} to be a float")
        if row.default is None and not row.airframe and row.rule is None:
            raise ParameterError(f"{where}: expected a default")
        if not row.low <= row.high:
            raise ParameterError(f"{where}: expected a range, got {row.low} to {row.high}")
        if row.below and row.below not in keys:
            raise ParameterError(f"{where}: below: there is no {row.below}")
        if row.default is not None:
            try:
                numbers = {row.key: row.numbers(row.default)}
                check_rows(filled(blank(law.Params), [row], numbers), [row])
            except ParameterError as error:
                said = str(error).removeprefix(f"{row.name}: ")
                raise ParameterError(f"{where}: its default is {row.default!r}: {said}") from error


def _check_row(row: Any) -> None:
    """Raise ParameterError for what is no Parameter, or has no name of MAVLink where one stands."""
    if not isinstance(row, Parameter):
        raise ParameterError(f"PARAMETERS: expected a Parameter(...), got {row!r}")
    names = row.mavlink
    several = isinstance(names, tuple) and all(isinstance(part, Part) for part in names)
    if not isinstance(names, str) and not several:
        raise ParameterError(
            f"PARAMETERS: {row.key!r}: expected a name of MAVLink, or Parts (name, fields, sentence)"
            f" where some of its numbers have names of their own, got {names!r}"
        )


def _is_name(name: Any) -> bool:
    return isinstance(name, str) and name.isascii() and name.isidentifier() and len(name) <= MOST


def printed(
    law: ModuleType, chosen: Mapping[str, Any], airframe: Mapping[str, Any]
) -> Mapping[str, Value]:
    """The defaults that are others with what was chosen, of a law that has such."""
    told: Mapping[str, Value] = law.printed(chosen, airframe) if hasattr(law, "printed") else {}
    return told


def law_params(
    law: ModuleType,
    believed: Airframe,
    airframe: Mapping[str, Any],
    rate_hz: float,
    chosen: Mapping[str, Any] | None = None,
) -> Any:
    """Params for an airframe and a control rate.

    `airframe`: the tables of the file that `believed` is of. `chosen`: values of the
    table, under their keys, in place of their defaults. Raises ParameterError, AirframeError.
    """
    given = dict(flat(chosen or {}))
    if hasattr(law, "params"):
        rows = shared(law)
        of_all = {row.key for row in rows}
        rest = {key: value for key, value in given.items() if key not in of_all}
        with _blamed(law, "params"):
            params = law.params(believed, airframe, rate_hz, rest)
        if not isinstance(params, law.Params):
            raise ParameterError(f"{law.__file__}: params: expected Params, got {params!r}")
        given = {key: value for key, value in given.items() if key in of_all}
        params = filled(params, rows, values(rows, airframe, given))
    else:
        params = _from_the_table(law, believed, airframe, rate_hz, given)
    check(law, params)
    return params


def _from_the_table(
    law: ModuleType,
    believed: Airframe,
    airframe: Mapping[str, Any],
    rate_hz: float,
    given: Mapping[str, Any],
) -> Any:
    kind, rows = law.Params, table(law)
    told = {path.partition(".")[0] for row in rows for path in row.fields}
    for name in fields(kind):
        if name not in (*FILLED, *told):
            raise ParameterError(
                f"{law.__file__}: Params.{name}: expected a row for it in PARAMETERS"
            )
    most, lag = airframe["limits"], believed.rotor_lag
    limits = Limits(
        T_min=float(most["thrust_min_n"]),
        T_max=float(most["thrust_max_n"]),
        phi_star=math.radians(most["tilt_max_deg"]),
    )
    value = values(rows, airframe, given, printed(law, given, airframe))
    h = 1.0 / rate_hz
    rotors = believed_rotors(believed, h, lag, f_min=math.nan, kappa=math.nan)
    params = filled(
        blank(kind, h=h, limits=limits, rotors=rotors._replace(f_min=limits.T_min / rotors.W)),
        rows,
        value,
    )
    (response,) = value["rotor_response_s"]
    return with_field(params, "rotors.kappa", actuation.kappa(lag, response))


def pace(law: ModuleType, params: Any, airframe: Mapping[str, Any]) -> Pace:
    """What modes that lead the vehicle have to know of the law: if it does not say, gentle.

    `airframe`: the tables of its file, with the vehicle's weight.
    """
    hover = G * 0.5 * float(sum(airframe["vehicle"]["mass_kg"]))
    return _told(law, params) or Pace(f_m=1.0, yaw_rate_max=1.0, T_hover=hover)


def _told(law: ModuleType, params: Any) -> Pace | None:
    """What the law says of its pace, if it does."""
    if not hasattr(law, "pace"):
        return None
    with _blamed(law, "pace"):
        told: Pace = law.pace(params)
    if not isinstance(told, Pace) or not all(0.0 < number < math.inf for number in told):
        raise ParameterError(f"{law.__file__}: pace: expected a Pace above 0, got {told!r}")
    return told


def check(law: ModuleType, params: Any) -> None:
    """Raise ParameterError for values that the law cannot fly with."""
    check_rows(params, table(law))
    _told(law, params)
    if hasattr(law, "check"):
        with _blamed(law, "check"):
            law.check(params)


@contextmanager
def _blamed(law: ModuleType, function: str) -> Iterator[None]:
    """Whatever a function of the law raises is said of it."""
    try:
        yield
    except (ParameterError, AirframeError):
        raise
    except Exception as error:
        raise ParameterError(f"{law.__file__}: {function}: {error!r}") from error
