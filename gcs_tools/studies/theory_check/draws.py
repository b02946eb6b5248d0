"""Random systems of the general M-MRAC, a batch of equal shapes at a time.

A batch shares n, q, p, the form of Lambda and where the disturbance acts; everything else is
drawn for each system: models, uncertainty and how it moves, gains (gamma inside one decade, so
that one step of integration suits all), start, command, limits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from fcu.theory.adaptive import Block, Estimates, Laws, predictor
from fcu.theory.arrays import Array, frobenius
from fcu.theory.bounds import Assumed, Blocks, Unknown
from fcu.theory.projection import Ball, Box, Set, Structure, symmetric_box
from fcu.theory.simulate import ClosedLoop, LoopState
from fcu.theory.systems import (
    Plant,
    ReferenceModel,
    Signal,
    Uncertainty,
    Varying,
    swinging,
    symmetric,
    unlimited,
)

Rng = np.random.Generator
LEAST = 0.3  # of Lambda's eigenvalues


@dataclass(frozen=True)
class Shape:
    """What the systems of a batch share."""

    n: int
    q: int
    p: int
    structure: Structure  # of Lambda: SCALAR (projection to balls) or DIAGONAL (to boxes)
    beside: bool  # the disturbance beside Lambda
    saturated: bool
    smooth: bool  # projection of Pomet and Praly, or hard
    gamma: tuple[float, float]

    def __str__(self) -> str:
        """In words."""
        return (
            f"n={self.n} q={self.q} p={self.p} {self.structure.value} "
            f"{'beside' if self.beside else 'inside'} gamma={self.gamma[0]:.0e}"
        )


class Draw(NamedTuple):
    """A batch of loops, from where they start, and what is assumed of them."""

    shape: Shape
    loop: ClosedLoop
    start: LoopState
    assumed: Assumed  # every number (N,)
    gammas: Blocks  # (N,)
    k: Array  # (N,)
    r_star: Array  # (N,), |r|
    r_rate: Array  # (N,), |r'|
    f_0: Array  # (N, p), and F (N, p, q) of the regressor f_0 + F r, where it is that
    F: Array


def shape(rng: Rng, decade: int) -> Shape:
    """A shape, for gamma between 10^decade and ten times that."""
    q = int(rng.integers(1, 4))
    return Shape(
        n=int(rng.integers(q, 5)),
        q=q,
        p=int(rng.integers(1, 5)),
        structure=Structure.SCALAR if rng.random() < 0.5 else Structure.DIAGONAL,
        beside=bool(rng.random() < 0.4),
        saturated=bool(rng.random() < 0.5),
        smooth=bool(rng.random() < 0.5),
        gamma=(10.0**decade, 10.0 ** (decade + 1)),
    )


def spread(rng: Rng, low: float, high: float, size: Any) -> Array:
    """Log-uniform."""
    return np.asarray(np.exp(rng.uniform(np.log(low), np.log(high), size)))


def model(rng: Rng, count: int, n: int, q: int) -> ReferenceModel:
    """Hurwitz A of rates 0.3 to 3 1/s, some oscillating; B of full rank; Q positive definite."""
    A = rng.normal(size=(count, n, n))
    shift = np.linalg.eigvals(A).real.max(axis=-1) + spread(rng, 0.3, 3.0, count)
    A = A - shift[:, None, None] * np.eye(n)
    B = rng.normal(size=(count, n, q))
    B = B + np.sign(B) * 0.2
    root = rng.normal(size=(count, n, n))
    return ReferenceModel(A, B, np.eye(n) + 0.3 * root @ np.swapaxes(root, -1, -2))


def lambdas(rng: Rng, count: int, drawn: Shape, moving: bool) -> tuple[Varying, Unknown]:
    """Lambda(t) with eigenvalues of at least LEAST, and what is assumed of it."""
    one = drawn.structure is Structure.SCALAR
    mean = spread(rng, 2.0 * LEAST, 3.0, (count, 1 if one else drawn.q))
    swing: Array = (mean - LEAST) * rng.uniform(0.1, 0.9, mean.shape) * (1.0 if moving else 0.0)
    omega = spread(rng, 0.5, 10.0, mean.shape)
    phase = np.asarray(rng.uniform(0.0, 6.0, mean.shape))
    if one:
        mean, swing, omega, phase = (
            np.repeat(v, drawn.q, axis=-1) for v in (mean, swing, omega, phase)
        )
    eye = np.eye(drawn.q)
    value = swinging(
        mean[:, None, :] * eye, swing[:, None, :] * eye, omega[:, None, :] * eye,
        phase[:, None, :] * eye,
    )  # fmt: skip
    counted = 1 if one else drawn.q
    high = (mean + swing)[:, :counted]
    rate = (swing * omega)[:, :counted]
    return value, Unknown(
        np.linalg.norm(high, axis=-1), np.linalg.norm(rate, axis=-1),
        norm=high.max(axis=-1), norm_rate=rate.max(axis=-1),
    )  # fmt: skip


def unknown(rng: Rng, count: int, rows: int, columns: int, size: float, moving: bool) -> Varying:
    """A matrix whose components swing about a mean."""
    shape = (count, rows, columns)
    mean = size * rng.normal(size=shape)
    amplitude = size * rng.uniform(0.0, 1.0, shape) * (1.0 if moving else 0.0)
    return swinging(
        mean, amplitude, spread(rng, 0.5, 10.0, shape), rng.uniform(0.0, 6.0, shape)
    )  # fmt: skip


def kept_in(truth: Varying, drawn: Shape, room: float) -> tuple[Set, Unknown]:
    """A sound set that holds the truth with `room` times its bound, and what is then assumed."""
    margin = 0.1 if drawn.smooth else 0.0
    size, rate = np.asarray(truth.bound), np.asarray(truth.rate_bound)
    if drawn.structure is Structure.SCALAR:
        ball = Ball(room * size, margin)
        return ball, Unknown(size, rate, error=ball.farthest(size))
    rows, columns = truth.value(0.0).shape[-2:]
    half = room * size[:, None, None] * np.ones((rows, columns))
    box = symmetric_box(half, margin)
    return box, Unknown(size, rate, error=box.farthest(size))


def gains(rng: Rng, count: int, drawn: Shape) -> tuple[Blocks, Array]:
    """Block gains, the paper's single one for half of the systems; k likewise sqrt(gamma)."""
    gamma = spread(rng, *drawn.gamma, count)
    own = rng.random(count) < 0.5

    def block() -> Array:
        return np.where(own, np.clip(gamma * spread(rng, 0.3, 3.0, count), *drawn.gamma), gamma)

    k = np.sqrt(gamma) * np.where(rng.random(count) < 0.5, 1.0, spread(rng, 0.3, 3.0, count))
    return Blocks(block(), block(), block(), block(), block()), k


def commands(rng: Rng, count: int, q: int, size: Array | float) -> tuple[Signal, Array, Array]:
    """Sinusoidal commands r(t), and bounds (N,) of |r| and |r'|."""
    mean, swing = size * rng.normal(size=(count, q)), size * rng.uniform(0.0, 1.0, (count, q))
    omega = spread(rng, 0.3, 3.0, (count, q))

    def r(t: float) -> Array:
        return np.asarray(mean + swing * np.sin(omega * t))

    star = np.linalg.norm(np.abs(mean) + swing, axis=-1)
    return r, star, np.linalg.norm(swing * omega, axis=-1)


def draw(rng: Rng, count: int, drawn: Shape, linear: bool) -> Draw:
    """A batch. `linear`: with what (30) assumes (no saturation, constant Lambda, regressor f_0 + F r
    of small motion, wide projection sets); else with all that (14) allows.
    """
    n, q, p = drawn.n, drawn.q, drawn.p
    reference = model(rng, count, n, q)
    Lambda, of_Lambda = lambdas(rng, count, drawn, moving=not linear)
    Theta = unknown(rng, count, q, p, 0.5, moving=True)
    d = unknown(rng, count, q, 1, 0.5, moving=True)
    room = 3.0 if linear else 1.0
    Theta_set, of_Theta = kept_in(Theta, drawn, room)
    d_set, of_d = kept_in(d, drawn, room)
    gammas, k = gains(rng, count, drawn)
    r, r_star, r_rate = commands(rng, count, q, 0.5)
    f_0 = rng.normal(size=(count, p))
    F = rng.normal(size=(count, p, q)) * (spread(rng, 0.003, 0.1, (count, 1, 1)) if linear else 1.0)
    W = rng.normal(size=(count, p, n))

    def f(x: Array, r: Array) -> Array:
        by_r = f_0 + (F @ r[..., None])[..., 0]
        return by_r if linear else np.sin((W @ x[..., None])[..., 0]) + by_r

    # the estimate starts at the middle of its set; (30) beside Lambda takes Lambda for known
    counted = 1 if drawn.structure is Structure.SCALAR else q
    high = 1.1 * np.asarray(of_Lambda.star)[:, None, None] * np.ones((counted, 1))
    low = np.full((count, counted, 1), 0.8 * LEAST)
    Lambda_box = Box(low, high, 0.1 if drawn.smooth else 0.0)
    width = np.maximum(
        Lambda_box.outer_high - LEAST, np.asarray(of_Lambda.star)[:, None, None] - low
    )
    of_Lambda = of_Lambda._replace(error=frobenius(np.maximum(width, 0.0)))
    adapted = not (linear and drawn.beside)
    start_Lambda = 0.5 * (low + high)
    if not adapted:
        start_Lambda, of_Lambda = Lambda.value(0.0), of_Lambda._replace(error=np.zeros(count))
    name = "s" if drawn.beside else "d"
    laws = Laws(
        Lambda=Block(gammas.Lambda, Lambda_box, drawn.structure) if adapted else None,
        Theta=Block(gammas.Theta, Theta_set),
        d=None if drawn.beside else Block(gammas.d, d_set),
        s=Block(gammas.s, d_set) if drawn.beside else None,
        weight=drawn.structure,
    )
    truth = Uncertainty(
        Lambda, np.full(count, LEAST), drawn.structure, Theta=Theta, **{name: d}
    )  # fmt: skip
    limits = symmetric(spread(rng, 0.3, 3.0, (count, q)))
    plant = Plant(
        reference, truth, r, f=f,
        actuator=limits if drawn.saturated and not linear else unlimited,
    )  # fmt: skip
    x_m = 0.5 * rng.normal(size=(count, n))
    x = x_m + 0.2 * rng.normal(size=(count, n)) * (rng.random((count, 1)) < 0.5)
    x_til = spread(rng, 1e-3, 0.3, (count, 1)) * rng.normal(size=(count, n))
    x_hat = x - x_til * (rng.random((count, 1)) < 0.3)
    nothing = np.zeros((count, q, 1))
    estimates = Estimates(start_Lambda, np.zeros((count, q, p)), **{name: nothing})
    assumed = Assumed(of_Lambda, np.full(count, LEAST), Theta=of_Theta, **{name: of_d})
    return Draw(
        drawn, ClosedLoop(plant, predictor(reference, k), laws), LoopState(x, x_m, x_hat, estimates),
        assumed, gammas, k, r_star, r_rate, f_0, F,
    )  # fmt: skip
