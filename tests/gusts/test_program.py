"""The linear program: within its bounds, and no worse than what is known to be best."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_tools.gusts.air import Bounds
from gcs_tools.gusts.program import DIRECTIONS, least, within

BOUNDS = Bounds(12.0, 20.0)
KNOTS, APART = 21, np.full(20, 0.05)
STILL = np.zeros((KNOTS, 3))


def gradient(seed):
    g = np.random.default_rng(seed).normal(size=(KNOTS + 4, 3))
    return np.stack([np.convolve(axis, np.full(5, 0.2), mode="valid") for axis in g.T], axis=1)


def kept(velocities, bounds=BOUNDS):
    speeds = np.linalg.norm(velocities, axis=1)
    rates = np.linalg.norm(np.diff(velocities, axis=0), axis=1) / 0.05
    return speeds.max() <= bounds.speed and rates.max() <= bounds.rate * (1.0 + 1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_a_wind_is_within_its_bounds_and_better_than_any_drawn(seed):
    g = gradient(seed)
    found = least(g, APART, BOUNDS, STILL, BOUNDS.speed, keeps_head=False)
    assert kept(found)
    random = np.random.default_rng(seed)
    drawn = [within(12.0 * random.normal(size=(KNOTS, 3)), APART, BOUNDS) for _ in range(100)]
    assert all(map(kept, drawn))
    assert (g * found).sum() < min((g * w).sum() for w in drawn)


@pytest.mark.parametrize(
    "way", [*np.eye(3), np.array([0.6, 0.0, -0.8]), np.array([0.3, 0.5, 0.81])]
)
def test_what_asks_for_one_direction_gets_the_greatest_speed_against_it(way):
    """Also between the directions of the polyhedron, where planes have to be added."""
    way = way / np.linalg.norm(way)
    found = least(np.tile(way, (KNOTS, 1)), APART, BOUNDS, STILL, BOUNDS.speed, keeps_head=False)
    assert (found @ -way).min() > 0.97 * BOUNDS.speed


def test_a_wind_turns_round_as_fast_as_it_may():
    """For a push that changes its sign once it is at the one speed before, at the other after, as the rate has it."""
    g = np.zeros((KNOTS, 3))
    g[:10, 0], g[11:, 0] = 1.0, -1.0
    found = least(g, APART, BOUNDS, STILL, BOUNDS.speed, keeps_head=False)
    best = -2.0 * sum(range(1, 11))  # 1 m/s each knot, from -10 to 10
    assert best <= (g * found).sum() < 0.93 * best


def test_the_head_stays_and_nothing_is_farther_than_it_may_be():
    near = np.tile([3.0, 0.0, 0.0], (KNOTS, 1))
    found = least(gradient(1), APART, BOUNDS, near, 0.5, keeps_head=True)
    assert found[0] == pytest.approx([3.0, 0.0, 0.0], abs=1e-6)
    assert np.abs(found - near).max() <= 0.5 + 1e-6


def test_directions_are_all_around():
    assert np.linalg.norm(DIRECTIONS, axis=1) == pytest.approx(np.ones(98))
    assert DIRECTIONS.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
