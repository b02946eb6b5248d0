"""How the outputs at a time T answer to the wind before it: a flight's loop, linearised about what it did.

The wind is a velocity at each of some knots. After the last it is that of the last. Before the first it is what
it was, or that of the first: `Knots.head`. Each is moved a little to either side along each axis, and the rest of the flight flown again from
there (`flight.resumption`): half of the difference is the answer.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gcs_tools.flight.resumption import Resumption
from gcs_tools.gusts.limits import outputs

Rows = np.ndarray[Any, np.dtype[np.float64]]

KNOT_S = 0.05  # between two knots
RECENT_S, COARSER = 1.0, 2  # before that, knots are so many times farther apart
WINDOW_S = 3.0  # before T: of what comes earlier only the steady wind counts
MOVED = 0.1  # m/s, to either side


class Knots(NamedTuple):
    """Ticks between which the wind runs straight."""

    at: Any  # int64[k], ascending
    h: float  # s a tick
    head: Rows | None  # float64[at[0], 3], m/s: the wind before the first, where it is kept

    @property
    def apart(self) -> Rows:
        """float64[k - 1], s."""
        return np.asarray(np.diff(self.at) * self.h)

    def air(self, velocities: Rows, ticks: int) -> Rows:
        """float64[ticks, 3] of float64[k, 3]."""
        t = np.arange(ticks)
        found = np.stack([np.interp(t, self.at, v) for v in velocities.T], axis=1)
        if self.head is not None:
            found[: len(self.head)] = self.head
        return found


def knots(T: int, h: float, wind: Rows | None = None) -> Knots:
    """Those before tick T, the last of them at T.

    wind : float64[n, 3], which is kept before them. None: there it is that of the first.
    """
    each = max(1, round(KNOT_S / h))
    recent, whole = round(RECENT_S / KNOT_S), round(WINDOW_S / KNOT_S)
    back = np.r_[np.arange(recent), np.arange(recent, whole + 1, COARSER)]
    at = T - each * back[each * back <= T][::-1]
    kept = wind is not None and len(at) == len(back) and at[0] > 0
    return Knots(at, h, wind[: at[0]].copy() if kept and wind is not None else None)


class Response(NamedTuple):
    """A flight at T, and its answer to the wind at each knot."""

    out: Rows  # float64[6] of `limits.outputs`
    by_wind: Rows  # float64[k, 3, 6], a m/s


def response(
    vehicle: Resumption, velocities: Rows, of: Knots, T: int, moved: float = MOVED
) -> Response:
    """Linearise at tick T about the flight in a wind.  velocities : float64[k, 3] at the knots `of`, m/s.

    What ends before T answers with nothing. Raises LawError.
    """
    ticks = len(vehicle.air)
    base = of.air(velocities, ticks)
    vehicle.air[:] = base
    vehicle.resume(vehicle.begin)
    kept = []
    for k in range(len(of.at)):  # where the wind of a knot begins to count
        whole = k == 0 and of.head is None
        vehicle.fly(0 if whole else int(of.at[max(k - 1, 0)]))
        kept.append(vehicle.keep())
    vehicle.fly(T + 1)
    out = outputs(vehicle.law_rows[T : T + 1])[0]
    by_wind = np.zeros((len(of.at), 3, 6))
    for k, begin in enumerate(kept):
        if k == 0 and of.head is not None:
            continue  # it stays
        shape = np.interp(np.arange(ticks), of.at, np.eye(len(of.at))[k])
        for axis in range(3):
            sides = []
            for side in (moved, -moved):
                vehicle.air[:, axis] = base[:, axis] + side * shape
                vehicle.resume(begin)
                lasts = vehicle.fly(T + 1)
                sides.append(outputs(vehicle.law_rows[T : T + 1])[0] if lasts else out)
            vehicle.air[:, axis] = base[:, axis]
            by_wind[k, axis] = (sides[0] - sides[1]) / (2.0 * moved)
    return Response(out, by_wind)
