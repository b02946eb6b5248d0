"""What the flight controller is started with: octo.toml, or LawParams somebody has prepared."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from fcu.interface.airframe import Airframe, AirframeError, airframe, load
from fcu.kernel.buffers import from_buffer, to_buffer
from fcu.law.parameters import ParameterError, check, law_params
from fcu.law.types import LawParams

OCTO = Path(__file__).resolve().with_name("octo.toml")


class ConfigurationError(ValueError):
    """A file or a value that the controller cannot fly: which, and what was expected."""


def believed(path: Path = OCTO) -> tuple[Airframe, dict[str, Any]]:
    """The airframe the controller believes it flies, and its `[limits]`. Raises AirframeError."""
    tables = load(path)
    for table in ("rotors", "limits"):
        if table not in tables:
            raise AirframeError(f"{path}: [{table}] is missing")
    return airframe(tables["rotors"], str(path)), tables["limits"]


def read_law(path: Path | None, rate_hz: float) -> LawParams:
    """LawParams from a file that `write_law` wrote, or of octo.toml. Raises ConfigurationError."""
    try:
        if path is None:
            return law_params(*believed(), rate_hz)
        params = from_buffer(LawParams, json.loads(path.read_text())["params"])
        check(params)
        return params
    except (AirframeError, ParameterError) as error:
        raise ConfigurationError(str(error)) from error
    except OSError as error:
        raise ConfigurationError(f"{path}: {error.strerror}") from error
    except (KeyError, TypeError, ValueError, StopIteration) as error:
        raise ConfigurationError(f"{path}: not LawParams ({error})") from error


def write_law(params: LawParams, path: Path) -> None:
    """As JSON; every float64 survives to the bit."""
    path.write_text(json.dumps({"params": to_buffer(params).tolist()}, allow_nan=False))
