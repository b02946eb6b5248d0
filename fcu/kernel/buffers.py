"""Between NamedTuples (inside compiled code) and float64 buffers (at the edge of a process).

Every leaf of a kernel value is a float64, so a value is a flat float64 array, in the
order of its declaration. The declaration is the layout: dtype, column names, packing
and unpacking are derived from it, never written out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple, TypeVar, get_type_hints

import numba
import numpy as np

T = TypeVar("T")


class Leaf(NamedTuple):
    """One float of a value: its dotted name, and the expression that reaches it."""

    name: str
    path: tuple[str, ...]


def is_value(cls: Any) -> bool:
    """Whether `cls` is a NamedTuple class (and not a float leaf)."""
    return isinstance(cls, type) and issubclass(cls, tuple) and hasattr(cls, "_fields")


def fields(cls: Any) -> dict[str, Any]:
    """Field name -> type (float, or a NamedTuple class), in the order of declaration."""
    hints = get_type_hints(cls)
    return {name: hints[name] for name in cls._fields}


def leaves(cls: Any, path: tuple[str, ...] = ()) -> Iterator[Leaf]:
    """Every float of `cls`, in buffer order."""
    for name, kind in fields(cls).items():
        if is_value(kind):
            yield from leaves(kind, (*path, name))
        elif kind is float:
            yield Leaf(".".join((*path, name)), (*path, name))
        else:
            raise TypeError(f"{cls.__name__}.{name} is {kind}; a leaf is a float")


def size(cls: Any) -> int:
    """Number of float64 in a buffer of `cls`."""
    return sum(1 for _ in leaves(cls))


def dtype(cls: Any) -> np.dtype[Any]:
    """Structured little-endian dtype of `cls`, nested as the class is."""
    return np.dtype(
        [(name, dtype(kind) if is_value(kind) else "<f8") for name, kind in fields(cls).items()]
    )


def columns(cls: Any) -> list[str]:
    """Dotted names, one a float64 of the buffer."""
    return [leaf.name for leaf in leaves(cls)]


def to_buffer(value: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """A value as a new flat float64 array."""
    kind: Any = type(value)
    return np.array(_flattener(kind)(value), dtype=np.float64)


@cache
def _flattener(cls: Any) -> Callable[[Any], tuple[float, ...]]:
    scope: dict[str, Any] = {}
    row = "".join(f"v.{leaf.name}, " for leaf in leaves(cls))
    exec(f"def flat(v):\n    return ({row})\n", scope)
    flat: Callable[[Any], tuple[float, ...]] = scope["flat"]
    return flat


def from_buffer(cls: type[T], buffer: Sequence[float] | np.ndarray[Any, Any]) -> T:
    """A value from a flat array of `size(cls)` floats."""
    kind: Any = cls
    value: T = _builder(kind)(np.asarray(buffer, dtype=np.float64).tolist())
    return value


@cache
def _builder(cls: Any) -> Callable[[list[float]], Any]:
    """What `unpacker` compiles, as plain Python: from a list of floats."""
    scope = _constructors(cls, {})
    exec(f"def build(b):\n    return {_construct(cls, iter(range(size(cls))))}\n", scope)
    build: Callable[[list[float]], Any] = scope["build"]
    return build


def _constructors(cls: Any, found: dict[str, Any]) -> dict[str, Any]:
    found[cls.__name__] = cls
    for kind in fields(cls).values():
        if is_value(kind):
            _constructors(kind, found)
    return found


def _construct(cls: Any, index: Iterator[int]) -> str:
    parts = [
        _construct(kind, index) if is_value(kind) else f"b[{next(index)}]"
        for kind in fields(cls).values()
    ]
    return f"{cls.__name__}({', '.join(parts)})"


def _compiled(source: str, name: str, scope: dict[str, Any]) -> Callable[..., Any]:
    exec(source, scope)
    function: Callable[..., Any] = numba.njit(nogil=True)(scope[name])
    return function


def unpacker(cls: Any) -> Callable[..., Any]:
    """A compiled function `(buffer) -> cls`, for use inside kernels."""
    body = _construct(cls, iter(range(size(cls))))
    return _compiled(f"def unpack(b):\n    return {body}\n", "unpack", _constructors(cls, {}))


def packer(cls: Any) -> Callable[..., Any]:
    """A compiled function `(buffer, value)` that writes the value, for use inside kernels."""
    lines = [f"    b[{i}] = v.{leaf.name}" for i, leaf in enumerate(leaves(cls))]
    return _compiled("def pack(b, v):\n" + "\n".join(lines) + "\n", "pack", {})
