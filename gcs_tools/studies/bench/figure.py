"""One figure of `make bench`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Figure:
    """One number. Its key carries its unit, and stays what it is from version to version."""

    key: str
    label: str
    value: float
    wanted: str = ""
