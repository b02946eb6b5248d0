"""The loops of Section VII, position and the three body rates, as instances of the general form.

An `Image` is a loop of the flight controller at one time, in terms of the general form. Its rates
must equal the continuous right-hand sides of the kernels in `fcu.laws.mmrac`. `position_loop` and
`rate_loop` are complete loops for simulation. They predict with the achieved input and assume that
attitude and rotors follow without lag. The README lists where an image is not exact.

Arrays may have any leading axes. Frames and units are those of `fcu.laws.mmrac.types`. Every set is
a hard box, as in the kernels.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fcu.laws.mmrac.types import Params
from fcu.theory.adaptive import (
    Block,
    Estimates,
    Known,
    Laws,
    Predictor,
    estimate_rates,
    prediction_rate,
)
from fcu.theory.arrays import Array, length
from fcu.theory.projection import Box, Structure
from fcu.theory.simulate import ClosedLoop
from fcu.theory.systems import Actuator, Plant, ReferenceModel, Signal, Uncertainty

ONE = np.ones((1, 1))
# axes (rows) on which the five couplings c_p1, c_p2, c_q1, c_q2, c_r1 (columns) act
COUPLED = np.array([[1, 1, 0, 0, 0], [0, 0, 1, 1, 0], [0, 0, 0, 0, 1]], dtype=float)


class Image(NamedTuple):
    """A loop of the octocopter at one time: all inputs of the general right-hand side."""

    told: Predictor
    laws: Laws
    stored: Estimates
    known: Known
    u: Array  # (..., q), actuator output that the predictor uses

    def rates(self, x_til: Array) -> tuple[Array, Estimates]:
        """x_hat' (..., n) and the rates of the estimates, for a prediction error (..., n)."""
        full = self.laws.full(self.stored, self.known.r.shape[-1])
        y_til = self.told.y_til(x_til)
        x_hat_dot = prediction_rate(self.told, full, self.known, x_til, self.u)
        rates = estimate_rates(self.laws, self.stored, full, self.known, y_til, self.u)
        return x_hat_dot, rates


def integrator(q: int, gain: float) -> Predictor:
    """The predictor of q integrators: A = 0, B = P = I, L = gain I."""
    eye = np.eye(q)
    return Predictor(np.zeros((q, q)), eye, eye, gain * eye)


def box(low: Array | float, high: Array | float, rows: int = 1) -> Box:
    """A hard box of `rows` components with equal limits."""
    return Box(low * np.ones((rows, 1)), high * np.ones((rows, 1)), margin=0.0)


def column(rows: Array) -> Array:
    """(..., q) as a matrix of one column, (..., q, 1)."""
    return np.asarray(rows, dtype=float)[..., None]


def position_achieved(params: Params, v: Array, m_hat: Array, s_v_hat: Array, T_a: Array) -> Image:
    """Velocity, 1/m and s_v from the achieved force: v' = Lambda u + s + kappa. Paper (5), (10).

    v, s_v_hat, T_a : (..., 3).  m_hat : (...).  Lambda = I/m is one unknown, s_v is the s of the
    general form, and gravity is the known term. There is no Theta.
    """
    b = params.bounds
    laws = Laws(
        Lambda=Block(params.gamma_Lambda, box(1.0 / b.m_max, 1.0 / b.m_min), Structure.SCALAR),
        s=Block(params.gamma, box(-b.s_v_max, b.s_v_max, 3)),
        weight=Structure.SCALAR,
    )
    Lambda_hat = 1.0 / np.asarray(m_hat, dtype=float)[..., None, None]
    g_E = np.array([0.0, 0.0, -params.g])
    known = Known(v, np.zeros(3), kappa=g_E)
    return Image(
        integrator(3, params.lambda_v), laws, Estimates(Lambda_hat, s=column(s_v_hat)), known, T_a
    )


def position_demanded(params: Params, v: Array, m_hat: Array, s_v_hat: Array, f_c: Array) -> Image:
    """Velocity, m and s_v as printed: v' = f_c + Lambda (u + Theta f_c) + s. Paper (36)-(38).

    f_c : (..., 3), the demanded specific force, which contains s_v_hat. Theta = -m I is one unknown
    with regressor f = f_c, and f_c is also the known term. The predictor uses the demanded force
    m_hat f_c, so u + Theta_hat f is zero and Lambda_hat has no effect.
    """
    b = params.bounds
    laws = Laws(
        Lambda=None,
        Theta=Block(params.gamma_m, box(-b.m_max, -b.m_min), Structure.SCALAR),
        s=Block(params.gamma, box(-b.s_v_max, b.s_v_max, 3)),
        weight=Structure.SCALAR,
    )
    m = np.asarray(m_hat, dtype=float)
    stored = Estimates(np.eye(3), -m[..., None, None], s=column(s_v_hat))
    known = Known(v, np.zeros(3), f=f_c, kappa=f_c)
    return Image(integrator(3, params.lambda_v), laws, stored, known, m[..., None] * f_c)


def rate_achieved(
    params: Params, w: Array, J_hat: Array, s_hat: Array, c_hat: Array, phi: Array, tau_a: Array
) -> Image:
    """One body rate, 1/J, c and s: w' = Lambda tau + C phi + s. Paper (5), (10), (43).

    w, J_hat, s_hat, tau_a : (...).  c_hat, phi : (..., c), the couplings of the axis and their
    products of rates; roll and pitch have two, yaw has one.
    """
    b, c = params.bounds, np.shape(phi)[-1]
    laws = Laws(
        Lambda=Block(params.gamma_LambdaJ, box(1.0 / b.J_max, 1.0 / b.J_min)),
        C=Block(params.gamma_c, Box(np.full((1, c), -b.c_max), np.full((1, c), b.c_max), 0.0)),
        s=Block(params.gamma, box(-b.s_w_max, b.s_w_max)),
        weight=Structure.SCALAR,
    )
    stored = Estimates(1.0 / column(column(J_hat)), C=c_hat[..., None, :], s=column(column(s_hat)))
    known = Known(column(w), np.zeros(1), phi=phi)
    return Image(integrator(1, params.lambda_w), laws, stored, known, column(tau_a))


def rate_demanded(
    params: Params, w: Array, J_hat: Array, s_hat: Array, c_hat: Array, phi: Array, f_wc: Array
) -> Image:
    """One body rate, J, c and s as printed: w' = f_wc + Lambda (tau + Theta f_wc) + C phi + s.

    Theta = -J. The predictor uses the demanded torque J_hat f_wc. Paper (41)-(45).
    """
    b, c = params.bounds, np.shape(phi)[-1]
    laws = Laws(
        Lambda=None,
        Theta=Block(params.gamma_J, box(-b.J_max, -b.J_min)),
        C=Block(params.gamma_c, Box(np.full((1, c), -b.c_max), np.full((1, c), b.c_max), 0.0)),
        s=Block(params.gamma, box(-b.s_w_max, b.s_w_max)),
        weight=Structure.SCALAR,
    )
    J = np.asarray(J_hat, dtype=float)
    stored = Estimates(ONE, -column(column(J)), C=c_hat[..., None, :], s=column(column(s_hat)))
    f = column(f_wc)
    known = Known(column(w), np.zeros(1), f=f, phi=phi, kappa=f)
    return Image(integrator(1, params.lambda_w), laws, stored, known, column(J * f_wc))


def products(w: Array, Omega_m: Array | float) -> Array:
    """Products q r, q omega_m, p r, p omega_m, p q (..., 5) of body rates (..., 3). Paper (43)."""
    p, q, r = (w[..., i] for i in range(3))
    return np.stack([q * r, q * Omega_m, p * r, p * Omega_m, p * q], axis=-1)  # (43)


def position_model(params: Params) -> tuple[Array, Array]:
    """A (6, 6) and B (6, 3) of the reference model of position and velocity. Paper (34)."""
    eye, zero = np.eye(3), np.zeros((3, 3))
    f, zeta = params.f_m, params.zeta_m
    A = np.block([[zero, eye], [-f * f * eye, -2.0 * zeta * f * eye]])  # (34)
    return A, np.vstack([zero, eye])


def position_loop(params: Params, truth: Uncertainty, r: Signal, actuator: Actuator) -> ClosedLoop:
    """The position loop, x = (r, v), n = 6, q = 3, in the achieved form, without attitude lag.

    truth : Lambda = I/m and s, both (..., 3, .).  r : f_m^2 r_c, and for a moving setpoint
    + 2 zeta_m f_m v_c + a_c, (..., 3).  actuator : `cone(params)` or any other limit.
    kappa = g_E - a_ref cancels the part of the reference model in (3), so (26) is T_d of (37).
    """
    A, B = position_model(params)
    g_E = np.array([0.0, 0.0, -params.g])
    image = position_achieved(params, np.zeros(3), np.ones(()), np.zeros(3), np.zeros(3))

    def kappa(x: Array, r: Array) -> Array:
        return np.asarray(g_E - (x @ A[3:].T + r))

    plant = Plant(ReferenceModel(A, B, np.eye(6)), truth, r, kappa=kappa, actuator=actuator)
    return ClosedLoop(plant, Predictor(A, B, np.eye(6), params.lambda_v * np.eye(6)), image.laws)


def cone(params: Params) -> Actuator:
    """Limits a demanded force (N, E) without attitude lag: departure 13 of the law.

    Height has priority: the vertical component is at least T_dz_min, then the horizontal component
    is limited by the tilt limit, then the length is limited to [T_min, T_max].
    """

    def achieved(x: Array, T_d: Array) -> Array:
        T_z = np.maximum(T_d[..., 2], params.T_dz_min)
        aside = length(T_d[..., :2])
        k = np.minimum(1.0, T_z * math.tan(params.limits.phi_star) / (aside + 1e-30))
        safe = np.concatenate([k[..., None] * T_d[..., :2], T_z[..., None]], axis=-1)
        norm = length(safe)
        scale = np.clip(norm, params.limits.T_min, params.limits.T_max) / norm
        return np.asarray(safe * scale[..., None])

    return achieved


def rate_loop(
    params: Params, truth: Uncertainty, r: Signal, actuator: Actuator, Omega_m: float = 0.0
) -> ClosedLoop:
    """The three rate loops as one, n = q = 3, in the achieved form, without torque lag.

    truth : Lambda = J^-1 diagonal, C (..., 3, 5) with the pattern of `COUPLED`, s.  r : c_rate w_c
    (..., 3).  Omega_m : rad/s, constant.  A has -c_rate on the diagonal. Paper (41)-(45).
    """
    b = params.bounds
    c_rate = np.array(params.c_rate)
    reach = b.c_max * COUPLED
    laws = Laws(
        Lambda=Block(params.gamma_LambdaJ, box(1.0 / b.J_max, 1.0 / b.J_min, 3), Structure.DIAGONAL),
        C=Block(params.gamma_c, Box(-reach, reach, 0.0)),
        s=Block(params.gamma, box(-b.s_w_max, b.s_w_max, 3)),
        weight=Structure.DIAGONAL,
    )  # fmt: skip

    def phi(x: Array, r: Array) -> Array:
        return products(x, Omega_m)

    def kappa(x: Array, r: Array) -> Array:
        return np.asarray(c_rate * x - r)

    eye = np.eye(3)
    plant = Plant(
        ReferenceModel(-c_rate * eye, eye, eye), truth, r, phi=phi, kappa=kappa, actuator=actuator
    )
    return ClosedLoop(plant, Predictor(-c_rate * eye, eye, eye, params.lambda_w * eye), laws)
