"""Programs that are gone when the test is over, at an instance of its own."""

from tests.process.conftest import instance, start

__all__ = ["instance", "start"]
