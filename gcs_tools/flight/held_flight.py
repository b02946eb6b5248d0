"""A flight by a script whose time is held: time stands until the script has answered what it was sent.

The vehicle and the script have answered when every thread of theirs sleeps. Then, and only then, one tick more is
flown, and the vehicle reads what it was sent before it. A Python script sleeps in simulation time (held_clock.py), so two flights of it are the same to the
bit. A program in another language keeps the clock of the wall: it is waited for, time goes no
faster than the wall's while it lives, and its flights are the same only if nothing that it does
hangs on time.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress

from fcu.interface import handover
from gcs_tools.flight import asleep
from gcs_tools.flight.asleep import Sleepers
from gcs_tools.flight.held_clock import HeldClock
from gcs_tools.flight.processes import InfrastructureError
from gcs_tools.flight.script_flight import ScriptFlight

LOOK_S = 20e-6  # wall: between two looks at who sleeps
BEGINS = 5  # ticks within which a script may still begin
LONG_S = 0.5  # wall: who is awake for so long may have ended, or the flight with it
STANDS_S = (
    60.0  # time stands no longer for a script that works so long, or does nothing for so long
)
REST_LOOK_S = 0.02  # simulation time: between two looks at a vehicle that comes to rest


class Standing:
    """Bound on how long simulation time stands for a script that does not wait.

    Work is counted by the script's processor time: on a busy machine it takes longer, and is not late.
    """

    def __init__(
        self, work: Callable[[], tuple[float, bool]], clock: Callable[[], float] = time.monotonic
    ) -> None:
        """work : processor time (s) that the script has used so far, and whether it runs.  clock : of the wall, s."""
        self._work, self._clock = work, clock
        self.begin()

    def begin(self) -> None:
        """Time stands from now on."""
        self._since_s: float | None = None
        self._began_s = self._seen_s = 0.0

    def too_long(self) -> str:
        """Name what was too long, for a sentence. Empty: nothing yet."""
        (worked_s, runs), now = self._work(), self._clock()
        if self._since_s is None:
            self._began_s = worked_s
        if self._since_s is None or worked_s > self._seen_s or runs:
            self._seen_s, self._since_s = worked_s, now
        if worked_s - self._began_s > STANDS_S:
            return f"{STANDS_S:g} s of processor time without waiting, while simulation time stood"
        if now - self._since_s > STANDS_S:
            return f"{STANDS_S:g} s of wall time in which it neither worked nor waited"
        return ""


class HeldFlight(ScriptFlight):
    """The vehicle and the script of one flight, of which one waits while the other acts."""

    LINK_CLOCK = "held"

    def _led(self, stack: ExitStack) -> Callable[[], bool]:
        self._clock = HeldClock()
        stack.callback(self._clock.close)
        self._seen_pids: set[int] = set()
        self._on_wall = False
        self._ticked_s = 0.0  # wall
        self._granted = 0  # ticks
        self._standing: Standing | None = None  # of the script, once it has begun
        self._vehicle = Sleepers(each.process.pid for each in self._pair.children)
        return super()._led(stack)

    def _begin(self, words: list[str]) -> None:
        self._grant(1)  # from the first tick on the vehicle hears at ticks alone
        while self._flown_ticks() < 1 and not self._is_over():
            self._collector.wait_for(self._has_flown, LONG_S)
            self._pair.check()
        told = [f"{name}={value}" for name, value in self._clock.environment().items()]
        super()._begin(["env", *told, *words])
        pid = self._script.process.pid
        self._programs = Sleepers([pid])
        self._standing = Standing(lambda: asleep.work(pid))

    def _watch(self) -> bool:
        """Fly tick by tick until the flight is over. It never counts as arrived."""
        rate_hz = self._scene.rate_hz
        every = max(1, round(REST_LOOK_S * rate_hz))
        while not self._script.pid() and self._script.outcome() is None:
            self._pair.check()
            time.sleep(LOOK_S)
        while not self._is_over_at(self._granted, every):
            self._keep_to_the_wall()
            self._grant(self._granted + 1)
            self._collector.wait_for(self._has_flown, LONG_S)
            if self._granted % every == 0:
                self._pair.check()
                self._progress(self._granted / rate_hz)
        if self._outcome is None:
            self._took_s = time.monotonic() - self._began_s
        return False

    def _grant(self, tick: int) -> None:
        """Let time go on to this tick."""
        self._granted = tick
        if self._standing is not None:
            self._standing.begin()
        self._clock.set(tick / self._scene.rate_hz)
        with suppress(BrokenPipeError):  # the check of the pair says why
            os.write(self._control, handover.GRANT.pack(tick))

    def _has_flown(self) -> bool:
        return self._is_over() or self._flown_ticks() >= self._granted

    def _is_over_at(self, flown: int, every: int) -> bool:
        """Let the vehicle and the script act upon the last tick. Returns whether the flight is over."""
        self._programs.ran.clear()
        is_first = flown > BEGINS
        while self._wait_until_all_sleep():
            if is_first:
                self._note_who_ran()
            is_first = False
            if self._outcome is None and asleep.has_ended(self._script.pid()):
                if not self._wait_for_outcome() or self._is_finished(flown):
                    return True
            elif not self._clock.wake(flown / self._scene.rate_hz):
                break
        else:
            return True
        if self._outcome is None:
            return self._is_finished(flown)
        if flown % every and flown < self._scene.ticks and flown != self._ended_tick:
            return False
        self._wait_for_rows(flown)
        return self._is_finished(flown)

    def _wait_until_all_sleep(self) -> bool:
        """Wait until no thread of vehicle and script runs. False if the flight or its time is over."""
        looked = time.monotonic()
        while not (self._vehicle.have_slept() and self._programs.have_slept()):
            if time.monotonic() - looked > LONG_S:
                looked = time.monotonic()
                if self._collector.error is not None:
                    raise InfrastructureError(str(self._collector.error))
                if self._is_over() or self._has_ended() or self._is_late():
                    return False
                self._pair.check()
        return not self._is_over()

    def _is_late(self) -> bool:
        """True if time has stood too long for a script that neither ends nor waits."""
        if not self._late and self._standing is not None:
            self._late = self._standing.too_long()
            self._never_waits = bool(self._late)
        return bool(self._late)

    def _wait_for_outcome(self) -> bool:
        """Wait for the report of a script that has ended. False if its time is over."""
        while self._script.outcome() is None:
            if self._is_late():
                return False
            self._pair.check()
            time.sleep(LOOK_S)
        return True

    def _note_who_ran(self) -> None:
        """Learn from who runs though nobody woke it: it has another clock."""
        self._on_wall |= bool(self._programs.ran - {self._script.process.pid})

    def _keep_to_the_wall(self) -> None:
        """Wait for the wall's clock while a program lives that knows no other."""
        now = time.monotonic()
        if self._programs.pids != self._seen_pids:
            self._seen_pids = self._programs.pids
            others = self._seen_pids.difference(self._clock.heard)
            self._on_wall |= any(map(asleep.has_socket, others))
        if self._on_wall:
            time.sleep(max(0.0, self._ticked_s + 1.0 / self._scene.rate_hz - now))
        self._ticked_s = time.monotonic()
