"""The vehicle at one moment, as what it sends is made of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from fcu.guard.types import GuardInternals
from fcu.interface.messages import Battery, VehicleState
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import field_type, from_buffer
from fcu.kernel.rotations import euler, matrix
from fcu.kernel.rows import column
from fcu.laws.face import Outputs, SharedTick
from fcu.mavlink.geodesy import Geodetic, Origin, to_geodetic
from fcu.mavlink.setpoints import AttitudeSetpointMessage, SetpointMessage
from fcu.parameters import Parameters
from fcu.process.tick import Internals, State
from fcu.services.plan_protocol import PlanProtocol
from fcu.services.wind import Wind
from fcu.vehicle.state_machine import StateMachine

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
    vehicle: StateMachine
    params: Parameters
    wind: Wind
    row: Row
    measured: VehicleState
    t: float  # simulation time, s
    flying: bool  # whether the law ran at this tick
    asked: (
        SetpointMessage | AttitudeSetpointMessage | None
    )  # the script's last setpoint, as it came
    plans: PlanProtocol
    counters: Counters = field(default_factory=Counters)

    @property
    def law(self) -> Any:
        """The law's parameters in force."""
        return self.params.law

    @property
    def battery(self) -> Battery | None:
        """As last reported; None if the plant has none."""
        return self.vehicle.battery

    @property
    def adapts(self) -> bool:
        """Whether the law is that of the paper: what it estimates is told."""
        flown = self.params.flown
        kinds = {"state": State, "internals": Internals, "guard": GuardInternals}
        tells = all(flown.tells(name, kind) for name, kind in kinds.items())
        return tells and not self.vehicle.is_by_baseline

    def _told(self, name: str) -> Any:
        """A field of the Tick."""
        tick = self.params.flown.ticks.Tick
        return from_buffer(field_type(tick, name), column(tick, self.row, name))

    @cached_property
    def state(self) -> State:
        """What the law remembers after this tick, if it `adapts`."""
        state: State = self._told("state")
        return state

    @cached_property
    def outputs(self) -> Outputs:
        """What the law told of this tick."""
        outputs: Outputs = self._told("outputs")
        return outputs

    @cached_property
    def internals(self) -> Internals:
        """What the law computed at this tick, if it `adapts`."""
        internals: Internals = self._told("internals")
        return internals

    @cached_property
    def guard(self) -> GuardInternals:
        """What the guard did at this tick, if the law `adapts`."""
        guard: GuardInternals = self._told("guard")
        return guard

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
        commanded: list[float] = column(SharedTick, self.row, "command").tolist()
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
        Omega, c_T = self.measured.Omega, self.law.rotors.c_T
        T: float = sum(float(c) * float(w) * float(w) for c, w in zip(c_T, Omega, strict=True))
        T_max: float = self.law.limits.T_max
        return T / T_max
