"""Torque about roll and pitch from the least total thrust, by pairs of rotors. Not in the paper.

Let every rotor but those of a pair stand still, and a pair be two rotors that turn opposite ways and
give equal thrust: it turns nothing about yaw. Whatever gives torque about roll and pitch alone, with
thrusts of at least nought, is a mixture of pairs: half of its thrust is given by rotors of each spin.
A torque of one newton of total thrust therefore lies in the polygon whose corners are the outermost
pairs, and the least thrust for a torque is had from the two pairs at the ends of the side towards it.

The pseudo-inverse shares a torque among all rotors, and takes from one what it adds to the one
opposite: of an S1000 it needs 1.7 times that thrust, of a quadrotor the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fcu.kernel.algebra import Rotors, maximum, minimum, select, total
from fcu.kernel.compile import kernel

SAME = 1e-9  # of torques in N m: corners that differ by less are one


class PairsOf(NamedTuple):
    """Shares of each pair's thrust that a rotor gives: one half, or nought. Of a rotor that is a pair by itself, 1."""

    r1: Rotors
    r2: Rotors
    r3: Rotors
    r4: Rotors
    r5: Rotors
    r6: Rotors
    r7: Rotors
    r8: Rotors


class Pairs(NamedTuple):
    """The outermost pairs of an airframe, eight at most, counter-clockwise. Nought where there are fewer.

    A pair's thrust is that of a mixture with the pair before it, or with the one behind it: the lesser of
    the two, where less than half a turn lies between those neighbours, else the greater. It is not below nought.
    """

    before_x: Rotors  # thrust of a pair and the pair before it, one N m about body x, N
    before_y: Rotors  # about body y
    behind_x: Rotors  # of a pair and the pair behind it
    behind_y: Rotors
    wide: Rotors  # 1: more than half a turn lies between the neighbours
    of: PairsOf


def outermost(points: np.ndarray[Any, Any]) -> list[int]:
    """The corners of the convex hull of points float64[n, 2], counter-clockwise: their numbers.

    By a monotone chain (Andrew, 1979). Of points that are the same the first counts.
    """
    order: list[int] = []
    for i in sorted(range(len(points)), key=lambda i: (*np.round(points[i] / SAME).tolist(), i)):
        if not order or np.abs(points[i] - points[order[-1]]).max() > SAME:
            order.append(i)

    def chain(numbers: list[int]) -> list[int]:
        found: list[int] = []
        for i in numbers:
            while len(found) > 1:
                (a, b), (c, d) = (
                    points[found[-1]] - points[found[-2]],
                    points[i] - points[found[-2]],
                )
                if a * d - b * c > SAME * SAME:
                    break
                found.pop()
            found.append(i)
        return found[:-1]

    return chain(order) + chain(order[::-1])


def outermost_pairs(
    x: Rotors, y: Rotors, spin: Rotors, used: Sequence[int], yaw: bool = True
) -> Pairs:
    """The Pairs of the rotors `used`, which hover without torque: they reach around the vehicle.

    x, y, spin : of RotorParams.  used : indices of rotors, from 0.  yaw : false where the torque about
    yaw is given up: each rotor is a pair by itself then.
    """
    both = [(i, j) for i in used for j in used if (spin[i] > 0.0 > spin[j] if yaw else i == j)]
    torque = np.array([[y[i] + y[j], -x[i] - x[j]] for i, j in both]) / 2.0  # N m of 1 N
    corners = outermost(torque)
    before, behind, wide = np.zeros((2, 8)), np.zeros((2, 8)), np.zeros(8)
    members = np.zeros((8, 8))
    for k, number in enumerate(corners):
        last, following = corners[k - 1], corners[(k + 1) % len(corners)]
        before[:, k] = np.linalg.inv(torque[[number, last]].T)[0]
        behind[:, k] = np.linalg.inv(torque[[number, following]].T)[0]
        wide[k] = 1.0 if np.linalg.det(torque[[last, following]]) < 0.0 else 0.0
        for rotor in both[number]:
            members[rotor, k] += 0.5
    b_x, b_y, a_x, a_y, w = (Rotors(*row.tolist()) for row in (*before, *behind, wide))
    of = PairsOf(*(Rotors(*row.tolist()) for row in members))
    return Pairs(before_x=b_x, before_y=b_y, behind_x=a_x, behind_y=a_y, wide=w, of=of)


@kernel
def mixed1(a, b, wide):
    """The thrust of one pair (N) in a mixture, of the two that its neighbours leave it."""
    return maximum(select(wide > 0.5, maximum(a, b), minimum(a, b)), 0.0)


@kernel
def thrusts(pairs, tau_x, tau_y):
    """Thrusts (N) of the rotors, at least nought, that give a torque (N m, B) from the least total thrust."""
    a = tau_x * pairs.before_x + tau_y * pairs.before_y
    b = tau_x * pairs.behind_x + tau_y * pairs.behind_y
    w, of = pairs.wide, pairs.of
    each = Rotors(
        mixed1(a.r1, b.r1, w.r1), mixed1(a.r2, b.r2, w.r2), mixed1(a.r3, b.r3, w.r3),
        mixed1(a.r4, b.r4, w.r4), mixed1(a.r5, b.r5, w.r5), mixed1(a.r6, b.r6, w.r6),
        mixed1(a.r7, b.r7, w.r7), mixed1(a.r8, b.r8, w.r8),
    )  # fmt: skip
    return Rotors(
        total(of.r1 * each), total(of.r2 * each), total(of.r3 * each), total(of.r4 * each),
        total(of.r5 * each), total(of.r6 * each), total(of.r7 * each), total(of.r8 * each),
    )  # fmt: skip
