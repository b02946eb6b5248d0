"""Ground tools. `from gcs_tools import fly` flies a mission and returns its Result."""

from __future__ import annotations

TYPE_CHECKING = False  # importing `typing` for that takes longer than all the rest
if TYPE_CHECKING:
    from typing import Any

    from gcs_tools.flight.run import fly as fly


def __getattr__(name: str) -> Any:
    """`fly`, imported when asked for: importing the package stays free."""
    if name == "fly":
        from gcs_tools.flight.run import fly

        return fly
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
