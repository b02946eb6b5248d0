"""What the flight controller is started with: s1000.toml, or Settings somebody has prepared."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fcu.interface.airframe import OCTO, AirframeError, believed, believed_drag
from fcu.interface.handover import HandoverError, load
from fcu.interface.parameter import ParameterError
from fcu.kernel.algebra import Vec3
from fcu.laws.loader import Law


class ConfigurationError(ValueError):
    """A file or a value that the controller cannot fly: which, and what was expected."""


def read_drag(path: Path = OCTO) -> Vec3:
    """Believed drag coefficients, N/(m/s)^2, body axes. Raises ConfigurationError."""
    try:
        return believed_drag(path)
    except AirframeError as error:
        raise ConfigurationError(str(error)) from error


def read_settings(law: Law, path: Path | None, rate_hz: float) -> Any:
    """Settings of a law, from a file, or of s1000.toml at a control rate (Hz).

    Raises ConfigurationError.
    """
    try:
        if path is None:
            return law.settings.settings(*believed(), rate_hz)
        handed = load(path, law.settings.Settings)
        law.settings.check(handed)
        return handed
    except (AirframeError, ParameterError, HandoverError) as error:
        raise ConfigurationError(str(error)) from error
