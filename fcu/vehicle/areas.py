"""Areas of a fence: how far a place is from their borders, and which ways cross none.

Pure. Compiled, as the loop waits meanwhile. Frame: Earth, east and north. Lengths in m.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from fcu.kernel.compile import kernel

Numbers = np.ndarray[Any, np.dtype[np.float64]]

TOUCHES = 1e-6  # m: a margin so small is a border
NEARLY = 1e-9  # of an edge: so far beyond its ends it is met
MOST_CROSSED = 64  # borders that a clear way crosses, of areas that overlap
# At a border, for the ways of one plan. This bounds how long the loop waits.
MOST_LOOKS = 30_000_000


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
def _is_by(edges, i, x, y):
    """Tell whether a place touches an edge."""
    ax, ay, bx, by = edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3]
    if x < min(ax, bx) - TOUCHES or x > max(ax, bx) + TOUCHES:
        return False
    if y < min(ay, by) - TOUCHES or y > max(ay, by) + TOUCHES:
        return False
    return _apart(ax, ay, bx, by, x, y) <= TOUCHES * TOUCHES


@kernel
def margin_at(edges, first, stays, discs, x, y):
    """The distance of a place inside what the areas allow, below 0 outside.

    Of several areas to stay inside, one is enough (PX4 at 001bb4d7 asks for all). Inf without areas.
    """
    inside, value, asked = -math.inf, math.inf, False
    for k in range(stays.size):
        nearest, within = math.inf, False
        for i in range(first[k], first[k + 1]):
            apart = _apart(edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3], x, y)
            nearest = min(nearest, apart)
            within ^= _beyond(edges, i, x, y)
        depth = math.sqrt(nearest) if within else -math.sqrt(nearest)
        if stays[k] != 0.0:
            inside, asked = max(inside, depth), True
        else:
            value = min(value, -depth)
    for k in range(discs.shape[0]):
        depth = discs[k, 2] - math.hypot(x - discs[k, 0], y - discs[k, 1])
        if discs[k, 3] != 0.0:
            inside, asked = max(inside, depth), True
        else:
            value = min(value, -depth)
    return min(value, inside) if asked else value


@kernel
def _is_inside(edges, first, stays, discs, x, y):
    """Tell whether `margin_at` is above TOUCHES, for less."""
    asked, found = False, False
    for k in range(stays.size):
        if found and stays[k] != 0.0:
            continue  # one is enough
        touches, within = False, False
        for i in range(first[k], first[k + 1]):
            touches |= _is_by(edges, i, x, y)
            within ^= _beyond(edges, i, x, y)
        if stays[k] != 0.0:
            asked = True
            found |= within and not touches
        elif within or touches:
            return False
    for k in range(discs.shape[0]):
        dx, dy, radius = x - discs[k, 0], y - discs[k, 1], discs[k, 2]
        apart = dx * dx + dy * dy
        if discs[k, 3] != 0.0:
            asked = True
            found |= radius > TOUCHES and apart < (radius - TOUCHES) ** 2
        elif apart <= (radius + TOUCHES) ** 2:
            return False
    return found or not asked


@kernel
def _place(way, part):
    """The place, east and north, at a part, 0 to 1, of a way."""
    if way[4] > 0.0:
        angle = 2.0 * math.pi * part
        return way[0] + way[4] * math.cos(angle), way[1] + way[4] * math.sin(angle)
    return way[0] + part * (way[2] - way[0]), way[1] + part * (way[3] - way[1])


@kernel
def _put(parts, found, part):
    """Write a part within 0 and 1 to `parts` behind those found. How many there are now.

    More than fit are one more than fit.
    """
    if not 0.0 < part < 1.0:
        return found
    if found >= parts.size:
        return parts.size + 1
    parts[found] = part
    return found + 1


@kernel
def _straight_crossed(edges, discs, way, parts):
    """Write to `parts` where a straight way meets borders. How often, as `_put`."""
    x, y, dx, dy = way[0], way[1], way[2] - way[0], way[3] - way[1]
    found = 0
    for i in range(edges.shape[0]):
        ex, ey = edges[i, 2] - edges[i, 0], edges[i, 3] - edges[i, 1]
        to_x, to_y = edges[i, 0] - x, edges[i, 1] - y
        across = dx * ey - dy * ex
        if across == 0.0:  # an edge along the way is met at its corners, by its neighbours
            continue
        of_edge = (to_x * dy - to_y * dx) / across
        if abs(of_edge - 0.5) <= 0.5 + NEARLY:
            found = _put(parts, found, (to_x * ey - to_y * ex) / across)
    square = dx * dx + dy * dy
    for k in range(discs.shape[0]):
        to_x, to_y, radius = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2]
        apart = (to_x * dy - to_y * dx) ** 2
        if square == 0.0 or apart > (radius + TOUCHES) ** 2 * square:
            continue
        nearest = (to_x * dx + to_y * dy) / square
        half = math.sqrt(max(radius * radius - apart / square, 0.0) / square)
        found = _put(parts, found, nearest - half)
        found = _put(parts, found, nearest + half)
    return found


@kernel
def _part_of(x, y):
    """The part of a circle at which a direction from its centre is."""
    return (math.atan2(y, x) / (2.0 * math.pi)) % 1.0


@kernel
def _circle_crossed(edges, discs, way, parts):
    """Write to `parts` where a circle meets borders. How often, as `_put`."""
    x, y, radius = way[0], way[1], way[4]
    found = 0
    for i in range(edges.shape[0]):
        to_x, to_y = edges[i, 0] - x, edges[i, 1] - y
        ex, ey = edges[i, 2] - edges[i, 0], edges[i, 3] - edges[i, 1]
        square = ex * ex + ey * ey
        apart = (to_x * ey - to_y * ex) ** 2
        if square == 0.0 or apart > (radius + TOUCHES) ** 2 * square:
            continue
        nearest = -(to_x * ex + to_y * ey) / square
        half = math.sqrt(max(radius * radius - apart / square, 0.0) / square)
        for of_edge in (nearest - half, nearest + half):
            if abs(of_edge - 0.5) <= 0.5 + NEARLY:
                part = _part_of(to_x + of_edge * ex, to_y + of_edge * ey)
                found = _put(parts, found, part)
    for k in range(discs.shape[0]):
        to_x, to_y, other = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2]
        apart = math.hypot(to_x, to_y)
        if apart == 0.0 or not abs(radius - other) - TOUCHES <= apart <= radius + other + TOUCHES:
            continue
        cosine = (apart * apart + radius * radius - other * other) / (2.0 * apart * radius)
        bends = math.acos(max(-1.0, min(1.0, cosine))) / (2.0 * math.pi)
        middle = _part_of(to_x, to_y)
        found = _put(parts, found, (middle - bends) % 1.0)
        found = _put(parts, found, (middle + bends) % 1.0)
    return found


@kernel
def _sort(parts, total):
    """Sort the first `total` numbers, which are few."""
    for k in range(1, total):
        part, i = parts[k], k
        while i > 0 and parts[i - 1] > part:
            parts[i] = parts[i - 1]
            i -= 1
        parts[i] = part


@kernel
def _stays(edges, first, stays, discs, way, part):
    """Tell whether the place at a part of a way is inside."""
    x, y = _place(way, part)
    return _is_inside(edges, first, stays, discs, x, y)


@kernel
def first_crossing(edges, first, stays, discs, ways, parts):
    """The number of the first of some ways that leaves the areas or touches a border. -1: none.

    A way stays inside if its ends do, the places where it meets borders, and one between any two of these.
    One that meets more than MOST_CROSSED borders counts as leaving, and so does the way at which MOST_LOOKS
    are through: this bounds the time.

    ways : float64[k, 5], east and north of two places and 0, or the centre of a circle twice and its radius.
    parts : float64[MOST_CROSSED], scratch.
    """
    left, borders = MOST_LOOKS, edges.shape[0] + discs.shape[0]
    for k in range(ways.shape[0]):
        way = ways[k]
        joined = k > 0 and ways[k - 1, 2] == way[0] and ways[k - 1, 3] == way[1]
        goes_on = joined and way[4] == 0.0 and ways[k - 1, 4] == 0.0
        if not goes_on and not _stays(edges, first, stays, discs, way, 0.0):
            return k
        if not _stays(edges, first, stays, discs, way, 1.0):
            return k
        if way[4] > 0.0:
            met = _circle_crossed(edges, discs, way, parts)
        else:
            met = _straight_crossed(edges, discs, way, parts)
        left -= borders * (4 + 2 * met)
        if met > parts.size or left < 0:
            return k
        _sort(parts, met)
        before = 0.0
        for i in range(met + 1):
            part = parts[i] if i < met else 1.0
            if not _stays(edges, first, stays, discs, way, 0.5 * (before + part)):
                return k
            if i < met and not _stays(edges, first, stays, discs, way, part):
                return k
            before = part
    return -1


@kernel
def _keeps_clear(edges, discs, ax, ay, bx, by, kept):
    """Tell whether a straight way is so far (m) from every border."""
    square = kept * kept
    for i in range(edges.shape[0]):
        cx, cy, dx, dy = edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3]
        near = _apart(cx, cy, dx, dy, ax, ay) < square or _apart(cx, cy, dx, dy, bx, by) < square
        if near or _apart(ax, ay, bx, by, cx, cy) < square:  # its other end begins the next edge
            return False
        # the ends of each lie on both sides of the other: they cross
        of_c = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        of_d = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
        of_a = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx)
        of_b = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx)
        if (of_c > 0.0) != (of_d > 0.0) and (of_a > 0.0) != (of_b > 0.0):
            return False
    for k in range(discs.shape[0]):
        x, y, radius = discs[k, 0], discs[k, 1], discs[k, 2]
        nearest = math.sqrt(_apart(ax, ay, bx, by, x, y))
        farthest = max(math.hypot(ax - x, ay - y), math.hypot(bx - x, by - y))
        if nearest < radius + kept and farthest > radius - kept:
            return False
    return True


@kernel
def measure(edges, first, stays, discs, starts, ends, kept, mirrored, lengths):
    """Write the lengths of the straight ways between places to `lengths`. Inf: too near a border, or outside.

    starts, ends : float64[n, 2] and float64[m, 2].  lengths : float64[n, m].
    kept : the distance from every border that a way keeps.  mirrored : the ends are the starts.
    """
    for i in range(starts.shape[0]):
        x, y = starts[i, 0], starts[i, 1]
        inside = _is_inside(edges, first, stays, discs, x, y)
        for k in range(i if mirrored else 0, ends.shape[0]):
            to_x, to_y = ends[k, 0], ends[k, 1]
            clear = inside and _keeps_clear(edges, discs, x, y, to_x, to_y, kept)
            lengths[i, k] = math.hypot(to_x - x, to_y - y) if clear else math.inf
            if mirrored:
                lengths[k, i] = lengths[i, k]
