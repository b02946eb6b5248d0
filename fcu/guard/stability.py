"""Which gains fly together: the closed loop about hover, tick by tick, and whether it is stable.

Law and vehicle linearised about hover at rest, without wind, as they act once a tick: the law's
step as it is in this folder, then a rigid body under rotors whose lag is known, exactly. One
matrix a channel; it is stable if all its eigenvalues lie inside the unit circle. It is asked to
be so for estimates of mass and inertia that are right and that are 3 dB off either way (the gain
margin), and with rotors that answer late because their command is cut.
README, "Which gains go together". Only for prediction = "achieved".
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.airframe import believed_body
from fcu.laws.mmrac.parameters import rotor_lag
from fcu.laws.mmrac.types import Params

Matrix = np.ndarray[Any, np.dtype[np.float64]]

_mass, _inertia = believed_body()
MASS = 0.5 * sum(_mass)  # kg
INERTIA = tuple(0.5 * sum(J) for J in _inertia)  # kg m^2
LIFT, SINK = 1.3, 0.25  # of its weight: the least T_max, the greatest T_min
LEARNT = 1.0  # gamma_LambdaJ under which an inertia is as good as not learnt
FIRST = 2.0  # factor by which the first estimate of mass may be off
ROTATION = ("roll", "pitch", "yaw")
OFF = (1.0, 1.0 / math.sqrt(2.0), math.sqrt(2.0))  # estimates over truth: right, and 3 dB off
# What is left of the inverted lag when its command is cut. Set by flights: with 2, combinations pass
# that fail even in small steps; with 1, combinations that settle after large ones do not.
KAPPA_CUT = 1.5


class Fade(NamedTuple):
    """What is left after a tick of a step that a rotor has not followed yet, and its integrals."""

    left: float  # e^(-h/lag)
    once: float  # over the tick, s
    twice: float  # and again, s^2
    thrice: float
    fourfold: float


def fade(params: Params) -> Fade:
    """Of e^(-t/lag) over a tick."""
    h, lag = params.h, rotor_lag(params)
    left = math.exp(-h / lag) if lag > 0.0 else 0.0
    once = lag * (1.0 - left)
    twice = lag * (h - once)
    thrice = lag * (h * h / 2.0 - twice)
    return Fade(left, once, twice, thrice, lag * (h * h * h / 6.0 - thrice))


def height(params: Params, lag: Fade, off: float) -> Matrix:
    """One tick of height (8 x 8), with m_hat = off * m.

    State: height, its rate, thrust, thrust a tick ago, v_hat, s_hat + T_0 Lambda_hat (one
    number: in hover drag and mass cannot be told apart), trim, T_c a tick ago; all but the
    first two as departures from hover.
    """
    h, w, m, m_hat = params.h, params.rotors.mean, MASS, off * MASS
    z, v, T, T_prev, v_hat, s, trim, T_c_prev = np.eye(8)
    T_0 = m * params.g
    gain = params.gamma + params.gamma_Lambda * T_0 * T_0
    trim_rate = params.trim_rate if params.trim_max > 0.0 else 0.0

    T_mean = w * T_prev + (1.0 - w) * T
    e_minus = v - v_hat - h * (s + T_mean / m_hat)
    e = e_minus / (1.0 + h * params.lambda_v + h * h * gain)
    s = s + h * gain * e
    trim = (trim if trim_rate > 0.0 else 0.0 * trim) + h * trim_rate * (T_c_prev - T_mean)
    T_c = m_hat * (_a_ref(params, z, v) - s)

    aim = T + params.rotors.kappa * (T_c + trim - T)
    gap = T - aim
    return np.array([
        z + h * v + (aim * (h * h / 2.0) + gap * lag.twice) / m,
        v + (aim * h + gap * lag.once) / m,
        aim + gap * lag.left,
        T, v - e, s, trim, T_c,
    ])  # fmt: skip


def tilt(params: Params, lag: Fade, off: float, axis: int) -> Matrix:
    """One tick of a tilt and the way it leads to (12 x 12), axis 0 roll, 1 pitch.

    State: way, its rate, tilt, body rate, torque, tilt and torque a tick ago, v_hat, s_v_hat,
    w_hat, s_w_hat, tilt filter. m_hat = off * m, J_hat = off * J. Signs are those of pitch.
    """
    h, w, g, J, J_hat = params.h, params.rotors.mean, params.g, INERTIA[axis], off * INERTIA[axis]
    x, v, a, q, tau, a_prev, tau_prev, v_hat, s_v, w_hat, s_w, a_filter = np.eye(12)
    lift = g / off  # T_0 / m_hat

    e_v = v - v_hat - h * (s_v + lift * 0.5 * (a + a_prev))
    e_v = e_v / (1.0 + h * params.lambda_v + h * h * params.gamma)
    s_v = s_v + h * params.gamma * e_v
    e_w, s_w = _rate(params, q, w_hat, s_w, (w * tau_prev + (1.0 - w) * tau) / J_hat)

    a_c = (_a_ref(params, x, v) - s_v) / lift
    b = params.tilt_rate_bandwidth
    a_filter = (a_filter + h * b * a_c) / (1.0 + h * b)
    q_c = b * (a_c - a_filter) + params.c_angle[axis] * (a_c - a)
    tau_c = J_hat * (params.c_rate[axis] * (q_c - q) - s_w)

    aim = tau + params.rotors.kappa * (tau_c - tau)
    gap = tau - aim
    jerk = aim * (h * h * h / 6.0) + gap * lag.thrice
    snap = aim * (h * h * h * h / 24.0) + gap * lag.fourfold
    return np.array([
        x + h * v + g * (a * (h * h / 2.0) + q * (h * h * h / 6.0) + snap / J),
        v + g * (h * a + q * (h * h / 2.0) + jerk / J),
        a + h * q + (aim * (h * h / 2.0) + gap * lag.twice) / J,
        q + (aim * h + gap * lag.once) / J,
        aim + gap * lag.left,
        a, tau, v - e_v, s_v, q - e_w, s_w, a_filter,
    ])  # fmt: skip


def yaw(params: Params, lag: Fade, off: float) -> Matrix:
    """One tick of yaw (6 x 6), with J_hat = off * J.

    State: yaw, body rate, torque, torque a tick ago, w_hat, s_w_hat.
    """
    h, w, J, J_hat = params.h, params.rotors.mean, INERTIA[2], off * INERTIA[2]
    psi, r, tau, tau_prev, w_hat, s_w = np.eye(6)
    e, s_w = _rate(params, r, w_hat, s_w, (w * tau_prev + (1.0 - w) * tau) / J_hat)
    tau_c = J_hat * (params.c_rate.z * (-params.c_angle.z * psi - r) - s_w)
    aim = tau + params.rotors.kappa * (tau_c - tau)
    gap = tau - aim
    return np.array([
        psi + h * r + (aim * (h * h / 2.0) + gap * lag.twice) / J,
        r + (aim * h + gap * lag.once) / J,
        aim + gap * lag.left,
        tau, r - e, s_w,
    ])  # fmt: skip


def _a_ref(params: Params, r: Matrix, v: Matrix) -> Matrix:
    """Paper (34), with the setpoint at rest in the origin."""
    return -2.0 * params.f_m * params.zeta_m * v - params.f_m * params.f_m * r


def _rate(
    params: Params, w: Matrix, w_hat: Matrix, s_w: Matrix, known: Matrix
) -> tuple[Matrix, Matrix]:
    """Prediction error and disturbance of a body rate after the tick."""
    h, gamma = params.h, params.gamma
    e = (w - w_hat - h * (s_w + known)) / (1.0 + h * params.lambda_w + h * h * gamma)
    return e, s_w + h * gamma * e


CHANNELS: dict[str, Callable[[Params, Fade, float], Matrix]] = {
    "height": height,
    "roll": lambda params, lag, off: tilt(params, lag, off, 0),
    "pitch": lambda params, lag, off: tilt(params, lag, off, 1),
    "yaw": yaw,
}

# MAVLink's parameters that decide whether a channel is stable; what stands first is what it is
# held against.
_OF_TILT = ("MR_C_TILT", "MR_C_PQ", "MR_F_M", "MR_ZETA_M", "MR_GAMMA", "MR_ROTOR_RESP")
DECIDES: dict[str, tuple[str, ...]] = {
    "height": ("MR_F_M", "MR_GAMMA", "MR_ZETA_M", "MR_G_LAM", "MR_TRIM_RATE", "MR_ROTOR_RESP"),
    "roll": _OF_TILT,
    "pitch": _OF_TILT,
    "yaw": ("MR_C_YAW", "MR_C_R", "MR_GAMMA", "MR_ROTOR_RESP"),
}


def radius(params: Params, channel: str, off: float = 1.0) -> float:
    """Spectral radius of a channel: what its slowest mode is multiplied by in a tick.

    `off`: estimates of mass and inertia over the truth.
    """
    matrix = CHANNELS[channel](params, fade(params), off)
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def stable(params: Params, channel: str) -> bool:
    """Whether a channel is, with the gain margin, and with a cut rotor command.

    An inertia that is not learnt has to be right enough from the start.
    """
    cut = params._replace(rotors=params.rotors._replace(kappa=min(params.rotors.kappa, KAPPA_CUT)))
    offs = list(OFF)
    if channel in ROTATION and params.gamma_LambdaJ < LEARNT:
        offs.append(params.initial.J_hat_0 / INERTIA[ROTATION.index(channel)])
    return all(radius(params, channel, off) < 1.0 for off in offs) and radius(cut, channel) < 1.0


def grounded(params: Params) -> str:
    """What keeps the vehicle of Section VIII from hovering, whatever its gains; empty if nothing.

    Thrust limits that leave no room about its weight, sets that do not hold its mass or inertia
    (Section IV asks for sets that do), and a first estimate of mass that is too far off for the
    time that a fall leaves to learn it.
    """
    weight, b = MASS * params.g, params.bounds
    if params.limits.T_max < LIFT * weight:
        return f"too weak for {MASS:g} kg ({LIFT * weight:.0f} N at least)"
    if params.limits.T_min > SINK * weight:
        return f"no way down at {MASS:g} kg ({SINK * weight:.0f} N at most)"
    if not b.m_min <= MASS <= b.m_max:
        return f"{MASS:g} kg is outside the set of masses"
    if not b.J_min <= min(INERTIA) <= max(INERTIA) <= b.J_max:
        return f"{min(INERTIA):.2f} to {max(INERTIA):.2f} kg m^2 is outside the set of inertias"
    if not MASS / FIRST <= params.initial.m_hat_0 <= MASS * FIRST:
        return f"mass at arming: {MASS / FIRST:g} to {MASS * FIRST:g} kg"
    return ""


def unstable(params: Params) -> str:
    """The channel that is not stable; empty if all are, or for the printed prediction.

    Takes less than a millisecond.
    """
    if params.achieved < 0.5:
        return ""
    # roll is pitch where both have the same gains
    c, a = params.c_rate, params.c_angle
    alike = c.x == c.y and a.x == a.y and INERTIA[0] == INERTIA[1]
    for channel in CHANNELS:
        if not (alike and channel == "roll") and not stable(params, channel):
            return channel
    return ""
