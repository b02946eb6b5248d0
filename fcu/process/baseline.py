"""The law that flies on when the law of a vehicle fails: PX4's cascade with the gains of the airframe.

Made only where MR_LAW_ACT asks for it. It is compiled before the vehicle is ready, and it is told
nothing of the law that failed but the last command.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fcu.interface.airframe import AirframeFile
from fcu.kernel.buffers import size, to_buffer
from fcu.kernel.pointers import Pointer
from fcu.laws import loader
from fcu.laws.px4.handover import resume
from fcu.parameters import Parameters
from fcu.process.burst import Flight
from fcu.process.configuration import pinned
from fcu.vehicle.conditions import NO_MODEL

NAME = "px4"
Row = np.ndarray[Any, np.dtype[np.float64]]


class Baseline:
    """A law that waits."""

    def __init__(self, airframe: AirframeFile, h: float) -> None:
        """`h`: control period, s. Raises AirframeError, ParameterError."""
        law = loader.load(NAME)
        file = pinned(airframe, law)
        self._ticks, self._module = law.ticks, law.settings
        self._whole = law.settings.settings(file.rotors, file.tables, round(1.0 / h, 6))
        self._settings: Row = to_buffer(self._whole)
        self.compiled: Pointer | None = None

    def compile(self, flight: Flight) -> None:
        """Compile the law, and what it begins with."""
        self.compiled = self._ticks.compiled()
        remembered = np.zeros(size(self._ticks.Remembered))
        resume(
            self._settings, flight.setpoint, 0.0, flight.measured, np.full(8, np.nan), remembered
        )

    def foresee(self, params: Parameters) -> None:
        """Work out the shares without each of the rotors."""
        params.foresee(self._module, self._whole)

    def share(self, params: Parameters) -> None:
        """Have the law share its work as the vehicle's own does, among the rotors that are left."""
        self._settings[:] = to_buffer(params.of_what_is_left(self._module, self._whole)[1])

    def take(self, flight: Flight, age: float) -> tuple[Flight, bool]:
        """The same flight by this law, and True if it goes on from the last command.

        age : of the setpoint, s.
        """
        remembered = np.zeros(size(self._ticks.Remembered))
        goes_on = resume(
            self._settings, flight.setpoint, age, flight.measured, flight.thrusts, remembered
        )
        made = flight._replace(
            settings=self._settings, remembered=remembered, model=NO_MODEL.copy(),
            baseline=np.zeros(size(self._ticks.Tick)),
        )  # fmt: skip
        return made, bool(goes_on)
