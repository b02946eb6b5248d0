"""Rows of float64 read by name: where in a row the fields of its NamedTuple class stand.

A row is the buffer of one value (`buffers`), or begins with it; many rows are an array (n, width).
A name is dotted, as in a recording: `state.estimates.m_hat` is one float, `state` a value of many. Nobody
else knows a column by its number. Compiled code reads a field with `buffers.unpacker(cls, name)`.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple, TypeVar

import numpy as np

from fcu.kernel.buffers import builder, field_type, fields, offset, size

T = TypeVar("T")

Array = np.ndarray[Any, np.dtype[np.float64]]


@cache
def slice_of(cls: Any, name: str) -> slice:
    """The columns of the field `name` in a row of `cls`. Raises AttributeError if it has none."""
    kind = field_type(cls, name)
    first = offset(cls, name)
    return slice(first, first + (1 if kind is float else size(kind)))


@cache
def column_of(cls: Any, name: str) -> int:
    """The column of the float `name`. Raises TypeError if it is a value of several."""
    if field_type(cls, name) is not float:
        raise TypeError(f"{cls.__name__}.{name} has more than one column")
    return offset(cls, name)


def column(cls: Any, rows: Array, name: str) -> Array:
    """The field `name` of one row or of many, not copied: one number a row, or (..., size) of a value."""
    if field_type(cls, name) is float:
        one: Array = rows[..., column_of(cls, name)]
        return one
    part: Array = rows[..., slice_of(cls, name)]
    return part


def view(cls: type[T], rows: Array) -> T:
    """A `cls` of what stands in `rows`: of one row floats, of many columns float64 (n,), not copied."""
    kind: Any = cls
    value: T = builder(kind)(rows.tolist() if rows.ndim == 1 else rows.T)
    return value


def joined(name: str, *classes: Any) -> Any:
    """A NamedTuple class called `name`, whose row is that of the `classes` one behind the other."""
    return NamedTuple(name, [each for cls in classes for each in fields(cls).items()])
