"""Ctrl-C and being told to end, heard where a flight can be left.

Python raises what a signal handler raises between any two of its statements, also between those
that compiled code runs while it makes a NamedTuple: numba does not expect them to raise there, and
then answers with nothing, with another error, or not at all.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def interrupts_wait() -> Iterator[Callable[[], None]]:
    """Signals interrupt only where what is yielded is called, and at the end of the block.

    Each is raised once, as KeyboardInterrupt. What the block raises itself goes before one that
    nobody has looked at. In another than the main thread, which hears none, and of a signal that nobody
    handles, nothing is changed.
    """
    heard: list[int] = []

    def look() -> None:
        if heard:
            heard.clear()
            raise KeyboardInterrupt

    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            if callable(signal.getsignal(number)):
                before[number] = signal.signal(number, lambda number, _frame: heard.append(number))
    try:
        yield look
        look()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
