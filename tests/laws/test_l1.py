"""L1 against its publication: closed forms, its authors' vehicle, gains and injected uncertainties.

The numbers are those of the authors' code (sigma-pi/L1Quad, commit 18664bf): for their simulation 3 kg,
0.023, 0.023 and 0.0459 kg m^2, A_s of -5 and -10, cut-offs of 10 and, one after the other, 10 and 2
rad/s, gains of 18 and 27.6, 4 and 6, 5.4 and 0.092, 0.6 and 0.023, a rate of 400 Hz.
"""

from __future__ import annotations

import math
from copy import deepcopy

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fcu.kernel.algebra import Vec3
from fcu.kernel.rotations import euler, from_euler, matrix
from tests.laws.conftest import OCTO
from tests.laws.yardstick import ZERO, G, at, flown, fly, hovering

M, J = 3.0, np.array([0.023, 0.023, 0.0459])
RATE = 400.0
PAPER = {
    "m": M, "J": tuple(J.tolist()),
    "k_p": (18.0 / M, 18.0 / M, 27.6 / M), "k_v": (4.0 / M, 4.0 / M, 6.0 / M),
    "k_R": (5.4 / J[0], 5.4 / J[1], 0.092 / J[2]), "k_w": (0.6 / J[0], 0.6 / J[1], 0.023 / J[2]),
    "A_v": 5.0, "A_w": 10.0, "w_T": 10.0, "w_M1": 10.0, "w_M2": 2.0, "trim_rate": 0.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def paper():
    """The law with the authors' vehicle and gains, on eight rotors that can carry it."""
    tables = deepcopy(OCTO)
    tables["vehicle"] = {"mass_kg": [M, M], "inertia_kg_m2": [[j, j] for j in J.tolist()]}
    tables["limits"] |= {"thrust_min_n": 0.5, "thrust_max_n": 75.0}
    tables["rotors"] |= {"radius_m": 0.25, "thrust_coefficient": 3e-5, "lag_s": 0.0}
    return flown("l1", tables, RATE, **PAPER)


def random_tick(law, rng):
    """A random measurement near hover, and a State of the tick before it."""
    measured = hovering(
        law.params,
        r_E=Vec3(*rng.normal(scale=0.05, size=3).tolist()),
        v_E=Vec3(*rng.normal(scale=0.5, size=3).tolist()),
        q_EB=from_euler(*rng.normal(scale=0.2, size=3).tolist()),
        w_B=Vec3(*rng.normal(scale=0.3, size=3).tolist()),
    )
    return measured, law.face.take_over(law.params, at(), measured)[0]


def test_the_estimate_explains_the_error_of_one_sample(paper):
    """Phi^-1 mu: what remains of a prediction error is gone at the next sample, for any A_s."""
    h = paper.params.h
    for a in (1.0, 5.0, 50.0):
        K, Phi = paper.face.piecewise_constant(a, h)
        assert math.exp(-a * h) - Phi * K == pytest.approx(0.0, abs=1e-15)
        assert Phi == pytest.approx((1.0 - math.exp(-a * h)) / a)


def test_a_constant_force_and_torque_are_found_in_two_samples(paper):
    """To e^(A_s T_s) A_s T_s/(e^(A_s T_s) - 1) of the truth: 0.6 and 1.2 % short at 400 Hz."""
    force, torque = Vec3(0.6, -0.3, 1.5), Vec3(0.01, -0.02, 0.005)
    rows = fly(paper, at()._replace(level=2.0, T_c=M * G), 0.01, lambda t: (force, torque), 0.0, 1)
    told = rows[2][3]
    short = [math.exp(-a / RATE) * (a / RATE) / (1.0 - math.exp(-a / RATE)) for a in (5.0, 10.0)]
    assert short == pytest.approx([0.9938, 0.9876], abs=1e-4)
    found = (told.sigma_um.x, told.sigma_um.y, told.sigma_T)
    assert found == pytest.approx(np.array(force) * short[0], rel=2e-3)
    assert told.sigma_M == pytest.approx(np.array(torque) * short[1], rel=5e-3)


def authors(rows, params, f_thrust, moments, h):
    """sigma_m and u_ad of the law as its authors integrate it: an Euler step of the predictor.

    f_thrust (N), moments (N m): what acted in each tick, as commanded.
    """
    A = np.array([5.0] * 3 + [10.0] * 3)
    decay = np.exp(-A * h)
    z_last, R_last = None, np.eye(3)
    z_hat, sigma = np.zeros(6), np.zeros(6)
    u_T, u_1, u_2 = 0.0, np.zeros(3), np.zeros(3)
    told = []
    for k, (seen, *_) in enumerate(rows):
        z = np.array([*seen.v_E, *seen.w_B])
        R = np.array(matrix(seen.q_EB)).T
        if z_last is None:
            z_hat = z
        else:
            w = z_last[3:]
            f = np.array([0.0, 0.0, -G]) + R_last[:, 2] * f_thrust[k - 1] / M
            alpha = (moments[k - 1] - np.cross(w, J * w)) / J
            rate = np.concatenate([f + sigma[:3], alpha + sigma[3:]]) - A * (z_hat - z_last)
            z_hat = z_hat + h * rate
        sigma = A * decay / (decay - 1.0) * (z_hat - z)
        m_T, m_M = M * R[:, 2] @ sigma[:3], J * sigma[3:]
        if k:
            u_T += (1.0 - math.exp(-10.0 * h)) * (m_T - u_T)
            u_1 = u_1 + (1.0 - math.exp(-10.0 * h)) * (m_M - u_1)
            u_2 = u_2 + (1.0 - math.exp(-2.0 * h)) * (u_1 - u_2)
        told.append([m_T, *m_M, u_T, *u_2])
        z_last, R_last = z, R
    return np.array(told)


def injected(t):
    """What the authors' code injects into thrust and torque: 5 sin(t/2) N, 0.1 sin t, 0.05 sin 2t N m."""
    return 5.0 * math.sin(0.5 * t), Vec3(0.1 * math.sin(t), 0.05 * math.sin(2.0 * t), 0.0)


def injecting(t):
    """The same as pushes; the thrust is nearly upright."""
    T, torque = injected(t)
    return Vec3(0.0, 0.0, T), torque


@pytest.mark.computes
def test_l1_adapts_as_its_authors_code_does(paper):
    """Estimates and compensation of a flight with their uncertainties, within 2 % of the greatest."""
    rows = fly(paper, at(0.3, -0.2, 0.1), 6.0, injecting, 0.0, 1)
    c_T = paper.params.rotors.c_T
    x, y, spin = (np.array(row) for row in paper.params.rotors[:3])
    acted = np.array([np.array(row[2].thrusts) for row in rows])
    moments = np.stack([acted @ y, -acted @ x, -paper.params.rotors.k_Q * acted @ spin], axis=1)
    assert np.all(acted < np.resize(c_T, 8)[0] * 552.0**2)
    theirs = authors(rows, paper.params, acted.sum(axis=1), moments, 1.0 / RATE)
    ours = np.array(
        [
            [i.sigma_T, *i.sigma_M, s.filters.T, *s.filters.M2]
            for _, s, _, i in rows
        ]
    )  # fmt: skip
    late = slice(20, None)
    scale = np.abs(theirs[late]).max(axis=0)
    assert (scale[[0, 1, 2]] > (4.5, 0.09, 0.045)).all()
    error = np.abs(ours - theirs)[late].max(axis=0) / np.where(scale > 1e-3, scale, 1.0)
    assert (error < 0.02).all(), error


@pytest.mark.computes
def test_estimates_follow_the_injected_uncertainties_within_a_sample_or_so(paper):
    """The error of the estimate is of the order of T_s times the uncertainty's rate: here within two."""
    rows = fly(paper, at(), 6.0, injecting, 0.0, 1)
    t = np.arange(len(rows)) / RATE
    true = np.array([[T, *M_] for T, M_ in map(injected, t)])
    found = np.array([[row[3].sigma_T, *row[3].sigma_M] for row in rows])
    rate = np.array([2.5, 0.1, 0.1])
    short = np.array([0.0063 * 5.0, 0.0125 * 0.1, 0.0125 * 0.05])
    assert (np.abs(found - true)[3:, :3].max(axis=0) < 2.0 * rate / RATE + short).all()


@pytest.mark.computes
def test_l1_leaves_a_fifth_of_the_error_of_its_baseline(paper):
    """The publications' claim on average: five times smaller. Here of the injected uncertainties."""
    rms = {}
    for name, cutoffs in {"with": {}, "without": {"w_T": 0.1, "w_M1": 0.1, "w_M2": 0.1}}.items():
        law = paper._replace(params=paper.params._replace(**cutoffs))
        r = np.array([row[0].r_E for row in fly(law, at(), 12.0, injecting, 0.0, 1)])
        rms[name] = math.sqrt(float(np.mean(np.sum(r[2000:] ** 2, axis=1))))
    assert rms["without"] > 5.0 * rms["with"], rms


# --- the baseline


def vee(A):
    return np.array([A[2, 1], A[0, 2], A[1, 0]])


def test_the_demanded_force_is_that_of_the_geometric_controller(paper):
    """(1) and (2) for random states near the setpoint."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        measured, state = random_tick(paper, rng)
        _, _, outputs, told = paper.face.command(state, paper.params, at(), measured)
        R = Rotation.from_quat(measured.q_EB, scalar_first=True).as_matrix()
        r, v = np.array(measured.r_E), np.array(measured.v_E)
        F_d = -np.array([18.0, 18.0, 27.6]) * r - np.array([4.0, 4.0, 6.0]) * v
        F_d = F_d + M * np.array([0.0, 0.0, G])
        assert np.array(told.F_d) == pytest.approx(F_d, rel=1e-9)
        assert outputs.T_c == pytest.approx(F_d @ R[:, 2], rel=1e-9)


def test_the_torque_is_that_of_the_geometric_controller(paper):
    """(4) to (6) in matrices for random states, with an attitude that stands still."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        measured, state = random_tick(paper, rng)
        w, psi = np.array(measured.w_B), euler(matrix(measured.q_EB)).z
        phi, theta, e_psi = (rng.normal(size=3) * (0.2, 0.2, 0.02)).tolist()
        lying = at()._replace(level=1.0, tilt_c=Vec3(phi, theta, 0.0), psi_c=psi + e_psi, T_c=M * G)
        told = paper.face.command(state, paper.params, lying, measured)[3]
        R = Rotation.from_quat(measured.q_EB, scalar_first=True).as_matrix()
        b3 = Rotation.from_euler("ZYX", [psi, theta, phi]).as_matrix()[:, 2]
        yaw = psi + e_psi
        b1 = np.cross([-math.sin(yaw), math.cos(yaw), 0.0], b3)
        b1 /= np.linalg.norm(b1)
        R_c = np.stack([b1, np.cross(b3, b1), b3], axis=1)
        e_R = 0.5 * vee(R_c.T @ R - R.T @ R_c)
        M_b = -np.array([5.4, 5.4, 0.092]) * e_R - np.array([0.6, 0.6, 0.023]) * w
        M_b = M_b + np.cross(w, J * w)
        assert np.array(told.e_R) == pytest.approx(e_R, abs=1e-12)
        assert np.array(told.e_w) == pytest.approx(w, abs=1e-12)
        assert np.array(told.M_b) == pytest.approx(M_b, abs=1e-12)


def test_the_commanded_attitude_turns_as_its_derivatives_say(paper):
    """Omega_c and its rate against differences of R_c along a moving thrust axis and yaw."""
    rng = np.random.default_rng(2)
    face = paper.face
    for _ in range(20):
        q, q_dot, q_ddot = rng.normal(size=(3, 3))
        q[2] += 4.0
        psi, psi_dot = rng.normal(size=2).tolist()

        def R_c(s, at=(q, q_dot, q_ddot, psi, psi_dot)):
            q, q_dot, q_ddot, psi, psi_dot = at
            axis = [q + s * q_dot + 0.5 * s * s * q_ddot, q_dot + s * q_ddot, q_ddot]
            b3 = face.unit(*(Vec3(*a.tolist()) for a in axis))
            return face.commanded(b3, psi + s * psi_dot, psi_dot)

        h = 1e-4
        before, now, after = (R_c(s) for s in (-h, 0.0, h))
        R = [np.array(c.R).T for c in (before, now, after)]
        w = vee(R[1].T @ (R[2] - R[0]) / (2.0 * h))
        assert np.linalg.det(R[1]) == pytest.approx(1.0)
        assert now.w == pytest.approx(w, abs=1e-5)
        w_dot = (np.array(after.w) - np.array(before.w)) / (2.0 * h)
        assert now.w_dot == pytest.approx(w_dot, abs=1e-5)


@pytest.mark.computes
def test_leaning_against_the_unmatched_force_leaves_no_error(paper):
    """As published a steady push aside leaves its force over K_p; leaned against, nothing."""
    push = Vec3(1.5, 0.0, 0.0)
    for tilted, left in ((0.0, 1.5 / 18.0), (1.0, 0.0)):
        law = paper._replace(params=paper.params._replace(tilted=tilted))
        measured = fly(law, at(), 15.0, lambda t: (push, ZERO), 0.0, 1)[-1][0]
        assert measured.r_E.x == pytest.approx(left, abs=0.003)


def test_what_is_fed_forward_is_the_derivative_of_the_commanded_rate_in_body_axes(paper):
    """(4) and (6): of R_EB^T R_c Omega_c, while body and command turn both."""
    rng = np.random.default_rng(4)
    params, h = paper.params, 1e-6
    for _ in range(20):
        measured, _ = random_tick(paper, rng)
        w, w_c, w_c_dot = rng.normal(size=(3, 3))
        R_0, R_c = Rotation.random(2, rng)
        measured = measured._replace(w_B=Vec3(*w.tolist()))
        axes = paper.face.Matrix(*(Vec3(*row) for row in R_c.as_matrix().T.tolist()))
        zero = Vec3(0.0, 0.0, 0.0)
        target = paper.face.Target(
            R=axes, w=Vec3(*w_c.tolist()), w_dot=Vec3(*w_c_dot.tolist()), angles=zero, cut=0.0,
            fed_cut=0.0,
        )  # fmt: skip
        R_EB = paper.face.Matrix(*(Vec3(*row) for row in R_0.as_matrix().T.tolist()))
        base = paper.face.baseline(params, at(), measured, R_EB, target)

        def w_d(t, w=w, w_c=w_c, w_c_dot=w_c_dot, R_0=R_0, R_c=R_c):
            body = R_0 * Rotation.from_rotvec(t * w)
            command = R_c * Rotation.from_rotvec(t * w_c)
            return body.inv().apply(command.apply(w_c + t * w_c_dot))

        closed = np.array(params.k_R) * base.e_R + np.array(params.k_w) * base.e_w
        fed = (np.array(base.M_b) - np.cross(w, J * w)) / J + closed
        assert fed == pytest.approx((w_d(h) - w_d(-h)) / (2.0 * h), abs=1e-6)
