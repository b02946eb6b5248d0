"""Many flights: what is drawn from a seed, and in which order results come."""

from __future__ import annotations

import threading

import pytest

from gcs_tools.many.flights import drawn, each


def uniform(random):
    return float(random.uniform())


def test_a_seed_draws_the_same_and_counts_what_is_rejected():
    kept, rejected = drawn(uniform, lambda x: x < 0.5, 100, seed=7)
    assert len(kept) == 100
    assert max(kept) < 0.5
    assert drawn(uniform, lambda x: x < 0.5, 100, seed=7) == (kept, rejected)
    everything, none = drawn(uniform, lambda x: True, 100 + rejected, seed=7)
    assert none == 0
    assert [x for x in everything if x < 0.5] == kept
    assert drawn(uniform, lambda x: x < 0.5, 100, seed=8)[0] != kept


def test_results_come_in_the_order_of_the_items():
    later = threading.Event()

    def work(item):
        if item == 0:  # ends after the second has
            assert later.wait(10.0)
        if item == 1:
            later.set()
        return item * item

    assert list(each(work, range(20))) == [item * item for item in range(20)]


def test_a_failure_is_raised_at_its_item():
    found = each(lambda item: 1 / (3 - item), range(100))
    assert [next(found) for _ in range(3)] == [1 / 3, 1 / 2, 1.0]
    with pytest.raises(ZeroDivisionError):
        next(found)
