"""How long tests wait for what is to come: one bound for all, and none is a claim about speed."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

PATIENCE_S = 480.0  # wall: beside two other workers on two slow cores a cold start takes 170


def until(condition: Callable[[], Any], what: str) -> Any:
    """Poll until `condition` gives something true; fail with `what` when patience ends."""
    end = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        assert time.monotonic() < end, f"not within {PATIENCE_S:g} s: {what}"
        time.sleep(0.01)
    return found


def with_room(flown: Callable[[], tuple[int, str]]) -> tuple[int, str]:
    """Exit code and text of a program, which is begun again while other tests have the ports that it needs."""

    def once() -> tuple[int, str] | None:
        code, text = flown()
        return None if "in use" in text else (code, text)

    found: tuple[int, str] = until(once, "a free instance")
    return found
