"""Runs tests on a copy of the project: once to see what each test executes, then on each mutant.

Every run is a process forked from one that has numpy, numba, scipy and pytest imported already. The
copy is in a temporary folder, so a run that is killed leaves no changed file behind.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

from tests.mutation import plain

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("fcu", "sitl_plant", "gcs_tools")
LEFT_OUT = shutil.ignore_patterns(".*", "__pycache__", "node_modules", "runs", "dist")
TEST_S = 5.0  # of the processor's time: an uncompiled test that takes longer is left out
COMPILED_S = 40.0  # the same where compiled: it may compile
FILE_S = 40.0  # the same for a file: tests after that are left out
SPARE_S = 20.0  # on top of twice what the unchanged tests took
WALL_S = 240.0  # of a mutant that waits
MEMORY = 6 << 30


class TooSlow(BaseException):
    """A test that takes too long uncompiled."""


class Run(NamedTuple):
    """The report of a process that ran tests."""

    result: dict[str, Any]
    ended: str  # "" if it ended by itself, else "timeout" or the signal
    took_s: float


def preload() -> None:
    """Import what every run needs and none changes."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    import numba  # noqa: F401
    import pydantic  # noqa: F401
    import pytest  # noqa: F401
    import scipy.linalg
    import scipy.optimize
    import scipy.stats  # noqa: F401


class Copy:
    """A copy of the project, whose tests are run, and whose files are changed for a run."""

    def __init__(self, folder: Path, uncompiled: bool, of: Path = ROOT) -> None:
        self.folder = folder
        self.uncompiled = uncompiled
        shutil.copytree(of, folder, ignore=LEFT_OUT, symlinks=True)
        if uncompiled and of is ROOT:
            for package in PACKAGES:
                for path in sorted((folder / package).rglob("*.py")):
                    self.change(path.relative_to(folder).as_posix(), path.read_bytes())

    def change(self, path: str, content: bytes) -> None:
        """Write a file, and have Python compile it anew."""
        file = self.folder / path
        file.write_bytes(plain.prepared(path, content) if self.uncompiled else content)
        for cached in (file.parent / "__pycache__").glob(f"{file.stem}.*.pyc"):
            cached.unlink()

    def enter(self, log: Path) -> None:
        """Have this process import the copy, and write what it prints to a file."""
        os.chdir(self.folder)
        sys.path[:] = [str(self.folder), *(p for p in sys.path if p not in ("", str(ROOT)))]
        for name in [n for n in sys.modules if n.partition(".")[0] in (*PACKAGES, "tests")]:
            del sys.modules[name]
        os.environ["PYTHONPATH"] = str(self.folder)
        if self.uncompiled:
            plain.install()
        out = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        os.dup2(out, 1)
        os.dup2(out, 2)


class Place(NamedTuple):
    """Two copies of the project, for one run at a time."""

    plain: Copy  # kernels are uncompiled
    compiled: Copy
    cache: Path  # of compiled code, where that itself is changed


def places(folder: Path, count: int) -> list[Place]:
    """So many pairs of copies, all of one state of the project."""
    plain, compiled = Copy(folder / "plain0", True), Copy(folder / "compiled0", False)
    made = [Place(plain, compiled, folder / "cache")]
    for n in range(1, count):
        made.append(Place(
            Copy(folder / f"plain{n}", True, plain.folder),
            Copy(folder / f"compiled{n}", False, compiled.folder), folder / "cache",
        ))  # fmt: skip
    return made


class Job(NamedTuple):
    """Something to do in a process of its own, with a copy of the project."""

    name: str
    compiled: bool
    work: Callable[[Copy, Path], None]  # writes its result, a JSON file
    cpu_s: float
    path: str = ""  # of the file that is changed
    content: bytes = b""
    original: bytes = b""


def run_all(jobs: Sequence[Job], at: Sequence[Place]) -> Iterator[tuple[Job, Run]]:
    """Do every job, one in each place at a time. The results come as the jobs end."""
    free, folder = list(at), at[0].cache.parent
    todo, running = list(reversed(jobs)), dict[int, tuple[Job, Place, Path, float]]()
    try:
        while todo or running:
            while todo and free:
                job, place = todo.pop(), free.pop()
                copy = place.compiled if job.compiled else place.plain
                result = Path(tempfile.mkdtemp(dir=folder)) / "result.json"
                if job.path:
                    copy.change(job.path, job.content)
                pid = _forked(job, place, copy, result)
                running[pid] = (job, place, result, time.monotonic())
            time.sleep(0.02)
            for pid in list(running):
                job, place, result, began = running[pid]
                done, status = os.waitpid(pid, os.WNOHANG)
                took = time.monotonic() - began
                if not done and took > WALL_S + 4.0 * job.cpu_s:
                    os.killpg(pid, signal.SIGKILL)
                    done, status = os.waitpid(pid, 0)
                if done:
                    del running[pid]
                    free.append(place)
                    if job.path:
                        copy = place.compiled if job.compiled else place.plain
                        copy.change(job.path, job.original)
                    yield job, Run(_read(result), _ended(status), took)
    finally:
        for pid in running:
            os.killpg(pid, signal.SIGKILL)
            os.waitpid(pid, 0)


def _forked(job: Job, place: Place, copy: Copy, result: Path) -> int:
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid:
        return pid
    code = 1
    try:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (int(job.cpu_s) + 1, int(job.cpu_s) + 5))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        if job.path and job.compiled and is_compiled_code(job.path, job.original):
            os.environ["XDG_CACHE_HOME"] = str(place.cache)
        copy.enter(result.with_name("log"))
        job.work(copy, result)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return pid


def _read(result: Path) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads(result.read_text())
    except (OSError, ValueError):
        found = {}
    log = result.with_name("log")
    if "log" not in found and log.exists():
        found["log"] = log.read_text(errors="replace")[-2000:]
    shutil.rmtree(result.parent, ignore_errors=True)
    return found


def is_compiled_code(path: str, source: bytes) -> bool:
    """A file that the cache of compiled code is named by (`fcu.kernel.compile`)."""
    values = b"fcu.kernel" in source and (b"@kernel" in source or b"NamedTuple" in source)
    return values or path.startswith("fcu/kernel/")


def _ended(status: int) -> str:
    if not os.WIFSIGNALED(status):
        return ""
    number = os.WTERMSIG(status)
    return "timeout" if number in (signal.SIGKILL, signal.SIGXCPU) else signal.Signals(number).name


# --- what pytest is given


class Limited:
    """Gives every test a limit of the processor's time, and keeps how long each took."""

    def __init__(self, test_s: float) -> None:
        self.test_s = test_s
        self.took: dict[str, float] = {}
        self.outcome: dict[str, str] = {}
        self.began = time.process_time()

    def alarm(self, number: int, frame: FrameType | None) -> None:
        """End a test, but not while its coverage is kept: that would never give back its lock."""
        while frame is not None:
            if Path(frame.f_code.co_filename).parent.name == "coverage":
                signal.setitimer(signal.ITIMER_VIRTUAL, 0.01)
                return
            frame = frame.f_back
        raise TooSlow

    def pytest_runtest_logreport(self, report: Any) -> None:
        before = self.outcome.get(report.nodeid, "passed")
        self.outcome[report.nodeid] = before if report.outcome == "passed" else report.outcome

    def pytest_runtest_protocol(self, item: Any, nextitem: Any) -> Any:
        from _pytest.runner import runtestprotocol

        if time.process_time() - self.began > max(FILE_S, 3.0 * self.test_s):
            self.outcome[item.nodeid] = "late"
            return True
        self.start(item.nodeid)
        began = time.process_time()
        signal.signal(signal.SIGVTALRM, self.alarm)
        signal.setitimer(signal.ITIMER_VIRTUAL, self.test_s)
        try:
            runtestprotocol(item, nextitem=nextitem)
        except TooSlow:  # between two of its steps
            self.outcome[item.nodeid] = "failed"
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        self.took[item.nodeid] = round(time.process_time() - began, 3)
        return True

    def start(self, name: str) -> None:
        """Before a test."""


class Chosen:
    """Runs the tests that are named, in this order, and keeps the name of the first that fails."""

    def __init__(self, names: Sequence[str]) -> None:
        self.order = {name: n for n, name in enumerate(names)}
        self.failed: str | None = None
        self.ran = 0

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        wanted = [
            item
            for item in items
            if self.order.keys() & {item.nodeid, item.nodeid.partition("::")[0]}
        ]
        items[:] = sorted(wanted, key=lambda item: self.order.get(item.nodeid, 0))

    def pytest_runtest_logreport(self, report: Any) -> None:
        self.ran += report.when == "call"
        if report.failed and self.failed is None:
            self.failed = report.nodeid

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed and self.failed is None:
            self.failed = report.nodeid


def pytest_run(files: Sequence[str], *plugins: object) -> int:
    """Run pytest here, without its cache."""
    import pytest

    options = ["-q", "-m", "not slow", "-p", "no:cacheprovider", "-p", "no:xdist"]
    return int(pytest.main([*options, *files], plugins=list(plugins)))


def seen_of(file: str) -> Callable[[Copy, Path], None]:
    """Run the tests of a file with coverage: outcome, time and lines of each."""

    def work(copy: Copy, result: Path) -> None:
        import coverage

        data = result.with_name("coverage")
        source = [str(copy.folder / name) for name in PACKAGES]
        seen = coverage.Coverage(
            data_file=str(data), branch=True, source=source, config_file=False, messages=False
        )
        limited = Limited(TEST_S if copy.uncompiled else COMPILED_S)
        limited.start = seen.switch_context  # type: ignore[method-assign]
        seen.start()
        code = pytest_run([file], limited)
        seen.stop()
        seen.save()
        found = seen.get_data()
        lines: dict[str, dict[str, list[int]]] = {}
        arcs: dict[str, list[list[int]]] = {}
        for path in found.measured_files():
            name = Path(path).relative_to(copy.folder).as_posix()
            by_test: dict[str, list[int]] = {}
            for line, tests in found.contexts_by_lineno(path).items():
                for test in tests:
                    by_test.setdefault(test, []).append(line)
            lines[name] = by_test
            arcs[name] = [list(arc) for arc in found.arcs(path) or ()]
        result.write_text(json.dumps({
            "code": code, "took": limited.took, "outcome": limited.outcome, "lines": lines, "arcs": arcs,
        }))  # fmt: skip

    return work


def first_failure(tests: Sequence[str]) -> Callable[[Copy, Path], None]:
    """Run tests until one fails."""

    def work(copy: Copy, result: Path) -> None:
        sys.dont_write_bytecode = True
        chosen = Chosen(tests)
        files = list(dict.fromkeys(name.partition("::")[0] for name in tests))
        code = pytest_run(["-x", *files], chosen)
        result.write_text(json.dumps({"code": code, "killer": chosen.failed, "ran": chosen.ran}))

    return work
