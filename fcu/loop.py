"""The flight controller's loop: a state arrives, the law runs, a command goes back.

The plant paces the loop: a tick starts when its state arrives, so there is never a tick of
delay between a measurement and the command computed from it. Between ticks the ground links
are served. Nothing here blocks but the wait for the next datagram.
"""

from __future__ import annotations

import gc
import select
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface.link import UdpLink
from fcu.interface.messages import Setpoint, VehicleState
from fcu.interface.ports import Ports, owner
from fcu.interface.starter import log
from fcu.interface.status_texts import Code, Told, words
from fcu.kernel.buffers import fields, size, to_buffer
from fcu.kernel.rows import column_of, slice_of
from fcu.laws.face import Reference, SharedTick
from fcu.mavlink.definitions import Severity
from fcu.mavlink.plant_link import PlantCodec, WireError
from fcu.parameters import Parameters
from fcu.reporting import Reporter
from fcu.services.station import Station
from fcu.services.streams import Identity
from fcu.tick import FLYING, IDLE, TAKE_OVER
from fcu.vehicle.position_filter import PositionFilter
from fcu.vehicle.state_machine import StateMachine

WARN_S, END_S = 1.0, 5.0  # wall: a plant that has spoken and falls silent
JUMPS = 10  # states in a row of a wrong time, after which there is no going on
OK, INFRASTRUCTURE = 0, 3
LOAD_SMOOTHED = 1.0 / 256.0

_COMMAND = slice_of(SharedTick, "command")
_R_AND_V = slice(slice_of(VehicleState, "r_E").start, slice_of(VehicleState, "v_E").stop)


@dataclass
class Figures:
    """What the loop counted, for whoever asks at the end."""

    ticks: int = 0
    resent: int = 0
    refused: int = 0  # datagrams of the plant link that were not states, or of a wrong time
    strangers: int = 0  # datagrams on the plant link that were not the plant's
    cycle_max_us: float = 0.0
    dropped: int = 0  # rows that the recorder had no room for
    unpublished: int = 0  # rows that the publisher had no room for
    ground_dropped: dict[str, int] | None = None  # messages of the ground links, by reason


class Loop:
    """One flight controller, from its first datagram to its end."""

    def __init__(
        self, ports: Ports, identity: Identity, params: Parameters, reporter: Reporter,
        lifeline: int | None, sim_only: bool = False, file: Path | None = None,
    ) -> None:  # fmt: skip
        """`lifeline`: a file descriptor whose end of file ends the loop.

        `sim_only`: a script's stream is lost by simulation time alone. `file`: where parameters
        are saved. Raises PortBusy.
        """
        self._params = params
        self._law = params.flown
        self._fly: Any = self._law.ticks.tick
        self._settings = params.settings
        self._settings_buffer = to_buffer(self._settings)
        self._reporter = reporter
        self._lifeline = lifeline
        self._plant = UdpLink(ports.fcu_plant, ports.plant, owner("fcu_plant"))
        self._codec = PlantCodec(ports.system_id)
        self.vehicle = StateMachine(params, sim_only)
        self._ground = Station(
            ports, identity, params, self.vehicle, file,
            self._say,
        )  # fmt: skip
        self.figures = Figures()
        self.stopping = False
        self._setpoint = np.zeros(size(Setpoint))
        self._flown: Setpoint | None = None
        self._engaged = IDLE
        self._received = np.zeros(size(VehicleState))
        self._filter = PositionFilter()
        self._measured = self._filter.flown
        self._period_us = round(params.law.h * 1e6)
        self._jumps = 0
        remembers = self._law.ticks.Remembered
        self._remembered = np.zeros(size(remembers))
        if fields(fields(remembers)["law"]).get("reference") is Reference:
            reference = self._remembered[slice_of(remembers, "law.reference")]
            self.vehicle.reference_model = reference
        self._answer = b""
        self._time_us = -1
        self._heard = 0.0
        self._load = 0.0
        self._exit = OK

    def warm_up(self) -> None:
        """Compile what a tick needs, by flying one that goes nowhere."""
        row, remembered = np.zeros(self._reporter.width), np.zeros_like(self._remembered)
        measured = np.zeros(size(VehicleState))
        measured[column_of(VehicleState, "q_EB.w")] = 1.0
        PositionFilter().pass_on(measured, 0.002, 0)
        with self._law.compiling():
            for engaged in (IDLE, TAKE_OVER, FLYING):
                self._fly(
                    0.0, engaged, remembered, self._settings_buffer, self._setpoint, 0.0,
                    measured, row,
                )  # fmt: skip
        self._reporter.warm_up(row)
        self.vehicle.warm_up()
        self.vehicle.state = measured
        self._ground.warm_up(row)
        self.vehicle.state = None

    def run(self) -> int:
        """Fly until told to stop; returns the exit code."""
        poll = select.poll()
        plant_fd = self._plant.fileno()
        by_fd = {port.fileno(): port for port in self._ground.ports}
        for fd in (plant_fd, *by_fd):
            poll.register(fd, select.POLLIN)
        if self._lifeline is not None:
            poll.register(self._lifeline, select.POLLIN | select.POLLHUP)
        gc.collect()
        gc.freeze()
        gc.disable()
        warned = False
        while not self.stopping:
            for fd, _ in poll.poll(20):
                if fd == plant_fd:
                    self._serve_plant()
                elif fd in by_fd:
                    self._ground.serve(by_fd[fd], self._next_us(), time.monotonic())
                else:
                    self.stopping = True  # whoever started us is gone
            now = time.monotonic()
            self._ground.idle(self._next_us(), now)
            self._reporter.idle(self._time_s, self._settings, now)
            if self._heard:
                silent = now - self._heard
                if silent > END_S:
                    self._tell_silence("error", END_S, Code.PLANT_SILENT_STOPS)
                    self._exit = INFRASTRUCTURE
                    break
                if silent > WARN_S and not warned:
                    self._tell_silence("warning", WARN_S)
                warned = silent > WARN_S
        self._close()
        return self._exit

    # --- the plant

    def _serve_plant(self) -> None:
        # one datagram a call: whether there is another, poll says for less than a refused read
        datagram = self._plant.receive()
        if datagram is None:
            return
        started = time.perf_counter()
        try:
            time_us = self._codec.parse_state(datagram, self._received)
        except WireError as error:
            self.figures.refused += 1
            if self.figures.refused == 1:
                self._say("warning", f"plant link: {error}")
            return
        if not self._heard:
            self._say("info", "the plant is there")
        self._heard = time.monotonic()
        if self._codec.is_hold(datagram):
            if self._time_us < 0:
                self._filter.take(self._received)
                if self.vehicle.reference_model is not None:  # it is where the vehicle is
                    self.vehicle.reference_model[:] = self._measured[_R_AND_V]
                self.vehicle.battery = self._codec.battery
                self._say_all(self.vehicle.observe(self._measured, 0, self._heard))
            self._flush()  # time stands: what was flown so far is due
        elif time_us == self._time_us:  # our answer was lost
            self.figures.resent += 1
            self._plant.send(self._answer)
        elif time_us < self._time_us:
            self._say("error", f"time ran back from {self._time_us * 1e-6:.6f} s")
            self._exit, self.stopping = INFRASTRUCTURE, True
        elif self._time_us >= 0 and time_us - self._time_us != self._period_us:
            self.figures.refused += 1
            self._jumps += 1
            if self._jumps == JUMPS:
                self._say("error", f"time jumped from {self._time_us * 1e-6:.6f} s")
                self._exit, self.stopping = INFRASTRUCTURE, True
        else:
            self._jumps = 0
            self._time_us = time_us
            if self.vehicle.armed and not self.vehicle.on_ground:
                wrong = self._filter.pass_on(self._received, self._settings.law.h, time_us)
                if wrong:
                    self._say_all(wrong)
            else:
                self._filter.take(self._received)
            self.vehicle.battery = self._codec.battery
            self._tick(time_us, started)

    def _tick(self, time_us: int, started: float) -> None:
        t = time_us * 1e-6
        vehicle, row = self.vehicle, self._reporter.tape.row()
        happened = vehicle.observe(self._measured, time_us, self._heard)
        if happened:
            self._say_all(happened)
        if self._params.settings is not self._settings:  # somebody has set a parameter
            self._settings = self._params.settings
            self._settings_buffer = to_buffer(self._settings)
        setpoint = vehicle.setpoint
        if setpoint is None:
            self._engaged = IDLE
        elif self._engaged == IDLE:
            self._engaged = TAKE_OVER
        else:
            self._engaged = FLYING
        if setpoint is not self._flown and setpoint is not None:
            self._setpoint[:] = to_buffer(setpoint)
        self._flown = setpoint
        age = (time_us - vehicle.since_us) * 1e-6
        self._fly(
            t, self._engaged, self._remembered, self._settings_buffer, self._setpoint, age,
            self._measured, row,
        )  # fmt: skip
        self._answer = self._codec.pack_controls(time_us, row[_COMMAND], vehicle.armed, True)
        self._plant.send(self._answer)
        cycle = time.perf_counter() - started
        self._load += LOAD_SMOOTHED * (cycle / self._settings.law.h - self._load)
        self.figures.ticks += 1
        self._ground.see(row, setpoint is not None, self._load, self._filter.off)
        try:
            self._reporter.report(
                row, vehicle, self._filter.off, cycle, self._load, self.figures.resent,
                self.figures.refused,
            )  # fmt: skip
        except BrokenPipeError:
            self._unrecorded()

    def _say_all(self, happened: Sequence[Told]) -> None:
        for told in happened:
            self._ground.tell(told)

    def _tell_silence(self, level: str, for_s: float, code: Code = Code.PLANT_SILENT) -> None:
        self._say(level, f"the plant has been silent for {for_s:.0f} s")
        self._ground.streams.text(Severity.CRITICAL, words(Told(code, (for_s,))))

    def _flush(self) -> None:
        try:
            self._reporter.tape.flush()
        except BrokenPipeError:
            self._unrecorded()

    def _unrecorded(self) -> None:
        self._say("error", "nobody records this flight any more")
        self._exit, self.stopping = INFRASTRUCTURE, True

    # --- the ground

    def _next_us(self) -> int:
        """When what arrives now takes effect: at the next tick. While time stands, the one to come."""
        return 0 if self._time_us < 0 else self._time_us + self._period_us

    @property
    def _time_s(self) -> float:
        return max(self._time_us, 0) * 1e-6

    def _say(self, level: str, text: str) -> None:
        """A line of log, and an event for whoever listens to the publisher."""
        say(self._time_us, level, text)
        self._reporter.feed.event(self._time_s, level, text)

    def _close(self) -> None:
        self._flush()
        self.figures.cycle_max_us = self._reporter.cycle_max_s * 1e6
        self.figures.dropped = self._reporter.tape.dropped
        self.figures.unpublished = self._reporter.feed.dropped
        self.figures.strangers = self._plant.count_strangers()
        self.figures.ground_dropped = self._ground.dropped()
        self._plant.close()
        self._ground.close()
        self._reporter.feed.close()


def say(time_us: int, level: str, text: str) -> None:
    """One line of log an event: simulation time, level, process."""
    stamp = f"{time_us * 1e-6:10.3f}" if time_us >= 0 else f"{'-':>10}"
    log(f"{stamp} {level:<7} fcu  {text}")
