"""Programs for these tests end with the test, as those of the processes' own tests."""

from __future__ import annotations

from tests.process.conftest import start

__all__ = ["start"]
