"""The second-order Butterworth low-pass, and the rate of what passes."""

from __future__ import annotations

import math
from typing import NamedTuple

from fcu.kernel.algebra import Vec3
from fcu.kernel.compile import kernel


class Filtered(NamedTuple):
    """What passes the filter, and its rate."""

    x: Vec3  # in the unit of what is filtered
    x_dot: Vec3  # the same a second


@kernel
def low_pass(f, u, cutoff, h):
    """The Filtered one tick of h (s) on: of cut-off `cutoff` (rad/s), for an input u.

    Exact for an input that is constant in the tick.
    """
    b = cutoff * math.sqrt(0.5)  # damping ratio sqrt(1/2): decay and frequency are the same
    decay, c, s = math.exp(-b * h), math.cos(b * h), math.sin(b * h)
    e = f.x - u
    return Filtered(
        x=u + decay * ((c + s) * e + (s / b) * f.x_dot),
        x_dot=decay * ((c - s) * f.x_dot - (2.0 * b * s) * e),
    )
