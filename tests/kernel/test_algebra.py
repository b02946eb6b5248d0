"""The leaves' operators: one text, one result to the bit, in Python and compiled."""

from __future__ import annotations

import inspect
import math

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fcu.kernel import algebra
from fcu.kernel.algebra import Quat, Rotors, Vec3

MAGNITUDE = st.floats(1e-60, 1e60)
NUMBER = st.one_of(MAGNITUDE, MAGNITUDE.map(lambda x: -x))  # never zero: each also divides
VEC3 = st.builds(Vec3, NUMBER, NUMBER, NUMBER)
QUAT = st.builds(Quat, NUMBER, NUMBER, NUMBER, NUMBER)
ROTORS = st.builds(Rotors, *[NUMBER] * 8)

# as `kernel`, but for the cache on disk: it belongs to the packages, not to tests
compiled = numba.njit(nogil=True, error_model="numpy")


def flat(value):
    """Every float of a value, nested as it may be."""
    if isinstance(value, tuple):
        return [x for item in value for x in flat(item)]
    return [float(value)]


def bits(value):
    return np.array(flat(value)).tobytes()


@compiled
def vec3_operators(a, b, s):
    return a + b, a - b, -a, a * b, a * s, s * a, a / b, a / s, s * (a - b) / s + b * a


@compiled
def quat_operators(a, b, s):
    return a + b, -a, a * b, a * s, s * a, s * (a * b) + b


@compiled
def rotors_operators(a, b, s):
    return a + b, a - b, a * b, a * s, s * a, s * (a - b) + b * a


@settings(max_examples=100, deadline=None)
@given(VEC3, VEC3, NUMBER)
def test_vec3_operators_have_the_same_bits_compiled(a, b, s):
    assert bits(vec3_operators(a, b, s)) == bits(vec3_operators.py_func(a, b, s))


@settings(max_examples=100, deadline=None)
@given(QUAT, QUAT, NUMBER)
def test_quat_operators_have_the_same_bits_compiled(a, b, s):
    assert bits(quat_operators(a, b, s)) == bits(quat_operators.py_func(a, b, s))


@settings(max_examples=100, deadline=None)
@given(ROTORS, ROTORS, NUMBER)
def test_rotors_operators_have_the_same_bits_compiled(a, b, s):
    assert bits(rotors_operators(a, b, s)) == bits(rotors_operators.py_func(a, b, s))


@settings(max_examples=100, deadline=None)
@given(VEC3, VEC3)
def test_products_have_the_same_bits_compiled(a, b):
    for product in (algebra.dot, algebra.cross):
        assert bits(product(a, b)) == bits(product.py_func(a, b))
    assert bits(algebra.norm(a)) == bits(algebra.norm.py_func(a))


@settings(max_examples=100, deadline=None)
@given(st.builds(Rotors, *[MAGNITUDE] * 8))
def test_functions_of_rotors_have_the_same_bits_compiled(a):
    for function in (algebra.total, algebra.least, algebra.greatest, algebra.sqrt8):
        assert bits(function(a)) == bits(function.py_func(a))


def test_operators_are_those_of_linear_algebra():
    a, b = Vec3(1.0, -2.0, 3.0), Vec3(4.0, 5.0, -6.0)
    assert a + b == (5.0, 3.0, -3.0)
    assert a - b == (-3.0, -7.0, 9.0)
    assert a * b == (4.0, -10.0, -18.0)
    assert b / Vec3(2.0, 5.0, 3.0) == (2.0, 1.0, -2.0)
    assert 2.0 * a == a * 2.0 == (2.0, -4.0, 6.0)
    assert algebra.dot(a, b) == -24.0
    assert algebra.cross(a, b) == tuple(np.cross(a, b))
    assert algebra.norm(Vec3(2.0, 3.0, 6.0)) == 7.0


def test_the_hamilton_product_has_i_j_equal_to_k():
    i, j, k = Quat(0.0, 1.0, 0.0, 0.0), Quat(0.0, 0.0, 1.0, 0.0), Quat(0.0, 0.0, 0.0, 1.0)
    assert i * j == k
    assert j * i == -k
    assert i * i == (-1.0, 0.0, 0.0, 0.0)


def test_sums_and_extremes_run_over_all_eight_rotors():
    a = Rotors(1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0)
    assert algebra.total(a) == 255.0
    for i in range(8):
        one = Rotors(*[float(i == j) for j in range(8)])
        assert algebra.greatest(one) == 1.0
        assert algebra.least(-1.0 * one) == -1.0
    assert algebra.sqrt8(a * a) == a


@pytest.mark.parametrize("choose", [algebra.minimum, algebra.maximum])
def test_a_choice_with_a_nan_is_the_second_argument(choose):
    assert choose(math.nan, 2.0) == 2.0
    assert math.isnan(choose(2.0, math.nan))


def test_clip_holds_each_component_and_turns_a_nan_into_its_lower_limit():
    assert algebra.clip(5.0, -1.0, 2.0) == 2.0
    assert algebra.clip(-5.0, -1.0, 2.0) == -1.0
    assert algebra.clip(0.5, -1.0, 2.0) == 0.5
    assert algebra.clip(math.nan, -1.0, 2.0) == -1.0
    assert algebra.clip3(Vec3(-9.0, 0.25, 9.0), -1.0, 1.0) == (-1.0, 0.25, 1.0)
    eight = Rotors(-9.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 9.0)
    assert algebra.clip8(eight, -1.0, 1.0) == (-1.0, -1.0, -0.5, 0.0, 0.5, 1.0, 1.0, 1.0)


def test_select_takes_the_first_where_the_condition_holds():
    assert algebra.select(True, 1.0, 2.0) == 1.0
    assert algebra.select(False, 1.0, 2.0) == 2.0


def test_the_length_of_a_vector_of_two_is_correctly_rounded():
    """The bits of Python's own: the root of the sum of squares alone is off by a last bit now and then."""
    rng, off = np.random.default_rng(1), 0
    for x, y in rng.normal(size=(2000, 2)).tolist():
        assert algebra.hypot(x, y) == math.hypot(x, y)
        off += math.sqrt(x * x + y * y) != math.hypot(x, y)
    assert off > 100
    assert algebra.hypot(0.0, 0.0) == 0.0


@pytest.mark.parametrize("cls", [Vec3, Quat, Rotors])
def test_each_operator_that_numba_is_taught_is_the_one_of_python(cls, monkeypatch):
    """The operands in their order, whichever of the two is a number."""
    taught = []
    monkeypatch.setattr(
        algebra, "overload", lambda op: lambda rule: taught.append((op, rule)) or rule
    )
    algebra._teach(cls)
    a, b, s = cls(*range(1, len(cls._fields) + 1)), cls(*[3.0] * len(cls._fields)), 2.0
    known = 0
    for op, rule in taught:
        for operands in ((a, b), (a, s), (s, a), (a,)):
            if len(operands) == len(inspect.signature(rule).parameters):
                text = rule(*map(numba.typeof, operands))
                assert text is None or text(*operands) == op(*operands)
                known += text is not None
    assert known == {Vec3: 8, Quat: 5, Rotors: 5}[cls]
