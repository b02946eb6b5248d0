"""Intervals: where a known mean lies, and of what there is none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from gcs_tools.campaigns.margins import between
from gcs_tools.campaigns.statistics import Interval, mean


def test_the_interval_of_a_mean_is_that_of_students_t():
    values = np.random.default_rng(1).normal(3.0, 2.0, 200)
    found = mean(values.tolist())
    low, high = stats.t.interval(0.95, 199, loc=values.mean(), scale=stats.sem(values))
    assert found.value == pytest.approx(values.mean())
    assert found.low == pytest.approx(low, abs=1e-9)
    assert found.high == pytest.approx(high, abs=1e-9)


def test_intervals_cover_the_truth_about_as_often_as_they_say():
    random = np.random.default_rng(2)
    found = [mean(random.exponential(1.0, 60).tolist()) for _ in range(100)]
    covered = sum(each.low <= 1.0 <= each.high for each in found)
    assert 86 <= covered <= 99  # 95 of 100, less what skew costs


@pytest.mark.parametrize("n", [3, 5])
def test_an_interval_of_few_flights_covers_the_mean_too(n):
    """A percentile bootstrap covers 77 of 100 with three, 83 with five."""
    random = np.random.default_rng(4)
    found = [mean(random.normal(1.0, 0.3, n).tolist()) for _ in range(400)]
    covered = sum(each.low <= 1.0 <= each.high for each in found)
    assert 0.92 <= covered / len(found) <= 0.98


def test_the_same_values_give_the_same_interval_and_no_order_matters():
    values = np.random.default_rng(3).normal(size=20).tolist()
    assert mean(values) == mean(values)
    assert mean([0.5] * 9) == Interval(0.5, 0.5, 0.5)


def test_of_too_few_flights_there_is_no_interval():
    value, low, high = mean([2.0])
    assert value == 2.0
    assert math.isnan(low) and math.isnan(high)
    assert all(map(math.isnan, mean([])))
    assert not mean([2.0]).excludes_zero


@pytest.mark.parametrize("limit", [1.0, 1.4, 3.0, 9.9])
def test_a_margin_is_found_by_bisection(limit):
    held, lost = between(lambda x: x <= limit, 1.0, 10.0, 1.5, 0.05)
    assert held is not None and lost is not None
    assert held <= limit < lost <= 1.05 * held + 1e-12


def test_a_margin_may_lie_outside_what_is_tried():
    assert between(lambda x: True, 1.0, 10.0, 1.5, 0.05) == (10.0, None)
    assert between(lambda x: False, 1.0, 10.0, 1.5, 0.05) == (None, 1.0)


def test_values_within_a_tick_are_told_apart_no_further():
    tried = []

    def holds(x):
        tried.append(x)
        return x <= 0.0061

    held, lost = between(holds, 0.004, 0.5, 1.5, 1e-9, apart=0.002)
    assert held <= 0.0061 < lost <= held + 0.002
    assert len(tried) < 6
