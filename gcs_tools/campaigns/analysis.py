"""What the flights of a campaign say: success, metrics, differences of laws, what explains failures.

Reads a table of flights (`flights.parquet`), so it says the same whoever flew them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.files import input_file
from gcs_tools.campaigns.campaign_file import Campaign
from gcs_tools.campaigns.looks import Looks
from gcs_tools.campaigns.statistics import Share, share
from gcs_tools.campaigns.store import DRAWN
from gcs_tools.judging.metrics import METRICS

Numbers = np.ndarray[Any, np.dtype[np.float64]]
Flags = np.ndarray[Any, np.dtype[np.bool_]]

QUANTILES = (0.05, 0.5, 0.95, 0.99)
WORST = 10
TABLES = 9999  # drawn by chance, that a table of words is held against
LIKELY = 0.01  # a quantity with a p-value (corrected) above this explains nothing
LOST = ("crashed", "fell", "diverged", "rejected", "aborted", "refused")


class Quantile(NamedTuple):
    """A quantile of a metric, and its interval; not a number where there are too few flights."""

    at: float
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Metric:
    """A metric over the flights of a law."""

    name: str
    n: int  # flights in which it has a value
    quantiles: tuple[Quantile, ...]


@dataclass(frozen=True)
class Cause:
    """A drawn quantity, and how its values in failed flights differ from those in the others."""

    name: str
    effect: float  # greatest difference of the two distributions, 0 to 1
    direction: (
        float  # probability that a failed flight has the greater value; not a number: no order
    )
    p: float  # of no difference at all, corrected for the number of quantities


@dataclass(frozen=True)
class Worst:
    """A flight that was worse than others."""

    number: int
    success: bool
    ended: str
    value: float | None  # of the metric that flights are ranked by
    error: str


@dataclass(frozen=True)
class OfLaw:
    """What the flights of one law say."""

    law: str
    success: Share
    endings: dict[str, int]
    missed: dict[str, int]  # of what a flight must meet: how many did not, the most first
    metrics: tuple[Metric, ...]
    causes: tuple[
        Cause, ...
    ]  # of failures, the clearest first; empty without failures or successes
    worst: tuple[Worst, ...]


@dataclass(frozen=True)
class Difference:
    """A law against the first, flight by flight."""

    law: str
    first: str
    better: int  # flights in which this one succeeds and the first does not
    worse: int
    success: float  # difference of the shares
    low: float
    high: float
    p: float  # of no difference: McNemar's exact test
    metric: str
    median: Quantile  # of the difference of the metric, in flights in which both have it


@dataclass(frozen=True)
class Analysis:
    """All of it."""

    flights: int  # of each law
    of: int  # that the campaign might have flown
    looks: Looks
    confidence: float
    laws: tuple[OfLaw, ...]
    differences: tuple[Difference, ...]

    def plain(self) -> dict[str, Any]:
        """As JSON has it: what is not a number is None."""
        found: dict[str, Any] = _plain(asdict(self))
        return found


class Flights:
    """The flights of one law, column by column, in the order of their numbers."""

    def __init__(self, table: Any, law: str) -> None:
        from pyarrow import compute

        self._table = table.filter(compute.equal(table["law"], law))
        self.number = self._table["number"].to_numpy()
        self.success: Flags = self._table["success"].to_numpy(zero_copy_only=False)
        self.ended: list[str] = self._table["ended"].to_pylist()
        self.missed: list[str] = self._table["missed"].to_pylist()
        self.error: list[str] = self._table["error"].to_pylist()

    def __len__(self) -> int:
        return len(self.number)

    def numbers(self, name: str) -> Numbers:
        """A column of numbers; not a number where a flight has none."""
        column = self._table[name].to_numpy(zero_copy_only=False)
        found: Numbers = np.asarray(column, dtype=np.float64)
        return found

    def words(self, name: str) -> list[str] | None:
        """A column of texts; None of one of numbers."""
        column = self._table[name]
        return None if str(column.type) == "double" else column.to_pylist()


def read(path: Path) -> Any:
    """The table of a campaign's flights. Raises OSError."""
    from pyarrow import parquet

    with input_file.opened(path) as file:
        return parquet.read_table(file)


def analysis(campaign: Campaign, table: Any) -> Analysis:
    """What a table of flights says."""
    document = campaign.document
    looks = campaign.looks
    of_law = {label: Flights(table, label) for label in campaign.labels}
    confidence = looks.confidence(document.confidence)
    laws = tuple(
        OfLaw(
            label,
            share(int(flights.success.sum()), len(flights), confidence),
            {word: flights.ended.count(word) for word in sorted(set(flights.ended))},
            dict(
                Counter(
                    name for of in flights.missed if of for name in of.split(", ")
                ).most_common()
            ),
            tuple(_metric(flights, name, document.confidence) for name in shown(campaign, flights)),
            causes(flights, campaign.draws.names),
            worst(flights, campaign.ranked_by, campaign.floors),
        )
        for label, flights in of_law.items()
    )
    first, *others = of_law
    differences = tuple(
        difference(
            label, of_law[label], first, of_law[first], campaign.ranked_by, document.confidence
        )
        for label in others
    )
    return Analysis(len(of_law[first]), campaign.n, looks, document.confidence, laws, differences)


def shown(campaign: Campaign, flights: Flights) -> list[str]:
    """The metrics that the file asks for; else those whose values differ."""
    if campaign.document.metrics is not None:
        return list(campaign.document.metrics)
    found = []
    for name in METRICS:
        values = flights.numbers(name)
        values = values[np.isfinite(values)]
        if len(values) and float(np.ptp(values)) > 0.0:
            found.append(name)
    return found


def _metric(flights: Flights, name: str, confidence: float) -> Metric:
    values = flights.numbers(name)
    values = values[np.isfinite(values)]
    return Metric(name, len(values), tuple(quantile(values, q, confidence) for q in QUANTILES))


def quantile(values: Numbers, at: float, confidence: float) -> Quantile:
    """A quantile with the interval of its order statistics, whatever the distribution is."""
    from scipy.stats import quantile_test

    if not len(values):
        return Quantile(at, math.nan, math.nan, math.nan)
    found = quantile_test(values, p=at).confidence_interval(confidence)
    return Quantile(at, float(np.quantile(values, at)), float(found.low), float(found.high))


def causes(flights: Flights, names: Sequence[str]) -> tuple[Cause, ...]:
    """Which drawn quantities tell failed flights from others, the clearest first.

    Of numbers: Kolmogorov and Smirnov's distance, which sees any difference, and Mann and Whitney's
    statistic for its direction. Of words: Pearson's chi-squared, and the distance in total variation.
    The p-values are corrected for their number (Holm).
    """
    failed = ~flights.success
    if not failed.any() or failed.all():
        return ()
    found = []
    for name in names:
        words = flights.words(f"{DRAWN}{name}")
        if words is None:
            found.append(_of_numbers(name, flights.numbers(f"{DRAWN}{name}"), failed))
        else:
            found.append(_of_words(name, words, failed))
    order = sorted(range(len(found)), key=lambda i: (found[i].p, -found[i].effect))
    corrected, least = [], 0.0
    for rank, i in enumerate(order):
        least = max(least, min(1.0, found[i].p * (len(found) - rank)))
        corrected.append(Cause(found[i].name, found[i].effect, found[i].direction, least))
    return tuple(corrected)


def _of_numbers(name: str, values: Numbers, failed: Flags) -> Cause:
    from scipy.stats import ks_2samp, mannwhitneyu

    known = np.isfinite(values)
    bad, good = values[failed & known], values[~failed & known]
    if not len(bad) or not len(good) or np.ptp(values[known]) == 0.0:
        return Cause(name, 0.0, 0.5, 1.0)
    found = ks_2samp(bad, good, method="asymp")
    rank = mannwhitneyu(bad, good, method="asymptotic").statistic
    return Cause(
        name, float(found.statistic), float(rank) / (len(bad) * len(good)), float(found.pvalue)
    )


def _of_words(name: str, words: Sequence[str], failed: Flags) -> Cause:
    from scipy.stats import random_table

    kinds = sorted({word for word in words if word is not None})
    of = np.array(words, dtype=object)
    table = np.array(
        [[np.sum((of == kind) & which) for kind in kinds] for which in (failed, ~failed)]
    )
    if len(kinds) < 2:
        return Cause(name, 0.0, math.nan, 1.0)
    shares = table / table.sum(axis=1, keepdims=True)
    distance = 0.5 * float(np.abs(shares[0] - shares[1]).sum())
    # chi-squared against tables of the same sums: of few failures its own distribution is far off
    expected = np.outer(table.sum(axis=1), table.sum(axis=0)) / table.sum()
    drawn = random_table(table.sum(axis=1), table.sum(axis=0), seed=1).rvs(TABLES)
    chance = (np.square(drawn - expected) / expected).sum(axis=(1, 2))
    met = float((np.square(table - expected) / expected).sum())
    p = (1 + np.count_nonzero(chance >= met * (1.0 - 1e-9))) / (1 + TABLES)
    return Cause(name, distance, math.nan, float(p))


def worst(flights: Flights, metric: str, floors: bool) -> tuple[Worst, ...]:
    """Failed flights first, those that were lost before all, then by a metric."""
    values = flights.numbers(metric)
    badness = -values if floors else values
    badness = np.where(np.isfinite(badness), badness, math.inf)
    lost = np.array([ended in LOST for ended in flights.ended])
    order = np.lexsort((flights.number, -badness, ~lost, flights.success))[:WORST]
    return tuple(
        Worst(
            int(flights.number[i]), bool(flights.success[i]), flights.ended[i],
            float(values[i]) if math.isfinite(values[i]) else None, flights.error[i],
        )
        for i in order.tolist()
    )  # fmt: skip


def difference(
    law: str, flights: Flights, first: str, reference: Flights, metric: str, confidence: float
) -> Difference:
    """A law less the first one, of the same draws.

    The interval of the difference of the shares is that of two exact ones, of the flights that only
    this law and only the first brought to success, each with half of the error: it holds for few
    flights too, and is wider than need be.
    """
    from scipy.stats import binomtest

    n = len(flights)
    better = int((flights.success & ~reference.success).sum())
    worse = int((~flights.success & reference.success).sum())
    each = 0.5 + 0.5 * confidence
    up, down = share(better, n, each), share(worse, n, each)
    p = float(binomtest(better, better + worse).pvalue) if better + worse else 1.0
    values = flights.numbers(metric) - reference.numbers(metric)
    return Difference(
        law, first, better, worse, (better - worse) / n, up.low - down.high, up.high - down.low, p,
        metric, quantile(values[np.isfinite(values)], 0.5, confidence),
    )  # fmt: skip


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return _plain(value._asdict())
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
