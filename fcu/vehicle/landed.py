"""Whether the vehicle stands on the ground, from what the controller knows of it.

In the air a vehicle at rest carries its own weight. One that is at rest while its rotors push
with less than half of what they pushed with in flight is carried by something else. That holds
in every mode, and it cannot end an offboard take-off: landing is only concluded after a flight.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fcu.interface.messages import VehicleState
from fcu.kernel.rows import column_of, slice_of

Row = np.ndarray[Any, np.dtype[np.float64]]

SLOW = 0.25  # m/s, of a vehicle at rest
HELD_FOR_US = 500_000  # simulation time
STOOD_US = 100_000  # simulation time: what falls is at rest for a quarter of that
LIGHT = 0.5  # of the thrust in flight
LEARNT = 0.01  # of the thrust of one look: two seconds' worth
CLEAR = 0.15  # m above where it stood: in the air whatever the rotors do

_Z, _V = column_of(VehicleState, "r_E.z"), slice_of(VehicleState, "v_E")
_OMEGA = slice_of(VehicleState, "Omega")


class Landed:
    """The detector. Unknown (taken for landed) until the first state was seen."""

    def __init__(self, c_T: float, T_first: float) -> None:
        """`c_T`: believed thrust coefficient. `T_first`: thrust (N) expected in flight before one."""
        self._c_T = c_T
        self._T_flight = T_first
        self._since_us: int | None = None
        self._stood_at = math.nan  # height at which it was last seen standing
        self.ground = math.nan  # height (m, E) at which it has stood for a while
        self.landed = True
        self.has_flown = False  # since it was last on the ground for certain

    @property
    def light(self) -> float:
        """Thrust (N) of rotors that do not carry the vehicle, by far."""
        return 0.5 * LIGHT * self._T_flight

    def see(self, state: Row, time_us: int) -> bool:
        """One look, some 50 times a second; whether it is on the ground."""
        Omega, v = state[_OMEGA], state[_V]
        T = self._c_T * float(Omega @ Omega)
        still = float(v @ v) < SLOW * SLOW
        height = float(state[_Z])
        carried = LIGHT * self._T_flight < T  # by its rotors
        if self.landed:
            first = math.isnan(self._stood_at)
            if first:
                self._stood_at = height
            if not still:
                self._since_us = None
            elif self._since_us is None:
                self._since_us = time_us
            elif time_us - self._since_us >= STOOD_US:
                self.ground = self._stood_at
            if height > self._stood_at + CLEAR or (first and carried):
                self.landed, self.has_flown, self._since_us = False, True, None
        elif carried or not still:
            self._since_us = None
            if still:  # at rest in the air: what it takes to stay there
                self._T_flight += LEARNT * (T - self._T_flight)
        else:
            self._since_us = time_us if self._since_us is None else self._since_us
            if time_us - self._since_us >= HELD_FOR_US:
                self.landed, self._stood_at = True, height
        return self.landed
