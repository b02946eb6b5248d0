"""The worst wind: what is foretold is flown, and it is worse than what is drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fcu.guard import margin
from gcs_tools.gusts import air, worst_wind
from gcs_tools.gusts.air import Bounds
from gcs_tools.gusts.ends import DRAGS, at, ends
from gcs_tools.gusts.limits import LIMITS, facets, outputs, rooms
from gcs_tools.gusts.program import least
from gcs_tools.gusts.responses import knots, response
from gcs_tools.gusts.worst_wind import (
    Begin,
    Vehicle,
    bounds_of,
    gone_on,
    moved,
    parts_of,
    searches,
)

T = 2000


def begin(hover, end, name, wind):
    room = Vehicle(hover, end).fly(wind, hover.ticks)
    parts = parts_of(hover, 1)
    return Begin(end, name, wind, np.array([room[a:b].min(axis=0) for a, b in parts]))


@pytest.mark.parametrize("limit", LIMITS)
@pytest.mark.computes
def test_what_is_foretold_of_a_small_change_is_flown(hover, weakest, limit):
    """In a steady wind, for a mass in the middle: at its ends a projection bends what m_hat does."""
    vehicle, of = Vehicle(hover, weakest._replace(mass_kg=8.0)), knots(T, 0.002)
    here = np.tile([4.0, -2.0, 1.0], (len(of.at), 1))
    answer = response(vehicle.flight, here, of, T)
    facet = facets(vehicle.scene, limit, answer.out)[0]
    by_wind = answer.by_wind @ facet.gradient
    there = least(by_wind, of.apart, Bounds(12.0, 20.0), here, 0.05, keeps_head=False)
    foretold = float((by_wind * (there - here)).sum())
    vehicle.fly(of.air(there, hover.ticks), hover.ticks)
    flown = facet.value(outputs(vehicle.flight.law_rows[T : T + 1])[0]) - facet.value(answer.out)
    assert foretold < -0.005
    assert flown == pytest.approx(foretold, rel=0.03)


@pytest.mark.computes
def test_the_worst_wind_is_worse_than_fifty_drawn_and_within_belief(hover, weakest):
    bounds, part = bounds_of(hover), parts_of(hover, 1)[0]
    t = np.arange(hover.ticks) / hover.rate_hz
    steady = begin(hover, weakest, "steady", air.steady(np.array([1.0, 0.0, 0.0]), bounds, t))
    first = searches(hover, steady, "torque", part, 2)
    found = min((gone_on(hover, search, 5) for search in first), key=lambda s: s.found.room)
    vehicle = Vehicle(hover, weakest)
    drawn = [
        vehicle.fly(air.sines(np.random.default_rng(k), bounds, t), hover.ticks)[part[0] :, 3].min()
        for k in range(50)
    ]
    assert found.found.room < min(drawn) - 10.0
    assert found.found.room < float(steady.rooms[0, 3]) - 10.0
    speed, rate = air.exceeds(found.worst, Bounds(hover.guard.w_max, hover.guard.w_dot_max), 0.002)
    assert 0.9 < speed <= 1.0
    assert 0.9 < rate <= 1.0
    assert not found.found.saturated  # hover holds what the guard promises
    # and it is flown again by its samples
    samples = air.samples(found.worst, 0.002)
    again = np.stack([np.interp(t, samples[:, 0], v) for v in samples.T[1:]], axis=1)
    assert vehicle.judged(vehicle.fly(again, part[1])[:, 3], part).room == pytest.approx(
        found.found.room, abs=1e-3
    )


@pytest.mark.computes
def test_a_wind_is_moved_to_where_in_the_flight_it_is_worst(level, weakest):
    """A gust against the way, that comes after the vehicle has stopped, is moved to where it is fast."""
    part, bounds = parts_of(level, 1)[0], bounds_of(level)
    t = np.arange(level.ticks) / level.rate_hz
    gust = -np.clip(bounds.rate * (t - 11.0), 0.0, bounds.speed)
    wind = np.stack([gust, 0.0 * t, 0.0 * t], axis=1)
    late = searches(level, begin(level, weakest, "late", wind), "tilt", part, 1)[0]
    late = replace(late, found=Vehicle(level, weakest).judged(
        Vehicle(level, weakest).fly(wind, part[1])[:, LIMITS.index("tilt")], part
    ))  # fmt: skip
    found = moved(level, late)
    assert found.found.room < late.found.room - 1.0
    assert found.tick < late.found.tick
    again = Vehicle(level, weakest).fly(found.worst, part[1])[:, LIMITS.index("tilt")]
    assert again[found.tick] == found.found.room == pytest.approx(found.value, abs=0.5)


@pytest.mark.computes
def test_the_same_flight_finds_the_same_wind(hover, monkeypatch):
    monkeypatch.setattr(worst_wind, "FIRST_ROUNDS", 1)
    monkeypatch.setattr(worst_wind, "ROUNDS", 2)
    monkeypatch.setattr(worst_wind, "ends", lambda scene: ends(scene)[:3])
    once, again = (worst_wind.worst_winds(hover, 1, ["thrust_down"], sums=2) for _ in range(2))
    assert once[0].samples.tobytes() == again[0].samples.tobytes()
    assert once[0].computed_n == again[0].computed_n
    (found,) = once
    assert found.computed_n <= found.begun_n <= found.drawn_n < found.still_n
    assert found.end.mass_kg == 7.0


def test_no_wind_is_searched_where_none_is_believed(hover, weakest):
    calm = begin(hover, weakest, "still", np.zeros((hover.ticks, 3)))
    told = hover.settings._replace(guard=hover.guard._replace(w_max=0.0))
    assert searches(replace(hover, settings=told), calm, "tilt", (250, hover.ticks), 1) == []


def test_ends_are_those_of_what_is_believed(hover):
    found = ends(hover)
    guard = hover.guard
    assert len(found) == len(set(found)) == 2 * len(DRAGS) * 2
    assert {e.mass_kg for e in found} == {guard.m_min, guard.m_max}
    assert {e.rotor_lag_s for e in found} == {0.02, 0.08}
    assert max(max(e.drag) for e in found) == guard.c_D
    params = at(hover, found[0]).world.params
    assert params.m == params.m_after == found[0].mass_kg
    assert params.decay == pytest.approx(np.exp(-params.h / found[0].rotor_lag_s))


def test_each_room_is_the_least_of_its_facets(hover):
    """At demands inside and outside: touched by one, and by none undercut, for facets that do not move."""
    random, known = np.random.default_rng(1), margin.known(hover.guard, hover.law)
    for _ in range(50):
        out = np.array(
            [*random.normal(0, 30, 2), random.uniform(20, 180), 0, *random.normal(0, 8, 2)]
        )
        out[3] = np.linalg.norm(out[:3])
        room = dict(zip(LIMITS, rooms(hover, out[None])[0], strict=True))
        for limit in ("thrust_down", "torque", "thrust_up"):
            assert min(f.value(out) for f in facets(hover, limit, out)) == pytest.approx(
                room[limit]
            )
        tilt = min(f.value(out) for f in facets(hover, "tilt", out))
        assert room["tilt"] - 1e-9 <= tilt <= room["tilt"] + 0.03 * known.T_max


def test_winds_that_a_search_begins_with_are_within_the_bounds(hover):
    bounds, t = bounds_of(hover), np.arange(hover.ticks) / hover.rate_hz
    for name, wind in air.family(bounds, t, 20, 3):
        speed, rate = air.exceeds(wind, bounds, 0.002)
        assert speed <= 1.0 + 1e-9, name
        assert rate <= 1.0 + 1e-9, name
