"""A vehicle without some of its rotors: is there a hover, and how is thrust and torque shared in it?

A rotor that is lost gives nothing. The others hold roll and pitch where they stand around the centre of
mass. Some of them may have to stand still too: of coaxial pairs the other rotors, or of a hexacopter the
one that is opposite. So every choice of the rotors that go on is looked at, and of each choice several
hovers: with and without balance about yaw, with loads as even as they can be, and of the greatest thrust.

Of these hovers one is flown. Carrying the weight comes first, yaw second. Thrust counts next, until it is
enough for a flight, and then the room for torque about roll and pitch beside the hover. A choice whose thrust
cannot win is not worked out further, since the vehicle waits in the air.

Worked out once, when a rotor is lost: no kernel knows of it but by its RotorParams and Limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from enum import IntEnum
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.airframe import APART, HOVERS, LEAST_SHARE, ROTORS, even_hover
from fcu.kernel.algebra import Rotors
from fcu.laws.allocation import RotorParams
from fcu.laws.face import Limits
from fcu.laws.least_thrust import outermost_pairs

Array = np.ndarray[Any, np.dtype[np.float64]]

BALANCED = 1e-6  # N m of a newton of hover: less is no torque
SAME = 1e-9  # of thrusts over full thrust
LEAST_TILT = math.radians(5.0)  # the tilt limit is not less, though the vehicle may sink
LEAST_LEFT = 3  # rotors that hold roll and pitch


class Fate(IntEnum):
    """The best that a vehicle can do without the rotors that it has lost, by severity."""

    FLIES = 0  # it holds thrust, roll, pitch and yaw
    LANDS = 1  # it does not hold yaw, or not enough thrust for a flight
    FALLS = 2  # it does not hold roll and pitch


class Yaw(IntEnum):
    """A hover's torque about yaw."""

    LEFT = 0  # some torque is left: the vehicle turns ever faster
    BALANCED = 1  # none is left, and none can be given
    HELD = 2


class Shared(NamedTuple):
    """A hover of the rotors that go on, and what it leaves."""

    w: Array  # float64[8], weights of the rotors, 0 of one that stands still
    B: Array  # float64[8, 3], thrusts over weights for one N m about each axis, N
    f_max: float  # N, greatest thrust of a rotor of weight 1
    yaw: Yaw
    room: float  # N m, torque about any axis across that the pseudo-inverse gives beside hover

    @property
    def T_max(self) -> float:
        """Total thrust (N) of the hover with one of its rotors at full speed."""
        return float(self.w.sum()) * self.f_max


def hovers(
    rotors: RotorParams,
    lost: Collection[int],
    T_hover: float,
    even: bool = True,
    level: bool = True,
    counts: Callable[[float], bool] = lambda T_max: True,
) -> Iterator[Shared]:
    """Yield a hover of every choice of the rotors that are not lost, where the choice has one.

    lost : numbers of rotors, from 1.  T_hover : total thrust of hover, N.  even : with loads as even as
    they can be. Else that of the greatest thrust.  level : without torque about yaw. Else with any.
    counts : whether a hover of a greatest total thrust (N) is wanted. Others may be left out.
    """
    x, y, spin, c_T, Omega_max = (
        np.array(row) for row in (rotors.x, rotors.y, rotors.spin, rotors.c_T, rotors.Omega_max)
    )
    effect, full = np.stack([np.ones(ROTORS), y, -x, -rotors.k_Q * spin]), c_T * Omega_max**2
    there = [i for i in range(ROTORS) if spin[i] != 0.0 and i + 1 not in lost]
    rows, hover = 4 if level else 3, even_hover if even else strongest_hover
    for n in range(len(there), LEAST_LEFT - 1, -1):
        for used in map(list, combinations(there, n)):
            if not counts(float(full[used].sum()) * (1.0 + SAME)):
                continue
            each = hover(effect[:rows, used], full[used])
            T_min = rotors.f_min * rotors.W
            found = _shared(effect[:, used], full[used], each, T_hover, T_min, counts)
            if found is not None and not (level and found.yaw is Yaw.LEFT):
                w, B = np.zeros(ROTORS), np.zeros((ROTORS, 3))
                w[used], B[used] = found.w, found.B
                yield found._replace(w=w, B=B)


def best_hover(
    rotors: RotorParams, lost: Collection[int], T_hover: float, T_heaviest: float
) -> Shared | None:
    """The hover that is flown without the rotors that are lost. None: roll and pitch cannot be held.

    lost : numbers of rotors, from 1.  T_hover : total thrust of hover, N.  T_heaviest : weight of the
    greatest believed mass, N.

    The first of these counts that tells two hovers apart: to carry the greatest weight, or that of the
    middle mass. To hold yaw, or to be balanced about it. To carry HOVERS times the greatest weight. The
    room that is left, or the thrust where no weight is carried. Hovers of even loads are kept where one of
    them is enough for a flight. A hover that turns ever faster has to carry the weight.
    """
    best: Shared | None = None

    def rank(T_max: float, yaw: Yaw, room: float) -> tuple[float, ...]:
        carried = sum(T_max >= weight for weight in (T_hover, T_heaviest))
        return carried, yaw, T_max >= HOVERS * T_heaviest, room if carried else T_max

    def of(each: Shared) -> tuple[float, ...]:
        return rank(each.T_max, each.yaw, each.room)

    def counts(T_max: float) -> bool:
        return best is None or rank(T_max, Yaw.HELD, math.inf) > of(best)

    def search(even: bool, level: bool = True) -> Shared | None:
        """Return the best hover so far, and of several that are alike the first."""
        nonlocal best
        for each in hovers(rotors, lost, T_hover, even, level, counts):
            if (level or each.T_max >= T_hover) and (best is None or of(each) > of(best)):
                best = each
        return best

    for even, level, enough in (
        (True, True, HOVERS * T_heaviest), (False, True, T_heaviest),
        (True, False, math.inf), (False, False, math.inf),
    ):  # fmt: skip
        found = search(even, level)
        if found is not None and found.T_max >= enough:
            break
    return best


def strongest_hover(effect: Array, full: Array) -> Array:
    """float64[n]: the rotors' thrusts (N) of the greatest total thrust without torque. NaN: there is none.

    effect : float64[m, n], total thrust and the torques that are balanced.  full : float64[n], full thrusts, N.

    A linear program: no rotor gives less than LEAST_SHARE of the strongest one's full thrust. At its
    solution all rotors but m - 1 are at a limit, so every such corner is looked at.
    """
    n, torque = len(full), effect[1:]
    m = len(torque)
    low, best = np.full(n, LEAST_SHARE * full.max()), np.full(n, np.nan)
    if n < m:
        return best
    limits = np.array(list(product((0.0, 1.0), repeat=n - m))).T  # 1: at full thrust
    inner = np.array(list(combinations(range(n), m)))
    outer = np.array([[i for i in range(n) if i not in each] for each in inner.tolist()], int)
    apart = np.linalg.cond(torque[:, inner].swapaxes(0, 1)) <= 1.0 / SAME
    if not apart.any():
        return best
    inner, outer = inner[apart], outer.reshape(len(apart), n - m)[apart]
    corner = np.arange(len(inner))[:, None]
    f = np.empty((len(inner), n, limits.shape[1]))
    f[corner, outer] = low[outer, None] + (full - low)[outer, None] * limits
    given = np.array([torque[:, o] @ each[o] for o, each in zip(outer, f, strict=True)])
    f[corner, inner] = np.linalg.solve(torque[:, inner].swapaxes(0, 1), -given)
    slack = SAME * full.max()
    fits = ((f >= low[:, None] - slack) & (f <= full[:, None] + slack)).all(axis=1)
    T = np.where(fits, f.sum(axis=1), -1.0)
    most = 0.0
    for i, top in enumerate(T.max(axis=1).tolist()):
        if top > most:
            best = f[i, :, T[i].argmax()]
            most = max(float(best.sum()), 0.0)
    return best


def _shared(
    effect: Array, full: Array, each: Array, T_hover: float, T_min: float,
    counts: Callable[[float], bool],
) -> Shared | None:  # fmt: skip
    """Work out what some rotors make of a hover. None: they do not balance or hold roll and pitch.

    effect : float64[4, n] of `interface.airframe.effect`.  full : float64[n], full thrusts, N.
    each : float64[n], thrusts of the hover, N.  T_hover, T_min : total thrust of hover, and the least, N.
    counts : as for `hovers`. None is returned of what does not count, too.
    """
    if not each.max() > 0.0:
        return None
    left = effect[1:] @ each / each.sum()  # N m of a newton of hover
    w = each / each.max()
    if np.abs(left[:2]).max() > BALANCED or w.min() < LEAST_SHARE * (1.0 - SAME):
        return None
    f_max, W = float((full / w).min()), float(w.sum())
    if not counts(W * f_max * (1.0 + SAME)):
        return None
    shared = effect * w
    balanced = bool(abs(left[2]) <= BALANCED)
    yaw = Yaw.HELD if balanced and _holds(shared) else Yaw.BALANCED if balanced else Yaw.LEFT
    if yaw is not Yaw.HELD and not _holds(shared[:3]):
        return None
    B = np.zeros((len(w), 3))
    if yaw is Yaw.HELD:
        B[:] = np.linalg.pinv(shared)[:, 1:]
    else:
        B[:, :2] = np.linalg.pinv(shared[:3])[:, 1:]
    room = max(min((T_hover - T_min) / W, f_max - T_hover / W), 0.0)
    return Shared(w, B, f_max, yaw, room / float(np.hypot(B[:, 0], B[:, 1]).max()))


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

    A vehicle flies on if it holds yaw and carries HOVERS times the greatest believed weight, as every
    airframe has to. The greatest thrust is that of the level hover. At the tilt limit it still carries the
    greatest believed weight if the vehicle flies on, and that of the middle mass if it lands. The tilt
    limit is not below LEAST_TILT, at which the vehicle may sink.
    """
    if not lost:
        return Fate.FLIES, rotors, limits
    best = best_hover(rotors, lost, T_hover, T_heaviest)
    if best is None:
        return Fate.FALLS, rotors, limits
    W, T_max, held = float(best.w.sum()), min(limits.T_max, best.T_max), best.yaw is Yaw.HELD
    B_x, B_y, B_z = (Rotors(*best.B[:, axis].tolist()) for axis in range(3))
    used = [i for i in range(ROTORS) if best.w[i] > 0.0]
    after = rotors._replace(
        w=Rotors(*best.w.tolist()), W=W, f_min=rotors.f_min * rotors.W / W, f_max=best.f_max,
        B_x=B_x, B_y=B_y, B_z=B_z,
        pairs=outermost_pairs(rotors.x, rotors.y, rotors.spin, used, yaw=held),
    )  # fmt: skip
    flies = held and T_max >= HOVERS * T_heaviest
    carries = math.acos(min((T_heaviest if flies else T_hover) / T_max, 1.0))
    phi_star = min(limits.phi_star, max(carries, LEAST_TILT))
    return (
        Fate.FLIES if flies else Fate.LANDS,
        after,
        limits._replace(T_max=T_max, phi_star=phi_star),
    )
