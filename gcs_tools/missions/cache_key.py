"""Caches for many flights of a mission, most of which ask for the same."""

from __future__ import annotations

from typing import Generic, TypeVar

Value = TypeVar("Value")


class CacheKey(Generic[Value]):
    """A value as the key of a cache: equal to another of which the same is told.

    Numbers are told as text or bytes: 0.0 equals -0.0, and flies to other bits.
    """

    def __init__(self, of: Value, *told: str | bytes) -> None:
        self.of = of
        self._told = told

    def __hash__(self) -> int:
        return hash(self._told)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, CacheKey) and self._told == other._told
