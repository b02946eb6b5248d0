"""The flight controller's process: its sockets, and what is due by the wall clock.

The plant paces the loop: a tick starts when its state arrives, so there is never a tick of delay
between a measurement and the command computed from it. Ticks are flown in bursts of compiled code
(`burst`); whenever something else is due, a burst ends and Python serves it. Nothing here blocks
but the wait for the next datagram.
"""

from __future__ import annotations

import gc
import select
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from fcu.interface import event_log
from fcu.interface.event_log import Event
from fcu.interface.link import UdpLink
from fcu.interface.ports import Ports, owner
from fcu.interface.status_texts import Code, Told
from fcu.kernel import system
from fcu.kernel.compile import compile_for
from fcu.mavlink.definitions import Result, Severity
from fcu.mavlink.plant_link import LONGEST
from fcu.parameters import Parameters
from fcu.process.autopilot import TIMES, Autopilot, LawRaised, LinkClock, Lost, Row, say
from fcu.process.burst import BUSY, FILTERED, RAISED, SILENT, SLOW, SLOW_S, UNREAD, Wire, serve
from fcu.process.reporting import Reporter
from fcu.services import tcp_socket
from fcu.services.command_protocol import Failure
from fcu.services.ground_port import GroundPort
from fcu.services.tcp_socket import TcpSocket
from fcu.services.view import Identity
from fcu.vehicle.conditions import ROWS, Condition
from fcu.vehicle.conditions import Row as ConditionRow
from fcu.vehicle.state_machine import StateMachine

__all__ = ["INFRASTRUCTURE", "OK", "Loop", "say"]

SILENCE, LOST = ROWS[Condition.PLANT_SILENT], ROWS[Condition.PLANT_LOST]  # by wall time
PATIENCE_S = 0.02  # wall: how long a burst waits for a state
TURNS = 1000  # of a port before a tick of held time: a flood does not stop the loop
RESET_AGAIN_S, RESET_S = (
    0.1,
    2.0,
)  # wall: a plant is asked to reset, or to fail, so often, for so long
OK, INFRASTRUCTURE = 0, 3


class Loop:
    """One flight controller, from its first datagram to its end."""

    def __init__(
        self, ports: Ports, identity: Identity, params: Parameters, reporter: Reporter,
        lifeline: int | None, clock: LinkClock = "both", file: Path | None = None,
        burst_ticks: int | None = None, resets: bool = False,
        write: Callable[[Event], None] = event_log.write,
    ) -> None:  # fmt: skip
        """`lifeline`: a file descriptor whose end of file ends the loop.

        `clock`: which decides about ground stations. `file`: where parameters are saved.
        `burst_ticks`: the most ticks of a burst. None: as many as the recorder takes at once.
        `resets`: ground stations may reset the vehicle and its plant. `write`: takes an event. Raises PortBusy.
        """
        self._lifeline = lifeline
        self._reporter = reporter
        self._plant = UdpLink(ports.fcu_plant, ports.plant, owner("fcu_plant"))
        self._make = partial(
            Autopilot, ports, identity, params, clock=clock, file=file, resets=resets,
            write=write, fly_decided=self._fly_decided if system.HAS_LIBC else None,
            listen=TcpSocket if tcp_socket.AVAILABLE else None,
        )  # fmt: skip
        self._autopilot = self._make(reporter)
        self._held = clock == "held"
        self._most = burst_ticks
        self._poll, self._heard = select.poll(), select.poll()  # the second: for time that is held
        self._hears_at_ticks = False  # ground stations: once time that is held has begun
        self._reset_since = self._reset_due = 0.0  # wall: the plant was asked to; 0: it was not
        self._reset_late = False  # it was asked to, and did not answer in time: it may yet
        self._fail_since = self._fail_due = 0.0  # wall: likewise, to fail
        self.figures = self._autopilot.figures
        self.stopping = False
        self._datagram = np.zeros(LONGEST, dtype=np.uint8)
        self._wire: Wire | None = None
        self._quick = True  # whether bursts are to be of more than one tick
        self._answered_s = 0.0  # wall: when the last answer was sent; 0: time was held since
        self._times = np.zeros((len(reporter.tape.free()), TIMES))
        self._exit = OK
        self.law_raised: str | None = None  # why there was no going on, if it was that

    def warm_up(self, wait_for_law: Callable[[], None] = lambda: None) -> None:
        """Compile what a tick needs, by flying one that goes nowhere.

        `wait_for_law`: called when all is compiled that does not hold the law.
        """
        reporter = self._reporter
        if system.HAS_LIBC:
            self._plant.let_wait(PATIENCE_S)
            served = [port.fileno() for port in self._autopilot.ground.ports]
            others = served if self._lifeline is None else [*served, self._lifeline]
            self._wire = Wire(
                link=np.array([self._plant.fileno()]), others=system.polled(*others),
                datagram=self._datagram, due=np.zeros(1), scratch=np.zeros(2, dtype=np.int64),
            )  # fmt: skip
            rows, times = np.zeros((1, reporter.width)), self._times[:1]
            compile_for(serve, self._autopilot.flight, 0, self._wire, rows, times, -1)
        reporter.warm_up(np.zeros(reporter.width))
        wait_for_law()
        self._autopilot.warm_up()

    @property
    def vehicle(self) -> StateMachine:
        """The vehicle: another one after a reset."""
        return self._autopilot.vehicle

    def run(self) -> int:
        """Fly until told to stop; returns the exit code."""
        poll = self._poll
        plant_fd, ground_ports = self._plant.fileno(), self._autopilot.ground.ports
        by_fd = {port.fileno(): port for port in ground_ports}  # for good
        for fd in (plant_fd, *by_fd):
            poll.register(fd, select.POLLIN)
        if self._lifeline is not None:
            poll.register(self._lifeline, select.POLLIN | select.POLLHUP)
        gc.collect()
        gc.freeze()
        gc.disable()
        warned = False
        while not self.stopping:
            waiting = self._autopilot.ground.is_waiting and not self._hears_at_ticks
            for fd, _ in poll.poll(0 if waiting else 20):
                if fd == plant_fd:
                    self._fly()
                elif fd not in by_fd:
                    self.stopping = True  # whoever started us is gone
                elif not by_fd[fd].is_waiting and not self._hears_at_ticks:
                    self._listen(by_fd[fd])
            if waiting:  # what they took in before comes first, a time for each port
                for port in ground_ports:
                    if port.is_waiting:
                        self._listen(port)
            now = time.monotonic()
            if self._autopilot.ground.reset_asked:
                self._ask_for_reset(now)
            self._ask_to_fail(now)
            self._autopilot.idle(now)
            if self._autopilot.heard_s:
                silent = now - self._autopilot.heard_s
                if silent > LOST.hold_us * 1e-6:
                    self._tell_silence("error", LOST)
                    self._exit = INFRASTRUCTURE
                    break
                late = silent > SILENCE.hold_us * 1e-6
                if late and not warned:
                    self._tell_silence("warning", SILENCE)
                warned = late
        self._close()
        return self._exit

    def _listen(self, port: GroundPort) -> None:
        """What waits on a port; during a reset it goes on waiting."""
        if not self._autopilot.ground.reset_asked:
            self._autopilot.serve(port, time.monotonic())

    def _listen_at_a_tick(self) -> None:
        """Everything that waits, before a tick of held time. Between ticks nobody is heard any more."""
        ports = self._autopilot.ground.ports
        if not self._hears_at_ticks:
            self._hears_at_ticks = True
            self._autopilot.ground.begin_streams()  # their time begins
            for port in ports:
                self._poll.unregister(port.fileno())
                self._heard.register(port.fileno(), select.POLLIN)
        for _ in range(TURNS):
            ready = {fd for fd, _ in self._heard.poll(0)}
            waiting = [port for port in ports if port.is_waiting or port.fileno() in ready]
            if not waiting:
                break
            for port in waiting:
                self._listen(port)

    # --- a reset

    def _ask_for_reset(self, now: float) -> None:
        """Ask the plant to begin again, and again; if it does not, go on as before, until it does.

        Until it says that it has, its states are of before, and have no answer.
        """
        if not self._reset_since:
            self._reset_since = now
        if now - self._reset_since > RESET_S:
            self._reset_since = self._reset_due = 0.0
            self._reset_late = True
            self._autopilot.ground.forget_reset()
            self._autopilot.ground.tell(Told(Code.NOT_RESET))
        elif now >= self._reset_due:
            self._reset_due = now + RESET_AGAIN_S
            self._plant.send(self._autopilot.codec.pack_reset())

    def _ask_to_fail(self, now: float) -> None:
        """Pass a failure on to the plant, again and again, until it has answered or time is up."""
        failure = self._autopilot.ground.failure
        if failure is None:
            self._fail_since = self._fail_due = 0.0
            return
        again = self._fail_since > 0.0
        if not again:
            self._fail_since = now
        if now - self._fail_since > RESET_S:
            self._fail_is_over(failure, Result.FAILED)
        elif now >= self._fail_due:
            self._fail_due = now + RESET_AGAIN_S
            self._plant.send(
                self._autopilot.codec.pack_failure(failure.order, failure.number, again)
            )

    def _hear_of_failure(self, datagram: bytes) -> bool:
        """Take the plant's answer to a failure. Return false for another datagram."""
        said = self._autopilot.codec.failure_answer(datagram)
        failure = self._autopilot.ground.failure
        if said is not None and failure is not None and failure.number == said[1]:
            self._fail_is_over(failure, said[0])
        return said is not None

    def _fail_is_over(self, failure: Failure, result: Result) -> None:
        failure.result = result
        self._fail_since = self._fail_due = 0.0
        self._autopilot.ground.failure_is_over()

    def _await_reset(self) -> None:
        while (datagram := self._plant.receive()) is not None:
            if self._autopilot.codec.is_reset_done(datagram):
                self._begin_again()
                return

    def _begin_again(self) -> None:
        """As after the start, but for the parameters that were set, and the links."""
        self._reset_since = self._reset_due = self._answered_s = 0.0
        self._reset_late = False
        self._quick = True
        self._reporter.tape.flush()
        self._reporter = self._autopilot.reporter.renewed()
        self._autopilot = self._make(self._reporter, before=self._autopilot)
        self._autopilot.warm_up()
        gc.collect()  # what a reset has left: the objects of before the first flight are frozen
        self._autopilot.ground.tell(Told(Code.RESET))

    # --- the plant

    def _fly(self) -> None:
        """What the plant has sent: a burst of ticks, and what it has ended with."""
        try:
            if self._autopilot.ground.reset_asked:
                self._await_reset()
                return
            if self._held:
                datagram = self._plant.receive()
                if datagram is not None:
                    if self._hear_of_failure(datagram):
                        return
                    if not self._autopilot.codec.is_hold(datagram):
                        self._listen_at_a_tick()
                        self._ask_to_fail(time.monotonic())
                    self._decide(datagram, False)
                return
            if self._wire is None:
                # one datagram a call: whether there is another, poll says for less than a read
                datagram = self._plant.receive()
                if datagram is not None:
                    self._decide(datagram, None)
                return
            why, length = self._serve(self._wire)
            if why in (UNREAD, FILTERED):
                self._decide(self._datagram[:length].tobytes(), why == FILTERED)
        except BrokenPipeError:
            self._end("nobody records this flight any more")
        except Lost as error:
            self.law_raised = str(error) if isinstance(error, LawRaised) else None
            self._end(str(error))

    def _serve(self, wire: Wire) -> tuple[int, int]:
        """Fly a burst; why it ended, and the length of a datagram that it left to Python."""
        autopilot = self._autopilot
        autopilot.prepare()
        one = autopilot.ground.is_pending or not self._quick
        rows = self._reporter.tape.free()[: 1 if one else self._most]
        times = self._times[: len(rows)]
        wire.due[0] = autopilot.due_s
        flown, why, length = serve(autopilot.flight, autopilot.law_at, wire, rows, times, -1)
        if why == BUSY:  # the last answer has not gone out
            self._plant.send(autopilot.answer)
        if flown:
            self._quick = self._is_quick(times[:flown], why)
            autopilot.completed(rows[:flown], times[:flown])
        if why == RAISED:
            self._plant.send(autopilot.law_failed(time.monotonic()))
            autopilot.report()
        return why, length

    def _is_quick(self, times: Row, why: int) -> bool:
        """Whether the plant asks so soon again that it is worth while to wait in compiled code.

        Else Python's poll waits: for ground stations too, and with what was flown handed on.
        """
        (answered, cycle), last = times[0, :2].tolist(), self._answered_s
        self._answered_s = float(times[-1, 0])
        if len(times) > 1 or why == SLOW:
            return why not in (SLOW, SILENT)
        return self._quick if last == 0.0 else answered - cycle - last < SLOW_S

    def _fly_decided(self, time_us: int, row: Row) -> bool:
        autopilot = self._autopilot
        _, why, _ = serve(
            autopilot.flight, autopilot.law_at, self._wire, row[None], self._times[:1], time_us
        )
        return bool(why != RAISED)

    def _decide(self, datagram: bytes, filtered: bool | None) -> None:
        """One datagram; `filtered`: as a burst has left it; None: no burst has seen it."""
        autopilot, now = self._autopilot, time.monotonic()
        if self._hear_of_failure(datagram):
            return
        if autopilot.codec.is_reset_done(datagram):
            if self._reset_late:  # else once more: it was asked more than once
                self._begin_again()
            return
        if filtered is None:
            answer = autopilot.take(datagram, now)
        else:
            answer = autopilot.decide(datagram, filtered, now)
        self._answered_s = 0.0
        if answer is not None:
            self._plant.send(answer)
            autopilot.report()

    def _end(self, why: str) -> None:
        self._autopilot.say("error", why)
        self._exit, self.stopping = INFRASTRUCTURE, True

    def _tell_silence(self, level: str, row: ConditionRow) -> None:
        for_s = row.hold_us * 1e-6
        self._autopilot.ground.hear_again()
        self._autopilot.say(level, Told(Code.LINK_SILENT, (for_s,)))
        self._autopilot.ground.streams.text(Severity[row.severity], Told(row.code, (for_s,)))

    def _close(self) -> None:
        try:
            self._reporter.tape.flush()
        except BrokenPipeError:
            self._end("nobody records this flight any more")
        self.figures.strangers = self._plant.count_strangers()
        ground = self._autopilot.ground
        self.figures.script_messages = sum(
            port.heard for port in ground.ports if port is not ground.station
        )
        self.figures.parameters_set = ground.parameters_set()
        self._autopilot.close()
        self._plant.close()
