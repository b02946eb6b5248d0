"""Tells what in flight contradicts the beliefs of the guard, each once a flight of the law.

On the ground, which carries part of the weight and holds the vehicle, nothing is told; nor just after
it, while estimates and signs still hold what they took from the ground.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from fcu.guard.contradictions import LASTS_S
from fcu.guard.types import Contradicted, GuardInternals
from fcu.interface.status_texts import Code, Told
from fcu.kernel.rows import column_of, slice_of
from fcu.laws.face import TAKE_OVER, SharedTick
from fcu.laws.loader import Law

Row = np.ndarray[Any, np.dtype[np.float64]]

_ENGAGED = column_of(SharedTick, "engaged")
_FORGETS_S = 2.0 * LASTS_S  # after the ground: an eighth is left then of what was smoothed


class BeliefWatch:
    """Looks at the rows of ticks; sees nothing of a law that has not the guard of M-MRAC."""

    def __init__(self, law: Law) -> None:
        has_guard = law.tells("guard", GuardInternals)
        self._flags = slice_of(law.ticks.Tick, "guard.contradicted") if has_guard else slice(0, 0)
        self._told: set[int] = set()  # of this flight, by place
        self._ground_s = -math.inf  # of this flight: when it was last on the ground

    def see(self, rows: Row, settings: Any, airborne: bool) -> Iterator[tuple[int, Told]]:
        """What ticks contradict for the first time since take-over, and when (us).

        rows : float64[n, size(Tick) or more].  settings : in force.  airborne : armed, and not on the
        ground, in all of them.
        """
        if len(rows) and (rows[:, _ENGAGED] == TAKE_OVER).any():
            self._told.clear()
            self._ground_s = -math.inf
        if len(rows) and not airborne:
            self._ground_s = float(rows[-1, 0])
        counts = rows[:, :1] - self._ground_s > _FORGETS_S
        up = (rows[:, self._flags] > 0.5) & counts
        if not up.any():
            return
        for place in np.flatnonzero(up.any(axis=0)).tolist():
            if place not in self._told:
                self._told.add(place)
                at_s = rows[int(up[:, place].argmax()), 0]
                what = _what(Contradicted._fields[place], settings)
                yield round(at_s * 1e6), Told(Code.NOT_AS_BELIEVED, (what,))


def _what(sign: str, settings: Any) -> Told:
    """A field of Contradicted, with the belief that it contradicts."""
    guard, law = settings.guard, settings.law
    return {
        "lighter": Told(Code.LIGHTER, (guard.m_min,)),
        "heavier": Told(Code.HEAVIER, (guard.m_max,)),
        "drag": Told(Code.MORE_DRAG, (guard.w_max,)),
        "thrust": Told(Code.THRUST_OFF),
        "trim": Told(Code.TRIM_PINNED, (law.trim_max,)),
    }[sign]
