"""The places where the vehicle may be: areas of a fence, and how far it may go from home.

One number tells all: the margin of a place, the distance to the nearest border of what is allowed,
below 0 outside. It changes by no more than the place moves. So a vehicle with so much margin need
not be looked at before it has moved so far. Pure. Frame: Earth ENU. M.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from fcu.kernel.algebra import Vec3
from fcu.vehicle.areas import TOUCHES, Area, borders_of, first_crossing, margin_at
from fcu.vehicle.detour import Detours


class Way(NamedTuple):
    """From a place straight to another, or a level circle about both. M, E."""

    start: Vec3
    end: Vec3
    radius: float = 0.0


class FenceLimits(NamedTuple):
    """Distances from home at which the vehicle may be. Inf: as far as it likes."""

    across: float = math.inf
    up: float = math.inf


class Breach(IntEnum):
    """FENCE_BREACH: what was crossed."""

    NONE = 0
    HIGHEST = 2
    BORDER = 3


class Margin(NamedTuple):
    """The distance of a place from the border of what is allowed, below 0 outside. Which border."""

    value: float
    border: Breach


FREE = Margin(math.inf, Breach.NONE)


class Fence:
    """The fence of one vehicle, whether it is breached, and how often it was."""

    def __init__(self) -> None:
        self.areas = ()
        self.limits = FenceLimits()
        self.home = Vec3(0.0, 0.0, 0.0)
        self.is_breached = False
        self.breaches = 0
        self.border = Breach.NONE  # of the last breach
        self.since_us = 0

    @property
    def areas(self) -> tuple[Area, ...]:
        """The areas to stay inside and outside."""
        return self._areas

    @areas.setter
    def areas(self, areas: tuple[Area, ...]) -> None:
        self._areas = areas
        self._borders = borders_of(areas)
        self._detours = Detours(areas)

    def warm_up(self) -> None:
        """Load what looks at places and ways."""
        margin_at(*self._borders, 0.0, 0.0)
        first_crossing(*self._borders, np.zeros((0, 5)))
        self._detours.way(self.home, self.home, self.home, math.inf)

    @property
    def is_set(self) -> bool:
        """Tell whether there is any place where the vehicle must not be."""
        return bool(self.areas) or self.limits != FenceLimits()

    def margin(self, r: Vec3) -> Margin:
        """The margin of a place."""
        if not self.is_set:
            return FREE
        value = min(margin_at(*self._borders, r.x, r.y), self._across(r))
        above = self._above(r)
        if above < value:
            return Margin(above, Breach.HIGHEST)
        return Margin(value, Breach.NONE if math.isinf(value) else Breach.BORDER)

    def _across(self, r: Vec3) -> float:
        return self.limits.across - math.hypot(r.x - self.home.x, r.y - self.home.y)

    def _above(self, r: Vec3) -> float:
        return self.limits.up - (r.z - self.home.z)

    def first_outside(self, ways: Sequence[Way]) -> int | None:
        """The number of the first way that does not stay inside, or that touches a border. None: none."""
        if not self.is_set:
            return None
        across = np.array([(a.x, a.y, b.x, b.y, r) for a, b, r in ways]).reshape(-1, 5)
        crossing = int(first_crossing(*self._borders, across))
        looked = ways if crossing < 0 else ways[:crossing]
        beyond = (k for k, way in enumerate(looked) if not self._is_within(way))
        return next(beyond, None if crossing < 0 else crossing)

    def _is_within(self, way: Way) -> bool:
        """Tell whether a way keeps the limits. What they allow is convex: the ends tell."""
        return all(
            self._across(r) - way.radius > TOUCHES and self._above(r) > TOUCHES
            for r in (way.start, way.end)
        )

    def is_clear(self, start: Vec3, end: Vec3) -> bool:
        """Tell whether the straight way between two places stays inside, and touches no border."""
        return self.first_outside([Way(start, end)]) is None

    def way(self, start: Vec3, end: Vec3) -> list[Vec3] | None:
        """The places to fly through to `end` so that the way stays inside. None: there is no way.

        It keeps a few metres from the borders where that can be. Height is not looked at.
        """
        if not self.is_set:
            return [end]
        found = self._detours.way(start, end, self.home, self.limits.across)
        straight = found is None and self.first_outside([Way(start, end)]) is None
        return [end] if straight else found

    def see(self, r: Vec3, t_us: int) -> Margin:
        """Look at a place. `is_breached` afterwards says whether it is outside."""
        margin = self.margin(r)
        outside = margin.value < 0.0
        if outside and not self.is_breached:
            self.breaches += 1
            self.border, self.since_us = margin.border, t_us
        self.is_breached = outside
        return margin
