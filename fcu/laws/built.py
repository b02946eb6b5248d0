"""Parameters of a law of a user's own, in the place of `fcu.laws.mmrac.parameters`.

What the law does not say by itself comes from its table, the airframe and the control rate.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from fcu.interface.airframe import Airframe, AirframeError
from fcu.interface.parameter import (
    Parameter,
    ParameterError,
    Value,
    blank,
    filled,
    flat,
    values,
    with_field,
)
from fcu.interface.parameter import check as check_rows
from fcu.kernel.buffers import field_type, fields
from fcu.laws import actuation
from fcu.laws.allocation import believed_rotors
from fcu.laws.face import Limits, Pace
from fcu.laws.mmrac import law as face
from fcu.laws.mmrac.types import Params

G = 9.81  # m/s^2
MOST = 16  # characters in a name of MAVLink
TAKEN = ("module", "guard")  # keys of [law] that are not the law's
FILLED = ("h", "limits", "rotors")  # fields of Params that are no rows of the table

OWN: tuple[Parameter, ...] = tuple(getattr(face, "PARAMETERS", ()))
SHARED = actuation.rows("CA_ROTOR_RESP")
PARAMETERS: tuple[Parameter, ...] = (*OWN, *SHARED)


def check_table() -> None:
    """Raise ParameterError for a table that no mission, or no ground station, could use."""
    names = [part.name for row in PARAMETERS for part in row.parts]
    keys = [row.key for row in PARAMETERS]
    for row in OWN:
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
            if field_type(Params, path) is not float:
                raise ParameterError(f"{where}: expected Params.{path} to be a float")
        if row.default is None and not row.airframe and row.rule is None:
            raise ParameterError(f"{where}: expected a default")
        if not row.low <= row.high:
            raise ParameterError(f"{where}: expected a range, got {row.low} to {row.high}")
        if row.below and row.below not in keys:
            raise ParameterError(f"{where}: below: there is no {row.below}")
        if row.default is not None:
            check_rows(filled(blank(Params), [row], {row.key: row.numbers(row.default)}), [row])


def _is_name(name: Any) -> bool:
    return isinstance(name, str) and name.isascii() and name.isidentifier() and len(name) <= MOST


def printed(chosen: Mapping[str, Any], airframe: Mapping[str, Any]) -> Mapping[str, Value]:
    """The defaults that are others with what was chosen: none."""
    return {}


def law_params(
    believed: Airframe,
    airframe: Mapping[str, Any],
    rate_hz: float,
    chosen: Mapping[str, Any] | None = None,
) -> Any:
    """Params for an airframe and a control rate.

    `airframe`: the tables of the file that `believed` is of; `chosen`: values of PARAMETERS, under
    their keys, in place of their defaults. Raises ParameterError, AirframeError.
    """
    given = dict(flat(chosen or {}))
    if hasattr(face, "params"):
        of_all = {row.key for row in SHARED}
        own = {key: value for key, value in given.items() if key not in of_all}
        with _blamed("params"):
            law = face.params(believed, airframe, rate_hz, own)
        if not isinstance(law, Params):
            raise ParameterError(f"{face.__file__}: params: expected Params, got {law!r}")
        given = {key: value for key, value in given.items() if key in of_all}
        law = filled(law, SHARED, values(SHARED, airframe, given))
    else:
        law = _from_the_table(believed, airframe, rate_hz, given)
    check(law)
    return law


def _from_the_table(
    believed: Airframe, airframe: Mapping[str, Any], rate_hz: float, given: Mapping[str, Any]
) -> Any:
    kind: Any = Params
    told = {path.partition(".")[0] for row in PARAMETERS for path in row.fields}
    for name in fields(kind):
        if name not in (*FILLED, *told):
            raise ParameterError(
                f"{face.__file__}: Params.{name}: expected a row for it in PARAMETERS"
            )
    table, lag = airframe["limits"], believed.rotor_lag
    limits = Limits(
        T_min=float(table["thrust_min_n"]),
        T_max=float(table["thrust_max_n"]),
        phi_star=math.radians(table["tilt_max_deg"]),
    )
    value, h = values(PARAMETERS, airframe, given), 1.0 / rate_hz
    rotors = believed_rotors(believed, h, lag, f_min=math.nan, kappa=math.nan)
    law = filled(
        blank(kind, h=h, limits=limits, rotors=rotors._replace(f_min=limits.T_min / rotors.W)),
        PARAMETERS,
        value,
    )
    (response,) = value["rotor_response_s"]
    return with_field(law, "rotors.kappa", actuation.kappa(lag, response))


def pace(law: Any, airframe: Mapping[str, Any]) -> Pace:
    """What modes that lead the vehicle have to know of the law: if it does not say, gentle.

    `airframe`: the tables of its file, with the vehicle's weight.
    """
    hover = G * 0.5 * float(sum(airframe["vehicle"]["mass_kg"]))
    return _told(law) or Pace(f_m=1.0, yaw_rate_max=1.0, T_hover=hover)


def _told(law: Any) -> Pace | None:
    """What the law says of its pace, if it does."""
    if not hasattr(face, "pace"):
        return None
    with _blamed("pace"):
        told: Pace = face.pace(law)
    if not isinstance(told, Pace) or not all(0.0 < number < math.inf for number in told):
        raise ParameterError(f"{face.__file__}: pace: expected a Pace above 0, got {told!r}")
    return told


def check(law: Any) -> None:
    """Raise ParameterError for values that the law cannot fly with."""
    check_rows(law, PARAMETERS)
    _told(law)
    if not hasattr(face, "check"):
        return
    with _blamed("check"):
        face.check(law)


@contextmanager
def _blamed(what: str) -> Iterator[None]:
    """Whatever a function of the user's raises is said of it."""
    try:
        yield
    except (ParameterError, AirframeError):
        raise
    except Exception as error:
        raise ParameterError(f"{face.__file__}: {what}: {error!r}") from error
