"""How long tests wait for what is to come: one bound for all, and none is a claim about speed."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

PATIENCE_S = 180.0  # wall: many times what a busy machine takes for anything here


def until(condition: Callable[[], Any], what: str) -> Any:
    """Poll until `condition` gives something true; fail with `what` when patience ends."""
    end = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        assert time.monotonic() < end, f"not within {PATIENCE_S:g} s: {what}"
        time.sleep(0.01)
    return found
