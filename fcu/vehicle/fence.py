"""The places where the vehicle may be: areas of a fence, and how far it may go from home.

One number tells all: the margin of a place, the distance to the nearest border of what is allowed,
below 0 outside. It changes by no more than the place moves. So a vehicle with so much margin need
not be looked at before it has moved so far, and a straight way is clear where the margin at its
middle is greater than half its length. Pure. Frame: Earth ENU. M.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import IntEnum
from typing import NamedTuple

from fcu.kernel.algebra import Vec3

FINEST = 0.05  # m of a way: shorter ones are not halved again
TOUCHES = 1e-6  # m: a margin so small is a border


class Polygon(NamedTuple):
    """An area by its corners, east and north."""

    inclusion: bool
    corners: tuple[tuple[float, float], ...]

    def inside(self, x: float, y: float) -> float:
        """The distance of a place inside, below 0 outside."""
        nearest, within = math.inf, False
        ax, ay = self.corners[-1]
        for bx, by in self.corners:
            dx, dy = bx - ax, by - ay
            square = dx * dx + dy * dy
            part = 0.0
            if square > 0.0:
                part = max(0.0, min(1.0, ((x - ax) * dx + (y - ay) * dy) / square))
            nearest = min(nearest, math.hypot(x - ax - part * dx, y - ay - part * dy))
            if (ay > y) != (by > y) and x < ax + (y - ay) * dx / dy:
                within = not within
            ax, ay = bx, by
        return nearest if within else -nearest


class Disc(NamedTuple):
    """An area by its centre, east and north, and its radius."""

    inclusion: bool
    x: float
    y: float
    radius: float

    def inside(self, x: float, y: float) -> float:
        """The distance of a place inside, below 0 outside."""
        return self.radius - math.hypot(x - self.x, y - self.y)


Area = Polygon | Disc


class Limits(NamedTuple):
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


def margin_of(areas: Iterable[Area], limits: Limits, home: Vec3, r: Vec3) -> Margin:
    """The margin of a place. Of several areas to stay inside, one is enough, as for PX4."""
    inside, has_inclusion, value = -math.inf, False, math.inf
    for area in areas:
        depth = area.inside(r.x, r.y)
        if area.inclusion:
            inside, has_inclusion = max(inside, depth), True
        else:
            value = min(value, -depth)
    if has_inclusion:
        value = min(value, inside)
    value = min(value, limits.across - math.hypot(r.x - home.x, r.y - home.y))
    above = limits.up - (r.z - home.z)
    if above < value:
        return Margin(above, Breach.HIGHEST)
    return Margin(value, Breach.NONE if math.isinf(value) else Breach.BORDER)


class Fence:
    """The fence of one vehicle, whether it is breached, and how often it was."""

    def __init__(self) -> None:
        self.areas: tuple[Area, ...] = ()
        self.limits = Limits()
        self.home = Vec3(0.0, 0.0, 0.0)
        self.is_breached = False
        self.breaches = 0
        self.border = Breach.NONE  # of the last breach
        self.since_us = 0

    @property
    def is_set(self) -> bool:
        """Tell whether there is any place where the vehicle must not be."""
        return bool(self.areas) or self.limits != Limits()

    def margin(self, r: Vec3) -> Margin:
        """The margin of a place."""
        return margin_of(self.areas, self.limits, self.home, r) if self.is_set else FREE

    def is_clear(self, start: Vec3, end: Vec3) -> bool:
        """Tell whether the straight way between two places stays inside, and touches no border."""
        if not self.is_set:
            return True
        ways = [(start, end)]
        while ways:
            a, b = ways.pop()
            half = 0.5 * math.dist(a, b)
            middle = 0.5 * (a + b)
            value = self.margin(middle).value
            if value > half:
                continue
            if value <= TOUCHES:
                return False
            if 2.0 * half > FINEST:
                ways += [(a, middle), (middle, b)]
        return True

    def see(self, r: Vec3, t_us: int) -> Margin:
        """Look at a place. `is_breached` afterwards says whether it is outside."""
        margin = self.margin(r)
        outside = margin.value < 0.0
        if outside and not self.is_breached:
            self.breaches += 1
            self.border, self.since_us = margin.border, t_us
        self.is_breached = outside
        return margin
