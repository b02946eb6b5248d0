"""What explains failures: nothing does where they fall by chance, and what does is found."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from gcs_tools.campaigns.analysis import LIKELY, _of_words
from gcs_tools.campaigns.statistics import interval
from gcs_tools.pictures.plot.campaign import shrinking

WORDS = list("abcdef")
RARE = [0.9, 0.02, 0.02, 0.02, 0.02, 0.02]


@pytest.mark.computes
def test_a_word_that_few_flights_have_explains_no_failure_by_chance():
    random, found = np.random.default_rng(3), 0
    for _ in range(300):
        words = random.choice(WORDS, size=200, p=RARE).tolist()
        failed = np.zeros(200, dtype=bool)
        failed[random.choice(200, size=3, replace=False)] = True
        found += _of_words("x", words, failed).p <= LIKELY
    assert found <= 9  # of 3 expected: more with a probability below 0.4 %


def test_a_word_that_makes_flights_fail_is_found():
    words = ["calm", "storm"] * 100
    failed = np.array([word == "storm" and i % 20 < 10 for i, word in enumerate(words)])
    cause = _of_words("x", words, failed)
    assert cause.p <= 1e-3
    assert cause.effect > 0.5


def test_few_flights_are_counted_in_plain_numbers():
    for n in (30, 80, 300):
        drawn = shrinking({"a law": np.ones(n, dtype=bool)}, partial(interval, confidence=0.95))
        assert "flights" in drawn
        assert "math" not in drawn
