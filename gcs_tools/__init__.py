"""Ground tools, and the functions of `from gcs_tools import fly, read, compare, campaign, tune, airframe`."""

from __future__ import annotations

TYPE_CHECKING = False  # importing `typing` for that takes longer than all the rest
if TYPE_CHECKING:
    from typing import Any

    from gcs_tools.flight.run import fly as fly
    from gcs_tools.library.functions import airframe as airframe
    from gcs_tools.library.functions import campaign as campaign
    from gcs_tools.library.functions import compare as compare
    from gcs_tools.library.functions import read as read
    from gcs_tools.library.functions import tune as tune

FUNCTIONS = ("fly", "read", "compare", "campaign", "tune", "airframe")


def __getattr__(name: str) -> Any:
    """A function, imported when asked for: importing the package stays free."""
    if name == "fly":
        from gcs_tools.flight.run import fly

        return fly
    if name in FUNCTIONS:
        from gcs_tools.library import functions

        return getattr(functions, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
