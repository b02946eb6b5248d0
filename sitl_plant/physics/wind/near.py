"""The air at the eight hubs of a vehicle, of which what is near is kept from tick to tick.

A vehicle is in the same few cells for many ticks. Their corners are read from the field when a hub leaves them, or a
time of the field is passed, and lie side by side until then: of each component up to three corners along each axis.
A tick interpolates them in time, and then all hubs at once (`groups`), with the bits of `field.sample`. That samples
the hubs where they lie farther apart: in cells that are smaller than half the vehicle.

What is kept is float64[ROWS, 8] for a vehicle. Each component has `_EACH` rows of it.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from fcu.kernel import groups
from fcu.kernel.algebra import select
from fcu.kernel.compile import kernel
from fcu.kernel.groups import ROTORS, WIDE
from fcu.kernel.lanes import any_lane
from fcu.kernel.pointers import address_of
from sitl_plant.physics.wind import field

# rows of a component: two of what is held, its corners at the time before, what they change by until the time after
_BEFORE, _CHANGE, _EACH = 2, 6, 10
# columns of what is held: the time before, counted from 1, 0 for nothing; and, in steps along each axis, where the
# first cell begins, where the second one begins, and where they end
_TIME, _FIRST, _SECOND = 0, 1, 4  # of the first row
_END = 0  # of the second
_SIDE = 3  # corners along an axis
_CORNERS = 4 * ROTORS  # numbers in four rows, of which 27 are corners
# rows of the place of each hub in the field along x, y and z, m
HUBS = 3 * _EACH
SCRATCH = HUBS + 3  # a row for whoever asks
# of the component in hand: steps of each hub along the axes, its share of a cell of uneven axes, corners now
_STEPS, _SHARES, _NOW = SCRATCH + 1, SCRATCH + 4, SCRATCH + 7
ROWS = _NOW + 4
_NEVER = math.inf


@partial(kernel, inlined=False)
def _place_each(axis, near, n):
    """Write where hubs are along an axis of any spacing: the middle of a cell, and their shares of it."""
    for h in range(ROTORS):
        i, share = field.place(axis, near[HUBS + n, h])
        near[_STEPS + n, h], near[_SHARES + n, h] = i + 0.5, share


@kernel
def _place(axis, per_m, near, first, n):
    """Write where hubs are along axis n, in steps. Return true if one is in none of the cells that are held."""
    address, leaves = address_of(near), False
    begin, end = near[first, _FIRST + n], near[first + 1, _END + n]
    if per_m == 0.0:
        _place_each(axis, near, n)
    last = float(axis.shape[0] - 1)
    for h in range(0, ROTORS, WIDE):
        if per_m == 0.0:
            steps = groups.read(address, (_STEPS + n) * ROTORS + h)
        else:
            steps = (groups.read(address, (HUBS + n) * ROTORS + h) - axis[0]) * per_m
            steps = select(steps > 0.0, steps, 0.0)  # of NaN too
            steps = select(steps < last, steps, last)
            groups.write(address, (_STEPS + n) * ROTORS + h, steps)
        leaves = leaves or any_lane((steps < begin) | (steps >= end))
    return leaves


@partial(kernel, inlined=False)
def _hold(of, k, near, first):
    """Read the corners of the cells in which hubs are. Return false if those are more than two along an axis."""
    near[first, _TIME] = 0.0
    ends = of.x.shape[0] - 1, of.y.shape[0] - 1, of.z.shape[0] - 1
    for n in range(3):
        low = high = near[_STEPS + n, 0]
        for h in range(1, ROTORS):
            low, high = min(low, near[_STEPS + n, h]), max(high, near[_STEPS + n, h])
        final = max(ends[n] - 1, 0)
        i, j = min(int(low), final), min(int(high), final)
        if j - i > 1:
            return False
        near[first, _FIRST + n] = float(i)
        near[first, _SECOND + n] = float(j) if j > i else _NEVER
        near[first + 1, _END + n] = j + 1.0 if j < final else _NEVER
    x, y, z = (
        int(near[first, _FIRST]), int(near[first, _FIRST + 1]), int(near[first, _FIRST + 2]),
    )  # fmt: skip
    after = min(k + 1, of.v.shape[0] - 1)
    for c in range(_SIDE if near[first, _SECOND + 2] < _NEVER else 2):
        for b in range(_SIDE if near[first, _SECOND + 1] < _NEVER else 2):
            for a in range(_SIDE if near[first, _SECOND] < _NEVER else 2):
                at = (c * _SIDE + b) * _SIDE + a
                row, column = at // ROTORS, at % ROTORS
                iz, iy, ix = min(z + c, ends[2]), min(y + b, ends[1]), min(x + a, ends[0])
                before = np.float64(of.v[k, iz, iy, ix])
                near[first + _BEFORE + row, column] = before
                near[first + _CHANGE + row, column] = np.float64(of.v[after, iz, iy, ix]) - before
    near[first, _TIME] = k + 1.0
    return True


@kernel
def _to_time(near, first, f):
    """Write the corners at a share of the time."""
    address = address_of(near)
    before, change = (first + _BEFORE) * ROTORS, (first + _CHANGE) * ROTORS
    for i in range(0, _CORNERS, WIDE):
        v = groups.read(address, before + i) + f * groups.read(address, change + i)
        groups.write(address, _NOW * ROTORS + i, v)


@kernel
def _along_x(near, i, later, share):
    """Between corners i, i + 1 and i + 2.  later : of hubs that are in the second cell."""
    a = near[_NOW + i // ROTORS, i % ROTORS]
    b = near[_NOW + (i + 1) // ROTORS, (i + 1) % ROTORS]
    c = near[_NOW + (i + 2) // ROTORS, (i + 2) % ROTORS]
    return select(later, b, a) + share * select(later, c - b, b - a)


@kernel
def _between(a, b, c, later, share):
    """Between a, b and c: from a to b, and later from b to c."""
    low, high = select(later, b, a), select(later, c, b)
    return low + share * (high - low)


@kernel
def _level(near, i, x_later, x, y_later, y):
    """Between the nine corners of one height, of which the first is i."""
    return _between(
        _along_x(near, i, x_later, x),
        _along_x(near, i + _SIDE, x_later, x),
        _along_x(near, i + 2 * _SIDE, x_later, x),
        y_later,
        y,
    )


@kernel
def _share(per_m, near, first, n, h):
    """Which hubs are in the second cell along axis n, and the share of their cell."""
    address = address_of(near)
    begin, second = near[first, _FIRST + n], near[first, _SECOND + n]
    steps = groups.read(address, (_STEPS + n) * ROTORS + h)
    later = steps >= second
    if per_m == 0.0:
        return later, groups.read(address, (_SHARES + n) * ROTORS + h)
    return later, steps - select(later, second, begin)


@kernel
def _interpolate(of, near, first, out, column):
    """Write a component at each hub to a row of `out`, from the corners that are held."""
    to = address_of(out)
    for h in range(0, ROTORS, WIDE):
        x_later, x = _share(of.per_m.x, near, first, 0, h)
        y_later, y = _share(of.per_m.y, near, first, 1, h)
        z_later, z = _share(of.per_m.z, near, first, 2, h)
        low = _level(near, 0, x_later, x, y_later, y)
        high = _level(near, _SIDE * _SIDE, x_later, x, y_later, y)
        if near[first, _SECOND + 2] < _NEVER:
            top = _level(near, 2 * _SIDE * _SIDE, x_later, x, y_later, y)
            groups.write(to, column * ROTORS + h, _between(low, high, top, z_later, z))
        else:
            groups.write(to, column * ROTORS + h, low + z * (high - low))


@partial(kernel, inlined=False)
def _sample(of, near, k, f, out, column):
    """Write a component at each hub to a row of `out`, from the field."""
    field.sample(of, near[HUBS : HUBS + 3], k, f, out[column])


@kernel
def _component(of, near, first, k, f, out, column):
    """Write a component at each hub to a row of `out`."""
    leaves_x = _place(of.x, of.per_m.x, near, first, 0)
    leaves_y = _place(of.y, of.per_m.y, near, first, 1)
    leaves_z = _place(of.z, of.per_m.z, near, first, 2)
    leaves = leaves_x or leaves_y or leaves_z or near[first, _TIME] != k + 1.0
    if leaves and not _hold(of, k, near, first):
        _sample(of, near, k, f, out, column)
        return
    _to_time(near, first, f)
    _interpolate(of, near, first, out, column)


@kernel
def meet(of, near, k, f, out):
    """Write the velocity of the air (m/s) at each hub to `out`.

    of : Field.  near : float64[ROWS, 8], with the place of each hub in rows HUBS, 0 before the first tick.
    k, f : as of `field.time_in`.  out : float64[3, 8].
    """
    _component(of.u, near, 0, k, f, out, 0)
    _component(of.v, near, _EACH, k, f, out, 1)
    _component(of.w, near, 2 * _EACH, k, f, out, 2)
