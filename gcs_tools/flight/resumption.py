"""A law flown alone in an air that is given tick by tick, which goes on again from any tick that was kept.

The ticks are those of `law_alone.fly` to the bit. What a small change of the air does late in a flight is so
flown without what comes before it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fcu.kernel.buffers import size
from fcu.kernel.rows import column_of
from fcu.laws.loader import LawError
from fcu.mavlink.plant_link import fault_in_words
from fcu.process import burst
from fcu.process.burst import Course
from gcs_tools.flight import law_alone
from gcs_tools.flight.closed_loop import closed
from gcs_tools.flight.scenario import Scenario
from gcs_tools.flight.vehicle_loop import ENDED, RAISED, TICKS
from sitl_plant.burst import NOISE_AT, WIDTH, air_by_tick
from sitl_plant.simulator import Simulator

Rows = np.ndarray[Any, np.dtype[np.float64]]

_SINCE = column_of(Course, "since_us")
_CONSTANT = {"noise", "air", "settings", "desk", "params", "start", "spin"}  # no tick changes them


class Kept(NamedTuple):
    """All that a flight has changed, before a tick."""

    tick: int
    arrays: list[Any]


class Resumption:
    """One flight of a scene. Raises LawError."""

    def __init__(self, scene: Scenario) -> None:
        """`scene`: without items. Its wind is what `air` begins with."""
        if scene.legs:
            raise LawError("a mission of items is flown by a whole vehicle, not by a law alone")
        if scene.layers is not None:
            raise LawError(
                "[wind] layers depend on where the vehicle is: expected steady, sines, step or file"
            )
        self._scene = scene
        self._alone, self._law = law_alone.flight(scene)
        plant = Simulator(scene.world, law_alone.SYSTEM).plant
        noise = scene.noise(scene.ticks)
        if not len(noise):
            noise = np.zeros((scene.ticks, plant.noise.shape[1]))
        self.air = _air_of(scene)
        self._plant = plant._replace(noise=noise, air=plant.air._replace(samples=self.air))
        self._plant.progress[NOISE_AT] = 0.0
        self._changing = [
            array
            for of in (self._alone, self._plant)
            for name, array in of._asdict().items()
            if name not in _CONSTANT and isinstance(array, np.ndarray)
        ]
        self.tick = 0
        self.plant_rows = np.zeros((scene.ticks, WIDTH))
        self.law_rows = np.zeros((scene.ticks, size(scene.flown.ticks.Tick)))
        self.begin = self.keep()

    def keep(self) -> Kept:
        """Everything that `resume` needs to go on from here."""
        return Kept(self.tick, [array.copy() for array in self._changing])

    def resume(self, kept: Kept) -> None:
        """Go back to where something was kept, in an air that may be another since."""
        for array, was in zip(self._changing, kept.arrays, strict=True):
            array[...] = was
        self.tick = kept.tick

    def fly(self, until: int) -> bool:
        """Fly to the tick `until`, and write the rows of these ticks. Returns True if the flight got there."""
        scene, until = self._scene, min(until, self._scene.ticks)
        while self.tick < until:
            k = self.tick
            now = int(np.searchsorted(scene.sent_at, k, side="right")) - 1
            begins = scene.sent_at[now + 1] if now + 1 < len(scene.sent_at) else scene.ticks
            self._alone.setpoint[:] = scene.setpoints[now]
            self._alone.course[_SINCE] = scene.sent_at[now] * scene.period_us
            to = min(int(begins), until)
            flown, why, left = closed(
                self._alone, self._law.address, self._plant, self.plant_rows[k:to],
                self.law_rows[k:to],
            )  # fmt: skip
            self.tick += flown
            if why == ENDED:
                return False
            if why == RAISED:
                raise LawError(
                    burst.what_was_raised(self._law, self._alone, self.law_rows[self.tick])
                )
            if why != TICKS:
                raise LawError(f"tick {self.tick}: {fault_in_words(left)}")
        return True


def _air_of(scene: Scenario) -> Rows:
    """float64[ticks, 3], m/s, E: the steady wind and the samples of a scene at each tick."""
    steady = scene.world.params.wind.steady
    if scene.wind is None:
        return np.tile(np.array(steady), (scene.ticks, 1))
    by_tick = air_by_tick(steady, scene.wind, scene.rate_hz)
    at = np.minimum(np.arange(scene.ticks), len(by_tick) - 1)
    return np.ascontiguousarray(by_tick[at])
