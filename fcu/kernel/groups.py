"""Groups: the numbers of eight rotors at a time, as lanes, or one after the other where there are no lanes.

A group is `WIDE` numbers of a row of eight in memory, from number h on. A kernel that goes through rows in steps of
`WIDE` has the same bits either way. What is summed over rotors is summed in their order.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

from fcu.kernel.lanes import Lanes

ROTORS = 8
_DOUBLE = ir.DoubleType()

try:
    _GROUP: Any = Lanes(ROTORS)
except NotImplementedError:
    _GROUP = types.float64
WIDE = ROTORS if isinstance(_GROUP, Lanes) else 1


def _pointer(context: Any, builder: Any, address: Any, index: Any) -> Any:
    first = builder.inttoptr(address, _DOUBLE.as_pointer())
    where = builder.gep(first, [index])
    return builder.bitcast(where, context.get_value_type(_GROUP).as_pointer())


@intrinsic
def read(_typing: Any, address: Any, index: Any) -> Any:
    """The group that begins at float64 number `index` from an address."""

    def generate(context: Any, builder: Any, _given: Any, values: Any) -> Any:
        return builder.load(_pointer(context, builder, *values), align=8)

    return _GROUP(types.intp, types.intp), generate


@intrinsic
def write(_typing: Any, address: Any, index: Any, value: Any) -> Any:
    """Write a group, or a number for all of it, to where `read` finds it."""

    def generate(context: Any, builder: Any, _given: Any, values: Any) -> Any:
        address, index, value = values
        builder.store(value, _pointer(context, builder, address, index), align=8)
        return context.get_dummy_value()

    return types.none(types.intp, types.intp, _GROUP), generate


@intrinsic
def add_up(_typing: Any, total: Any, group: Any) -> Any:
    """A sum (float) and the numbers of a group, added one after the other."""

    def generate(_context: Any, builder: Any, _given: Any, values: Any) -> Any:
        total, group = values
        if WIDE == 1:
            return builder.fadd(total, group)
        for i in range(WIDE):
            one = builder.extract_element(group, ir.Constant(ir.IntType(32), i))
            total = builder.fadd(total, one)
        return total

    return types.float64(types.float64, _GROUP), generate


@intrinsic
def _all_of(_typing: Any, rotors: Any) -> Any:
    """Rotors as lanes."""

    def generate(context: Any, builder: Any, _given: Any, values: Any) -> Any:
        group = ir.Constant(context.get_value_type(_GROUP), ir.Undefined)
        for i in range(WIDE):
            one = builder.extract_value(values[0], i)
            group = builder.insert_element(group, one, ir.Constant(ir.IntType(32), i))
        return group

    return _GROUP(rotors), generate


def of(rotors: Any, h: int) -> Any:
    """The group of Rotors that begins with number h."""
    return rotors[h]


@overload(of)
def _of(rotors, h):
    return (lambda rotors, h: rotors[h]) if WIDE == 1 else (lambda rotors, h: _all_of(rotors))
