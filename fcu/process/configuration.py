"""What the flight controller is started with: an airframe file, or Settings somebody has prepared."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from fcu.guard.gains import unstable, why_refused
from fcu.interface import airframe as airframes
from fcu.interface.airframe import LAW, PINNED, AirframeError, AirframeFile
from fcu.interface.files.spelling import suggestion
from fcu.interface.files.toml_lines import nearest
from fcu.interface.handover import HandoverError, load
from fcu.interface.parameter import ParameterError, flat
from fcu.laws.loader import Law


class ConfigurationError(ValueError):
    """A file or a value that the controller cannot fly: which, and what was expected."""


def read_airframe(
    law: Law, name_or_file: str | None = None, folder: Path | None = None
) -> AirframeFile:
    """An airframe, with what its file pins for a law; None: an S1000. Raises ConfigurationError.

    name_or_file : of a shipped one, or a file relative to `folder` or the working directory.
    """
    try:
        path = airframes.OCTO if name_or_file is None else airframes.find(name_or_file, folder)
        return pinned(airframes.read(path), law)
    except AirframeError as error:
        raise ConfigurationError(str(error)) from error


def pinned(file: AirframeFile, law: Law) -> AirframeFile:
    """An airframe file with what its [law.NAME] pins for the law of that name.

    Raises AirframeError for a parameter that the law does not have, or a value that it cannot have.
    """
    laws = file.tables.get(LAW, {})
    said = laws.get(law.name, {})

    def where(*at: str) -> str:
        line = nearest(file.lines, (LAW, law.name, *at))
        return f"{file.path}:{line}: [law.{law.name}]" if line else f"{file.path}: [law.{law.name}]"

    for name, table in laws.items():
        if not isinstance(table, dict):
            line = nearest(file.lines, (LAW, name))
            raise AirframeError(
                f"{file.path}:{line}: [law] {name}: expected a table [law.NAME] of a law's parameters"
            )
    rows = {row.key: row for row in law.settings.PARAMETERS if row.key}
    values = dict(flat(said))
    for key, value in values.items():
        at = where(*key.split("."))
        if key not in rows:
            raise AirframeError(f"{at} {key}: no such law parameter{suggestion(key, rows)}")
        try:
            rows[key].numbers(value)
        except ParameterError as error:
            raise AirframeError(f"{at} {error}") from error
    return replace(file, tables={**file.tables, PINNED: values})


def read_settings(
    law: Law, path: Path | None, rate_hz: float, airframe: AirframeFile | None = None,
    flies_unstable: bool = False,
) -> Any:  # fmt: skip
    """Settings of a law, from a file, or of an airframe at a control rate (Hz).

    `airframe`: None: an S1000. `flies_unstable`: gains that the rule of stability refuses are
    accepted. Raises ConfigurationError.
    """
    file = airframe or read_airframe(law)
    made = _read(law, path, rate_hz, file)
    if not flies_unstable and (channel := unstable(law, made)):
        pinned_values = {} if path is not None else file.tables[PINNED]
        chosen = {
            key: f"{value} ({file.path.name}:{nearest(file.lines, (LAW, law.name, *key.split('.')))})"
            for key, value in pinned_values.items()
        }
        raise ConfigurationError(f"{path or file.path}: {why_refused(law, channel, chosen)}")
    return made


def _read(law: Law, path: Path | None, rate_hz: float, file: AirframeFile) -> Any:
    """Read Settings as `read_settings` does, without a look at the gains."""
    try:
        if path is None:
            return law.settings.settings(file.rotors, file.tables, rate_hz)
        handed = load(path, law.settings.Settings)
        try:
            law.settings.check(handed)
        except ParameterError as error:
            raise ConfigurationError(f"{path}: {error}") from error
        return handed
    except (AirframeError, ParameterError, HandoverError) as error:
        raise ConfigurationError(str(error)) from error
