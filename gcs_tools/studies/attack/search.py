"""An optimiser that looks for the flight that comes nearest to a limit, or beyond.

A quarter of its flights is spread over all numbers that make a flight (Latin hypercube); the worst of
them begin a differential evolution. What it makes least is `Verdict.least_n`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from gcs_tools.campaigns.flights import each
from gcs_tools.studies.attack.draws import Array, How, Numbers, attack
from gcs_tools.studies.attack.flight import fly
from gcs_tools.studies.attack.verdict import Verdict, verdict

POPULATION = 64
SPREAD = 0.25  # part of the flights that begin it
REFUSED = 1e6  # N: of gains that are not stable, which are not flown
WORST = -1e6  # N: of a flight that has no least


class SearchFound(NamedTuple):
    """The worst flight of a pair of setpoints and wind."""

    numbers: Numbers
    verdict: Verdict


class Search(NamedTuple):
    """What a search found, worst first, one for each pair of setpoints and wind."""

    flights: int
    found: list[SearchFound]


def search(how: How, flights: int, seed: int, console: Console | None = None) -> Search:
    """Look for the worst within so many flights (no fewer than two populations)."""
    worst: dict[tuple[str, str], SearchFound] = {}
    flown = 0

    def look(x: Array) -> tuple[float, SearchFound | None]:
        numbers = Numbers(*map(float, x))
        chosen = attack(numbers, how)
        if chosen is None:
            return REFUSED, None
        said = verdict(chosen, fly(chosen.scene, chosen.gust, chosen.noise))
        return max(said.least_n, WORST), SearchFound(numbers, said)

    def looked(points: Iterable[Array], what: str) -> list[float]:
        nonlocal flown
        values = []
        for value, found in each(look, list(points), what, console):
            values.append(value)
            if found is not None:
                flown += 1
                pair = found.verdict.setpoints, found.verdict.wind
                if pair not in worst or found.verdict.least_n < worst[pair].verdict.least_n:
                    worst[pair] = found
        return values

    spread = qmc.LatinHypercube(len(Numbers._fields), rng=seed)
    points = spread.random(max(POPULATION, round(SPREAD * flights)))
    order = np.argsort(looked(points, "spread"))
    generations = max((flights - len(points)) // POPULATION - 1, 0)  # the first is flown again

    def mapped(_: Callable[[Array], float], points: Iterable[Array]) -> list[float]:
        return looked(points, "search")

    bounds: Any = [(0.0, 1.0)] * len(Numbers._fields)
    differential_evolution(
        lambda x: look(x)[0], bounds, init=points[order[:POPULATION]], maxiter=generations,
        tol=0.0, atol=-1.0, rng=seed, polish=False, updating="deferred", workers=mapped,
    )  # fmt: skip
    ordered = sorted(worst.values(), key=lambda found: found.verdict.least_n)
    return Search(flown, ordered)
