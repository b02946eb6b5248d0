"""How fast to go towards a point so as to stop there in time. Not in the paper."""

from __future__ import annotations

import math

from fcu.kernel.algebra import maximum, select
from fcu.kernel.compile import kernel


@kernel
def approach(c, limit, x):
    """Speed c x towards a point x away, or less: one from which `limit` stops it in time.

    Close by c x, then a square root that joins it smoothly, whose own deceleration is `limit`.
    """
    knee = limit / c
    root = math.sqrt(maximum(2.0 * limit * x - knee * knee, 0.0))
    return select(c * x > knee, root, c * x)
