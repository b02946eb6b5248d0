"""Values that tests of laws share, and values of the law, changed by the names of their fields."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fcu.kernel.buffers import fields, is_value

# Yaw, setpoint (m, E), and the signs of the roll and the pitch that lead there.
TILTS = [
    (0.0, (2.0, 0.0, 0.0), 0, 1),
    (0.0, (0.0, 2.0, 0.0), -1, 0),
    (0.5 * math.pi, (0.0, 2.0, 0.0), 0, 1),  # nose north: north is ahead
    (0.5 * math.pi, (2.0, 0.0, 0.0), 1, 0),  # and east is to the right
    (math.pi, (2.0, 0.0, 0.0), 0, -1),
]


def with_fields(value: Any, **given: Any) -> Any:
    """A nested NamedTuple with other values in some fields, wherever in it these stand.

    Raises AssertionError for a name that is there twice, or not at all.
    """
    found: list[str] = []

    def changed(part: Any) -> Any:
        if not hasattr(part, "_fields"):
            return part
        found.extend(name for name in part._fields if name in given)
        return type(part)(
            *(
                given[name] if name in given else changed(getattr(part, name))
                for name in part._fields
            )
        )

    result = changed(value)
    assert sorted(found) == sorted(given), set(given) ^ set(found)
    return result


def dtype(cls: Any) -> np.dtype[Any]:
    """Structured dtype of a row of `cls`, nested as the class is: a row's memory, by name."""
    return np.dtype(
        [(name, dtype(kind) if is_value(kind) else "<f8") for name, kind in fields(cls).items()]
    )
