"""What ties a process to whoever started it: a lifeline, and lines of JSON on standard output."""

from __future__ import annotations

import json
import os
import select
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

ORPHANED = 3  # exit code


@contextmanager
def watched(*lifelines: int | None) -> Iterator[None]:
    """End this process at once when a lifeline hangs up while the body runs.

    For work during which nobody polls, and which no signal handler written in Python can
    interrupt: compiling. `lifelines`: reading ends of pipes that the starter holds open.
    """
    fds = [fd for fd in lifelines if fd is not None]
    done_out, done_in = os.pipe()
    poll = select.poll()
    for fd in fds:
        poll.register(fd, 0)  # a hang-up is reported without being asked for
    poll.register(done_out, select.POLLIN)

    def watch() -> None:
        if any(fd in fds for fd, _ in poll.poll()):
            os._exit(ORPHANED)

    thread = threading.Thread(target=watch, daemon=True, name="lifeline")
    thread.start()
    try:
        yield
    finally:
        os.write(done_in, b"\0")
        thread.join()
        os.close(done_in)
        os.close(done_out)


def announce(said: dict[str, Any]) -> None:
    """One line of JSON to whoever started us; lost if nobody listens any more."""
    with suppress(OSError):
        os.write(1, (json.dumps(said) + "\n").encode())


def log(line: str) -> None:
    """One line on standard error. A log that cannot be written must neither end nor stop a flight.

    A line for which a pipe that nobody reads has no room is lost.
    """
    with suppress(OSError):
        poll = select.poll()
        poll.register(2, select.POLLOUT)  # of a pipe: PIPE_BUF bytes at least would fit
        if poll.poll(0):
            os.write(2, (line + "\n").encode()[: select.PIPE_BUF])


def occupy_standard_streams() -> None:
    """Open /dev/null where descriptors 0 to 2 are closed: no socket shall take their places."""
    with suppress(OSError):
        while (fd := os.open(os.devnull, os.O_RDWR)) <= 2:
            pass
        os.close(fd)
