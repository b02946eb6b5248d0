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
from numba.core.types import WrapperAddressProtocol
from numba.experimental import function_type as _registered  # noqa: F401  # by which numba knows it
from numba.extending import intrinsic

from fcu.kernel.compile import kernel


class Pointer(WrapperAddressProtocol):
    """The address of a compiled kernel, and how it is called."""

    def __init__(self, function: Any, signature: Any) -> None:
        """Compiles `function`, or loads it. `signature`: of numba, `None` and numbers."""
        function.compile(signature.args)
        compiled = function.overloads[signature.args]
        name = compiled.fndesc.llvm_cfunc_wrapper_name
        self._kept = compiled  # with its machine code
        self._signature = signature
        self._address: int = compiled.library.get_pointer_to_function(name)

    def __wrapper_address__(self) -> int:
        return self._address

    def signature(self) -> Any:
        """As numba asks for it."""
        return self._signature


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


# (t, engaged, age, and five addresses): how the tick of any law is called, `fcu.tick.tick_at`
LAW_CALL = types.none(*[types.float64] * 3, *[types.intp] * 5)


@kernel
def address_of(array):
    """The address of the first element of an array."""
    return np.intp(array.ctypes.data)
