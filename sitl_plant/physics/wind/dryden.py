"""Dryden turbulence: white noise through rational filters. MIL-F-8785C, 3.7.1.2.

H_u = 1 / (1 + s), H_v = H_w = (1 + sqrt(3) s) / (1 + s)^2, in time over L / V. The filters are discretised exactly:
over a step the mean and covariance of their states are those of the continuous filters, so that no statistic depends
on the step.
"""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3
from fcu.kernel.compile import kernel

STATES = 5  # one along the wind, two across, two up
_A, _B = math.sqrt(3.0), 1.0 - math.sqrt(3.0)  # (1 + sqrt(3) s) = _A (1 + s) + _B


@kernel
def begin(x, n, at):
    """Draw the states x[at : at + STATES] from their stationary distribution.  n : normal, as many as x."""
    x[at] = n[at]
    for k in (at + 1, at + 3):  # variances 1/2 and 1/4, covariance 1/4
        x[k] = math.sqrt(0.5) * n[k]
        x[k + 1] = 0.5 * x[k] + math.sqrt(0.125) * n[k + 1]


@kernel
def step(x, h, n, at):
    """Advance the states x[at : at + STATES] by `h` (V dt / L, by axis).  n : normal, as many as x."""
    x[at] = math.exp(-h.x) * x[at] + math.sqrt(-math.expm1(-2.0 * h.x)) * n[at]
    _second(x, at + 1, h.y, n)
    _second(x, at + 3, h.z, n)


@kernel
def _second(x, k, h, n):
    """Advance the two states of a second-order filter, x[k] and x[k + 1]."""
    e, grown = math.exp(-h), -math.expm1(-2.0 * h)
    q11 = 0.5 * grown
    q12 = 0.25 * grown - 0.5 * h * e * e
    q22 = 0.25 * grown - 0.5 * h * e * e * (h + 1.0)
    l11 = math.sqrt(q11)
    l21 = q12 / l11
    l22 = math.sqrt(max(q22 - l21 * l21, 0.0))  # below 0 by rounding alone
    x[k + 1] = e * (x[k + 1] + h * x[k]) + l21 * n[k] + l22 * n[k + 1]
    x[k] = e * x[k] + l11 * n[k]


@kernel
def output(x, at):
    """Turbulence of variance 1 by axis of the states from `at` on: along the wind, across, up."""
    return Vec3(x[at], _A * x[at + 1] + _B * x[at + 2], _A * x[at + 3] + _B * x[at + 4])
