"""A kernel called through its address: what calls it is compiled, and cached, without it.

A kernel that calls another by its name holds a copy of it, as long to compile again as the first.
Whoever must not (what flies any law, and is compiled once for all of them) takes it as an argument.
The address is an ordinary value, so both are served from the cache. Numbers cross as they are,
arrays as the address of their first element.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numba import carray, types
from numba.extending import intrinsic

from fcu.kernel.compile import kernel
from fcu.kernel.lanes import Lanes


class Pointer:
    """Where a compiled kernel is in memory: `address`, valid as long as this is kept."""

    def __init__(self, function: Any, signature: Any) -> None:
        """Compiles `function`, or loads it. `signature`: of numba, `None` and numbers."""
        function.compile(signature.args)
        self.function = function
        compiled = function.overloads[signature.args]
        name = compiled.fndesc.llvm_func_name
        self._kept = compiled  # with its machine code
        self.address: int = compiled.library.get_pointer_to_function(name)


@intrinsic
def _float64_at(_typing: Any, address: Any) -> Any:
    """A pointer to float64 from an integer."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float64)(types.intp), generate


@partial(kernel, makes_arrays=True)
def array_at(address, size):
    """The float64[size] that begins at an address."""
    return carray(_float64_at(address), size)


# (t, engaged, age, and five addresses): how the tick of any law is called, `fcu.process.tick.tick_at`
LAW_CALL = types.none(*[types.float64] * 3, *[types.intp] * 5)


def lanes_call(width: int) -> Any:
    """The same of a tick of several vehicles, with an age for each: `fcu.process.tick.lanes_at`."""
    return types.none(types.float64, types.float64, Lanes(width), *[types.intp] * 5)


@kernel
def address_of(array):
    """The address of the first element of an array."""
    return np.intp(array.ctypes.data)


@intrinsic
def call_law(_typing: Any, address: Any, arguments: Any) -> Any:
    """Call what is at an address with a tuple of LAW_CALL's or lanes_call's arguments; whether it has raised.

    An address is an integer to numba: a function as an argument would cost each call as much as
    fifty ticks. What was raised is not told: call the same from Python.
    """
    age = arguments.types[2]
    call = lanes_call(age.width) if isinstance(age, Lanes) else LAW_CALL

    def generate(context: Any, builder: Any, _signature: Any, given: Any) -> Any:
        convention = context.call_conv
        kind = convention.get_function_type(call.return_type, call.args)
        function = builder.inttoptr(given[0], kind.as_pointer())
        taken = [builder.extract_value(given[1], i) for i in range(len(call.args))]
        status, _ = convention.call_function(builder, function, call.return_type, call.args, taken)
        return status.is_error

    return types.boolean(types.intp, types.Tuple(call.args)), generate
