"""The places where the vehicle may be: areas of a fence, and how far it may go from home.

One number tells all: the margin of a place, the distance to the nearest border of what is allowed,
below 0 outside. It changes by no more than the place moves. So a vehicle with so much margin need
not be looked at before it has moved so far. A straight way is clear where it has a margin at its ends,
wherever it crosses a border of an area, and between any two of these places. Pure. Frame: Earth ENU. M.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from fcu.kernel.algebra import Vec3

Numbers = np.ndarray[Any, np.dtype[np.float64]]
Flags = np.ndarray[Any, np.dtype[np.bool_]]

TOUCHES = 1e-6  # m: a margin so small is a border
MOST_CROSSED = 64  # borders that a clear way crosses, of areas that overlap


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


class Borders:
    """The areas of a fence as arrays, to look at many places at once.

    A way of a plan costs some 0.1 ms, however many corners an area may have.
    """

    def __init__(self, areas: tuple[Area, ...]) -> None:
        polygons = [area for area in areas if isinstance(area, Polygon)]
        discs = [area for area in areas if isinstance(area, Disc)]
        ordered: list[Area] = [*polygons, *discs]
        both = [area.inclusion for area in ordered]
        self._inclusion: Flags = np.array(both, dtype=np.bool_)
        self._exclusion: Flags = np.array([not each for each in both], dtype=np.bool_)
        corners = [np.array(polygon.corners, dtype=np.float64) for polygon in polygons]
        self._first = np.cumsum([0, *map(len, corners)][:-1] if corners else [], dtype=np.intp)
        empty = np.zeros((0, 2))
        self._begin = np.concatenate([empty, *corners])
        self._end = np.concatenate([empty, *(np.roll(each, -1, axis=0) for each in corners)])
        self._along = self._end - self._begin
        square = (self._along**2).sum(axis=1)
        self._square = np.where(square > 0.0, square, 1.0)
        self._center = np.array([(disc.x, disc.y) for disc in discs]).reshape(-1, 2)
        self._radius = np.array([disc.radius for disc in discs])

    def margins(self, places: Numbers) -> Numbers:
        """The margins (k,) of places (k, 2), of the areas alone."""
        if not len(self._inclusion):
            return np.full(len(places), math.inf)
        depth = np.concatenate([self._in_polygons(places), self._in_discs(places)], axis=1)
        stay, leave = depth[:, self._inclusion], depth[:, self._exclusion]
        inside = np.full(len(places), math.inf) if not stay.shape[1] else stay.max(axis=1)
        found: Numbers = np.minimum(inside, (-leave).min(axis=1, initial=math.inf))
        return found

    def crossed(self, start: Numbers, way: Numbers) -> Numbers:
        """The parts, 0 to 1, of a straight way (2,) at which it meets a border."""
        to = self._begin - start
        across = way[0] * self._along[:, 1] - way[1] * self._along[:, 0]
        slanted = across != 0.0  # an edge along the way is met at its corners, by its neighbours
        scale = np.where(slanted, across, 1.0)
        part = (to[:, 0] * self._along[:, 1] - to[:, 1] * self._along[:, 0]) / scale
        of_edge = (to[:, 0] * way[1] - to[:, 1] * way[0]) / scale
        met = slanted & (np.abs(of_edge - 0.5) <= 0.5 + 1e-9)
        return np.concatenate([part[met], circle_crossed(start, way, self._center, self._radius)])

    def _in_polygons(self, places: Numbers) -> Numbers:
        """How deep places (k, 2) are in each polygon, below 0 outside. float64[k, polygons]"""
        if not len(self._first):
            return np.zeros((len(places), 0))
        from_begin = places[:, None, :] - self._begin
        part = np.clip((from_begin * self._along).sum(axis=2) / self._square, 0.0, 1.0)
        away = np.hypot(*np.moveaxis(from_begin - part[:, :, None] * self._along, 2, 0))
        x, y = from_begin[:, :, 0], from_begin[:, :, 1]
        rise = self._along[:, 1]
        spans = (self._begin[:, 1] > places[:, 1:]) != (self._end[:, 1] > places[:, 1:])
        slope = self._along[:, 0] / np.where(rise != 0.0, rise, 1.0)
        odd = np.add.reduceat((spans & (x < y * slope)).astype(np.intp), self._first, axis=1) % 2
        nearest: Numbers = np.minimum.reduceat(away, self._first, axis=1)
        return np.where(odd == 1, nearest, -nearest)

    def _in_discs(self, places: Numbers) -> Numbers:
        """How deep places (k, 2) are in each disc, below 0 outside. float64[k, discs]"""
        away = places[:, None, :] - self._center
        found: Numbers = self._radius - np.hypot(away[:, :, 0], away[:, :, 1])
        return found


def circle_crossed(start: Numbers, way: Numbers, centers: Numbers, radii: Numbers) -> Numbers:
    """The parts of a straight way (2,) at which it meets circles about centers (n, 2)."""
    square = float(way @ way)
    if square == 0.0 or not len(radii):
        return np.zeros(0)
    to = centers - start
    nearest = (to @ way) / square
    apart = (to[:, 0] * way[1] - to[:, 1] * way[0]) ** 2 / square
    half = np.sqrt(np.maximum(radii**2 - apart, 0.0) / square)
    met = apart <= (radii + TOUCHES) ** 2
    return np.concatenate([(nearest - half)[met], (nearest + half)[met]])


class Fence:
    """The fence of one vehicle, whether it is breached, and how often it was."""

    def __init__(self) -> None:
        self.areas = ()
        self.limits = Limits()
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
        self._borders = Borders(areas)

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
        a, b = np.array(start), np.array(end)
        way, home = b - a, np.array(self.home)
        parts = [np.array([0.0, 1.0]), self._borders.crossed(a[:2], way[:2])]
        if math.isfinite(self.limits.across):
            across = np.array([self.limits.across])
            parts.append(circle_crossed(a[:2], way[:2], home[None, :2], across))
        at = np.unique(np.clip(np.concatenate(parts), 0.0, 1.0))
        if len(at) > MOST_CROSSED:
            return False
        at = np.concatenate([at, 0.5 * (at[1:] + at[:-1])])
        places = a + at[:, None] * way
        from_home = places - home
        value = np.minimum(
            self._borders.margins(places[:, :2]),
            np.minimum(
                self.limits.across - np.hypot(from_home[:, 0], from_home[:, 1]),
                self.limits.up - from_home[:, 2],
            ),
        )
        return bool(np.all(value > TOUCHES))

    def see(self, r: Vec3, t_us: int) -> Margin:
        """Look at a place. `is_breached` afterwards says whether it is outside."""
        margin = self.margin(r)
        outside = margin.value < 0.0
        if outside and not self.is_breached:
            self.breaches += 1
            self.border, self.since_us = margin.border, t_us
        self.is_breached = outside
        return margin
