"""Quadratic drag along and about the body axes, against the air. Paper, Section VI.B."""

from __future__ import annotations

from fcu.kernel.algebra import Vec3
from fcu.kernel.compile import kernel


@kernel
def against(c, a):
    """-c a |a|, axis by axis: force (N) of a velocity (m/s), torque (N m) of a rate (rad/s)."""
    return Vec3(-c.x * a.x * abs(a.x), -c.y * a.y * abs(a.y), -c.z * a.z * abs(a.z))
