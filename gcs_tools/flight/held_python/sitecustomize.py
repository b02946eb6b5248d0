"""Hold the time of a Python program: its clocks tell simulation time, and it waits in simulation time.

Python imports this before the program, if its folder is on PYTHONPATH. The environment names the clock (see
held_clock.py). Without it nothing is changed. Held are the clocks of `time` and `datetime.now`, sleep, the
waiting of `select` and `selectors` (so asyncio's), of sockets, of threading's locks, conditions and events, of
queues, and the alarms of `signal`. A program that looks at the clock again and again without ever waiting waits
for the next tick.
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
    import errno
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
    least_s, step_s = 1e-6, 0.01  # of a wait, and of what is looked at again and again
    gone = errno.EPIPE, errno.ECONNRESET, errno.ECONNREFUSED, errno.ENOTCONN
    close_s = 1e-9  # a time that is over but for rounding is over
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
        except BaseException as error:
            if getattr(error, "errno", None) not in gone:  # the handler of a signal raised it
                del own.ticket  # this wait is over: what is still said about it is not for the next
                mine.close()
                raise
            woken = b""
        if not woken:  # the clock is gone, and its flight
            os._exit(1)

    # --- threads

    lock_of_wall, join_of_wall = threading._allocate_lock, threading.Thread.join
    bells_lock = lock_of_wall()

    class HeldLock:
        """A lock that is waited for in simulation time. Who holds time wakes who waits, one at a time."""

        def __init__(self):
            self._lock, self._bells = lock_of_wall(), []

        def acquire(self, blocking=True, timeout=-1):
            if not blocking and timeout != -1:
                raise ValueError("can't specify a timeout for a non-blocking call")
            if timeout < 0 and timeout != -1:
                raise ValueError("timeout value must be a non-negative number")
            if self._lock.acquire(False):
                return True
            if not blocking or timeout == 0:
                look()
                return False
            bell = os.eventfd(0)
            with bells_lock:
                self._bells.append(bell)
            try:
                return self._acquired(
                    bell, None if timeout == -1 else now() + max(timeout, least_s)
                )
            finally:
                with bells_lock:
                    self._bells.remove(bell)
                os.close(bell)

        def _acquired(self, bell, until_s):
            while not self._lock.acquire(False):
                if until_s is not None and now() >= until_s - close_s:
                    return False
                wait([(bell, select.POLLIN)], None if until_s is None else until_s - now())
                if poll_of_bell(bell):
                    os.eventfd_read(bell)
            return True

        def __enter__(self):
            return self.acquire()

        def __exit__(self, *_):
            self.release()

        def release(self):
            self._lock.release()
            with bells_lock:
                for bell in self._bells:
                    os.eventfd_write(bell, 1)

        def locked(self):
            return self._lock.locked()

        def _at_fork_reinit(self):
            self._lock, self._bells = lock_of_wall(), []

    def poll_of_bell(bell):
        rung = poll_of_wall()
        rung.register(bell, select.POLLIN)
        return rung.poll(0)

    def held_join(self, timeout=None):
        if timeout is not None:
            until_s = now() + timeout
            while self.is_alive() and now() < until_s:
                sleep(step_s)
            if self.is_alive():
                return
        join_of_wall(self)

    threading._allocate_lock = threading.Lock = HeldLock
    threading.Thread.join = held_join
    threading._time = time.monotonic  # where threading was imported before
    threading._CRLock = None  # its RLock in Python waits for a lock as above

    import queue

    queue.SimpleQueue = (
        queue._PySimpleQueue
    )  # which waits for a semaphore, and that for a lock as above
    os.register_at_fork(after_in_child=bells_lock._at_fork_reinit)

    # --- alarms

    import _thread
    import signal

    itimer_of_wall, left_of_wall = signal.setitimer, signal.getitimer
    wait_of_wall = signal.sigtimedwait
    alarms = [0, float("inf"), 0.0]  # how many were set, when the last goes off, and how often then

    def ring(which):
        """Send the signal when it is time, as often as it is due, until another alarm is set."""
        while alarms[0] == which:
            wait((), alarms[1] - now())
            if alarms[0] == which and now() >= alarms[1] - close_s:
                alarms[1] = alarms[1] + alarms[2] if alarms[2] else float("inf")
                os.kill(os.getpid(), signal.SIGALRM)
                if not alarms[2]:
                    return

    def held_getitimer(which, /):
        if which != signal.ITIMER_REAL:
            return left_of_wall(which)
        if alarms[1] == float("inf"):
            return 0.0, 0.0
        return max(alarms[1] - now(), least_s), alarms[2]

    def held_setitimer(which, seconds, interval=0.0, /):
        if which != signal.ITIMER_REAL:
            return itimer_of_wall(which, seconds, interval)
        if seconds < 0 or interval < 0:
            raise signal.ItimerError(22, "Invalid argument")
        before = held_getitimer(which)
        alarms[:] = alarms[0] + 1, now() + seconds if seconds else float("inf"), interval
        if seconds:
            _thread.start_new_thread(ring, (alarms[0],))
        return before

    def held_alarm(seconds, /):
        left, _ = held_setitimer(signal.ITIMER_REAL, int(seconds))
        return -int(-left // 1)

    def held_sigtimedwait(sigset, timeout, /):
        if timeout < 0:
            raise ValueError("timeout must be non-negative")
        until_s = now() + timeout
        while (found := wait_of_wall(sigset, 0)) is None and now() < until_s - close_s:
            sleep(min(step_s, until_s - now()))
        return found

    def no_alarm():
        alarms[:] = alarms[0] + 1, float("inf"), 0.0

    os.register_at_fork(after_in_child=no_alarm)
    signal.setitimer, signal.getitimer = held_setitimer, held_getitimer
    signal.alarm, signal.sigtimedwait = held_alarm, held_sigtimedwait

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
