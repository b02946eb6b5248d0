"""The leaves of every kernel value, and their arithmetic.

A leaf is a float, a `Vec3`, a `Quat` or a `Rotors`. The three are NamedTuples with
operators; the same methods are what numba compiles, so an expression has one text and
one result to the bit, in Python and compiled. `+ -` and `* /` act element by element,
or with a float; `dot`, `cross` and (in `rotations`) `rotate` are the only named products.
"""

from __future__ import annotations

import math
import operator
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from fcu.kernel.compile import kernel
from fcu.kernel.lanes import Lanes, Mask, chosen, single


class Vec3(NamedTuple):
    """Three components along the axes of one frame (the name of the variable says which)."""

    x: float
    y: float
    z: float

    def __add__(self, b):
        return Vec3(self.x + b.x, self.y + b.y, self.z + b.z)

    def __sub__(self, b):
        return Vec3(self.x - b.x, self.y - b.y, self.z - b.z)

    def __neg__(self):
        return Vec3(-self.x, -self.y, -self.z)

    def __mul__(self, b):
        return self.times(b) if isinstance(b, Vec3) else self.scaled(b)

    def __rmul__(self, b):
        return self.scaled(b)

    def __truediv__(self, b):
        return self.over(b) if isinstance(b, Vec3) else self.divided(b)

    def times(self, b):
        return Vec3(self.x * b.x, self.y * b.y, self.z * b.z)

    def scaled(self, b):
        return Vec3(self.x * b, self.y * b, self.z * b)

    def over(self, b):
        return Vec3(self.x / b.x, self.y / b.y, self.z / b.z)

    def divided(self, b):
        return Vec3(self.x / b, self.y / b, self.z / b)


class Quat(NamedTuple):
    """Hamilton quaternion, scalar first. As a rotation, `q_EB` takes body components to Earth."""

    w: float
    x: float
    y: float
    z: float

    def __add__(self, b):
        return Quat(self.w + b.w, self.x + b.x, self.y + b.y, self.z + b.z)

    def __neg__(self):
        return Quat(-self.w, -self.x, -self.y, -self.z)

    def __mul__(self, b):
        return self.times(b) if isinstance(b, Quat) else self.scaled(b)

    def __rmul__(self, b):
        return self.scaled(b)

    def times(self, b):
        """Hamilton product."""
        return Quat(
            self.w * b.w - self.x * b.x - self.y * b.y - self.z * b.z,
            self.w * b.x + self.x * b.w + self.y * b.z - self.z * b.y,
            self.w * b.y - self.x * b.z + self.y * b.w + self.z * b.x,
            self.w * b.z + self.x * b.y - self.y * b.x + self.z * b.w,
        )

    def scaled(self, b):
        return Quat(self.w * b, self.x * b, self.y * b, self.z * b)


class Rotors(NamedTuple):
    """One value for each of the eight rotors, numbered as in the airframe file."""

    r1: float
    r2: float
    r3: float
    r4: float
    r5: float
    r6: float
    r7: float
    r8: float

    def __add__(self, b):
        return Rotors(
            self.r1 + b.r1, self.r2 + b.r2, self.r3 + b.r3, self.r4 + b.r4,
            self.r5 + b.r5, self.r6 + b.r6, self.r7 + b.r7, self.r8 + b.r8,
        )  # fmt: skip

    def __sub__(self, b):
        return Rotors(
            self.r1 - b.r1, self.r2 - b.r2, self.r3 - b.r3, self.r4 - b.r4,
            self.r5 - b.r5, self.r6 - b.r6, self.r7 - b.r7, self.r8 - b.r8,
        )  # fmt: skip

    def __mul__(self, b):
        return self.times(b) if isinstance(b, Rotors) else self.scaled(b)

    def __rmul__(self, b):
        return self.scaled(b)

    def times(self, b):
        return Rotors(
            self.r1 * b.r1, self.r2 * b.r2, self.r3 * b.r3, self.r4 * b.r4,
            self.r5 * b.r5, self.r6 * b.r6, self.r7 * b.r7, self.r8 * b.r8,
        )  # fmt: skip

    def scaled(self, b):
        return Rotors(
            self.r1 * b, self.r2 * b, self.r3 * b, self.r4 * b,
            self.r5 * b, self.r6 * b, self.r7 * b, self.r8 * b,
        )  # fmt: skip


_NUMBER = types.Number, Lanes


def _scaled_left(a, b):
    return b.scaled(a)


def _is(numba_type: Any, cls: type) -> bool:
    return isinstance(numba_type, types.BaseNamedTuple) and numba_type.instance_class is cls


def _teach(cls: Any) -> None:
    """Give numba the operators of `cls`: the very methods that Python uses."""

    def binary(op: Any, method: str) -> None:
        if hasattr(cls, method):
            text = getattr(cls, method)

            @overload(op)
            def _(self, b):
                return text if _is(self, cls) and _is(b, cls) else None

    def by_number(op: Any, method: str) -> None:
        if hasattr(cls, method):
            text = getattr(cls, method)

            @overload(op)
            def _(self, b):
                return text if _is(self, cls) and isinstance(b, _NUMBER) else None

    binary(operator.add, "__add__")
    binary(operator.sub, "__sub__")
    binary(operator.mul, "times")
    binary(operator.truediv, "over")
    by_number(operator.mul, "scaled")
    by_number(operator.truediv, "divided")

    scaled = cls.scaled

    @overload(operator.mul)
    def _(a, b):
        if isinstance(a, _NUMBER) and _is(b, cls):
            return lambda a, b: scaled_(b, a)
        return None

    scaled_ = kernel(scaled)

    if hasattr(cls, "__neg__"):
        negated = cls.__neg__

        @overload(operator.neg)
        def _(self):
            return negated if _is(self, cls) else None


for _cls in (Vec3, Quat, Rotors):
    _teach(_cls)


@kernel
def dot(a, b):
    """Scalar product of two Vec3."""
    return a.x * b.x + a.y * b.y + a.z * b.z


@kernel
def cross(a, b):
    """Vector product of two Vec3."""
    return Vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


@kernel
def norm(a):
    """Euclidean length of a Vec3."""
    return math.sqrt(a.x * a.x + a.y * a.y + a.z * a.z)


@kernel
def hypot(x, y):
    """Length of the vector (x, y), correctly rounded: the bits of `math.hypot` in Python.

    The C library's own, which compiled code would call, differs from it by a last bit now and then.
    """
    p, p_lost = _squared(x)
    q, q_lost = _squared(y)
    greater, less = maximum(p, q), minimum(p, q)
    s = greater + less
    lost = (less - (s - greater)) + (p_lost + q_lost)
    h = math.sqrt(s)
    t, t_lost = _squared(h)
    return h + select(h > 0.0, ((s - t) + (lost - t_lost)) / (2.0 * h), 0.0)


@kernel
def _squared(x):
    """`x * x`, and what it lost in rounding (Dekker, 1971)."""
    c = 134217729.0 * x  # 2**27 + 1
    high = c - (c - x)
    low = x - high
    p = x * x
    return p, ((high * high - p) + 2.0 * high * low) + low * low


@kernel
def total(a):
    """Sum over the rotors, in pairs (one order, so one result)."""
    return ((a.r1 + a.r2) + (a.r3 + a.r4)) + ((a.r5 + a.r6) + (a.r7 + a.r8))


def select(condition, a, b):
    """`a` where the condition holds, else `b`: the only data-dependent choice a kernel makes."""
    return a if condition else b


@overload(select)
def _select(condition, a, b):
    return (
        (lambda condition, a, b: chosen(condition, a, b)) if isinstance(condition, Mask) else select
    )


def as_float32(x):
    """A float rounded as a float32 holds it."""
    return np.float64(np.float32(x))


@overload(as_float32)
def _as_float32(x):
    return (lambda x: single(x)) if isinstance(x, Lanes) else as_float32


@kernel
def select3(condition, a, b):
    """`select` of each component of two Vec3."""
    return Vec3(
        select(condition, a.x, b.x), select(condition, a.y, b.y), select(condition, a.z, b.z)
    )


@kernel
def minimum(a, b):
    """The lesser of two floats; `b` if either is not a number."""
    return select(a < b, a, b)


@kernel
def maximum(a, b):
    """The greater of two floats; `b` if either is not a number."""
    return select(a > b, a, b)


@kernel
def clip(a, low, high):
    """`a` held inside [low, high]."""
    return minimum(maximum(a, low), high)


@kernel
def clip3(a, low, high):
    """A Vec3 held, component by component, inside [low, high] (floats)."""
    return Vec3(clip(a.x, low, high), clip(a.y, low, high), clip(a.z, low, high))


@kernel
def clip8(a, low, high):
    """A Rotors held, rotor by rotor, inside [low, high] (floats)."""
    return Rotors(
        clip(a.r1, low, high), clip(a.r2, low, high), clip(a.r3, low, high), clip(a.r4, low, high),
        clip(a.r5, low, high), clip(a.r6, low, high), clip(a.r7, low, high), clip(a.r8, low, high),
    )  # fmt: skip


@kernel
def least(a):
    """The smallest of the eight."""
    return minimum(
        minimum(minimum(a.r1, a.r2), minimum(a.r3, a.r4)),
        minimum(minimum(a.r5, a.r6), minimum(a.r7, a.r8)),
    )


@kernel
def greatest(a):
    """The largest of the eight."""
    return maximum(
        maximum(maximum(a.r1, a.r2), maximum(a.r3, a.r4)),
        maximum(maximum(a.r5, a.r6), maximum(a.r7, a.r8)),
    )


@kernel
def inverse8(a):
    """1 over each of the eight; 0 where it is 0, of a rotor that is absent."""
    return Rotors(
        inverse1(a.r1), inverse1(a.r2), inverse1(a.r3), inverse1(a.r4),
        inverse1(a.r5), inverse1(a.r6), inverse1(a.r7), inverse1(a.r8),
    )  # fmt: skip


@kernel
def inverse1(a):
    """The same of one."""
    return 1.0 / select(a == 0.0, math.inf, a)


@kernel
def sqrt8(a):
    """Square roots, rotor by rotor."""
    return Rotors(
        math.sqrt(a.r1), math.sqrt(a.r2), math.sqrt(a.r3), math.sqrt(a.r4),
        math.sqrt(a.r5), math.sqrt(a.r6), math.sqrt(a.r7), math.sqrt(a.r8),
    )  # fmt: skip
