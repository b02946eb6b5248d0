"""Lanes of numbers: each operator and function has the bits of the scalar, whatever the number."""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core.errors import NumbaError

from fcu.kernel import lanes
from fcu.kernel.algebra import Vec3, as_float32, maximum, minimum, select, select3
from fcu.kernel.buffers import packer, size, unpacker
from fcu.kernel.lanes import LanesPart, Zeros, any_lane, buffer_at, spread
from fcu.kernel.pointers import address_of

WIDTHS = pytest.mark.parametrize("width", [4, 8])
compiled = numba.njit(error_model="numpy")

ORDINARY = [0.0, 1.0, -1.0, 0.1, -2.5, 3.7e-9, 12345.678, math.pi, -7.0 * math.pi, 0.5]
EXTREMES = [
    -0.0, 5e-324, -2.2e-308, 2.2250738585072014e-308, 1.7976931348623157e308, -1e300, 1e-300,
    3.4028235677973366e38, 1.1754942e-38, math.inf, -math.inf, math.nan,
]  # fmt: skip
NUMBERS = ORDINARY + EXTREMES


@compiled
def two(x, y):
    """What is made of two numbers."""
    return (
        x + y, x - y, x * y, x / y, x + 1, 2.0 * y, 1.0 / x, -x, +x,
        minimum(x, y), maximum(x, y), math.copysign(x, y), math.atan2(x, y),
        select(x < y, 1.0, 0.0), select(x <= y, x, y), select(x > y, 1.0, 0.0), select(x >= y, x, 0.0),
        select(x == y, 1.0, 0.0), select(x != y, 1.0, 0.0), select(not (x < y), 1.0, y),
        select((x < y) & (y > 0.0), x, y), select((x < y) | (y == 0.0), x, y), select((x < y) ^ (x > 0.0), x, y),
        select((x < y) & True, 1.0, 0.0),
    )  # fmt: skip


@compiled
def one(x):
    """What is made of one."""
    return (
        abs(x), math.fabs(x), math.sqrt(x), math.sin(x), math.cos(x), math.tan(x), math.asin(x),
        math.acos(x), math.atan(x), math.sinh(x), math.cosh(x), math.tanh(x), math.exp(x), math.expm1(x), math.log(x),
        math.log1p(x), math.log10(x), as_float32(x),
    )  # fmt: skip


@compiled
def floored(x):
    """A whole number of what is not too great for one: what follows it, as `wrap` does."""
    return (x - 2.0 * math.pi * math.floor(x / (2.0 * math.pi) + 0.5),)


@compiled
def in_lanes(x, y, out, like):
    """`two` of x and y, `one` and `floored` of x: float64[1, width] each; out : float64[n, width]."""
    a, b = buffer_at(address_of(x), like)[0], buffer_at(address_of(y), like)[0]
    to, i = buffer_at(address_of(out), like), 0
    for v in numba.literal_unroll(two(a, b)):
        to[i] = v
        i += 1
    for v in numba.literal_unroll(one(a)):
        to[i] = v
        i += 1
    return i


@compiled
def floored_in_lanes(x, out, like):
    """`floored` of float64[1, width]."""
    buffer_at(address_of(out), like)[0] = floored(buffer_at(address_of(x), like)[0])[0]


def bits(numbers):
    """As integers; of what is not a number it does not matter which it is."""
    numbers = np.asarray(numbers, dtype=np.float64)
    return np.where(np.isnan(numbers), np.nan, numbers).view(np.int64)


def scalar(x, y):
    return [*two(x, y), *one(x)]


@WIDTHS
@pytest.mark.computes
def test_each_lane_has_the_bits_of_the_scalar(width):
    pairs = list(product(NUMBERS, NUMBERS))
    random = np.random.default_rng(width)
    random.shuffle(pairs)
    pairs += [pairs[0]] * (-len(pairs) % width)
    out = np.zeros((len(scalar(1.0, 1.0)), width))
    for at in range(0, len(pairs), width):
        x, y = (np.array([[pair[i] for pair in pairs[at : at + width]]]) for i in (0, 1))
        assert in_lanes(x, y, out, Zeros(width)) == len(out)
        expected = np.array([scalar(*pair) for pair in pairs[at : at + width]]).T
        assert np.array_equal(bits(out), bits(expected)), np.argwhere(bits(out) != bits(expected))


@WIDTHS
def test_lanes_that_all_ask_the_same(width):
    """What is computed once for all of them: 0 and -0 are not the same."""
    out = np.zeros((len(scalar(1.0, 1.0)), width))
    rows = [[x] * width for x in NUMBERS] + [
        [0.0, -0.0] * (width // 2),
        [-0.0] * (width - 1) + [0.0],
    ]
    for row in rows:
        x, y = np.array([row]), np.full((1, width), -1.0)
        in_lanes(x, y, out, Zeros(width))
        expected = np.array([scalar(each, -1.0) for each in row]).T
        assert np.array_equal(bits(out), bits(expected))


@WIDTHS
def test_a_whole_number_of_turns(width):
    out = np.zeros((1, width))
    numbers = [*ORDINARY, -0.0, 5e-324, 1e9, -1e9, 9.42477796076938, -3.1415926535897936]
    numbers += [0.0] * (-len(numbers) % width)
    for at in range(0, len(numbers), width):
        x = np.array([numbers[at : at + width]])
        floored_in_lanes(x, out, Zeros(width))
        assert np.array_equal(bits(out[0]), bits([floored(each)[0] for each in x[0]]))


@compiled
def branching(x, out, like):
    """A law that branches on data."""
    a, to = buffer_at(address_of(x), like)[0], buffer_at(address_of(out), like)
    if a > 0.0 and a < 10.0:
        to[0] = a + 1.0
    else:
        to[0] = -a
    return any_lane(a > 5.0)


@WIDTHS
def test_a_branch_is_taken_where_all_lanes_agree(width):
    out = np.zeros((1, width))
    assert not branching(np.full((1, width), 3.0), out, Zeros(width))
    assert (out == 4.0).all()
    assert branching(np.full((1, width), 30.0), out, Zeros(width))
    assert (out == -30.0).all()
    for odd in range(width):
        x = np.full((1, width), 3.0)
        x[0, odd] = -3.0
        with pytest.raises(LanesPart):
            branching(x, out, Zeros(width))


@WIDTHS
def test_a_truth_of_lanes_is_that_of_all_of_them_or_there_is_none(width, monkeypatch):
    """The rule in Python, by how many lanes are true: that of the compiled branch above."""
    for true in range(width + 1):
        monkeypatch.setattr(lanes, "_counted", lambda mask, true=true: true)
        truth = lanes._truth(lanes.Mask(width))
        if true in (0, width):
            assert truth(None) is (true == width)
        else:
            with pytest.raises(LanesPart):
                truth(None)


class Pair(NamedTuple):
    """Named tuples in named tuples."""

    v: Vec3
    w: float


@compiled
def unified(x, fixed, out, like):
    """Numbers in one branch, lanes in the other."""
    a = buffer_at(address_of(x), like)[0]
    pair = Pair(v=Vec3(0.0, -0.0, 1.0), w=2.0) if fixed else Pair(v=2.0 * Vec3(a, a, 1.0), w=a)
    part = 1.0
    for factor in (2.0, 3.0):
        part = minimum(part, factor * a)
    v = select3(a > 1.0, pair.v, Vec3(a, 7.0, a))
    to = buffer_at(address_of(out), like)
    to[0], to[1], to[2], to[3], to[4] = v.x, v.y, v.z, pair.w, part


@WIDTHS
def test_numbers_and_lanes_are_one_value(width):
    x, out = np.linspace(-1.0, 3.0, width)[None], np.zeros((5, width))
    unified(x, True, out, Zeros(width))
    big = x[0] > 1.0
    assert np.array_equal(out[0], np.where(big, 0.0, x[0]))
    assert np.array_equal(bits(out[1]), bits(np.where(big, -0.0, 7.0)))
    assert (out[3] == 2.0).all()
    assert np.array_equal(out[4], np.minimum(1.0, np.minimum(2.0 * x[0], 3.0 * x[0])))
    unified(x, False, out, Zeros(width))
    assert np.array_equal(out[0], np.where(big, 2.0 * x[0], x[0]))
    assert np.array_equal(out[2], np.where(big, 2.0, x[0]))


_unpack, _pack = unpacker(Pair), packer(Pair)


@compiled
def copied(source, to, like):
    """A value unpacked and packed: the functions that other buffers have."""
    _pack(buffer_at(address_of(to), like), _unpack(buffer_at(address_of(source), like)))


@WIDTHS
def test_a_buffer_is_read_and_written_as_any_other(width):
    source = np.arange(float(size(Pair) * width)).reshape(size(Pair), width)
    to = np.zeros_like(source)
    copied(source, to, Zeros(width))
    assert np.array_equal(source, to)


@compiled
def spread_out(source, out, wanted, like):
    """Columns 1 and on, to rows of out, float64[lane, n, width]: to the second of each."""
    spread(buffer_at(address_of(source), like), 1, address_of(out[0, 1]), out[0].nbytes, wanted)


@WIDTHS
def test_columns_are_spread_to_the_rows_of_the_lanes_that_are_wanted(width):
    source = np.random.default_rng(1).normal(size=(width + 3, width))
    for wanted in (2**width - 1, 0b0101, 0):
        out = np.zeros((width, 3, width))
        spread_out(source, out, wanted, Zeros(width))
        there = [bool(wanted >> lane & 1) for lane in range(width)]
        expected = np.where(np.array(there)[:, None], source[1 : width + 1].T, 0.0)
        assert np.array_equal(out[:, 1], expected)
        assert not out[:, [0, 2]].any()


def test_what_lanes_do_not_have_is_refused():
    @compiled
    def counted(x, like):
        return int(buffer_at(address_of(x), like)[0])

    with pytest.raises(NumbaError):
        counted(np.zeros((1, 4)), Zeros(4))
