"""The forces that the octocopter's actuators reach, in numpy alone: a reference for kernels."""

from __future__ import annotations

import numpy as np


def _to_segment(points, a, b):
    along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return np.linalg.norm(points - (a + along[..., None] * (b - a)), axis=-1)


def _to_arc(points, radius, tilt):
    """To the arc of a radius from straight up to a tilt (rad)."""
    angle = np.clip(np.arctan2(points[..., 0], points[..., 1]), 0.0, tilt)
    nearest = radius * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    return np.linalg.norm(points - nearest, axis=-1)


def exact_set_distance(T, T_min, T_max, phi_star):
    """Distance (..., N) of forces T (..., 3) to the boundary of the set; negative outside.

    |T_xy| <= T_z tan phi*, T_min <= |T| <= T_max, T_z > 0: the set turns about the vertical, so
    the nearest point of its boundary is in the half plane (|T_xy|, T_z) of the force itself.
    """
    T = np.asarray(T, dtype=float)
    points = np.stack([np.hypot(T[..., 0], T[..., 1]), T[..., 2]], axis=-1)
    edge = np.array([np.sin(phi_star), np.cos(phi_star)])
    distance = np.minimum(
        _to_segment(points, T_min * edge, T_max * edge),
        np.minimum(_to_arc(points, T_min, phi_star), _to_arc(points, T_max, phi_star)),
    )
    size = np.linalg.norm(points, axis=-1)
    tilt = np.arctan2(points[..., 0], points[..., 1])
    inside = (size >= T_min) & (size <= T_max) & (tilt <= phi_star)
    return np.where(inside, distance, -distance)
