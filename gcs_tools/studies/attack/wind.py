"""Wind that answers to the flight: within a speed and a rate, blown where it hurts.

Kinds: `own`, the plant's own (steady and sinusoids); `square`, to and fro along a line; `turning`, in a
plane; `flipping`, against the way to each new setpoint; `pushing`, so that drag drives the demanded
force towards its nearest limit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fcu.kernel.algebra import Vec3, cross, maximum, minimum, norm
from fcu.kernel.compile import kernel

KINDS = ("own", "square", "turning", "flipping", "pushing")
OWN, SQUARE, TURNING, FLIPPING, PUSHING = map(float, range(5))


class Gust(NamedTuple):
    """The wind of an attack; without a kind but `own` it is not touched."""

    kind: float
    speed: float  # m/s, at most
    rate: float  # m/s^2, at most
    every: float  # s: half a period, square; the time of a radian, turning
    along: Vec3  # E, of length 1: the line of a square wind, the axis of one that turns


@kernel
def across(n):
    """A direction of length 1 across n, level unless n points straight up."""
    side = Vec3(-n.y, n.x, 0.0)
    if norm(side) < 1e-6:
        return Vec3(1.0, 0.0, 0.0)
    return (1.0 / norm(side)) * side


@kernel
def pushes(known, T_0):
    """Where to (E, length 1) drag has to be blown for a demand T_0 (N, E) to meet its nearest limit.

    Drag is what the demand makes up for, so the wind blows against the way the demand is to go.
    """
    aside, size = math.sqrt(T_0.x * T_0.x + T_0.y * T_0.y), norm(T_0)
    cone = T_0.z * known.sin - aside * known.cos
    above, below = known.T_max - size, T_0.z - known.T_z_min
    if above <= minimum(cone, below):
        return (-1.0 / (size + 1e-9)) * T_0
    if below <= cone:
        return Vec3(0.0, 0.0, 1.0)
    out = -known.cos / (aside + 1e-9)
    return Vec3(out * T_0.x, out * T_0.y, known.sin)


@kernel
def wanted(gust, known, t, to_go, T_0):
    """The velocity of the air (m/s, E) that the attack would have at t (s).

    known : `margin.Known`.  to_go : m, E, to the last setpoint when it was sent.  T_0 : N, E, demanded.
    """
    n = gust.along
    if gust.kind == SQUARE:
        return (gust.speed if math.sin(math.pi * t / gust.every) >= 0.0 else -gust.speed) * n
    if gust.kind == TURNING:
        side = across(n)
        a = t / gust.every
        return gust.speed * (math.cos(a) * side + math.sin(a) * cross(n, side))
    if gust.kind == FLIPPING:
        return (-gust.speed / (norm(to_go) + 1e-9)) * to_go
    return gust.speed * pushes(known, T_0)


@kernel
def blown(gust, air, to, h):
    """The velocity of the air (m/s, E) a time h (s) after `air`, on its way to `to`."""
    change = to - air
    part = minimum(1.0, gust.rate * h / maximum(norm(change), 1e-12))
    return air + part * change
