"""Wind from a 3-D field on a grid: each component at its own places, between them linear in space and time.

The components of a staggered grid stand on the faces of its cells, so that no flow crosses a wall. Every component
has axes of its own, of any spacing. Values are float32 and may be mapped from a file: a tick reads those
about the vehicle alone.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from fcu.kernel.algebra import Vec3
from fcu.kernel.compile import kernel

Axis = np.ndarray[Any, np.dtype[np.float64]]
Values = np.ndarray[Any, np.dtype[np.float32]]


class Component(NamedTuple):
    """One component of the velocity."""

    x: Axis  # m, rising; E
    y: Axis
    z: Axis  # m
    per_m: Vec3  # 1 / step of each axis that is evenly spaced, else 0
    v: Values  # float32[t, z, y, x], m/s


class Field(NamedTuple):
    """A field, and the heights of what is solid in it. Read only."""

    t: Axis  # s, rising; one of a steady field
    u: Component  # to East
    v: Component  # to North
    w: Component  # up
    bounds: Axis  # float64[6]: least and greatest x, y and z, m
    top_x: Axis  # edges of the cells of `top`, m
    top_y: Axis
    top: Values  # float32[y, x]: height of ground and buildings, m


NO_TOP = -1e30  # m: of a field without buildings
_EVEN = 1e-9  # of a step: places that are nearer to even ones are taken for them


def frozen(array: Any) -> Any:
    """A plain read-only array of the same memory: all fields have one type for the compiler."""
    plain = np.asarray(array)
    plain.flags.writeable = False
    return plain


def _per_m(axis: Axis) -> float:
    """Places a metre of an axis that is evenly spaced, else 0."""
    if len(axis) < 2:
        return 0.0
    even = np.linspace(axis[0], axis[-1], len(axis))
    step = (axis[-1] - axis[0]) / (len(axis) - 1)
    return float(1.0 / step) if (np.abs(axis - even) <= _EVEN * step).all() else 0.0


def component_on(x: Axis, y: Axis, z: Axis, v: Any) -> Component:
    """A component of values v (float32[t, z, y, x], m/s) at places x, y, z (m, rising)."""
    x, y, z = (frozen(np.ascontiguousarray(axis, dtype=np.float64)) for axis in (x, y, z))
    return Component(x, y, z, Vec3(_per_m(x), _per_m(y), _per_m(z)), frozen(v))


def no_field() -> Field:
    """A still field, for a vehicle that flies in none."""
    axis = frozen(np.zeros(1))
    still = component_on(axis, axis, axis, np.zeros((1, 1, 1, 1), dtype=np.float32))
    edges, flat = frozen(np.zeros(2)), frozen(np.full((1, 1), NO_TOP, dtype=np.float32))
    return Field(axis, still, still, still, frozen(np.zeros(6)), edges, edges, flat)


@kernel
def place(axis, at):
    """Index i of an axis, and the share of the way from there to i + 1, held at both ends."""
    last = axis.shape[0] - 1
    if last == 0 or at <= axis[0]:
        return 0, 0.0
    if at >= axis[last]:
        return last - 1, 1.0
    # exact for even spacing; a few steps from there else
    i = int((at - axis[0]) / (axis[last] - axis[0]) * last)
    i = min(max(i, 0), last - 1)
    while axis[i] > at:
        i -= 1
    while axis[i + 1] < at:
        i += 1
    return i, (at - axis[i]) / (axis[i + 1] - axis[i])


@partial(kernel, inlined=False)
def _place_of_uneven(axis, at):
    """The same, of an axis of any spacing: a call, since its loops would keep the others from being fast."""
    return place(axis, at)


@kernel
def _place(axis, per_m, at):
    """As `place`, without a search where the places stand evenly."""
    if per_m == 0.0:
        return _place_of_uneven(axis, at)
    last, steps = axis.shape[0] - 1, (at - axis[0]) * per_m
    if not steps > 0.0:  # nor NaN
        return 0, 0.0
    steps = min(steps, float(last))
    i = min(int(steps), last - 1)
    return i, steps - i


@kernel
def _between(a, b, f):
    return a + f * (b - a)


@kernel
def _corner(v, k, f, z, y, x):
    """The value of a corner of a cell between the times k and k + 1."""
    a = np.float64(v[k, z, y, x])
    return a if f == 0.0 else _between(a, np.float64(v[k + 1, z, y, x]), f)


@kernel
def sample(of, places, k, f, out):
    """Write one component (m/s) at n places to `out`.

    of : Component.  places : float64[3, n], m.  k, f : as of `time_in`.  out : float64[n].
    The corners of a cell are read once where places that follow one another lie in it.
    """
    x_last, y_last, z_last = of.x.shape[0] - 1, of.y.shape[0] - 1, of.z.shape[0] - 1
    i, j, n_z = -1, -1, -1
    a, b, c, d, e, g, h, m = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for at in range(places.shape[1]):
        x, fx = _place(of.x, of.per_m.x, places[0, at])
        y, fy = _place(of.y, of.per_m.y, places[1, at])
        z, fz = _place(of.z, of.per_m.z, places[2, at])
        if x != i or y != j or z != n_z:
            i, j, n_z = x, y, z
            x1, y1, z1 = min(x + 1, x_last), min(y + 1, y_last), min(z + 1, z_last)
            a, b = _corner(of.v, k, f, z, y, x), _corner(of.v, k, f, z, y, x1)
            c, d = _corner(of.v, k, f, z, y1, x), _corner(of.v, k, f, z, y1, x1)
            e, g = _corner(of.v, k, f, z1, y, x), _corner(of.v, k, f, z1, y, x1)
            h, m = _corner(of.v, k, f, z1, y1, x), _corner(of.v, k, f, z1, y1, x1)
        low = _between(_between(a, b, fx), _between(c, d, fx), fy)
        high = _between(_between(e, g, fx), _between(h, m, fx), fy)
        out[at] = _between(low, high, fz)


@kernel
def time_in(axis, t, repeats):
    """Index k of an axis of times and the share of the way to k + 1.

    After its end the last time holds. If it repeats, time goes back to the first instead.
    """
    last = axis.shape[0] - 1
    if last == 0:
        return 0, 0.0
    if repeats and t > axis[last]:
        span = axis[last] - axis[0]
        t -= span * math.floor((t - axis[0]) / span)
    return place(axis, t)


@kernel
def sample_all(field, places, k, f, out):
    """Write the velocity of the air (m/s) at n places of the field to `out`, float64[3, n].  Arguments as for `sample`."""
    sample(field.u, places, k, f, out[0])
    sample(field.v, places, k, f, out[1])
    sample(field.w, places, k, f, out[2])


@kernel
def height(field, x, y):
    """Height (m) of the ground or the roof at a place of the field."""
    i, _ = place(field.top_x, x)
    j, _ = place(field.top_y, y)
    i, j = min(i, field.top.shape[1] - 1), min(j, field.top.shape[0] - 1)
    return np.float64(field.top[j, i])


@kernel
def is_inside(field, r):
    """Return true if a position lies in the field."""
    b = field.bounds
    return b[0] <= r.x <= b[1] and b[2] <= r.y <= b[3] and b[4] <= r.z <= b[5]
