"""The paper's wind: velocity and rotation of the air as sines over time. Sections VI.B and VIII."""

from __future__ import annotations

import math
from typing import NamedTuple

from fcu.kernel.algebra import Vec3, select
from fcu.kernel.compile import kernel


class Phases(NamedTuple):
    """Sines and cosines of the phases of the wind at one time, by axis."""

    sin: Vec3  # of the velocity
    cos: Vec3
    rotation_sin: Vec3  # of the rotation
    rotation_cos: Vec3


@kernel
def sin3(a):
    """Sines of three angles (rad)."""
    return Vec3(math.sin(a.x), math.sin(a.y), math.sin(a.z))


@kernel
def cos3(a):
    """Cosines of three angles (rad)."""
    return Vec3(math.cos(a.x), math.cos(a.y), math.cos(a.z))


@kernel
def phases(wind, t):
    """Phases at time t (s)."""
    a = wind.phase + t * wind.frequency
    b = wind.rotation_phase + t * wind.rotation_frequency
    return Phases(sin3(a), cos3(a), sin3(b), cos3(b))


@kernel
def half_step_later(wind, at):
    """Phases half an integration step after `at`, by the angle addition formulas."""
    s, c = wind.half_step.sin, wind.half_step.cos
    rs, rc = wind.half_step.rotation_sin, wind.half_step.rotation_cos
    return Phases(
        at.sin * c + at.cos * s,
        at.cos * c - at.sin * s,
        at.rotation_sin * rc + at.rotation_cos * rs,
        at.rotation_cos * rc - at.rotation_sin * rs,
    )


@kernel
def v_air_E(wind, at, t):
    """Velocity of the air (m/s, E) at time t (s): a constant, sinusoids and a step, then turned."""
    risen = select(t >= wind.step_time, 1.0, 0.0)
    v = wind.steady + wind.amplitude * at.sin + risen * wind.step
    c, s = wind.azimuth_cos, wind.azimuth_sin
    return Vec3(c * v.x - s * v.y, s * v.x + c * v.y, v.z)


@kernel
def w_air_B(wind, at):
    """Rotation of the air mass (rad/s, body axes)."""
    return wind.rotation_amplitude * at.rotation_sin + wind.rotation
