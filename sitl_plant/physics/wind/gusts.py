"""Discrete gusts of 1-cosine shape. MIL-F-8785C, 3.7.2.3, and MIL-HDBK-1797, 4.9.2."""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3
from fcu.kernel.compile import kernel

WIDTH = 7  # of a row: begin, rise, hold, fall (s), velocity (m/s, E)


@kernel
def share(t, rise, hold, fall):
    """Share of a gust that blows at time t (s) after its begin: 0 to 1 and back to 0."""
    if t <= 0.0 or t >= rise + hold + fall:
        return 0.0
    if t < rise:
        return 0.5 * (1.0 - math.cos(math.pi * t / rise))
    if t <= rise + hold:
        return 1.0
    return 0.5 * (1.0 + math.cos(math.pi * (t - rise - hold) / fall))


@kernel
def velocity(rows, t):
    """Sum of gusts (m/s, E) at time t (s).  rows : float64[n, WIDTH]."""
    v = Vec3(0.0, 0.0, 0.0)
    for i in range(rows.shape[0]):
        of = share(t - rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3])
        v = v + of * Vec3(rows[i, 4], rows[i, 5], rows[i, 6])
    return v
