"""Programs for these tests end with the test, as those of the processes' own tests."""

from __future__ import annotations

from tests.process.conftest import fly, instance, start

__all__ = ["fly", "instance", "start"]
