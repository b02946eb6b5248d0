"""Disturbances of the octocopter at rest: drag of the paper's wind, and nearly worst cases."""

from __future__ import annotations

import numpy as np

from fcu.theory.arrays import Array
from fcu.theory.systems import Varying

WIND = np.array([7.2, 7.2, 5.7]), np.array([1.5, 1.6, 1.7])  # m/s, rad/s: Section VIII
ROTATION = np.array([0.7, 0.6, 0.5]), np.array([2.5, 2.4, 2.3])  # rad/s, rad/s: Section VIII


def drag(amplitude: Array, omega: Array, over: Array | float) -> Varying:
    """s (3, 1) of a sinusoidal wind (3,) on a body at rest, with Earth axes. Section VI.B.

    over : drag coefficient divided by mass (1/m) or by inertia. The bounds use the largest value of
    each axis: amplitude^2 over, and amplitude^2 over omega for the rate.
    """
    amplitude, omega = np.asarray(amplitude), np.asarray(omega)
    most = over * amplitude * amplitude

    def value(t: float) -> Array:
        wave = np.sin(omega * t)
        return np.asarray((most * wave * np.abs(wave))[..., None])

    return Varying(value, np.linalg.norm(most, axis=-1), np.linalg.norm(most * omega, axis=-1))


def triangle(rate: Array, omega: Array) -> Varying:
    """A triangle wave s (..., 3, 1) with rate (..., 3) and frequency omega (rad/s).

    At the natural frequency of the prediction error this is nearly the worst of all disturbances
    with that rate.
    """
    rate, omega = np.asarray(rate), np.asarray(omega)
    most = 0.5 * np.pi * rate / omega

    def value(t: float) -> Array:
        return np.asarray((most * (2.0 / np.pi) * np.arcsin(np.sin(omega * t)))[..., None])

    return Varying(value, np.linalg.norm(most, axis=-1), np.linalg.norm(rate, axis=-1))
