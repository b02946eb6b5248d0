"""The draws of a campaign: which values each flight has, by its number and the campaign's seed alone.

    quantities = draws.quantities(1234)          # {"plant.mass_kg": 7.31, ...}
    draws.values(1234, quantities, base)         # {"flight.seed": ..., "plant.mass_kg": 7.31, ...}

A key may go into an array: `wind.phase_rad[0]`, `flight.setpoints[1].position_m[2]`.
"""

from __future__ import annotations

import copy
import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.files import input_file
from gcs_tools.campaigns.distributions import Distribution, Numbers
from gcs_tools.campaigns.rare import Mixture

RANDOM, HYPERCUBE, SOBOL, GRID, LIST = METHODS = (
    "random", "latin_hypercube", "sobol", "grid", "list",
)  # fmt: skip
SEED = "flight.seed"  # of the noise: drawn for every flight, unless the file says otherwise
FILES = ("wind.file", "wind.field.file")  # keys that name files
MOST_DIMENSIONS = 1000
_PART = re.compile(r"([\w-]+)((?:\[[0-9]{1,9}\])*)")


class DrawError(input_file.PlainError):
    """A key or a value that cannot be drawn: which, and why."""


class Key(NamedTuple):
    """A dotted key of a mission, and the way into its array."""

    name: str  # as it is written
    table: str  # the part that a mission has as a key
    inside: tuple[str | int, ...]  # from there


def key(name: str) -> Key:
    """The parts of a written key. Raises DrawError."""
    parts: list[str | int] = []
    for part in name.split("."):
        found = _PART.fullmatch(part)
        if found is None:
            raise DrawError(
                f"{name}: expected a key as TABLE.KEY, or TABLE.KEY[0] for a number of it"
            )
        parts += [found[1], *(int(each) for each in re.findall(r"\d+", found[2]))]
    at = next((i for i, part in enumerate(parts) if isinstance(part, int)), len(parts))
    return Key(name, ".".join(map(str, parts[:at])), tuple(parts[at:]))


def check_apart(names: Iterable[str]) -> None:
    """Raise DrawError for a quantity that is drawn twice: under two spellings, or within another."""
    paths: dict[tuple[str | int, ...], str] = {}
    for each in map(key, names):
        path = (*each.table.split("."), *each.inside)
        if path in paths:
            raise DrawError(f"{each.name}: drawn twice, also as {paths[path]}")
        paths[path] = each.name
    for path, name in paths.items():
        for length in range(1, len(path)):
            if path[:length] in paths:
                raise DrawError(f"{name}: drawn twice, also within {paths[path[:length]]}")


@dataclass(frozen=True)
class Draws:
    """What is drawn, how, and how many flights there are."""

    method: str
    seed: int
    n: int
    drawn: tuple[tuple[Key, Distribution], ...]
    points: tuple[Mapping[str, Any], ...]  # with LIST: the values of each flight
    has_seed: bool  # whether the file sets or draws the mission's seed
    stage: int = 0  # flights of each stage that looks for rare failures; 0: there are none
    stages: int = 0  # the flights that count come after so many
    proposals: dict[int, Mixture] = field(default_factory=dict)  # of each stage, once it is known
    folder: Path = Path()  # the mission's, where drawn names of files begin

    @property
    def names(self) -> tuple[str, ...]:
        """The drawn quantities, as the file writes them."""
        if self.method == LIST:
            return tuple(dict.fromkeys(name for point in self.points for name in point))
        return tuple(each.name for each, _ in self.drawn)

    def quantities(self, number: int) -> dict[str, Any]:
        """What was drawn for a flight: written key -> value, before it multiplies anything."""
        if self.method == LIST:
            return dict(self.points[number % len(self.points)])
        if self.method == GRID:
            values = self._grid[number % len(self._grid)]
            return {each.name: value for (each, _), value in zip(self.drawn, values, strict=True)}
        if self.stage:
            from scipy.special import ndtr

            return self.at(ndtr(self.z(number)))
        return self.at(self._parts(number))

    def stage_of(self, number: int) -> int:
        """The stage of a flight that looks for rare failures; of those that count `stages`."""
        return min(number // self.stage, self.stages)

    def z(self, number: int) -> Numbers:
        """The standard normal numbers (d,) by way of which a flight's quantities are drawn."""
        random = np.random.default_rng([self.seed, number])
        return self.proposals[self.stage_of(number)].draw(random)

    def weight(self, number: int) -> float:
        """How often a flight's quantities come without importance, for once with it."""
        mixture = self.proposals[self.stage_of(number)]
        return float(mixture.weights(self.z(number)[None, :])[0])

    def at(self, parts: Numbers) -> dict[str, Any]:
        """The quantities at parts (d,) between 0 and 1 of their distributions."""
        return {
            each.name: distribution.at(parts[i : i + 1])[0]
            for i, (each, distribution) in enumerate(self.drawn)
        }

    def noise_seed(self, number: int) -> int:
        """The seed of a flight's noise."""
        return int(np.random.default_rng([self.seed, number, 1]).integers(1, 2**53))

    def values(
        self, number: int, quantities: Mapping[str, Any], base: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Dotted keys of a mission, and their values in a flight with these quantities.

        base : the mission's own values by key, to multiply and to go into. Raises DrawError.
        """
        found: dict[str, Any] = {} if self.has_seed else {SEED: self.noise_seed(number)}
        relative = {each.name for each, distribution in self.drawn if distribution.relative}
        for name, value in quantities.items():
            at = key(name)
            if name in FILES and isinstance(value, str):
                value = str(self.folder / value)
            if name in relative:
                value = multiplied(name, value, _original(at, base))
            if at.inside:
                whole = found.get(at.table)
                whole = copy.deepcopy(base.get(at.table)) if whole is None else whole
                found[at.table] = _inside(name, whole, at.inside, value)
            else:
                found[at.table] = value
        return found

    def _parts(self, number: int) -> Numbers:
        if self.method == RANDOM:
            return np.random.default_rng([self.seed, number]).uniform(size=len(self.drawn))
        found: Numbers = self._sample[number]
        return found

    @cached_property
    def _sample(self) -> Numbers:
        """float64 (n, d): all parts of a method that lays them out together."""
        from scipy.stats import qmc

        d = len(self.drawn)
        random = np.random.default_rng([self.seed])
        if not d:
            return np.zeros((self.n, 0))
        if self.method == HYPERCUBE:
            laid: Numbers = qmc.LatinHypercube(d, rng=random).random(self.n)
            return laid
        power = max(0, math.ceil(math.log2(self.n)))
        sobol: Numbers = qmc.Sobol(d, scramble=True, rng=random).random_base2(power)[: self.n]
        return sobol

    @cached_property
    def _grid(self) -> list[tuple[Any, ...]]:
        return list(itertools.product(*(distribution.grid() for _, distribution in self.drawn)))


def grid_size(distributions: Sequence[Distribution]) -> int:
    """Points of a grid."""
    return math.prod(
        len(each.choice) if each.choice is not None else each.levels or 0 for each in distributions
    )


def _original(at: Key, base: Mapping[str, Any]) -> Any:
    """The mission's own value of a key; None without one."""
    value = base.get(at.table)
    for step in at.inside:
        try:
            value = value[step]  # type: ignore[index]
        except (KeyError, IndexError, TypeError):
            return None
    return value


def multiplied(name: str, factor: Any, value: Any) -> Any:
    """A value, or each number of an array, times a factor. Raises DrawError, of nothing but 0 too."""
    if _is_nothing(value):
        raise DrawError(
            f"{name}: relative = true multiplies what the mission has there, which is 0"
        )
    return _multiplied(name, factor, value)


def _is_nothing(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return all(map(_is_nothing, value))
    return value == 0 and not isinstance(value, bool)


def _multiplied(name: str, factor: Any, value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_multiplied(name, factor, each) for each in value]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return factor * value
    raise DrawError(
        f"{name}: relative = true multiplies a number of the mission, which has none there"
    )


def _inside(name: str, whole: Any, steps: tuple[str | int, ...], value: Any) -> Any:
    """`whole` with one value in it replaced. Raises DrawError."""
    at = whole
    try:
        for step in steps[:-1]:
            at = at[step]
        if isinstance(steps[-1], int):
            _ = at[steps[-1]]  # raises for one that is not there
        at[steps[-1]] = value
    except (KeyError, IndexError, TypeError) as error:
        raise DrawError(f"{name}: the mission has no such place") from error
    return whole
