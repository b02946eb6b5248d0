"""Simulated errors held against their bounds, system by system.

What each bound assumes stands with it; a system outside of it is not counted, and how many
were is told.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from fcu.guard.responses import gain, peak
from fcu.theory.arrays import Array, frobenius
from fcu.theory.bounds import prediction_bound
from fcu.theory.guarantee import Assumptions, Guarantee, Model, guarantee
from fcu.theory.linear_loop import LoopBounds, Moving, NoBoundError, Start, bounds, loop
from fcu.theory.region import Reference, Sizes
from fcu.theory.simulate import Run, simulate, step_for
from fcu.theory.systems import sat, symmetric
from gcs_tools.studies.theory_check.draws import Draw, Rng, draw, shape
from gcs_tools.studies.theory_check.region_draws import RegionDraw, region_draw

STEPS = 3000  # of integration, each 0.3 over the fastest frequency or less
ROUNDING = 1e-9  # relative, of a bound that may be met exactly


class Held(NamedTuple):
    """One bound of one system: what it says, and the largest that was simulated."""

    name: str
    bound: float
    measured: float
    exceeded: bool
    aimed: bool = True  # at this bound: counts for how tight it is
    projected: bool = False  # whether the projection of Theta_hat acted, which the bound allows


class Excluded(NamedTuple):
    """One system that is outside of what a bound assumes: which bound, and why."""

    name: str
    why: str


def held(name: str, bound: float, measured: float) -> Held:
    """A bound of the largest value."""
    return Held(name, bound, measured, measured > bound * (1.0 + ROUNDING))


def lyapunov(drawn: Draw, run: Run) -> Iterator[Held]:
    """(14), (19), (20): assumed is only a sound projection; saturation or not, Lambda(t) too."""
    reference = drawn.loop.plant.reference
    x_til = run.states.x - run.states.x_hat
    bound = prediction_bound(
        drawn.assumed, drawn.gammas, drawn.k, reference.P, reference.Q, x_til[0]
    )
    size = np.linalg.norm(x_til, axis=-1)
    at = np.stack([np.asarray(bound.at(t)) for t in run.t])
    split = np.stack([np.asarray(bound.split(t)) for t in run.t])
    acts = projected(drawn, run, "Theta")
    over = ((size > at * (1.0 + ROUNDING)) | (at > split * (1.0 + ROUNDING))).any(axis=0)
    for i in range(size.shape[1]):
        measured = float(size[:, i].max())
        bound_i, acted = float(at[:, i].max()), bool(acts[i])
        yield Held("prediction (14)", bound_i, measured, bool(over[i]), projected=acted)


def projected(drawn: Draw, run: Run, name: str) -> Array:
    """bool (N,): whether an estimate ever left its inner set, where projection begins."""
    block, estimate = getattr(drawn.loop.laws, name), getattr(run.states.estimates, name)
    return np.asarray(~np.asarray(block.kept_in.contains(estimate)).all(axis=0))


def linear_bounds(drawn: Draw, run: Run, i: int, acts: bool) -> LoopBounds:
    """Bounds of prediction, control difference and tracking of one system of a linear draw.

    acts : whether the projection of Theta_hat acts, which may lower G to gamma_d.
    """
    told, truth = drawn.loop.plant.reference, drawn.loop.plant.truth
    beside, known = drawn.shape.beside, drawn.assumed
    Lambda = truth.Lambda.value(0.0)[i]
    gamma_d = float(np.asarray(drawn.gammas.s if beside else drawn.gammas.d)[i])
    gamma_Theta = float(np.asarray(drawn.gammas.Theta)[i])
    reach = float(np.linalg.norm(drawn.F[i], 2)) * drawn.r_star[i]
    middle = float(np.linalg.norm(drawn.f_0[i]))
    low = 0.0 if acts else max(middle - reach, 0.0) ** 2
    high = (middle + reach) ** 2
    scale = Lambda if beside else np.eye(len(Lambda))
    G = gamma_d * np.eye(len(Lambda)) + gamma_Theta * 0.5 * (low + high) * scale
    half = 0.5 * gamma_Theta * (high - low) * float(np.linalg.norm(scale, 2))
    f_rate = float(np.linalg.norm(drawn.F[i], 2)) * drawn.r_rate[i]
    Theta, d = known.Theta, known.s if beside else known.d
    moving = np.asarray(Theta.rate)[i] * (middle + reach) + np.asarray(Theta.error)[i] * f_rate
    delta = float(moving * np.linalg.norm(scale, 2) + np.asarray(d.rate)[i])
    states = run.states
    v_til = (run.signals.v_0 - run.signals.v)[0, i]
    start = Start(
        float(np.linalg.norm((states.x - states.x_hat)[0, i])),
        float(np.linalg.norm(scale @ v_til)),
        float(np.linalg.norm((states.x - states.x_m)[0, i])),
    )
    system = loop(told.A[i], told.B[i], told.P[i], float(drawn.k[i]), Lambda, G, beside)
    return bounds(system, delta, start, Moving(G=half))


def linear(drawn: Draw, run: Run) -> Iterator[Held | Excluded]:
    """(30) and the tracking bound: assumed is no saturation, and constant Lambda.

    The projection of Theta_hat may act: then the bounds are those of the whole range of G. That of
    d_hat (s_hat) must not. (30) is held against at every time; its x_til and e at their largest.
    """
    names = ("prediction, 1/gamma", "control difference (30)", "tracking")
    acts = projected(drawn, run, "Theta")
    left = projected(drawn, run, "s" if drawn.shape.beside else "d")
    states = run.states
    x_til = np.linalg.norm(states.x - states.x_hat, axis=-1)
    e = np.linalg.norm(states.x - states.x_m, axis=-1)
    v_til = np.linalg.norm(run.signals.v_0 - run.signals.v, axis=-1)
    for i in range(len(left)):
        if left[i]:
            yield from (Excluded(name, "the projection of d acts") for name in names)
            continue
        try:
            found = linear_bounds(drawn, run, i, bool(acts[i]))
        except NoBoundError:
            yield from (Excluded(name, "the regressor moves too far") for name in names)
            continue
        at_edge = bool(acts[i])
        one = held(names[0], float(found.prediction[0]), float(x_til[:, i].max()))
        yield one._replace(projected=at_edge)
        difference = found.control
        at = difference.beta_1 * np.exp(-difference.nu_1 * run.t) + difference.lasting
        over = bool((v_til[:, i] > at * (1.0 + ROUNDING)).any())
        sharpest = min(difference.peak, float(found.control_peak[0]))
        measured = float(v_til[:, i].max())
        over = over or measured > sharpest * (1.0 + ROUNDING)
        yield Held(names[1], sharpest, measured, over, projected=at_edge)
        one = held(names[2], float(found.tracking[0]), float(e[:, i].max()))
        yield one._replace(projected=at_edge)


def region(rng: Rng, drawn: RegionDraw, steps: int) -> Iterator[Held | Excluded]:
    """(31): systems whose limits are just what the condition asks; none may saturate, nor d_hat
    be larger than the guarantee says.

    All is known before the run: the projection of Theta_hat may act, and d_hat has the set that
    the guarantee asks for.
    """
    name = "control inside the region (31)"
    count = len(drawn.k)
    limits, d_hat = np.full(count, np.nan), np.ones(count)
    for i in range(count):
        try:
            found = region_guarantee(drawn, i)
            limits[i], d_hat[i] = found.budget.used, found.d_hat
        except NoBoundError:
            yield Excluded(name, "the regressor moves too far")
    kept = np.isfinite(limits)
    v_star = np.where(kept, limits, 1.0)[:, None] * np.ones(drawn.q)
    loop_ = drawn.loop(symmetric(v_star), d_hat)
    h = step_for(loop_, f=drawn.f_star)
    run = simulate(loop_, drawn.start, steps * h, h, every=max(1, steps // 1500))
    v = run.signals.v
    saturated = (sat(v, symmetric(v_star)) != v).any(axis=(0, 2))
    acts, learned = drawn.projected(run), run.states.estimates.d
    assert learned is not None
    beyond: list[bool] = (frobenius(learned).max(axis=0) > d_hat * (1.0 + ROUNDING)).tolist()
    for i in map(int, np.flatnonzero(kept)):
        measured = float(np.linalg.norm(v[:, i], axis=-1).max())
        over = bool(saturated[i]) or beyond[i]
        yield Held(name, float(limits[i]), measured, over, projected=bool(acts[i]))


def region_guarantee(drawn: RegionDraw, i: int) -> Guarantee:
    """What (31) asks of the limit of |v| and of the set for d."""
    told = drawn.reference
    A, B = told.A[i], told.B[i]
    Lambda, r_star = drawn.Lambda[i], float(drawn.r_star[i])
    x_m_0 = float(np.linalg.norm(drawn.start.x_m[i]))
    x_m = float(peak(A)[0, 0]) * x_m_0 + float(gain(A, B)[0, 0]) * r_star
    rate = float(np.linalg.norm(A, 2)) * x_m + float(np.linalg.norm(B, 2)) * r_star
    lambda_g = float(np.linalg.norm(drawn.W[i], 2))
    eigenvalues = np.linalg.eigvalsh(Lambda)
    sizes = Sizes(
        K=float(np.linalg.norm(drawn.K[i], 2)),
        Lambda_star=float(eigenvalues[-1]),
        Lambda_least=float(eigenvalues[0]),
        d_star=float(drawn.d_star[i]),
        K_0=float(np.linalg.norm(drawn.K_0[i], 2)),
        lambda_g=lambda_g,
    )
    g = min(lambda_g * x_m, float(np.sqrt(drawn.K_0.shape[-1])))
    assumed = Assumptions(
        sizes, float(drawn.d_rate[i]), float(drawn.Theta_error[i]), Reference(x_m, r_star, g),
        rate, float(drawn.r_rate[i]), float(drawn.z_0[i]),
        e_0=float(np.linalg.norm((drawn.start.x - drawn.start.x_m)[i])),
    )  # fmt: skip
    gammas = float(drawn.gamma_Theta[i]), float(drawn.gamma[i])
    told_model = Model(A, B, told.P[i], float(drawn.k[i]), Lambda, *gammas)
    return guarantee(told_model, assumed, v_star=1.0)


def general_batch(rng: Rng, count: int, decade: int, steps: int) -> list[Held | Excluded]:
    """(14) with everything that it allows."""
    drawn = draw(rng, count, shape(rng, decade), linear=False)
    return list(lyapunov(drawn, _run(drawn, steps)))


def linear_batch(rng: Rng, count: int, decade: int, steps: int) -> list[Held | Excluded]:
    """(30), tracking and the prediction error's own linear bound; (14) besides."""
    drawn = draw(rng, count, shape(rng, decade), linear=True)
    run = _run(drawn, steps)
    return [*lyapunov(drawn, run), *linear(drawn, run)]


def region_batch(rng: Rng, count: int, decade: int, steps: int) -> list[Held | Excluded]:
    """(31): no control saturates."""
    return list(region(rng, region_draw(rng, count, decade), steps))


def _run(drawn: Draw, steps: int) -> Run:
    by_r = np.linalg.norm(drawn.F, axis=(-2, -1)) * drawn.r_star
    f = float(np.max(np.linalg.norm(drawn.f_0, axis=-1) + np.sqrt(drawn.shape.p) + by_r))
    h = step_for(drawn.loop, f=f, delta_u=2.0)
    return simulate(drawn.loop, drawn.start, steps * h, h, every=max(1, steps // 1500))


BATCHES = (general_batch, linear_batch, region_batch)


def random_systems(
    seed: int, systems: int, batch: int = 50, steps: int = STEPS
) -> Iterator[list[Held | Excluded]]:
    """Batches until each kind of bound has held (or not) of at least so many systems.

    gamma goes through the decades from 10 to 1e5, for (31) from 100.
    """
    rng = np.random.default_rng(seed)
    for make in BATCHES:
        counted, number = 0, 0
        while counted < systems:
            # below gamma = 100 the regressor of hardly any region moves little enough for a bound
            decade = 2 + number % 3 if make is region_batch else 1 + number % 4
            found = make(rng, min(batch, systems), decade, steps)
            kinds = [one.name for one in found if isinstance(one, Held)]
            counted += min((kinds.count(kind) for kind in set(kinds)), default=0)
            number += 1
            yield found
