"""A command that ends with whoever started it: python -m gcs_tools.flight.leash FD FOLDER COMMAND...

FD is a lifeline: the reading end of a pipe. The command runs in FOLDER, in a session of its own. When it ends,
when the lifeline hangs up or at SIGTERM, every process is ended that it has left (on Linux also those
that have gone into sessions of their own). What it writes goes to standard error, where a file takes so
much and no more; standard output has a line of JSON when it has begun and one when it has ended, which names the
processes that the command has left behind when it ended by itself.
"""

from __future__ import annotations

import ctypes
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from fcu.interface.starter import announce

GRACE_S = 0.5  # wall: from SIGTERM to SIGKILL
LOOK_S = 0.01  # wall
LOG_BYTES, LOG_LOOK_S = 1 << 26, 0.25  # of its log, at most; wall: between two looks
SWEEPS = 100  # over processes that others leave while they are ended
_DIE_WITH_PARENT, _ADOPT = 1, 36  # linux/prctl.h: PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER
LINUX = sys.platform == "linux"


def _prctl(option: int, value: int) -> None:
    ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def die_with_parent() -> None:
    """Let this process be killed when the one that started it has ended, however it ends."""
    _prctl(_DIE_WITH_PARENT, signal.SIGKILL)


def _left() -> list[int]:
    """The processes that are ours now: the command's, and those that it has left."""
    try:
        return [*map(int, Path("/proc/thread-self/children").read_text().split())]
    except OSError:  # not Linux
        return []


def _tell(process: subprocess.Popen[bytes], number: int) -> None:
    """A signal to the session of the command."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, number)


def _end(process: subprocess.Popen[bytes]) -> int:
    """End the command and all that it has left; its exit code."""
    until = time.monotonic() + GRACE_S
    if process.poll() is None:
        _tell(process, signal.SIGTERM)
        _tell(process, signal.SIGCONT)
    while process.poll() is None and time.monotonic() < until:
        time.sleep(LOOK_S)
    _tell(process, signal.SIGKILL)
    code = process.wait()
    for _ in range(SWEEPS):
        if not (pids := _left()):
            break
        for pid in pids:
            with suppress(ProcessLookupError, PermissionError, ChildProcessError):
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)
    return code


def _left_behind() -> list[str]:
    """Names of the processes that an ended command has left, and that do not end within GRACE_S."""
    until = time.monotonic() + GRACE_S
    while True:
        running = []
        for pid in _left():
            with suppress(OSError):
                if os.waitpid(pid, os.WNOHANG)[0] == 0:
                    name = Path(f"/proc/{pid}/comm").read_bytes()  # may be cut inside a character
                    running.append(name.decode(errors="replace").strip())
        if not running or time.monotonic() > until:
            return running
        time.sleep(LOOK_S)


def main(arguments: Sequence[str]) -> None:
    """Run the command to its end, or to ours."""
    lifeline, folder, command = int(arguments[0]), arguments[1], arguments[2:]
    heard, wake = os.pipe()
    for end in (heard, wake):
        os.set_blocking(end, False)
    asked: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: asked.append(number))
    signal.signal(signal.SIGCHLD, lambda *_: None)  # wakes us
    signal.set_wakeup_fd(wake)
    if LINUX:
        _prctl(_ADOPT, 1)
    try:
        process = subprocess.Popen(
            command, cwd=folder, stdin=subprocess.DEVNULL, stdout=sys.stderr, start_new_session=True,
            preexec_fn=die_with_parent if LINUX else None,
        )  # fmt: skip
    except OSError as error:
        announce({"ended": "controller", "why": f"it did not begin ({error.strerror})"})
        return
    announce({"ready": "controller", "pid": process.pid})
    why = ""
    while process.poll() is None and not asked and not why:
        if lifeline in select.select((lifeline, heard), (), (), LOG_LOOK_S)[0]:
            break
        with suppress(BlockingIOError):
            os.read(heard, 4096)
        if os.fstat(sys.stderr.fileno()).st_size > LOG_BYTES:
            why = f"it has written more than {LOG_BYTES >> 20} MiB to its log"
    left = [] if asked or why or process.poll() is None else _left_behind()
    code = _end(process)
    if os.fstat(sys.stderr.fileno()).st_size > LOG_BYTES:  # written between two looks
        os.ftruncate(sys.stderr.fileno(), LOG_BYTES)
    announce({"ended": "controller", "exit_code": code, "why": why, "left": left})


if __name__ == "__main__":
    main(sys.argv[1:])
