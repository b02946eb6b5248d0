"""Simulation of closed loops in batches: plant, predictor, estimates and reference model.

Classical Runge-Kutta with a fixed step. A batch is one array with a leading axis of systems with
equal n, q, p, so a step of a thousand systems takes little longer than a step of one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fcu.theory.adaptive import (
    Block,
    Estimates,
    Known,
    Laws,
    Predictor,
    control,
    estimate_rates,
    lyapunov,
    prediction_rate,
)
from fcu.theory.arrays import Array, transposed
from fcu.theory.systems import Plant


class SimulationError(ArithmeticError):
    """A state is no longer finite; the message has the time and the systems of the batch."""


class LoopState(NamedTuple):
    """States of plant, reference model and predictor (..., n), and estimates as stored."""

    x: Array
    x_m: Array
    x_hat: Array
    estimates: Estimates


class Signals(NamedTuple):
    """Signals that a closed loop computes from its state."""

    v_0: Array  # (..., q), the control of a known system (21)
    v: Array  # (..., q), demanded (26)
    u: Array  # (..., q), achieved
    V: Array  # (...), (15)


@dataclass(frozen=True)
class ClosedLoop:
    """A plant with its predictor and adaptive laws.

    achieved : True if the predictor and the laws use u, as in (5) and (9); False if they use v,
    which omits Delta_u, as in the printed Section VII.
    """

    plant: Plant
    predictor: Predictor
    laws: Laws
    achieved: bool = True

    def known(self, x: Array, r: Array) -> Known:
        """The regressors at a state and a command."""
        p = self.plant
        return Known(
            x,
            r,
            None if p.f is None else p.f(x, r),
            None if p.phi is None else p.phi(x, r),
            None if p.kappa is None else p.kappa(x, r),
        )

    def rate(self, t: float, state: LoopState) -> LoopState:
        """The right-hand side of the whole loop. Paper (1), (3), (5), (9), (10), (26)."""
        x, x_m, x_hat, stored = state
        r = self.plant.r(t)
        known, full = self.known(x, r), self.laws.full(stored, r.shape[-1])
        v = control(full, known)
        u = self.plant.actuator(x, v)
        told = u if self.achieved else v
        x_til = x - x_hat
        y_til = self.predictor.y_til(x_til)
        return LoopState(
            self.plant.rate(t, x, u, r),
            self.plant.reference.rate(x_m, r),
            prediction_rate(self.predictor, full, known, x_til, told),
            estimate_rates(self.laws, stored, full, known, y_til, told),
        )

    def errors(self, t: float, stored: Estimates) -> Estimates:
        """True values minus estimates, as full matrices: Lambda (..., q, q), Theta (..., q, p)."""
        truth, full = self.plant.truth, self.laws.full(stored, self.plant.reference.q)

        def error(name: str) -> Array | None:
            true, estimate = getattr(truth, name), getattr(full, name)
            return None if true is None or estimate is None else true.value(t) - estimate

        Lambda = truth.Lambda.value(t) - full.Lambda
        return Estimates(Lambda, error("Theta"), error("d"), error("C"), error("s"))

    def signals(self, t: float, state: LoopState) -> Signals:
        """Signals to show and to compare with bounds; the integration does not need them."""
        r = self.plant.r(t)
        full = self.laws.full(state.estimates, r.shape[-1])
        v = control(full, self.known(state.x, r))
        Lambda = self.plant.truth.Lambda.value(t)
        errors = self.errors(t, state.estimates)
        V = lyapunov(self.predictor, self.laws, Lambda, state.x - state.x_hat, errors)
        v_0 = self.plant.known_control(t, state.x, r)
        return Signals(v_0, v, self.plant.actuator(state.x, v), V)


class Run(NamedTuple):
    """A simulated loop: t (m,); every other array has a leading axis of length m."""

    t: Array
    states: LoopState
    signals: Signals


class Layout:
    """Conversion between a LoopState and one array (..., size) with leading batch axes."""

    def __init__(self, state: LoopState) -> None:
        leaves = (*state[:3], *state.estimates)
        self._axes = (1, 1, 1, 2, 2, 2, 2, 2)
        self._shapes = [
            None if leaf is None else leaf.shape[leaf.ndim - axes :]
            for leaf, axes in zip(leaves, self._axes, strict=True)
        ]
        self._sizes = [0 if shape is None else math.prod(shape) for shape in self._shapes]
        self._batch = np.broadcast_shapes(
            *(
                leaf.shape[: leaf.ndim - axes]
                for leaf, axes in zip(leaves, self._axes, strict=True)
                if leaf is not None
            )
        )

    def widened(self, loop: ClosedLoop, state: LoopState) -> Array:
        """A start state as one array, with the batch axes of state and loop."""
        rate = loop.rate(0.0, state)
        self._batch = np.broadcast_shapes(self._batch, Layout(rate)._batch)
        return self.pack(state)

    def pack(self, state: LoopState) -> Array:
        """A state as one new array."""
        y = np.empty((*self._batch, sum(self._sizes)))
        end = 0
        for leaf, axes, size in zip(
            (*state[:3], *state.estimates), self._axes, self._sizes, strict=True
        ):
            if leaf is not None:
                y[..., end : end + size] = leaf.reshape(*leaf.shape[: leaf.ndim - axes], size)
                end += size
        return y

    def unpack(self, y: Array) -> LoopState:
        """A state whose leaves are views of `y`."""
        parts: list[Array | None] = []
        end = 0
        for shape, size in zip(self._shapes, self._sizes, strict=True):
            part = y[..., end : end + size]
            parts.append(None if shape is None else part.reshape(*y.shape[:-1], *shape))
            end += size
        x, x_m, x_hat, *estimates = parts
        return LoopState(x, x_m, x_hat, Estimates(*estimates))  # type: ignore[arg-type]


def simulate(loop: ClosedLoop, start: LoopState, duration: float, h: float, every: int = 1) -> Run:
    """Integrate a loop for `duration` s in steps of at most h s; keep every `every`-th state.

    `step_for` computes a step. After each step, estimates outside their outer set are clipped to
    it. Raises SimulationError, with the time and the systems, if a state is no longer finite.
    """
    steps = every * math.ceil(duration / (h * every) * (1.0 - 1e-12))
    h = duration / steps
    layout = Layout(start)
    y = layout.widened(loop, start)

    def rate(t: float, y: Array) -> Array:
        return layout.pack(loop.rate(t, layout.unpack(y)))

    kept, times_kept = [y], [0.0]
    for step in range(steps):
        t = step * h
        with np.errstate(over="ignore", invalid="ignore"):
            k_1 = rate(t, y)
            k_2 = rate(t + 0.5 * h, y + (0.5 * h) * k_1)
            k_3 = rate(t + 0.5 * h, y + (0.5 * h) * k_2)
            k_4 = rate(t + h, y + h * k_3)
            y = y + (h / 6.0) * (k_1 + 2.0 * (k_2 + k_3) + k_4)
        state = layout.unpack(y)
        y = layout.pack(state._replace(estimates=loop.laws.hold(state.estimates)))
        if (step + 1) % every == 0:
            if not np.isfinite(y).all():
                lost = np.argwhere(~np.isfinite(y).all(axis=-1)).tolist()
                raise SimulationError(
                    f"not finite before t = {t + h:.4g} s in systems {lost}: "
                    f"use a step shorter than {h:.3g} s, or a shorter duration"
                )
            kept.append(y)
            times_kept.append(t + h)
    states = layout.unpack(np.stack(kept))
    shown = [loop.signals(t, layout.unpack(y)) for t, y in zip(times_kept, kept, strict=True)]
    signals = Signals(
        *(np.stack(np.broadcast_arrays(*column)) for column in zip(*shown, strict=True))
    )
    return Run(np.array(times_kept), states, signals)


def step_for(
    loop: ClosedLoop,
    f: float = 0.0,
    phi: float = 0.0,
    delta_u: float = 0.0,
    radians: float = 0.3,
) -> float:
    """A step (s) for regressors of these norms: `radians` of the fastest oscillation in the batch.

    Prediction error and estimates form an oscillator with squared frequency of at most
    |B^T P B| (|Lambda| (gamma_Theta f^2 + gamma_d) + gamma_Lambda delta_u^2 + gamma_C phi^2 +
    gamma_s), damped by L. delta_u is the norm of the whole regressor of Lambda_hat. The fastest
    system determines the step of a batch. Scale each Q so that P has norm 1; then gamma determines
    the frequency.
    """
    told, laws, truth = loop.predictor, loop.laws, loop.plant.truth
    strength = np.linalg.norm(transposed(told.B) @ told.P @ told.B, ord=2, axis=(-2, -1))
    damping = np.linalg.norm(told.L, ord=2, axis=(-2, -1))

    def gamma(block: Block | None) -> Array:
        return np.asarray(0.0 if block is None else block.gamma)

    within = gamma(laws.Theta) * f * f + gamma(laws.d)
    aside = gamma(laws.Lambda) * delta_u**2 + gamma(laws.C) * phi * phi + gamma(laws.s)
    frequency = np.sqrt(strength * (truth.Lambda.bound * within + aside))
    return radians / max(float(frequency.max()), float(damping.max()))
