"""(30) for one channel and for any: against the exact solution, worst cases and each other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from fcu.theory.control_difference import (
    Channel,
    control_difference,
    control_gain,
    prediction_gain,
    settled_prediction,
)
from fcu.theory.linear_loop import Moving, NoBoundError, Start, bounds, loop

ZETAS = (0.05, 0.139, 0.3, 0.5, 0.707, 0.999, 1.0, 1.001, 2.0, 10.0)


def channel(zeta, omega=20.0, Lambda=0.3):
    return Channel(A=0.0, k=2.0 * zeta * omega, Lambda=Lambda, G=omega * omega / Lambda)


def flow(c, h):
    return expm(np.array([[c.A - c.k, c.Lambda], [-c.G, 0.0]]) * h)


def worst(c, out, horizon=40.0, points=8_000):
    """Largest |x_til| (0) or |z| (1) from rest, by the delta of size 1 that does most to it."""
    h = horizon / (c.omega * min(c.zeta, 1.0 / c.zeta)) / points
    M = np.array([[c.A - c.k, c.Lambda, 0.0], [-c.G, 0.0, 1.0], [0.0, 0.0, 0.0]])
    step = expm(M * h)
    state, answers = np.array([0.0, 1.0]), []
    for _ in range(points):
        answers.append(state[out])
        state = step[:2, :2] @ state
    sign = np.sign(answers)[::-1]
    state = np.zeros(3)
    for s in sign:
        state[2] = s
        state = step @ state
    return abs(state[out])


@pytest.mark.parametrize(
    ("zeta", "N"), [(0.139, 4.69), (0.3, 2.37), (0.5, 1.713), (0.707, 1.612), (1.0, 2.0)]
)
def test_the_control_gain_has_these_values(zeta, N):
    assert control_gain(zeta) == pytest.approx(N, abs=1e-3 if zeta > 0.3 else 5e-3)


@pytest.mark.parametrize("zeta", ZETAS)
@pytest.mark.computes
def test_some_disturbance_attains_the_bounds_and_none_exceeds_them(zeta):
    c = channel(zeta)
    for out, bound in (
        (1, control_difference(c, 0.0, 1.0).lasting),
        (0, settled_prediction(c, 1.0)),
    ):
        found = worst(c, out)
        assert 0.98 * bound < found <= bound * (1.0 + 1e-9)


# the fastest reference model beside the slowest predictor, and less of it
WITH_A = [(-5.0, 1.0, 0.1), (-2.0, 10.0, 1.0), (-2.0, 10.0, 30.0), (-3.0, 1.0, 20.0)]


@pytest.mark.parametrize(("A", "k", "G"), WITH_A)
def test_no_disturbance_exceeds_the_bounds_where_a_is_not_small(A, k, G):
    c = Channel(A, k, 1.0, G)
    for out, bound in (
        (1, control_difference(c, 0.0, 1.0).lasting),
        (0, settled_prediction(c, 1.0)),
    ):
        found = worst(c, out)
        assert 0.98 * bound < found <= bound * (1.0 + 1e-9)


@pytest.mark.parametrize(("A", "k", "G"), WITH_A)
@pytest.mark.parametrize("start", [(0.0, 1.0), (1.0, 0.0), (0.3, -1.0)])
@pytest.mark.computes
def test_start_and_disturbance_together_stay_under_30_where_a_is_not_small(A, k, G, start):
    """At every 20th time under the delta that does most to z until then."""
    c = Channel(A, k, 1.0, G)
    bound, points = control_difference(c, start[1], 1.0, start[0]), 1000
    h = 10.0 / (c.omega * min(c.zeta, 1.0 / c.zeta)) / points
    step = expm(np.array([[A - k, 1.0, 0.0], [-G, 0.0, 1.0], [0.0, 0.0, 0.0]]) * h)
    free, answers = [np.array(start)], [np.array([0.0, 1.0])]
    for _ in range(points):
        free.append(step[:2, :2] @ free[-1])
        answers.append(step[:2, :2] @ answers[-1])
    for end in range(0, points + 1, 20):
        state = np.array([*start, 0.0])
        for answer in reversed(answers[:end]):
            state[2] = np.sign(answer[1]) * (1.0 if free[end][1] >= 0.0 else -1.0)
            state = step @ state
        assert abs(state[1]) <= bound.at(end * h) * (1.0 + 1e-9)


@pytest.mark.parametrize("zeta", ZETAS)
@pytest.mark.parametrize("start", [(0.0, 1.0), (1.0, 0.0), (-0.5, 1.0)])
@pytest.mark.computes
def test_the_start_is_forgotten_under_its_envelope(zeta, start):
    c = channel(zeta)
    bound = control_difference(c, start[1], 0.0, start[0])
    h = 0.01 / c.omega
    step, state = flow(c, h), np.array(start)
    closest = np.inf
    for i in range(4000):
        assert abs(state[1]) <= bound.at(i * h) * (1.0 + 1e-9)
        closest = min(closest, bound.at(i * h) / max(abs(state[1]), 1e-300))
        state = step @ state
    if abs(zeta - 1.0) > 0.1:
        assert closest < 2.5


def test_the_gains_join_where_the_roots_meet():
    for of in (control_gain, prediction_gain):
        assert of(1.0 - 1e-4) == pytest.approx(of(1.0), rel=1e-3)
        assert of(1.0 + 1e-4) == pytest.approx(of(1.0), rel=1e-3)


def test_the_lasting_part_shrinks_as_the_root_of_gamma_and_prediction_as_gamma():
    def at(gamma):
        c = Channel(0.0, np.sqrt(gamma), 1.0, gamma)
        return control_difference(c, 0.0, 8.1).lasting, settled_prediction(c, 8.1)

    (v_1, x_1), (v_2, x_2) = at(100.0), at(10_000.0)
    assert v_1 / v_2 == pytest.approx(10.0)
    assert x_1 / x_2 == pytest.approx(100.0)


@pytest.mark.parametrize("zeta", [0.139, 0.5, 2.0])
@pytest.mark.parametrize(("share", "B", "P"), [(1e-6, 1.0, 1.0), (0.7, 1.0, 1.0), (0.4, 3.0, 0.2)])
def test_any_loop_with_one_channel_is_that_channel(zeta, share, B, P):
    """`share` of the decay of x_til comes from A; B and P other than 1 count with Lambda."""
    told, one = channel(zeta), np.eye(1)
    A, k = -share * told.k, (1.0 - share) * told.k
    c = Channel(A, k, told.Lambda * B * B * P, told.G)
    found = bounds(loop(A * one, B * one, P * one, k, told.Lambda * one, told.G), 2.0)
    assert found.control.lasting == pytest.approx(control_difference(c, 0.0, 2.0).lasting, rel=2e-3)
    assert found.prediction[0] == pytest.approx(settled_prediction(c, 2.0) / (B * P), rel=2e-3)


@pytest.mark.parametrize("beside", [False, True])
@pytest.mark.parametrize("norm", ["spectral", "entries"])
@pytest.mark.computes
def test_any_loop_against_random_disturbances_and_moving_regressors(beside, norm):
    rng = np.random.default_rng(3)
    tightest = np.inf
    for _ in range(3):
        n, q = 3, 2
        A = rng.normal(size=(n, n))
        A = A - (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(n)
        B, P, k = rng.normal(size=(n, q)), np.diag(rng.uniform(0.5, 2.0, n)), 12.0
        Lambda, G, swing = np.diag(rng.uniform(0.5, 1.5, q)), 200.0, 10.0
        system = loop(A, B, P, k, Lambda, G, beside)
        start = Start(*(rng.uniform(0.0, 0.1, size) for size in (n, q, n)))
        if norm == "spectral":
            start = Start(*(float(np.linalg.norm(part)) for part in start))
        delta_star = np.full(q, 1.0) if norm == "entries" else np.sqrt(q)
        moved = np.eye(q) * swing if norm == "entries" else swing
        found = bounds(system, delta_star, start, Moving(G=moved), norm)
        M, h = system.whole, 2e-3
        state = np.concatenate([np.atleast_1d(np.asarray(part)) * np.ones(size) / (
            np.sqrt(size) if norm == "spectral" else 1.0
        ) for part, size in zip(start, (n, q, n), strict=True)])  # fmt: skip
        most = dict.fromkeys("xve", 0.0)
        control = found.control
        for i in range(1200):
            delta = np.sign(np.sin(9.0 * i * h + np.arange(q)))
            departure = swing * np.sin(7.0 * i * h)
            moving = M.copy()
            moving[n : n + q, :n] -= departure * system.output
            middle = state + 0.5 * h * (moving @ state)
            middle[n : n + q] += 0.5 * h * delta
            state = state + h * (moving @ middle)
            state[n : n + q] += h * delta
            v = system.control @ state[n : n + q]
            parts = {"x": state[:n], "v": v, "e": state[n + q :]}
            for name, part in parts.items():
                size = np.abs(part) if norm == "entries" else np.linalg.norm(part)
                most[name] = np.maximum(most[name], size)
            assert np.max(np.abs(v)) <= control.at((i + 1) * h)
        for name, bound in (
            ("x", found.prediction),
            ("v", found.control_peak),
            ("e", found.tracking),
        ):
            assert np.all(most[name] <= bound)
            tightest = min(tightest, float(np.min(bound / most[name])))
    assert tightest < 4.0


@pytest.mark.parametrize("norm", ["spectral", "entries"])
def test_a_lambda_that_moves_beside_the_disturbance_enlarges_the_control_alone(norm):
    """v_0 - v = -Lambda(t)^-1 z: z does most when Lambda is at its least."""
    eye, swing = np.eye(2), 0.3
    Lambda = np.diag([0.5, 2.0])
    system = loop(-eye, eye, eye, 10.0, Lambda, 100.0, beside=True)
    delta = np.ones(2) if norm == "entries" else 1.0
    moved = swing * eye if norm == "entries" else swing
    still = bounds(system, delta, norm=norm)
    found = bounds(system, delta, moving=Moving(Lambda=moved), norm=norm)
    assert np.array_equal(found.prediction, still.prediction)
    assert np.array_equal(found.tracking, still.tracking)
    z = worst(Channel(-1.0, 10.0, 1.0, 100.0), out=1)
    least = np.diag(Lambda) - swing
    measured = z / least if norm == "entries" else z / least.min()
    assert np.all(0.98 * found.control_peak < measured)
    assert np.all(measured <= found.control_peak)
    assert found.control.lasting == pytest.approx(float(np.max(found.control_settled)))
    assert np.max(measured) > np.max(still.control_peak)


def test_a_lambda_that_may_become_singular_has_no_bound_of_the_control():
    one = np.eye(1)
    system = loop(-one, one, one, 10.0, 0.5 * one, 100.0, beside=True)
    with pytest.raises(NoBoundError, match="singular"):
        bounds(system, 1.0, moving=Moving(Lambda=0.5))


def test_a_regressor_that_moves_too_far_has_no_bound():
    one = np.eye(1)
    system = loop(-one, one, one, 10.0, one, 100.0)
    with pytest.raises(NoBoundError, match="not below 1"):
        bounds(system, 1.0, moving=Moving(G=95.0))
    near = bounds(system, 1.0, moving=Moving(G=20.0))
    assert 0.1 < near.loop_gain < 1.0
    assert near.prediction[0] > bounds(system, 1.0).prediction[0]
