"""For all tests: what `--quick` leaves out, and the same examples of a property every time."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("project", deadline=None, derandomize=True)
settings.load_profile("project")

# The whole of these takes real processes, a browser or the clients of others; of the other
# folders `--quick` leaves out what is marked `slow`: processes, and seconds of computing.
SLOW_FOLDERS = {
    "bad_input",
    "bus",
    "clients",
    "missions",
    "off_host",
    "paper",
    "process",
    "replay",
    "tools",
    "view",
}


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--quick", action="store_true", help="leave out what is slow")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    here = Path(__file__).parent
    slow = collection_path.parent == here and collection_path.name in SLOW_FOLDERS
    return True if slow and config.getoption("quick") else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("quick"):
        slow = [item for item in items if item.get_closest_marker("slow")]
        config.hook.pytest_deselected(items=slow)
        items[:] = [item for item in items if not item.get_closest_marker("slow")]
