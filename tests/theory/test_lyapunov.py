"""V of (15) along the general closed loop, with and without what the proofs ask for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fcu.theory.adaptive import Block, Estimates, Laws, Predictor, lyapunov, predictor
from fcu.theory.arrays import inner, outer, times
from fcu.theory.projection import Ball, ProjectionError, Structure, symmetric_box
from fcu.theory.simulate import ClosedLoop, LoopState, simulate, step_for
from fcu.theory.systems import (
    Plant,
    ReferenceModel,
    Uncertainty,
    constant,
    swinging,
    symmetric,
    unlimited,
)

GAMMA = {"Theta": 300.0, "Lambda": 200.0, "d": 500.0, "C": 400.0, "s": 600.0}


def batch(rng, count, structure, moving=False, beside=False, v_star=None):
    """`count` random systems, n = 4, q = 2, p = 3: plant, and a start with wrong estimates."""
    n, q, p, c = 4, 2, 3, 2
    A = rng.normal(size=(count, n, n))
    A -= (np.linalg.eigvals(A).real.max(axis=1) + 0.5)[:, None, None] * np.eye(n)
    B, root = rng.normal(size=(count, n, q)), rng.normal(size=(count, n, n))
    Q = root @ np.swapaxes(root, 1, 2) + np.eye(n)
    eigenvalues = rng.uniform(0.5, 2.0, (count, q))
    if structure is Structure.SCALAR:
        eigenvalues[:, 1] = eigenvalues[:, 0]
    Lambda = eigenvalues[..., None] * np.eye(q)
    if structure is Structure.FULL:
        turn, _ = np.linalg.qr(rng.normal(size=(count, q, q)))
        Lambda = turn @ Lambda @ np.swapaxes(turn, 1, 2)
        Lambda = 0.5 * (Lambda + np.swapaxes(Lambda, 1, 2))

    def unknown(rows, columns):
        mean = rng.normal(size=(count, rows, columns))
        if not moving:
            return constant(mean)
        return swinging(mean, 0.4, rng.uniform(0.5, 3.0, mean.shape), rng.uniform(0, 6, mean.shape))

    truth = Uncertainty(
        swinging(Lambda, 0.3 * Lambda, 1.7) if moving else constant(Lambda),
        0.4 * eigenvalues.min(axis=1),
        structure,
        unknown(q, p),
        unknown(q, 1),
        unknown(q, c) if beside else None,
        unknown(q, 1) if beside else None,
    )
    command = rng.normal(size=(count, q))
    size = np.linalg.norm(ReferenceModel(A, B, Q).P, ord=2, axis=(1, 2))
    plant = Plant(
        ReferenceModel(A, B, Q / size[:, None, None]), truth, lambda t: command * np.sin(2.0 * t),
        f=lambda x, r: np.concatenate([np.tanh(x[..., :2]), r[..., :1]], axis=-1),
        phi=(lambda x, r: np.tanh(x[..., 2:])) if beside else None,
        actuator=unlimited if v_star is None else symmetric(np.full(q, v_star)),
    )  # fmt: skip
    x = rng.normal(size=(count, n))
    estimates = Estimates(
        np.broadcast_to(np.eye(q), Lambda.shape),
        np.zeros((count, q, p)),
        np.zeros((count, q, 1)),
        np.zeros((count, q, c)) if beside else None,
        np.zeros((count, q, 1)) if beside else None,
    )
    return plant, LoopState(x, x, x + 0.1 * rng.normal(size=x.shape), estimates)


def laws_of(plant, kind=Ball, tight=1.0, **more):
    """Blocks whose sets hold the truth: of its own bound, so that projection acts."""
    truth = plant.truth

    def block(name):
        unknown = getattr(truth, name)
        if unknown is None:
            return None
        if kind is Ball:
            return Block(GAMMA[name], Ball(tight * unknown.bound))
        half_width = tight * unknown.bound[:, None, None] * np.ones(unknown.value(0.0).shape)
        return Block(GAMMA[name], symmetric_box(half_width))

    return Laws(*(block(name) for name in ("Lambda", "Theta", "d", "C", "s")), **more)


@pytest.mark.parametrize("beside", [False, True], ids=["inside", "beside"])
def test_the_derivative_of_v_is_the_papers_with_the_term_that_13_lacks(beside):
    """Time-varying everything, saturating, no projection: V' by differences and by formula.

    (13) as printed leaves out 2 tr(Lambda'^T Lambda_til): the difference found is that term.
    """
    rng = np.random.default_rng(13)
    plant, start = batch(rng, 200, Structure.FULL, moving=True, beside=beside, v_star=1.0)
    laws = laws_of(plant, tight=100.0, unsound=True)
    loop = ClosedLoop(plant, predictor(plant.reference, 7.0), laws)
    t, eps = 0.8, 2e-6
    rate = loop.rate(t, start)

    def moved(by):
        estimates = Estimates(*(
            None if e is None else e + by * d
            for e, d in zip(start.estimates, rate.estimates, strict=True)
        ))  # fmt: skip
        state = LoopState(
            *(a + by * b for a, b in zip(start[:3], rate[:3], strict=True)), estimates
        )
        return loop.signals(t + by, state).V

    found = (moved(eps) - moved(-eps)) / (2.0 * eps)

    x_til, errors = start.x - start.x_hat, loop.errors(t, start.estimates)
    dots = {
        name: (unknown.value(t + eps) - unknown.value(t - eps)) / (2.0 * eps)
        for name in ("Lambda", "Theta", "d", "C", "s")
        if (unknown := getattr(plant.truth, name)) is not None
    }
    Lambda, Lambda_dot = plant.truth.Lambda.value(t), dots["Lambda"]
    V_dot = -np.einsum("ni,nij,nj->n", x_til, loop.predictor.dissipation, x_til)  # (16)
    for name in ("Theta", "d"):
        error = getattr(errors, name)
        V_dot += 2.0 * inner(dots[name], Lambda @ error) / GAMMA[name]  # (13)
        V_dot += inner(error, Lambda_dot @ error) / GAMMA[name]  # (13)
    for name in ("C", "s") if beside else ():
        V_dot += 2.0 * inner(dots[name], getattr(errors, name)) / GAMMA[name]
    left_out = 2.0 * inner(Lambda_dot, errors.Lambda) / GAMMA["Lambda"]
    scale = np.abs(V_dot).max()
    np.testing.assert_allclose(found, V_dot + left_out, rtol=0.0, atol=1e-7 * scale)
    assert np.abs(found - V_dot).max() > 1e2 * 1e-7 * scale
    dissipation = plant.reference.Q + 2.0 * 7.0 * plant.reference.P
    np.testing.assert_allclose(loop.predictor.dissipation, dissipation, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("v_star", [None, 0.7], ids=["unlimited", "saturating"])
@pytest.mark.parametrize(
    ("structure", "kind"),
    [(Structure.SCALAR, Ball), (Structure.DIAGONAL, symmetric_box), (Structure.FULL, None)],
    ids=["scalar, ball", "diagonal, box", "full, far sets"],
)
def test_v_does_not_grow_while_the_truth_stands_still(structure, kind, v_star):
    rng = np.random.default_rng(15)
    plant, start = batch(rng, 60, structure, v_star=v_star)
    if kind is None:
        laws = laws_of(plant, tight=100.0, unsound=True)
    else:
        laws = laws_of(plant, kind, weight=structure)
    loop = ClosedLoop(plant, predictor(plant.reference, 10.0), laws)
    run = simulate(loop, start, 0.6, step_for(loop, f=2.0, delta_u=3.0))
    V = run.signals.V
    assert np.diff(V, axis=0).max() < 1e-9 * V[0].min()
    assert np.all(V[-1] < 0.99 * V[0])
    saturated = np.abs(run.signals.u - run.signals.v).max(axis=(0, 2)) > 0.1
    assert saturated.mean() > 0.9 if v_star else not saturated.any()


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Ball, symmetric_box], ids=["ball", "box"])
def test_a_full_lambda_has_sound_sets_for_its_products_beside_it(kind):
    """Lambda Theta and Lambda d, estimated as C and s outside a full, unknown Lambda."""
    plant, start = batch(np.random.default_rng(17), 60, Structure.FULL, v_star=0.7)
    truth, Lambda = plant.truth, plant.truth.Lambda.value(0.0)
    products = Uncertainty(
        truth.Lambda, truth.Lambda_min, Structure.FULL,
        C=constant(Lambda @ truth.Theta.value(0.0)), s=constant(Lambda @ truth.d.value(0.0)),
    )  # fmt: skip
    plant = replace(plant, truth=products, f=None, phi=plant.f)
    laws = laws_of(plant, kind)  # refused, were one of these sets not sound for a full Lambda
    outward = [np.sign(products.C.value(0.0)), np.sign(products.s.value(0.0))]
    C, s = (
        block.kept_in.hold(9.0 * out) for block, out in zip((laws.C, laws.s), outward, strict=True)
    )
    estimates = Estimates(start.estimates.Lambda, None, None, -C, -s)
    loop = ClosedLoop(plant, predictor(plant.reference, 10.0), laws)
    run = simulate(
        loop,
        start._replace(estimates=estimates),
        0.6,
        step_for(loop, phi=2.0, delta_u=3.0, radians=0.15),
    )
    V = run.signals.V
    # a step across a kink of Pr costs an error of its square
    assert np.diff(V, axis=0).max() < 1e-5 * V[0].min()
    assert np.all(V[-1] < 0.99 * V[0])
    assert (np.abs(run.signals.u - run.signals.v).max(axis=(0, 2)) > 0.1).mean() > 0.9


@pytest.mark.slow
def test_v_does_not_grow_with_unknowns_beside_lambda():
    rng = np.random.default_rng(16)
    plant, start = batch(rng, 60, Structure.DIAGONAL, beside=True, v_star=1.0)
    laws = laws_of(plant, symmetric_box, weight=Structure.DIAGONAL)
    keeps_off_zero = Block(GAMMA["Lambda"], symmetric_box(np.full((60, 2, 2), 5.0)))
    laws = Laws(keeps_off_zero, *laws.blocks[1:], weight=Structure.DIAGONAL)
    loop = ClosedLoop(plant, predictor(plant.reference, 10.0), laws)
    V = simulate(loop, start, 0.6, step_for(loop, f=2.0, phi=1.5, delta_u=3.0)).signals.V
    assert np.diff(V, axis=0).max() < 1e-9 * V[0].min()
    assert np.all(V[-1] < 0.99 * V[0])


def test_a_ball_with_a_diagonal_lambda_can_raise_v():
    """Slip: a norm ball is not sound there. V' of the projected law, above that without projection."""
    eye = np.eye(2)
    Lambda = np.diag([0.1, 2.0])
    truth, estimate = np.array([[0.05], [0.99]]), np.array([[0.8], [0.6]])
    reference = ReferenceModel(-eye, eye, eye)
    told = predictor(reference, 1.0)
    x_til = 1e-3 * np.array([1.0, 1.0])
    Y = outer(told.y_til(x_til), np.ones(1))

    def V_dot(kept_in):
        block = Block(1.0, kept_in)
        taken = Y - block.rate(estimate, Y)
        dissipated = x_til @ told.dissipation @ x_til
        return -dissipated + 2.0 * float(inner(truth - estimate, Lambda @ taken))

    assert V_dot(Ball(1.0, 0.0)) > 1e-5
    assert V_dot(Ball(1.0, 0.1)) < 0.0  # just inside its outer set this one does not act yet
    assert V_dot(Ball(1.0 / 1.1, 0.1)) > 1e-5
    assert V_dot(symmetric_box(np.array([[0.8], [1.0]]), 0.0)) < 0.0
    with pytest.raises(ProjectionError, match="use a box"):
        Laws(None, Theta=Block(1.0, Ball(1.0)), weight=Structure.DIAGONAL)


def test_one_unknown_times_the_identity_counts_once():
    """Lambda = lambda I over three axes: V holds lambda_til^2/gamma, as its law moves one number."""
    told = Predictor(np.zeros((3, 3)), np.eye(3), np.eye(3), np.eye(3))
    laws = Laws(Block(4.0, Ball(1.0), Structure.SCALAR), weight=Structure.SCALAR)
    V = lyapunov(told, laws, np.eye(3), np.zeros(3), Estimates(0.2 * np.eye(3)))
    assert pytest.approx(0.2**2 / 4.0) == V


def saturated_loop(achieved):
    """x' = -x + r + u + theta x + d with |u| at most 1, too little for a while: r = 3 for 1 s."""
    one = np.ones((1, 1))
    truth = Uncertainty(
        constant(one), np.array(1.0), Structure.SCALAR, constant(0.5 * one), constant(0.4 * one)
    )
    plant = Plant(
        ReferenceModel(-one, one, one), truth, lambda t: np.array([3.0]), f=lambda x, r: x - 2.0 * r,
        actuator=symmetric(np.ones(1)),
    )  # fmt: skip
    far = symmetric_box(1e3 * one)
    laws = Laws(Block(100.0, far), Block(100.0, far), Block(100.0, far), weight=Structure.SCALAR)
    start = LoopState(
        np.zeros(1), np.zeros(1), np.zeros(1), Estimates(one, np.zeros((1, 1)), np.zeros((1, 1)))
    )
    loop = ClosedLoop(plant, predictor(plant.reference, 10.0), laws, achieved)
    return simulate(loop, start, 3.0, 2e-3, every=1)


@pytest.mark.slow
def test_with_delta_u_estimates_stay_bounded_through_saturation_and_without_they_wind_up():
    """(9) against (8) told the demand: same plant, same gains, actuator at its limit all the while."""
    with_it, without = saturated_loop(True), saturated_loop(False)
    for run in (with_it, without):
        assert np.abs(run.signals.u - run.signals.v)[50:].min() > 0.05
    V = with_it.signals.V
    assert np.diff(V).max() < 1e-9 * V[0]
    assert np.abs(with_it.states.estimates.Theta).max() < 2.0
    assert np.abs(with_it.states.estimates.d).max() < 2.0
    assert without.signals.V[-1] > 100.0 * without.signals.V[0]
    assert np.abs(without.states.estimates.Theta[-1]) > 10.0


def test_inside_the_limits_the_predictor_is_the_modified_reference_model():
    """(5) with u = v is (8): x_hat' = A x_hat + B r + k x_til, and Lambda_hat stands still."""
    plant, start = batch(np.random.default_rng(8), 50, Structure.FULL, moving=True)
    loop = ClosedLoop(plant, predictor(plant.reference, 9.0), laws_of(plant, unsound=True))
    rate, ref = loop.rate(0.3, start), plant.reference
    expected = ref.rate(start.x_hat, plant.r(0.3)) + 9.0 * (start.x - start.x_hat)  # (8)
    np.testing.assert_allclose(rate.x_hat, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())
    assert np.abs(rate.estimates.Lambda).max() < 1e-12 * np.abs(rate.estimates.Theta).max()
    v_0 = loop.signals(0.3, start).v_0
    x_dot = plant.rate(0.3, start.x, v_0, plant.r(0.3))
    expected = ref.rate(start.x, plant.r(0.3))
    np.testing.assert_allclose(x_dot, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())
    assert times(ref.A, start.x).shape == start.x.shape
