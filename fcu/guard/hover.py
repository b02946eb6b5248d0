"""Region of attraction of the octocopter: conditions on steps and wind, in newtons and metres.

The forces that the vehicle can produce at every yaw angle satisfy

    |T_xy| <= T_z tan phi*,   T_min <= |T| <= T_max,   T_z > 0,

This set is not a box and does not contain zero. Besides the exact set along the reference
trajectory there are two simpler conditions: the largest ball about hover, and the paper's (31) with
the origin at the target (with the origin at the start it would count |K x_m| and |Lambda^-1 r|
separately, although they cancel). Both are sufficient, not necessary: a flight that fails them may
still be fine.

Forces are in N, E. The mass is the believed mass, and the wind is a bound of its speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from fcu.guard.responses import Matrix, gain, peak
from fcu.laws.mmrac.types import Params

SMALLEST, FARTHEST = 1e-12, 1e6  # ends of the search for the largest start or step


class Budget(NamedTuple):
    """Part of the limit that each term uses, in the units of u. Paper (24), (25), (31)."""

    limit: float  # v*
    reference: float  # to hold the reference state: |K| |x_m|
    nonlinearity: float  # |K_0| |g(x_m)|
    command: float  # |Lambda^-1| |r|
    disturbance: float  # d*
    initial_error: float  # gamma_A (|K| + lambda_g |K_0|) |e(0)|
    tracking_error: float = 0.0  # contribution of adaptation to e; not in the paper
    learning: float = 0.0  # beta_1
    lasting_error: float = 0.0  # beta_2 gamma^(-1/2)

    @property
    def used(self) -> float:
        """The sum of the terms."""
        return sum(self[1:])

    @property
    def margin(self) -> float:
        """Limit minus used. The condition holds if the margin is not negative."""
        return self.limit - self.used

    @property
    def holds(self) -> bool:
        """True if the condition holds."""
        return self.margin >= 0.0

    @property
    def largest(self) -> str:
        """Name of the largest term."""
        return max(self._fields[1:], key=lambda name: float(getattr(self, name)))


class Air(NamedTuple):
    """Assumptions about the air: bounds of the wind and of its rate, and the drag coefficient."""

    speed: float  # m/s
    rate: float  # m/s^2
    drag: float  # N/(m/s)^2

    def force(self, v: float = 0.0) -> float:
        """Largest drag (N) at speed v (m/s), for any attitude. Section VI.B."""
        return self.drag * (v + self.speed) ** 2

    def force_rate(self) -> float:
        """Largest rate of the drag c |w| w (N/s) at rest."""
        return 2.0 * self.drag * self.speed * self.rate


def A(params: Params) -> Matrix:
    """A (2 x 2) of position and velocity on one axis. Paper (34)."""
    f, zeta = params.f_m, params.zeta_m
    return np.array([[0.0, 1.0], [-f * f, -2.0 * f * zeta]])  # (34)


def ball(params: Params, mass: float) -> float:
    """R (N): the vehicle can produce every force within R of hover, which is mass * g up."""
    weight = mass * params.g
    aside = weight * math.sin(params.limits.phi_star)
    lowest = max(params.limits.T_min, params.achieved * params.T_dz_min)
    return min(params.limits.T_max - weight, weight - lowest, aside)


def K(params: Params, mass: float) -> float:
    """|K| of the matching condition: |mass (f_m^2 I, 2 zeta_m f_m I)|, N per unit of state."""
    f = params.f_m
    return mass * f * math.hypot(f, 2.0 * params.zeta_m)


def position_error(params: Params, z: float) -> float:
    """Bound of |r - r_m| (m), from 0, for a bound z (m/s^2): e'' + 2 zeta f e' + f^2 e = z."""
    B, C = np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    return float(gain(A(params), B, C)[0, 0]) * z


class Step(NamedTuple):
    """Largest values of the response of the reference model to a step of 1 m from rest."""

    speed: float  # m/s
    away: float  # |x_m - x_c|, m and m/s
    acceleration: float  # m/s^2


@lru_cache(maxsize=64)
def unit_step(params: Params) -> Step:
    """Largest values along the reference model, too large by `TOLERANCE` of `peak` at most."""
    M, start = A(params), np.array([[-1.0], [0.0]])
    return Step(
        float(peak(M, start, np.array([[0.0, 1.0]]))[0, 0]),
        float(peak(M, start)[0, 0]),
        float(peak(M, start, M[1:])[0, 0]),
    )


def ball_budget(
    params: Params, mass: float, air: Air, step: float, adaptation: float = 0.0
) -> Budget:
    """Condition (B): mass |r_m''(t)| + d + mu <= R, at the worst time.

    step : m, from rest, in any direction. adaptation : mu (N), beta_1 + beta_2 gamma^(-1/2) plus
    the contribution of the tracking error.
    """
    states = step * _reference(params)
    acceleration = mass * np.abs(states @ A(params)[1])
    drag = air.drag * (np.abs(states[:, 1]) + air.speed) ** 2
    worst = int(np.argmax(acceleration + drag))
    return Budget(
        limit=ball(params, mass), reference=float(acceleration[worst]), nonlinearity=0.0,
        command=0.0, disturbance=float(drag[worst]), initial_error=0.0, lasting_error=adaptation,
    )  # fmt: skip


def theorem_budget(
    params: Params, mass: float, air: Air, step: float, adaptation: float = 0.0,
    e_0: float = 0.0,
) -> Budget:  # fmt: skip
    """Condition (N): (31) with the origin at the target and the limit R about hover.

    e_0 : |x(0) - x_m(0)|, m and m/s. Other arguments as in `ball_budget`. Paper (31).
    """
    unit, per_state = unit_step(params), K(params, mass)
    return Budget(
        limit=ball(params, mass),
        reference=per_state * unit.away * step,
        nonlinearity=0.0,
        command=0.0,
        disturbance=air.force(unit.speed * step),
        initial_error=per_state * float(peak(A(params))[0, 0]) * e_0,
        lasting_error=adaptation,
    )  # (31)


POINTS = 2000  # of the response of the reference model


@lru_cache(maxsize=64)
def _reference(params: Params) -> Matrix:
    """Position relative to the target, and velocity (POINTS x 2), for a step of 1 m from rest."""
    slow = params.f_m * min(params.zeta_m, 1.0 / params.zeta_m)
    h = 8.0 / slow / POINTS
    one, states = expm(A(params) * h), [np.array([-1.0, 0.0])]
    for _ in range(POINTS - 1):
        states.append(one @ states[-1])
    return np.array(states)


def largest(admitted: Callable[[float], bool], precision: float = 1e-9) -> float:
    """Search for a value that is admitted while one `precision` (relative) above it is not. 0 if 0 is not.

    Searches from SMALLEST to FARTHEST. The largest of all if every value below an admitted one is
    admitted too.
    """
    low, high = 0.0, 1.0
    if not admitted(low):
        return 0.0
    while admitted(high) and high < FARTHEST:
        low, high = high, 2.0 * high
    while high - low > precision * high and high > SMALLEST:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if admitted(middle) else (low, middle)
    return low


def largest_step(condition: Callable[[float], Budget]) -> float:
    """Largest step (m) whose `Budget` holds, or 0. condition : function from step to Budget."""
    return largest(lambda step: condition(step).holds)
