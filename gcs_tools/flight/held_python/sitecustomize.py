"""Hold the time of a Python program: its clocks tell simulation time, and it sleeps in simulation time.

Python imports this before the program, if its folder is on PYTHONPATH. The environment names the clock (see
held_clock.py). Without it nothing is changed. Held are the clocks of `time`, sleep, the waiting of `select`
and `selectors` (so asyncio's), of sockets with a timeout, and of threading's conditions, events and queues.
A program that looks at the clock again and again without ever sleeping sleeps to the next tick.
"""

from __future__ import annotations

import importlib.machinery
import importlib.util
import os
import sys

NAME = "M_MRAC_HELD"
HERE = os.path.dirname(os.path.abspath(__file__))


def _hold(name: str, path: str) -> None:
    """Put clocks and waits of this program under the clock of that name."""
    import mmap
    import struct
    import time

    of_wall = {each: getattr(time, each) for each in ("time", "monotonic", "sleep")}
    with open(path, "rb") as file:
        shared = mmap.mmap(file.fileno(), 8, prot=mmap.PROT_READ)
    date_s = 1_767_225_600.0  # 2026-01-01: the date when simulation begins
    since_s = 1_000.0  # what a monotonic clock then shows
    spins = [0, -1.0]  # looks at the clock since time last went on, and that time
    most_spins = 1_000
    says = struct.Struct("<id")
    number = struct.Struct("<d")

    def now() -> float:
        return float(number.unpack(shared[:])[0])

    def look() -> float:
        """The time. Who looks too often without sleeping waits until it goes on."""
        at = now()
        if at != spins[1]:
            spins[:] = 0, at
        spins[0] += 1
        if spins[0] > most_spins:
            spins[0] = 0
            wait((), at + 1e-6)
            return now()
        return at

    def clock(begins: float, of_ns: bool):
        if of_ns:
            return lambda: round((begins + look()) * 1e9)
        return lambda: begins + look()

    for kind, begins in (("time", date_s), ("monotonic", since_s), ("perf_counter", since_s)):
        setattr(time, kind, clock(begins, False))
        setattr(time, f"{kind}_ns", clock(begins, True))

    import select
    import socket
    import threading

    poll_of_wall, select_of_wall, epoll_of_wall = select.poll, select.select, select.epoll
    connect_of_wall, recv_of_wall = socket.socket.connect, socket.socket.recv
    own = threading.local()

    def forget() -> None:
        nonlocal own
        own = threading.local()

    os.register_at_fork(after_in_child=forget)

    def ticket() -> socket.socket:
        """This thread's connection to the clock."""
        if not hasattr(own, "ticket"):
            made = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            connect_of_wall(made, f"\0{name}")
            own.ticket = made
        return own.ticket

    def wait(files, until_s: float) -> None:
        """Sleep until one of `files` ((number, events) each) is ready, or that simulation time."""
        held = ticket()
        polled = poll_of_wall()
        for each, events in files:
            polled.register(each, events)
        if polled.poll(0):
            return
        held.send(says.pack(os.getpid(), until_s))
        polled.register(held.fileno(), select.POLLIN)
        ready = polled.poll()
        if held.fileno() not in (each for each, _ in ready):
            held.send(says.pack(os.getpid(), float("inf")))
        elif not recv_of_wall(held, 1):  # the clock is gone, and its flight
            of_wall["sleep"](60.0)
            raise SystemExit(1)

    def sleep(seconds, /):
        if seconds < 0:
            raise ValueError("sleep length must be non-negative")
        wait((), now() + seconds)

    time.sleep = sleep

    def numbers(files, events):
        return [(f if isinstance(f, int) else f.fileno(), events) for f in files]

    def held_select(rlist, wlist, xlist, timeout=None, /):
        rlist, wlist, xlist = list(rlist), list(wlist), list(xlist)
        if timeout is not None and timeout > 0:
            wait(
                [*numbers(rlist, select.POLLIN), *numbers(wlist, select.POLLOUT), *numbers(xlist, select.POLLPRI)],
                now() + timeout,
            )  # fmt: skip
            timeout = 0
        found = select_of_wall(rlist, wlist, xlist, timeout)
        if timeout == 0 and not any(found):
            look()
        return found

    class HeldPoll:
        """select.poll, whose timeout is of simulation time."""

        def __init__(self):
            self._poll, self._files = poll_of_wall(), {}

        def register(self, fd, eventmask=select.POLLIN | select.POLLPRI | select.POLLOUT, /):
            self._poll.register(fd, eventmask)
            self._files[fd if isinstance(fd, int) else fd.fileno()] = eventmask

        def modify(self, fd, eventmask, /):
            self._poll.modify(fd, eventmask)
            self._files[fd if isinstance(fd, int) else fd.fileno()] = eventmask

        def unregister(self, fd, /):
            self._poll.unregister(fd)
            del self._files[fd if isinstance(fd, int) else fd.fileno()]

        def poll(self, timeout=None, /):
            if timeout is None or timeout < 0:
                return self._poll.poll()
            if timeout > 0:
                wait(self._files.items(), now() + timeout * 1e-3)
            found = self._poll.poll(0)
            if not found:
                look()
            return found

    class HeldEpoll:
        """select.epoll, whose timeout is of simulation time."""

        def __init__(self, sizehint=-1, flags=0):
            self._epoll = epoll_of_wall(sizehint, flags)

        @classmethod
        def fromfd(cls, fd):
            made = cls.__new__(cls)
            made._epoll = epoll_of_wall.fromfd(fd)
            return made

        def poll(self, timeout=None, maxevents=-1):
            if timeout is None or timeout < 0:
                return self._epoll.poll(None, maxevents)
            if timeout > 0:
                wait([(self._epoll.fileno(), select.POLLIN)], now() + timeout)
            found = self._epoll.poll(0, maxevents)
            if not found:
                look()
            return found

        def __getattr__(self, name):
            return getattr(self._epoll, name)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            self._epoll.close()

    select.select, select.poll, select.epoll = held_select, HeldPoll, HeldEpoll

    def held_receive(kind):
        receive = getattr(socket.socket, kind)

        def held(self, *args, **named):
            timeout = self.gettimeout()
            if timeout:
                polled = poll_of_wall()
                polled.register(self, select.POLLIN)
                if not polled.poll(0):
                    wait([(self.fileno(), select.POLLIN)], now() + timeout)
                if not polled.poll(0):
                    raise TimeoutError("timed out")
            try:
                return receive(self, *args, **named)
            except BlockingIOError:
                look()
                raise

        setattr(socket.socket, kind, held)

    for kind in ("recv", "recv_into", "recvfrom", "recvfrom_into", "recvmsg", "accept"):
        held_receive(kind)

    lock_of_wall = threading._allocate_lock

    class HeldLock:
        """The lock that a condition waits for, whose timeout is of simulation time."""

        def __init__(self):
            self._lock, self._bell = lock_of_wall(), None

        def acquire(self, blocking=True, timeout=-1):
            if self._lock.acquire(False):
                return True
            if not blocking or timeout == 0:
                look()
                return False
            if timeout < 0:
                return self._lock.acquire()
            bell = os.eventfd(0)
            self._bell = bell
            try:
                if not self._lock.acquire(False):
                    wait([(bell, select.POLLIN)], now() + timeout)
                    return self._lock.acquire(False)
                return True
            finally:
                self._bell = None
                os.close(bell)

        __enter__ = acquire

        def __exit__(self, *_):
            self.release()

        def release(self):
            bell = self._bell
            self._lock.release()
            if bell is not None:
                try:
                    os.eventfd_write(bell, 1)
                except OSError:  # it has seen the lock itself
                    pass

        def locked(self):
            return self._lock.locked()

    threading._allocate_lock = HeldLock
    held = ticket()
    held.send(says.pack(os.getpid(), float("inf")))


def _go_on() -> None:
    """The sitecustomize that this one hides, if there is one."""
    paths = [each for each in sys.path if os.path.abspath(each) != HERE]
    found = importlib.machinery.PathFinder.find_spec("sitecustomize", paths)
    if found is not None and found.loader is not None:
        found.loader.exec_module(importlib.util.module_from_spec(found))


if os.environ.get(NAME):
    _hold(*os.environ[NAME].split(" ", 1))
_go_on()
