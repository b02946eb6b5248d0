"""The simulator's main loop: it owns simulation time and waits for the controller at every tick.

The loop sends a state, waits for the command computed from that state, and then integrates. If
no answer comes, the loop sends the state again, then ends the run and logs the cause; it never
substitutes zeros. The process that started the simulator may hold time: it writes run-until
grants to a pipe.
"""

from __future__ import annotations

import gc
import os
import select
import sys
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from fcu.interface.diagnostics import PlantTiming, plant_row
from fcu.interface.handover import GRANT
from fcu.interface.link import UdpLink
from fcu.interface.messages import Battery, RotorCommand, VehicleState
from fcu.interface.ports import Ports, owner
from fcu.interface.publisher_feed import PublisherFeed
from fcu.interface.recorder_pipe import RecorderPipe
from fcu.interface.starter import log
from fcu.kernel.buffers import from_buffer, size, to_buffer
from fcu.kernel.rows import column, slice_of
from fcu.mavlink.plant_link import PlantCodec, WireError
from sitl_plant.pacing import Pacer
from sitl_plant.physics import dynamics, tick
from sitl_plant.physics.battery import BatteryState
from sitl_plant.physics.types import PlantRecord
from sitl_plant.physics.world import World

RESEND_S, WARN_S, END_S = 0.1, 1.0, 5.0  # wall-clock timeouts for an answer from the controller
OK, INFRASTRUCTURE = 0, 3
ENDINGS = {dynamics.DIVERGED: "diverged (left the arena)", dynamics.CRASHED: "hit the ground"}
BATTERY_HZ = 10.0  # of simulation time
_NOISE_BLOCK = 4096  # rows drawn at once

PlantRow = plant_row(PlantRecord)
WIDTH = size(PlantRow)  # float64 in a row
_TIMING = slice_of(PlantRow, "timing")

Buffer = np.ndarray[Any, np.dtype[np.float64]]


@dataclass
class Figures:
    """Counters of the loop, reported at the end."""

    ticks: int = 0
    resent: int = 0
    refused: int = 0  # datagrams that could not be decoded as answers
    stale: int = 0  # answers to the state of another tick
    strangers: int = 0  # datagrams from senders other than the flight controller
    flight_ended: str = ""  # how the flight ended, if the vehicle crashed or diverged
    time_s: float = 0.0  # simulation time at the end
    unpublished: int = 0  # rows dropped because the publisher's buffer was full


class Server:
    """One simulator, from its first datagram to its end."""

    def __init__(
        self,
        ports: Ports,
        world: World,
        tape: RecorderPipe,
        feed: PublisherFeed,
        pacer: Pacer,
        control: int | None = None,
        lifeline: int | None = None,
    ) -> None:
        """`control`: file descriptor of the grants, or None to let time run freely.

        `lifeline`: a file descriptor; its end of file ends the flight. Raises PortBusy.
        """
        self._lifeline = lifeline
        self._world = world
        self._tape = tape
        self._feed = feed
        self.pacer = pacer
        self._control = control
        self._link = UdpLink(ports.plant, ports.fcu_plant, owner("plant"))
        self._codec = PlantCodec(ports.system_id, world.params.airframe.spin)
        self._params = to_buffer(world.params)
        self._start = to_buffer(world.start)
        self._state = self._start.copy()
        self._drawn = np.zeros(size(BatteryState))
        self._command = np.zeros(size(RotorCommand))
        self._reported = np.zeros(size(VehicleState))
        self._past: deque[Buffer] = deque(maxlen=int(world.delay_ticks) + 1)
        self._random = np.random.default_rng(int(world.seed))
        self._noise = np.zeros((0, tick.NOISE))
        self._noise_at = 0
        self._period_us = round(1e6 / world.rate_hz)
        self._battery: Battery | None = None  # the last battery report
        self._battery_ticks = max(1, round(world.rate_hz / BATTERY_HZ))
        self._granted = 0 if control is not None else sys.maxsize
        self._tick = 0
        self._unusable = ""  # why the last answer to this tick's state was rejected
        self.figures = Figures()
        self.stopping = False

    def warm_up(self) -> None:
        """Compile the functions that a tick calls."""
        state, row = self._start.copy(), np.zeros(WIDTH)
        drawn = self._drawn.copy()
        tick.observe(self._params, state, drawn, 0.0, self._start, row)
        self._battery = from_buffer(
            Battery, column(PlantRecord, row, "battery")
        )  # for the first keep-alive
        tick.sense(state, np.zeros(tick.NOISE), self._reported)
        tick.advance(self._params, state, drawn, self._command, 0.0, self._world.steps)

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
        try:
            while not self.stopping:
                if self._tick >= self._granted:
                    self._hold(poll)
                    continue
                self._feed.find(time.monotonic())
                self.pacer.wait()
                if not self._observe():
                    break
                if not self._exchange(poll):
                    code = OK if self.stopping else INFRASTRUCTURE
                    break
                t = self._tick * self._period_us * 1e-6
                tick.advance(
                    self._params, self._state, self._drawn, self._command, t, self._world.steps
                )  # fmt: skip
                self._tick += 1
                self.figures.ticks += 1
            self._tape.flush()
        except BrokenPipeError:
            self._say("error", "the recorder has closed its pipe")
            code = INFRASTRUCTURE
        self.figures.time_s = self._time_s
        self.figures.strangers = self._link.count_strangers()
        self._link.close()
        self.figures.unpublished = self._feed.dropped
        self._feed.close()
        return code

    def _say(self, level: str, text: str) -> None:
        """Write a log line, and send it as an event to the publisher."""
        say(self._time_s, level, text)
        self._feed.event(self._time_s, level, text)

    @property
    def _time_s(self) -> float:
        return self._tick * self._period_us * 1e-6

    def _observe(self) -> bool:
        """Record the true state and prepare the report; False if the flight has ended."""
        row = self._tape.row()
        ended = tick.observe(
            self._params, self._state, self._drawn, self._time_s, self._start, row
        )  # fmt: skip
        if self._reports_battery:
            self._battery = from_buffer(Battery, column(PlantRecord, row, "battery"))
        self._hand_on(row)
        if ended != dynamics.FLYING:
            what = ENDINGS[ended]
            self.figures.flight_ended = what
            self._say("warning", f"the flight ended: the vehicle {what}")
            return False
        self._past.append(self._state.copy())
        tick.sense(self._past[0], self._next_noise(), self._reported)
        return True

    def _hand_on(self, row: Buffer) -> None:
        """Complete the row of this tick and pass it to the recorder and the publisher."""
        row[_TIMING] = PlantTiming(
            sequence=self._tick, published=time.time(), late=self.pacer.late_s,
            slips=self.pacer.slips, resent=self.figures.resent,
            unrecorded=self._tape.dropped, unpublished=self._feed.dropped,
        )  # fmt: skip
        self._feed.send(row)
        self._tape.done()

    @property
    def _reports_battery(self) -> bool:
        return self._tick % self._battery_ticks == 0

    def _next_noise(self) -> Buffer:
        if self._noise_at == len(self._noise):
            shape = (_NOISE_BLOCK, tick.NOISE)
            scale = self._world.noise_scale
            self._noise = (
                self._random.standard_normal(shape) * scale if scale.any() else np.zeros(shape)
            )
            self._noise_at = 0
        self._noise_at += 1
        row: Buffer = self._noise[self._noise_at - 1]
        return row

    def _exchange(self, poll: select.poll) -> bool:
        """Send the state and wait for the command computed from it; False if none will come."""
        time_us = self._tick * self._period_us
        battery = self._battery if self._reports_battery else None
        datagram = self._codec.pack_state(time_us, self._reported, battery)
        self._link.send(datagram)
        asked = time.monotonic()
        waiting, warned, first = asked, False, self.figures.ticks == 0
        self._unusable = ""
        while not self.stopping:
            for fd, _ in poll.poll(RESEND_S * 1000):
                if fd == self._lifeline:
                    self.stopping = True
                elif fd == self._control:
                    self._read_grants()
                    continue
                while (answer := self._link.receive()) is not None:
                    if self._is_answer(answer, time_us):
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
                    self._say("info", "waiting for the flight controller")
                else:
                    self._say("warning", self._what_is_wrong(WARN_S))
            if silent >= END_S and not (first and self._control is None):
                self._say("error", self._what_is_wrong(END_S))
                return False
        return False

    def _what_is_wrong(self, seconds: float) -> str:
        if self._unusable:
            return f"no valid answer for {seconds:.0f} s; rejected the last one: {self._unusable}"
        return f"the flight controller has been silent for {seconds:.0f} s"

    def _is_answer(self, datagram: bytes, time_us: int) -> bool:
        try:
            answered, _, _ = self._codec.parse_controls(datagram, self._command)
        except WireError as error:
            self.figures.refused += 1
            if self.figures.refused == 1:
                self._say("warning", f"plant link: {error}")
            self._unusable = str(error)
            return False
        if answered != time_us:
            self.figures.stale += 1
            return False
        return True

    def _hold(self, poll: select.poll) -> None:
        """Hold time: flush the recorder, send keep-alives to the controller, wait for a grant."""
        self._tape.flush()
        self.pacer.restart()
        if self._tick == 0:
            self._reported[:] = self._state
        time_us = self._tick * self._period_us
        while not self.stopping and self._tick >= self._granted:
            self._feed.find(time.monotonic())
            self._link.send(self._codec.pack_hold(time_us, self._reported, self._battery))
            self._link.count_strangers()
            until = time.monotonic() + RESEND_S
            while self._tick >= self._granted and not self.stopping:
                left = until - time.monotonic()
                if left <= 0.0:
                    break
                for fd, _ in poll.poll(left * 1000):
                    if fd == self._control:
                        self._read_grants()
                    elif fd == self._lifeline:
                        self.stopping = True
                    else:
                        self._link.receive()

    def _read_grants(self) -> None:
        assert self._control is not None
        try:
            data = os.read(self._control, GRANT.size * 64)
        except BlockingIOError:
            return
        if not data:
            self.stopping = True  # the process that held time has ended
            return
        for (granted,) in GRANT.iter_unpack(data[: len(data) // GRANT.size * GRANT.size]):
            self._granted = granted


def say(time_s: float, level: str, text: str) -> None:
    """Log one line: simulation time, level, process, text."""
    log(f"{time_s:10.3f} {level:<7} plant {text}")
