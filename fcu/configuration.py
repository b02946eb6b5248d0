"""What the flight controller is started with: octo.toml, or LawParams somebody has prepared."""

from __future__ import annotations

from pathlib import Path

from fcu.interface.airframe import OCTO, AirframeError, believed
from fcu.interface.airframe import load as load_toml
from fcu.interface.handover import HandoverError, load
from fcu.kernel.algebra import Vec3
from fcu.law.parameters import ParameterError, check, law_params
from fcu.law.types import LawParams


class ConfigurationError(ValueError):
    """A file or a value that the controller cannot fly: which, and what was expected."""


def read_drag(path: Path = OCTO) -> Vec3:
    """Believed drag coefficients, N/(m/s)^2, body axes. Raises ConfigurationError."""
    try:
        drag = [float(c) for c in load_toml(path)["air"]["drag"]]
        if len(drag) != 3 or not all(0.0 < c < 100.0 for c in drag):
            raise ValueError("expected three numbers above 0")
        return Vec3(*drag)
    except (AirframeError, KeyError, TypeError, ValueError) as error:
        raise ConfigurationError(f"{path}: [air] drag: {error}") from error


def read_law(path: Path | None, rate_hz: float) -> LawParams:
    """LawParams from a file, or of octo.toml at a control rate (Hz). Raises ConfigurationError."""
    try:
        if path is None:
            return law_params(*believed(), rate_hz)
        params = load(path, LawParams)
        check(params)
        return params
    except (AirframeError, ParameterError, HandoverError) as error:
        raise ConfigurationError(str(error)) from error
