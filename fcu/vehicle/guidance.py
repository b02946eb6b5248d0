"""Where the vehicle is told to be when nobody streams setpoints: pieces of constant acceleration.

The law carries a setpoint along its own velocity and acceleration, so a trapezoid of speed is
three setpoints, exact at every tick between. Frames: Earth ENU; SI.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3

STILL = Vec3(0.0, 0.0, 0.0)
SLOW = 0.05  # m/s under which there is nothing to brake
EIGHT_HZ = 20.0  # at which the figure of eight is laid down
EIGHT_RAMP_S = 5.0  # from rest to full speed


class Piece(NamedTuple):
    """A setpoint, and for how long (s) it is carried; inf: until something else is wanted."""

    setpoint: Setpoint
    for_s: float


class Limits(NamedTuple):
    """How fast the vehicle is led. m/s, m/s^2."""

    cruise: float
    up: float
    down: float
    acceleration: float  # across
    acceleration_up: float  # up and down


def length(v: Vec3) -> float:
    """Of a vector."""
    return math.sqrt(v.x * v.x + v.y * v.y + v.z * v.z)


def rest(r: Vec3, psi: float) -> Piece:
    """Stay at r."""
    return Piece(Setpoint(r, STILL, STILL, psi, 0.0), math.inf)


def brake(r: Vec3, v: Vec3, psi: float, limits: Limits) -> tuple[list[Piece], Vec3]:
    """From r at velocity v to a stop; returns the pieces and where it stops."""
    speed = length(v)
    if speed < SLOW:
        return [], r
    across = math.hypot(v.x, v.y)
    least = min(
        limits.acceleration * speed / max(across, 1e-9),
        limits.acceleration_up * speed / max(abs(v.z), 1e-9),
    )
    time = speed / least
    a = (-1.0 / time) * v
    return [Piece(Setpoint(r, v, a, psi, 0.0), time)], r + (0.5 * time) * v


def line(start: Vec3, end: Vec3, psi: float, limits: Limits) -> list[Piece]:
    """From rest at `start` straight to rest at `end`, within the limits; without the rest there."""
    way = end - start
    far = length(way)
    if far < 1e-6:
        return []
    ahead = (1.0 / far) * way
    across, climb = math.hypot(ahead.x, ahead.y), ahead.z
    vertical = limits.up if climb > 0.0 else limits.down
    speed = min(limits.cruise / max(across, 1e-9), vertical / max(abs(climb), 1e-9))
    a = min(limits.acceleration / max(across, 1e-9), limits.acceleration_up / max(abs(climb), 1e-9))
    speed = min(speed, math.sqrt(a * far))  # a triangle if the way is short
    ramp, flat = speed / a, far / speed - speed / a
    pieces, r = [], start
    for v, accel, time in ((0.0, a, ramp), (speed, 0.0, flat), (speed, -a, ramp)):
        if time > 1e-9:
            pieces.append(Piece(Setpoint(r, v * ahead, accel * ahead, psi, 0.0), time))
            r = r + (v * time + 0.5 * accel * time * time) * ahead
    return pieces


def through(
    r: Vec3, v: Vec3, points: list[Vec3], psi: float, limits: Limits, settle_s: float = 0.0
) -> list[Piece]:
    """Stop, then from point to point; ends with the rest at the last, `settle_s` after arriving."""
    pieces, here = brake(r, v, psi, limits)
    for point in points:
        pieces += line(here, point, psi, limits)
        here = point
    last = rest(here, psi)
    return [*pieces, *([last._replace(for_s=settle_s)] if settle_s > 0.0 else []), last]


def descent(
    r: Vec3, v: Vec3, psi: float, slow_below: float, speed: float, limits: Limits
) -> list[Piece]:
    """Stop, go down at the limit to `slow_below` (m), then at `speed` until something is touched."""
    pieces, here = brake(r, v, psi, limits)
    if here.z > slow_below + 1.0:
        low = Vec3(here.x, here.y, slow_below)
        pieces += line(here, low, psi, limits)
        here = low
    sinking = Setpoint(here, Vec3(0.0, 0.0, -speed), STILL, psi, 0.0)
    return [*pieces, Piece(sinking, math.inf)]


def steps(r: Vec3, away: Vec3, period_s: float, psi: float) -> Iterator[Piece]:
    """There and back, each held for a period, as steps: the reference model is to shape them."""
    every = period_s if period_s > 0.0 else math.inf
    while True:
        yield Piece(Setpoint(r + away, STILL, STILL, psi, 0.0), every)
        yield Piece(Setpoint(r, STILL, STILL, psi, 0.0), every)


def eight_acceleration(size: tuple[float, float], speed: float) -> float:
    """The greatest acceleration (m/s^2) along a figure of eight, at full speed."""
    a, b = size
    rate = speed / math.hypot(0.5 * a, b)
    p = [math.pi * k / 180.0 for k in range(360)]
    return rate * rate * max(
        math.hypot(0.5 * a * math.sin(q), 2.0 * b * math.sin(2.0 * q)) for q in p
    )  # fmt: skip


def figure_eight(r: Vec3, size: tuple[float, float], speed: float, psi: float) -> Iterator[Piece]:
    """x = a/2 sin p, y = b/2 sin 2p about r, from rest; `speed` (m/s) where it crosses."""
    a, b = size
    rate = speed / math.hypot(0.5 * a, b)  # of p, at full speed
    k = 0
    while True:
        t = k / EIGHT_HZ
        if t < EIGHT_RAMP_S:
            p, p_dot, p_ddot = (
                0.5 * rate * t * t / EIGHT_RAMP_S,
                rate * t / EIGHT_RAMP_S,
                rate / EIGHT_RAMP_S,
            )
        else:
            p, p_dot, p_ddot = rate * (t - 0.5 * EIGHT_RAMP_S), rate, 0.0
        s, c, s2, c2 = math.sin(p), math.cos(p), math.sin(2.0 * p), math.cos(2.0 * p)
        yield Piece(
            Setpoint(
                r + Vec3(0.5 * a * s, 0.5 * b * s2, 0.0),
                Vec3(0.5 * a * c * p_dot, b * c2 * p_dot, 0.0),
                Vec3(
                    0.5 * a * (c * p_ddot - s * p_dot * p_dot),
                    b * (c2 * p_ddot - 2.0 * s2 * p_dot * p_dot),
                    0.0,
                ),
                psi,
                0.0,
            ),
            1.0 / EIGHT_HZ,
        )
        k += 1
