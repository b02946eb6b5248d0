"""What a process is handed at its start: a value on file, as JSON, exact to the bit.

The runner writes what it has prepared; the process reads it back. Every number flown is so
on file, in the run's folder.
"""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path
from typing import Any, TypeVar

from fcu.kernel.buffers import columns, from_buffer, to_buffer

T = TypeVar("T")

GRANT = struct.Struct("<q")  # on the plant's control pipe: a `grant`
_FLIGHTS = 1 << 40  # ticks: more than a flight has


class HandoverError(ValueError):
    """A file that does not hold the value it should: which, and what is wrong."""


def grant(ticks: int, flight: int = 0) -> bytes:
    """Ticks that may be flown in all, of the flight of that number; a reset begins the next one."""
    return GRANT.pack(flight * _FLIGHTS + min(ticks, _FLIGHTS - 1))


def granted(number: int) -> tuple[int, int]:
    """(flight, ticks) of a grant that was unpacked."""
    return divmod(number, _FLIGHTS)


def save(path: Path, value: Any) -> None:
    """Write a NamedTuple of floats. Raises OSError, and ValueError for a number not finite."""
    named = dict(zip(columns(type(value)), to_buffer(value).tolist(), strict=True))
    path.write_text(json.dumps({type(value).__name__: named}, allow_nan=False, indent=1))


def load(path: Path, cls: type[T]) -> T:
    """Read what `save` wrote. Raises HandoverError."""
    try:
        named = json.loads(path.read_text())[cls.__name__]
        if list(named) != columns(cls):
            raise ValueError("other names than this version's")
        for name, number in named.items():
            if isinstance(number, bool) or not isinstance(number, int | float):
                raise ValueError(f"{name}: expected a number, got {number!r}")
            if not math.isfinite(number):
                raise ValueError(f"{name}: expected a finite number, got {number!r}")
        return from_buffer(cls, list(named.values()))
    except OSError as error:
        raise HandoverError(f"{path}: {error.strerror}") from error
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise HandoverError(f"{path}: not a {cls.__name__} ({error})") from error
