"""A field of wind sampled at many places at once, for tools: the numbers that a vehicle in it would meet."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from sitl_plant.physics.wind.field import Component, Field

Array = np.ndarray[Any, Any]


def _component(of: Component, k: int, r: Array) -> Array:
    """One component at time number k and places r (n, 3), held at its outermost places."""
    axes = {
        name: (places, at)
        for name, places, at in zip("zyx", (of.z, of.y, of.x), r.T[::-1], strict=True)
        if len(places) > 1
    }
    values = of.v[k].squeeze(tuple(i for i, n in enumerate(of.v.shape[1:]) if n == 1))
    if not axes:
        return np.full(len(r), float(values))
    places = tuple(p for p, _ in axes.values())
    at = np.stack([np.clip(a, p[0], p[-1]) for p, a in axes.values()], axis=-1)
    found: Array = RegularGridInterpolator(places, np.asarray(values, dtype=np.float64))(at)
    return found


def velocity(field: Field, r: Array, t: Array, repeats: bool = False) -> Array:
    """Velocity of the air (n, 3), m/s, E, at places r (n, 3), m, and times t (n,), s, of the field.

    Linear in space and time, as in flight (`sitl_plant.physics.wind.field`). After the last time
    it holds, or the times begin anew if it repeats.
    """
    found = np.zeros((len(r), 3))
    lasts = field.t[-1] - field.t[0]
    if repeats and lasts > 0.0:
        t = np.where(t > field.t[-1], t - lasts * np.floor((t - field.t[0]) / lasts), t)
    at = np.clip(t, field.t[0], field.t[-1])
    k = np.clip(np.searchsorted(field.t, at, side="right") - 1, 0, max(len(field.t) - 2, 0))
    for number in np.unique(k):
        here = k == number
        later = min(number + 1, len(field.t) - 1)
        share = np.zeros(here.sum())
        if later > number:
            share = (at[here] - field.t[number]) / (field.t[later] - field.t[number])
        for i, part in enumerate((field.u, field.v, field.w)):
            before = _component(part, number, r[here])
            after = _component(part, later, r[here]) if later > number else before
            found[here, i] = before + share * (after - before)
    return found


def is_known(field: Field, r: Array) -> Array:
    """True of places r (n, 3), m, that are in the field and in no building: bool[n]."""
    low, high = field.bounds[::2], field.bounds[1::2]
    inside = ((r >= low) & (r <= high)).all(axis=1)
    found: Array = inside & (r[:, 2] >= heights(field, r[:, 0], r[:, 1]))
    return found


def heights(field: Field, x: Array, y: Array) -> Array:
    """Height (m) of the ground or the roofs at places x and y (m), of one shape."""
    i = np.clip(np.searchsorted(field.top_x, x, side="right") - 1, 0, field.top.shape[1] - 1)
    j = np.clip(np.searchsorted(field.top_y, y, side="right") - 1, 0, field.top.shape[0] - 1)
    found: Array = field.top[j, i]
    return found
