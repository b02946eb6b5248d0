"""The simulator's main loop: it owns simulation time and waits for the controller at every tick.

The loop sends a state, waits for the command computed from that state, and then integrates. If
no answer comes, the loop sends the state again, then ends the run and logs the cause; it never
substitutes zeros. The process that started the simulator may hold time: it writes run-until
grants to a pipe. When the controller asks for a reset, another simulator begins, at the start and
at time 0: whatever happens in a world happens again.

At full speed compiled code flies bursts of ticks (`burst`), and returns here for everything else.
Here a tick is flown with the same kernels: in real time, while the controller is slow, where
there is no libc to call, and whenever a burst has stopped between a state and its answer.
"""

from __future__ import annotations

import gc
import os
import select
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fcu.interface import event_log
from fcu.interface.diagnostics import PlantTiming
from fcu.interface.event_log import Event, Said
from fcu.interface.faults import LINK, Fault, Kind
from fcu.interface.handover import GRANT, granted
from fcu.interface.link import UdpLink
from fcu.interface.ports import Ports, owner
from fcu.interface.publisher_feed import PublisherFeed
from fcu.interface.recorder_pipe import RecorderPipe
from fcu.interface.status_texts import Code, Told
from fcu.kernel import system
from fcu.kernel.rows import column
from fcu.mavlink.plant_link import WireError
from sitl_plant import burst
from sitl_plant.burst import WIDTH, Progress
from sitl_plant.pacing import Pacer
from sitl_plant.physics import dynamics
from sitl_plant.physics.wind.layers import Layers
from sitl_plant.physics.world import World
from sitl_plant.simulator import Simulator, say

__all__ = ["INFRASTRUCTURE", "WIDTH", "Figures", "Server", "say"]

RESEND_S, WARN_S, END_S = 0.1, 1.0, 5.0  # wall-clock timeouts for an answer from the controller
WAIT_S = 0.02  # of these, what compiled code waits before it returns here
AT_ONCE = 256  # datagrams that are read without a look at the clock: a flood delays nothing else
OK, INFRASTRUCTURE = 0, 3
ANSWERED_HOLD = (
    "the flight controller has answered a keep-alive: what begins with a HEARTBEAT is no tick, and is"
    " not answered"
)


@dataclass
class Figures:
    """Counters of the loop, reported at the end."""

    ticks: int = 0
    resent: int = 0
    refused: int = 0  # datagrams that could not be decoded as answers
    stale: int = 0  # answers to the state of another tick
    strangers: int = 0  # datagrams from senders other than the flight controller
    unanswered: bool = False  # it ended because the flight controller was silent
    flight_ended: str = ""  # how the flight ended, if the vehicle crashed or diverged
    time_s: float = 0.0  # simulation time at the end
    resets: int = 0
    unpublished: int = 0  # rows dropped because the publisher's buffer was full


class Server:
    """One vehicle's simulator, and after a reset the next, from the first datagram to the end."""

    def __init__(
        self,
        ports: Ports,
        world: World,
        tape: RecorderPipe,
        feed: PublisherFeed,
        pacer: Pacer,
        control: int | None = None,
        lifeline: int | None = None,
        burst_ticks: int = sys.maxsize,
        stays: bool = False,
        announce: Callable[[dict[str, Any]], None] = lambda said: None,
        write: Callable[[Event], None] = event_log.write,
        wind: burst.Buffer | None = None,
        ordered: Sequence[Fault] = (),
        layers: Layers | None = None,
    ) -> None:
        """`control`: file descriptor of the grants, or None to let time run freely.

        `lifeline`: a file descriptor. Its end of file ends the flight. `burst_ticks`: ticks that
        compiled code flies at once, at most what is left of the recorder's batch. `stays`: when a
        flight ends it holds time until a reset. `announce`: told of resets, and of such an end.
        `write`: takes an event. `wind`, `ordered`, `layers`: as for `burst.plant`.
        Raises PortBusy, FieldError.
        """
        self._lifeline = lifeline
        self._world, self._wind, self._system = world, wind, ports.system_id
        self._ordered, self._layers = ordered, layers
        self._stays = stays
        self._announce = announce
        self._write = write
        self._tape = tape
        self._feed = feed
        self.pacer = pacer
        self._control = control
        self._controller_port = ports.fcu_plant
        self._link = UdpLink(ports.plant, ports.fcu_plant, owner("plant"))
        others = tuple(fd for fd in (control, lifeline) if fd is not None)
        self._wire = burst.wire(self._link.fileno(), -1, others)
        self._burst_ticks = burst_ticks
        self._bursts = system.HAS_LIBC and not pacer.paced
        self.figures = Figures()
        self.stopping = False
        self._begin_flight()

    def _begin_flight(self) -> None:
        self._simulator = Simulator(
            self._world, self._system, self._write, self._wind, self._ordered, self._layers
        )
        self._plant = self._simulator.plant
        self._timing = column(Progress, self._plant.progress, "timing")
        self._granted = 0 if self._control is not None else sys.maxsize
        # of the link: a tick is then flown here
        self._torn = [each for each in self._ordered if each.kind in LINK]
        self._quick = (
            self._bursts and not self._torn
        )  # whether compiled code is to fly the next tick
        self._sent = b""  # the state of the tick before
        self._unusable = ""  # why the last answer to this tick's state was rejected
        self._elsewhere = 0  # answers to other states that have come instead of this tick's
        self._reset_asked = False
        self._misled = False  # whether a keep-alive was answered

    def warm_up(self) -> None:
        """Compile the functions that a tick calls."""
        self._simulator.warm_up()
        if self._bursts:
            burst.serve(self._plant, self._wire, np.zeros((1, WIDTH)), 0)

    def run(self) -> int:
        """Run until the flight ends or a stop is requested; returns the exit code."""
        poll = select.poll()
        poll.register(self._link.fileno(), select.POLLIN)
        if self._control is not None:
            os.set_blocking(self._control, False)
            poll.register(self._control, select.POLLIN | select.POLLHUP)
        if self._lifeline is not None:
            poll.register(self._lifeline, select.POLLIN | select.POLLHUP)
        gc.collect()
        gc.freeze()
        gc.disable()
        code = OK
        if self._bursts:
            self._link.let_wait(WAIT_S)
        try:
            while not self.stopping:
                if self._reset_asked:
                    self._reset()
                    continue
                if self._is_held:
                    self._hold(poll)
                    if self._misled:
                        self._say("error", ANSWERED_HOLD)
                        code = INFRASTRUCTURE
                        break
                    continue
                self._feed.find(time.monotonic())
                self.pacer.wait()
                self._simulator.draw_noise()
                flown = self._serve() if self._quick else self._begin()
                self.figures.ticks = self._simulator.tick
                if flown.why == burst.ENDED:
                    self._end(flown.status)
                    if self._stays:
                        continue
                    break
                if flown.why == burst.OTHERS:
                    self._look(poll)
                elif flown.why == burst.SLOW:
                    self._quick = False
                elif flown.why in burst.WAITING:
                    is_over = not self._exchange(poll, flown)
                    self._tape.done()  # not before: who reads a row may rely on its answer
                    if is_over:
                        code = OK if self.stopping else INFRASTRUCTURE
                        break
            self._tape.flush()
        except BrokenPipeError:
            self._say("error", "the recorder has closed its pipe")
            code = INFRASTRUCTURE
        self.figures.time_s = self._simulator.time_s
        self.figures.strangers = self._link.count_strangers()
        self._link.close()
        self.figures.unpublished = self._feed.dropped
        self._feed.close()
        return code

    def _say(self, level: str, said: Said) -> None:
        """An event, for the log and for whoever listens to the publisher."""
        self._feed.event(self._simulator.say(level, said))

    @property
    def _rotors(self) -> int:
        """How many rotors the vehicle has."""
        return int(self._world.params.airframe.n)

    def _tell_time(self) -> None:
        """Set what the rows of the next ticks tell of time and of losses."""
        self._timing[:] = PlantTiming(
            sequence=self._simulator.tick, published=time.time(), late=self.pacer.late_s,
            slips=self.pacer.slips, resent=self.figures.resent,
            unrecorded=self._tape.dropped, unpublished=self._feed.dropped,
        )  # fmt: skip

    def _serve(self) -> burst.Burst:
        """Fly a burst of ticks in compiled code."""
        self._tell_time()
        self._plant.progress[burst.GRANT] = self._granted
        if self._feed.fileno() != self._wire.feed:
            self._wire = self._wire._replace(feed=self._feed.fileno())
        rows = self._tape.free()
        flown: burst.Burst = burst.serve(self._plant, self._wire, rows, self._burst_ticks)
        if flown.unpublished:
            self._feed.missed(flown.unpublished, rows[flown.rows - 1] if flown.unsent else None)
        if complete := flown.rows - (flown.why in burst.WAITING):
            self._tape.done(complete)
        return flown

    def _begin(self) -> burst.Burst:
        """Begin one tick here: record the true state, and send what is reported of it."""
        self._tell_time()
        row = self._tape.row()
        length, status = burst.begin(self._plant, row, self._wire.outbox)
        self._feed.send(row)
        asked = time.monotonic()
        ended = status != dynamics.FLYING
        if ended:
            self._tape.done()
        else:
            self._send_state(self._wire.outbox[:length].tobytes())
        return burst.Burst(
            why=burst.ENDED if ended else burst.BEGUN, rows=1, status=status, length=length,
            received=0, asked=asked, unpublished=0, unsent=False,
        )  # fmt: skip

    def _send_state(self, state: bytes) -> None:
        """Send the state of a tick for the first time, as faults of the link leave it."""
        struck = {each.kind: each.size for each in self._torn if self._strikes(each)}
        if Kind.LINK_LATE in struck:
            time.sleep(struck[Kind.LINK_LATE].b)
        if Kind.LINK_LOST not in struck:  # else it is sent again, without an answer
            self._link.send(state)
            if Kind.LINK_DOUBLED in struck:
                self._link.send(state)
            if Kind.LINK_REORDERED in struck and self._sent:
                self._link.send(self._sent)
        self._sent = state

    def _strikes(self, fault: Fault) -> bool:
        """Return true if a fault of the link holds at this tick, and is drawn for it."""
        if not fault.since_us <= self._simulator.time_us < fault.until_us:
            return False
        drawn = np.random.default_rng(
            [int(self._world.seed), int(fault.kind), self._simulator.tick]
        )
        return bool(drawn.uniform() < fault.size.a)

    def _end(self, status: int) -> None:
        self._say("warning", self._simulator.end(status))
        self.figures.flight_ended = how = self._simulator.flight_ended
        if self._stays:
            self._announce({"flight_ended": how, "time_s": self._simulator.time_s})

    def _reset(self) -> None:
        """Begin again, and then say so: what is sent after that is of the new flight."""
        self._tape.flush()
        self._begin_flight()
        self._simulator.warm_up()
        self.pacer.restart()
        self.figures.resets += 1
        self.figures.flight_ended = ""
        self._feed.reset()
        self._say("info", Told(Code.PLANT_RESET))
        self._link.send(self._simulator.codec.pack_reset_done())
        self._announce({"reset": self.figures.resets})

    def _look(self, poll: select.poll) -> None:
        """Read what has come for others than the link."""
        for fd, _ in poll.poll(0):
            if fd == self._lifeline:
                self.stopping = True
            elif fd == self._control:
                self._read_grants()

    def _exchange(self, poll: select.poll, begun: burst.Burst) -> bool:
        """Finish a tick with the answer to its state; False if none will come."""
        datagram = self._wire.outbox[: begun.length].tobytes()
        self._unusable, self._elsewhere = "", 0
        if begun.why == burst.NOT_SENT:
            self._link.send(datagram)
        elif begun.why == burst.UNEXPECTED:
            self._is_answer(self._wire.inbox[: begun.received].tobytes())
        waiting = asked = begun.asked
        warned, first = False, self._simulator.tick == 0
        while not (self.stopping or self._reset_asked):
            for fd, _ in poll.poll(RESEND_S * 1000):
                if fd == self._lifeline:
                    self.stopping = True
                elif fd == self._control:
                    self._read_grants()
                    continue
                for _ in range(AT_ONCE):
                    if (answer := self._link.receive()) is None:
                        break
                    if self._is_answer(answer):
                        took = time.monotonic() - waiting
                        quick = took < burst.QUICK_S and not self._torn
                        self._quick = self._bursts and quick
                        return True
            now = time.monotonic()
            if now - asked >= RESEND_S:
                asked = now
                self.figures.resent += 1
                self._link.send(datagram)
            silent = now - waiting
            if silent >= WARN_S and not warned:
                warned = True
                if first:
                    self._say("info", f"waiting for a flight controller of {self._rotors} rotors")
                else:
                    self._say("warning", self._what_is_wrong(WARN_S))
            if silent >= END_S and not (first and self._control is None):
                self._say("error", self._what_is_wrong(END_S))
                self.figures.unanswered = not self._unusable
                return False
        return self._reset_asked

    def _what_is_wrong(self, seconds: float) -> str:
        if self._unusable:
            return f"no valid answer for {seconds:.0f} s; rejected the last one: {self._unusable}"
        if self._elsewhere:
            return (
                f"no answer for {seconds:.0f} s to the state of {self._simulator.time_us} us, and"
                f" {self._elsewhere} to others"
            )
        silent = f"the flight controller has been silent for {seconds:.0f} s"
        if strangers := self._link.count_strangers():
            silent += f"; {strangers} datagrams came from other ports than {self._controller_port}"
        return silent

    def _is_answer(self, datagram: bytes) -> bool:
        """Fly to the next tick if this is the answer to the state of this one; else count it."""
        inbox = self._wire.inbox
        inbox[: len(datagram)] = np.frombuffer(datagram, dtype=np.uint8)
        verdict = burst.finish(self._plant, inbox, len(datagram))
        if verdict == burst.STALE:
            self.figures.stale += 1
            self._elsewhere += 1
        elif verdict != burst.FLOWN:
            self._refuse(datagram)
        self.figures.ticks = self._simulator.tick
        return bool(verdict == burst.FLOWN)

    def _refuse(self, datagram: bytes) -> None:
        """Count a datagram that is no answer, and remember why; or hear that a reset is asked for."""
        if self._simulator.codec.is_reset(datagram):
            self._reset_asked = True
            return
        if self._fails(datagram):
            return
        try:
            self._simulator.codec.parse_controls(datagram, self._plant.command)
        except WireError as error:
            self.figures.refused += 1
            if self.figures.refused == 1:
                self._say("warning", f"plant link: {error}")
            self._unusable = str(error)

    def _fails(self, datagram: bytes) -> bool:
        """Break or mend what a datagram orders, and answer it. Return false for another datagram."""
        answer = self._simulator.answer_failure(datagram)
        if answer is not None:
            self._link.send(answer)
        return answer is not None

    @property
    def _is_held(self) -> bool:
        """Whether time stands: until more is granted, or, once the flight has ended, a reset."""
        return bool(self._simulator.flight_ended) or self._simulator.tick >= self._granted

    def _hold(self, poll: select.poll) -> None:
        """Hold time: flush the recorder, send keep-alives to the controller, wait for a grant."""
        self._tape.flush()
        self.pacer.restart()
        while self._is_held and not self._is_called:
            self._feed.find(time.monotonic())
            self._link.send(self._simulator.hold())
            self._link.count_strangers()
            until = time.monotonic() + RESEND_S
            while self._is_held and not self._is_called:
                left = until - time.monotonic()
                if left <= 0.0:
                    break
                for fd, _ in poll.poll(left * 1000):
                    if fd == self._control:
                        self._read_grants()
                    elif fd == self._lifeline:
                        self.stopping = True
                    elif (datagram := self._link.receive()) is not None:
                        if self._fails(datagram):
                            continue
                        self._reset_asked |= self._simulator.codec.is_reset(datagram)
                        self._misled = self._misled or self._is_early(datagram)

    @property
    def _is_called(self) -> bool:
        """Whether something else is to be done than to hold time."""
        return self.stopping or self._reset_asked or self._misled

    def _is_early(self, datagram: bytes) -> bool:
        """Whether it answers the state of the tick that comes next, which has not been sent yet.

        Were it taken for that answer when time goes on, wall time would be part of the flight.
        """
        try:
            time_us, _, _ = self._simulator.codec.parse_controls(datagram, self._plant.command)
        except WireError:
            return False
        of_next = time_us == self._simulator.time_us and not self._simulator.flight_ended
        return of_next and not self.figures.resets  # after one it may be of the flight before

    def _read_grants(self) -> None:
        assert self._control is not None
        try:
            data = os.read(self._control, GRANT.size * 64)
        except BlockingIOError:
            return
        if not data:
            self.stopping = True  # the process that held time has ended
            return
        for (number,) in GRANT.iter_unpack(data[: len(data) // GRANT.size * GRANT.size]):
            flight, ticks = granted(number)
            if flight == self.figures.resets:  # else it came too late for its flight
                self._granted = ticks
