"""1000 random instants of the octocopter's loops, and what equal means there."""

from __future__ import annotations

import numpy as np

from fcu.kernel.algebra import Vec3
from fcu.laws.mmrac.prediction import Past
from fcu.theory import octocopter
from tests.laws.values import with_fields

N = 1000
G_E = np.array([0.0, 0.0, -9.81])
AXES = ("roll", "pitch", "yaw")
COUPLINGS = ("c_p1_hat", "c_p2_hat", "c_q1_hat", "c_q2_hat", "c_r1_hat")
EXACT = 1e-12


ZERO = Vec3(0.0, 0.0, 0.0)


def past(w, Omega_m, tau_a=ZERO):
    """A tick over which nothing changed."""
    return Past(T_mean=0.0, T_a=ZERO, tau_a=tau_a, w=w, Omega_m=Omega_m)


def vec3(row):
    return Vec3(*np.asarray(row, dtype=float).tolist())


def equal(a, b, scale):
    """Equal to 1e-12 of the largest term that is summed, state by state."""
    a, b = np.asarray(a), np.asarray(b)
    scale = np.asarray(scale).reshape(-1, *[1] * (a.ndim - 1))
    assert a.shape == b.shape
    assert np.abs((a - b) / scale).max() < EXACT
    assert np.abs(a / scale).max() > 0.01  # and they are not both nothing


def size(*terms):
    """(N,) the largest component of any term, at least 1."""
    return np.max([np.abs(t).reshape(N, -1).max(axis=1) for t in terms] + [np.ones(N)], axis=0)


class States:
    """1000 random instants of both loops, as arrays and as the law's State."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.v, self.v_til = rng.normal(size=(N, 3)) * 5.0, rng.normal(size=(N, 3))
        self.w, self.w_til = rng.normal(size=(N, 3)) * 2.0, rng.normal(size=(N, 3))
        self.s_v, self.s_w = rng.normal(size=(N, 3)) * 3.0, rng.normal(size=(N, 3)) * 3.0
        self.m, self.J = rng.uniform(4.0, 12.0, N), rng.uniform(0.1, 1.0, (N, 3))
        self.c = rng.normal(size=(N, 5)) * (1.0, 1e-3, 1.0, 1e-3, 1.0)
        self.T_a = rng.normal(size=(N, 3)) * 30.0 + (0.0, 0.0, 78.0)
        self.tau_a, self.Omega_m = rng.normal(size=(N, 3)), rng.normal(size=N) * 50.0
        self.a_ref, self.w_c = rng.normal(size=(N, 3)) * 5.0, rng.normal(size=(N, 3))
        self.r = rng.normal(size=(N, 3)) * 5.0
        self.phi = octocopter.products(self.w, self.Omega_m)

    def coupled(self, axis):
        """c_hat and phi of one axis, (N, 2) or (N, 1)."""
        these = octocopter.COUPLED[axis] > 0.0
        return self.c[:, these], self.phi[:, these]

    def law_state(self, start, i, **more):
        return with_fields(
            start, v_hat=vec3(self.v[i] - self.v_til[i]), s_v_hat=vec3(self.s_v[i]), m_hat=float(self.m[i]),
            w_hat=vec3(self.w[i] - self.w_til[i]), s_w_hat=vec3(self.s_w[i]), J_hat=vec3(self.J[i]),
            **{name: float(c) for name, c in zip(COUPLINGS, self.c[i], strict=True)}, **more,
        )  # fmt: skip
