"""The processes of a flight: started, watched, stopped again whatever happens; their instance."""

from __future__ import annotations

import json
import os
import queue
import re
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np

from fcu.interface import event_log
from fcu.interface.event_log import Event
from fcu.interface.link import HOST, PortBusy
from fcu.interface.ports import INSTANCES, NoFreeInstance, busy, ports
from gcs_tools.exit_codes import USAGE
from gcs_tools.flight.forking import Forked, can_fork, fork_program

PORTS = (
    "plant",
    "fcu_plant",
    "fcu_script",
    "fcu_station",
    "script",
    "fcu_tcp",
)  # that a flight binds
_ESCAPES = re.compile(r"\x1b\[[0-9;?]*[ -/]*[@-~]")  # of a terminal's colours
WROTE_NOTHING = "it wrote nothing"  # a process that has ended
LAST_BYTES = 1 << 16  # of a log, that may hold its last words
HANGS_S = 8.0  # wall: after that a process that neither works nor is ready is given up
SUSPENDED = "is stopped (SIGSTOP): continue it, or start again"
COMPILED_S = 600.0  # wall: for one that works all the time
LOOK_S = 0.25  # wall: between two looks at whether a process works, or is suspended
HURRY_S = 0.2  # wall: how long at most nothing is recorded while time stands
BEHIND = 32  # batches that may wait to be recorded
AT_A_TIME = 64  # rows that are recorded without looking whether somebody is in a hurry
AFTER_OTHERS = 5  # added to the nice value of who records
TURN_S = 1e-4  # wall: how long a thread of the runner keeps another from running
STOP_S = 1.0  # wall: after that a process is ended that was asked to end, and does nothing
STOPPED_S = 10.0  # wall: and one that works all the time
BUSY_S, BUSY_PART = 0.5, 0.05  # wall: a process above this CPU share is busy

Rows = np.ndarray[Any, np.dtype[np.float64]]
Take = Callable[[Rows], None]


class Keeper(Protocol):
    """Who keeps rows: FlownRows, or what stands before one."""

    def append(self, rows: Rows, /) -> None:
        """Keep some more, (k, n)."""


class InfrastructureError(RuntimeError):
    """A process died or stalled, or a port was busy: which one, in words."""


class Misused(InfrastructureError):
    """A process does not take what it was started with: what it said."""


class Unanswered(InfrastructureError):
    """The plant has ended because the flight controller was silent."""


class FlightEnded(InfrastructureError):
    """The vehicle hit the ground or was lost, and the plant has ended: what became of it, when."""


def _stat(pid: int) -> list[str]:
    """What Linux tells of a process from its state on; nothing elsewhere, and of one that is gone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []


def _worked_s(pid: int) -> float:
    """Processor time (s) that a process and its children have used, 0 where Linux does not tell."""
    stats = [stat[11:13] for stat in map(_stat, _family(pid)) if stat]
    return sum(int(n) for times in stats for n in times) / os.sysconf("SC_CLK_TCK")


def _is_kept(pid: int) -> bool:
    """Tell if a process or a child of it works, or waits for a processor or a disk."""
    return any(_stat(each)[:1] in (["R"], ["D"]) for each in _family(pid))


def _family(pid: int) -> list[int]:
    """A process and its children, as far as Linux tells. A child may compile for its parent."""
    try:
        return [pid, *map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split())]
    except OSError:
        return [pid]


def is_stopped(pid: int) -> bool:
    """Whether a signal or a debugger has stopped it (SIGSTOP)."""
    return _stat(pid)[:1] in (["T"], ["t"])


def printable(text: str) -> str:
    """A text without colours and control characters, which no terminal and no XML should be given."""
    return "".join(c for c in _ESCAPES.sub("", text) if c.isprintable())


class Child:
    """One process: its log in a file, its JSON lines on standard output."""

    def __init__(
        self, name: str, module: str, arguments: Sequence[str], log: Path, fds: Sequence[int],
        forks: bool = False, tells: bool = False,
    ) -> None:  # fmt: skip
        """`fds`: file descriptors it inherits. They are closed on our side.

        `forks`: it begins from what is loaded here, if this process can be forked. `tells`: it is one
        of ours, which writes its events to a file beside its log.
        """
        self.name = name
        self._log_path = log
        self._log: IO[bytes] = log.open("wb")
        self._events = event_log.beside(log) if tells else None
        if self._events is not None:
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND
            events = os.open(self._events, flags, 0o666)
            arguments, fds = [*arguments, "--events-fd", str(events)], (*fds, events)
        self._lines: queue.Queue[dict[str, Any]] = queue.Queue()
        self._said: dict[str, Any] = {}  # last of itself
        self._is_ready = False
        self._began_s = self._idle_since_s = 0.0  # wall: when it was first waited for, last worked
        self._worked_s = 0.0
        self._stopped_since_s: float | None = None  # wall
        self._look_again_s = 0.0  # wall: whether it is stopped
        out, said = os.pipe()
        self._out = os.fdopen(out, "rb")
        try:
            self.process: Forked | subprocess.Popen[bytes] = (
                fork_program(module, arguments, said, self._log.fileno(), fds)
                if forks and can_fork()
                else _started(module, arguments, said, self._log, fds)
            )
        finally:
            for fd in (said, *fds):
                os.close(fd)
        self._reader = threading.Thread(target=self._read, daemon=True)

    def listen(self) -> None:
        """Hear what it says; from then on a thread runs here, and nothing can be forked."""
        if self._reader.ident is None:
            self._reader.start()

    def _read(self) -> None:
        for line in self._out:
            try:
                told = json.loads(line)
            except ValueError:
                continue
            if isinstance(told, dict):  # a law may print what it likes
                self._lines.put(told)

    def wait_ready(self, check: Callable[[], None]) -> None:
        """Until it says that it is. Raises InfrastructureError. `check` is called meanwhile."""
        while not self.is_ready(LOOK_S):
            check()

    def is_ready(self, timeout_s: float = 0.0) -> bool:
        """Whether it has said so, within that time. Raises InfrastructureError if it will not.

        What it compiles may take long on a busy machine: who works is waited for. Where Linux does
        not tell who does, each is.
        """
        self.listen()
        with suppress(queue.Empty):
            while not self._is_ready:
                self._is_ready = "ready" in self._lines.get(timeout_s > 0.0, timeout_s)
        if self._is_ready:
            return True
        pid, now, worked = self.process.pid, time.monotonic(), _worked_s(self.process.pid)
        self._began_s = self._began_s or now
        works = (worked > self._worked_s or _is_kept(pid)) and not is_stopped(pid)
        if works or not self._idle_since_s:
            self._worked_s, self._idle_since_s = worked, now
        idle, waited = now - self._idle_since_s, now - self._began_s
        hangs = idle >= HANGS_S and bool(_stat(pid))
        if not hangs and waited < COMPILED_S:
            return False
        why = f"did nothing for {idle:.0f} s" if hangs else "still works"
        if is_stopped(pid):
            why = SUSPENDED
        raise InfrastructureError(f"the {self.name} was not ready within {waited:.0f} s: it {why}")

    def check(self) -> None:
        """Raise InfrastructureError if it has ended, FlightEnded if its flight had, Unanswered."""
        code = self.process.poll()
        if code is not None:
            if code == -signal.SIGKILL:  # it had no time for last words
                raise InfrastructureError(f"the {self.name} was killed by signal {-code}")
            if code == USAGE:  # it was handed on what a person typed
                raise Misused(self.last_words().removeprefix("Error: "))
            said = self._last_said()
            if said.get("flight_ended"):
                ending, at_s = said["flight_ended"], said["time_s"]
                raise FlightEnded(f"the vehicle {ending} at {at_s:.1f} s")
            if said.get("law_raised"):
                raise InfrastructureError(f"the {self.name} ended: {said['law_raised']}")
            how = f"was ended by signal {-code}" if code < 0 else f"ended with exit code {code}"
            kind = Unanswered if said.get("unanswered") else InfrastructureError
            raise kind(f"the {self.name} {how}: {self.last_words()}")

    def check_suspended(self) -> None:
        """Raise InfrastructureError if it has been so for HANGS_S, as far as anybody has looked."""
        now = time.monotonic()
        if now < self._look_again_s:  # a look costs as much as a setpoint
            return
        self._look_again_s = now + LOOK_S
        if not is_stopped(self.process.pid):
            self._stopped_since_s = None
        elif self._stopped_since_s is None:
            self._stopped_since_s = now
        elif now - self._stopped_since_s > HANGS_S:
            raise InfrastructureError(f"the {self.name} {SUSPENDED}")

    def is_computing(self) -> bool:
        """Whether it lives and works now, and does not wait for anybody."""
        worked, until = _worked_s(self.process.pid), time.monotonic() + BUSY_S
        while self.process.poll() is None and time.monotonic() < until:
            time.sleep(LOOK_S)
            if _worked_s(self.process.pid) - worked >= BUSY_PART * BUSY_S:
                return self.process.poll() is None
        return False

    def last_error(self) -> Event | None:
        """The last error that it told. None if it told none, or is none of ours."""
        if self._events is None or not self._events.is_file():  # a FIFO of a script's, for one
            return None
        told = event_log.read(self._events)
        errors = [event for event in told if event.level == "error"]
        return errors[-1] if errors else None

    def last_words(self) -> str:
        """The last error that it told, or the last line of its log."""
        if error := self.last_error():
            return " ".join(event_log.line(error).split())
        lines: list[str] = []
        with suppress(OSError):
            if self._log_path.is_file():
                with self._log_path.open("rb") as log:
                    log.seek(max(0, self._log_path.stat().st_size - LAST_BYTES))
                    lines = log.read().decode(errors="replace").strip().splitlines()
        return printable(" ".join((lines or [WROTE_NOTHING])[-1].split()))

    def ask_to_stop(self) -> None:
        """Tell it to end, also if it is suspended; `stop` waits for it."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            self.process.send_signal(signal.SIGCONT)

    def stop(self) -> dict[str, Any]:
        """End it, kindly and then not; returns what it said last of itself.

        On a busy machine its last words may take long: who works is waited for.
        """
        self.ask_to_stop()
        began = idle_since = time.monotonic()
        worked = _worked_s(self.process.pid)
        while self.process.poll() is None:
            try:
                self.process.wait(LOOK_S)
                break
            except subprocess.TimeoutExpired:
                pass
            now = time.monotonic()
            if (so_far := _worked_s(self.process.pid)) > worked:
                worked, idle_since = so_far, now
            if now - idle_since > STOP_S or now - began > STOPPED_S:
                self.process.kill()
                self.process.wait()
        said = self._last_said()
        self._log.close()
        if not self._reader.is_alive():
            self._out.close()
        return said

    def heard(self) -> list[dict[str, Any]]:
        """What it has said since it was ready, or since the last call."""
        said = []
        while not self._lines.empty():
            line = self._lines.get_nowait()
            if "ended" in line:
                self._said = line
            else:
                said.append(line)
        return said

    def _last_said(self) -> dict[str, Any]:
        """What a process that has ended said last of itself."""
        self.listen()
        self._reader.join(STOP_S)
        self.heard()
        return self._said


def _started(
    module: str, arguments: Sequence[str], out: int, log: IO[bytes], fds: Sequence[int]
) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=out,
        stderr=log,
        pass_fds=fds,
        start_new_session=True,  # a Ctrl-C at our terminal is ours to handle
    )


def stop_all(children: Sequence[Child]) -> dict[str, dict[str, Any]]:
    """End them together; returns what each said last, by name."""
    for child in children:
        child.ask_to_stop()
    return {child.name: child.stop() for child in children}


class Started(Protocol):
    """The processes of a vehicle."""

    children: list[Child]  # controller, plant

    def check(self) -> None:
        """Raise InfrastructureError if one of them has ended."""

    def stop(self) -> dict[str, dict[str, Any]]:
        """Stop them; returns what each said last, by name."""


@contextmanager
def one_core(core: int, children: Sequence[Child], collector: Collector) -> Iterator[None]:
    """The children and the calling thread on one core, the collector on the others; where it can be.

    Those who take turns wake one another without crossing cores, which costs far more than a
    turn. Children stay where they are put.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    allowed = os.sched_getaffinity(0)
    with suppress(OSError):
        collector.keep_off(core)
        for task in (0, *[child.process.pid for child in children]):
            os.sched_setaffinity(task, {core})
    interval = sys.getswitchinterval()
    sys.setswitchinterval(TURN_S)  # whoever was waited for must not wait for who records
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
        os.sched_setaffinity(0, allowed)


class Collector(threading.Thread):
    """Takes the rows of both processes from their pipes and hands them on as arrays.

    A second thread records them. It may fall behind by so many batches; then none are taken, and the
    pipes make the processes wait: in lockstep nothing is lost.
    """

    def __init__(self, sources: dict[int, tuple[int, Keeper, Take]]) -> None:
        """`sources`: file descriptor -> float64 in a row, who keeps rows, who records them.

        What is recorded has been kept, and whoever waits for it told: recording takes its time.
        """
        super().__init__(daemon=True, name="collector")
        self._sources = sources
        self._left = {fd: b"" for fd in sources}
        self.ended: set[int] = set()  # pipes that nobody writes to any more
        self.error: Exception | None = None
        self._changed = threading.Condition()
        self._done: Callable[[], bool] = lambda: False
        self._unhurried = threading.Event()  # nobody holds time: there is time to record
        self._unhurried.set()
        self._recorded = 0  # batches
        self._to_record: queue.Queue[tuple[Take, Rows] | None] = queue.Queue(BEHIND)
        self._recorder = threading.Thread(target=self._record, daemon=True, name="recorder")

    def run(self) -> None:
        """Until every pipe is closed at its other end, and all is recorded."""
        while open_fds := self._sources.keys() - self.ended:
            for fd in select.select(open_fds, (), ())[0]:
                data = os.read(fd, 1 << 20)
                if not data:
                    os.close(fd)
                    self.ended.add(fd)
                else:
                    self._take(fd, data)
            self._tell()
        self._to_record.put(None)
        self._recorder.join()

    def start(self) -> None:
        """Begin, with a thread that records."""
        self._recorder.start()
        super().start()

    def finish(self, timeout_s: float) -> None:
        """Take what processes that have ended have still handed over, and record it.

        `timeout_s`: how long nothing may be recorded; then `error` says so.
        """
        self.go_on()
        if self.ident is None:
            self.start()
        recorded = -1
        while self.is_alive() and recorded != self._recorded:
            recorded = self._recorded
            self.join(timeout_s)
        if self.is_alive() and self.error is None:
            self.error = RuntimeError(f"nothing could be recorded for {timeout_s:.0f} s")

    def keep_off(self, core: int) -> None:
        """Record on other cores, where there are any; rows are taken wherever there is room."""
        others = os.sched_getaffinity(0) - {core}
        if self._recorder.native_id is not None and others:
            os.sched_setaffinity(self._recorder.native_id, others)

    def _tell(self) -> None:
        """Wake whoever waits, but only for what is waited for."""
        with self._changed:
            if self._done():
                self._unhurried.clear()
                self._changed.notify_all()

    def _take(self, fd: int, data: bytes) -> None:
        width, kept, record = self._sources[fd]
        data = self._left[fd] + data
        n = len(data) // (8 * width)
        self._left[fd] = data[n * 8 * width :]
        rows = np.frombuffer(data, dtype="<f8", count=n * width).reshape(n, width)
        if n and self.error is None:
            kept.append(rows)
            self._tell()
            self._to_record.put((record, rows))

    def _record(self) -> None:
        if (
            sys.platform == "linux"
        ):  # where a thread has a priority of its own: the flight goes before
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), AFTER_OTHERS)
        while (job := self._to_record.get()) is not None:
            record, rows = job
            for i in range(0, len(rows), AT_A_TIME):
                self._unhurried.wait(HURRY_S)
                if self.error is not None:
                    break
                try:
                    record(rows[i : i + AT_A_TIME])
                except Exception as error:  # reported by whoever waits for rows
                    self.error = error
                    self._tell()
            self._recorded += 1

    def wait_for(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Until `done()`, at most the time; it is asked again whenever rows have come.

        Simulation time may stand until the caller waits again: so long nothing is recorded, which
        would keep it from its work.
        """
        self._unhurried.set()
        with self._changed:
            self._done = lambda: done() or self.error is not None
            came = self._changed.wait_for(self._done, timeout_s)
            self._done = lambda: False
        return came

    def go_on(self) -> None:
        """Nobody waits for rows any more, and time does not stand."""
        self._unhurried.set()


@contextmanager
def claimed(instance: int | None, *names: str) -> Iterator[int]:
    """Hold an instance whose ports are free, the first there is or the one asked for.

    `names`: which of its ports must be free, as for `busy`. Raises PortBusy for the one asked
    for, NoFreeInstance if there is none.

    A process takes a second to start. Two runners that look for a free instance in that second
    must not find the same one, so each holds a claim while its own processes run.
    """
    for number in range(INSTANCES) if instance is None else (instance,):
        try:
            claim = _claim(number)
        except PortBusy as error:
            if instance is not None:
                raise _elsewhere(error, names) from error
            continue
        with claim:
            taken = busy(number, *names)
            if not taken:
                yield number
                return
            if instance is not None:
                raise _elsewhere(taken[0], names) from None
    raise NoFreeInstance(f"instances 0 to {INSTANCES - 1} all have a port in use")


def _elsewhere(error: PortBusy, names: Sequence[str]) -> PortBusy:
    """The same error, with an instance that would do."""
    for number in range(INSTANCES):
        with suppress(PortBusy):
            _claim(number).close()
            if not busy(number, *names):
                error.strerror = f"{error.strerror} (free: --instance {number})"
                return error
    error.strerror = f"{error.strerror} (no other instance is free)"
    return error


def _claim(number: int) -> socket.socket:
    """A TCP socket bound to the plant link's number: nobody uses it, and it dies with us."""
    port = ports(number).fcu_plant
    claim = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        claim.bind((HOST, port))
    except OSError as error:
        claim.close()
        raise PortBusy(port, f"instance {number}, claimed by another runner") from error
    return claim
