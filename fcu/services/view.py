"""What the vehicle can tell a ground station of itself, at one moment.

One View a telemetry round: what several messages need is worked out once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from fcu.interface.messages import Battery, VehicleState
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import from_buffer
from fcu.kernel.rotations import euler, matrix
from fcu.kernel.rows import column
from fcu.laws.mmrac.types import Internals, LawParams, LawState, Tick
from fcu.mavlink.geodesy import Geodetic, Origin, to_geodetic
from fcu.parameters import Parameters
from fcu.vehicle.supervisor import Supervisor
from fcu.vehicle.wind import Wind

Row = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class Identity:
    """Who the vehicle is to ground stations, from its start to its end."""

    system_id: int
    autopilot: int  # MAV_AUTOPILOT
    origin: Origin  # of local positions
    drag: Vec3  # believed, N/(m/s)^2: only the wind that is shown depends on it


@dataclass
class Counters:
    """What the loop knows for SYS_STATUS and ESTIMATOR_STATUS."""

    load: float = 0.0  # fraction of the control period that a tick takes
    errors: int = 0  # messages of ground stations that were dropped
    position_off: float = 0.0  # m: how far the plant's is off; 0: it is believed


@dataclass
class View:
    """The vehicle at one tick. `row` is the Tick just flown, or zeros before the first."""

    identity: Identity
    vehicle: Supervisor
    params: Parameters
    wind: Wind
    row: Row
    measured: VehicleState
    t: float  # simulation time, s
    flying: bool  # whether the law ran at this tick
    counters: Counters = field(default_factory=Counters)

    @property
    def law(self) -> LawParams:
        """The law's parameters in force."""
        return self.params.law

    @property
    def battery(self) -> Battery | None:
        """As last reported; None if the plant has none."""
        return self.vehicle.battery

    @cached_property
    def state(self) -> LawState:
        """What the law remembers after this tick."""
        state: LawState = from_buffer(LawState, column(Tick, self.row, "state"))
        return state

    @cached_property
    def internals(self) -> Internals:
        """What the law computed at this tick."""
        internals: Internals = from_buffer(Internals, column(Tick, self.row, "internals"))
        return internals

    @cached_property
    def angles(self) -> Vec3:
        """Roll, pitch, yaw, rad."""
        angles: Vec3 = euler(matrix(self.measured.q_EB))
        return angles

    @cached_property
    def place(self) -> Geodetic:
        """Where it is on Earth."""
        return to_geodetic(self.identity.origin, self.measured.r_E)

    @property
    def commanded(self) -> list[float]:
        """Rotor speeds as commanded, over full speed, 0 to 1."""
        commanded: list[float] = column(Tick, self.row, "command").tolist()
        return commanded

    @property
    def home(self) -> Vec3:
        """Where a return flies to, m, E."""
        return self.vehicle.home or self.measured.r_E

    @cached_property
    def ground_speed(self) -> float:
        """m/s."""
        return math.hypot(self.measured.v_E.x, self.measured.v_E.y)

    @cached_property
    def throttle(self) -> float:
        """Achieved total thrust over full thrust, 0 to 1, by the believed coefficient."""
        Omega = self.measured.Omega
        T = self.law.c_T * sum(float(w) * float(w) for w in Omega)
        return T / self.law.T_max
