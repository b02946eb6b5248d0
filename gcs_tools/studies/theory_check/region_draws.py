"""Random systems of the paper's own form, Theta f = K x + K_0 g(x) - Lambda^-1 r, for (31).

Constant unknowns, d moving inside Lambda, Lambda a multiple of the identity. The actuator is
left open: its limits are computed from the condition.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fcu.theory.adaptive import Block, Estimates, Laws, predictor
from fcu.theory.arrays import Array, frobenius
from fcu.theory.projection import Ball, Box, Structure
from fcu.theory.simulate import ClosedLoop, LoopState, Run
from fcu.theory.systems import (
    Actuator,
    Plant,
    ReferenceModel,
    Signal,
    Uncertainty,
    Varying,
    constant,
)
from gcs_tools.studies.theory_check.draws import Rng, commands, model, spread, unknown

WIDTH = 0.02  # Theta_hat is kept within this of a guess, component by component
OFF = 0.01  # and the truth is within this of it
SHARE = 0.05  # gamma of Theta over that of d: with more it learns d in Theta's place
ROOM = 3.0  # projection set of d_hat over the size of d


@dataclass(frozen=True)
class RegionDraw:
    """A batch of systems (N in front of every array) without their actuator."""

    reference: ReferenceModel
    Lambda: Array  # (N, q, q)
    K: Array  # (N, q, n)
    K_0: Array  # (N, q, g)
    W: Array  # (N, g, n), g(x) = sin(W x)
    guess: Array  # (N, q, n + g + q), of Theta
    d: Varying
    gamma: Array  # (N,)
    k: Array
    r: Signal
    r_star: Array
    r_rate: Array
    start: LoopState

    @property
    def q(self) -> int:
        """Number of inputs."""
        return self.reference.q

    @property
    def Theta(self) -> Array:
        """(N, q, n + g + q): K, K_0 and -Lambda^-1 side by side."""
        return np.concatenate([self.K, self.K_0, -np.linalg.inv(self.Lambda)], axis=-1)

    @property
    def d_star(self) -> Array:
        """(N,)."""
        return np.asarray(self.d.bound)

    @property
    def d_rate(self) -> Array:
        """(N,)."""
        return np.asarray(self.d.rate_bound)

    @property
    def Theta_error(self) -> Array:
        """(N,), largest error of Theta_hat inside its set."""
        return np.asarray((WIDTH + OFF) * np.sqrt(self.Theta[0].size) * np.ones(len(self.k)))

    @property
    def f_star(self) -> float:
        """About the largest regressor, for the step of integration."""
        return float(np.sqrt(4.0 + self.K_0.shape[-1]))

    def f(self, x: Array, r: Array) -> Array:
        """x, g(x), r (N, n + g + q)."""
        g = np.sin((self.W @ x[..., None])[..., 0])
        return np.concatenate([x, g, np.broadcast_to(r, (*x.shape[:-1], self.q))], axis=-1)

    @property
    def z_0(self) -> Array:
        """(N,), |Theta_til f + d_til| at the start, from estimates of zero."""
        f = self.f(self.start.x, self.r(0.0))
        z = ((self.Theta - self.guess) @ f[..., None])[..., 0] + self.d.value(0.0)[..., 0]
        return np.asarray(np.linalg.norm(z, axis=-1))

    def loop(self, actuator: Actuator) -> ClosedLoop:
        """The closed loops with an actuator."""
        truth = Uncertainty(
            constant(self.Lambda), self.Lambda[:, 0, 0], Structure.SCALAR,
            Theta=constant(self.Theta), d=self.d,
        )  # fmt: skip
        laws = Laws(
            Lambda=Block(self.gamma, Ball(ROOM * self.Lambda[:, 0, 0], 0.0), Structure.SCALAR),
            Theta=Block(SHARE * self.gamma, Box(self.guess - WIDTH, self.guess + WIDTH, 0.0)),
            d=Block(self.gamma, Ball(ROOM * self.d_star, 0.0)),
            weight=Structure.SCALAR,
        )
        plant = Plant(self.reference, truth, self.r, f=self.f, actuator=actuator)
        return ClosedLoop(plant, predictor(self.reference, self.k), laws)

    def projected(self, run: Run) -> Array:
        """bool (N,): whether an estimate ever reached the edge of its set."""
        Theta, d = run.states.estimates.Theta, run.states.estimates.d
        assert Theta is not None and d is not None
        at_edge = (np.abs(Theta - self.guess) >= WIDTH).any(axis=(0, -2, -1))
        return np.asarray(at_edge | (frobenius(d) >= ROOM * self.d_star).any(axis=0))


def region_draw(rng: Rng, count: int, decade: int) -> RegionDraw:
    """Systems with commands and starts of a few tenths; gamma from 10^decade."""
    q = int(rng.integers(1, 4))
    n, g = int(rng.integers(q, 5)), int(rng.integers(1, 3))
    reference = model(rng, count, n, q)
    Lambda = spread(rng, 0.5, 3.0, (count, 1, 1)) * np.eye(q)
    gamma = spread(rng, 10.0**decade, 10.0 ** (decade + 1), count)
    k = np.sqrt(gamma) * np.where(rng.random(count) < 0.5, 1.0, spread(rng, 1.0, 3.0, count))
    r, r_star, r_rate = commands(rng, count, q, 0.03)
    x_m = 0.05 * rng.normal(size=(count, n))
    x = x_m + 0.02 * rng.normal(size=(count, n)) * (rng.random((count, 1)) < 0.5)
    K, K_0 = 0.3 * rng.normal(size=(count, q, n)), 0.3 * rng.normal(size=(count, q, g))
    Theta = np.concatenate([K, K_0, -np.linalg.inv(Lambda)], axis=-1)
    guess = Theta + rng.uniform(-OFF, OFF, Theta.shape)
    start = LoopState(
        x, x_m, x, Estimates(Lambda[:, :1, :1], guess, np.zeros((count, q, 1)))
    )  # fmt: skip
    return RegionDraw(
        reference, Lambda, K, K_0, 0.5 * rng.normal(size=(count, g, n)), guess,
        unknown(rng, count, q, 1, 0.2, moving=True), gamma, k, r, r_star, r_rate, start,
    )  # fmt: skip
