"""The procedure by which all laws are tuned and compared: one file, read and checked, and its hash."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field, ValidationError

from fcu.interface.files import toml_file
from fcu.interface.files.toml_file import FileError
from gcs_tools.missions import problems
from gcs_tools.missions.fields import NotNegative, Positive, Table, wrong

SHIPPED = Path(__file__).resolve().with_name("procedure.toml")


def _rising(of: tuple[float, float]) -> tuple[float, float]:
    """Check two numbers. Raises a PydanticCustomError."""
    if of[0] > of[1]:
        raise wrong((), f"least and greatest, got {of[0]:g} and {of[1]:g}")
    return of


Range = Annotated[tuple[Positive, Positive], Field(strict=False), AfterValidator(_rising)]
Names = Annotated[tuple[str, ...], Field(strict=False, min_length=1)]
Count = Annotated[int, Field(ge=1, le=1000)]


class ProcedureError(ValueError):
    """A procedure that cannot be followed: file, key and what was expected."""


class Draws(Table):
    """What a seed draws beside what the airframe believes."""

    rotor_lag: Range


class Objective(Table):
    """What is minimised."""

    error_scale_m: Positive
    whole_weight: NotNegative
    noise_scale: Positive
    noise_weight: NotNegative
    lost: Positive
    far_m: Positive


class Search(Table):
    """How the optimiser searches."""

    multiples: Range
    evaluations_per_gain: Count
    seeds: Annotated[
        tuple[Annotated[int, Field(ge=0)], ...], Field(strict=False, min_length=1, max_length=1000)
    ]
    first_step: Positive


class Set(Table):
    """Missions, and how many seeds each is flown with."""

    missions: Names
    seeds: Count


class Margins(Table):
    """Where a law loses the vehicle: first and greatest value that is tried of each quantity."""

    mission: str
    seeds: Annotated[int, Field(ge=0, le=100)]
    factor: Annotated[float, Field(ge=1.01)]
    accuracy: Annotated[float, Field(ge=0.001, le=1.0)]
    delay_s: Range
    lag: Range
    mass: Range
    wind: Range


class _Document(Table):
    draws: Draws
    objective: Objective
    search: Search
    training: Set
    validation: Set
    margins: Margins


@dataclass(frozen=True)
class Procedure:
    """What stands in the file."""

    sha256: str  # of its text
    draws: Draws
    objective: Objective
    search: Search
    training: Set
    validation: Set
    margins: Margins


def read(path: Path = SHIPPED) -> Procedure:
    """The procedure of a file. Raises ProcedureError."""
    try:
        file = toml_file.read(path)
    except FileError as error:
        raise ProcedureError(str(error)) from error
    try:
        found = _Document.model_validate(file.tables)
    except ValidationError as error:
        raise ProcedureError(problems.told(error, _Document, str(path), file.lines)) from error
    if not found.search.multiples[0] <= 1.0 <= found.search.multiples[1]:
        raise ProcedureError(
            f"{file.where('search', 'multiples')}: [search] multiples: expected 1 between them: a search begins at the defaults"
        )
    return Procedure(sha256=file.sha256, **dict(found))
