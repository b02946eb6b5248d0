"""A campaign that looks for rare failures: its stages flown, and what the flights that count say."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gcs_tools.campaigns.campaign_file import Campaign
from gcs_tools.campaigns.rare import Estimate, Mixture, Numbers, estimate, search
from gcs_tools.campaigns.running import Stage, Told, Workers, run
from gcs_tools.campaigns.store import SUCCESS, Store


@dataclass(frozen=True)
class Typical:
    """A quantity, without importance and in the flights that fail."""

    name: str
    median: Any
    of_failures: Any  # the median by weight; None without failures


@dataclass(frozen=True)
class RareFound:
    """What was found."""

    estimate: Estimate
    confidence: float
    levels: tuple[
        float, ...
    ]  # of each stage: its worst tenth is so much beyond the limit (< 0: not)
    flown: int  # flights in all
    plain_flights: float  # that would be needed for an interval as narrow, drawn without importance
    typical: tuple[Typical, ...]

    def plain(self) -> dict[str, Any]:
        """As JSON has it."""
        found = asdict(self)
        found["estimate"] = {**self.estimate._asdict(), "doubt": self.estimate.doubt}
        found["plain_flights"] = self.plain_flights if math.isfinite(self.plain_flights) else None
        return found


def fly(campaign: Campaign, store: Store, workers: Workers, told: Told) -> RareFound:
    """Fly what is missing of it. Raises as `run` does."""
    draws, d = campaign.draws, len(campaign.draws.drawn)

    def flown(stage: int, mixture: Mixture, n: int) -> tuple[range, Numbers]:
        draws.proposals[stage] = mixture
        store.keep_proposals()
        numbers = range(stage * draws.stage, stage * draws.stage + n)
        run(campaign, store, workers, Stage(store, numbers), told)
        return numbers, np.array([draws.z(number) for number in numbers]).reshape(n, d)

    def severity(stage: int, mixture: Mixture) -> tuple[Numbers, Numbers]:
        numbers, z = flown(stage, mixture, draws.stage)
        return z, _severity(campaign, store, numbers)

    mixture, levels = search(severity, d, draws.stages, draws.seed)
    numbers, z = flown(draws.stages, mixture, campaign.document.flights or 0)
    weights = mixture.weights(z)
    failed = store.outcome[0, numbers.start : numbers.stop] != SUCCESS
    found = estimate(weights, failed.astype(np.float64), campaign.document.confidence)
    return RareFound(
        found, campaign.document.confidence, tuple(levels), len(levels) * draws.stage + len(numbers),
        _plain_flights(found, campaign.document.confidence),
        tuple(_typical(campaign, numbers, weights, failed)),
    )  # fmt: skip


def _severity(campaign: Campaign, store: Store, numbers: range) -> Numbers:
    """How far beyond the limit each flight is: 0 or more for one that failed."""
    rare = campaign.document.rare
    assert rare is not None
    part = slice(numbers.start, numbers.stop)
    value, failed = store.metric[0, part], store.outcome[0, part] != SUCCESS
    beyond = value - rare.limit if rare.limit is not None else (rare.at_least or 0.0) - value
    beyond = np.where(np.isfinite(beyond), beyond, math.inf)
    found: Numbers = np.where(failed, np.maximum(beyond, 0.0), np.minimum(beyond, -1e-300))
    return found


def _plain_flights(found: Estimate, confidence: float) -> float:
    from scipy.special import ndtri

    half = found.high - found.probability  # the lower end may be cut off at 0
    p, z = found.probability, float(ndtri(0.5 + 0.5 * confidence))
    return z * z * p * (1.0 - p) / (half * half) if half > 0.0 and p > 0.0 else math.inf


def _typical(
    campaign: Campaign, numbers: range, weights: Numbers, failed: np.ndarray[Any, Any]
) -> list[Typical]:
    found = []
    drawn = [campaign.draws.quantities(n) for n, bad in zip(numbers, failed, strict=True) if bad]
    of = weights[failed]
    for key, distribution in campaign.draws.drawn:
        if distribution.is_choice:
            continue
        values = np.array([each[key.name] for each in drawn], dtype=np.float64)
        order = np.argsort(values)
        half = np.searchsorted(np.cumsum(of[order]), 0.5 * of.sum()) if len(values) else 0
        middle = distribution.at(np.array([0.5]))[0]
        found.append(Typical(key.name, middle, float(values[order[half]]) if len(values) else None))
    return found
