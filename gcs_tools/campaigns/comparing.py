"""Laws flown through the same missions with the same draws, and what the flights say.

    parts = campaigns(entrants, missions, seeds, procedure)   # one of each mission on each airframe
    found = summary(rows(part, table), procedure.objective)

A comparison is a campaign of each mission on each airframe, over the laws. It is flown, kept, continued
and flown again as any campaign is.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from fcu.interface.files.input_file import written
from gcs_tools.campaigns import score, statistics
from gcs_tools.campaigns.campaign_file import Campaign, Changes, parsed, settings
from gcs_tools.campaigns.entrant import Entrant
from gcs_tools.campaigns.procedure import Objective, Procedure
from gcs_tools.campaigns.score import NAMES, Score, cost
from gcs_tools.campaigns.statistics import Interval
from gcs_tools.missions import mission as mission_file
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


class Part(NamedTuple):
    """One mission on one airframe, with all laws and seeds."""

    airframe: str
    mission: str
    campaign: Campaign

    @property
    def folder(self) -> str:
        """The name of its folder, below that of the comparison."""
        return self.campaign.name


def campaigns(
    entrants: Sequence[Entrant], missions: Sequence[Mission], seeds: Sequence[int],
    procedure: Procedure,
) -> list[Part]:  # fmt: skip
    """The campaigns of a comparison, in the order of airframes and missions.

    seeds : one after the other.  Raises EntrantError, CampaignError.
    """
    for entrant in entrants:
        for mission in missions:
            entrant.mission(mission)  # raises, in the words of the command line
    found = []
    for airframe in dict.fromkeys(entrant.airframe for entrant in entrants):
        laws = [entrant for entrant in entrants if entrant.airframe == airframe]
        for mission in missions:
            name = re.sub(r"[^\w.-]+", "-", f"{airframe}-{mission.name}")
            text = _text(laws, mission, seeds, procedure)
            changes = Changes(set=settings(laws[0].settings))
            campaign = parsed(text, name, Path.cwd(), name, changes)
            of_law = len(missions) * len(seeds)
            found.append(Part(airframe, mission.name, replace(campaign, in_all=of_law)))
    return found


def _text(
    laws: Sequence[Entrant], mission: Mission, seeds: Sequence[int], procedure: Procedure
) -> str:
    """The file of a campaign: what is flown stands in it, but for what `--set` changes."""
    entries = ",\n".join(f"    {_inline(_entry(each, mission))}" for each in laws)
    lines = {
        "title": mission.title, "mission": _named(mission), "airframe": laws[0].vehicle.source,
        "flights": len(seeds), "seed": seeds[0], "fly": "law",
    }  # fmt: skip
    head = "\n".join(f"{key} = {written(value)}" for key, value in lines.items())
    ranges = {**procedure.draws.model_dump(), "far_m": procedure.objective.far_m}
    drawn = "\n".join(f"{key} = {written(value)}" for key, value in ranges.items())
    return f"{head}\nlaws = [\n{entries},\n]\n\n[seeds]\n{drawn}\n"


def _entry(of: Entrant, mission: Mission) -> dict[str, Any]:
    """A law with the settings of its own and its gains, of which the latter win."""
    module = str(Path(of.module).absolute()) if of.module.endswith(".py") else of.module
    own = settings([f"law.{setting}" for setting in of.own])
    gains = {f"law.{key}": value for key, value in of.gains.items()}
    return {"law": module, "label": of.label, "set": {**own, **gains}}


def _inline(table: Mapping[str, Any]) -> str:
    """A table on one line, its keys in quotes: a dotted one is one key."""
    values = (
        f"{json.dumps(key)} = {_inline(value) if isinstance(value, Mapping) else written(value)}"
        for key, value in table.items()
    )
    return f"{{ {', '.join(values)} }}"


def _named(mission: Mission) -> str:
    """The name of a shipped mission, or the file of another one."""
    file = Path(mission.folder, f"{mission.name}.toml").absolute()
    if file.is_relative_to(root := mission_file.folder().absolute()):
        return str(file.relative_to(root).with_suffix(""))
    return str(file)


def rows(part: Part, table: Any) -> list[Row]:
    """The flights of a table (`flights.parquet`), law by law."""
    first = part.campaign.document.seed
    flights = table.select(
        ["law", "number", "success", "ended", "missed", "error", "exit_code", *score.COLUMNS]
    )
    found = [
        Row(
            part.airframe, part.mission, each["law"], first + each["number"], score.of_columns(each)
        )
        for each in flights.to_pylist()
    ]
    order = {law: i for i, law in enumerate(part.campaign.labels)}
    return sorted(found, key=lambda row: (order[row.law], row.seed))


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
