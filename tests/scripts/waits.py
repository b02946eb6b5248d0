"""A program that waits in every way that held time knows. Prints each way, and how long it took, s.

Its sleeps are what is tested, or work that takes a thread or a child so long. No test waits for them: their time
is held, and goes on as soon as everybody waits.
"""

from __future__ import annotations

import asyncio
import contextlib
import datetime
import queue
import select
import socket
import subprocess
import sys
import threading
import time


def by_datetime() -> None:
    until = datetime.datetime.now() + datetime.timedelta(seconds=0.5)
    while datetime.datetime.now() < until:
        pass


def by_looking() -> None:
    until = time.monotonic() + 0.5
    while time.monotonic() < until:
        pass


def by_tiny_sleeps() -> None:
    until = time.time() + 0.5
    while time.time() < until:
        time.sleep(
            1e-9
        )  # a sleep shorter than a tick has to end with the next one, not at once for ever


def by_sleeping_zero() -> None:
    until = time.time() + 0.5
    while time.time() < until:
        time.sleep(0)  # scripts yield so in a loop that polls: time has to go on


def by_socket() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mine:
        mine.bind(("127.0.0.1", 0))
        mine.settimeout(0.5)
        with contextlib.suppress(TimeoutError):
            mine.recvfrom(10)


def by_polling_a_socket() -> None:
    until = time.time() + 0.5
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mine:
        mine.bind(("127.0.0.1", 0))
        mine.setblocking(False)
        while time.time() < until:
            with contextlib.suppress(BlockingIOError):
                mine.recv(10)


def by_poll() -> None:
    select.poll().poll(500)


def by_epoll() -> None:
    with select.epoll() as each:
        each.poll(0.5)


def by_queue() -> None:
    with contextlib.suppress(queue.Empty):
        queue.Queue().get(timeout=0.5)


def by_join() -> None:
    other = threading.Thread(target=time.sleep, args=(5.0,), daemon=True)
    other.start()
    other.join(0.5)


def by_thread() -> None:
    """Wait for longer than another thread takes to end the waiting."""
    done = threading.Event()

    def work() -> None:
        time.sleep(
            0.5
        )  # held time of another thread: the waiting ends by it, not by its own timeout
        done.set()

    threading.Thread(target=work).start()
    assert done.wait(5.0)


def by_a_child() -> None:
    """Read what another Python writes after it has slept."""
    child = "import time; time.sleep(0.5); print(1)"  # held in a process that this one starts, too
    words = [sys.executable, "-c", child]
    assert subprocess.run(words, capture_output=True, text=True, timeout=60).stdout == "1\n"


def by_two_sockets() -> None:
    """Read in one thread what another sends after it has slept."""
    mine, other = socket.socketpair()

    def send() -> None:
        time.sleep(0.5)  # held time until there is something to read
        other.send(b"x")

    threading.Thread(target=send).start()
    assert mine.recv(1) == b"x"


WAYS = {
    "sleep": lambda: time.sleep(0.5), "select": lambda: select.select([], [], [], 0.5),
    "asyncio": lambda: asyncio.run(asyncio.sleep(0.5)), "event": lambda: threading.Event().wait(0.5),
    "datetime": by_datetime, "looking": by_looking, "tiny sleeps": by_tiny_sleeps,
    "sleeping zero": by_sleeping_zero, "socket": by_socket, "polling a socket": by_polling_a_socket,
    "poll": by_poll, "epoll": by_epoll, "queue": by_queue, "join": by_join, "thread": by_thread,
    "child": by_a_child, "two sockets": by_two_sockets,
}  # fmt: skip

for way, wait in WAYS.items():
    began = time.monotonic()
    wait()
    print(way, round(time.monotonic() - began, 6), flush=True)
