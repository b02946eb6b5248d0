"""What is tuned and compared: a law with its gains on an airframe, and the scenes that it flies."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fcu.interface.airframe import AirframeError, AirframeFile, find, read
from fcu.interface.parameter import Parameter, ParameterError, flat
from fcu.laws import loader
from fcu.laws.loader import Law, LawError
from gcs_tools.campaigns.procedure import Draws
from gcs_tools.campaigns.seed_draws import Stream, sampled
from gcs_tools.flight import law_alone
from gcs_tools.flight.scenario import Scenario, scenario
from gcs_tools.judging.preflight_check import refused_gains
from gcs_tools.missions.mission import (
    Mission,
    MissionError,
    override,
    refuse_script,
    with_airframe,
    with_law,
    with_values,
)

DEFAULT_AIRFRAME = "s1000"
OWN = ":"  # between the name of a law and settings of its own


class EntrantError(ValueError):
    """What cannot be flown: which law, with which mission, and why."""


@dataclass(frozen=True)
class Entrant:
    """A law on an airframe."""

    law: Law
    name: str  # by which it is asked for: of a FILE.py, the path; with ":KEY=VALUE" of its own
    vehicle: AirframeFile
    gains: Mapping[str, Any] = field(default_factory=dict)  # key of [law] -> value
    settings: tuple[str, ...] = ()  # TABLE.KEY=VALUE, as --set takes them

    own: tuple[str, ...] = ()  # settings of [law] that its name has: KEY=VALUE

    @property
    def module(self) -> str:
        """Its name as a mission has it."""
        return self.name.partition(OWN)[0] if self.own else self.name

    @property
    def label(self) -> str:
        """As tables have it."""
        return OWN.join((self.law.name, *self.own))

    @property
    def airframe(self) -> str:
        """The same, of the airframe."""
        return self.vehicle.name

    def chosen(self, of: Mission) -> dict[str, Any]:
        """Key of [law] -> value, of the settings of its own. Raises EntrantError."""
        keys = {setting.partition("=")[0].strip() for setting in self.own}
        given = flat(self.mission(of).given.get("law", {}))
        return {key: value for key, value in given if key in keys}

    def mission(self, of: Mission) -> Mission:
        """A mission as this entrant flies it. Raises EntrantError."""
        try:
            refuse_script(of, "a law alone")
            made = with_airframe(with_law(of, self.module), self.vehicle.source)
            for setting in self.own:
                made = override(made, f"law.{setting}", self.name)
            made = with_values(made, {f"law.{k}": v for k, v in self.gains.items()}, "--gains")
            for setting in self.settings:
                made = override(made, setting)
        except MissionError as error:
            raise EntrantError(f"{self.label}: {error}") from error
        if made.flight.items:
            raise EntrantError(
                f"{of.source}: a mission of items is flown by a whole vehicle, not by a law alone"
            )
        return made


def entrant(name: str, airframe: str = DEFAULT_AIRFRAME, **more: Any) -> Entrant:
    """By the name of a law, or its FILE.py, and that of an airframe, or its FILE.toml.

    A law may be told settings of its own, LAW:KEY=VALUE:KEY=VALUE. Raises EntrantError.
    """
    module, *own = [name] if Path(name).exists() else name.split(OWN)
    try:
        return Entrant(loader.load(module), name, read(find(airframe)), own=tuple(own), **more)
    except (LawError, AirframeError) as error:
        raise EntrantError(str(error)) from error


def scene(mission: Mission) -> Scenario:
    """What a mission flies. Raises EntrantError."""
    try:
        return scenario(mission)
    except (MissionError, ParameterError, AirframeError) as error:
        raise EntrantError(f"{mission.source}: {error}") from error


def free(law: Law) -> tuple[Parameter, ...]:
    """The rows that tuning may choose."""
    return tuple(row for row in law.settings.PARAMETERS if row.gain and row.key)


@dataclass(frozen=True)
class EntrantFlight:
    """One flight of an entrant."""

    entrant: Entrant
    mission: Mission  # the entrant's, as written
    stream: Stream
    seed: int

    def sampled(self, draws: Draws) -> Mission:
        """The mission as the seed draws it. Raises EntrantError."""
        try:
            return sampled(self.mission, draws, self.stream, self.seed)
        except (MissionError, AirframeError) as error:
            raise EntrantError(str(error)) from error


def refusal(entrant: Entrant, mission: Mission) -> str:
    """Why a vehicle would not arm with the gains of an entrant; empty: it would. Raises EntrantError."""
    made = entrant.mission(mission)
    return refused_gains(made, scene(made))


def warm_up(entrants: Iterable[Entrant], mission: Mission) -> None:
    """Compile, one law after the other, before threads fly them. Raises EntrantError, LawError."""
    for each in entrants:
        law_alone.warm_up(scene(each.mission(mission)))
