"""Flights held against those of a baseline.

Flights of one mission are held against each other. With the same seeds in both, winds and noise are the
same too: what differs is the change's doing, and a metric is worse when its mean is, by more than a
tolerance. With other seeds a metric is worse when its mean is beyond the interval in which the baseline
expects it. Of shares of time the mean is that of their square roots, squared: the spread of roots does not
grow with the share.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gcs_tools.judging.comparison import RECORDING, RESULT, ComparedFlight, unequal
from gcs_tools.judging.first_difference import Parted, first_difference
from gcs_tools.judging.junit_report import Case
from gcs_tools.judging.metrics import FLOORS, METRICS
from gcs_tools.missions.flight_table import HELD
from gcs_tools.recording.reader import RecordingError

LEVEL = (
    0.99  # of the interval: all metrics of a mission together are within it, if nothing has changed
)
TOLERANCE = 0.005  # of the baseline's mean, by which a metric may be worse
LEAST = 1e-6  # in a metric's unit: less is no difference
TOLD = 3  # flights that are told of one by one
RESAMPLES = 19_999  # of flights that change sides
FEWEST = 3  # flights of a baseline that give an interval
_NOT_TOLD = "flight.seed", "flight.duration_s"


class RegressionError(ValueError):
    """Flights that cannot be held against a baseline: why, and what to do."""


@dataclass(frozen=True)
class Worse:
    """One metric that is worse than the baseline's."""

    metric: str
    value: float | None  # mean of the flights; None: it has no value any more
    baseline: float  # mean of the baseline's
    limit: float  # from which it is worse

    def __str__(self) -> str:
        """The metric's value, and the one that it may have."""
        bound = "at least" if self.metric in FLOORS else "at most"
        now = "no value" if self.value is None else f"{self.value:.6g}"
        return (
            f"{self.metric} {now}, expected {bound} {self.limit:.6g} (baseline {self.baseline:.6g})"
        )


@dataclass(frozen=True)
class Held:
    """The flights of one mission, held against those of the baseline."""

    mission: str
    flights: int
    baseline_flights: int
    by: str  # seeds: pairs with the same seed; interval: of the baseline; exact: to the bit
    worse: tuple[Worse, ...] = ()
    failed: tuple[
        str, ...
    ] = ()  # sentences: flights that fail and passed, that are missing, that part
    changed: dict[str, list[str]] = field(
        default_factory=dict
    )  # key -> value, value of the baseline
    parted: tuple[tuple[str, Parted], ...] = ()  # flight -> where it leaves the baseline's

    @property
    def passed(self) -> bool:
        """True if nothing is worse."""
        return not self.worse and not self.failed

    def lines(self) -> list[str]:
        """A sentence for each thing that is worse, and then for each changed value."""
        told = [*self.failed[:TOLD], *map(str, self.worse)]
        if more := len(self.failed[TOLD:]):
            told.insert(TOLD, f"and {more} flights more")
        return [*told, *self._changes()] if told else []

    def _changes(self) -> list[str]:
        return [
            f"changed: {key} = {now or 'none'}, was {was or 'none'}"
            for key, (now, was) in self.changed.items()
        ]

    def case(self) -> Case:
        """As a test case. Its name does not depend on the outcome."""
        lines = self.lines()
        return Case(
            "regression", self.mission, 0.0, failure="; ".join(lines[:3]), text="\n".join(lines)
        )


def held_against(
    flights: Sequence[ComparedFlight],
    baseline: Sequence[ComparedFlight],
    exact: bool = False,
    tolerance: float = TOLERANCE,
) -> list[Held]:
    """Each mission of the baseline, with what is worse. Raises RegressionError.

    A run without a verdict is refused, and a recording alone is not.
    exact : to the bit.  tolerance : part of the baseline's mean, for flights with the same seeds.
    """
    missions = list(dict.fromkeys(each.mission for each in baseline))
    if not {each.mission for each in flights} & set(missions):
        flown = ", ".join(dict.fromkeys(each.mission for each in flights))
        raise RegressionError(
            f"no mission in common: flown {flown}; baseline {', '.join(missions)}"
        )
    for each in (*flights, *baseline):
        if each.passed is None and each.path.is_dir():
            raise RegressionError(
                f"{each.path}: this run has no verdict (its {RESULT} is missing or cannot be read): fly it again"
            )
    hold = _exactly if exact else _by_metrics
    found = []
    for mission in missions:
        mine = [each for each in flights if each.mission == mission]
        theirs = [each for each in baseline if each.mission == mission]
        if not mine:
            failed = (f"not flown: {mission} is in the baseline alone",)
            found.append(
                Held(mission, 0, len(theirs), "exact" if exact else "seeds", failed=failed)
            )
        else:
            found.append(hold(mission, mine, theirs, tolerance))
    return found


def _changed(
    mine: Sequence[ComparedFlight], theirs: Sequence[ComparedFlight]
) -> dict[str, list[str]]:
    """Values and versions in force that differ, of the first flight of each."""
    one, other = mine[0], theirs[0]
    values = {key: value for key, value in unequal([one, other]).items() if key not in _NOT_TOLD}
    names = dict.fromkeys([*one.versions, *other.versions])
    versions = {
        f"version of {name}": [one.versions.get(name, ""), other.versions.get(name, "")] for name in names
        if one.versions.get(name) != other.versions.get(name)
    }  # fmt: skip
    return values | versions


def _pairs(
    mission: str, mine: Sequence[ComparedFlight], theirs: Sequence[ComparedFlight]
) -> list[tuple[ComparedFlight, ComparedFlight]]:
    """Flights with the same seed. Empty unless each of the flights has one. Raises RegressionError."""
    of_seed: dict[int | None, ComparedFlight] = {}
    for each in theirs:
        if each.seed in of_seed:
            raise RegressionError(
                f"{each.path}: a second flight of {mission} with seed {each.seed} in the baseline"
            )
        of_seed[each.seed] = each
    if any(each.seed not in of_seed or each.seed is None for each in mine):
        return []
    return [(each, of_seed[each.seed]) for each in mine]


def _is_by_wall(flight: ComparedFlight) -> bool:
    """True of a flight by a script that kept the wall's clock: another with its seed is another flight."""
    if flight.by_wall:
        return True
    script = flight.values.get("flight.script", "None")
    return script != "None" and flight.values.get("flight.pace") != HELD


def _failures(
    mine: Sequence[ComparedFlight], theirs: Sequence[ComparedFlight], paired: bool
) -> list[str]:
    """Flights that fail and passed with the same seed, or that fail more often than those of other seeds."""
    passed = [each.passed is not False for each in theirs]
    if not paired and not all(passed):
        now, was = (sum(each.passed is False for each in of) for of in (mine, theirs))
        more = _is_more_often(now, len(mine), was, len(theirs))
        return [f"{now} of {len(mine)} flights fail, {was} of {len(theirs)} did"] if more else []
    if not paired:
        passed = [True] * len(mine)
    return [
        f"{each.name} failed: {each.why}" for each, did in zip(mine, passed, strict=True)
        if did and each.passed is False
    ]  # fmt: skip


def _is_more_often(now: int, flights: int, was: int, baseline: int) -> bool:
    """Tell whether `now` of some flights are more than `was` of the baseline's lead one to expect (Fisher)."""
    from scipy.stats import hypergeom

    return bool(hypergeom.sf(now - 1, flights + baseline, now + was, flights) < 1.0 - LEVEL)


def _by_metrics(
    mission: str, mine: Sequence[ComparedFlight], theirs: Sequence[ComparedFlight], tolerance: float
) -> Held:
    by_wall = any(map(_is_by_wall, (*mine, *theirs)))
    pairs = [] if by_wall else _pairs(mission, mine, theirs)
    if by_wall and len(theirs) < FEWEST:
        raise RegressionError(
            f"{mission}: a script flew by the clock of the wall, and so no two flights are the same: hold them"
            f" against a baseline of {FEWEST} flights at least, or fly both with its time held (pace ="
            ' "held", gcs test --held; a library with threads of its own, as MAVSDK, keeps the clock of the'
            " wall then, too)"
        )
    if not pairs and len(theirs) < FEWEST:
        raise RegressionError(
            f"{mission}: the baseline has {len(theirs)} flight(s), with other seeds: fly the same seeds, "
            f"or a baseline of {FEWEST} flights at least (gcs fly {mission} --seed 1..20)"
        )
    if pairs:
        theirs = [was for _, was in pairs]
    wanted = [
        name for name in METRICS if any(each.metrics.get(name) is not None for each in theirs)
    ]
    worse = []
    for name in wanted:
        before, now = _values(name, theirs), _values(name, mine)
        if pairs:
            lost = any(
                b.metrics.get(name) is not None and a.metrics.get(name) is None for a, b in pairs
            )
            both = [(a, b) for a, b in pairs if a.metrics.get(name) is not None]
            now = _values(name, [a for a, _ in both])
            before = _values(name, [b for _, b in both]) or before
        if not pairs and len(before) < FEWEST:
            raise RegressionError(
                f"{mission}: {name} has a value in {len(before)} of the baseline's {len(theirs)} flights,"
                f" and an interval takes {FEWEST}: fly more flights for the baseline"
            )
        if not pairs:
            without, were = len(mine) - len(now), len(theirs) - len(before)
            lost = (
                without > 0 if were == 0 else _is_more_often(without, len(mine), were, len(theirs))
            )
        limit = _limit(name, before, len(now), bool(pairs), len(wanted), tolerance)
        mean = _mean(name, now, bool(pairs)) if now and not lost else None
        sign = -1.0 if name in FLOORS else 1.0
        beyond = mean is not None and sign * (mean - limit) > 0.0
        if beyond and not pairs:
            beyond = _is_beyond_chance(name, before, now, len(wanted))
        if lost or beyond:
            worse.append(Worse(name, mean, _mean(name, before, bool(pairs)), limit))
    return Held(
        mission, len(mine), len(theirs), "seeds" if pairs else "interval", tuple(worse),
        tuple(_failures(mine, theirs, bool(pairs))), _changed(mine, theirs),
    )  # fmt: skip


def _is_beyond_chance(
    name: str, before: Sequence[float], now: Sequence[float], metrics: int
) -> bool:
    """Tell whether flights that change sides at random differ so rarely. True where they are too few to tell.

    Flights leave Student's interval more often than it says where a metric is 0 but for a few of them.
    """
    from scipy.stats import permutation_test

    rare = (1.0 - LEVEL) / metrics
    if math.comb(len(before) + len(now), len(now)) * rare < 1.0:
        return True
    sign = -1.0 if name in FLOORS else 1.0
    of = [
        np.sqrt(each) if _is_by_roots(name, False) else np.asarray(each) for each in (now, before)
    ]
    found = permutation_test(
        of, lambda x, y, axis: sign * (x.mean(axis) - y.mean(axis)), vectorized=True,
        alternative="greater", n_resamples=RESAMPLES, rng=np.random.default_rng(0),
    )  # fmt: skip
    return bool(found.pvalue < rare)


def _values(name: str, flights: Sequence[ComparedFlight]) -> list[float]:
    """The values of a metric, of the flights that have one."""
    return [value for each in flights if (value := each.metrics.get(name)) is not None]


def _is_by_roots(name: str, paired: bool) -> bool:
    return name.endswith("_fraction") and not paired


def _mean(name: str, values: Sequence[float], paired: bool) -> float:
    """The mean of a metric, of shares of time with other seeds that of their roots, squared."""
    if _is_by_roots(name, paired):
        return float(np.sqrt(values).mean()) ** 2
    return math.fsum(values) / len(values)


def _limit(
    name: str, before: Sequence[float], flights: int, paired: bool, metrics: int, tolerance: float
) -> float:
    """From which on the mean of so many flights is worse than the baseline's."""
    sign = -1.0 if name in FLOORS else 1.0
    mean, n = _mean(name, before, paired), len(before)
    limit = mean + sign * max(tolerance * abs(mean), LEAST)
    if paired or n == 1 or not flights:
        return limit
    from scipy.special import stdtrit

    quantile = float(stdtrit(n - 1, 1.0 - (1.0 - LEVEL) / metrics))
    is_share = _is_by_roots(name, paired)
    values = np.sqrt(before) if is_share else np.asarray(before)
    room = quantile * float(np.std(values, ddof=1)) * math.sqrt(1.0 / flights + 1.0 / n)
    edge = float(values.mean()) + sign * room
    return sign * max(sign * limit, sign * (edge * edge if is_share else edge))


def _exactly(
    mission: str,
    mine: Sequence[ComparedFlight],
    theirs: Sequence[ComparedFlight],
    _tolerance: float,
) -> Held:
    pairs = _pairs(mission, mine, theirs)
    if not pairs:
        raise RegressionError(f"{mission}: --exact wants the seeds of the baseline")
    failed, parted = [], []
    for now, was in pairs:
        if now.trajectory_sha256 and now.trajectory_sha256 == was.trajectory_sha256:
            continue
        try:
            where = first_difference(_recording(now.path), _recording(was.path))
        except RecordingError as error:
            if not (now.trajectory_sha256 and was.trajectory_sha256):
                raise RegressionError(str(error)) from error
            failed.append(f"{now.name} differs from {was.name}; where is not known: {error}")
            continue
        if where is not None:
            parted.append((now.name, where))
            failed.append(f"{now.name} {where}")
        elif now.trajectory_sha256 and was.trajectory_sha256:
            failed.append(f"{now.name} differs from {was.name}, between recorded ticks")
    return Held(
        mission, len(mine), len(pairs), "exact", (), tuple(failed), _changed(mine, [pairs[0][1]]),
        tuple(parted),
    )  # fmt: skip


def _recording(path: Path) -> Path:
    if path.is_dir():
        return path / RECORDING
    return path.parent / RECORDING if path.suffix == ".json" else path
