"""What holds while projection acts: the range of G, and bounds of runs that reach their sets."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.theory.adaptive import Block, Estimates, Laws, predictor
from fcu.theory.linear_loop import Moving, Start, any_projection, bounds, loop
from fcu.theory.loop_bounds import Flight, position_bounds, rate_bounds
from fcu.theory.projection import Ball, Structure, symmetric_box
from fcu.theory.scenes import WIND, drag
from fcu.theory.simulate import ClosedLoop, LoopState, simulate, step_for
from fcu.theory.sweep import hover_run, with_gamma
from fcu.theory.systems import Plant, ReferenceModel, Uncertainty, Varying, constant

GAMMA, K = 100.0, 10.0


def stiffness(kept_in, Theta_hat, f, y_til):
    """The matrix M with Pr(Theta_hat, y f^T) f = M y for every y near y_til."""
    columns, h = [], 1e-6
    for unit in np.eye(len(y_til)):
        ahead, behind = (
            kept_in.rate(Theta_hat, np.outer(y_til + side * h * unit, f)) @ f for side in (1, -1)
        )
        columns.append((ahead - behind) / (2.0 * h))
    return np.array(columns).T


@pytest.mark.parametrize("margin", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("shape", ["ball", "box"])
@pytest.mark.computes
def test_projection_of_theta_hat_leaves_g_in_its_range(shape, margin):
    """Estimates on the edge of the outer set, and between the edges; adaptation in and outward."""
    rng = np.random.default_rng(5)
    least, acted = np.inf, 0
    for _ in range(300):
        q, p = rng.integers(1, 5, 2)
        Theta_hat, f, y_til = rng.normal(size=(q, p)), rng.normal(size=p), rng.normal(size=q)
        reach = 1.0 + margin * rng.choice([1.0, rng.random()])
        if shape == "ball":
            kept_in = Ball(float(np.linalg.norm(Theta_hat)) / reach, margin)
        else:
            at_edge = rng.random((q, p)) < 0.7
            kept_in = symmetric_box(np.abs(Theta_hat) / np.where(at_edge, reach, 0.5), margin)
        found = stiffness(kept_in, Theta_hat, f, y_til)
        whole = float(f @ f)
        assert found == pytest.approx(found.T, abs=1e-6 * whole)
        assert kept_in.rate(Theta_hat, np.outer(y_til, f)) @ f == pytest.approx(
            found @ y_til, abs=1e-6 * whole
        )
        shares = np.linalg.eigvalsh(found) / whole
        assert shares.min() > -1e-6 and shares.max() < 1.0 + 1e-6
        least, acted = min(least, float(shares.min())), acted + (shares.min() < 0.999)
    assert least < 0.01 and acted > 50
    G, moving = any_projection(2.0, 3.0, 0.5)
    low, high = G - moving.G, G + moving.G
    assert (low, high) == pytest.approx((2.0, 2.75))


def one_channel(Theta, d, f, r, kept_in, d_set, start):
    """A channel with A = -1, B = P = Lambda = 1, that knows Lambda; `start` is Theta_hat(0)."""
    count = len(Theta)
    one = np.ones((count, 1, 1))
    told = ReferenceModel(-one, one, 2.0 * one)
    truth = Uncertainty(
        constant(one), np.ones(count), Structure.SCALAR, Theta=constant(Theta[:, None, None]), d=d
    )
    laws = Laws(None, Theta=Block(GAMMA, kept_in), d=Block(GAMMA, d_set), weight=Structure.SCALAR)
    whole = ClosedLoop(Plant(told, truth, r, f=f), predictor(told, K), laws)
    nothing = np.zeros((count, 1))
    estimates = Estimates(one, Theta=start[:, None, None] * one, d=0.0 * one)
    return whole, LoopState(nothing, nothing, nothing, estimates)


def bound(d_rate, Theta_error, f_star, f_rate, z_0, G=None, moving=None):
    """Bounds of that channel; by default whatever the projection of Theta_hat does."""
    one = np.eye(1)
    if G is None:
        G, moving = any_projection(GAMMA, GAMMA, f_star)
    system = loop(-one, one, one, K, one, G)
    return bounds(system, d_rate + Theta_error * f_rate, Start(z=z_0), moving, nu_1=0.5)


def largest(run):
    states, signals = run.states, run.signals
    rows = states.x - states.x_hat, signals.v_0 - signals.v, states.x - states.x_m
    return [np.abs(row[..., 0]).max(axis=0) for row in rows]


@pytest.mark.slow
def test_a_regressor_in_quadrature_drives_theta_hat_to_its_edge_and_the_bounds_hold():
    """d = 0.5 sin wt and f = 1 + phi cos wt, with a set three times the truth of 0.5."""
    phi, omega, Theta, size = np.array([0.1, 0.1, 0.3]), np.array([2.0, 5.0, 2.0]), 0.5, 1.5
    f_star, Theta_error = 1.0 + phi, Theta + size
    found = [
        bound(0.5 * w, Theta_error, f, p * w, Theta * f)
        for p, w, f in zip(phi, omega, f_star, strict=True)
    ]
    d_hat = 0.5 + Theta_error * f_star + np.array([float(one.control_peak[0]) for one in found])
    whole, start = one_channel(
        np.full(3, Theta), Varying(
            lambda t: (0.5 * np.sin(omega * t))[:, None, None], np.full(3, 0.5), 0.5 * omega
        ), lambda x, r: 1.0 + phi[:, None] * r, lambda t: np.cos(omega * t)[:, None],
        Ball(size, 0.0), Ball(1.01 * d_hat, 0.0), np.zeros(3),
    )  # fmt: skip
    run = simulate(whole, start, 81.0, step_for(whole, f=1.3), every=2)
    estimates = run.states.estimates
    at_edge = np.abs(estimates.Theta[..., 0, 0]) >= size * (1.0 - 1e-9)
    assert run.t[at_edge.argmax(axis=0)] == pytest.approx([79.3, 30.5, 26.0], abs=0.1)
    assert at_edge[:, 2].sum() > 100
    assert np.all(np.abs(estimates.d[..., 0, 0]).max(axis=0) <= d_hat)
    x_til, v_til, e = largest(run)
    for i, one in enumerate(found):
        assert x_til[i] <= one.prediction[0]
        assert v_til[i] <= one.control_peak[0]
        assert e[i] <= one.tracking[0]


@pytest.mark.parametrize("margin", [0.0, 0.1])
def test_at_the_edge_the_bound_without_projection_is_exceeded_and_the_one_with_it_is_not(margin):
    """Theta_hat is at its edge and d rises: d_hat learns alone, at half the rate."""
    rate, rise, size = 1.0, 3.0, 0.5
    outer = size * (1.0 + margin)
    d = Varying(
        lambda t: np.full((1, 1, 1), rate * min(t, rise)), np.full(1, rise), np.full(1, rate)
    )
    whole, start = one_channel(
        np.zeros(1), d, lambda x, r: np.ones((1, 1)), lambda t: np.zeros((1, 1)),
        Ball(size, margin), Ball(10.0, 0.0), np.full(1, outer),
    )  # fmt: skip
    begin = start._replace(
        estimates=start.estimates._replace(d=np.full((1, 1, 1), -outer))  # so that z(0) = 0
    )
    run = simulate(whole, begin, 2.0 * rise, step_for(whole, f=1.0))
    x_til = largest(run)[0][0]
    narrow = bound(rate, outer, 1.0, 0.0, 0.0, 2.0 * GAMMA, Moving())
    wide = bound(rate, outer, 1.0, 0.0, 0.0)
    assert narrow.prediction[0] < x_til <= wide.prediction[0]


@pytest.mark.slow
def test_the_octocopters_bounds_may_count_on_no_projection_or_do_without(law):
    """A set of 2 % about the mass, which the estimate reaches; gamma_Lambda = 1e-4 gamma."""
    mass, low, high = 8.0, 0.98, 1.02
    params = with_gamma(law(), 1000.0)
    params = params._replace(
        gamma_Lambda=0.1, bounds=params.bounds._replace(m_min=low * mass, m_max=high * mass)
    )
    amplitude, omega = WIND
    most = 0.15 / mass * amplitude**2
    flight = Flight(most, most * omega, np.zeros(3), np.zeros(3), low, high)
    free = position_bounds(params, mass, flight)
    without = position_bounds(params, mass, flight._replace(projected=True))
    assert free.prediction < without.prediction and free.s_hat < params.bounds.s_v_max
    run = hover_run(params, mass, drag(amplitude, omega, 0.15 / mass), 12.0)
    m_hat = 1.0 / run.states.estimates.Lambda
    assert m_hat.max() >= 0.9999 * high * mass or m_hat.min() <= 1.0001 * low * mass
    assert np.linalg.norm(run.states.estimates.s, axis=(-2, -1)).max() <= without.s_hat
    for bounded, rows in (
        (without.prediction, (run.states.x - run.states.x_hat)[:, 3:]),
        (without.control.peak, run.signals.v_0 - run.signals.v),
        (without.tracking, (run.states.x - run.states.x_m)[:, :3]),
    ):
        assert np.linalg.norm(rows, axis=-1).max() < bounded
    turning = rate_bounds(params, np.full(3, 0.3), flight._replace(s=most / 4, s_rate=most))
    again = rate_bounds(
        params, np.full(3, 0.3), flight._replace(s=most / 4, s_rate=most, projected=True)
    )
    assert turning == again  # their G counts on the disturbance alone
