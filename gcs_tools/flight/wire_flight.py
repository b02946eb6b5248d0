"""A flight over the wire: both processes started, the mission sent by UDP."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from fcu.interface import handover
from fcu.interface.link import PortBusy
from fcu.kernel.buffers import size
from gcs_tools.flight.ground_script import Vehicle
from gcs_tools.flight.interrupts import interrupts_wait
from gcs_tools.flight.item_script import Flyer
from gcs_tools.flight.pair import Pair
from gcs_tools.flight.processes import Collector, InfrastructureError, Started, Take, one_core
from gcs_tools.flight.publisher_process import Zenoh
from gcs_tools.flight.scenario import OF_MISSIONS, Scenario
from gcs_tools.flight.scripted_flight import Flown, ScriptedFlight

STALL_S = 7.0  # wall: neither process complains, and still no tick is flown
DRAIN_S = 2.0  # wall: for rows that are still in the pipes of a process that has ended


class WireFlight(ScriptedFlight):
    """The pair of processes of one flight, and what they have flown so far."""

    LINK_CLOCK = "sim"  # by which a stream of setpoints is lost (fcu --link-clock)

    def __init__(
        self,
        scene: Scenario,
        folder: Path,
        instance: int,
        speed: float | None,
        on_rows: tuple[Take, Take],
        progress: Callable[[float], None],
        zenoh: Zenoh | None = None,
        flies: dict[str, Any] | None = None,
        note: Callable[[str], None] = lambda text: None,
        starting: Callable[[], None] = lambda: None,
    ) -> None:
        """`speed` None: as fast as it goes.  `on_rows`: takes plant rows, takes fcu rows.

        `progress` is told the simulation time flown, s. `zenoh`: how it is published, None: not;
        `flies`: what is then said of it. `note` is told what does not end the flight.
        `starting` is called while the processes start.
        """
        super().__init__(scene, on_rows, progress)
        self._zenoh = zenoh
        self._flies = flies or {}
        self._note, self._starting = note, starting
        self._folder = folder
        self._instance = instance
        self._speed = speed

    def fly(self) -> Flown:
        """The whole flight. Raises InfrastructureError; what was flown is then in `flown`."""
        began = time.monotonic()
        try:
            with interrupts_wait() as interrupts, ExitStack() as stack:
                self._control = self._start(stack, interrupts.look)
                fly_on = self._led(stack)
                startup = time.monotonic() - began
                first = time.monotonic()
                arrived = fly_on()
                wall = time.monotonic() - first
                self._collector.go_on()
                said = self._pair.stop()
                if problem := said.get("publisher", {}).get("problem"):
                    self._note(f"diagnostics: {problem}")
        except OSError as error:
            where = error.filename or self._folder
            raise InfrastructureError(f"{where}: {error.strerror or error}") from error
        if self._collector.error is not None:
            raise InfrastructureError(str(self._collector.error))
        flown = self.flown()
        return replace(flown, arrived=arrived, startup_s=startup, wall_time_s=wall, said=said)

    # --- starting

    def _start(self, stack: ExitStack, look: Callable[[], None]) -> int:
        """Start the pair; where to grant it time. `look` raises what has interrupted us."""
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
        self._pair: Started
        self._pair = pair = Pair(
            stack, self._folder, self._instance, self._scene.flown,
            self._scene.airframe, self._zenoh, self._flies, look, self._starting,
        )  # fmt: skip
        own = [
            word
            for name, value in OF_MISSIONS.items()
            if name not in self._scene.parameters
            for word in ("--param", f"{name}={value:g}")
        ]
        why = pair.start(
            self._scene,
            ["--link-clock", self.LINK_CLOCK, keep, "--record-fd", str(fcu_in), *own],
            ["--speed", speed, keep, "--record-fd", str(plant_in), "--control-fd", str(grants_out)],
            (fcu_in,), (plant_in, grants_out),
        )  # fmt: skip
        self._collector.start()  # after those who are forked: a copy has no threads
        if why:
            self._note(f"flown without diagnostics: {why}")
        if self._speed is None:
            core = self._instance % (os.cpu_count() or 1)
            if pair.publisher is not None:
                pair.publisher.keep_off(core)
            stack.enter_context(one_core(core, pair.children, self._collector))
        return grants_in

    def _led(self, stack: ExitStack) -> Callable[[], bool]:
        """Meet the vehicle. The result flies it, and tells whether it arrived."""
        vehicle = self._meet(stack)
        return lambda: self._send_setpoints(vehicle)

    def _meet(self, stack: ExitStack) -> Flyer:
        try:
            vehicle = Vehicle(self._instance)
        except PortBusy as error:
            raise InfrastructureError(str(error.strerror)) from error
        stack.callback(vehicle.close)
        vehicle.on_wait = self._pair.check
        self._arm(vehicle)
        return vehicle

    # --- flying

    def _fly_to(self, tick: int) -> bool:
        with suppress(BrokenPipeError):  # the plant is gone: the check below says why
            os.write(self._control, handover.GRANT.pack(tick))
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

    def _wait_for_rows(self, tick: int) -> None:
        def are_here() -> bool:
            return self._ticks(self._fcu_rows.last) >= tick

        # in real time they may have been dropped
        until = time.monotonic() + (STALL_S if self._speed is None else DRAIN_S)
        while not self._collector.wait_for(are_here, 0.1) and time.monotonic() < until:
            self._pair.check()

    def _has_ended(self) -> bool:
        """Whether the plant has, because the flight is over: its last rows may be on their way."""
        if self._pair.children[-1].process.poll() != 0:
            return False
        self._collector.wait_for(lambda: self._plant_fd in self._collector.ended, DRAIN_S)
        return self._is_over()
