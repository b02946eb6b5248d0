"""Processes that begin from what this one has loaded: imports and compiled code, by `os.fork`.

A fork copies one thread. So it is made only while no other thread runs here, and never by a process
that has Zenoh, which brings threads of its own. Elsewhere a process is started anew, and does the
same; it only takes longer to begin.
"""

from __future__ import annotations

import gc
import importlib
import math
import os
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from types import FrameType
from typing import Any

from fcu.kernel.compile import is_cached
from fcu.laws.loader import Law

Handler = Callable[[int, FrameType | None], None]

LOOK_S = 0.002  # wall: between two looks whether a process has ended
CRASHED = 1  # exit code of a process that raised, as Python's own


def can_fork() -> bool:
    """Whether this process, as it is now, may be copied."""
    return sys.platform == "linux" and threading.active_count() == 1 and "zenoh" not in sys.modules


_loaded: set[Law] = set()


def load(law: Law) -> bool:
    """Load what flight controller and plant run, from the cache, for those who are forked.

    False if not all of it is there: a process that compiles says so in its own log.
    """
    if law in _loaded:
        return True
    if not (law.is_cached() and is_cached("begin")):
        return False
    collects = gc.isenabled()
    gc.freeze()  # what they do before they fly takes no time here
    try:
        _program("fcu").load(law)
        _program("sitl_plant").load()
    finally:
        gc.unfreeze()
        if collects:
            gc.enable()
    _loaded.add(law)
    return True


def _program(module: str) -> Any:
    """What `python -m` of a module runs."""
    return importlib.import_module(f"{module}.__main__")


class Forked:
    """A process made by fork; looks like subprocess.Popen's."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Its exit code (of one ended by a signal: minus its number), or None while it runs."""
        if self.returncode is None:
            with suppress(ChildProcessError):  # somebody else has waited for it
                pid, status = os.waitpid(self.pid, os.WNOHANG)
                if pid:
                    self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout: float = math.inf) -> int:
        """Its exit code. Raises subprocess.TimeoutExpired."""
        until = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > until:
                raise subprocess.TimeoutExpired([str(self.pid)], timeout)
            time.sleep(LOOK_S)
        return code

    def send_signal(self, number: int) -> None:
        """Send it a signal, while it runs."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)


def fork_program(
    module: str, arguments: Sequence[str], out: int, log: int, fds: Sequence[int]
) -> Forked:
    """What `python -m module arguments` does, in a copy of this process; ps and top show `module`.

    out, log : file descriptors of its standard output and standard error.  fds : others it keeps.
    """

    def run() -> None:
        sys.argv = [module, *arguments]
        _program(module).main(list(arguments), prog_name=f"python -m {module}")

    return fork(run, module, fds, out, log)


def fork(
    run: Callable[[], None], name: str, fds: Sequence[int] = (), out: int = -1, err: int = -1,
    handlers: Mapping[signal.Signals, Handler] | None = None,
) -> Forked:  # fmt: skip
    """`run` in a copy of this process: a session of its own, signals as in a process just started.

    fds : the file descriptors that it keeps, beside the standard ones.  out, err : what stands for
    these; -1: ours.  handlers : of signals that it handles from its first moment on.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):  # none, or nobody reads it any more
            stream.flush()  # or the copy would write it again
    held = signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
    try:
        pid = os.fork()
        if pid:
            return Forked(pid)
        code = CRASHED
        try:  # the copy: it never leaves this block
            gc.freeze()
            _become(name, fds, out, err)
            for number, handler in (handlers or {}).items():
                signal.signal(number, handler)
            signal.pthread_sigmask(signal.SIG_SETMASK, held)
            code = _ended(run)
        finally:
            os._exit(code)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, held)


def _become(name: str, fds: Sequence[int], out: int, err: int) -> None:
    """Leave the session, the signals and the files of the process that this one is a copy of."""
    os.setsid()  # a Ctrl-C at its terminal is its own to handle
    signal.set_wakeup_fd(-1)
    for number in signal.valid_signals():
        if callable(signal.getsignal(number)):
            ours = number == signal.SIGINT
            signal.signal(number, signal.default_int_handler if ours else signal.SIG_DFL)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for fd, target in ((nowhere, 0), (out, 1), (err, 2)):
        if fd >= 0:
            os.dup2(fd, target)
    kept = sorted({0, 1, 2, *fds})
    for first, last in zip(kept, [*kept[1:], os.sysconf("SC_OPEN_MAX")], strict=True):
        os.closerange(first + 1, last)
    sys.stdin = os.fdopen(0, closefd=False)
    sys.stdout = os.fdopen(1, "w", closefd=False)
    sys.stderr = os.fdopen(2, "w", buffering=1, errors="backslashreplace", closefd=False)
    with suppress(OSError), open("/proc/self/comm", "w") as comm:
        comm.write(name)


def _ended(run: Callable[[], None]) -> int:
    """The exit code with which a Python program ends that does `run`."""
    try:
        run()
        code = 0
    except SystemExit as end:
        if isinstance(end.code, int) or end.code is None:
            code = end.code or 0
        else:
            print(end.code, file=sys.stderr)
            code = CRASHED
    except BaseException:
        traceback.print_exc()
        code = CRASHED
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    return code
