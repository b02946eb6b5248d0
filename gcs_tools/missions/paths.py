"""Paths in space and time: along a line with rounded corners, a spline, or a recorded track.

A path begins and ends at rest, but for a recorded one, which has the times that were recorded. Its
speed is the greatest that keeps the acceleration, along and across, within a limit; a mean over
SMOOTH_S then bounds how fast the acceleration changes. Frame: Earth East-North-Up; SI.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

Rows = np.ndarray[Any, np.dtype[np.float64]]

SMOOTH_S = 0.5  # over which the place along a path is averaged
REVERSAL_DEG = 150.0  # a corner that turns farther is a stop
LONGEST_S = 3600.0  # as a flight lasts, at most
CLOSE_M = 1e-6  # two points that are no farther apart are one

_TURNS_BACK = 2.0 * math.sin(math.radians(0.5 * REVERSAL_DEG))  # between directions of length 1
_SLOWEST = 0.02  # of what a curve's parameter moves by on average: below it turns on a point
_LOOKS, _MOST_LOOKS = 200, 40_000  # places at which a piece of a curve, and all of it, is looked at
_REPAIRS = 8  # of a speed that the mean takes into a bend
_STEP_S = 0.01  # between instants at which the place along a path is known
# A corner is a curve of degree five between points on either line, CUT apart of the way to the
# corner: no curvature at its ends. Half way it passes the corner at SAGITTA of that way times
# the length of the change of direction: (16 - 25 CUT) / 32.
_CUT = 0.4
_SAGITTA = (16.0 - 25.0 * _CUT) / 32.0


class PathError(ValueError):
    """A path that cannot be flown: why, and of which point or sample (None: of none)."""

    def __init__(self, why: str, at: int | None = None) -> None:
        super().__init__(why)
        self.at = at


class Moving(NamedTuple):
    """Position, m, velocity, m/s, and acceleration, m/s^2, float64 (n, 3) each, E."""

    r: Rows
    v: Rows
    a: Rows


@dataclass(frozen=True)
class Path:
    """Where to be at which time."""

    duration_s: float
    _at: Callable[[Rows], Moving]

    def at(self, t: Rows) -> Moving:
        """At times (n,), s from its begin; after its end it rests there."""
        inside = np.clip(t, 0.0, self.duration_s)
        found = self._at(inside)
        over = (t >= self.duration_s)[:, None]
        return Moving(found.r, np.where(over, 0.0, found.v), np.where(over, 0.0, found.a))


def rounded(points: Rows, corner_m: float, speed: float, acceleration: float) -> Path:
    """Straight from point to point, each corner passed at `corner_m` at most.

    points : float64 (n, 3), m, E.  speed : m/s, at most.  acceleration : m/s^2, at most.
    Raises PathError.
    """
    from scipy.interpolate import BPoly  # takes 0.2 s, and few missions have a path

    lengths = _lengths(points)
    ways = np.diff(points, axis=0)
    along = ways / lengths[:, None]
    turns = np.linalg.norm(np.diff(along, axis=0), axis=1)
    cuts = np.zeros(len(points))  # how far from a point its corner begins
    stops = np.zeros(len(points), bool)
    for i, turn in enumerate(turns.tolist(), start=1):
        if turn > _TURNS_BACK:
            stops[i] = True
        elif turn > 1e-9:
            cuts[i] = min(corner_m / (_SAGITTA * turn), 0.5 * lengths[i - 1], 0.5 * lengths[i])
    pieces: list[Rows] = []
    knots = [0.0]  # of the curve's parameter, by which it is everywhere as fast where pieces join
    stands: list[int] = []  # pieces after which it stands
    for i in range(len(ways)):
        begin, end = points[i] + cuts[i] * along[i], points[i + 1] - cuts[i + 1] * along[i]
        if np.linalg.norm(end - begin) > CLOSE_M:
            pieces.append(np.linspace(begin, end, 6))
            knots.append(knots[-1] + float(np.linalg.norm(end - begin)))
        if cuts[i + 1] > 0.0:
            before, after = points[i + 1] - end, along[i + 1] * cuts[i + 1]
            pieces.append(
                np.array([
                    end, end + _CUT * before, end + 2.0 * _CUT * before,
                    points[i + 1] + (1.0 - 2.0 * _CUT) * after,
                    points[i + 1] + (1.0 - _CUT) * after, points[i + 1] + after,
                ])
            )  # fmt: skip
            knots.append(knots[-1] + 5.0 * _CUT * float(cuts[i + 1]))
        if stops[i + 1]:
            stands.append(len(pieces))
    curve = BPoly(np.stack(pieces, axis=1), np.array(knots))
    return _timed(curve, stands, speed, acceleration)


def spline(points: Rows, speed: float, acceleration: float) -> Path:
    """A smooth curve through all points: cubic, twice differentiable. As `rounded`.

    Where it turns back it stands: a curve ends there, and another begins.
    """
    from scipy.interpolate import CubicSpline, PPoly

    steps = np.sqrt(_lengths(points))  # centripetal: no loops
    knots = np.concatenate([[0.0], np.cumsum(steps)])
    along = np.diff(points, axis=0) / _lengths(points)[:, None]
    turns = np.linalg.norm(np.diff(along, axis=0), axis=1)
    stands = (1 + np.flatnonzero(turns > _TURNS_BACK)).tolist()
    ends = [0, *stands, len(points) - 1]
    parts = [CubicSpline(knots[i : j + 1], points[i : j + 1]).c for i, j in pairwise(ends)]
    return _timed(PPoly(np.concatenate(parts, axis=1), knots), stands, speed, acceleration)


def recorded(t: Rows, points: Rows, off_m: float, acceleration: float) -> Path:
    """A curve through positions (n, 3) at times (n,), s, that misses them by `off_m` RMS at most.

    Raises PathError, also where it would accelerate by more than `acceleration` (m/s^2).
    """
    from scipy.interpolate import UnivariateSpline

    if len(t) < 4:
        raise PathError("expected four samples or more", len(t) - 1)
    back = np.flatnonzero(np.diff(t) <= 0.0)
    if len(back):
        i = int(back[0]) + 1
        raise PathError(f"expected a time after {t[i - 1]:g} s, got {t[i]:g}", i)
    since = t - t[0]
    fits = [UnivariateSpline(since, xs, k=3, s=len(t) * off_m * off_m / 3.0) for xs in points.T]

    def at(times: Rows) -> Moving:
        r, v, a = (np.stack([fit(times, nu=n) for fit in fits], axis=1) for n in range(3))
        return Moving(r, v, a)

    found = at(np.linspace(0.0, since[-1], max(1000, 4 * len(t))))
    sizes = np.linalg.norm(found.a, axis=1)
    worst = int(sizes.argmax())
    if not sizes[worst] <= acceleration:
        when = float(since[-1]) * worst / (len(sizes) - 1)
        raise PathError(
            f"the track accelerates by {sizes[worst]:.3g} m/s^2 at {t[0] + when:.4g} s, more than "
            f"acceleration_m_s2, {acceleration:g}: raise that, or if its samples are noisy set smooth_m",
            int(np.searchsorted(since, when)),
        )
    return Path(float(since[-1]), at)


def _lengths(points: Rows) -> Rows:
    """From point to point, m. Raises PathError for two that are one."""
    lengths: Rows = np.linalg.norm(np.diff(points, axis=0), axis=1)
    same = np.flatnonzero(lengths <= CLOSE_M)
    if len(same):
        raise PathError("expected another place than the point before", int(same[0]) + 1)
    return lengths


def _timed(curve: Any, stands: list[int], speed: float, acceleration: float) -> Path:
    """A curve r(u) in pieces, flown from rest to rest; it stands after pieces `stands`."""
    from scipy.interpolate import CubicHermiteSpline

    first, second = curve.derivative(1), curve.derivative(2)
    knots = curve.x
    looks = max(20, min(_LOOKS, _MOST_LOOKS // (len(knots) - 1)))
    within = np.arange(looks) / looks
    u = np.append((knots[:-1, None] + within * np.diff(knots)[:, None]).ravel(), knots[-1])
    middle = 0.5 * (u[1:] + u[:-1])
    rate, half = (np.linalg.norm(first(at), axis=1) for at in (u, middle))
    s = np.append(0.0, np.cumsum(np.diff(u) * (rate[1:] + 4.0 * half + rate[:-1]) / 6.0))  # Simpson
    _check_rate(rate, s, u, looks)

    # the greatest speed at each place: of the path, where it bends, and to slow down before that
    bends = np.linalg.norm(_across(first(u), second(u)), axis=1)  # 1/m
    allowed = np.minimum(speed, np.sqrt(acceleration / np.maximum(bends, 1e-12)))
    still = [looks * k for k in stands]
    most = allowed.copy()
    for _ in range(_REPAIRS):
        most[[0, *still, -1]] = 0.0
        v = _slower_before(most, bends, s, acceleration)
        v = _slower_before(v[::-1], bends[::-1], (s[-1] - s)[::-1], acceleration)[::-1]
        law = _averaged(np.insert(s, still, s[still]), np.insert(v, still, 0.0))
        t = np.arange(0.0, law.x[-1], _STEP_S)
        part = np.interp(s, law(t), law(t, 1)) / allowed
        if part.max() < 1.01:
            break
        most = most / np.maximum(part, 1.0)  # the mean takes speed into a bend

    # what is left above the limits, looked at where the curve bends and evenly in time, slows all of it
    u_of_s = CubicHermiteSpline(s, u, 1.0 / rate)
    slower = 1.0
    for _ in range(2):
        whole = _along(curve, (first, second), u_of_s, law, slower)
        reached = np.interp(s, law(t), t) * slower
        found = whole.at(np.append(reached, np.linspace(0.0, whole.duration_s, 4 * len(t))))
        fastest, strongest = (np.linalg.norm(x, axis=1).max() for x in (found.v, found.a))
        slower *= max(1.0, fastest / speed, math.sqrt(strongest / acceleration))
    return whole


def _check_rate(rate: Rows, s: Rows, u: Rows, looks: int) -> None:
    """Raise PathError where a curve turns on a point: there it has no direction."""
    pieces = np.maximum(np.diff(s[::looks]) / np.diff(u[::looks]), 1e-12)
    least = np.minimum(rate[:-1].reshape(-1, looks).min(axis=1), rate[looks::looks])
    slow = np.flatnonzero(least < _SLOWEST * pieces)
    if len(slow):
        raise PathError(
            'the curve turns on a point here: take corners = "rounded"', int(slow[0]) + 1
        )


def _across(r_u: Rows, r_uu: Rows) -> Rows:
    """Curvature times the normal, (n, 3), 1/m, of a curve with these derivatives."""
    square = np.maximum((r_u * r_u).sum(axis=1, keepdims=True), 1e-18)
    across: Rows = (r_uu - r_u * ((r_uu * r_u).sum(axis=1, keepdims=True) / square)) / square
    return across


def _slower_before(most: Rows, bends: Rows, s: Rows, acceleration: float) -> Rows:
    """At most these speeds, and none that is reached by more than the acceleration that bends leave."""
    v = most.copy()
    for i, (bend, ds) in enumerate(zip(bends[:-1].tolist(), np.diff(s).tolist(), strict=True)):
        left = acceleration**2 - (v[i] * v[i] * bend) ** 2
        v[i + 1] = min(v[i + 1], math.sqrt(v[i] * v[i] + 2.0 * math.sqrt(max(left, 0.0)) * ds))
    return v


def _averaged(s: Rows, v: Rows) -> Any:
    """The length flown over time, a mean over the last SMOOTH_S: a CubicSpline, from rest to rest.

    s : lengths, m; where one stands twice, it waits until the mean stands too.  v : the speed there,
    m/s; between them the acceleration is constant.
    """
    from scipy.interpolate import CubicSpline

    ds, mean = np.diff(s), np.maximum(0.5 * (v[1:] + v[:-1]), 1e-9)
    t = np.append(0.0, np.cumsum(np.where(ds > 0.0, ds / mean, SMOOTH_S)))
    if t[-1] > LONGEST_S:
        raise PathError(f"it takes {t[-1]:.3g} s, more than any flight has")
    before = round(SMOOTH_S / _STEP_S)
    grid = np.arange(-before, math.ceil(t[-1] / _STEP_S) + before + 1) * _STEP_S
    i = np.clip(np.searchsorted(t, grid, side="right") - 1, 0, len(t) - 2)
    since = np.clip(grid, 0.0, t[-1]) - t[i]
    exact = s[i] + since * (v[i] + 0.5 * since * (v[i + 1] - v[i]) / (t[i + 1] - t[i]))
    total = np.append(0.0, np.cumsum(0.5 * (exact[1:] + exact[:-1])))
    averaged = (total[before:] - total[:-before]) / before
    return CubicSpline(grid[before:], averaged, bc_type="clamped")


def _along(curve: Any, derivatives: tuple[Any, Any], u_of_s: Any, law: Any, slower: float) -> Path:
    """The path of a curve r(u) and a time law s(t), flown `slower` times as slowly."""
    first, second = derivatives
    length = float(u_of_s.x[-1])

    def at(times: Rows) -> Moving:
        t = times / slower
        u = np.clip(u_of_s(np.clip(law(t), 0.0, length)), curve.x[0], curve.x[-1])
        v, a = law(t, 1) / slower, law(t, 2) / slower**2
        r_u = first(u)
        ahead = r_u / np.maximum(np.linalg.norm(r_u, axis=1, keepdims=True), 1e-12)
        across = _across(r_u, second(u))
        return Moving(curve(u), v[:, None] * ahead, a[:, None] * ahead + (v * v)[:, None] * across)

    return Path(slower * float(law.x[-1]), at)
