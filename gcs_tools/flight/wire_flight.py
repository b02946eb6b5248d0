"""A flight over the wire: both processes started, the mission sent as a ground script would.

Simulation time stands whenever the script has something to say. The plant stops at that
tick, the setpoint is sent, its echo awaited, and time goes on: the wall time a script takes
cannot leak into the flight.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface import handover
from fcu.interface.link import PortBusy
from fcu.interface.messages import Setpoint
from fcu.kernel.buffers import size
from fcu.kernel.rows import column_of
from gcs_tools.flight.ground_script import Vehicle, VehicleError
from gcs_tools.flight.pair import Pair
from gcs_tools.flight.processes import Collector, InfrastructureError, Rows, one_core
from gcs_tools.flight.publisher_process import Zenoh
from gcs_tools.flight.scenario import Scenario, arrival
from gcs_tools.recording.schema import Kinds
from sitl_plant.physics import dynamics
from sitl_plant.physics.types import PlantRecord

STALL_S = 7.0  # wall: neither process complains, and still no tick is flown
DRAIN_S = 2.0  # wall: for rows that are still in the pipes of a process that has ended
SEND_AGAIN_S = 0.9  # simulation time after which a setpoint is sent again, if there is no other

_ENDED = column_of(PlantRecord, "ended")


@dataclass
class Flown:
    """What a flight left behind."""

    plant: Rows
    fcu: Rows
    arrived: bool = False
    startup_s: float = 0.0
    wall_time_s: float = 0.0
    said: dict[str, dict[str, Any]] = field(default_factory=dict)  # each process's last words

    @property
    def ended(self) -> str:
        """How the flight ended, if it was not cut short: time, arrived, diverged, crashed."""
        how = self.plant[-1, _ENDED] if len(self.plant) else dynamics.FLYING
        words = {dynamics.DIVERGED: "diverged", dynamics.CRASHED: "crashed"}
        return "arrived" if self.arrived else words.get(how, "time")


class WireFlight:
    """The pair of processes of one flight, and what they have flown so far."""

    def __init__(
        self,
        scene: Scenario,
        folder: Path,
        instance: int,
        speed: float | None,
        on_rows: tuple[Callable[[Rows], None], Callable[[Rows], None]],
        progress: Callable[[float], None],
        zenoh: Zenoh | None = None,
        flies: dict[str, Any] | None = None,
        note: Callable[[str], None] = lambda text: None,
    ) -> None:
        """`speed` None: as fast as it goes.  `on_rows`: takes plant rows, takes fcu rows.

        `progress` is told the simulation time flown, s. `zenoh`: how it is published, None: not;
        `flies`: what is then said of it. `note` is told what does not end the flight.
        """
        self._zenoh = zenoh
        self._flies = flies or {}
        self._note = note
        self._scene = scene
        self._kinds = Kinds.of(scene.flown)
        self._folder = folder
        self._instance = instance
        self._speed = speed
        self._on_rows = on_rows
        self._progress = progress
        self._plant_rows: list[Rows] = []
        self._fcu_rows: list[Rows] = []

    def flown(self) -> Flown:
        """Everything that has arrived so far."""
        plant = _joined(self._plant_rows, size(PlantRecord))
        fcu = _joined(self._fcu_rows, size(self._kinds.tick))
        if len(plant) < self._ticks(plant) or len(fcu) < self._ticks(fcu):
            plant, fcu = in_step(plant, fcu)
        return Flown(plant, fcu)

    def fly(self) -> Flown:
        """The whole flight. Raises InfrastructureError; what was flown is then in `flown`."""
        began = time.monotonic()
        try:
            with ExitStack() as stack:
                control = self._start(stack)
                vehicle = self._meet(stack)
                startup = time.monotonic() - began
                first = time.monotonic()
                arrived = self._send_setpoints(vehicle, control)
                wall = time.monotonic() - first
                said = self._pair.stop()
                if problem := said.get("publisher", {}).get("problem"):
                    self._note(f"diagnostics: {problem}")
        except OSError as error:
            where = error.filename or self._folder
            raise InfrastructureError(f"{where}: {error.strerror or error}") from error
        flown = self.flown()
        return Flown(flown.plant, flown.fcu, arrived, startup, wall, said)

    # --- starting

    def _start(self, stack: ExitStack) -> int:
        """Start the pair; where to grant it time."""
        plant_out, plant_in = os.pipe()
        fcu_out, fcu_in = os.pipe()
        grants_out, grants_in = os.pipe()
        stack.callback(os.close, grants_in)
        keep = "--wait" if self._speed is None else "--drop"
        speed = "max" if self._speed is None else str(self._speed)
        self._collector = Collector(
            {
                plant_out: (size(self._kinds.plant_row), self._plant_rows, self._on_rows[0]),
                fcu_out: (size(self._kinds.fcu_row), self._fcu_rows, self._on_rows[1]),
            }
        )
        self._plant_fd = plant_out
        stack.callback(self._collector.finish, DRAIN_S)  # takes what they have still handed over
        self._pair = Pair(
            stack, self._folder, self._instance, self._scene.flown, self._zenoh, self._flies
        )
        why = self._pair.start(
            self._scene,
            ["--link-clock", "sim", keep, "--record-fd", str(fcu_in)],
            ["--speed", speed, keep, "--record-fd", str(plant_in), "--control-fd", str(grants_out)],
            (fcu_in,), (plant_in, grants_out),
        )  # fmt: skip
        self._collector.start()  # after those who are forked: a copy has no threads
        if why:
            self._note(f"flown without diagnostics: {why}")
        if self._speed is None:
            core = self._instance % (os.cpu_count() or 1)
            if self._pair.publisher is not None:
                self._pair.publisher.keep_off(core)
            stack.enter_context(one_core(core, self._pair.children, self._collector))
        return grants_in

    def _meet(self, stack: ExitStack) -> Vehicle:
        try:
            vehicle = Vehicle(self._instance)
        except PortBusy as error:
            raise InfrastructureError(str(error.strerror)) from error
        stack.callback(vehicle.close)
        vehicle.on_wait = self._pair.check
        try:
            vehicle.wait_ready()
            for _ in range(2):  # one setpoint is not a stream yet
                vehicle.set_setpoint(self._scene.sent[0])
            vehicle.offboard()
            vehicle.arm()
        except VehicleError as error:
            raise InfrastructureError(str(error)) from error
        return vehicle

    # --- flying

    def _send_setpoints(self, vehicle: Vehicle, control: int) -> bool:
        """Grant time up to each setpoint, send it, and on; whether the vehicle arrived."""
        scene = self._scene
        for k, setpoint, last in schedule(scene):
            if not self._fly_to(control, k):
                return False
            if last and scene.arrive is not None:
                flown = self.flown()
                if arrival(scene, flown.plant, flown.fcu) is not None:
                    return True
            if k >= scene.ticks:
                break
            try:
                vehicle.set_setpoint(setpoint, k / scene.rate_hz)
            except VehicleError as error:
                raise InfrastructureError(str(error)) from error
        return False

    def _fly_to(self, control: int, tick: int) -> bool:
        """Let time run to `tick`; False if the flight has ended before."""
        with suppress(BrokenPipeError):  # the plant is gone: the check below says why
            os.write(control, handover.GRANT.pack(tick))
        seen, since = -1, time.monotonic()
        while True:
            self._collector.wait_for(lambda: self._is_over() or self._flown_ticks() >= tick, 0.1)
            if self._collector.error is not None:
                raise InfrastructureError(str(self._collector.error))
            flown = self._flown_ticks()
            self._progress(flown / self._scene.rate_hz)
            if self._is_over() or self._has_ended():
                return False
            if flown >= tick:
                return True
            self._pair.check()
            if flown != seen:
                seen, since = flown, time.monotonic()
            elif time.monotonic() - since > STALL_S:
                raise InfrastructureError(f"no tick was flown for {STALL_S:.0f} s")

    def _is_over(self) -> bool:
        """Whether the plant's last row says that the flight has ended."""
        return bool(self._plant_rows) and self._plant_rows[-1][-1, _ENDED] != 0.0

    def _has_ended(self) -> bool:
        """Whether the plant has, because the flight is over: its last rows may be on their way."""
        if self._pair.children[-1].process.poll() != 0:
            return False
        self._collector.wait_for(lambda: self._plant_fd in self._collector.ended, DRAIN_S)
        return self._is_over()

    def _ticks(self, rows: Rows) -> int:
        """The tick after the last of `rows`: their number, if none was dropped."""
        return round(rows[-1, 0] * 1e6 / self._scene.period_us) + 1 if len(rows) else 0

    def _flown_ticks(self) -> int:
        """Ticks that the plant has flown, each with the controller's answer."""
        return self._ticks(self._plant_rows[-1]) if self._plant_rows else 0


def _joined(batches: list[Rows], width: int) -> Rows:
    """The first `width` columns of all rows: what was flown, without what was reported of it."""
    return np.concatenate([np.zeros((0, width)), *(rows[:, :width] for rows in batches)])


def schedule(scene: Scenario) -> Iterator[tuple[int, Setpoint, bool]]:
    """(tick, setpoint to send then, whether it is the last one of the mission), to the end.

    Every setpoint of the mission after the first; between them, and after the last, the same one
    again: a vehicle flies a script's setpoints only while they come. One that is sent again
    stands still (those that move are sent more often than that), so it changes nothing.
    """
    again = max(1, round(SEND_AGAIN_S * scene.rate_hz))
    begins = [*scene.sent_at.tolist(), scene.ticks]
    for i, setpoint in enumerate(scene.sent):
        last = i + 1 == len(scene.sent)
        for k in range(begins[i], min(begins[i + 1], scene.ticks), again):
            if k > 0:
                yield k, setpoint, last
    yield scene.ticks, scene.sent[-1], True


def in_step(plant: Rows, fcu: Rows) -> tuple[Rows, Rows]:
    """The ticks that both recorded: real time drops rows rather than wait.

    The plant's last row stays: it says how the flight ended, and may have no answer.
    """
    kept = np.isin(plant[:, 0], fcu[:, 0])
    kept[-1:] = True
    plant = plant[kept]
    return plant, fcu[np.isin(fcu[:, 0], plant[:, 0])]
