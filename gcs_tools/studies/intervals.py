"""How often a campaign's interval of success holds the truth: campaigns of a known probability.

    python -m gcs_tools.studies.intervals                    1000 campaigns of each case

The flights are random numbers; when a campaign ends, and with which interval, is decided as
`gcs campaign` decides it (`campaign.running.Ending`).
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from gcs_tools.campaigns.looks import Looks
from gcs_tools.campaigns.running import Ending
from gcs_tools.campaigns.statistics import Share, share

PROBABILITIES = 0.5, 0.9, 0.99, 0.999
WIDTHS = None, 0.08, 0.02  # that a campaign ends early at; None: it does not
FLIGHTS = 1000  # of a campaign, at most
CONFIDENCE = 0.95


@dataclass(frozen=True)
class _Flown:
    """The outcomes of flights, as a Store has them."""

    outcome: np.ndarray[Any, np.dtype[np.int8]]
    whole: np.ndarray[Any, np.dtype[np.bool_]]


def ended(outcome: np.ndarray[Any, Any], looks: Looks, confidence: float) -> Share:
    """The share at which a campaign of one law ends whose flights have these outcomes, bool[n]."""
    kept = _Flown(outcome.astype(np.int8)[None, :], np.ones(len(outcome), dtype=bool))
    ending = Ending(looks, confidence, kept)
    assert ending.look()
    assert ending.n is not None
    (found,) = ending.shares(ending.n)
    return found


def flown(p: float, n: int, seed: int, width: float | None, confidence: float) -> Share:
    """The share at the end of a campaign whose flights succeed with probability `p`."""
    outcome = np.random.default_rng([seed, n]).uniform(size=n) < p
    return ended(outcome, Looks.of(n, confidence, width), confidence)


class Covered(NamedTuple):
    """Of so many campaigns."""

    probability: float
    width: float | None
    campaigns: int
    covered: int  # whose interval holds the probability
    early: int  # that ended before their last flight
    flights: float  # on average
    peeking: int | None  # that would have: ended at the same looks, by plain intervals


def covered(p: float, width: float | None, campaigns: int) -> Covered:
    """Fly and count."""
    found = [flown(p, FLIGHTS, seed, width, CONFIDENCE) for seed in range(campaigns)]
    return Covered(
        p, width, campaigns,
        sum(each.low <= p <= each.high for each in found),
        sum(each.of < FLIGHTS for each in found),
        float(np.mean([each.of for each in found])),
        None if width is None else sum(_peeked(p, width, seed) for seed in range(campaigns)),
    )  # fmt: skip


def _peeked(p: float, width: float, seed: int) -> bool:
    """Whether the interval holds that a campaign ends with which takes no care of its looks."""
    outcome = np.random.default_rng([seed, FLIGHTS]).uniform(size=FLIGHTS) < p
    for n in Looks.of(FLIGHTS, CONFIDENCE, width).at:
        at = share(int(outcome[:n].sum()), n, CONFIDENCE)
        if at.width <= width:
            break
    return at.low <= p <= at.high


@click.command()
@click.option("--campaigns", default=1000, show_default=True, type=click.IntRange(1), help="of each case")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="a JSON object on standard output")
def main(campaigns: int, as_json: bool) -> None:
    """Fly campaigns of known probabilities; exit 1 if fewer intervals hold them than are to."""
    found = [covered(p, width, campaigns) for width, p in product(WIDTHS, PROBABILITIES)]
    least = CONFIDENCE - 4.0 * np.sqrt(CONFIDENCE * (1.0 - CONFIDENCE) / campaigns)
    if as_json:
        click.echo(json.dumps([each._asdict() for each in found], indent=1))
    else:
        table = Table("probability", "ends at width", "interval holds it", "ended early", "flights", "looked at plainly", box=None)  # fmt: skip
        for each in found:
            plain = "" if each.peeking is None else f"{each.peeking / campaigns:.1%}"
            table.add_row(
                f"{each.probability:g}", "-" if each.width is None else f"{each.width:g}",
                f"{each.covered / campaigns:.1%}", f"{each.early / campaigns:.1%}", f"{each.flights:.0f}", plain,
            )  # fmt: skip
        Console().print(table)
    sys.exit(0 if all(each.covered >= least * campaigns for each in found) else 1)


if __name__ == "__main__":
    main()
