"""Real processes on real sockets: started, watched from outside, and never left behind."""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from fcu.interface.link import UdpLink
from fcu.interface.ports import INSTANCES, busy, ports
from tests.patience import PATIENCE_S, until
from tests.process.script import Script

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # begun by a shell in the background:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # programs would not hear Ctrl-C


def alive(pid: int) -> bool:
    """Whether a process runs (one that only waits to be reaped does not)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        assert Path("/proc/self").exists(), "asks Linux's /proc, which is not here"
        return False


_PDEATHSIG = 1  # linux/prctl.h
_libc = ctypes.CDLL(None)


def start_process(
    words: Sequence[Any], preexec_fn: Callable[[], None] = lambda: None, **options: Any
) -> subprocess.Popen[Any]:
    """Start a process that is killed when the thread that starts it ends, however that ends (on Linux)."""

    def first() -> None:
        if sys.platform == "linux":
            _libc.prctl(_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        preexec_fn()

    return subprocess.Popen([*map(str, words)], preexec_fn=first, **options)


class Program:
    """One of the project's programs, its output on file."""

    def __init__(self, folder: Path, module: str, *arguments: str, **options: Any) -> None:
        self.folder = folder
        self.out, self.err = folder / f"{module}.out", folder / f"{module}.err"
        with self.out.open("wb") as out, self.err.open("wb") as err:
            self.process = start_process(
                [sys.executable, "-X", "faulthandler", "-m", module, *arguments],
                cwd=folder, **{"stdin": subprocess.DEVNULL, "stdout": out, "stderr": err, **options},
            )  # fmt: skip

    @property
    def pid(self) -> int:
        return self.process.pid

    def children(self) -> dict[str, int]:
        """Pid by module of the processes that it has started, as copies of itself or anew."""
        found = {}
        for entry in Path("/proc").iterdir():
            try:
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
                name = (entry / "comm").read_text().strip()
                words = (entry / "cmdline").read_bytes().split(b"\0")
            except (OSError, IndexError, ValueError):
                continue
            if parent != self.pid:
                continue
            if name in ("fcu", "sitl_plant", "gcs_tools"):
                found[name] = int(entry.name)
            elif words != self._words and b"-m" in words:
                found[words[words.index(b"-m") + 1].decode()] = int(entry.name)
        return found

    @property
    def _words(self) -> list[bytes]:
        """Its own command line: that of a copy too, which is yet to be given its name."""
        return Path(f"/proc/{self.pid}/cmdline").read_bytes().split(b"\0")

    def started(self) -> dict[str, int]:
        """Pids of both processes, once it has started them."""
        both = {"fcu", "sitl_plant"}  # a child that is yet to become one looks like its parent
        return until(lambda: (c := self.children()).keys() >= both and c, "two processes")

    def text(self) -> str:
        """What it has said: standard output, then standard error."""
        return self.out.read_text() + self.err.read_text()

    def says(self, text: str) -> str:
        """Wait until it has said something that holds `text`."""

        def heard() -> str:
            said = self.text()
            assert text in said or self.process.poll() is None, said
            return said if text in said else ""

        return until(heard, text)

    def logged(self, level: str, *parts: str) -> bool:
        """Whether a line that it logged at this level holds all of the parts."""
        lines = [line for line in self.text().splitlines() if level in line.split()[:3]]
        return any(all(part in line for part in parts) for line in lines)

    def signal(self, number: int) -> None:
        self.process.send_signal(number)

    def wait(self) -> int:
        """Its exit code, when it has ended; of one that hangs, what it said and where it is."""
        try:
            return self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.signal(signal.SIGABRT)  # its threads tell where they are, see faulthandler
            self.process.wait()
            raise AssertionError(f"{self.process.args} hangs:\n{self.text()}") from None

    def interrupted(self) -> int:
        """Its exit code after a Ctrl-C."""
        self.signal(signal.SIGINT)
        return self.wait()

    def kill(self) -> None:
        children = self.children().values()
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        for pid in children:
            if alive(pid):
                os.kill(pid, signal.SIGKILL)


@pytest.fixture
def start(tmp_path):
    """`start("fcu", "--instance", 3)`: a program that is gone when the test is over."""
    programs: list[Program] = []

    def program(module: str, *arguments: Any, **options: Any) -> Program:
        folder = tmp_path / f"{len(programs)}-{module}"
        folder.mkdir()
        programs.append(Program(folder, module, *arguments, **options))
        return programs[-1]

    yield program
    for each in programs:
        each.kill()


@pytest.fixture
def fly(start, tmp_path):
    """`fly("paper_nominal", ...)`: a flight whose run is in tmp_path / "run"."""

    def flight(*arguments: Any, **options: Any) -> Program:
        return start("gcs_tools", "fly", "--out", tmp_path / "run", *arguments, **options)

    return flight


@contextmanager
def claimed_instance():
    """An instance of a test's own: from the far end, so that `gcs fly` finds others.

    Tests that run at the same time tell each other by a TCP port, which nobody else binds.
    """
    for number in reversed(range(INSTANCES)):
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as claim:
            try:
                claim.bind(("127.0.0.1", ports(number).plant))
            except OSError:
                continue
            if not busy(
                number, "plant", "fcu_plant", "fcu_script", "script", "fcu_station", "fcu_tcp"
            ):
                yield number
                return
    pytest.fail("every instance has a port in use")


@pytest.fixture
def instance():
    """An instance of this test's own."""
    with claimed_instance() as number:
        yield number


@pytest.fixture
def bound(instance):
    """`bound("plant", "fcu_plant")`: the socket of one side of a link, its peer another's."""
    links: list[UdpLink] = []

    def link(mine: str, peer: str) -> UdpLink:
        at = ports(instance)._asdict()
        links.append(UdpLink(at[mine], at[peer]))
        return links[-1]

    yield link
    for each in links:
        each.close()


@pytest.fixture(name="until")
def _until():
    return until


@pytest.fixture(name="alive")
def _alive():
    return alive


@pytest.fixture
def script(instance):
    one = Script(instance)
    yield one
    one.close()


@pytest.fixture
def gone(until, alive):
    def check(pids):
        until(lambda: not any(map(alive, pids.values())), "no orphan")

    return check


SPIN = "import os, sys; os.sched_setaffinity(0, {int(sys.argv[1])})\nwhile True: pass"


@pytest.fixture
def busy_neighbours():
    """A process on each core that never rests."""
    cores = os.sched_getaffinity(0)
    spinning = [start_process([sys.executable, "-c", SPIN, core]) for core in cores]
    yield
    for process in spinning:
        process.kill()
        process.wait()
