"""A program that waits in every way that held time knows. Prints each way, and how long it took, s.

Its sleeps are what is tested, or work that takes a thread or a child so long. No test waits for them: their time
is held, and goes on as soon as everybody waits.
"""

from __future__ import annotations

import asyncio
import contextlib
import datetime
import os
import queue
import select
import signal
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


def by_simple_queue() -> None:
    with contextlib.suppress(queue.Empty):
        queue.SimpleQueue().get(timeout=0.5)


def by_lock() -> None:
    lock = threading.Lock()
    assert lock.acquire(timeout=0.5)
    assert not lock.acquire(timeout=0.5)


def by_rlock() -> None:
    """Wait for a lock that another thread has, and gives back."""
    lock, has_it = threading.RLock(), threading.Event()

    def hold() -> None:
        with lock:
            has_it.set()
            time.sleep(0.5)  # held time of who has the lock

    threading.Thread(target=hold).start()
    has_it.wait()
    assert lock.acquire(timeout=5.0)


def by_two_for_a_lock() -> None:
    """Two wait for one lock: one after the other has it."""
    lock, order = threading.Lock(), []

    def take(name: str) -> None:
        with lock:
            order.append(name)
            time.sleep(0.125)  # held time of who has the lock

    lock.acquire()
    threads = [threading.Thread(target=take, args=(name,)) for name in "ab"]
    for each in threads:
        each.start()
    time.sleep(0.25)  # held time, in which both wait
    lock.release()
    for each in threads:
        each.join()
    assert sorted(order) == ["a", "b"]


def by_semaphore() -> None:
    assert not threading.Semaphore(0).acquire(timeout=0.5)


def raises(*_: object) -> None:
    raise InterruptedError


def by_alarm() -> None:
    """End a longer wait by an alarm that raises, and wait again."""
    signal.signal(signal.SIGALRM, raises)
    signal.setitimer(signal.ITIMER_REAL, 0.25)
    with contextlib.suppress(InterruptedError):
        time.sleep(60.0)  # held time that the alarm ends
    time.sleep(0.25)  # held time: nothing of the wait before may end it


def by_alarm_in_seconds() -> None:
    signal.signal(signal.SIGALRM, raises)
    signal.alarm(1)
    time.sleep(0.5)  # held time until the alarm is taken back
    assert abs(signal.getitimer(signal.ITIMER_REAL)[0] - 0.5) < 0.01
    assert signal.alarm(0) == 1


def by_alarm_without_a_wait() -> None:
    """An alarm rings while a program waits for a file of its own, which held time knows nothing of."""
    signal.signal(signal.SIGALRM, raises)
    signal.setitimer(signal.ITIMER_REAL, 0.5)
    mine, _ = os.pipe()
    with contextlib.suppress(InterruptedError):
        os.read(mine, 1)


def by_alarms() -> None:
    """Five alarms, one after the other."""
    rung = threading.Semaphore(0)
    signal.signal(signal.SIGALRM, lambda *_: rung.release())
    signal.setitimer(signal.ITIMER_REAL, 0.1, 0.1)
    for _ in range(5):
        rung.acquire()
    signal.setitimer(signal.ITIMER_REAL, 0.0)


def by_a_signal() -> None:
    assert signal.sigtimedwait({signal.SIGUSR1}, 0.5) is None


WAYS = {
    "sleep": lambda: time.sleep(0.5), "select": lambda: select.select([], [], [], 0.5),
    "asyncio": lambda: asyncio.run(asyncio.sleep(0.5)), "event": lambda: threading.Event().wait(0.5),
    "datetime": by_datetime, "looking": by_looking, "tiny sleeps": by_tiny_sleeps,
    "sleeping zero": by_sleeping_zero, "socket": by_socket, "polling a socket": by_polling_a_socket,
    "poll": by_poll, "epoll": by_epoll, "queue": by_queue, "join": by_join, "thread": by_thread,
    "child": by_a_child, "two sockets": by_two_sockets, "simple queue": by_simple_queue, "lock": by_lock,
    "rlock": by_rlock, "two for a lock": by_two_for_a_lock, "semaphore": by_semaphore, "alarm": by_alarm,
    "alarm in seconds": by_alarm_in_seconds, "alarm without a wait": by_alarm_without_a_wait,
    "alarms": by_alarms, "signal": by_a_signal,
}  # fmt: skip

for way, wait in WAYS.items():
    began = time.monotonic()
    wait()
    print(way, round(time.monotonic() - began, 6), flush=True)
