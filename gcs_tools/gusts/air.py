"""Winds within a greatest speed and rate: drawn, and as straight lines between knots."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

Rows = np.ndarray[Any, np.dtype[np.float64]]
Random = np.random.Generator

AXES = (*np.eye(3), *-np.eye(3))
SIDES = (
    (0, 1),
    (0, 2),
    (1, 2),
    (1, 0),
    (2, 0),
    (2, 1),
)  # of a wind that turns from one axis to the other


class Bounds(NamedTuple):
    """The greatest wind that is believed."""

    speed: float  # m/s
    rate: float  # m/s^2


def sines(random: Random, bounds: Bounds, t: Rows) -> Rows:
    """float64[n, 3], m/s, E: a steady wind and a sine along each axis, at most at the bounds."""
    steady, swing = random.normal(size=3), random.normal(size=3)
    part = random.uniform()
    steady *= part * bounds.speed / np.linalg.norm(steady)
    swing *= (1.0 - part) * bounds.speed / np.linalg.norm(swing)
    fastest = bounds.rate / max(float(np.linalg.norm(swing)), 1e-9)
    frequency = np.minimum(np.exp(random.uniform(math.log(0.3), math.log(6.0), 3)), fastest)
    phase = random.uniform(0.0, 2.0 * math.pi, 3)
    return np.asarray(steady + swing * np.sin(np.outer(t, frequency) + phase))


def steady(way: Rows, bounds: Bounds, t: Rows) -> Rows:
    """float64[n, 3]: the greatest wind along a direction of length 1."""
    return np.tile(bounds.speed * way, (len(t), 1))


def turning(first: Rows, second: Rows, bounds: Bounds, t: Rows) -> Rows:
    """float64[n, 3]: the greatest wind, which turns from `first` to `second` as fast as it may."""
    if bounds.speed <= 0.0:
        return np.zeros((len(t), 3))
    a = np.outer(t, [bounds.rate / bounds.speed])
    return np.asarray(bounds.speed * (np.cos(a) * first + np.sin(a) * second))


def family(bounds: Bounds, t: Rows, sums: int, seed: int) -> Iterator[tuple[str, Rows]]:
    """Names and winds that a search begins with: steady, turning, and `sums` drawn sums of sines."""
    for way in AXES:
        yield "steady", steady(way, bounds, t)
    for i, j in SIDES:
        yield "turning", turning(AXES[i], AXES[j], bounds, t)
    for k in range(sums):
        yield "sines", sines(np.random.default_rng([seed, k]), bounds, t)


def exceeds(air: Rows, bounds: Bounds, h: float) -> tuple[float, float]:
    """The greatest speed (m/s) and rate (m/s^2) of a wind at ticks h (s) apart, over the bounds (0/0 is 0)."""
    speed = float(np.linalg.norm(air, axis=1).max(initial=0.0))
    rate = float(np.linalg.norm(np.diff(air, axis=0), axis=1).max(initial=0.0)) / h
    return speed / max(bounds.speed, 1e-9), rate / max(bounds.rate, 1e-9)


def samples(air: Rows, h: float) -> Rows:
    """float64[m, 4], s and m/s, E: the fewest samples between which a wind at ticks h (s) apart runs straight."""
    bend = np.ones(len(air), dtype=bool)
    bend[1:-1] = np.abs(np.diff(air, 2, axis=0)).max(axis=1, initial=0.0) > 1e-9
    at = np.flatnonzero(bend)
    return np.column_stack([at * h, air[at]])
