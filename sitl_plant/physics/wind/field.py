"""The air: its velocity and its rotation, as functions of time. Paper, Sections VI.B and VIII."""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3, select
from fcu.kernel.compile import kernel


@kernel
def sines(amplitude, frequency, t):
    """amplitude sin(frequency t), axis by axis."""
    return Vec3(
        amplitude.x * math.sin(frequency.x * t),
        amplitude.y * math.sin(frequency.y * t),
        amplitude.z * math.sin(frequency.z * t),
    )


@kernel
def v_air_E(wind, t):
    """Velocity of the air (m/s, E) at time t (s): steady, plus sinusoids, plus a step."""
    risen = select(t >= wind.step_time, 1.0, 0.0)
    return wind.steady + sines(wind.amplitude, wind.frequency, t) + risen * wind.step


@kernel
def w_air_B(wind, t):
    """Rotation of the air mass (rad/s, body axes) at time t (s)."""
    return sines(wind.rotation_amplitude, wind.rotation_frequency, t)
