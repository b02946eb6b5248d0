"""Random systems of the paper's own form, Theta f = K x + K_0 g(x) - Lambda^-1 r, for (31).

Constant unknowns, d moving inside Lambda, Lambda a multiple of the identity. The actuator is
left open: its limits are computed from the condition.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fcu.theory.adaptive import Block, Estimates, Laws, predictor
from fcu.theory.arrays import Array
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

WIDTH = 0.02, 0.2  # Theta_hat is kept within this of a guess, component by component
OFF = 0.5  # times WIDTH: the truth is within this of the guess
SHARE = 0.02, 0.2  # gamma of Theta over that of d
COMMAND = 0.02, 0.2  # size of a component of r; of x_m(0) it is about twice that
ROOM = 1.01  # projection set of d_hat over the bound of |d_hat|


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
    width: Array  # (N,), half of the box of each component of Theta_hat
    gamma: Array  # (N,)
    gamma_Theta: Array
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
        return np.asarray((1.0 + OFF) * self.width * np.sqrt(self.Theta[0].size))

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
        """(N,), |Theta_til f + d_til| at the start, where d_hat = 0."""
        f = self.f(self.start.x, self.r(0.0))
        first = self.start.estimates.Theta
        assert first is not None
        z = ((self.Theta - first) @ f[..., None])[..., 0] + self.d.value(0.0)[..., 0]
        return np.asarray(np.linalg.norm(z, axis=-1))

    def loop(self, actuator: Actuator, d_hat: Array) -> ClosedLoop:
        """The closed loops with an actuator, and sets for d that hold |d_hat| (N,)."""
        truth = Uncertainty(
            constant(self.Lambda), self.Lambda[:, 0, 0], Structure.SCALAR,
            Theta=constant(self.Theta), d=self.d,
        )  # fmt: skip
        width = self.width[:, None, None]
        laws = Laws(
            Lambda=Block(self.gamma, Ball(3.0 * self.Lambda[:, 0, 0], 0.0), Structure.SCALAR),
            Theta=Block(self.gamma_Theta, Box(self.guess - width, self.guess + width, 0.0)),
            d=Block(self.gamma, Ball(ROOM * d_hat, 0.0)),
            weight=Structure.SCALAR,
        )
        plant = Plant(self.reference, truth, self.r, f=self.f, actuator=actuator)
        return ClosedLoop(plant, predictor(self.reference, self.k), laws)

    def projected(self, run: Run) -> Array:
        """bool (N,): whether an estimate of Theta ever reached the edge of its set."""
        Theta = run.states.estimates.Theta
        assert Theta is not None
        at_edge = np.abs(Theta - self.guess) >= (1.0 - 1e-9) * self.width[:, None, None]
        return np.asarray(at_edge.any(axis=(0, -2, -1)))


def region_draw(rng: Rng, count: int, decade: int) -> RegionDraw:
    """Systems of one shape with gamma from 10^decade; all else is drawn for each."""
    q = int(rng.integers(1, 4))
    n, g = int(rng.integers(q, 5)), int(rng.integers(1, 3))
    reference = model(rng, count, n, q)
    Lambda = spread(rng, 0.5, 3.0, (count, 1, 1)) * np.eye(q)
    gamma = spread(rng, 10.0**decade, 10.0 ** (decade + 1), count)
    k = np.sqrt(gamma) * np.where(rng.random(count) < 0.5, 1.0, spread(rng, 1.0, 3.0, count))
    size, width = spread(rng, *COMMAND, (count, 1)), spread(rng, *WIDTH, count)
    r, r_star, r_rate = commands(rng, count, q, size)
    x_m = 2.0 * size * rng.normal(size=(count, n))
    x = x_m + 0.5 * size * rng.normal(size=(count, n)) * (rng.random((count, 1)) < 0.5)
    K, K_0 = 0.3 * rng.normal(size=(count, q, n)), 0.3 * rng.normal(size=(count, q, g))
    Theta = np.concatenate([K, K_0, -np.linalg.inv(Lambda)], axis=-1)
    guess = Theta + OFF * width[:, None, None] * rng.uniform(-1.0, 1.0, Theta.shape)
    # half of the estimates start in a corner of their box, where projection acts at once
    corner = guess + width[:, None, None] * np.sign(rng.normal(size=guess.shape))
    first = np.where(rng.random((count, 1, 1)) < 0.5, corner, guess)
    start = LoopState(
        x, x_m, x, Estimates(Lambda[:, :1, :1], first, np.zeros((count, q, 1)))
    )  # fmt: skip
    return RegionDraw(
        reference, Lambda, K, K_0, 0.5 * rng.normal(size=(count, g, n)), guess,
        unknown(rng, count, q, 1, 0.2, moving=True), width, gamma,
        gamma * spread(rng, *SHARE, count), k, r, r_star, r_rate, start,
    )  # fmt: skip
