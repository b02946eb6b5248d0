"""Where progress and verdicts of flights go."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs_tools.judging.result import Result


class Display:
    """Shows nothing: for machine-readable output, and for use from Python."""

    def note(self, text: str) -> None:
        """Something a person waits for is going on."""

    def compiling(self, done: int, of: int, wall_s: float) -> None:
        """Show that so many kernels are compiled, of about so many, after so long."""

    @contextmanager
    def flight(self, mission: str, duration_s: float) -> Iterator[Callable[[float], None]]:
        """A flight is under way; what is yielded is told the simulation time flown, s."""
        yield lambda time_s: None

    def verdict(self, result: Result, folder: str) -> None:
        """A flight has been judged."""

    def closing(
        self, passed: int, of: int, wall_s: float, failed: Sequence[str], cut: Sequence[str],
        left: Sequence[str],
    ) -> None:  # fmt: skip
        """Several flights are over. `failed`, `cut`, `left`: those that failed, were interrupted, not begun."""
