"""Signals that ask a program to end (Ctrl-C, SIGTERM, SIGHUP), heard where a flight can be left.

Python raises what a signal handler raises between any two of its statements: between the making of a
recording and the block that closes it, in the closing itself, and between those that compiled code
runs while it makes a NamedTuple, where numba does not expect it and answers with nothing, with
another error, or not at all. So while a flight is made, flown and written down, signals are only
remembered, and raised where the flight looks for them. An interruption is raised once: signals that
follow it cannot cut short what it has begun.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


class Interrupts:
    """The handler of `SIGNALS`, and what it has heard.

    Outside of `interrupts_wait` it raises KeyboardInterrupt at once, as Python's own.
    """

    def __init__(self, waits: bool = False) -> None:
        """`waits`: it never raises at once, only where somebody looks."""
        self.is_heard = False  # whether a signal has come
        self._is_told = False  # whether somebody knows
        self._depth = int(waits)  # blocks in which signals wait

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        """Called by Python when a signal has come."""
        self.is_heard = True
        if not self._depth and not self._is_told and not _is_handled(sys.exception()):
            raise KeyboardInterrupt

    def take(self) -> bool:
        """Whether a signal has come that nobody knew of; whoever asks does now."""
        is_news = self.is_heard and not self._is_told
        if is_news:  # one that comes between these lines is news to who asks next
            self._is_told = True
        return is_news

    def look(self) -> None:
        """Raise KeyboardInterrupt if a signal has come that nobody knew of."""
        if self.take():
            raise KeyboardInterrupt

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Within a block in which signals wait: raise them at once, for what takes long (compiling).

        One that was lost on its way, as in code that clears all errors, is raised when the next kernel
        is compiled, or at the end.
        """
        from fcu.kernel import cache

        depth, self._depth = self._depth, 0
        cache.watchers.append(self.look)
        try:
            self.look()
            yield
        except KeyboardInterrupt:
            self._is_told = True
            raise
        finally:
            cache.watchers.remove(self.look)
            self._depth = depth
        self.look()

    @contextmanager
    def _waiting(self) -> Iterator[Interrupts]:
        self._depth += 1
        try:
            yield self
        finally:
            self._depth -= 1
        self.look()


def _is_handled(error: BaseException | None) -> bool:
    """Whether an interruption is being handled: what cleans up after it is not interrupted again."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__context__
    return False


@contextmanager
def interrupts_wait() -> Iterator[Interrupts]:
    """Signals wait until the block looks for them (`look` of what is yielded), or for its end.

    What the block raises itself goes before one that nobody has looked at. Blocks may be nested. In
    another than the main thread, which hears no signals, and of a signal that nobody handles,
    nothing is changed.
    """
    interrupts, before = _installed(), {}
    if interrupts is None:
        interrupts = Interrupts(waits=True)
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                if callable(signal.getsignal(number)):
                    before[number] = signal.signal(number, interrupts)
    try:
        with interrupts._waiting():
            yield interrupts
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _installed() -> Interrupts | None:
    """The handler of this program, if it has one and this is the thread that hears signals."""
    if threading.current_thread() is not threading.main_thread():
        return None
    handlers = (signal.getsignal(number) for number in SIGNALS)
    return next((each for each in handlers if isinstance(each, Interrupts)), None)


def install() -> Interrupts:
    """Hear signals from now on, for a program's own process; what has been installed already, if so.

    Signals that whoever started the program had it ignore (nohup, a shell's `&`) stay ignored; but
    SIGTERM, which tells this process to end and no other.
    """
    if (interrupts := _installed()) is None:
        interrupts = Interrupts()
        for number in SIGNALS:
            if number == signal.SIGTERM or signal.getsignal(number) != signal.SIG_IGN:
                signal.signal(number, interrupts)
    return interrupts


def is_heard() -> bool:
    """Whether a signal has come since `install`."""
    return (interrupts := _installed()) is not None and interrupts.is_heard


def ignore() -> None:
    """From now on signals change nothing: the program has its exit code, and ends."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


# signals that code brings upon its own process; others come from outside
OF_CODE = tuple(
    getattr(signal, name)
    for name in ("SIGSEGV", "SIGBUS", "SIGILL", "SIGFPE", "SIGABRT", "SIGTRAP", "SIGSYS")
    if hasattr(signal, name)
)


def is_of_code(code: int) -> bool:
    """Tell whether a process has ended by what it ran.  code : its exit code, -N for signal N."""
    return code >= 0 or -code in OF_CODE


def how_ended(code: int) -> str:
    """Say how code has ended its process.  code : as for `is_of_code`."""
    if code >= 0:
        return "ended its process"
    return f"ended its process by signal {-code} ({signal.strsignal(-code)})"
