"""The flights of a batch, wherever it is flown: the one function that a worker is sent.

A worker is given all that it needs: the plan (a campaign's missions, as JSON) and the values of each
flight. It draws nothing, writes nothing, and remembers nothing but the missions that it has loaded.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from fcu.interface.airframe import AirframeError
from fcu.interface.parameter import ParameterError
from fcu.laws.loader import LawError
from gcs_tools.campaigns import score
from gcs_tools.exit_codes import INFRASTRUCTURE, OK, USAGE
from gcs_tools.flight import law_flights
from gcs_tools.flight.arrival import arrival
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.processes import InfrastructureError
from gcs_tools.flight.run import fly_script
from gcs_tools.flight.scenario import Scenario, scenario
from gcs_tools.flight.scripted_flight import Flown
from gcs_tools.judging.expectations import LIMITED
from gcs_tools.judging.preflight_check import refusal, refused_gains
from gcs_tools.judging.result import Judged, trajectory_sha256
from gcs_tools.missions.mission import Mission, MissionError, from_tables, with_values
from gcs_tools.recording.table import Rows

VEHICLE = "vehicle"  # a campaign's `fly`; else the law alone
REJECTED, ABORTED = "rejected", "aborted"  # ends of a flight that did not fly, or not to its end


class OrderedFlight(NamedTuple):
    """A flight that is to be flown."""

    number: int
    law: int  # which of the plan's
    values: Mapping[str, Any]  # dotted key of the mission -> value


class Row(NamedTuple):
    """What is kept of a flight."""

    number: int
    law: int
    seed: int  # of the noise
    success: bool
    ended: str  # as Result.ended
    error: str  # why it was rejected or aborted; else empty
    exit_code: int  # 2: values or a law that cannot be flown, 3: what flew it failed
    sim_time_s: float
    ticks: int
    trajectory_sha256: str
    metrics: Mapping[str, float | None]
    missed: str = ""  # which of what it must meet it did not, with commas between


class _Ready(NamedTuple):
    """A flight that may fly."""

    asked: OrderedFlight
    mission: Mission
    scene: Scenario


def fly_batch(plan: str, asked: Sequence[OrderedFlight]) -> list[Row]:
    """Fly each, and give their rows in order. What a flight can do is in its row; nothing of that is raised.

    plan : Campaign.plan().
    """
    fly, n, missions, far_m = _loaded(plan)
    made = [_ready(OrderedFlight(*one), missions[one[1]], far_m is not None) for one in asked]
    ready = [one for one in made if isinstance(one, _Ready)]
    flown = _vehicles(ready) if fly == VEHICLE else _laws(ready, n * len(missions))
    rows = {ready[i].asked[:2]: _judged(ready[i], how, far_m) for i, how in flown}
    return [rows[one.asked[:2]] if isinstance(one, _Ready) else one for one in made]


@lru_cache(maxsize=2)
def _loaded(plan: str) -> tuple[str, int, tuple[Mission, ...], float | None]:
    """How a plan's flights are flown, how many of each law, its missions, and from where they are lost.

    Raises MissionError.
    """
    tables = json.loads(plan)
    made = [(from_tables(tables["name"], each["given"]), each) for each in tables["laws"]]
    missions = tuple(
        replace(mission, folder=Path(each["folder"])) if "folder" in each else mission
        for mission, each in made
    )
    return tables["fly"], tables["flights"], missions, tables.get("far_m")


def ended_its_process(plan: str, asked: OrderedFlight, how: str) -> Row:
    """The row of a flight that has ended the process that flew it.  how : in words."""
    mission = _loaded(plan)[2][asked.law]
    seed = int(asked.values.get("flight.seed", mission.flight.seed))
    return _lost(asked, seed, ABORTED, f"the law {how}", INFRASTRUCTURE)


def _ready(asked: OrderedFlight, base: Mission, scored: bool) -> _Ready | Row:
    """The flight, or the row of one that is rejected: of one that is scored, for its gains alone."""
    try:
        mission = with_values(base, asked.values, "draw")
        scene = scenario(mission)
    except (MissionError, ParameterError, AirframeError) as error:
        seed = int(asked.values.get("flight.seed", base.flight.seed))
        return _lost(asked, seed, REJECTED, str(error), USAGE)
    why = refused_gains(mission, scene)
    if not why and not scored:
        why = refusal(scene, mission.expectations().get(LIMITED) is True)
    if why:  # the vehicle's own decision
        return _lost(asked, mission.flight.seed, REJECTED, why, OK)
    return _Ready(asked, mission, scene)


def _judged(
    flight: _Ready, flown: Flown | LawError | InfrastructureError, far_m: float | None
) -> Row:
    """The row of a flight: judged by its mission or, with `far_m`, scored as laws are compared."""
    asked, mission, scene = flight
    if not isinstance(flown, Flown):
        code = USAGE if isinstance(flown, LawError) else INFRASTRUCTURE
        return _lost(asked, mission.flight.seed, ABORTED, str(flown), code)
    plant, fcu, ended = flown.plant, flown.fcu, flown.ended
    script = flown.script
    judged = Judged.of(
        mission, float(scene.rate_hz), plant, fcu, ended, flown.begun, script=script,
        said=flown.told,
    )  # fmt: skip
    missed = [each.name for each in judged.expectations if each.is_missed]
    if script is not None and script.failure:
        missed = [script.failure, *(name for name in missed if name != "script")]
    passed, metrics = judged.passed, judged.metrics
    if far_m is not None:
        found = score.of_rows(scene, mission, plant, fcu, far_m)
        passed, metrics = not found.lost, {**metrics, **score.columns(found)}
        missed = [found.lost] if found.lost not in ("", ended) else []
    return Row(
        asked.number, asked.law, mission.flight.seed, passed, ended,
        script.text if script is not None else "", OK,
        float(plant[-1, 0]) if len(plant) else 0.0, len(fcu),
        trajectory_sha256(plant) if len(plant) else "", metrics,
        ", ".join(missed),
    )  # fmt: skip


def _lost(asked: OrderedFlight, seed: int, ended: str, why: str, exit_code: int) -> Row:
    first = why.partition("\n")[0]
    return Row(asked.number, asked.law, seed, False, ended, first, exit_code, 0.0, 0, "", {})


def _vehicles(
    flights: Sequence[_Ready],
) -> Iterator[tuple[int, Flown | LawError | InfrastructureError]]:
    """Each flown by the whole vehicle, in this process."""
    for i, (_, mission, scene) in enumerate(flights):
        try:
            if scene.script:
                yield i, fly_script(mission, scene)
                continue
            flown = MemoryFlight(scene, None, (_drop, _drop)).fly()
        except (LawError, InfrastructureError) as error:
            yield i, error
            continue
        at_s = arrival(scene, flown.plant, flown.fcu)
        if at_s is not None:
            flown.plant, flown.fcu = (rows[rows[:, 0] <= at_s] for rows in (flown.plant, flown.fcu))
            flown.arrived = True
        yield i, flown


def _laws(flights: Sequence[_Ready], n: int) -> Iterator[tuple[int, Flown | LawError]]:
    """Each flown by the law without an autopilot, in lanes if `n` flights in all repay it."""
    for i, flown in law_flights.each([scene for _, _, scene in flights], in_all=n):
        yield i, flown if isinstance(flown, LawError) else Flown(flown.plant, flown.law)


def _drop(_rows: Rows) -> None:
    """Nobody records a flight of a campaign."""
