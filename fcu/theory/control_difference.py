"""Difference between adaptive control and known control: (30), with its constants derived.

Without saturation, the prediction error x_til and z = Theta_til f + d_til (inside Lambda) obey, for
any time-varying Theta, d and regressor f,

    x_til' = (A - k I) x_til + B Lambda z        z' = -G B^T P x_til + delta
    delta  = Theta' f + d' + Theta_til f'        G  = gamma_d + gamma_Theta |f|^2

while no projection acts, and the control difference is v_0 - v = -z. For a disturbance outside
Lambda, z is Lambda Theta_til f + s_til + Lambda_til (u + Theta_hat f) and enters without Lambda, G
is gamma_d + gamma_Theta Lambda |f|^2 + gamma_Lambda |u + Theta_hat f|^2, and v_0 - v = -Lambda^-1 z.
The same z drives the tracking error: e' = A e + B Lambda z.

Whether projection acts is a property of a run, not of a design: where f moves in phase with d',
Theta_hat may drift to the edge of a set that is several times as large as Theta. While the
projection of Theta_hat acts G is smaller, but not below gamma_d
(`fcu.theory.linear_loop.any_projection`). d_hat = d + Theta_til f - z is at most
d* + |Theta_til| |f| + |z|, so the projection onto a larger set for d never acts.

With constant Lambda and G this is a linear system: bounds of its impulse responses bound its
errors, and some delta attains them. This module has the closed forms for one channel, n = q = 1,
with B = P = 1 and an A that is not neglected. With kappa = k - A and omega^2 = Lambda G,

    delta to z:      (s + kappa)/(s^2 + kappa s + omega^2)
    delta to x_til:       Lambda/(s^2 + kappa s + omega^2)

so A counts as part of k. For zeta = kappa/(2 omega) >= 1 both poles -p_1, -p_2 are real, and
p_1 + p_2 = kappa. The impulse response (p_2 e^(-p_1 t) - p_1 e^(-p_2 t))/(p_2 - p_1) of z does not
change sign, so its L1 gain is the static gain kappa/omega^2: a delta that stays at delta* makes
|z| = (k - A) delta*/(Lambda G). For other B and P, y = B P x_til is the state of this channel with
Lambda B^2 P in place of Lambda. `fcu.theory.linear_loop` handles any A, B, P and time-varying G.
"""

from __future__ import annotations

import math
from typing import NamedTuple

CLOSE = 1e-9  # of zeta to 1, where the two forms coincide


class ControlDifference(NamedTuple):
    """|v_0 - v| <= beta_1 e^(-nu_1 t) + beta_2 gamma^(-1/2). Paper (30)."""

    beta_1: float
    nu_1: float  # 1/s
    lasting: float  # beta_2 gamma^(-1/2), in the units of u

    def at(self, t: float) -> float:
        """The bound at time t (s). Paper (30)."""
        return self.beta_1 * math.exp(-self.nu_1 * t) + self.lasting  # (30)

    @property
    def peak(self) -> float:
        """The bound over all times."""
        return self.beta_1 + self.lasting


class Channel(NamedTuple):
    """One channel with B = P = 1: x_til' = (A - k) x_til + Lambda z, z' = -G x_til + delta.

    k - A, Lambda and G must be above 0, and constant: the regressor of Theta_hat has a constant
    norm, and its projection does not act in the run, or there is no Theta_hat. A predictor without A, as those of the
    octocopter, has A = 0.
    """

    A: float  # 1/s, of the reference model: below 0
    k: float  # 1/s
    Lambda: float
    G: float  # gamma (1 + |f|^2)

    @property
    def kappa(self) -> float:
        """Decay rate of x_til alone, 1/s."""
        return self.k - self.A

    @property
    def omega(self) -> float:
        """Natural frequency, rad/s."""
        return math.sqrt(self.Lambda * self.G)

    @property
    def zeta(self) -> float:
        """Damping ratio."""
        return self.kappa / (2.0 * self.omega)


def control_gain(zeta: float) -> float:
    """N(zeta): omega times the integral of |h|, h the impulse response from delta to z. Exact.

    h has the transfer function (s + kappa)/(s^2 + kappa s + omega^2), kappa = 2 zeta omega. For
    zeta >= 1 it does not change sign. For zeta < 1 the areas of its half waves form a geometric series.
    """
    if zeta >= 1.0:
        return 2.0 * zeta
    root = math.sqrt(1.0 - zeta * zeta)
    first = math.exp(-(zeta / root) * (0.5 * math.pi + math.asin(zeta)))
    return 2.0 * zeta + 2.0 * first / -math.expm1(-math.pi * zeta / root)


def prediction_gain(zeta: float) -> float:
    """G times the integral of the absolute impulse response from delta to x_til. Exact."""
    if zeta >= 1.0:
        return 1.0
    return 1.0 / math.tanh(math.pi * zeta / (2.0 * math.sqrt(1.0 - zeta * zeta)))


def _envelope(channel: Channel) -> tuple[float, float, float]:
    """Envelope of z: decay rate (1/s), and initial values per unit of z(0) and of x_til(0)."""
    omega, zeta = channel.omega, channel.zeta
    if abs(zeta - 1.0) < CLOSE:  # (1 + omega t) e^(-omega t), G t e^(-omega t), at half the rate
        return 0.5 * omega, 2.0 * math.exp(-0.5), channel.G * 2.0 / (math.e * omega)
    if zeta < 1.0:
        root = math.sqrt(1.0 - zeta * zeta)
        return zeta * omega, 1.0 / root, channel.G / (omega * root)
    root = math.sqrt(zeta * zeta - 1.0)
    slow = omega / (zeta + root)  # omega (zeta - root), without cancellation
    return slow, (zeta + root) / (2.0 * root), channel.G / (2.0 * omega * root)


def control_difference(
    channel: Channel, z_0: float, delta_star: float, x_til_0: float = 0.0
) -> ControlDifference:
    """beta_1, nu_1 and beta_2 gamma^(-1/2) of one channel with B = P = 1. Paper (30).

    z_0, x_til_0 : |z| and |x_til| at the start. delta_star : bound of |delta| at all times. For
    zeta >= 1 the lasting part is (k - A) delta_star/(Lambda G), which delta = delta_star attains.
    With x_til_0 above zero, beta_1 grows as sqrt(gamma): start the predictor at the state. Near
    zeta = 1 the envelope is wide; `linear_loop` gives a tighter one. If all channels are equal,
    this also holds for norms of vectors.
    """
    nu_1, per_z, per_x = _envelope(channel)
    beta_1 = per_z * abs(z_0) + per_x * abs(x_til_0)
    lasting = control_gain(channel.zeta) * delta_star / channel.omega
    return ControlDifference(beta_1, nu_1, lasting)  # (30)


def settled_prediction(channel: Channel, delta_star: float) -> float:
    """Bound of |x_til| after the transient: it shrinks as 1/gamma, (20) only as 1/sqrt(gamma)."""
    return prediction_gain(channel.zeta) * delta_star / channel.G
