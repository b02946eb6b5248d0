"""Whether a vehicle is armed, in which mode it is, and what happens to it by itself.

A pilot with modes: landing, disarming, a script that falls silent, a plan that ends. What it is
asked for is the supervisor's business; which mode may follow which is `modes`. Pure; times are
simulation time in whole microseconds, unless they are called wall.
"""

from __future__ import annotations

from collections.abc import Iterable

from fcu.interface.messages import Battery
from fcu.kernel.algebra import Vec3
from fcu.mavlink.enums import LandedState, Severity, SystemStatus
from fcu.parameters import Parameters
from fcu.vehicle import modes
from fcu.vehicle.guidance import Piece
from fcu.vehicle.modes import Event, Mode
from fcu.vehicle.pilot import Pilot, Row
from fcu.vehicle.plans import plan_of

LOOK_US = 20_000  # between looks at whether it has landed, and at the timers of arming
INTO_THE_GROUND = "Setpoint leads into the ground: landing"


class Conduct(Pilot):
    """Arming and modes of one vehicle, as far as they go by themselves."""

    def __init__(self, params: Parameters, sim_only: bool = False) -> None:
        """`sim_only`: a script's stream is lost by simulation time alone."""
        super().__init__(params, sim_only)
        self.armed = False
        self.mode = Mode.HOLD
        self.home: Vec3 | None = None
        self.home_changed = 0  # how often
        self.terminated = False
        self.battery: Battery | None = None
        self.wake_us = 0  # nothing happens by itself before
        self.failsafe = ""  # why the vehicle is not where it was told to be
        self._armed_us = 0
        self._landed_us = 0
        self._look_us = 0
        self._untold = ""  # of the script's setpoint, as it was entered

    # --- what a ground station sees

    @property
    def status(self) -> SystemStatus:
        """BOOT until the plant was heard, then STANDBY, ACTIVE, or CRITICAL in a failsafe."""
        if self.terminated:
            return SystemStatus.EMERGENCY
        if self.state is None:
            return SystemStatus.BOOT
        if self.armed:
            return SystemStatus.CRITICAL if self.failsafe else SystemStatus.ACTIVE
        return SystemStatus.STANDBY

    @property
    def landed_state(self) -> LandedState:
        """From the detector, and the mode."""
        if self.state is None:
            return LandedState.UNDEFINED
        if self._landed.landed:
            return LandedState.ON_GROUND
        if self.mode is Mode.TAKEOFF:
            return LandedState.TAKING_OFF
        return LandedState.LANDING if self._is_landing else LandedState.IN_AIR

    @property
    def on_ground(self) -> bool:
        """Whether the detector has it on the ground."""
        return self._landed.landed

    @property
    def _is_landing(self) -> bool:
        return self.mode is Mode.LAND or self.lands_for_script

    # --- what happens by itself

    def observe(self, state: Row, t_us: int, wall_s: float) -> list[tuple[Severity, str]]:
        """The VehicleState buffer of this tick: what happened, in words.

        Called at every tick; does nothing before `wake_us`.
        """
        self.state = state
        if t_us < self.wake_us:
            return []
        said: list[tuple[Severity, str]] = []
        if t_us >= self._look_us:
            self._look_us = t_us + LOOK_US
            self._look(state, t_us, said)
        if self.armed and self.mode is Mode.OFFBOARD:
            self._watch_script(t_us, wall_s, said)
        self._advance(t_us, said)
        return said

    def _set_wake(self) -> None:
        self.wake_us = min(self._look_us, self.leader.until_us)
        if self.armed and self.mode is Mode.OFFBOARD:
            self.wake_us = min(self.wake_us, self.script.deadline_us(self.lost_us))

    def _look(self, state: Row, t_us: int, said: list[tuple[Severity, str]]) -> None:
        if self.home is None:
            self._set_home(self.pose().r_E)
        was = self._landed.landed
        if self._landed.see(state, t_us) and not was:
            self._landed_us = t_us
            said.append((Severity.INFO, "Landed"))
        if self.armed and self.mode is Mode.OFFBOARD and self.steer(t_us):
            self._untold = INTO_THE_GROUND
        if self._untold:
            said.append((Severity.INFO, self._untold))
            self._untold = ""
        lands, scripted = self._is_landing, self.mode is Mode.OFFBOARD
        if self.armed and (lands or not scripted) and self.touch_down(t_us, lands) and not lands:
            said.append((Severity.WARNING, "Led into the ground: resting on it"))
        if not self.armed or not self._landed.landed:
            return
        if self._landed.has_flown:
            wait, since = self._params["COM_DISARM_LAND"], self._landed_us
            if wait >= 0.0 and self._goes_down() and t_us - since >= wait * 1e6:
                self._disarm(t_us)
                said.append((Severity.INFO, "Disarmed after landing"))
        else:
            wait, idle = self._params["COM_DISARM_PRFLT"], self.mode in (Mode.HOLD, Mode.POSITION)
            if wait >= 0.0 and idle and t_us - self._armed_us >= wait * 1e6:
                self._disarm(t_us)
                said.append((Severity.INFO, "Disarmed: it did not take off"))

    def _goes_down(self) -> bool:
        """Whether what is flown is not above the vehicle: a script may be about to take off."""
        if self._is_landing:
            return True
        assert self.measured is not None
        return self.setpoint is None or self.setpoint.level > 0.0 or (
            self.setpoint.r_c.z <= self.measured.r_E.z + 0.1 and self.setpoint.v_c.z <= 0.0
        )  # fmt: skip

    @property
    def lost_us(self) -> int:
        """How old a script's last setpoint may be, us."""
        return round(self._params["COM_OF_LOSS_T"] * 1e6)

    def _watch_script(self, t_us: int, wall_s: float, said: list[tuple[Severity, str]]) -> None:
        if not self.script.lost(t_us, wall_s, self.lost_us):
            return
        action = int(self._params["COM_OBL_RC_ACT"])
        self.script.forget()
        text = f"Offboard lost: no setpoint for {self._params['COM_OF_LOSS_T']:g} s"
        mode = modes.ON_LOSS[action]
        if mode is Mode.RETURN and self._landed.landed:
            mode = Mode.HOLD
        if mode is None:
            if action == modes.TERMINATE:
                self.terminated = True
            self._disarm(t_us)
            said.append((Severity.CRITICAL, f"{text}, rotors stopped"))
            return
        self._enter(mode, t_us)
        self.failsafe = text
        said.append((Severity.CRITICAL, f"{text}, mode {mode.value}"))

    # --- how

    def fly_script(self, t_us: int) -> str:
        """The script has a new setpoint: it is flown in offboard mode. What is to be said of it."""
        lands = self.mode is Mode.OFFBOARD and self.armed and self.steer(t_us)
        self._set_wake()
        return INTO_THE_GROUND if lands else ""

    def _set_home(self, home: Vec3) -> None:
        self.home = home
        self.home_changed += 1

    def _become(self, mode: Mode) -> None:
        self.mode = mode
        self.begin_anew()
        if mode is not Mode.OFFBOARD:
            self.script.owner = None

    def _disarm(self, t_us: int) -> None:
        self.armed, self.failsafe = False, ""
        self.leader.take(None, t_us)
        self._landed.has_flown = False
        self._become(modes.after(self.mode, Event.DISARMED))
        self._set_wake()

    def _enter(self, mode: Mode, t_us: int) -> None:
        """Be in a mode, and lay down what it flies."""
        self._become(mode)
        if not self.armed:
            return
        if mode is Mode.OFFBOARD:
            self._untold = self.fly_script(t_us)
            return
        assert self.home is not None
        plan = plan_of(mode, self._from(t_us), self.home, self._params, self._limits())
        self._follow(plan, t_us, (mode, Event.ARRIVED) in modes.TRANSITIONS)

    def _follow(self, plan: Iterable[Piece], t_us: int, ends: bool = False) -> None:
        self.leader.follow(plan, t_us, ends)
        self._advance(t_us, [])

    def _advance(self, t_us: int, said: list[tuple[Severity, str]]) -> None:
        """On to the setpoint of this moment, and to the mode that follows at the end of a plan."""
        if self.leader.advance(t_us):
            following = modes.after(self.mode, Event.ARRIVED)
            said.append((Severity.INFO, f"{self.mode.value} complete, mode {following.value}"))
            self._enter(following, t_us)
        self._set_wake()
