"""One vehicle: armed or not, in which mode, what it flies; what it may be asked for, and when.

The one state machine. Pure: states, requests and times in, answers and events out, each a code
with numbers. It knows no socket, no clock and no message; the loop asks it at every tick what to
fly. Which mode may follow which is `modes`, what a mode flies `plans`, what a script's setpoint
asks for `setpoints`, what is done near the ground `landing`. Frames: Earth ENU; SI; times are
simulation time in whole microseconds, unless they are called wall.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from fcu.guard.admission import is_same_way
from fcu.interface.messages import (
    AttitudeRequest,
    Battery,
    PositionRequest,
    Setpoint,
    VehicleState,
)
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import from_buffer, size, to_buffer
from fcu.kernel.rotations import matrix
from fcu.kernel.rows import column_of, slice_of
from fcu.laws.mmrac.reference_model import carried
from fcu.parameters import Parameters
from fcu.vehicle import landing, modes, plans
from fcu.vehicle.feasibility_check import FeasibilityCheck, Shortfall
from fcu.vehicle.landing import Approach, LandedDetector, TouchdownDetector
from fcu.vehicle.modes import Event, Mode, Need
from fcu.vehicle.plans import NEVER_US, Leader, Piece, PlanLimits, Pose
from fcu.vehicle.setpoints import Script, anchored, of_attitude, of_position, script_limits
from fcu.vehicle.watch import LOOK_US, Given, Watch, warm_up

Row = np.ndarray[Any, np.dtype[np.float64]]

NEAR = 2.0  # m: an old setpoint farther from the vehicle than this is not gone on from
TILT_TO_ARM = math.radians(25.0)

_LOOK_AT, _WAKE_AT = column_of(Watch, "look_us"), column_of(Watch, "wake_us")
_LANDED, _TOUCHDOWN = slice_of(Watch, "landed"), slice_of(Watch, "touchdown")
_GIVEN = slice_of(Watch, "given")

_NOTHING = plans.at(plans.STILL, 0.0)


class Answer(NamedTuple):
    """What a request came to. Refused, it has changed nothing."""

    granted: bool
    told: Told | None = None  # what is done, or why it is not; None: nothing to say
    later: bool = False  # refused for what may change in a moment


def _refused(code: Code, *values: float) -> Answer:
    return Answer(False, Told(code, values))


class StateMachine:
    """Arming, modes and setpoint of one vehicle."""

    def __init__(self, params: Parameters, sim_only: bool = False) -> None:
        """`sim_only`: a script's stream is lost by simulation time alone."""
        self._params = params
        self.armed = False
        self.mode = Mode.HOLD
        self.home: Vec3 | None = None
        self.home_changed = 0  # how often
        self.terminated = False
        self.ended: Told | None = None  # how the plant's flight has ended, if it has
        self.failsafe: Told | None = None  # why the vehicle is not where it was told to be
        self.battery: Battery | None = None
        self.state: Row | None = None  # the last measured VehicleState, as its buffer
        self.reference_model: Row | None = None  # float64[6]: its r_m and v_m, after the last tick
        self.reference_acceleration: Row | None = None  # float64[3]: its a_m, of a law with a guard
        self.beginning: Callable[[], Row] | None = (
            None  # of a law whose demand is known: see `reference`
        )
        self.leader = Leader()
        self.script = Script(sim_only)
        self.feasibility = FeasibilityCheck(params)
        self.cruise: float | None = None  # m/s, as told; None: MPC_XY_CRUISE
        self.watch = np.zeros(size(Watch))  # shared with compiled code: see `arm_watch`
        self._landed = LandedDetector(
            params.law.rotors.c_T, params.pace.T_hover, self.watch[_LANDED]
        )
        self._approach = Approach.AS_ASKED  # how the script's setpoint is flown
        self._touchdown = TouchdownDetector(self.watch[_TOUCHDOWN])
        self._take_off_to: float | None = None  # m, E: once it is armed; None: MIS_TAKEOFF_ALT
        self._armed_us = 0
        self._landed_us = 0
        self._untold: Told | None = None  # of the script's setpoint, as it was entered

    def warm_up(self) -> None:
        """Compile what is asked at ticks and looks."""
        self.feasibility.warm_up()
        warm_up(self._limits())

    # --- where it is, and what it flies

    @property
    def measured(self) -> VehicleState | None:
        """The last measured state; None before the plant was heard."""
        return None if self.state is None else from_buffer(VehicleState, self.state)

    @property
    def setpoint(self) -> Setpoint | None:
        """What is flown, as of `since_us`; None while disarmed."""
        return self.leader.setpoint

    @property
    def since_us(self) -> int:
        """When it took effect."""
        return self.leader.since_us

    def pose(self) -> Pose:
        """Where the vehicle is."""
        assert self.state is not None
        return plans.pose_at(self.state)

    @property
    def reference(self) -> Row:
        """float64[9]: r_m, v_m and a_m of the reference model; without one where the vehicle is.

        In the air under the law's position control a Beginning. On the ground, which carries some of
        the weight, what is demanded says nothing of what will be.
        """
        flown, grounded = self.setpoint, self._landed.landed
        if flown is not None and flown.level == 0.0 and not grounded and self.beginning is not None:
            return self.beginning()
        a_m = np.zeros(3) if self.reference_acceleration is None else self.reference_acceleration
        if self.reference_model is not None:
            return np.concatenate([self.reference_model, a_m])
        here = self.pose()
        return np.concatenate([to_buffer(here.r_E), to_buffer(here.v_E), a_m])

    def flown(self, t_us: int, pose: Pose | None = None) -> Setpoint:
        """The setpoint flown now, to go on from: the vehicle itself if that is elsewhere.

        `pose`: where it is, if that is known already.
        """
        here = self.pose() if pose is None else pose
        return anchored(self.setpoint, (t_us - self.since_us) * 1e-6, here, NEAR)

    def led_to(self, t_us: int) -> Vec3:
        """Where the setpoint is now, m, E, however far from the vehicle."""
        assert self.setpoint is not None
        place: Vec3 = carried(self.setpoint, (t_us - self.since_us) * 1e-6).r_c
        return place

    @property
    def on_ground(self) -> bool:
        """Whether the detector has it on the ground."""
        return self._landed.landed

    @property
    def is_landing(self) -> bool:
        """Whether it comes down, for itself or for a script."""
        return self.mode is Mode.LAND or self._approach is Approach.DOWN

    @property
    def leads_itself(self) -> bool:
        """Whether it flies a plan of its own, of which the guard was asked about the begin at most."""
        own = self.mode is not Mode.OFFBOARD or self._approach is not Approach.AS_ASKED
        return self.armed and own

    def _from(self, t_us: int) -> Pose:
        """Where a plan begins: the setpoint flown now, so that the law's input does not jump."""
        now = self.flown(t_us)
        return Pose(now.r_c, now.v_c, now.psi_c)

    def _limits(self) -> PlanLimits:
        return plans.limits(self._params, self.cruise, self.feasibility.pace)

    # --- what happens by itself

    def observe(self, state: Row, t_us: int, wall_s: float) -> list[Told]:
        """The VehicleState buffer of this tick: what happened, as codes.

        Called at every tick; does nothing before `wake_us`.
        """
        self.state = state
        if t_us < self.watch[_WAKE_AT]:
            return []
        told: list[Told] = []
        if t_us >= self.watch[_LOOK_AT]:
            self.watch[_LOOK_AT] = t_us + LOOK_US
            self._look(state, t_us, told)
        if self.armed and self.mode is Mode.OFFBOARD:
            self._watch_script(t_us, wall_s, told)
        self._advance(t_us, told)
        return told

    def _set_wake(self) -> None:
        self.watch[_WAKE_AT] = min(self.watch[_LOOK_AT], self.leader.until_us, self._deadline_us)

    @property
    def wake_us(self) -> int:
        """Nothing happens by itself before."""
        return int(self.watch[_WAKE_AT])

    @property
    def _deadline_us(self) -> int:
        """The first microsecond at which the script may be lost."""
        scripted = self.armed and self.mode is Mode.OFFBOARD
        return self.script.deadline_us(self.lost_us) if scripted else NEVER_US

    def arm_watch(self) -> None:
        """Before compiled code flies on by itself: what `watch.quiet_look` has to know.

        To be called again after whatever else this object was asked for, or has observed.
        """
        scripted = self.armed and self.mode is Mode.OFFBOARD
        asked = self.script.setpoint
        self.watch[_GIVEN] = to_buffer(
            Given(
                until_us=self.leader.until_us,
                deadline_us=self._deadline_us,
                armed=self.armed,
                scripted=scripted,
                lands=self.is_landing,
                python=self.home is None
                or self._untold is not None
                or (scripted and not self._flies_on(asked)),
                approach=self._approach,
                asked=_NOTHING if asked is None else asked,
                asked_us=self.script.since_us,
                limits=self._limits(),
                c_T=self._landed.c_T,
                anywhere_us=landing.anywhere_us(self._params.pace.f_m),
            )
        )

    def _flies_on(self, asked: Setpoint | None) -> bool:
        """Whether a look that finds the approach as it was would leave what is flown alone."""
        if self._approach is Approach.AS_ASKED:
            as_asked = self.setpoint is asked and self.since_us == self.script.since_us
            return as_asked and self.leader.until_us == NEVER_US and asked is not None
        return self._approach is Approach.DOWN and asked is not None

    def _look(self, state: Row, t_us: int, told: list[Told]) -> None:
        if self.home is None:
            self._set_home(self.pose().r_E)
        was = self._landed.landed
        if self._landed.see(state, t_us) and not was:
            self._landed_us = t_us
            told.append(Told(Code.LANDED))
        if self.armed and self.mode is Mode.OFFBOARD and self._steer(t_us):
            self._untold = Told(Code.SETPOINT_INTO_GROUND)
        if self._untold is not None:
            told.append(self._untold)
            self._untold = None
        lands, scripted = self.is_landing, self.mode is Mode.OFFBOARD
        if self.armed and (lands or not scripted) and self._touch_down(t_us, lands) and not lands:
            told.append(Told(Code.LED_INTO_GROUND))
        if not self.armed or not self._landed.landed:
            return
        if self._landed.has_flown:
            wait, since = self._params["COM_DISARM_LAND"], self._landed_us
            if wait >= 0.0 and self._goes_down() and t_us - since >= wait * 1e6:
                self._disarm(t_us)
                told.append(Told(Code.DISARMED_LANDED))
        else:
            wait, idle = self._params["COM_DISARM_PRFLT"], self.mode in (Mode.HOLD, Mode.POSITION)
            if wait >= 0.0 and idle and t_us - self._armed_us >= wait * 1e6:
                self._disarm(t_us)
                told.append(Told(Code.DISARMED_IDLE))

    def _goes_down(self) -> bool:
        """Whether what is flown is not above the vehicle: a script may be about to take off."""
        if self.is_landing:
            return True
        assert self.measured is not None
        return self.setpoint is None or self.setpoint.level > 0.0 or (
            self.setpoint.r_c.z <= self.measured.r_E.z + 0.1 and self.setpoint.v_c.z <= 0.0
        )  # fmt: skip

    @property
    def lost_us(self) -> int:
        """How old a script's last setpoint may be, us."""
        return round(self._params["COM_OF_LOSS_T"] * 1e6)

    def _watch_script(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        if not self.script.lost(t_us, wall_s, self.lost_us):
            return
        action = int(self._params["COM_OBL_RC_ACT"])
        self.script.forget()
        silent = self._params["COM_OF_LOSS_T"]
        mode = modes.ON_LOSS[action]
        if mode is Mode.RETURN and self._landed.landed:
            mode = Mode.HOLD
        if mode is None:
            if action == modes.TERMINATE:
                self.terminated = True
            self._disarm(t_us)
            told.append(Told(Code.OFFBOARD_LOST_STOPPED, (silent,)))
            return
        self._enter(mode, t_us)
        self.failsafe = Told(Code.OFFBOARD_LOST_MODE, (silent, mode.value))
        told.append(self.failsafe)

    def _advance(self, t_us: int, told: list[Told]) -> None:
        """On to the setpoint of this moment, and to the mode that follows at the end of a plan."""
        if self.leader.advance(t_us):
            following = modes.after(self.mode, Event.ARRIVED)
            told.append(Told(Code.PLAN_COMPLETE, (self.mode.value, following.value)))
            self._enter(following, t_us)
        self._set_wake()

    # --- what it is asked for

    def arm(self, t_us: int, wall_s: float) -> Answer:
        """Start the rotors; the vehicle holds, takes off or flies the mode it is in."""
        if self.armed:
            return Answer(True)
        why = self.why_not_arm(t_us, wall_s)
        if why is not None:
            return Answer(False, why)
        self.armed, self._armed_us, self.failsafe = True, t_us, None
        self._landed.has_flown = not self._landed.landed
        if self._landed.landed:
            self._set_home(self.pose().r_E)
        self._enter(self.mode, t_us)
        return Answer(True, Told(Code.ARMED))

    def why_not_arm(self, t_us: int, wall_s: float) -> Told | None:
        """The first reason against arming; None if there is none."""
        if self.unfit is not None:
            return self.unfit
        if self.mode is Mode.TAKEOFF:
            return self._why_not_take_off(self._take_off_to, t_us, wall_s)
        if self.mode is not Mode.OFFBOARD or self.script.ready(t_us, wall_s, self.lost_us):
            return None
        return Told(Code.NO_STREAM)

    @property
    def unfit(self) -> Told | None:
        """Why the vehicle itself must not be armed; None if it may."""
        m = self.measured
        if m is None:
            return Told(Code.NO_STATE)
        if self.ended is not None:
            return Told(Code.HAS_ENDED)
        if self.terminated:
            return Told(Code.WAS_TERMINATED)
        if matrix(m.q_EB).e3.z < math.cos(TILT_TO_ARM):
            return Told(Code.TILTED, (math.degrees(TILT_TO_ARM),))
        if self.battery is not None and self.battery.remaining < self._params["BAT_CRIT_THR"]:
            return Told(Code.BATTERY_CRITICAL, (100.0 * self.battery.remaining,))
        return None

    def disarm(self, t_us: int, forced: bool = False) -> Answer:
        """Stop the rotors: on the ground, or whatever happens if forced."""
        if self.armed and not self._landed.landed and not forced:
            return _refused(Code.IN_FLIGHT)
        was = self.armed
        self._disarm(t_us)
        return Answer(True, Told(Code.DISARMED) if was else None)

    def terminate(self, t_us: int) -> Answer:
        """Stop the rotors for good."""
        self.terminated = True
        self._disarm(t_us)
        return Answer(True, Told(Code.TERMINATED))

    def end(self, how: Told, state: Row, t_us: int) -> None:
        """The plant's flight has ended: the rotors stop, and the vehicle lies at `state`.

        `how`: CRASHED or DIVERGED.  state : VehicleState, its buffer.
        """
        self.state, self.ended = state, how
        self._disarm(t_us)

    def select(self, wanted: Mode, t_us: int, wall_s: float) -> Answer:
        """Another mode; to be asked for `later` while a script's stream is all that is missing."""
        if wanted is self.mode and wanted is not Mode.HOLD:
            return Answer(True)  # a script that repeats itself
        need = modes.denied(wanted, self._met(t_us, wall_s))
        if need is not None:
            missing = need is Need.SETPOINTS
            refused = missing and self.feasibility.refused
            return Answer(False, Told(Code.GUARD_REFUSES if refused else need.value), missing)
        too_much = plans.asks_too_much(wanted, self._params)
        if too_much is not None:
            return Answer(False, too_much)
        lack: Shortfall | None = None
        if wanted is Mode.STEP:
            away = Vec3(*(self._params[f"REF_STEP_{axis}"] for axis in "ENU"))
            lack = self.feasibility.of_step(self._from(t_us), away, self._limits(), self.reference)
        if lack is not None and self.feasibility.refuses:
            return Answer(False, lack.reason)
        self.failsafe = None
        self._enter(wanted, t_us)
        name = wanted.value
        short = lack is not None and Told(Code.MODE_SHORT, (name, lack.short))
        return Answer(True, short or Told(Code.MODE, (name,)))

    def take_off(self, to_z: float | None, t_us: int, wall_s: float) -> Answer:
        """Climb to the height `to_z` (m, E), or by MIS_TAKEOFF_ALT; then hold.

        A vehicle that is not armed does so once it is.
        """
        why = self._why_not_take_off(to_z, t_us, wall_s)
        if why is not None:
            return Answer(False, why)
        height = self._climb(to_z, t_us)
        self.failsafe = None
        if self.armed:
            self._take_off(height, t_us)
            return Answer(True, Told(Code.TAKING_OFF, (height,)))
        self._become(Mode.TAKEOFF)
        self._take_off_to = to_z
        return Answer(True, Told(Code.TAKES_OFF_ONCE_ARMED, (height,)))

    def _why_not_take_off(self, to_z: float | None, t_us: int, wall_s: float) -> Told | None:
        need = modes.denied(Mode.TAKEOFF, self._met(t_us, wall_s))
        if need is not None:
            return Told(need.value)
        height = self._climb(to_z, t_us)
        return None if 0.0 < height <= 1000.0 else Told(Code.TAKEOFF_HEIGHT, (height,))

    def _climb(self, to_z: float | None, t_us: int) -> float:
        """How far it is up from here, m."""
        return self._params["MIS_TAKEOFF_ALT"] if to_z is None else to_z - self._from(t_us).r_E.z

    def _take_off(self, height: float, t_us: int) -> None:
        here, settle_s = self._from(t_us), plans.settle_s(self._params)
        self._become(Mode.TAKEOFF)
        self._follow(plans.take_off(here, height, self._limits(), settle_s), t_us, ends=True)

    def stopping_place(self, t_us: int) -> Vec3:
        """Where it comes to rest (m, E) if it is to hold from now on."""
        here = self._from(t_us)
        return plans.brake(here.r_E, here.v_E, here.psi, self._limits())[1]

    def turn(self, psi: float, t_us: int) -> Answer:
        """Hold here, with another yaw (rad)."""
        return self._go(None, psi, t_us)

    def reposition(
        self, to: Vec3, psi: float | None, t_us: int, speed: float | None = None
    ) -> Answer:
        """Hold somewhere else: straight there, within the limits; `speed`: as `change_speed`."""
        return self._go(to, psi, t_us, speed)

    def _go(
        self, to: Vec3 | None, psi: float | None, t_us: int, speed: float | None = None
    ) -> Answer:
        """`to`: where to hold, m, E; None: where it comes to rest."""
        if not self.armed or self.state is None:
            return _refused(Code.NOT_ARMED)
        if self._landed.landed:
            return _refused(Code.NOT_AIRBORNE)
        was = self.cruise
        if speed is not None:
            changed = self.change_speed(speed)
            if not changed.granted:
                return changed
        here, led = self._from(t_us), self._limits()
        psi = here.psi if psi is None else psi
        lack = None if to is None else self.feasibility.of_move(here, to, led, self.reference)
        if lack is not None and self.feasibility.refuses:
            self.cruise = was
            return Answer(False, lack.reason)
        self.failsafe = None
        self._become(Mode.HOLD)
        way = [] if to is None else [to]
        self._follow(plans.through(here.r_E, here.v_E, way, psi, led), t_us)
        if to is None:
            return Answer(True, Told(Code.MODE, (self.mode.value,)))
        far = plans.length(to - here.r_E)
        short = lack is not None and Told(Code.GOING_SHORT, (far, lack.short))
        return Answer(True, short or Told(Code.GOING, (far,)))

    def change_speed(self, speed: float) -> Answer:
        """Cruise speed (m/s) of what is laid down from now on; -1: MPC_XY_CRUISE again."""
        greatest = self._params["MPC_XY_VEL_MAX"]
        if speed != -1.0 and not 0.1 <= speed <= greatest:
            return _refused(Code.SPEED_RANGE, speed, greatest)
        self.cruise = None if speed == -1.0 else speed
        return Answer(True)

    def move(self, v: Vec3, psi_dot: float, t_us: int) -> None:
        """Sticks in position mode: a velocity (m/s, E) and a yaw rate (rad/s)."""
        if not self.armed or self.mode is not Mode.POSITION:
            return
        if self._touchdown.done:
            if v.z <= 0.0:
                return  # it is on the ground, and stays there
            self._end_approach()
        now = self.flown(t_us)
        going = plans.at(now.r_c, now.psi_c, v)._replace(psi_dot_c=psi_dot)
        piece = Piece(going, self._params["COM_RC_LOSS_T"])
        r, psi = now.r_c + piece.for_s * v, now.psi_c + piece.for_s * psi_dot
        self._follow([piece, plans.rest(r, psi)], t_us)

    def set_home(self, home: Vec3 | None) -> Answer:
        """Where a return flies to; None: here."""
        if self.state is None:
            return _refused(Code.NO_STATE)
        self._set_home(self.pose().r_E if home is None else home)
        return Answer(True, Told(Code.HOME_SET))

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

    # --- a script's setpoints

    def resolve(
        self, asked: PositionRequest | AttitudeRequest, t_us: int
    ) -> tuple[Setpoint | None, Told | None]:
        """The setpoint that a request asks for, and what of it was limited; None, and why not."""
        here = self.pose()
        flown = self.flown(t_us, here)
        if isinstance(asked, AttitudeRequest):
            return of_attitude(asked, flown, self._params.law.limits.T_max)
        limits = script_limits(self._params)
        made, told = of_position(asked, here, self.home or here.r_E, flown, limits)
        if told is not None and told.code is Code.SETPOINT_LOW and self._lands_at(made.r_c, here):
            return made, None  # as for any below the ground, the landing is told
        return made, told

    def _lands_at(self, r: Vec3, here: Pose) -> bool:
        """Whether a place (m, E) is below the ground that the vehicle knows."""
        return landing.is_below(r, here, self._landed.ground)

    def fly_script(self, t_us: int) -> Told | None:
        """The script has a new setpoint: it is flown in offboard mode. What is to be said of it."""
        lands = self.mode is Mode.OFFBOARD and self.armed and self._steer(t_us)
        self._set_wake()
        return Told(Code.SETPOINT_INTO_GROUND) if lands else None

    def keep_script(self, t_us: int, wall_s: float) -> Told | None:
        """The script has a setpoint that is not flown: what it flies by goes on. What is to be said."""
        if not self.armed or self.mode is not Mode.OFFBOARD:
            return None
        self.script.keep(t_us, wall_s)
        return self.fly_script(t_us)

    def short_of(self, setpoint: Setpoint) -> float:
        """By how much (N) the way to a setpoint misses the guard's condition; 0: it does not."""
        return self.feasibility.short(setpoint, self.reference)

    def flies_what_fits(self, t_us: int) -> bool:
        """Whether the way to what is flown now meets the guard's condition, or nothing is flown."""
        if self.setpoint is None:
            return True
        now = carried(self.setpoint, (t_us - self.since_us) * 1e-6)
        return self.short_of(now) == 0.0

    def is_flown(self, setpoint: Setpoint) -> bool:
        """Whether it is the script's that is flown already, but for its yaw."""
        asked = self.script.setpoint
        if not self.armed or self.mode is not Mode.OFFBOARD or asked is None:
            return False
        return is_same_way(setpoint, asked)

    # --- how

    def _set_home(self, home: Vec3) -> None:
        self.home = home
        self.home_changed += 1

    def _become(self, mode: Mode) -> None:
        self.mode = mode
        self._take_off_to = None
        self._end_approach()
        if mode is not Mode.OFFBOARD:
            self.script.owner = None

    def _disarm(self, t_us: int) -> None:
        self.armed, self.failsafe = False, None
        self.leader.take(None, t_us)
        self._landed.has_flown = False
        self._become(modes.after(self.mode, Event.DISARMED))
        self._set_wake()

    def _enter(self, mode: Mode, t_us: int) -> None:
        """Be in a mode, and lay down what it flies."""
        if mode is Mode.TAKEOFF and self.armed:
            self._take_off(self._climb(self._take_off_to, t_us), t_us)
            return
        self._become(mode)
        if not self.armed:
            return
        if mode is Mode.OFFBOARD:
            self._untold = self.fly_script(t_us)
            return
        assert self.home is not None
        plan = plans.plan_of(mode, self._from(t_us), self.home, self._params, self._limits())
        self._follow(plan, t_us, (mode, Event.ARRIVED) in modes.TRANSITIONS)

    def _follow(self, plan: Iterable[Piece], t_us: int, ends: bool = False) -> None:
        self.leader.follow(plan, t_us, ends)
        self._advance(t_us, [])

    # --- near the ground

    def _end_approach(self) -> None:
        """Another mode: what was begun near the ground is over."""
        self._approach = Approach.AS_ASKED
        self._touchdown.reset()

    def _steer(self, t_us: int) -> bool:
        """Fly the script's setpoint, or land if it leads into the ground; whether that begins."""
        asked, since_us, was = self.script.setpoint, self.script.since_us, self._approach
        if asked is None:
            return False
        age, ground = (t_us - since_us) * 1e-6, self._landed.ground
        self._approach = landing.approach_at(
            int(was), to_buffer(asked), age, self.state, ground, to_buffer(self._limits())
        )
        if self._approach is not Approach.DOWN:
            raised = self._approach is Approach.RAISED
            flown = landing.raised(asked, self.pose(), ground) if raised else asked
            self.leader.take(flown, since_us)
            if was is Approach.DOWN:
                self._touchdown.reset()
        elif was is not Approach.DOWN:
            self._land_from(landing.landing_from(carried(asked, age), self.pose(), ground), t_us)
            return True
        return False

    def _touch_down(self, t_us: int, meant: bool) -> bool:
        """Rest on the ground once what leads it down has met it, `meant` so or not; whether it has."""
        assert self.setpoint is not None
        here = self.pose()
        flown: Setpoint = carried(self.setpoint, (t_us - self.since_us) * 1e-6)
        if not self._touchdown.see(
            flown, here, self._landed.ground, t_us, meant, self._params.pace.f_m
        ):
            return False
        if self._touchdown.done:
            self.leader.take(landing.resting(flown, self._landed.light), t_us)
            return True
        self._land_from(here._replace(psi=flown.psi_c), t_us)
        return False

    def _land_from(self, here: Pose, t_us: int) -> None:
        r, v, psi = here
        slow_below = self._landed.ground + plans.SLOW_BELOW  # not a number: slow from here
        speed = self._params["MPC_LAND_SPEED"]
        self.leader.follow(plans.descent(r, v, psi, slow_below, speed, self._limits()), t_us)
        self.leader.advance(t_us)
