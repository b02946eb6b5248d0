"""Who may do what, when: arming, modes, and the setpoint that is flown.

Pure: requests and times in, a verdict in words out. It knows no socket, no clock and no
message; the loop asks it at every tick what to fly. Which mode may follow which is `modes`.
Times are simulation time in whole microseconds, unless they are called wall.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from fcu.interface.ground_numbers import LandedState, Result, Severity, SystemStatus
from fcu.interface.messages import Battery, Setpoint
from fcu.kernel.algebra import Vec3
from fcu.kernel.rotations import matrix
from fcu.law.admission import is_same_way
from fcu.params import Parameters
from fcu.vehicle import guidance, modes
from fcu.vehicle.foresight import beside
from fcu.vehicle.guidance import STILL, Piece
from fcu.vehicle.modes import Event, Mode, Need
from fcu.vehicle.pilot import Pilot, Row
from fcu.vehicle.plans import asks_too_much, plan_of, settle_s, take_off
from fcu.vehicle.verdict import Verdict, denied

LOOK_US = 20_000  # between looks at whether it has landed, and at the timers of arming
TILT_TO_ARM = math.radians(25.0)
INTO_THE_GROUND = "Setpoint leads into the ground: landing"


class Supervisor(Pilot):
    """Arming and modes of one vehicle."""

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
        assert self.state is not None
        return self.setpoint is None or self.setpoint.level > 0.0 or (
            self.setpoint.r_c.z <= float(self.state[2]) + 0.1 and self.setpoint.v_c.z <= 0.0
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

    # --- requests

    def arm(self, t_us: int, wall_s: float) -> Verdict:
        """Start the rotors; the vehicle holds, or flies the mode it is in."""
        if self.armed:
            return Verdict(Result.ACCEPTED)
        why = self.why_not_arm(t_us, wall_s)
        if why:
            return denied("Arming", why)
        self.armed, self._armed_us, self.failsafe = True, t_us, ""
        self._landed.has_flown = not self._landed.landed
        if self._landed.landed:
            self._set_home(self.pose().r_E)
        self._enter(self.mode, t_us)
        return Verdict(Result.ACCEPTED, "Armed")

    def why_not_arm(self, t_us: int, wall_s: float) -> str:
        """The first reason against arming; empty if there is none."""
        why = self.unfit
        if not why and self.mode is Mode.OFFBOARD:
            ready = self.script.ready(t_us, wall_s, self.lost_us)
            why = "" if ready else Need.SETPOINTS.value
        return why

    @property
    def unfit(self) -> str:
        """Why the vehicle itself must not be armed; empty if it may."""
        m = self.measured
        if m is None:
            return Need.STATE.value
        if self.terminated:
            return "flight was terminated (restart gcs up)"
        if matrix(m.q_EB).e3.z < math.cos(TILT_TO_ARM):
            return f"tilted by more than {math.degrees(TILT_TO_ARM):.0f} degrees"
        if self.battery is not None and self.battery.remaining < self._params["BAT_CRIT_THR"]:
            return f"battery at {100.0 * self.battery.remaining:.0f} %"
        return ""

    def disarm(self, t_us: int, forced: bool = False) -> Verdict:
        """Stop the rotors: on the ground, or whatever happens if forced."""
        if self.armed and not self._landed.landed and not forced:
            return denied("Disarming", "in flight (land first)")
        was = self.armed
        self._disarm(t_us)
        return Verdict(Result.ACCEPTED, "Disarmed" if was else "")

    def terminate(self, t_us: int) -> Verdict:
        """Stop the rotors for good."""
        self.terminated = True
        self._disarm(t_us)
        return Verdict(Result.ACCEPTED, "Flight terminated")

    def select(self, wanted: Mode, t_us: int, wall_s: float) -> Verdict:
        """Another mode. TEMPORARILY_REJECTED while a script's stream is all that is missing."""
        if wanted is self.mode and wanted is not Mode.HOLD:
            return Verdict(Result.ACCEPTED)  # a script that repeats itself
        need = modes.denied(wanted, self._met(t_us, wall_s))
        if need is not None:
            rejected = Result.TEMPORARILY_REJECTED if need is Need.SETPOINTS else Result.DENIED
            refused = need is Need.SETPOINTS and self.foresight.refused
            why = "the guard refuses its setpoints" if refused else need.value
            return Verdict(rejected, f"{wanted.value} denied: {why}")
        too_much = asks_too_much(wanted, self._params)
        if too_much:
            return denied(wanted.value, too_much)
        lack = None
        if wanted is Mode.STEP:
            away = Vec3(*(self._params[f"REF_STEP_{axis}"] for axis in "ENU"))
            lack = self.foresight.of_step(self._from(t_us), away, self._limits(), self.reference)
        if lack is not None and self.foresight.refuses:
            return denied(wanted.value, str(lack))
        self.failsafe = ""
        self._enter(wanted, t_us)
        return Verdict(Result.ACCEPTED, f"Mode {wanted.value}{beside(lack)}")

    def take_off(self, to_z: float | None, t_us: int, wall_s: float) -> Verdict:
        """Climb to the height `to_z` (m, E), or by MIS_TAKEOFF_ALT; then hold."""
        need = modes.denied(Mode.TAKEOFF, self._met(t_us, wall_s))
        if need is not None:
            return denied("Takeoff", need.value)
        here = self._from(t_us)
        height = self._params["MIS_TAKEOFF_ALT"] if to_z is None else to_z - here.r_E.z
        if not 0.0 < height <= 1000.0:
            return denied("Takeoff", f"{height:.1f} m up (expected above 0, at most 1000)")
        self.failsafe = ""
        self._become(Mode.TAKEOFF)
        plan = take_off(here, height, self._limits(), settle_s(self._params))
        self._follow(plan, t_us, ends=True)
        return Verdict(Result.ACCEPTED, f"Taking off to {height:.1f} m above here")

    def reposition(
        self, to: Vec3, psi: float | None, t_us: int, speed: float | None = None
    ) -> Verdict:
        """Hold somewhere else: straight there, within the limits; `speed`: as `change_speed`."""
        if not self.armed or self.state is None:
            return denied("Reposition", Need.ARMED.value)
        if self._landed.landed:
            return denied("Reposition", Need.AIRBORNE.value)
        was = self.cruise
        if speed is not None:
            told = self.change_speed(speed)
            if not told.good:
                return told
        here, led = self._from(t_us), self._limits()
        psi = here.psi if psi is None else psi
        lack = self.foresight.of_move(here, to, led, self.reference)
        if lack is not None and self.foresight.refuses:
            self.cruise = was
            return denied("Reposition", str(lack))
        self.failsafe = ""
        self._become(Mode.HOLD)
        self.begin_anew()
        self._follow(guidance.through(here.r_E, here.v_E, [to], psi, led), t_us)
        far = guidance.length(to - here.r_E)
        return Verdict(Result.ACCEPTED, f"Going {far:.0f} m{beside(lack)}")

    def move(self, v: Vec3, psi_dot: float, t_us: int) -> None:
        """Sticks in position mode: a velocity (m/s, E) and a yaw rate (rad/s)."""
        if not self.armed or self.mode is not Mode.POSITION:
            return
        if self.rests:
            if v.z <= 0.0:
                return  # it is on the ground, and stays there
            self.begin_anew()
        now = self.flown(t_us)
        piece = Piece(
            Setpoint(now.r_c, v, STILL, now.psi_c, psi_dot), self._params["COM_RC_LOSS_T"]
        )
        r, psi = now.r_c + piece.for_s * v, now.psi_c + piece.for_s * psi_dot
        stop = Piece(Setpoint(r, STILL, STILL, psi, 0.0), math.inf)
        self._follow([piece, stop], t_us)

    def set_home(self, home: Vec3 | None) -> Verdict:
        """Where a return flies to; None: here."""
        if self.state is None:
            return denied("Home", Need.STATE.value)
        self._set_home(self.pose().r_E if home is None else home)
        return Verdict(Result.ACCEPTED, "Home set")

    def fly_script(self, t_us: int) -> str:
        """The script has a new setpoint: it is flown in offboard mode. What is to be said of it."""
        lands = self.mode is Mode.OFFBOARD and self.armed and self.steer(t_us)
        self._set_wake()
        return INTO_THE_GROUND if lands else ""

    def keep_script(self, t_us: int, wall_s: float) -> str:
        """The script has a setpoint that is not flown: what it flies by goes on. What is to be said."""
        if not self.armed or self.mode is not Mode.OFFBOARD:
            return ""
        self.script.keep(t_us, wall_s)
        return self.fly_script(t_us)

    def is_flown(self, setpoint: Setpoint) -> bool:
        """Whether it is the script's that is flown already, but for its yaw."""
        asked = self.script.setpoint
        if not self.armed or self.mode is not Mode.OFFBOARD or asked is None:
            return False
        return is_same_way(setpoint, asked)

    # --- how

    def _met(self, t_us: int, wall_s: float) -> frozenset[Need]:
        landed = self._landed.landed
        met = {
            Need.STATE: self.state is not None,
            Need.ARMED: self.armed,
            Need.AIRBORNE: not landed,
            Need.GROUNDED: landed,
            Need.SETPOINTS: self.script.ready(t_us, wall_s, self.lost_us),
        }
        return frozenset(need for need, yes in met.items() if yes)

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
