"""Intervals of success: exact, and as good where a campaign ends early."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binomtest

from gcs_tools.campaigns.looks import RATIO, Looks
from gcs_tools.campaigns.running import Ending
from gcs_tools.campaigns.statistics import at_least, interval, share
from gcs_tools.studies.intervals import flown

CAMPAIGNS = 1000
CONFIDENCE = 0.9


@pytest.mark.parametrize("p", [0.5, 0.9, 0.99])
@pytest.mark.parametrize("width", [None, 0.08])
@pytest.mark.computes
def test_the_interval_covers_the_known_probability(p, width):
    found = [flown(p, 1000, seed, width, CONFIDENCE) for seed in range(CAMPAIGNS)]
    covered = sum(each.low <= p <= each.high for each in found)
    # of 1000 campaigns at 90 %: 900 less four standard deviations
    assert covered >= 862
    ended_early = sum(each.of < 1000 for each in found)
    assert (ended_early > 0) == (width is not None and p > 0.5)


def test_an_end_that_peeks_with_plain_intervals_would_not_cover():
    """What the looks' parts of the error are for: without them, ends follow the outcomes."""
    looks, p, missed = Looks.of(1000, CONFIDENCE, 0.1).at, 0.97, [0, 0]
    for seed in range(CAMPAIGNS):
        success = np.random.default_rng(seed).uniform(size=1000) < p
        for i, confidence in enumerate((CONFIDENCE, Looks(looks, 0.1).confidence(CONFIDENCE))):
            shares = [share(int(success[:n].sum()), n, confidence) for n in looks]
            missed[i] += any(not each.low <= p <= each.high for each in shares)
    plain, parted = missed
    assert plain > 150  # of 100 that are allowed
    assert parted <= 138


def test_looks_are_at_fixed_numbers_the_last_at_all():
    looks = Looks.of(10_000, 0.95, 0.01)
    assert looks.at[-1] == 10_000
    assert all(b / a <= RATIO + 0.01 for a, b in zip(looks.at, looks.at[1:], strict=False))
    # before the first, not even flights that all succeed have an interval so narrow
    confidence = looks.confidence(0.95)
    assert share(looks.at[0], looks.at[0], confidence).width <= 0.01
    assert Looks.of(10_000, 0.95).at == (10_000,)
    assert Looks.of(10_000, 0.95).confidence(0.95) == 0.95


def test_a_campaign_does_not_end_before_a_flight_that_is_missing():
    n = 1000
    store = SimpleNamespace(outcome=np.ones((1, n), dtype=np.int8), whole=np.ones(n, dtype=bool))
    looks = Looks.of(n, CONFIDENCE, 0.05)
    store.whole[looks.at[0] - 1] = False
    ending = Ending(looks, CONFIDENCE, store)
    assert not ending.look()
    store.whole[:] = True
    assert ending.look()
    assert ending.n == looks.at[0]


def test_an_exact_interval_is_the_one_of_clopper_and_pearson():
    found = share(9, 10, 0.95)
    assert (round(found.low, 4), round(found.high, 4)) == (0.5550, 0.9975)  # their table
    for successes, of in ((0, 1), (1, 1), (0, 30), (17, 40), (9999, 10_000)):
        theirs = binomtest(successes, of).proportion_ci(0.99, method="exact")
        assert interval(successes, of, 0.99) == pytest.approx(theirs, abs=1e-9)
    assert share(0, 10, 0.95).low == 0.0
    assert share(10, 10, 0.95).high == 1.0
    # 299 flights without a failure show 99 %, 298 do not: ln(0.05) / ln(0.99) = 298.07
    assert at_least(299, 299, 0.95) >= 0.99 > at_least(298, 298, 0.95)
