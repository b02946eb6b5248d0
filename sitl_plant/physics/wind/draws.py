"""Normal random numbers that depend on a seed, a tick and a number alone.

Nothing is kept between ticks, so that vehicles in lanes, in processes and alone draw the same bits.
Counters are mixed by SplitMix64's finalizer (Steele, Lea, Flood 2014), and made normal by Box and Muller.
"""

from __future__ import annotations

import math

import numpy as np

from fcu.kernel.compile import kernel

_GOLDEN, _FIRST, _SECOND = (
    np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB),
)  # fmt: skip
_30, _27, _31, _11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_2_53 = 1.0 / 9007199254740992.0


@kernel
def mixed(counter):
    """64 bits that look random.  counter : uint64."""
    z = counter + _GOLDEN
    z = (z ^ (z >> _30)) * _FIRST
    z = (z ^ (z >> _27)) * _SECOND
    return z ^ (z >> _31)


@kernel
def uniform(bits):
    """A number in (0, 1] of 53 random bits."""
    return (np.float64(bits >> _11) + 1.0) * _2_53


@kernel
def normals(seed, tick, pair):
    """Two independent standard normal numbers.  seed, tick, pair : whole numbers, not negative."""
    key = mixed(mixed(mixed(np.uint64(seed)) + np.uint64(tick)) + np.uint64(2 * pair))
    radius = math.sqrt(-2.0 * math.log(uniform(key)))
    angle = 2.0 * math.pi * uniform(mixed(key))
    return radius * math.cos(angle), radius * math.sin(angle)
