"""Values of the law, changed by the names of their fields."""

from __future__ import annotations

from typing import Any

import numpy as np

from fcu.kernel.buffers import fields, is_value


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
