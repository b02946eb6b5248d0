"""Who may do what, when: arming, modes, and the setpoint that is flown.

Pure: commands and messages in, a verdict in words out. It knows no socket, no clock and no
MAVLink number but those of `ground_messages`; the loop asks it once a tick what to fly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fcu.interface.ground_messages import (
    IGNORE_ACCELERATION,
    IGNORE_POSITION,
    IGNORE_VELOCITY,
    IGNORE_YAW,
    AutoMode,
    Command,
    CommandId,
    LandedState,
    MainMode,
    Result,
    SetpointMessage,
    SystemStatus,
)  # fmt: skip
from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import columns, from_buffer
from fcu.kernel.rotations import euler, matrix

FORCE_MAGIC = 21196  # MAV_CMD_COMPONENT_ARM_DISARM, parameter 2: do it whatever the checks say
TAKEOFF_HEIGHT = 2.5  # m, when the command does not say
LAND_SPEED = 0.7  # m/s
LANDED_BELOW = 0.5  # m that the setpoint must have sunk below a vehicle that does not follow
LANDED_FOR = 1.0  # s
NOTHING = Vec3(0.0, 0.0, 0.0)

Row = np.ndarray[Any, np.dtype[np.float64]]
_HEIGHT, _CLIMB = (columns(VehicleState).index(name) for name in ("r_E.z", "v_E.z"))


@dataclass
class Verdict:
    """What became of a command, and why, in words for a STATUSTEXT (empty: nothing to say)."""

    result: Result
    text: str = ""


@dataclass
class Supervisor:
    """Arming and modes of one vehicle. Times are simulation time, s."""

    armed: bool = False
    main_mode: MainMode = MainMode.AUTO
    sub_mode: AutoMode = AutoMode.LOITER
    setpoint: Setpoint | None = None  # what is flown, as of `set_at`
    set_at: float = 0.0
    offered: Setpoint | None = None  # the last acceptable setpoint of a script
    offered_at: float = 0.0
    state: Row | None = None  # the last measured VehicleState, as its buffer
    _landed_since: float | None = field(default=None, repr=False)

    # --- what a ground station sees

    @property
    def measured(self) -> VehicleState | None:
        """The last measured state; None before the plant was heard."""
        return None if self.state is None else from_buffer(VehicleState, self.state)

    @property
    def status(self) -> SystemStatus:
        """BOOT until the plant was heard, then STANDBY or ACTIVE."""
        if self.state is None:
            return SystemStatus.BOOT
        return SystemStatus.ACTIVE if self.armed else SystemStatus.STANDBY

    @property
    def landed_state(self) -> LandedState:
        """On the ground while disarmed; else by mode."""
        if not self.armed:
            return LandedState.ON_GROUND
        return {
            AutoMode.TAKEOFF: LandedState.TAKING_OFF,
            AutoMode.LAND: LandedState.LANDING,
        }.get(self.sub_mode, LandedState.IN_AIR)

    # --- what it is told

    def offer(self, message: SetpointMessage, t: float) -> Verdict:
        """A script's setpoint: taken if it can be flown, and flown if in offboard mode."""
        if message.refusal:
            return Verdict(Result.DENIED, f"Setpoint refused: {message.refusal}")
        if message.ignores(IGNORE_POSITION):
            return Verdict(Result.DENIED, "Setpoint refused: it has no position")
        offered = message.setpoint
        if message.ignores(IGNORE_VELOCITY):
            offered = offered._replace(v_c=NOTHING)
        if message.ignores(IGNORE_ACCELERATION):
            offered = offered._replace(a_c=NOTHING)
        if message.ignores(IGNORE_YAW):
            psi = self.setpoint.psi_c if self.setpoint is not None else self._yaw()
            offered = offered._replace(psi_c=psi, psi_dot_c=0.0)
        self.offered, self.offered_at = offered, t
        if self.main_mode is MainMode.OFFBOARD:
            self._fly(offered, t)
        return Verdict(Result.ACCEPTED)

    def command(self, command: Command, t: float) -> Verdict:
        """A command of a ground station or script."""
        if command.command == CommandId.ARM_DISARM:
            return self._arm(command, t)
        if command.command == CommandId.SET_MODE:
            return self._set_mode(command, t)
        if command.command == CommandId.TAKEOFF:
            return self._take_off(command, t)
        if command.command == CommandId.LAND:
            return self._land(t)
        return Verdict(Result.UNSUPPORTED)

    def observe(self, state: Row, t: float) -> str:
        """The VehicleState buffer of this tick. Returns what happened, in words, if it did.

        Called at every tick: it reads two numbers of the buffer, and only when they matter.
        """
        self.state = state
        if not self.armed or self.setpoint is None:
            return ""
        if self.sub_mode is AutoMode.TAKEOFF and state[_HEIGHT] > self.setpoint.r_c.z - 0.3:
            self._enter(MainMode.AUTO, AutoMode.LOITER)
            return "Takeoff complete, holding"
        if self.sub_mode is AutoMode.LAND:
            sunk = state[_HEIGHT] - (self.setpoint.r_c.z - LAND_SPEED * (t - self.set_at))
            if abs(state[_CLIMB]) < 0.15 and sunk > LANDED_BELOW:
                self._landed_since = t if self._landed_since is None else self._landed_since
                if t - self._landed_since >= LANDED_FOR:
                    self._disarm()
                    return "Landed, disarmed"
            else:
                self._landed_since = None
        return ""

    # --- how

    def _yaw(self) -> float:
        measured = self.measured
        if measured is None:
            return 0.0
        psi: float = euler(matrix(measured.q_EB)).z
        return psi

    def _fly(self, setpoint: Setpoint, t: float) -> None:
        self.setpoint, self.set_at = setpoint, t

    def _enter(self, main: MainMode, sub: AutoMode = AutoMode.NONE) -> None:
        self.main_mode, self.sub_mode = main, sub
        self._landed_since = None

    def _here(self, up: float = 0.0, v_c: Vec3 = NOTHING) -> Setpoint:
        measured = self.measured
        assert measured is not None
        return Setpoint(measured.r_E + Vec3(0.0, 0.0, up), v_c, NOTHING, self._yaw(), 0.0)

    def _disarm(self) -> None:
        self.armed, self.setpoint = False, None
        self._enter(MainMode.AUTO, AutoMode.LOITER)

    def _arm(self, command: Command, t: float) -> Verdict:
        want, forced = command.params[0], command.params[1] == FORCE_MAGIC
        if want not in (0.0, 1.0):
            return Verdict(Result.DENIED, "Arming denied: parameter 1 is neither 0 nor 1")
        if want == 0.0:
            if self.armed and self._landed_since is None and not forced:
                return Verdict(Result.DENIED, "Disarming denied: in flight (land first)")
            self._disarm()
            return Verdict(Result.ACCEPTED, "Disarmed")
        if self.armed:
            return Verdict(Result.ACCEPTED)
        if self.state is None:
            return Verdict(Result.DENIED, "Arming denied: no state from the plant yet")
        self.armed = True
        if self.main_mode is MainMode.OFFBOARD and self.offered is not None:
            self._fly(self.offered, self.offered_at)
        else:
            self._fly(self._here(), t)
        return Verdict(Result.ACCEPTED, "Armed")

    def _set_mode(self, command: Command, t: float) -> Verdict:
        main, sub = command.params[1], command.params[2]
        if main == MainMode.OFFBOARD:
            if self.offered is None:
                return Verdict(Result.TEMPORARILY_REJECTED, "Offboard denied: no setpoint yet")
            self._enter(MainMode.OFFBOARD)
            self._fly(self.offered, self.offered_at)
            return Verdict(Result.ACCEPTED, "Offboard")
        if main == MainMode.AUTO and sub == AutoMode.LOITER:
            self._enter(MainMode.AUTO, AutoMode.LOITER)
            if self.state is not None:
                self._fly(self._here(), t)
            return Verdict(Result.ACCEPTED, "Holding")
        if main == MainMode.AUTO and sub == AutoMode.LAND:
            return self._land(t)
        return Verdict(Result.UNSUPPORTED, "Mode not supported: hold, offboard and land are")

    def _take_off(self, command: Command, t: float) -> Verdict:
        if not self.armed or self.state is None:
            return Verdict(Result.DENIED, "Takeoff denied: not armed")
        height = command.params[6]
        up = TAKEOFF_HEIGHT if math.isnan(height) or height == 0.0 else height
        if not 0.0 < up <= 100.0:
            return Verdict(Result.DENIED, "Takeoff denied: height must be above 0, at most 100 m")
        self._enter(MainMode.AUTO, AutoMode.TAKEOFF)
        self._fly(self._here(up), t)
        return Verdict(Result.ACCEPTED, f"Taking off to {up:.1f} m above here")

    def _land(self, t: float) -> Verdict:
        if not self.armed:
            return Verdict(Result.DENIED, "Landing denied: not armed")
        self._enter(MainMode.AUTO, AutoMode.LAND)
        self._fly(self._here(v_c=Vec3(0.0, 0.0, -LAND_SPEED)), t)
        return Verdict(Result.ACCEPTED, "Landing")
