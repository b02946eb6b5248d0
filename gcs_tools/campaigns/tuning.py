"""Gains found by one procedure for every law: the same objective, budget, bounds and flights.

What is varied is the logarithm of a factor on each number of the gains, by SciPy's Nelder-Mead: a simplex
that starts at the defaults. README.md says what it was chosen against.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.airframe import AirframeError
from fcu.interface.parameter import Parameter, ParameterError
from gcs_tools.campaigns import score
from gcs_tools.campaigns.entrant import Entrant, EntrantError, EntrantFlight, free, scene
from gcs_tools.campaigns.flights import each
from gcs_tools.campaigns.procedure import Objective, Procedure, Search, Set
from gcs_tools.campaigns.score import REFUSED, Score, cost, lost
from gcs_tools.campaigns.seed_draws import Stream
from gcs_tools.flight.scenario import with_gains
from gcs_tools.missions.mission import load

Vector = np.ndarray[Any, np.dtype[np.float64]]
Progress = Callable[["Evaluation"], None]


class Free(NamedTuple):
    """One factor that is varied: a number of a row, or equal numbers of it."""

    row: Parameter
    at: tuple[int, ...]  # which of the row's numbers
    default: float


class Evaluation(NamedTuple):
    """What the search has done so far."""

    seed: int  # of the optimiser
    done: int  # evaluations with this seed
    of: int
    cost: float  # of the last one
    best: float  # of all with this seed


class Tried(NamedTuple):
    """Gains, and what they cost in validation."""

    gains: Mapping[str, Any]
    cost: float
    lost: int  # flights


@dataclass(frozen=True)
class Tuned:
    """What tuning found."""

    free: tuple[Free, ...]
    defaults: Tried
    found: tuple[Tried, ...]  # with each seed of the optimiser
    flights: int  # of one validation
    evaluations: int  # in all

    @property
    def best(self) -> Tried:
        """The least cost in validation; the defaults, if nothing that was found is better."""
        return min((self.defaults, *self.found), key=lambda tried: tried.cost)


def factors(entrant: Entrant) -> tuple[Free, ...]:
    """What is varied of a law. Raises EntrantError for one without free gains."""
    first = scene(entrant.mission(load("benchmark/steps")))
    found = []
    for row in free(entrant.law):
        numbers = row.get(first.settings)
        for number in dict.fromkeys(numbers):
            if number != 0.0:
                at = tuple(i for i, other in enumerate(numbers) if other == number)
                found.append(Free(row, at, number))
    if not found:
        raise EntrantError(
            f"{entrant.name}: no row of its table is free: mark those that tuning may choose with gain=True"
        )
    return tuple(found)


def _without(entrant: Entrant, keys: Container[str]) -> Entrant:
    """The entrant without settings of these keys of [law]: where the search starts, no more."""
    kept = (s for s in entrant.settings if s.partition("=")[0].strip()[len("law.") :] not in keys)
    return replace(entrant, settings=tuple(kept))


def gains(free: Sequence[Free], multiples: Sequence[float]) -> dict[str, Any]:
    """Key of [law] -> value, each number its default times its multiple, within the row's range."""
    numbers: dict[str, list[float]] = {}
    rows = {each.row.key: each.row for each in free}
    for (row, at, default), multiple in zip(free, multiples, strict=True):
        values = numbers.setdefault(row.key, [0.0] * max(1, len(row.fields)))
        for i in at:
            wanted = default if multiple == 1.0 else float(f"{default * multiple:.6g}")
            values[i] = min(max(wanted, row.low), row.high)
    return {key: v if len(rows[key].fields) > 1 else v[0] for key, v in numbers.items()}


class Flights:
    """The flights of a set, made once: only the gains change from one candidate to the next."""

    def __init__(
        self, entrant: Entrant, of: Set, stream: Stream, procedure: Procedure, times: int
    ) -> None:
        """times : how often they are flown, about. Raises EntrantError, MissionError."""
        self._far_m = procedure.objective.far_m
        missions = [entrant.mission(load(name)) for name in of.missions]
        flights = [
            EntrantFlight(entrant, mission, stream, seed).sampled(procedure.draws)
            for mission in missions
            for seed in range(1, of.seeds + 1)
        ]
        self._of = [(mission, scene(mission)) for mission in flights]
        self._in_all = times * len(self._of)

    def __len__(self) -> int:
        return len(self._of)

    def scores(self, candidates: Sequence[Mapping[str, Any]]) -> list[list[Score]]:
        """Of each candidate's gains, each flight. Raises LawError."""
        return list(each(self._scores, candidates))

    def _scores(self, gains: Mapping[str, Any]) -> list[Score]:
        made = []
        for mission, default in self._of:
            try:
                made.append((with_gains(default, mission, gains), mission))
            except (ParameterError, AirframeError):  # values that do not go together
                return [lost(REFUSED)] * len(self._of)
        return score.fly_several(made, self._far_m, self._in_all)


def mean_cost(scores: Sequence[Score], objective: Objective) -> float:
    """The objective: the mean over flights."""
    return math.fsum(cost(score, objective) for score in scores) / len(scores)


def tune(entrant: Entrant, procedure: Procedure, progress: Progress = lambda at: None) -> Tuned:
    """Tune a law on an airframe. Raises EntrantError, MissionError, LawError."""
    free = factors(entrant)
    entrant = _without(entrant, {each.row.key for each in free})
    seeds, budget = len(procedure.search.seeds), len(free) * procedure.search.evaluations_per_gain
    training = Flights(entrant, procedure.training, Stream.TRAINING, procedure, seeds * budget)
    validation = Flights(entrant, procedure.validation, Stream.VALIDATION, procedure, 1 + seeds)

    def evaluate(point: Vector) -> float:
        (scores,) = training.scores([gains(free, np.exp(point).tolist())])
        return mean_cost(scores, procedure.objective)

    candidates, evaluations = [gains(free, [1.0] * len(free))], 0
    for seed in procedure.search.seeds:
        best, done = search(
            evaluate, len(free), procedure.search, seed, progress, procedure.objective.lost
        )
        candidates.append(gains(free, np.exp(best).tolist()))
        evaluations += done
    first, *rest = (
        Tried(tried, mean_cost(scores, procedure.objective), sum(bool(s.lost) for s in scores))
        for tried, scores in zip(candidates, validation.scores(candidates), strict=True)
    )
    return Tuned(free, first, tuple(rest), len(validation), evaluations)


def search(
    evaluate: Callable[[Vector], float], n: int, how: Search, seed: int, progress: Progress,
    lost: float = math.inf,
) -> tuple[Vector, int]:  # fmt: skip
    """The best point of float64[n], logarithms of multiples, and how many were evaluated.

    The first is 0, the defaults; those around it lie `first_step` up or down along each axis, as the
    seed says. Where the defaults cost `lost`, which tells no direction, random points within the bounds
    are tried until one costs less, with half of the budget at most; the search begins there.
    """
    from scipy.optimize import minimize

    budget = n * how.evaluations_per_gain
    low, high = (math.log(multiple) for multiple in how.multiples)
    best, least, done = np.zeros(n), math.inf, 0

    def look(point: Vector) -> float:
        nonlocal best, least, done
        value = evaluate(point)
        done += 1
        if value < least:
            best, least = point.copy(), value
        progress(Evaluation(seed, done, budget, value, least))
        return value

    random = np.random.default_rng(seed)
    steps = np.diag(how.first_step * random.choice([-1.0, 1.0], n))
    first = np.zeros(n)
    if math.isfinite(lost) and look(first) >= lost:
        while least >= lost and done < budget // 2:
            look(random.uniform(low, high, n))
        first = best
    simplex = np.clip(first + np.vstack([np.zeros(n), steps]), low, high)
    options = {"initial_simplex": simplex, "adaptive": True, "maxfev": budget - done, "xatol": 0.0, "fatol": 0.0}  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the budget was used up
        minimize(look, first, method="Nelder-Mead", bounds=[(low, high)] * n, options=options)
    return best, done
