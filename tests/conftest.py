"""For all tests: properties are checked on the same examples every time, however long they take."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("project", deadline=None, derandomize=True)
settings.load_profile("project")
