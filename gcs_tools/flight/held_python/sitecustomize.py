"""Hold the time of a Python program: its clocks tell simulation time, and it waits in simulation time.

Python imports this before the program, if its folder is on PYTHONPATH. The environment names the clock (see
held_clock.py). Without it nothing is changed. Held are the clocks of `time` and `datetime.now`, sleep, the
waiting of `select` and `selectors` (so asyncio's), of sockets, and of threading's conditions, events and
queues. A program that looks at the clock again and again without ever waiting waits for the next tick.
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
    import select
    import struct
    import time

    with open(path, "rb") as file:
        shared = mmap.mmap(file.fileno(), 8, prot=mmap.PROT_READ)
    number, says, event = struct.Struct("<d"), struct.Struct("<d"), struct.Struct("<h")
    date_s = 1_767_225_600.0  # 2026-01-01: the date when simulation begins
    since_s = 1_000.0  # what a monotonic clock then shows
    spins = [0, -1.0]  # looks since time last went on, and that time
    most_spins, most_files = 1_000, 250
    least_s, step_s = 1e-6, 0.01  # of a wait, and of a thread that is joined
    select_of_wall, poll_of_wall, epoll_of_wall = select.select, select.poll, select.epoll

    # --- the time

    def now() -> float:
        return float(number.unpack(shared[:])[0])

    def look() -> float:
        """The time. Who looks too often without waiting waits until it goes on."""
        at = now()
        if at != spins[1]:
            spins[:] = 0, at
        spins[0] += 1
        if spins[0] > most_spins:
            spins[0] = 0
            wait((), least_s)
            return now()
        return at

    def clock(begins: float, of_ns: bool):
        if of_ns:
            return lambda: round((begins + look()) * 1e9)
        return lambda: begins + look()

    for kind, begins in (("time", date_s), ("monotonic", since_s), ("perf_counter", since_s)):
        setattr(time, kind, clock(begins, False))
        setattr(time, f"{kind}_ns", clock(begins, True))

    def sleep(seconds, /):
        if seconds < 0:
            raise ValueError("sleep length must be non-negative")
        if seconds:
            wait((), seconds)
        else:
            look()

    time.sleep = sleep

    # --- files: `socket` imports selectors, which has to find what is held

    def numbers(files, events):
        return [(each if isinstance(each, int) else each.fileno(), events) for each in files]

    def held(find, files, timeout):
        """Find at once, or once one of `files` is ready or `timeout` (s, None: never) is over."""
        found = find()
        if any(found) if isinstance(found, tuple) else found:
            return found
        if timeout == 0:
            look()
            return found
        wait(files(), timeout)
        return find()

    def held_select(rlist, wlist, xlist, timeout=None, /):
        kinds = rlist, wlist, xlist = list(rlist), list(wlist), list(xlist)

        def files():
            of = select.POLLIN, select.POLLOUT, select.POLLPRI
            return [
                each
                for kind, events in zip(kinds, of, strict=True)
                for each in numbers(kind, events)
            ]

        return held(lambda: select_of_wall(*kinds, 0), files, timeout)

    class HeldPoll:
        """select.poll, whose timeout is of simulation time."""

        def __init__(self):
            self._poll, self._files = poll_of_wall(), {}

        def register(self, fd, eventmask=select.POLLIN | select.POLLPRI | select.POLLOUT, /):
            self._poll.register(fd, eventmask)
            self._files.update(numbers([fd], eventmask))

        def modify(self, fd, eventmask, /):
            self._poll.modify(fd, eventmask)
            self._files.update(numbers([fd], eventmask))

        def unregister(self, fd, /):
            self._poll.unregister(fd)
            del self._files[numbers([fd], 0)[0][0]]

        def poll(self, timeout=None, /):
            seconds = None if timeout is None or timeout < 0 else timeout * 1e-3
            return held(lambda: self._poll.poll(0), self._files.items, seconds)

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
            seconds = None if timeout is None or timeout < 0 else timeout
            mine = [(self._epoll.fileno(), select.POLLIN)]
            return held(lambda: self._epoll.poll(0, maxevents), lambda: mine, seconds)

        def __getattr__(self, name):
            return getattr(self._epoll, name)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            self._epoll.close()

    select.select, select.poll, select.epoll = held_select, HeldPoll, HeldEpoll

    import socket

    def hold_reception(kind):
        receive = getattr(socket.socket, kind)

        def held_receive(self, *args, **named):
            timeout = self.gettimeout()
            if timeout == 0:
                try:
                    return receive(self, *args, **named)
                except BlockingIOError:
                    look()
                    raise
            mine = [(self.fileno(), select.POLLIN)]
            ready = poll_of_wall()
            ready.register(*mine[0])
            if not held(lambda: ready.poll(0), lambda: mine, timeout):
                raise TimeoutError("timed out")
            return receive(self, *args, **named)

        setattr(socket.socket, kind, held_receive)

    recv_of_wall, connect_of_wall = socket.socket.recv, socket.socket.connect
    for kind in ("recv", "recv_into", "recvfrom", "recvfrom_into", "recvmsg", "accept"):
        hold_reception(kind)

    # --- who holds time

    import threading

    own = threading.local()

    def forget() -> None:
        nonlocal own
        own = threading.local()

    os.register_at_fork(after_in_child=forget)

    def ticket() -> socket.socket:
        """The connection of this thread to the clock."""
        if not hasattr(own, "ticket"):
            made = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            connect_of_wall(made, f"\0{name}")
            own.ticket = made
        return own.ticket

    def wait(files, timeout) -> None:
        """Wait until one of `files` ((number, events) each) is ready, or `timeout` (s) is over.

        Who holds time looks whether they are: what arrives while others run is seen once they wait.
        """
        files = list(files)[:most_files]
        until_s = float("inf") if timeout is None else now() + max(timeout, least_s)
        told = says.pack(until_s) + b"".join(event.pack(e & 0x7FFF) for _, e in files)
        mine = ticket()
        try:
            socket.send_fds(mine, [told], [each for each, _ in files])
            woken = recv_of_wall(mine, 1)
        except OSError:
            woken = b""
        if not woken:  # the clock is gone, and its flight
            os._exit(1)

    # --- threads

    lock_of_wall, join_of_wall = threading._allocate_lock, threading.Thread.join

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
            self._bell = bell = os.eventfd(0)
            try:
                return held(
                    lambda: self._lock.acquire(False), lambda: [(bell, select.POLLIN)], timeout
                )
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
                except OSError:  # who waited has seen the lock already
                    pass

        def locked(self):
            return self._lock.locked()

    def held_join(self, timeout=None):
        if timeout is not None:
            until_s = now() + timeout
            while self.is_alive() and now() < until_s:
                sleep(step_s)
            if self.is_alive():
                return
        join_of_wall(self)

    threading._allocate_lock, threading.Thread.join = HeldLock, held_join

    # --- dates

    import datetime

    class HeldDatetime(datetime.datetime):
        """datetime, whose present is of simulation."""

        @classmethod
        def now(cls, tz=None):
            return cls.fromtimestamp(time.time(), tz)

        @classmethod
        def utcnow(cls):
            utc = datetime.timezone.utc  # noqa: UP017 (Python 3.10 has no other)
            return cls.fromtimestamp(time.time(), utc).replace(tzinfo=None)

        @classmethod
        def today(cls):
            return cls.now()

    HeldDatetime.__name__ = HeldDatetime.__qualname__ = "datetime"
    HeldDatetime.__module__ = "datetime"
    datetime.datetime = HeldDatetime
    ticket()  # so that who holds time has heard of this program before it does anything


def _go_on() -> None:
    """Run the sitecustomize that this one hides, if there is one."""
    paths = [each for each in sys.path if os.path.abspath(each) != HERE]
    found = importlib.machinery.PathFinder.find_spec("sitecustomize", paths)
    if found is not None and found.loader is not None:
        found.loader.exec_module(importlib.util.module_from_spec(found))


if os.environ.get(NAME) and sys.version_info >= (3, 10):  # an older one keeps the wall's time
    _hold(*os.environ[NAME].split(" ", 1))
_go_on()
