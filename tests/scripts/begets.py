"""A program that sleeps until it is told to beget what runs on: a child, a thread, or an orphan.

Argument 1 says which. An orphan's parent is there from the start, and ends as soon as it has begotten it:
then the program, which does not notice, has it.
"""

from __future__ import annotations

import ctypes
import os
import sys
import threading

ADOPT = 36  # linux/prctl.h: PR_SET_CHILD_SUBREAPER


def run_on() -> None:
    """Tell that it is there, and run until the program is ended."""
    os.write(1, b"!")
    while True:
        pass


def child() -> None:
    os.read(0, 1)
    if os.fork() == 0:
        run_on()


def thread() -> None:
    os.read(0, 1)
    threading.Thread(target=run_on, daemon=True).start()


def orphan() -> None:
    ctypes.CDLL(None).prctl(ADOPT, 1, 0, 0, 0)
    if os.fork() == 0:
        os.read(0, 1)
        mine = os.getpid()
        if os.fork() == 0:
            while os.getppid() == mine:
                pass
            run_on()
        os._exit(0)


{"child": child, "thread": thread, "orphan": orphan}[sys.argv[1]]()
never, _ = os.pipe()
os.read(never, 1)
