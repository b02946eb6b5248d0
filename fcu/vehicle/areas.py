"""Areas of a fence: how far a place is from their borders, and which ways keep clear of them.

A vehicle has to be inside every area to stay inside, as for PX4 at 001bb4d7, and outside all others. So a way is
clear if it begins inside and comes near no border. Pure. Compiled, as the loop waits meanwhile. Frame: Earth, east
and north. Lengths in m.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from fcu.kernel.compile import kernel

Numbers = np.ndarray[Any, np.dtype[np.float64]]

TOUCHES = 1e-6  # m: a margin so small is a border


class Polygon(NamedTuple):
    """An area by its corners, east and north."""

    inclusion: bool
    corners: tuple[tuple[float, float], ...]


class Disc(NamedTuple):
    """An area by its centre, east and north, and its radius."""

    inclusion: bool
    x: float
    y: float
    radius: float


Area = Polygon | Disc


class Borders(NamedTuple):
    """The borders of areas, as compiled code reads them. Areas to stay inside have 1, others 0.

    edges : float64[n, 4], from a corner (east, north) to the next, of all polygons one behind the other.
    first : intp[p + 1], the first edge of each polygon, and n.
    stays : float64[p].
    discs : float64[m, 4], east, north, radius, and whether to stay inside.
    """

    edges: Any
    first: Any
    stays: Any
    discs: Any


def borders_of(areas: tuple[Area, ...]) -> Borders:
    """The Borders of areas."""
    polygons = [area for area in areas if isinstance(area, Polygon)]
    discs = [area for area in areas if isinstance(area, Disc)]
    corners = [np.array(polygon.corners, dtype=np.float64) for polygon in polygons]
    edges = [np.concatenate([each, np.roll(each, -1, axis=0)], axis=1) for each in corners]
    return Borders(
        edges=np.concatenate([np.zeros((0, 4)), *edges]),
        first=np.cumsum([0, *map(len, corners)]).astype(np.intp),
        stays=np.array([polygon.inclusion for polygon in polygons], dtype=np.float64),
        discs=np.array(
            [(disc.x, disc.y, disc.radius, disc.inclusion) for disc in discs], dtype=np.float64
        ).reshape(-1, 4),
    )


@kernel
def _apart(ax, ay, bx, by, x, y):
    """The square of the distance of a place from the straight line between two others, m^2."""
    dx, dy = bx - ax, by - ay
    square, part = dx * dx + dy * dy, 0.0
    if square > 0.0:
        part = max(0.0, min(1.0, ((x - ax) * dx + (y - ay) * dy) / square))
    away_x, away_y = x - ax - part * dx, y - ay - part * dy
    return away_x * away_x + away_y * away_y


@kernel
def _beyond(edges, i, x, y):
    """Tell whether a ray from a place to the east crosses an edge: an odd number of times from inside."""
    ay, by = edges[i, 1], edges[i, 3]
    if (ay > y) == (by > y):
        return False
    return x < edges[i, 0] + (y - ay) * (edges[i, 2] - edges[i, 0]) / (by - ay)


@kernel
def margin_at(edges, first, stays, discs, x, y):
    """The distance of a place inside what the areas allow, below 0 outside. Inf without areas."""
    value = math.inf
    for k in range(stays.size):
        nearest, within = math.inf, False
        for i in range(first[k], first[k + 1]):
            apart = _apart(edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3], x, y)
            nearest = min(nearest, apart)
            within ^= _beyond(edges, i, x, y)
        depth = math.sqrt(nearest) if within else -math.sqrt(nearest)
        value = min(value, depth if stays[k] != 0.0 else -depth)
    for k in range(discs.shape[0]):
        depth = discs[k, 2] - math.hypot(x - discs[k, 0], y - discs[k, 1])
        value = min(value, depth if discs[k, 3] != 0.0 else -depth)
    return value


@kernel
def _is_within(edges, first, stays, discs, x, y):
    """Tell whether a place that is on no border is inside, for less than `margin_at`."""
    for k in range(stays.size):
        within = False
        for i in range(first[k], first[k + 1]):
            within ^= _beyond(edges, i, x, y)
        if within != (stays[k] != 0.0):
            return False
    for k in range(discs.shape[0]):
        within = (x - discs[k, 0]) ** 2 + (y - discs[k, 1]) ** 2 < discs[k, 2] ** 2
        if within != (discs[k, 3] != 0.0):
            return False
    return True


@kernel
def _meets(cx, cy, dx, dy, ax, ay, bx, by, kept):
    """Tell whether a straight way, from a to b, comes nearer than `kept` to an edge, from c to d."""
    across = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) > 0.0
    beyond = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax) > 0.0
    before = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx) > 0.0
    behind = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx) > 0.0
    if across != beyond and before != behind:  # the ends of each lie on both sides of the other
        return True
    nearest = min(_apart(cx, cy, dx, dy, ax, ay), _apart(cx, cy, dx, dy, bx, by))
    nearest = min(nearest, _apart(ax, ay, bx, by, cx, cy), _apart(ax, ay, bx, by, dx, dy))
    return nearest <= kept * kept


@kernel
def _reaches(nearest, farthest, radius, kept):
    """Tell whether what lies at these distances, squared, comes nearer than `kept` to a circle."""
    inner = max(radius - kept, 0.0)
    return nearest <= (radius + kept) ** 2 and farthest >= inner * inner


@kernel
def _straight_keeps(edges, discs, ax, ay, bx, by, kept):
    """Tell whether a straight way keeps farther than that from every border."""
    along_x, along_y = bx - ax, by - ay
    wide = kept * math.hypot(along_x, along_y)
    for i in range(edges.shape[0]):
        cx, cy, dx, dy = edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3]
        of_c = along_x * (cy - ay) - along_y * (cx - ax)
        of_d = along_x * (dy - ay) - along_y * (dx - ax)
        aside = (of_c > wide and of_d > wide) or (of_c < -wide and of_d < -wide)
        if not aside and _meets(cx, cy, dx, dy, ax, ay, bx, by, kept):
            return False
    for k in range(discs.shape[0]):
        x, y = discs[k, 0], discs[k, 1]
        farthest = max((ax - x) ** 2 + (ay - y) ** 2, (bx - x) ** 2 + (by - y) ** 2)
        if _reaches(_apart(ax, ay, bx, by, x, y), farthest, discs[k, 2], kept):
            return False
    return True


@kernel
def _circle_keeps(edges, discs, x, y, radius, kept):
    """Tell whether a circle about a place keeps farther than that from every border."""
    for i in range(edges.shape[0]):
        ax, ay, bx, by = edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3]
        farthest = max((ax - x) ** 2 + (ay - y) ** 2, (bx - x) ** 2 + (by - y) ** 2)
        if _reaches(_apart(ax, ay, bx, by, x, y), farthest, radius, kept):
            return False
    for k in range(discs.shape[0]):
        apart, other = math.hypot(discs[k, 0] - x, discs[k, 1] - y), discs[k, 2]
        if abs(radius - other) - kept <= apart <= radius + other + kept:
            return False
    return True


@kernel
def first_crossing(edges, first, stays, discs, ways):
    """The number of the first of some ways that is not clear, or that touches a border. -1: none.

    ways : float64[k, 5], east and north of two places and 0, or the centre of a circle twice and its radius.
    """
    for k in range(ways.shape[0]):
        x, y, to_x, to_y, radius = ways[k, 0], ways[k, 1], ways[k, 2], ways[k, 3], ways[k, 4]
        if radius > 0.0:
            clear = _circle_keeps(edges, discs, x, y, radius, TOUCHES)
        else:
            clear = _straight_keeps(edges, discs, x, y, to_x, to_y, TOUCHES)
        if not clear or not _is_within(edges, first, stays, discs, x + radius, y):
            return k
    return -1


@kernel
def measure(edges, first, stays, discs, starts, ends, kept, mirrored, lengths):
    """Write the lengths of the straight ways between places to `lengths`. Inf: too near a border, or outside.

    starts, ends : float64[n, 2] and float64[m, 2].  lengths : float64[n, m].
    kept : the distance from every border that a way keeps.  mirrored : the ends are the starts.
    """
    for i in range(starts.shape[0]):
        x, y = starts[i, 0], starts[i, 1]
        inside = _is_within(edges, first, stays, discs, x, y)
        for k in range(i if mirrored else 0, ends.shape[0]):
            to_x, to_y = ends[k, 0], ends[k, 1]
            clear = inside and _straight_keeps(edges, discs, x, y, to_x, to_y, kept)
            lengths[i, k] = math.hypot(to_x - x, to_y - y) if clear else math.inf
            if mirrored:
                lengths[k, i] = lengths[i, k]
