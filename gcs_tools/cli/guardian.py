"""A guardian for laws of users' own, whose code may end the process that runs it.

A law that writes beyond an array ends its process by a signal: nothing that runs in that process can
tell anybody. So before a user's FILE is imported, the command goes on in a copy of its process. The
process that was started stays behind, passes signals on, and ends with the exit code of the copy. If
the copy ends without an exit code of its own, the guardian names the file.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from pathlib import Path
from typing import NoReturn

from fcu.interface import foreign_code
from gcs_tools.exit_codes import INFRASTRUCTURE
from gcs_tools.flight.interrupts import SIGNALS, how_ended, is_of_code

FROM_TERMINAL = 0x80  # SI_KERNEL: who sent it has sent it to the copy, too
ENDED = b"\0"  # what a copy writes that ends by itself

_told: int | None = None  # of the copy: where it tells its guardian; None: nobody guards it


def install() -> None:
    """From now on import no user's law without a guardian. Where a process cannot be copied: import it."""
    if hasattr(os, "fork") and hasattr(signal, "sigwaitinfo"):
        foreign_code.before_import = _stand_by


def leave() -> None:
    """Tell the guardian, if there is one, that the command ends by itself."""
    if _told is not None:
        os.write(_told, ENDED)


def _stand_by(file: Path) -> None:
    """Go on in a copy of this process, and tell its guardian which file is imported."""
    global _told
    if _told is None and threading.active_count() == 1:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        reading, writing = os.pipe()
        waited = {*SIGNALS, signal.SIGCHLD}
        before = signal.pthread_sigmask(signal.SIG_BLOCK, waited)
        guardian = os.getpid()
        if pid := os.fork():
            os.close(writing)
            _guard(pid, reading, waited)
        from gcs_tools.flight import leash

        if leash.LINUX:
            leash.die_with_parent()
        if os.getppid() != guardian:
            os._exit(INFRASTRUCTURE)
        os.close(reading)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        _told = writing
    if _told is not None:
        os.write(_told, f"{file}\n".encode())


def _guard(pid: int, reading: int, waited: set[signal.Signals]) -> NoReturn:
    """Pass signals on until the copy has ended, and end as it has."""
    while True:
        heard = signal.sigwaitinfo(waited)
        if heard.si_signo != signal.SIGCHLD:
            if heard.si_code != FROM_TERMINAL:
                os.kill(pid, heard.si_signo)
            continue
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended:
            break
    os.set_blocking(reading, False)
    try:
        said = os.read(reading, 1 << 16)
    except BlockingIOError:
        said = b""
    code = os.waitstatus_to_exitcode(status)
    if said.endswith(ENDED) and code >= 0:
        os._exit(code)
    files = dict.fromkeys(said.decode(errors="replace").replace("\0", "").splitlines())
    if not is_of_code(code):
        if -code != signal.SIGKILL:
            signal.signal(-code, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, waited)
        os.kill(os.getpid(), -code)
        os._exit(INFRASTRUCTURE)
    os.write(2, f"Error: {', '.join(files)}: this law {how_ended(code)}\n".encode())
    os._exit(INFRASTRUCTURE)
