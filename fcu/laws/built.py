"""Parameters of a law of a user's own, in the place of `fcu.laws.mmrac.parameters`.

What the law does not say by itself comes from its table, the airframe and the control rate.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from fcu.interface.airframe import Airframe
from fcu.interface.parameter import Parameter, ParameterError, Value, blank, filled, flat, values
from fcu.interface.parameter import check as check_rows
from fcu.kernel.buffers import fields
from fcu.laws.allocation import believed_rotors
from fcu.laws.face import Limits, Pace
from fcu.laws.mmrac import law as face
from fcu.laws.mmrac.types import Params

RESPONSE = 0.01  # s, what the inverted rotor lag is made to look like
FILLED = ("h", "limits", "rotors")  # fields of Params that are no rows of the table

PARAMETERS: tuple[Parameter, ...] = tuple(getattr(face, "PARAMETERS", ()))


def printed(chosen: Mapping[str, Any]) -> Mapping[str, Value]:
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
        law = face.params(believed, airframe, rate_hz, given)
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
            raise ParameterError(f"Params.{name}: expected a row for it in PARAMETERS")
    table, lag = airframe["limits"], believed.rotor_lag
    limits = Limits(
        T_min=float(table["thrust_min_n"]),
        T_max=float(table["thrust_max_n"]),
        phi_star=math.radians(table["tilt_max_deg"]),
    )
    h, f_min = 1.0 / rate_hz, limits.T_min / len(believed.spin)
    rotors = believed_rotors(believed, h, lag, f_min, kappa=max(1.0, lag / RESPONSE))
    law: Any = blank(kind, h=h, limits=limits, rotors=rotors)
    return filled(law, PARAMETERS, values(PARAMETERS, airframe, given))


def pace(law: Any) -> Pace:
    """What modes that lead the vehicle have to know of the law: if it does not say, gentle."""
    if hasattr(face, "pace"):
        told: Pace = face.pace(law)
        return told
    return Pace(f_m=1.0, yaw_rate_max=1.0, T_hover=0.5 * law.limits.T_max)


def check(law: Any) -> None:
    """Raise ParameterError for values that the law cannot fly with."""
    check_rows(law, PARAMETERS)
    if hasattr(face, "check"):
        face.check(law)
