"""Laws flown through the same missions with the same draws, and what the flights say.

    flights = fly(entrants, missions, seeds, procedure)
    found = summary(flights, procedure.objective)

Each flight keeps a Score; its rows are dropped as soon as it has one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rich.console import Console

from gcs_tools.campaigns import statistics
from gcs_tools.campaigns.entrant import Entrant, Flight
from gcs_tools.campaigns.entrant import fly as fly_some
from gcs_tools.campaigns.flights import chunked
from gcs_tools.campaigns.procedure import Objective, Procedure
from gcs_tools.campaigns.score import NAMES, Score, cost
from gcs_tools.campaigns.seed_draws import Stream
from gcs_tools.campaigns.statistics import Interval
from gcs_tools.missions.mission import Mission


class Row(NamedTuple):
    """One flight."""

    airframe: str
    mission: str
    law: str
    seed: int
    score: Score


@dataclass(frozen=True)
class Cell:
    """A law on an airframe in a mission: all seeds."""

    airframe: str
    mission: str
    law: str
    flights: int
    lost: int
    means: dict[str, Interval]  # of the flights that were not lost, by the names of a Score


@dataclass(frozen=True)
class Overall:
    """A law on an airframe in all missions."""

    airframe: str
    law: str
    flights: int
    lost: Interval  # part of them
    cost: Interval  # the procedure's objective; the interval is over seeds
    cost_less_first: Interval  # the same less the first law's, seed by seed: it counts losses
    means: dict[str, Interval]  # of the missions' means; the interval is over seeds


@dataclass(frozen=True)
class Difference:
    """A law less the first law, seed by seed."""

    airframe: str
    mission: str
    law: str
    first: str
    pairs: int  # seeds with which neither was lost
    error_m: Interval  # over these
    cost: Interval  # over all seeds: what is lost counts


@dataclass(frozen=True)
class Summary:
    """What all flights say."""

    cells: tuple[Cell, ...]
    overall: tuple[Overall, ...]
    differences: tuple[Difference, ...]


def fly(
    entrants: Sequence[Entrant], missions: Sequence[Mission], seeds: Sequence[int],
    procedure: Procedure, console: Console | None = None,
) -> list[Row]:  # fmt: skip
    """Every entrant in every mission with every seed, in the order of airframes, missions, laws, seeds.

    Raises EntrantError, LawError.
    """
    flights = [
        Flight(entrant, entrant.mission(mission), Stream.TEST, seed)
        for airframe in dict.fromkeys(entrant.airframe for entrant in entrants)
        for mission in missions
        for entrant in entrants
        if entrant.airframe == airframe
        for seed in seeds
    ]
    of_law = len(flights) / len(entrants)
    scores = chunked(  # seeds of a law in a mission, mostly
        lambda some: fly_some(some, procedure, of_law), flights, None, "comparing", console
    )
    return [
        Row(f.entrant.airframe, f.mission.name, f.entrant.label, f.seed, score)
        for f, score in zip(flights, scores, strict=True)
    ]


def summary(rows: Sequence[Row], objective: Objective) -> Summary:
    """What the flights say, cell by cell, overall, and of the others against the first law."""
    airframes, missions, laws = (
        tuple(dict.fromkeys(getattr(row, of) for row in rows))
        for of in ("airframe", "mission", "law")
    )
    by: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        by.setdefault((row.airframe, row.mission, row.law), []).append(row)
    of_law = {
        (airframe, law): [row for mission in missions for row in by[airframe, mission, law]]
        for airframe in airframes
        for law in laws
    }
    return Summary(
        cells=tuple(_cell(*of, flown) for of, flown in by.items()),
        overall=tuple(
            _overall(airframe, law, flown, of_law[airframe, laws[0]], objective)
            for (airframe, law), flown in of_law.items()
        ),
        differences=tuple(
            _difference(by[airframe, mission, law], by[airframe, mission, laws[0]], objective)
            for airframe in airframes
            for mission in missions
            for law in laws[1:]
        ),
    )


def _cell(airframe: str, mission: str, law: str, rows: list[Row]) -> Cell:
    kept = [row.score for row in rows if not row.score.lost]
    means = {name: statistics.mean([getattr(s, name) for s in kept]) for name in NAMES}
    return Cell(airframe, mission, law, len(rows), len(rows) - len(kept), means)


def _overall(
    airframe: str, law: str, rows: list[Row], first: list[Row], objective: Objective
) -> Overall:
    of_seed = _by_seed(rows)
    costs = _costs(of_seed, objective)
    theirs = _costs(_by_seed(first), objective)
    kept = {seed: [score for score in scores if not score.lost] for seed, scores in of_seed.items()}
    means = {
        name: statistics.mean(
            [_mean([getattr(s, name) for s in scores]) for scores in kept.values() if scores]
        )
        for name in NAMES
    }
    lost = sum(bool(row.score.lost) for row in rows)
    return Overall(
        airframe, law, len(rows), statistics.share(lost, len(rows)).interval, statistics.mean(list(costs.values())),
        statistics.mean([costs[seed] - theirs[seed] for seed in costs]), means,
    )  # fmt: skip


def _by_seed(rows: list[Row]) -> dict[int, list[Score]]:
    found: dict[int, list[Score]] = {}
    for row in rows:
        found.setdefault(row.seed, []).append(row.score)
    return found


def _costs(of_seed: dict[int, list[Score]], objective: Objective) -> dict[int, float]:
    """Of each seed, the mean over missions."""
    return {
        seed: _mean([cost(score, objective) for score in scores])
        for seed, scores in of_seed.items()
    }


def _difference(rows: list[Row], first: list[Row], objective: Objective) -> Difference:
    theirs = {row.seed: row.score for row in first}
    found = [
        row.score.error_m - theirs[row.seed].error_m
        for row in rows
        if not row.score.lost and not theirs[row.seed].lost
    ]
    costs = [cost(row.score, objective) - cost(theirs[row.seed], objective) for row in rows]
    airframe, mission, law = rows[0][:3]
    return Difference(
        airframe, mission, law, first[0].law, len(found), statistics.mean(found), statistics.mean(costs)
    )  # fmt: skip


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)
