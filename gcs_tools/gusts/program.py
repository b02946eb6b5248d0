"""The wind that makes a linear function of it least, within a speed and a rate: a linear program.

A wind is a velocity at each of some knots, with straight lines between them. That it is no faster than the
bound is asked along `DIRECTIONS`, a polyhedron around the ball. Where an answer is outside the ball a plane
that touches it there is added, and asked again. What is left of that at the end is cut off, so the wind is
within its bounds, and a few percent of what is least at most.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import block_diag, csr_matrix, kron, vstack

from gcs_tools.gusts.air import Bounds

Rows = np.ndarray[Any, np.dtype[np.float64]]

CUTS = 2  # times that planes are added
OUTSIDE = 2e-3  # of the bound: nearer is near enough


class ProgramError(RuntimeError):
    """A linear program without an answer, in its solver's words."""


def _directions() -> Rows:
    """float64[98, 3], of length 1: to the points of a cube's faces, five by five on each."""
    every = np.array(list(itertools.product((-2, -1, 0, 1, 2), repeat=3)), dtype=float)
    outside = every[np.abs(every).max(axis=1) == 2.0]
    return np.asarray(outside / np.linalg.norm(outside, axis=1, keepdims=True))


DIRECTIONS = _directions()


def least(
    gradient: Rows, apart: Rows, bounds: Bounds, near: Rows, by: float, keeps_head: bool
) -> Rows:
    """float64[k, 3], m/s: the velocities at k knots for which `gradient` times them is least.

    gradient : float64[k, 3].  apart : float64[k - 1], s between two knots.  near, by : float64[k, 3] and m/s,
    along each axis no farther from it.  keeps_head : whether the first stays.  Raises ProgramError.
    """
    k = len(gradient)
    change = csr_matrix(np.diff(np.eye(k), axis=0))
    sizes = np.concatenate(
        [np.full(k, bounds.speed), bounds.rate * apart]
    )  # of speeds, and changes
    every = vstack([csr_matrix(np.eye(k)), change], format="csr")
    planes, most = (
        kron(every, csr_matrix(DIRECTIONS), format="csr"),
        np.repeat(sizes, len(DIRECTIONS)),
    )
    scale = max(float(np.abs(gradient).max()), 1e-30)
    axes = kron(every, csr_matrix(np.eye(3)), format="csr")
    found = np.zeros((k, 3))
    off = np.full((k, 3), by)
    off[:1] = 0.0 if keeps_head else by
    free = np.column_stack([(near - off).ravel(), (near + off).ravel()])
    for _ in range(1 + CUTS):
        done = linprog(
            gradient.ravel() / scale, A_ub=planes, b_ub=most, bounds=free, method="highs-ds"
        )
        if done.x is None:
            raise ProgramError(f"the worst wind has no answer: {done.message}")
        found = done.x.reshape(k, 3)
        each = (axes @ done.x).reshape(-1, 3)
        size = np.linalg.norm(each, axis=1)
        outside = np.flatnonzero(size > sizes * (1.0 + OUTSIDE))
        if not len(outside):
            break
        touching = block_diag(list((each[outside] / size[outside, None])[:, None, :]), format="csr")
        chosen = (3 * outside[:, None] + np.arange(3)).ravel()
        planes = vstack([planes, touching @ axes[chosen]], format="csr")
        most = np.concatenate([most, sizes[outside]])
    return within(found, apart, bounds)


def within(velocities: Rows, apart: Rows, bounds: Bounds) -> Rows:
    """The velocities, float64[k, 3], no faster than the bounds: changes cut alike, then each of them."""
    changes = np.diff(velocities, axis=0)
    rates = np.linalg.norm(changes, axis=1) / np.maximum(bounds.rate * apart, 1e-12)
    part = 1.0 / max(1.0, float(rates.max(initial=0.0)))
    kept = velocities[:1] + np.concatenate([np.zeros((1, 3)), part * np.cumsum(changes, axis=0)])
    speeds = np.linalg.norm(kept, axis=1, keepdims=True)
    shorter = np.minimum(1.0, bounds.speed / np.maximum(speeds, 1e-12))
    return np.asarray(kept * shorter * (1.0 - 1e-9))


def smoothed(gradient: Rows, apart: float, bounds: Bounds) -> float:
    """About what `least` gains: of the gradient, float64[k, 3], averaged over the time in which a wind turns round."""
    n = max(1, math.ceil(min(bounds.speed / max(bounds.rate * apart, 1e-12), len(gradient))))
    mean = np.stack([np.convolve(g, np.full(n, 1.0 / n), mode="same") for g in gradient.T], axis=1)
    return bounds.speed * float(np.linalg.norm(mean, axis=1).sum())
