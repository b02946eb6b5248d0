"""Cuts through a field of wind: a plan and a section, as numbers to draw."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gcs_tools.wind_fields.sample import heights, velocity
from sitl_plant.physics.wind.field import NO_TOP, Field

Array = np.ndarray[Any, Any]

POINTS = 160  # across a cut, at most


class Cut(NamedTuple):
    """A plane of a field. Where it is building, speed is NaN."""

    title: str
    axes: tuple[str, str]
    a: Array  # places across, m
    b: Array  # and up the picture, m
    speed: Array  # (b, a), m/s
    v_a: Array  # components in the plane, m/s
    v_b: Array
    path: Array  # (n, 2), m: the flight, seen from there; (0, 2) without one
    roofs: Array | None  # (b, a): height of ground and roofs below a plan, m


def _places(field: Field, axis: int) -> Array:
    wanted = (field.u.x, field.v.y, field.w.z)[axis]
    return np.linspace(wanted[0], wanted[-1], min(max(2 * len(wanted), 24), POINTS))


def _cut(field: Field, across: int, up: int, at: float, t: float, path: Array, scale: float) -> Cut:
    a, b = _places(field, across), _places(field, up)
    r = np.empty((len(b), len(a), 3))
    through = 3 - across - up
    r[..., across], r[..., up], r[..., through] = a[None, :], b[:, None], at
    places = r.reshape(-1, 3)
    v = scale * velocity(field, places, np.full(len(places), t)).reshape(r.shape)
    top = heights(field, r[..., 0], r[..., 1])
    v[(r[..., 2] < top) & (top > 0.5 * NO_TOP)] = np.nan
    names = "east", "north", "up"
    where = f"{at:.4g} m {'up' if through == 2 else names[through]}"
    kind = "Plan" if through == 2 else "Section"
    when = f", after {t:.4g} s" if len(field.t) > 1 else ""
    return Cut(
        f"{kind}, {where}{when}",
        (f"{names[across]} in the field, m", f"{names[up]} in the field, m"), a, b, np.linalg.norm(v, axis=-1),
        v[..., across], v[..., up], path[:, [across, up]],
        top if through == 2 and top.max() > 0.5 * NO_TOP else None,
    )  # fmt: skip


def _kept(path: Array, axis: int) -> float:
    """The place along an axis (m, to the metre) at which a flight goes farthest in the other two."""
    steps = np.diff(path, axis=0)
    steps[:, axis] = 0.0
    places, of = np.unique(np.rint(path[:-1, axis]), return_inverse=True)
    return float(places[np.bincount(of, np.linalg.norm(steps, axis=1)).argmax()])


def middle(field: Field, path: Array) -> tuple[float, int, float]:
    """Height of the plan (m), the axis that the section looks along (0 east, 1 north), and its place (m).

    With a flight those at which it goes farthest. Without: half a cell above the highest roof, or in the middle.
    """
    b = field.bounds
    if len(path):
        along = int(np.argmin(np.ptp(path[:, :2], axis=0)))
        return _kept(path, 2), along, _kept(path, along)
    top = float(field.top.max())
    above = top + 0.5 * float(np.diff(field.w.z).min(initial=np.inf) if len(field.w.z) > 1 else 0.0)
    height = above if b[4] + 1.0 < above <= b[5] else 0.5 * float(b[4] + b[5])
    along = int((b[3] - b[2]) <= (b[1] - b[0]))
    return height, along, 0.5 * float(b[2 * along] + b[2 * along + 1])


def cuts(
    field: Field, height: float | None, t: float, path: Array, scale: float = 1.0
) -> tuple[Cut, Cut]:
    """Plan and section.  height : of the plan, m.  t : s of the field.  path : (n, 3), m of the field."""
    plan_at, along, section_at = middle(field, path)
    return (
        _cut(field, 0, 1, plan_at if height is None else height, t, path, scale),
        _cut(field, 1 - along, 2, section_at, t, path, scale),
    )
