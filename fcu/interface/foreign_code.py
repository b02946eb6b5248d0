"""The place where a program prepares for code of a user's own, such as a law in a FILE.py."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path


def _nothing(_file: Path) -> None:
    """Run it as it is."""


before_import: Callable[[Path], None] = _nothing  # called with the file
