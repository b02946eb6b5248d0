"""Many flights: what is drawn from a seed, and in which order results come."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from gcs_tools.campaigns.flights import LawFlightOrder, accepted_draws, chunked, each, flown, fly
from gcs_tools.flight import law_alone, law_flights
from gcs_tools.flight.law_flights import Keep
from gcs_tools.flight.run import prepared
from gcs_tools.recording.table import Table


def uniform(random):
    return float(random.uniform())


def test_a_seed_draws_the_same_and_counts_what_is_rejected():
    kept, rejected = accepted_draws(uniform, lambda x: x < 0.5, 100, seed=7)
    assert len(kept) == 100
    assert max(kept) < 0.5
    assert accepted_draws(uniform, lambda x: x < 0.5, 100, seed=7) == (kept, rejected)
    everything, none = accepted_draws(uniform, lambda x: True, 100 + rejected, seed=7)
    assert none == 0
    assert [x for x in everything if x < 0.5] == kept
    assert accepted_draws(uniform, lambda x: x < 0.5, 100, seed=8)[0] != kept


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


@pytest.mark.parametrize("n", [None, 1, 7, 100])
def test_chunks_are_whole_and_in_order(n):
    chunks = []

    def work(some):
        chunks.append(len(some))
        return [2 * item for item in some]

    assert list(chunked(work, range(50), n)) == [2 * item for item in range(50)]
    assert sum(chunks) == 50
    assert max(chunks) <= min(n or 64, 50)


def test_no_flights_give_no_results():
    assert list(chunked(list, [])) == []
    assert fly([]) == []


NAMES = ("outputs.T_c", "setpoint.r_c")


def scene_of(f_m, duration_s=0.3):
    return prepared("paper_nominal", [f"flight.duration_s={duration_s}", f"law.f_m={f_m}"])[1]


def seen(flight):
    """Its thrust, and what it was asked for."""
    return flight.scene.law.f_m, flight.lasted, flight.law["outputs.T_c"].tobytes()


@pytest.mark.parametrize("in_lanes", [False, True])
@pytest.mark.computes
def test_what_is_found_stands_at_its_item_and_is_that_of_each_flight_alone(monkeypatch, in_lanes):
    flew = []
    each_of = law_flights.each

    def told(*arguments, **more):
        for i, one in each_of(*arguments, **more):
            flew.append(one.in_lanes)
            yield i, one

    monkeypatch.setattr(law_flights, "each", told)
    monkeypatch.setattr(law_flights, "is_compiled", lambda *kind: in_lanes)

    def flights_of(f_m):
        return 8 * (round(10.0 * f_m) % 3)  # whole groups of lanes, 4 or 8 wide

    def asked(f_m):
        scenes = (scene_of(f_m, 0.1 + 0.02 * n) for n in range(flights_of(f_m)))
        return [LawFlightOrder(scene, seen) for scene in scenes]

    items = [0.8 + 0.1 * i for i in range(4)]
    found = list(flown(asked, items, Keep(plant=(), law=NAMES)))
    assert sum(flew) == (len(flew) if in_lanes else 0)
    assert [len(each) for each in found] == [flights_of(f_m) for f_m in items]
    for f_m, of_item in zip(items, found, strict=True):
        for asked_for, one in zip(asked(f_m), of_item, strict=True):
            rows = Table.of(asked_for.scene.flown.ticks.Tick, law_alone.fly(asked_for.scene)[1])
            assert one == (f_m, True, np.ascontiguousarray(rows["outputs.T_c"]).tobytes())


@pytest.mark.parametrize(("items", "in_lanes"), [(10, 0), (20, 40)])
def test_a_study_is_flown_in_lanes_if_all_of_it_repays_them(monkeypatch, items, in_lanes):
    """Not each chunk of it: none has more than 100 ticks."""
    beside = []
    monkeypatch.setattr(law_flights, "REPAID", 150)
    monkeypatch.setattr(law_flights, "is_compiled", lambda *kind: False)
    monkeypatch.setattr(law_flights, "_beside", lambda scenes, *more: beside.extend(scenes) or {})
    one = LawFlightOrder(scene_of(1.0, 0.01), lambda flight: flight.ticks)
    assert list(flown(lambda item: [one, one], range(items))) == [[5, 5]] * items
    assert len(beside) == in_lanes


def test_a_flight_that_fails_is_raised():
    def look(flight):
        raise ValueError("seen")

    with pytest.raises(ValueError, match="seen"):
        list(flown(lambda item: [LawFlightOrder(scene_of(1.0, 0.01), look)], range(3)))
