"""A vehicle without some of its rotors: is there a hover, and how is thrust and torque shared in it?

A rotor that is lost gives nothing. The others carry the vehicle without torque if each of them pushes
upwards then. Some may have to stand still too: of a coaxial pair's other rotors, or of a hexacopter the
one that is opposite. Every choice of the rotors that go on is looked at. Of those that hold yaw, and
else of those that do not, the one counts that leaves the most torque about roll and pitch beside hover.

Worked out once, when a rotor is lost: no kernel knows of it but by its RotorParams and Limits.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from enum import IntEnum
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.airframe import APART, HOVERS, LEAST_SHARE, ROTORS, even_hover
from fcu.kernel.algebra import Rotors
from fcu.laws.allocation import RotorParams
from fcu.laws.face import Limits
from fcu.laws.least_thrust import outermost_pairs

Array = np.ndarray[Any, np.dtype[np.float64]]

BALANCED = 1e-6  # N m of a newton of hover: less is no torque
LEAST_TILT = math.radians(5.0)  # tilt limit of a vehicle that cannot carry its weight with any
LEAST_LEFT = 3  # rotors that hold roll and pitch


class Fate(IntEnum):
    """The best that a vehicle can do without the rotors that it has lost, by severity."""

    FLIES = 0  # it holds thrust, roll, pitch and yaw
    LANDS = 1  # it does not hold yaw, or not enough thrust for a flight
    FALLS = 2  # it does not hold roll and pitch


class Shared(NamedTuple):
    """A hover of the rotors that go on, and what it leaves."""

    w: Array  # float64[8], weights of the rotors, 0 of one that stands still
    B: Array  # float64[8, 3], thrusts over weights for one N m about each axis, N
    f_max: float  # N, greatest thrust of a rotor of weight 1
    yaw: bool  # it holds yaw
    room: float  # N m, torque about the weaker of roll and pitch beside hover


def hovers(rotors: RotorParams, lost: Collection[int], T_hover: float) -> Iterator[Shared]:
    """Yield every hover of the rotors that are not lost.

    lost : numbers of rotors, from 1.  T_hover : total thrust of hover, N.
    """
    x, y, spin, c_T, Omega_max = (
        np.array(row) for row in (rotors.x, rotors.y, rotors.spin, rotors.c_T, rotors.Omega_max)
    )
    effect, full = np.stack([np.ones(ROTORS), y, -x, -rotors.k_Q * spin]), c_T * Omega_max**2
    there = [i for i in range(ROTORS) if spin[i] != 0.0 and i + 1 not in lost]
    for n in range(len(there), LEAST_LEFT - 1, -1):
        for used in map(list, combinations(there, n)):
            found = _shared(effect[:, used], full[used], T_hover, rotors.f_min * rotors.W)
            if found is not None:
                w, B = np.zeros(ROTORS), np.zeros((ROTORS, 3))
                w[used], B[used] = found.w, found.B
                yield found._replace(w=w, B=B)


def _shared(effect: Array, full: Array, T_hover: float, T_min: float) -> Shared | None:
    """The hover of some rotors. None: they do not balance, or do not hold roll and pitch.

    effect : float64[4, n] of `interface.airframe.effect`.  full : float64[n], full thrusts, N.
    T_hover, T_min : total thrust of hover, and the least, N.
    """
    each = even_hover(effect, full)
    if np.abs(effect @ each - np.array([1.0, 0.0, 0.0, 0.0])).max() > BALANCED:
        return None
    w = each / each.max()
    if w.min() < LEAST_SHARE:
        return None
    shared = effect * w
    yaw = _holds(shared)
    if not yaw and not _holds(shared[:3]):
        return None
    B = np.zeros((len(w), 3))
    if yaw:
        B[:] = np.linalg.pinv(shared)[:, 1:]
    else:
        B[:, :2] = np.linalg.pinv(shared[:3])[:, 1:]
    f_max, W = float((full / w).min()), float(w.sum())
    room = max(min((T_hover - T_min) / W, f_max - T_hover / W), 0.0)
    weaker = max(float(np.abs(B[:, axis]).max()) for axis in (0, 1))
    return Shared(w, B, f_max, yaw, room / weaker)


def _holds(rows: Array) -> bool:
    """Return true if rotors give each row (float64[m, n], of thrust and torques) apart from the others."""
    rows = rows / np.maximum(np.abs(rows).max(axis=1, keepdims=True), 1e-12)
    sizes = np.linalg.svd(rows, compute_uv=False)
    return rows.shape[1] >= len(rows) and bool(sizes[-1] >= APART * sizes[0])


def without(
    rotors: RotorParams, limits: Limits, lost: Collection[int], T_hover: float, T_heaviest: float
) -> tuple[Fate, RotorParams, Limits]:
    """The Fate of a vehicle that has lost rotors, and the rotors and limits of its law.

    lost : numbers of rotors, from 1.  T_hover : total thrust of hover, N.  T_heaviest : weight of the
    greatest believed mass, N. Without a hover, rotors and limits are as they were.

    The greatest thrust is that of the level hover, and at the tilt limit it still carries the weight.
    A vehicle flies on if it carries HOVERS times the greatest believed weight, as every airframe has to.
    """
    if not lost:
        return Fate.FLIES, rotors, limits
    best = max(hovers(rotors, lost, T_hover), key=lambda each: (each.yaw, each.room), default=None)
    if best is None:
        return Fate.FALLS, rotors, limits
    W = float(best.w.sum())
    T_max = min(limits.T_max, W * best.f_max)
    B_x, B_y, B_z = (Rotors(*best.B[:, axis].tolist()) for axis in range(3))
    used = [i for i in range(ROTORS) if best.w[i] > 0.0]
    after = rotors._replace(
        w=Rotors(*best.w.tolist()), W=W, f_min=rotors.f_min * rotors.W / W, f_max=best.f_max,
        B_x=B_x, B_y=B_y, B_z=B_z,
        pairs=outermost_pairs(rotors.x, rotors.y, rotors.spin, used, yaw=best.yaw),
    )  # fmt: skip
    carries = math.acos(min(T_hover / T_max, 1.0))
    phi_star = min(limits.phi_star, max(carries, LEAST_TILT))
    flies = best.yaw and T_max >= HOVERS * T_heaviest
    return (
        Fate.FLIES if flies else Fate.LANDS,
        after,
        limits._replace(T_max=T_max, phi_star=phi_star),
    )
