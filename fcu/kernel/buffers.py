"""Between NamedTuples (inside compiled code) and float64 buffers (at the edge of a process).

Every leaf of a kernel value is a float64, so a value is a flat float64 array, in the
order of its declaration. The declaration is the layout: column names, packing and
unpacking are derived from it, never written out. `rows` reads a buffer by name.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from types import MappingProxyType
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


@cache
def fields(cls: Any) -> Mapping[str, Any]:
    """Field name -> type (float, or a NamedTuple class), in the order of declaration."""
    hints = get_type_hints(cls)  # slow, and asked for with every batch of rows
    return MappingProxyType({name: hints[name] for name in cls._fields})


@cache
def leaves(cls: Any) -> tuple[Leaf, ...]:
    """Every float of `cls`, in buffer order."""
    return tuple(_leaves(cls, ()))


def _leaves(cls: Any, path: tuple[str, ...]) -> Iterator[Leaf]:
    for name, kind in fields(cls).items():
        if is_value(kind):
            yield from _leaves(kind, (*path, name))
        elif kind is float:
            yield Leaf(".".join((*path, name)), (*path, name))
        else:
            raise TypeError(f"{cls.__name__}.{name} is {kind}; a leaf is a float")


def size(cls: Any) -> int:
    """Number of float64 in a buffer of `cls`."""
    return len(leaves(cls))


@cache
def field_type(cls: Any, name: str) -> Any:
    """The type of the field `name` (dotted) of `cls`: float, or a NamedTuple class; of "" `cls`.

    Raises AttributeError if there is no such field.
    """
    kind = cls
    for part in name.split(".") if name else ():
        if not is_value(kind) or part not in kind._fields:
            raise AttributeError(f"{cls.__name__} has no field {name}")
        kind = fields(kind)[part]
    return kind


def offset(cls: Any, name: str) -> int:
    """The column at which the field `name` (dotted) begins in a buffer of `cls`; of "" 0."""
    field_type(cls, name)
    kind, first = cls, 0
    for part in name.split(".") if name else ():
        inner = fields(kind)
        before = kind._fields[: kind._fields.index(part)]
        first += sum(size(inner[field]) if is_value(inner[field]) else 1 for field in before)
        kind = inner[part]
    return first


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
    value: T = builder(kind)(np.asarray(buffer, dtype=np.float64).tolist())
    return value


@cache
def builder(cls: Any) -> Callable[[Any], Any]:
    """What `unpacker` compiles, as plain Python: from a sequence of leaves."""
    expression, scope = _construction(cls, 0)
    exec(f"def build(b):\n    return {expression}\n", scope)
    build: Callable[[Any], Any] = scope["build"]
    return build


def _construction(cls: Any, first: int) -> tuple[str, dict[str, Any]]:
    """An expression that makes a `cls` of b[first], b[first + 1], ..., and the names it needs.

    Classes of one name may be in one value (the State of a law, the State of its guard).
    """
    names: dict[Any, str] = {}
    index = itertools.count(first)

    def construct(kind: Any) -> str:
        if not is_value(kind):
            return f"b[{next(index)}]"
        name = names.setdefault(kind, f"{kind.__name__}_{len(names)}")
        given = (f"{field}={construct(of)}" for field, of in fields(kind).items())
        return f"{name}({', '.join(given)})"

    expression = construct(cls)
    return expression, {name: kind for kind, name in names.items()}


def _compiled(source: str, name: str, scope: dict[str, Any]) -> Callable[..., Any]:
    exec(source, scope)
    function: Callable[..., Any] = numba.njit(nogil=True)(scope[name])
    return function


def unpacker(cls: Any, field: str = "") -> Callable[..., Any]:
    """A compiled function `(buffer) -> cls`, for use inside kernels; of its `field` (dotted) alone."""
    body, scope = _construction(field_type(cls, field), offset(cls, field))
    return _compiled(f"def unpack(b):\n    return {body}\n", "unpack", scope)


def packer(cls: Any, field: str = "") -> Callable[..., Any]:
    """A compiled function `(buffer, value)` that writes the value, or that of its `field` (dotted)."""
    kind, first = field_type(cls, field), offset(cls, field)
    parts = [f"v.{leaf.name}" for leaf in leaves(kind)] if is_value(kind) else ["v"]
    lines = [f"    b[{first + i}] = {part}" for i, part in enumerate(parts)]
    return _compiled("def pack(b, v):\n" + "\n".join(lines or ["    pass"]) + "\n", "pack", {})
