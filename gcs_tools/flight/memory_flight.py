"""A flight in this process: the same flight controller and the same simulator, joined in memory.

Nothing of them is left out: the ground script's datagrams, the autopilot and what it says, the plant
link's datagrams and their checksums. What two processes have beside it is sockets, pipes and the
wall clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from fcu.interface import event_log, options
from fcu.interface.diagnostics import PlantTiming
from fcu.interface.event_log import Event
from fcu.interface.link import MemoryNetwork
from fcu.interface.ports import owner, ports
from fcu.interface.publisher_feed import PublisherFeed
from fcu.interface.recorder_pipe import Tape
from fcu.kernel.compile import is_cached
from fcu.kernel.rows import column
from fcu.laws.loader import Law
from fcu.mavlink.definitions import Autopilot as ShownAs
from fcu.mavlink.framing import Source
from fcu.mavlink.geodesy import Origin
from fcu.mavlink.plant_link import LONGEST, fault_in_words
from fcu.parameters import Parameters
from fcu.process.autopilot import TIMES, Autopilot, Lost
from fcu.process.reporting import Reporter, row_width
from fcu.services.view import Identity
from gcs_tools.flight.ground_script import ME, Vehicle
from gcs_tools.flight.interrupts import interrupts_wait
from gcs_tools.flight.processes import InfrastructureError, Rows, Take
from gcs_tools.flight.scenario import OF_MISSIONS, Scenario
from gcs_tools.flight.scripted_flight import Flown, ScriptedFlight
from gcs_tools.flight.vehicle_loop import BEGUN, ENDED, FILTERED, LEFT, RAISED, together
from sitl_plant import burst
from sitl_plant.burst import WIDTH, Progress
from sitl_plant.simulator import Simulator

BATCH = 512  # rows that are handed over at once, and the most ticks between two looks
INSTANCE = 0  # whose port numbers and MAVLink identity it has; no port of the system is opened


class MemoryFlight(ScriptedFlight):
    """Flight controller and simulator of one flight, and what they have flown so far.

    Telemetry is sent while a script waits for it: under way there is nobody to read it.
    """

    def __init__(
        self, scene: Scenario, folder: Path | None, on_rows: tuple[Take, Take],
        progress: Callable[[float], None] = lambda time_s: None,
    ) -> None:  # fmt: skip
        """`folder`: where logs and events are written. None: events are in what `fly` returns.

        `on_rows`: takes plant rows, takes fcu rows. `progress` is told the time flown, s.
        """
        super().__init__(scene, on_rows, progress)
        self._folder = folder
        self._network = MemoryNetwork()
        self._at = ports(INSTANCE)
        self._datagram = np.zeros(LONGEST, dtype=np.uint8)
        self._times = np.zeros((BATCH, TIMES))
        self._no_row = np.zeros((1, WIDTH))
        self._failed = False  # whoever takes rows
        self._look: Callable[[], None] = lambda: None  # raises what has interrupted us
        self._has_ended = False
        self._told: list[Event] = []  # where no log is written

    def fly(self) -> Flown:
        """The whole flight. Raises LawError; InfrastructureError: what was flown is in `flown`."""
        began = time.monotonic()
        with ExitStack() as stack:
            interrupts = stack.enter_context(interrupts_wait())
            self._look = interrupts.look
            with nullcontext() if is_compiled(self._scene.flown) else interrupts.at_once():
                vehicle = self.begin(stack)
            first = time.monotonic()
            arrived = self._send_setpoints(vehicle)
            wall = time.monotonic() - first
        flown = self.flown()
        return replace(
            flown,
            arrived=arrived,
            startup_s=first - began,
            wall_time_s=wall,
            told=tuple(self._told),
        )

    def begin(self, stack: ExitStack) -> Vehicle:
        """Make both, and have the vehicle armed and flying the first setpoint: its ground script.

        `stack`: ends them. Raises LawError, InfrastructureError.
        """
        self._make(stack)
        vehicle = self.meet()
        stack.callback(vehicle.close)
        self._arm(vehicle)
        return vehicle

    def meet(self, port: int | None = None, me: Source = ME) -> Vehicle:
        """A ground script; `port`: its own, of the ground station's link; None: the script's."""
        at = self._at
        if port is None:
            link = self._network.link(at.script, at.fcu_script, owner("script"))
        else:
            link = self._network.link(port, at.fcu_station, "another script")
        vehicle = Vehicle(INSTANCE, link, me)
        vehicle.on_wait = self._serve
        return vehicle

    def _make(self, stack: ExitStack) -> None:
        scene, law, at = self._scene, self._scene.flown, self._at
        identity = Identity(at.system_id, ShownAs.PX4, Origin(*options.ORIGIN), scene.airframe.drag)
        self._fcu_tape = Tape(row_width(law), BATCH, partial(self._keep, 1))
        self._plant_tape = Tape(WIDTH, BATCH, partial(self._keep, 0))
        stack.callback(self._flush)
        reporter = Reporter(
            law, self._fcu_tape, PublisherFeed(None, "fcu", law.identity), identity.drag
        )
        self._autopilot = Autopilot(
            at, identity, Parameters(scene.settings, at.system_id, None, law, scene.airframe, {**OF_MISSIONS, **scene.parameters}), reporter,
            clock="sim", bind=self._network.socket, write=self._log(stack, "fcu"),
            fly_decided=self._fly_decided,
        )  # fmt: skip
        stack.callback(self._autopilot.close)
        self._simulator = Simulator(
            scene.world,
            at.system_id,
            self._log(stack, "plant"),
            scene.wind,
            scene.faults,
            scene.layers,
        )
        self._plant_timing = column(Progress, self._simulator.plant.progress, "timing")
        self._simulator.warm_up()
        self._autopilot.warm_up()
        self._hold()

    def _log(self, stack: ExitStack, who: str) -> Callable[[Event], None]:
        """Writes the events of a process, or keeps them. A file that cannot be written does not end a flight."""
        if self._folder is None:
            return self._told.append
        log = self._folder / f"{who}.log"
        try:
            files = [
                stack.enter_context(path.open("w", buffering=1))
                for path in (log, event_log.beside(log))
            ]
        except OSError as error:
            raise InfrastructureError(f"{error.filename}: {error.strerror}") from error

        def write(event: Event) -> None:
            for file, text in zip(
                files, (event_log.line(event), event_log.as_line(event)), strict=True
            ):
                with suppress(OSError):
                    file.write(f"{text}\n")

        return write

    # --- time

    def _serve(self) -> None:
        """While time stands: what the ground script has sent."""
        now = time.monotonic()
        for port in self._autopilot.ground.ports:
            self._autopilot.serve(port, now)
        self._fail()
        self._autopilot.idle(now)

    def _fail(self) -> None:
        """Have the simulator break what the flight controller asks it to."""
        ground = self._autopilot.ground
        if ground.failure is not None:
            ground.failure.result = self._simulator.fail(ground.failure.order)
            ground.failure_is_over()

    def _fly_to(self, tick: int) -> bool:
        while self._simulator.tick < tick and not self._has_ended:
            self._look()
            try:
                self._fly_on(tick)
            except Lost as error:
                self._autopilot.say("error", str(error))
                raise InfrastructureError(f"the flight controller ended: {error}") from error
        self._hold()
        self._progress(self._simulator.time_s)
        return not self._has_ended

    def _wait_for_rows(self, tick: int) -> None:
        """They are here: `_hold` has handed them over."""

    def _fly_on(self, tick: int) -> None:
        """Some ticks, to this one at most, and what they have ended with."""
        autopilot, simulator = self._autopilot, self._simulator
        simulator.draw_noise()
        autopilot.prepare()
        left = 1 if autopilot.ground.is_pending else tick - simulator.tick
        plant_rows, fcu_rows = self._plant_tape.free()[:left], self._fcu_tape.free()[:left]
        self._plant_timing[:] = PlantTiming(
            sequence=simulator.tick, published=time.time(), late=0.0, slips=0, resent=0,
            unrecorded=0, unpublished=0,
        )  # fmt: skip
        began = time.monotonic()
        flown, why, left_over = self._call(plant_rows, fcu_rows)
        now = time.monotonic()
        if flown:
            times = self._times[:flown]
            cycle = (now - began) / flown  # of a tick of both
            times[:] = now, cycle, cycle * self._scene.rate_hz
            autopilot.completed(fcu_rows[:flown], times)
        self._plant_tape.done(flown + (why in BEGUN))
        if why == ENDED:
            self._has_ended = True
            simulator.say("warning", simulator.end(left_over))
        elif why in (LEFT, FILTERED):
            self._decide(left_over, why == FILTERED, now)
        elif why == RAISED:
            self._answer(autopilot.law_failed(now))
        elif why in BEGUN:
            raise refused(left_over)
        if autopilot.ground.is_pending:
            autopilot.idle(now)

    def _call(self, plant_rows: Rows, fcu_rows: Rows, decided_us: int = -1) -> tuple[int, int, int]:
        flown: tuple[int, int, int] = together(
            self._autopilot.flight, self._autopilot.law_at, self._simulator.plant,
            self._datagram, plant_rows, fcu_rows, decided_us,
        )  # fmt: skip
        return flown

    def _fly_decided(self, time_us: int, row: Rows) -> bool:
        return self._call(self._no_row, row[None], time_us)[1] != RAISED

    def _decide(self, length: int, filtered: bool, now: float) -> None:
        """A tick at which something happens: Python decides."""
        answer = self._autopilot.decide(self._datagram[:length].tobytes(), filtered, now)
        assert answer is not None, "no state is lost, repeated or torn in memory"
        self._answer(answer)

    def _answer(self, answer: bytes) -> None:
        """Give the simulator the answer to a tick that Python has decided."""
        received = np.frombuffer(answer, dtype=np.uint8)
        self._datagram[: len(received)] = received
        fault = burst.finish(self._simulator.plant, self._datagram, len(received))
        if fault != burst.FLOWN:
            raise refused(fault)
        self._autopilot.report()

    def _hold(self) -> None:
        """Time stands: what was flown is handed over, and the controller told."""
        self._plant_tape.flush()
        if not self._has_ended:  # the simulator of a mission is gone then, and tells nothing more
            self._autopilot.decide(self._simulator.hold(), False, time.monotonic())

    # --- rows

    def _keep(self, which: int, rows: Rows) -> None:
        (self._plant_rows, self._fcu_rows)[which].append(rows)
        if self._failed:
            return
        try:
            self._on_rows[which](rows.copy())
        except Exception as error:
            self._failed = True
            raise InfrastructureError(str(error)) from error

    def _flush(self) -> None:
        """Hand over what is left of a flight that was cut short."""
        for tape in (self._plant_tape, self._fcu_tape):
            tape.flush()


def is_compiled(law: Law) -> bool:
    """Whether what such a flight runs is compiled already."""
    return law.is_cached() and is_cached("together")


def refused(fault: int) -> InfrastructureError:
    """The simulator cannot fly what the controller has answered: why, by `sitl_plant.burst.finish`."""
    return InfrastructureError(f"the flight controller's answer: {fault_in_words(fault)}")
