"""The way from one place to another that keeps inside a fence: straight, or around what is in between.

The shortest way around areas bends at their corners. So the places to bend at stand a little aside from
corners. The straight ways between them that keep clear of all borders are measured once for a fence, and
the shortest chain of them is flown (Dijkstra). Pure. Frame: Earth ENU. M.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from fcu.kernel.algebra import Vec3
from fcu.vehicle.areas import Area, Polygon, borders_of, margin_at, measure

Numbers = np.ndarray[Any, np.dtype[np.float64]]

KEPT = (3.0, 1.0)  # distances from the borders: the first at which there is a way
OWN = 0.99  # of the margin of a start or an end nearer than that: what the way to it keeps
ASIDE = 1.05  # of it: the distance of a bend from its corner
MOST_CORNERS = 128  # of a fence: its bends, two a corner at most, are looked at with each other
ROUND = 12  # bends about a circle


class Detours:
    """The ways about the areas of one fence."""

    def __init__(self, areas: tuple[Area, ...]) -> None:
        self._borders = borders_of(areas)
        few = len(self._borders.edges) + ROUND * len(self._borders.discs) <= MOST_CORNERS
        self._areas = areas if few else ()
        self._graphs: dict[float, tuple[Numbers, Numbers]] = {}  # bends and ways, by distance kept
        self._graph(KEPT[0])

    def way(self, start: Vec3, end: Vec3, home: Vec3, across: float) -> list[Vec3] | None:
        """The places to fly through after `start`, at its height, with `end` as the last. None: no way.

        It is straight where that keeps clear.  across : the distance from home that bends may have.
        """
        a, b = np.array([start[:2]]), np.array([end[:2]])
        of_a, of_b = (OWN * margin_at(*self._borders, *r[:2]) for r in (start, end))
        if not min(of_a, of_b) > 0.0:
            return None
        for kept in KEPT:
            if self._lengths(a, b, min(kept, of_a, of_b))[0, 0] < math.inf:
                return [end]
            bends, between = self._graph(kept)
            first = self._lengths(a, bends, min(kept, of_a))[0]
            last = self._lengths(bends, b, min(kept, of_b))[:, 0]
            far = np.hypot(*(bends - home[:2]).T) > across - kept
            first[far] = last[far] = math.inf
            chain = shortest(first, np.where(far, math.inf, between), last)
            if chain is not None:
                at = [Vec3(float(bends[k, 0]), float(bends[k, 1]), start.z) for k in chain]
                return [*at, end]
        return None

    def _graph(self, kept: float) -> tuple[Numbers, Numbers]:
        if kept not in self._graphs:
            beside = [r for area in self._areas for r in _bends(area, ASIDE * kept)]
            bends = np.array(beside).reshape(-1, 2)
            self._graphs[kept] = bends, self._lengths(bends, bends, kept, mirrored=True)
        return self._graphs[kept]

    def _lengths(
        self, starts: Numbers, ends: Numbers, kept: float, mirrored: bool = False
    ) -> Numbers:
        found = np.empty((len(starts), len(ends)))
        measure(*self._borders, starts, ends, kept, mirrored, found)
        return found


def _bends(area: Area, aside: float) -> Iterator[tuple[float, float]]:
    """The places beside the corners of an area, on the outer side of each turn."""
    if not isinstance(area, Polygon):
        radius = (area.radius + aside) / math.cos(math.pi / ROUND)  # also between two bends
        for k in range(ROUND):
            angle = 2.0 * math.pi * k / ROUND
            yield area.x + radius * math.cos(angle), area.y + radius * math.sin(angle)
        return
    corners = [corner for k, corner in enumerate(area.corners) if corner != area.corners[k - 1]]
    for k, (x, y) in enumerate(corners):
        before, after = corners[k - 1], corners[(k + 1) % len(corners)]
        comes, goes = (x - before[0], y - before[1]), (after[0] - x, after[1] - y)
        side = math.copysign(1.0, comes[0] * goes[1] - comes[1] * goes[0])  # 1: it turns left
        ahead, on = _unit(*comes), _unit(*goes)
        out = side * ahead[1], -side * ahead[0]
        out_on = side * on[1], -side * on[0]
        along = out[0] * out_on[0] + out[1] * out_on[1]
        if along >= 0.0:  # a turn by a right angle at most: one bend
            far = aside / (1.0 + along)
            yield x + far * (out[0] + out_on[0]), y + far * (out[1] + out_on[1])
            continue
        yield x + aside * (out[0] + ahead[0]), y + aside * (out[1] + ahead[1])
        yield x + aside * (out_on[0] - on[0]), y + aside * (out_on[1] - on[1])


def _unit(x: float, y: float) -> tuple[float, float]:
    far = math.hypot(x, y)
    return x / far, y / far


def shortest(first: Numbers, between: Numbers, last: Numbers) -> list[int] | None:
    """The chain of places with the least way. None: there is none.

    first, last : float64[n], from the start to each place, and from each to the end.
    between : float64[n, n], from each to each. Inf: no way.
    """
    away, before = first.copy(), np.full(len(first), -1)
    left = np.ones(len(first), dtype=np.bool_)
    while (open_to := np.where(left, away, math.inf)).min(initial=math.inf) < math.inf:
        here = int(np.argmin(open_to))
        left[here] = False
        longer = away[here] + between[here]
        nearer = left & (longer < away)
        away[nearer], before[nearer] = longer[nearer], here
    total = away + last
    if not len(total) or not math.isfinite(total.min()):
        return None
    chain = [int(np.argmin(total))]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return chain[::-1]
