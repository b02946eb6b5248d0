"""What the flight controller is started with: s1000.toml, or LawParams somebody has prepared."""

from __future__ import annotations

from pathlib import Path

from fcu.interface.airframe import OCTO, AirframeError, believed, believed_drag
from fcu.interface.handover import HandoverError, load
from fcu.interface.parameter import ParameterError
from fcu.kernel.algebra import Vec3
from fcu.laws.mmrac.parameters import check, law_params
from fcu.laws.mmrac.types import LawParams


class ConfigurationError(ValueError):
    """A file or a value that the controller cannot fly: which, and what was expected."""


def read_drag(path: Path = OCTO) -> Vec3:
    """Believed drag coefficients, N/(m/s)^2, body axes. Raises ConfigurationError."""
    try:
        return believed_drag(path)
    except AirframeError as error:
        raise ConfigurationError(str(error)) from error


def read_law(path: Path | None, rate_hz: float) -> LawParams:
    """LawParams from a file, or of s1000.toml at a control rate (Hz). Raises ConfigurationError."""
    try:
        if path is None:
            return law_params(*believed(), rate_hz)
        params = load(path, LawParams)
        check(params)
        return params
    except (AirframeError, ParameterError, HandoverError) as error:
        raise ConfigurationError(str(error)) from error
