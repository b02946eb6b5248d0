"""A mission on its way, whatever carries it: its setpoints sent as a ground script would send them.

Simulation time stands whenever the script has something to say. It stops at that tick, the
setpoint is sent, its echo awaited, and time goes on: the wall time a script takes cannot leak into
the flight.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fcu.interface.event_log import Event
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import size
from fcu.kernel.rows import column_of, slice_of
from gcs_tools.flight.arrival import arrival, stands_from
from gcs_tools.flight.flown_rows import FlownRows
from gcs_tools.flight.ground_script import SetpointRefused, VehicleError
from gcs_tools.flight.item_script import SEND_AGAIN_S, Flyer, ItemScript, Seen
from gcs_tools.flight.processes import InfrastructureError, Rows, Take
from gcs_tools.flight.scenario import Scenario
from gcs_tools.judging.script_check import ScriptFlown
from gcs_tools.missions.timeline import LANDS, Begun
from sitl_plant.physics import dynamics
from sitl_plant.physics.types import PlantRecord

_STILL = Vec3(0.0, 0.0, 0.0)
_ENDED, ON_GROUND, HEIGHT = (
    column_of(PlantRecord, name) for name in ("ended", "on_ground", "state.r_E.z")
)
FELL = "fell"  # how a flight ends whose rotors were stopped in the air
AIRBORNE_M = 0.15  # a vehicle so high above the ground is in the air
_R_E, _V_E = (slice_of(PlantRecord, f"state.{name}") for name in ("r_E", "v_E"))


@dataclass
class Flown:
    """What a flight left behind."""

    plant: Rows
    fcu: Rows
    arrived: bool = False
    begun: tuple[Begun, ...] = ()  # legs of the mission's items
    done: str = ""  # how a flight ends whose items are done: landed, done; or refused, fell; empty: none of it
    refusal: str = ""  # what the vehicle would not do
    script: ScriptFlown | None = None  # of a mission that names one
    startup_s: float = 0.0
    wall_time_s: float = 0.0
    said: dict[str, dict[str, Any]] = field(default_factory=dict)  # each process's last words
    told: tuple[Event, ...] = ()  # events of a flight that keeps no log

    @property
    def ended(self) -> str:
        """How the flight ended, if it was not cut short, as `Result.ended`."""
        if self.done:
            return self.done
        how = self.plant[-1, _ENDED] if len(self.plant) else dynamics.FLYING
        words = dynamics.ENDED
        return "arrived" if self.arrived else words.get(how, "time")


class ScriptedFlight(ABC):
    """One flight of a mission, and what it has flown so far."""

    def __init__(
        self, scene: Scenario, on_rows: tuple[Take, Take], progress: Callable[[float], None]
    ) -> None:
        """`on_rows`: takes plant rows, takes fcu rows, as they come.

        `progress` is told the simulation time flown, s.
        """
        self._scene = scene
        self._progress = progress
        self._kinds = scene.kinds
        self._engaged = column_of(self._kinds.tick, "engaged")
        self._on_rows = on_rows
        self._items: ItemScript | None = None
        self._plant_rows = FlownRows(size(PlantRecord), scene.ticks + 1)  # and how it ended
        self._fcu_rows = FlownRows(size(self._kinds.tick), scene.ticks)

    @abstractmethod
    def fly(self) -> Flown:
        """The whole flight. Raises InfrastructureError; what was flown is then in `flown`."""

    @abstractmethod
    def _fly_to(self, tick: int) -> bool:
        """Let time run to `tick`; False if the flight has ended before."""

    @abstractmethod
    def _wait_for_rows(self, tick: int) -> None:
        """Until the rows of both are here up to `tick`, which was flown."""

    def flown(self) -> Flown:
        """Everything that has arrived so far."""
        plant, fcu = self._plant_rows.rows, self._fcu_rows.rows
        if len(plant) < self._ticks(plant) or len(fcu) < self._ticks(fcu):
            plant, fcu = in_step(plant, fcu)
        n = min(len(plant), len(fcu))
        fell = FELL * has_fallen(plant[:n], fcu[:n, self._engaged] > 0.0)
        script = self._items
        if script is None:
            return Flown(plant, fcu, done=fell)
        lands = self._scene.legs[-1].kind in LANDS
        done = "refused" if script.refusal else ("landed" if lands else "done") * script.is_done
        return Flown(plant, fcu, False, tuple(script.begun), fell or done, script.refusal)

    def _arm(self, vehicle: Flyer) -> None:
        """Armed, and flying the first setpoint; of items on the ground, ready. Raises InfrastructureError."""
        try:
            if self._scene.legs:
                self._items = ItemScript(self._scene, vehicle, self._fly_to, self._look_at)
                self._items.begin()
                return
            vehicle.wait_ready()
            for _ in range(2):  # one setpoint is not a stream yet
                vehicle.set_setpoint(self._scene.sent[0])
            vehicle.offboard()
            vehicle.arm()
        except VehicleError as error:
            raise InfrastructureError(str(error)) from error

    def _send_setpoints(self, vehicle: Flyer) -> bool:
        """Let time run up to each setpoint, send it, and on; whether the vehicle arrived.

        One that the vehicle refuses is not sent again: the one before is, as long as it would be.
        Of items: all of them.
        """
        if self._items is not None:
            try:
                self._items.fly()
            except VehicleError as error:
                raise InfrastructureError(str(error)) from error
            return False
        scene, again = self._scene, round(SEND_AGAIN_S * self._scene.rate_hz)
        flown, refused, is_lost = scene.sent[0], None, False
        look_at = math.inf if scene.arrive is None else stands_from(scene)
        for k, setpoint, last in schedule(scene):
            if not self._fly_to(k):
                return False
            if k >= look_at or (last and scene.arrive is not None):
                look_at = k + again
                self._wait_for_rows(k)
                rows = self.flown()
                if arrival(scene, rows.plant, rows.fcu) is not None:
                    return True
            if k >= scene.ticks:
                break
            if not scene.hears(k):
                is_lost = True
                continue
            if is_lost:
                is_lost = False
                self._take_up_again(vehicle, flown, k)
            wanted = flown if refused is not None and _goes_on(setpoint, refused) else setpoint
            try:
                try:
                    vehicle.set_setpoint(wanted, k / scene.rate_hz)
                    flown = wanted
                except SetpointRefused:  # the verdict says so
                    refused = setpoint
                    vehicle.set_setpoint(flown, k / scene.rate_hz)
            except VehicleError as error:
                raise InfrastructureError(str(error)) from error
        return False

    def _take_up_again(self, vehicle: Flyer, setpoint: Setpoint, tick: int) -> None:
        """Stream again once the ground link is back, and ask for the mode that flies the stream."""
        try:
            for _ in range(2):  # one setpoint is not a stream yet
                vehicle.set_setpoint(setpoint, tick / self._scene.rate_hz)
            vehicle.offboard()
        except VehicleError as error:
            raise InfrastructureError(str(error)) from error

    def _look_at(self, tick: int) -> Seen:
        """What is so at the last tick before `tick`, or at the last one that was kept."""
        self._wait_for_rows(tick)
        plant, fcu = (rows.last[0] for rows in (self._plant_rows, self._fcu_rows))
        r_E, v_E = (Vec3(*plant[each].tolist()) for each in (_R_E, _V_E))
        return Seen(r_E, v_E, bool(fcu[self._engaged] > 0.0), bool(plant[ON_GROUND] > 0.5))

    def _ticks(self, rows: Rows) -> int:
        """The tick after the last of `rows`: their number, if none was dropped."""
        return round(rows[-1, 0] * 1e6 / self._scene.period_us) + 1 if len(rows) else 0

    def _flown_ticks(self) -> int:
        """Ticks that the plant has flown, each with the controller's answer."""
        return self._ticks(self._plant_rows.last)

    def _is_over(self) -> bool:
        """Whether the plant's last row says that the flight has ended."""
        return bool((self._plant_rows.last[:, _ENDED] != dynamics.FLYING).any())


def is_aloft(plant: Rows) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Tell for each row of the plant if the vehicle was in the air.

    It is more than AIRBORNE_M above the place where it touches the ground next, or touched it last.
    """
    on_ground, height = plant[:, ON_GROUND] > 0.5, plant[:, HEIGHT]
    at = np.flatnonzero(on_ground)
    if not len(at):
        return ~on_ground
    following = np.minimum(np.searchsorted(at, np.arange(len(plant))), len(at) - 1)
    found: np.ndarray[Any, np.dtype[np.bool_]] = height > height[at[following]] + AIRBORNE_M
    return found


def has_fallen(plant: Rows, runs: np.ndarray[Any, np.dtype[np.bool_]]) -> bool:
    """Return True if rotors that ran were stopped in the air. `runs`: they run, at each row."""
    begun = int(runs.argmax()) if runs.any() else len(runs)
    if runs[begun:].all():
        return False
    return bool((is_aloft(plant) & ~runs)[begun:].any())


def _goes_on(setpoint: Setpoint, refused: Setpoint) -> bool:
    """Whether a setpoint asks again for what was refused: the same place, or more of a curve."""
    return setpoint.r_c == refused.r_c or setpoint.v_c != _STILL


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
