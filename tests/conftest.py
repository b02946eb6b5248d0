"""For all tests: what `--quick` leaves out, and the same examples of a property every time."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("project", deadline=None, derandomize=True)
settings.load_profile("project")

# The whole of these takes real processes, a browser or the clients of others; of the other
# folders `--quick` leaves out what is marked: `slow` are processes, `computes` takes long to compute
# or compiles kernels of its own. What it leaves is to take less than a minute on two cores.
SLOW_FOLDERS = {
    "attacks",
    "bad_input",
    "bus",
    "ci",
    "clients",
    "foreign_controller",
    "foreign_plant",
    "missions",
    "off_host",
    "paper",
    "process",
    "replay",
    "scripts",
    "tools",
    "view",
    "wheel",
}


LEFT_OUT = "slow", "computes"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--quick", action="store_true", help="leave out what is slow")


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile first what all workers would otherwise compile at once."""
    workers = getattr(session.config.option, "numprocesses", None)  # not of a worker
    if not workers:
        return
    from fcu.kernel.compile import is_cached

    if not all(map(is_cached, ("together", "tick_at", "burst.serve"))):
        fly = [sys.executable, "-m", "gcs_tools", "fly", "paper_nominal"]
        with tempfile.TemporaryDirectory() as folder:
            for n, how in enumerate((["--in-process"], [])):
                short = ["--set", "flight.duration_s=0.1", "--out", f"{folder}/{n}", *how]
                subprocess.run([*fly, *short], stdout=subprocess.DEVNULL, check=False)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect tests without looking for garbage, which is half of the time, nor among them later."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.fixture(scope="session", autouse=True)
def _quick_tests_start_no_process(request: pytest.FixtureRequest) -> Iterator[None]:
    """With `--quick` a test that starts a process fails: it is to be marked `slow`."""

    def refused(*_words: object, **_options: object) -> None:
        raise AssertionError("a quick test starts a process: mark it slow")

    with pytest.MonkeyPatch.context() as patch:
        if request.config.getoption("quick"):
            patch.setattr(subprocess.Popen, "__init__", refused)
            patch.setattr(os, "fork", refused)
        yield


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    here = Path(__file__).parent
    slow = collection_path.parent == here and collection_path.name in SLOW_FOLDERS
    return True if slow and config.getoption("quick") else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("quick"):
        left_out = [item for item in items if any(map(item.get_closest_marker, LEFT_OUT))]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if not any(map(item.get_closest_marker, LEFT_OUT))]
    items[:] = _dealt(items, getattr(config, "workerinput", {}).get("workercount", 1))


def _dealt(items: list[pytest.Item], workers: int) -> list[pytest.Item]:
    """Deal the slow files to the workers in turn, and fill each one's share with the others.

    A worker begins with an equal part of all tests: if what is slow comes first in it, what is left
    at the end, when one takes tests over from another, is short.
    """

    def is_slow(path: Path) -> bool:
        return path.relative_to(Path(__file__).parent).parts[0] in SLOW_FOLDERS

    slow = [path for path in dict.fromkeys(item.path for item in items) if is_slow(path)]
    among = set(slow)
    quick = [item for item in items if item.path not in among]
    dealt: list[pytest.Item] = []
    for n in range(workers):
        own = set(slow[n::workers])
        dealt += [item for item in items if item.path in own]
        room = max((n + 1) * len(items) // workers - len(dealt), 0)
        dealt, quick = dealt + quick[:room], quick[room:]
    return dealt + quick
