"""Quadratic drag force and torque relative to the air, by body axis. Paper, Section VI.B."""

from __future__ import annotations

from fcu.kernel.algebra import Vec3
from fcu.kernel.compile import kernel


@kernel
def against(c, a):
    """-c a |a| by axis: force (N) for a velocity (m/s), torque (N m) for a rate (rad/s)."""
    return Vec3(-c.x * a.x * abs(a.x), -c.y * a.y * abs(a.y), -c.z * a.z * abs(a.z))
