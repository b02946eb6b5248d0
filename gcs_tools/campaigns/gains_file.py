"""Files of tuned gains: [law] as a mission has it, and [provenance], which says how they were found."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from fcu.interface.files import toml_file
from fcu.interface.files.input_file import written
from fcu.interface.files.toml_file import FileError
from fcu.interface.parameter import flat
from gcs_tools.campaigns.entrant import Entrant
from gcs_tools.campaigns.procedure import Procedure
from gcs_tools.campaigns.tuning import Tuned
from gcs_tools.missions.mission import load

_TOLD = ("law", "law_digest", "airframe")


class GainsError(ValueError):
    """A file of gains that cannot be read: which, and why."""


@dataclass(frozen=True)
class Gains:
    """What stands in a file."""

    path: Path
    law: str  # by which it was asked for
    digest: str  # of the law's sources, when it was tuned
    airframe: str
    values: Mapping[str, Any]  # key of [law] -> value
    provenance: Mapping[str, Any]


def name(entrant: Entrant) -> str:
    """What a file of its gains is called, without its suffix."""
    return re.sub(r"[^\w.-]+", "-", f"{entrant.label}-{entrant.airframe}")


def text(entrant: Entrant, tuned: Tuned, procedure: Procedure) -> str:
    """The TOML file of what was found."""
    best, settings = tuned.best, list(entrant.settings)
    own = entrant.chosen(load(procedure.training.missions[0]))
    provenance = {
        "law": entrant.name,
        "law_digest": entrant.law.digest,
        "airframe": entrant.airframe,
        "airframe_sha256": entrant.vehicle.sha256,
        "settings": settings,
        "procedure_sha256": procedure.sha256,
        "optimiser": f"scipy {version('scipy')} Nelder-Mead",
        "optimiser_seeds": list(procedure.search.seeds),
        "evaluations": tuned.evaluations,
        "cost_of_defaults": tuned.defaults.cost,
        "costs": [tried.cost for tried in tuned.found],
        "cost": best.cost,
        "lost": best.lost,
        "flights": tuned.flights,
        "m_mrac": version("m-mrac"),
    }
    lines = [
        f"# Gains of {entrant.label} on {entrant.airframe}, found by gcs tune."
        " [law] may stand in a mission.",
        "[law]",
        f"module = {written(entrant.module)}",
        *(f"{key} = {written(value)}" for key, value in {**own, **best.gains}.items()),
        "",
        "[provenance]  # costs are those of validation, see the procedure",
        *(f"{key} = {written(value)}" for key, value in provenance.items()),
    ]
    return "\n".join(lines) + "\n"


def read(path: Path) -> Gains:
    """A file of gains. Raises GainsError."""
    try:
        tables = toml_file.read(path).tables
    except FileError as error:
        raise GainsError(str(error)) from error
    law, provenance = tables.get("law"), tables.get("provenance")
    if not isinstance(law, dict) or not isinstance(provenance, dict):
        raise GainsError(f"{path}: expected [law] and [provenance], as gcs tune writes them")
    if not all(isinstance(provenance.get(name), str) for name in _TOLD):
        raise GainsError(f"{path}: [provenance] expected texts for {', '.join(_TOLD)}")
    try:
        json.dumps(provenance, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise GainsError(
            f"{path}: [provenance] expected texts, numbers and lists ({error})"
        ) from error
    name, digest, airframe = (provenance[key] for key in _TOLD)
    values = {key: value for key, value in flat(law) if key != "module"}
    return Gains(path, name, digest, airframe, values, provenance)


def folder(path: Path) -> list[Gains]:
    """Every file of gains in a folder, or the one of a file. Raises GainsError."""
    if path.is_dir():
        found = [read(file) for file in sorted(path.glob("*.toml"))]
        if not found:
            raise GainsError(f"{path}: there is no file of gains in this folder (*.toml)")
        return found
    return [read(path)]


def of(gains: Iterable[Gains], law: str, airframe: str) -> Gains | None:
    """Those of a law on an airframe. Raises GainsError where there are several."""
    found = [each for each in gains if (each.law, each.airframe) == (law, airframe)]
    if len(found) > 1:
        both = " and ".join(str(each.path) for each in found[:2])
        raise GainsError(f"{both}: both are gains of {law} on {airframe}")
    return found[0] if found else None


def changes(gains: Gains, entrant: Entrant) -> list[str]:
    """What is not as it was when an entrant's gains were found, each a sentence."""
    found, given = [], gains.provenance
    if gains.digest != entrant.law.digest:
        found.append(f"{entrant.name} has changed since it was tuned")
    if given.get("airframe_sha256") != entrant.vehicle.sha256:
        found.append(f"{entrant.airframe} has changed since {entrant.name} was tuned for it")
    then = given.get("settings", [])
    if then != (now := list(entrant.settings)):
        told, is_told = (
            " ".join(map(str, each)) or "no --set" if isinstance(each, list) else repr(each)
            for each in (then, now)
        )
        found.append(f"{entrant.name} was tuned with {told}, and flies with {is_told}")
    return found
