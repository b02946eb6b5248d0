"""Runs kernels as plain Python, with the arithmetic that they have compiled.

Compiled, a division by zero and a root of a negative number are not errors, and numbers read from
an array are floats. `NUMBA_DISABLE_JIT` gives Python's own rules, with which half of the tests fail.
"""

from __future__ import annotations

import ast
import builtins
import functools
import math
import re
from collections.abc import Callable
from typing import Any

_VALUES = "fcu/kernel/algebra.py"
# Appended to the file that declares them; the number of no line changes.
_APPENDED = b"\nfor _kind in (Vec3, Quat, Rotors):\n    _kind.__array_ufunc__ = _ieee_ufunc\n"


def prepared(path: str, source: bytes) -> bytes:
    """A file in which every division of a kernel is by `_ieee_divided`. Lines keep their numbers."""
    if b"@kernel" in source or path == _VALUES:
        source = _divided(source)
    return source + _APPENDED if path == _VALUES else source


def _divided(source: bytes) -> bytes:
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    inserted: list[tuple[int, int, bytes]] = []  # where, and how deep
    replaced: list[tuple[int, int]] = []
    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef) or not function.decorator_list:
            continue
        if "kernel" not in ast.unparse(function.decorator_list[0]):
            continue
        for node in ast.walk(function):
            if not isinstance(node, ast.BinOp) or not isinstance(node.op, ast.Div):
                continue
            begin = starts[node.lineno - 1] + node.col_offset
            end = starts[(node.end_lineno or 1) - 1] + (node.end_col_offset or 0)
            left = starts[(node.left.end_lineno or 1) - 1] + (node.left.end_col_offset or 0)
            right = starts[node.right.lineno - 1] + node.right.col_offset
            gap = re.sub(rb"#[^\n]*", lambda m: b" " * len(m[0]), source[left:right])
            at = left + gap.index(b"/")
            # both operands in brackets of their own, whatever brackets they had
            inserted += [(begin, -(end - begin), b"_ieee_divided(("), (end, end - begin, b"))")]
            replaced.append((at, at + 1))
    pieces = [(at, depth, 0, text) for at, depth, text in inserted]
    pieces += [(a, 0, b - a, b"),(") for a, b in replaced]
    done, last = b"", 0
    for at, _, removed, text in sorted(pieces):
        done += source[last:at] + text
        last = at + removed
    return done + source[last:]


def _ieee_divided(a: Any, b: Any) -> Any:
    try:
        return a / b
    except ZeroDivisionError:
        if isinstance(a, tuple):
            return type(a)(*(_ieee_divided(part, b) for part in a))
        if a != a or a == 0.0:
            return math.nan
        return math.copysign(math.inf, a) * math.copysign(1.0, b)


def _ieee_ufunc(self: Any, ufunc: Any, method: str, *inputs: Any, **named: Any) -> Any:
    """The value's own product with a number of numpy's, and of arrays for all else."""
    import numpy as np

    if ufunc is np.multiply and method == "__call__" and isinstance(inputs[0], np.floating):
        return float(inputs[0]) * inputs[1]
    made = [np.array(each) if isinstance(each, tuple) else each for each in inputs]
    return getattr(ufunc, method)(*made, **named)


def _quiet(function: Callable[..., float], instead: float) -> Callable[..., float]:
    @functools.wraps(function)
    def quiet(*given: Any) -> float:
        try:
            return function(*given)
        except ValueError:
            return math.nan
        except OverflowError:
            return instead

    return quiet


def _uncompiled(*given: Any, **_flags: Any) -> Any:
    """In the place of `numba.njit`: functions stay plain Python, and are given Python's own numbers."""
    import numpy as np

    if not given:
        return _uncompiled
    (function,) = given
    of_buffer = function.__name__ == "unpack"

    @functools.wraps(function)
    def plain(*arguments: Any, **named: Any) -> Any:
        if of_buffer and isinstance(arguments[0], np.ndarray):
            return function(arguments[0].tolist())
        for argument in arguments:
            if type(argument) is np.float64:
                arguments = tuple(float(a) if type(a) is np.float64 else a for a in arguments)
                break
        return function(*arguments, **named)

    plain.py_func = function  # type: ignore[attr-defined]
    return plain


class _Libc:
    """In the place of `numba.types.ExternalFunction`: a function of libc, called by ctypes."""

    def __init__(self, name: str, signature: Any) -> None:
        import ctypes

        def of(kind: Any) -> Any:
            return getattr(ctypes, f"c_{kind.name.replace('uint64', 'size_t')}")

        self._call = getattr(ctypes.CDLL(None), name)
        self._call.argtypes = [of(kind) for kind in signature.args]
        self._call.restype = of(signature.return_type)

    def __call__(self, *given: Any) -> int:
        return int(self._call(*map(int, given)))


def install() -> None:
    """From now on what this process imports is not compiled."""
    import numba
    import numpy as np

    numba.njit = _uncompiled
    numba.types.ExternalFunction = _Libc
    np.seterr(all="ignore")
    builtins._ieee_divided = _ieee_divided  # type: ignore[attr-defined]
    builtins._ieee_ufunc = _ieee_ufunc  # type: ignore[attr-defined]
    for name in ("sqrt", "sin", "cos", "tan", "acos", "asin", "log", "fmod"):
        setattr(math, name, _quiet(getattr(math, name), math.nan))
    for name in ("exp", "pow", "cosh", "sinh"):
        setattr(math, name, _quiet(getattr(math, name), math.inf))
