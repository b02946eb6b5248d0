"""How far adaptive control is from the one that knows: (30), with its constants derived.

While nothing saturates and no projection acts, the prediction error x_til and
z = Theta_til f + d_til (inside) obey, for any moving Theta, d and regressor f,

    x_til' = (A - k I) x_til + B Lambda z        z' = -G B^T P x_til + delta
    delta  = Theta' f + d' + Theta_til f'        G  = gamma_d + gamma_Theta |f|^2

and the control difference is v_0 - v = -z. With a disturbance beside Lambda, z is
Lambda Theta_til f + s_til + Lambda_til (u + Theta_hat f), it enters without Lambda, G is
gamma_d + gamma_Theta Lambda |f|^2 + gamma_Lambda |u + Theta_hat f|^2, and v_0 - v = -Lambda^-1 z.
The tracking error is driven by the same z: e' = A e + B Lambda z.

With constant Lambda and |f| this is a linear system: bounds of its impulse responses bound its
errors, and some delta attains them. Here are the closed forms for one channel (A neglected
against k, B = P = 1); `fcu.theory.linear_loop` does the same for any A, B, P and for moving G.
"""

from __future__ import annotations

import math
from typing import NamedTuple

CLOSE = 1e-9  # zeta to 1, where the two forms meet


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
    """One channel: x_til' = -k x_til + Lambda z, z' = -G x_til + delta."""

    k: float  # 1/s
    Lambda: float
    G: float  # gamma (1 + |f|^2)

    @property
    def omega(self) -> float:
        """Natural frequency, rad/s."""
        return math.sqrt(self.Lambda * self.G)

    @property
    def zeta(self) -> float:
        """Damping ratio."""
        return self.k / (2.0 * self.omega)


def control_gain(zeta: float) -> float:
    """N(zeta): omega times the integral of |h|, h from delta to z. Exact.

    h has transfer function (s + k)/(s^2 + k s + omega^2). For zeta >= 1 it does not change its
    sign; for zeta < 1 the areas of its half waves are a geometric series.
    """
    if zeta >= 1.0:
        return 2.0 * zeta
    root = math.sqrt(1.0 - zeta * zeta)
    first = math.exp(-(zeta / root) * (0.5 * math.pi + math.asin(zeta)))
    return 2.0 * zeta + 2.0 * first / -math.expm1(-math.pi * zeta / root)


def prediction_gain(zeta: float) -> float:
    """G times the integral of |x_til|'s impulse response from delta. Exact: 1 for zeta >= 1."""
    if zeta >= 1.0:
        return 1.0
    return 1.0 / math.tanh(math.pi * zeta / (2.0 * math.sqrt(1.0 - zeta * zeta)))


def _envelope(channel: Channel) -> tuple[float, float, float]:
    """Of z: its rate (1/s), and what one unit of z(0) and one of x_til(0) begin at."""
    omega, zeta = channel.omega, channel.zeta
    if abs(zeta - 1.0) < CLOSE:  # (1 + omega t) e^(-omega t), G t e^(-omega t), at half the rate
        return 0.5 * omega, 2.0 * math.exp(-0.5), channel.G * 2.0 / (math.e * omega)
    if zeta < 1.0:
        root = math.sqrt(1.0 - zeta * zeta)
        return zeta * omega, 1.0 / root, channel.G / (omega * root)
    root = math.sqrt(zeta * zeta - 1.0)
    slow = omega / (zeta + root)  # omega (zeta - root), without its cancellation
    return slow, (zeta + root) / (2.0 * root), channel.G / (2.0 * omega * root)


def control_difference(
    channel: Channel, z_0: float, delta_star: float, x_til_0: float = 0.0
) -> ControlDifference:
    """beta_1, nu_1 and beta_2 gamma^(-1/2) of one channel. Paper (30).

    z_0, x_til_0 : |z| and |x_til| at the start. delta_star : |delta| at all times.
    beta_1 grows as sqrt(gamma) with x_til_0: begin the predictor at the state. Near zeta = 1 the
    envelope is wide; `linear_loop` has a tighter one. Also right for vectors, as norms, when the
    channels are alike.
    """
    nu_1, per_z, per_x = _envelope(channel)
    beta_1 = per_z * abs(z_0) + per_x * abs(x_til_0)
    lasting = control_gain(channel.zeta) * delta_star / channel.omega
    return ControlDifference(beta_1, nu_1, lasting)  # (30)


def settled_prediction(channel: Channel, delta_star: float) -> float:
    """Bound of |x_til| once the start is forgotten: it shrinks as 1/gamma, (20) as 1/sqrt(gamma)."""
    return prediction_gain(channel.zeta) * delta_star / channel.G
