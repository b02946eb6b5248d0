"""Lanes: a number for each of several vehicles, as one value of compiled code.

A processor adds eight doubles as fast as one. `Lanes(8)` is a numba type of eight float64 that stands
wherever a kernel has a float: the same kernels, compiled for it, work for eight vehicles at a time.

Every lane has the bits of the scalar kernel. Addition, multiplication, division, square root and
comparison are those of IEEE 754 in a vector as in a scalar; nothing is contracted or reordered (never
`fastmath`). What the C library computes (sines, arc tangents, ...) it computes for each lane by
itself, or once where all lanes ask for the same.

What depends on data, and differs between lanes, goes through `algebra.select`. A branch (`if`, `while`,
`and`, `or`) is taken where all lanes agree. Where they do not, the kernel raises `LanesPart`, and whoever called flies
the lanes one by one.

A buffer of lanes is float64[n, width]. `buffer_at` makes of its address what `unpacker` and `packer`
read and write as if it were float64[n].
"""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np
from llvmlite import binding as ll
from llvmlite import ir
from numba import types
from numba.extending import (
    NativeValue,
    intrinsic,
    models,
    overload,
    register_model,
    typeof_impl,
    unbox,
)

from fcu.kernel import cache

try:  # names that numba may change: without them there are no lanes
    from numba.core import cgutils
    from numba.core.imputils import lower_builtin, lower_cast
    from numba.core.typeconv import Conversion
    from numba.core.types import BaseNamedTuple  # type: ignore[attr-defined]
    from numba.core.typing.templates import AbstractTemplate, infer_global
except ImportError as error:
    _missing: Exception | None = error
    AbstractTemplate = BaseNamedTuple = types.Type

    infer_global = lower_builtin = lower_cast = lambda *_arguments: lambda made: made
else:
    _missing = None

WIDTH = 8 if ll.get_host_cpu_features().get("avx512f") else 4  # that suits this machine


class Zeros:
    """Zero in each of `width` lanes: what Python gives a kernel to say of how many it is to be."""

    def __init__(self, width: int = WIDTH) -> None:
        self.width = width


class LanesPart(Exception):
    """A branch that lanes do not take alike."""


class Lanes(types.Type):  # type: ignore[misc]  # numba has no types; and no Number, of which it would ask NumPy
    """A float64 for each of `width` lanes."""

    def __init__(self, width: int) -> None:
        """Raises NotImplementedError where this version of numba lacks what lanes need."""
        if _missing is not None:
            cache.tell_missing(_missing, "vehicles fly one at a time")
            raise NotImplementedError(str(_missing))
        BaseNamedTuple.unify = _unified  # of no concern to processes without lanes
        self.width = width
        super().__init__(name=f"Lanes{width}")

    def can_convert_from(self, _typing: Any, other: Any) -> Any:
        """From a number, which all lanes then have."""
        return Conversion.safe if isinstance(other, (types.Float, types.Integer)) else None

    def unify(self, _typing: Any, other: Any) -> Any:
        """Of a number and lanes: lanes."""
        return self if isinstance(other, (types.Float, types.Integer)) else None


class Mask(types.Type):  # type: ignore[misc]
    """A truth value for each of `width` lanes."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"Mask{width}")

    def can_convert_from(self, _typing: Any, other: Any) -> Any:
        """From a truth value, which all lanes then have."""
        return Conversion.safe if isinstance(other, types.Boolean) else None

    def unify(self, _typing: Any, other: Any) -> Any:
        """Of a truth value and a mask: a mask."""
        return self if isinstance(other, types.Boolean) else None


_DOUBLE, _BIT, _INT32, _INT64 = (
    ir.DoubleType(), ir.IntType(1), ir.IntType(32), ir.IntType(64),
)  # fmt: skip


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    """A vector register; in memory no better aligned than a float64."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(_DOUBLE, kind.width))

    def load_from_data_pointer(self, builder: Any, pointer: Any, _align: Any = None) -> Any:
        return builder.load(pointer, align=8)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(_BIT, kind.width))


@typeof_impl.register(Zeros)
def _type_of_zeros(value: Zeros, _context: Any) -> Lanes:
    return Lanes(value.width)


@unbox(Lanes)
def _zeros(kind: Any, _value: Any, unboxing: Any) -> NativeValue:
    return NativeValue(ir.Constant(unboxing.context.get_value_type(kind), None))


# --- from one value to all lanes


def _splat(builder: Any, value: Any, width: int) -> Any:
    vector = ir.VectorType(value.type, width)
    nothing = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(nothing, value, ir.Constant(_INT32, 0))
    zeros = ir.Constant(ir.VectorType(_INT32, width), [0] * width)
    return builder.shuffle_vector(first, nothing, zeros)


@lower_cast(types.Float, Lanes)
@lower_cast(types.Integer, Lanes)
def _number_to_lanes(context: Any, builder: Any, kind: Any, to: Any, value: Any) -> Any:
    return _splat(builder, context.cast(builder, value, kind, types.float64), to.width)


@lower_cast(types.IntegerLiteral, Lanes)
def _literal_to_lanes(context: Any, builder: Any, kind: Any, to: Any, value: Any) -> Any:
    value = context.cast(builder, value, kind, kind.literal_type)
    return _number_to_lanes(context, builder, kind.literal_type, to, value)


@lower_cast(types.Boolean, Mask)
def _truth_to_mask(context: Any, builder: Any, kind: Any, to: Any, value: Any) -> Any:
    return _splat(builder, context.cast(builder, value, kind, types.boolean), to.width)


@lower_cast(types.BooleanLiteral, Mask)
def _truth_literal_to_mask(context: Any, builder: Any, kind: Any, to: Any, value: Any) -> Any:
    return _truth_to_mask(
        context, builder, types.boolean, to, context.cast(builder, value, kind, types.boolean)
    )


# --- named tuples: numba unifies tuples element by element, but named ones not at all


def _unified(kind: Any, typing: Any, other: Any) -> Any:
    """A named tuple of numbers and the same of lanes: of lanes."""
    if not isinstance(other, BaseNamedTuple) or kind.instance_class != other.instance_class:
        return None
    pairs = list(zip(kind.types, other.types, strict=True))
    made = [a if a == b else typing.unify_pairs(a, b) for a, b in pairs]
    if None in made or not any(map(_holds_lanes, made)):
        return None
    return types.NamedTuple.from_types(made, kind.instance_class)


def _holds_lanes(kind: Any) -> bool:
    parts = kind.types if isinstance(kind, types.BaseTuple) else ()
    return isinstance(kind, (Lanes, Mask)) or any(map(_holds_lanes, parts))


@lower_cast(BaseNamedTuple, BaseNamedTuple)
def _named_to_named(context: Any, builder: Any, kind: Any, to: Any, value: Any) -> Any:
    parts = [
        context.cast(builder, builder.extract_value(value, i), a, b)
        for i, (a, b) in enumerate(zip(kind.types, to.types, strict=True))
    ]
    return context.make_tuple(builder, to, parts)


# --- operators


def _is_number(kind: Any) -> bool:
    return isinstance(kind, (Lanes, types.Float, types.Integer))


def _is_truth(kind: Any) -> bool:
    return isinstance(kind, (Mask, types.Boolean))


def _all_lanes(kinds: Any, of: Any, fits: Any) -> Any:
    """The type with lanes among those of arguments that all fit, or None."""
    lanes = [kind for kind in kinds if isinstance(kind, of)]
    return lanes[0] if lanes and all(map(fits, kinds)) and len(set(lanes)) == 1 else None


def _operator(function: Any, of: Any, fits: Any, result: Any, generate: Any) -> None:
    """Give `function` of lanes and numbers (or masks and truth values) a meaning.

    result : from the type of the arguments to that of the result.  generate : (builder, *values).
    """

    @infer_global(function)
    class _Template(AbstractTemplate):  # type: ignore[misc]  # numba has no types
        def generic(self, arguments: Any, _keywords: Any) -> Any:
            kind = _all_lanes(arguments, of, fits)
            return None if kind is None else result(kind)(*[kind] * len(arguments))

    def lower(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return generate(builder, *arguments)

    for arity in (1, 2):
        lower_builtin(function, *[of] * arity)(lower)


def _alike(kind: Any) -> Any:
    return kind


def _compared(kind: Any) -> Any:
    return Mask(kind.width)


for _function, _name in (
    (operator.add, "fadd"), (operator.iadd, "fadd"), (operator.sub, "fsub"), (operator.isub, "fsub"),
    (operator.mul, "fmul"), (operator.imul, "fmul"), (operator.truediv, "fdiv"), (operator.itruediv, "fdiv"),
):  # fmt: skip
    _operator(
        _function, Lanes, _is_number, _alike,
        lambda builder, a, b, _name=_name: getattr(builder, _name)(a, b),
    )  # fmt: skip
_operator(operator.neg, Lanes, _is_number, _alike, lambda builder, a: builder.fneg(a))
_operator(operator.pos, Lanes, _is_number, _alike, lambda _builder, a: a)
for _function, _name in (
    (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="), (operator.eq, "=="),
):  # fmt: skip
    _operator(
        _function, Lanes, _is_number, _compared,
        lambda builder, a, b, _name=_name: builder.fcmp_ordered(_name, a, b),
    )  # fmt: skip
_operator(
    operator.ne, Lanes, _is_number, _compared,
    lambda builder, a, b: builder.fcmp_unordered("!=", a, b),
)  # fmt: skip
for _function, _name in (
    (operator.and_, "and_"), (operator.or_, "or_"), (operator.xor, "xor"),
    (operator.iand, "and_"), (operator.ior, "or_"), (operator.ixor, "xor"),
):  # fmt: skip
    _operator(
        _function, Mask, _is_truth, _alike,
        lambda builder, a, b, _name=_name: getattr(builder, _name)(a, b),
    )  # fmt: skip
_operator(operator.not_, Mask, _is_truth, _alike, lambda builder, a: builder.not_(a))


# --- choices


@intrinsic
def chosen(_typing: Any, mask: Any, a: Any, b: Any) -> Any:
    """`a` in lanes of which the mask is true, `b` in the others."""
    kind = Lanes(mask.width)

    def generate(context: Any, builder: Any, given: Any, values: Any) -> Any:
        a, b = (context.cast(builder, values[i], given.args[i], kind) for i in (1, 2))
        return builder.select(values[0], a, b)

    return kind(mask, a, b), generate


@intrinsic
def _counted(_typing: Any, mask: Any) -> Any:
    """How many lanes of a mask are true."""

    def generate(_context: Any, builder: Any, _given: Any, values: Any) -> Any:
        bits = builder.bitcast(values[0], ir.IntType(mask.width))
        return builder.zext(builder.ctpop(bits), _INT64)

    return types.int64(mask), generate


def any_lane(mask: Any) -> bool:
    """Whether a mask is true in a lane; of a truth value: itself."""
    return bool(mask)


@overload(any_lane)
def _any_lane(mask):
    if isinstance(mask, Mask):
        return lambda mask: _counted(mask) != 0
    return lambda mask: mask


@overload(bool)
def _truth(mask):
    if not isinstance(mask, Mask):
        return None
    n = mask.width

    def truth(mask):
        count = _counted(mask)
        if count != 0 and count != n:
            raise LanesPart
        return count == n

    return truth


# --- functions


def _function_of_lanes(function: Any, arity: int, code: Any) -> None:
    """Give `function` of lanes (of one or two arguments, of which one may be a number) a meaning.

    code : from (typing, kind) to what generates it, (context, builder, values) -> value.
    """

    def typed(typing: Any, *kinds: Any) -> Any:
        kind = _all_lanes(kinds, Lanes, _is_number)
        make = code(typing, kind)

        def generate(context: Any, builder: Any, _given: Any, values: Any) -> Any:
            made = [context.cast(builder, v, k, kind) for v, k in zip(values, kinds, strict=True)]
            return make(context, builder, made)

        return kind(*kinds), generate

    if arity == 1:
        of_one = intrinsic(lambda typing, x: typed(typing, x))

        @overload(function)
        def _of_one(x):
            return (lambda x: of_one(x)) if isinstance(x, Lanes) else None

    else:
        of_two = intrinsic(lambda typing, x, y: typed(typing, x, y))

        @overload(function)
        def _of_two(x, y):
            return (lambda x, y: of_two(x, y)) if _all_lanes((x, y), Lanes, _is_number) else None


def _by_vector(function: Any, arity: int, name: str) -> None:
    """A function of which LLVM knows an exact vector form."""

    def code(_typing: Any, kind: Any) -> Any:
        def make(context: Any, builder: Any, values: Any) -> Any:
            vector = context.get_value_type(kind)
            called = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(vector, [vector] * arity),
                f"llvm.{name}.v{kind.width}f64",
            )  # fmt: skip
            return builder.call(called, values)

        return make

    _function_of_lanes(function, arity, code)


_ROOTS: tuple[Any, ...] = math.sqrt, np.sqrt
_SIZES: tuple[Any, ...] = abs, math.fabs, np.abs
for _function in _ROOTS:
    _by_vector(_function, 1, "sqrt")
for _function in _SIZES:
    _by_vector(_function, 1, "fabs")
_by_vector(math.copysign, 2, "copysign")


@intrinsic
def _whole(_typing: Any, x: Any) -> Any:
    """Lanes made whole numbers of 64 bits and back, as numba does with those of `math.floor`."""

    def generate(context: Any, builder: Any, _given: Any, values: Any) -> Any:
        vector = context.get_value_type(x)
        floor = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(vector, [vector]), f"llvm.floor.v{x.width}f64"
        )
        whole = builder.fptosi(builder.call(floor, values), ir.VectorType(_INT64, x.width))
        return builder.sitofp(whole, vector)

    return x(x), generate


@overload(math.floor)
def _floor(x):
    return (lambda x: _whole(x)) if isinstance(x, Lanes) else None


@intrinsic
def single(_typing: Any, x: Any) -> Any:
    """Lanes as float32 holds them."""

    def generate(context: Any, builder: Any, _given: Any, values: Any) -> Any:
        less = builder.fptrunc(values[0], ir.VectorType(ir.FloatType(), x.width))
        return builder.fpext(less, context.get_value_type(x))

    return x(x), generate


def _one_by_one(function: Any, arity: int) -> None:
    """A function that the C library computes, or that numba has of float64 alone: lane by lane.

    Once, where all lanes have the same bits. Out of line, and known to have no effect: what is asked for
    twice is computed once, and what nobody reads, never.
    """
    name = f"{function.__module__}.{function.__name__}"
    scalar = types.float64(*[types.float64] * arity)

    def code(typing: Any, kind: Any) -> Any:
        resolved = typing.resolve_value_type(function)
        resolved.get_call_type(typing, scalar.args, {})

        def make(context: Any, builder: Any, values: Any) -> Any:
            found = context.get_function(resolved, scalar)
            return builder.call(_out_of_line(context, builder, name, kind, found, arity), values)

        return make

    _function_of_lanes(function, arity, code)


def _out_of_line(context: Any, builder: Any, name: str, kind: Any, scalar: Any, arity: int) -> Any:
    """The function of a module that calls `scalar` for each lane."""
    vector, width = context.get_value_type(kind), kind.width
    called = f"lanes.{name}.{width}"
    made = builder.module.globals.get(called)
    if made is not None:
        return made
    made = ir.Function(builder.module, ir.FunctionType(vector, [vector] * arity), called)
    made.linkage = "linkonce_odr"
    for attribute in ("noinline", "nounwind", "readnone", "willreturn"):
        made.attributes._known = made.attributes._known | {attribute}
        made.attributes.add(attribute)
    inside = ir.IRBuilder(made.append_basic_block("entry"))
    bits = ir.VectorType(_INT64, width)
    alike = ir.Constant(_BIT, 1)
    for argument in made.args:
        whole = inside.bitcast(argument, bits)
        first = inside.extract_element(whole, ir.Constant(_INT32, 0))
        same = inside.icmp_signed("==", whole, _splat(inside, first, width))
        same = inside.bitcast(same, ir.IntType(width))
        alike = inside.and_(
            alike, inside.icmp_signed("==", same, ir.Constant(ir.IntType(width), -1))
        )

    def at(lane: int) -> Any:
        index = ir.Constant(_INT32, lane)
        return scalar(inside, [inside.extract_element(argument, index) for argument in made.args])

    with inside.if_then(alike):
        inside.ret(_splat(inside, at(0), width))
    result = ir.Constant(vector, ir.Undefined)
    for lane in range(width):
        result = inside.insert_element(result, at(lane), ir.Constant(_INT32, lane))
    inside.ret(result)
    return made


_OF_ONE: tuple[Any, ...] = (
    math.sin, math.cos, math.tan, math.asin, math.acos, math.atan, math.sinh, math.cosh, math.tanh,
    math.exp, math.expm1, math.log, math.log1p, math.log10,
)  # fmt: skip
_OF_TWO: tuple[Any, ...] = (math.atan2,)
for _function in _OF_ONE:
    _one_by_one(_function, 1)
for _function in _OF_TWO:
    _one_by_one(_function, 2)


# --- buffers


class Buffer(types.Type):  # type: ignore[misc]
    """A buffer of lanes, float64[n, width] in memory: read and written by index, as a float64[n] is."""

    def __init__(self, of: Lanes) -> None:
        self.of = of
        super().__init__(name=f"Buffer({of})")


@register_model(Buffer)
class _BufferModel(models.PrimitiveModel):  # type: ignore[misc]
    """The address of its first number."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _DOUBLE.as_pointer())


@intrinsic
def buffer_at(_typing: Any, address: Any, like: Any) -> Any:
    """The Buffer that begins at an address.  like : Lanes of its width."""

    def generate(context: Any, builder: Any, _given: Any, values: Any) -> Any:
        return builder.inttoptr(values[0], _DOUBLE.as_pointer())

    return Buffer(like)(types.intp, like), generate


def _where(builder: Any, kind: Any, buffer: Any, index: Any) -> Any:
    first = builder.mul(index, ir.Constant(index.type, kind.of.width))
    vector = ir.VectorType(_DOUBLE, kind.of.width)
    return builder.bitcast(builder.gep(buffer, [first]), vector.as_pointer())


@infer_global(operator.getitem)
class _Read(AbstractTemplate):  # type: ignore[misc]  # numba has no types
    def generic(self, arguments: Any, _keywords: Any) -> Any:
        buffer, index = arguments
        if isinstance(buffer, Buffer) and isinstance(index, types.Integer):
            return buffer.of(buffer, types.intp)
        return None


@lower_builtin(operator.getitem, Buffer, types.intp)
def _read(_context: Any, builder: Any, given: Any, values: Any) -> Any:
    return builder.load(_where(builder, given.args[0], *values), align=8)


@infer_global(operator.setitem)
class _Write(AbstractTemplate):  # type: ignore[misc]  # numba has no types
    def generic(self, arguments: Any, _keywords: Any) -> Any:
        buffer, index, value = arguments
        if isinstance(buffer, Buffer) and isinstance(index, types.Integer) and _is_number(value):
            return types.none(buffer, types.intp, buffer.of)
        return None


@lower_builtin(operator.setitem, Buffer, types.intp, Lanes)
def _write(context: Any, builder: Any, given: Any, values: Any) -> Any:
    buffer, index, value = values
    builder.store(value, _where(builder, given.args[0], buffer, index), align=8)
    return context.get_dummy_value()


@intrinsic
def spread(_typing: Any, buffer: Any, column: Any, first: Any, stride: Any, wanted: Any) -> Any:
    """Copy as many columns of a Buffer as it has lanes, from `column` on, to a row of each lane.

    first : address of where the row of lane 0 is to have the first of them.  stride : bytes from there to
    that of the next lane.  wanted : int64, a bit a lane: which lanes are written.
    """
    width = buffer.of.width

    def generate(context: Any, builder: Any, _given: Any, values: Any) -> Any:
        source, column, first, stride, wanted = values
        vector = ir.VectorType(_DOUBLE, width)
        rows = []
        for i in range(width):
            index = builder.add(column, ir.Constant(column.type, i))
            rows.append(builder.load(_where(builder, buffer, source, index), align=8))
        step = 1
        while step < width:  # of 2 x 2 blocks of `step`, the two off the diagonal change places
            for i in range(width):
                if not i & step:
                    a, b = rows[i], rows[i + step]
                    low = [j if not j & step else width + j - step for j in range(width)]
                    high = [j + step if not j & step else width + j for j in range(width)]
                    rows[i], rows[i + step] = (
                        builder.shuffle_vector(
                            a, b, ir.Constant(ir.VectorType(_INT32, width), order)
                        )
                        for order in (low, high)
                    )
            step *= 2
        for lane, row in enumerate(rows):
            bit = builder.and_(wanted, ir.Constant(wanted.type, 1 << lane))
            with builder.if_then(builder.icmp_signed("!=", bit, ir.Constant(wanted.type, 0))):
                to = builder.add(first, builder.mul(stride, ir.Constant(stride.type, lane)))
                builder.store(row, builder.inttoptr(to, vector.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.none(buffer, types.intp, types.intp, types.intp, types.intp), generate
