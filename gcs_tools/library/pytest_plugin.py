"""A plugin for pytest: missions are tests, and a fixture starts a vehicle to talk to.

It costs nothing where it is not used: everything is imported by who needs it. docs/python.md describes it.
"""

from __future__ import annotations

import fnmatch
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

MISSIONS, COMMANDS = "mmrac_missions", "--mmrac-allow-commands"
READY_S = 180.0  # wall: for a vehicle to be ready, which may compile first
GONE_S = 15.0  # wall: for it to end
_READY = re.compile(r"ready: instance (\d+), MAVLink system (\d+)")
_LOGS = re.compile(r"^ +logs +(.+)$", re.MULTILINE)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare the options."""
    parser.addini(MISSIONS, "patterns of mission files that are tests", type="args", default=[])
    parser.getgroup("m-mrac").addoption(
        COMMANDS, action="store_true", help="fly missions that run a command of their own"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Declare the mark."""
    config.addinivalue_line(
        "markers",
        "vehicle(mission=None, speed=1): the mission whose start, wind and airframe the fixture"
        " `vehicle` has, and simulated seconds per second",
    )


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect a mission file that is named on the command line or by the configuration."""
    if file_path.suffix != ".toml":
        return None
    config = parent.config
    named = any(Path(arg.split("::")[0]).resolve() == file_path for arg in config.args)
    root = config.rootpath
    inside = file_path.relative_to(root).as_posix() if file_path.is_relative_to(root) else ""
    if named or any(fnmatch.fnmatch(inside, each) for each in config.getini(MISSIONS)):
        made: pytest.Collector = MissionFile.from_parent(parent, path=file_path)
        return made
    return None


class MissionFile(pytest.File):
    """A mission file. It has one test, which is called as the mission."""

    def collect(self) -> Iterator[pytest.Item]:
        """Its test."""
        yield MissionTest.from_parent(self, name=self.path.stem)


class MissionMissed(Exception):
    """A mission that was flown, and is not as expected."""


class MissionTest(pytest.Item):
    """A mission, flown and judged."""

    def runtest(self) -> None:
        """Fly it. Raises MissionMissed, and UsageError for one that cannot be flown."""
        from gcs_tools.flight.run import fly
        from gcs_tools.missions.mission import load

        commands = bool(self.config.getoption(COMMANDS))
        by_script = commands and load(str(self.path)).flight.script is not None
        with self._folder() as folder:
            result = fly(
                str(self.path), in_process=not by_script, out=folder, record="light", figure="failed",
                allow_commands=commands, overwrite=True,
            )  # fmt: skip
        if result.passed:
            return
        missed = [f"[expect] {each}" for each in result.expectations if each.is_missed]
        told = [result.title, *([result.error] if result.error else []), *missed, *result.causes]
        told += [f"log, recording and figure: {folder}"] * (self._cache() is not None)
        raise MissionMissed("\n".join(told))

    def _folder(self) -> AbstractContextManager[Path]:
        """A folder for log, recording and figure: in pytest's cache until the next run, if that keeps one."""
        cache = self._cache()
        if cache is None:
            return _passing()
        name = re.sub(r"[^\w.-]+", "-", self.nodeid)
        return nullcontext(cache.mkdir("m-mrac") / name)

    def _cache(self) -> pytest.Cache | None:
        """The cache of pytest. None where its plugin is turned off."""
        return getattr(self.config, "cache", None)

    def repr_failure(self, excinfo: Any, style: Any = None) -> Any:
        """The sentences of a flight that missed. Of anything else a traceback."""
        from gcs_tools.flight.run_folder import UsageError

        if isinstance(excinfo.value, MissionMissed | UsageError):
            return str(excinfo.value).replace(" --allow-commands ", f" {COMMANDS} ")
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Its place in reports."""
        return self.path, None, f"mission: {self.name}"


@contextmanager
def _passing() -> Iterator[Path]:
    """A folder that is removed behind the block."""
    from tempfile import TemporaryDirectory

    with TemporaryDirectory(prefix="m-mrac-") as folder:
        yield Path(folder)


@dataclass(frozen=True)
class Vehicle:
    """A vehicle that is up."""

    instance: int
    system_id: int  # of MAVLink
    port: int  # of the script link, UDP on loopback
    folder: Path  # with the logs of both processes
    process: subprocess.Popen[str]

    @property
    def url(self) -> str:
        """The script link, as pymavlink takes it."""
        return f"udpin:127.0.0.1:{self.port}"

    @property
    def mavsdk_url(self) -> str:
        """The script link, as MAVSDK takes it."""
        return f"udpin://127.0.0.1:{self.port}"

    def alive(self) -> bool:
        """True while it runs."""
        return self.process.poll() is None


@pytest.fixture
def vehicle(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Vehicle]:
    """A vehicle on a free instance, which ends with the test, and with pytest however that ends."""
    from fcu.interface.ports import ports

    mark = request.node.get_closest_marker("vehicle")
    asked = {"mission": None, "speed": 1, **(mark.kwargs if mark is not None else {})}
    if mark is not None and mark.args:
        raise pytest.UsageError(
            f"vehicle({', '.join(map(repr, mark.args))}): name it, vehicle(mission={mark.args[0]!r})"
        )
    if unknown := asked.keys() - {"mission", "speed"}:
        raise pytest.UsageError(f"vehicle({', '.join(unknown)}=...): expected mission or speed")
    words = [str(asked["mission"])] if asked["mission"] is not None else []
    words += ["--speed", str(asked["speed"]), "--until-eof"]
    with (tmp_path / "vehicle.log").open("w+") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "gcs_tools", "up", *words], cwd=tmp_path, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, start_new_session=True,
        )  # fmt: skip
        try:
            said = _until_ready(process)
            ready, logs = _READY.search(said), _LOGS.search(said)
            if ready is None or logs is None:
                log.seek(0)
                pytest.fail(f"no vehicle: {log.read().strip() or said}", pytrace=False)
            instance = int(ready[1])
            folder = tmp_path / logs[1].strip()
            yield Vehicle(instance, int(ready[2]), ports(instance).script, folder, process)
        finally:
            assert process.stdin is not None
            assert process.stdout is not None
            process.stdin.close()
            try:
                process.wait(GONE_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            process.stdout.close()


def _until_ready(process: subprocess.Popen[str]) -> str:
    """Everything that `gcs up` has said when it is ready, has ended, or the time is over."""
    import threading

    said: list[str] = []
    is_told = threading.Event()

    def read() -> None:
        assert process.stdout is not None
        for line in process.stdout:
            said.append(line)
            if _LOGS.search(line):
                is_told.set()
        is_told.set()

    threading.Thread(target=read, daemon=True).start()
    is_told.wait(READY_S)
    return "".join(said)
