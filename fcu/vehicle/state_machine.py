"""One vehicle: armed or not, in which mode, what it flies; what it may be asked for, and when.

The one state machine. Pure: states, requests and times in, answers and events out, each a code
with numbers. It knows no socket, no clock and no message; the loop asks it at every tick what to
fly. Which mode may follow which is `modes`, what a mode flies `plans`, what a script's setpoint
asks for `setpoints`, what is done near the ground `landing`. Frames: Earth ENU; SI; times are
simulation time in whole microseconds, unless they are called wall.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain
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
from fcu.laws.setpoint import carried
from fcu.parameters import Fate, Parameters
from fcu.vehicle import landing, modes, plans
from fcu.vehicle.areas import Area
from fcu.vehicle.conditions import (
    CHARGE_US,
    HELD,
    MODES,
    NEAR,
    NO_MODEL,
    ROWS,
    Action,
    Clears,
    Condition,
    Due,
    Held,
    Values,
    Watch,
    fence_place_at,
    look,
    warm_up,
)
from fcu.vehicle.feasibility_check import FeasibilityCheck, Shortfall
from fcu.vehicle.fence import Fence, FenceLimits
from fcu.vehicle.follow import FOLLOW_US, Follower, Report, Target
from fcu.vehicle.landing import Approach, LandedDetector, TouchdownDetector
from fcu.vehicle.mission import Do, Mission, Step, first_place, is_finite, outside, placed
from fcu.vehicle.mission_flight import MissionFlight, Sees
from fcu.vehicle.modes import Event, Mode, Need
from fcu.vehicle.plan_check import Ground, along
from fcu.vehicle.plans import STILL, Circle, Leader, Piece, PlanLimits, Pose
from fcu.vehicle.returning import (
    RETURN_FACTOR,
    RETURN_MARGIN_S,
    Ending,
    ReturnType,
    battery_left_s,
    ending,
)
from fcu.vehicle.setpoints import (
    POSITION,
    Clocks,
    Owner,
    Script,
    Throttle,
    anchored,
    anchored_by_axis,
    is_lost,
    of_attitude,
    of_position,
    script_limits,
)
from fcu.vehicle.sticks import (
    CENTER,
    LOW,
    STEP_US,
    Accepts,
    Gesture,
    Seen,
    StickFlight,
    StickInput,
    Sticks,
    StickSource,
)

Row = np.ndarray[Any, np.dtype[np.float64]]

YAW_OF_ORBIT = 0.5  # rad/s, with which it turns at the entry of an orbit, at most
HIGHEST = 1000.0  # m: farther up no take-off goes
LEAST_UP = 0.5  # m: from the ground no place that is lower is flown to
TILT_TO_ARM = math.radians(25.0)

_FOUND, _VALUE = column_of(Watch, "found"), column_of(Watch, "value")
_LANDED, _TOUCHDOWN = slice_of(Watch, "landed"), slice_of(Watch, "touchdown")
_UNTIL, _LIMITS = slice_of(Watch, "due.until_us"), slice_of(Watch, "limits")
_VALUES, _HOME = slice_of(Watch, "values"), slice_of(Watch, "home")
_HELD = tuple(slice_of(Watch, name) for name in HELD)
_ASKED = slice_of(Watch, "script.asked")
_FENCE, _FENCE_PREDICTS = slice_of(Watch, "fence"), column_of(Watch, "fence.predicts")
_ROTORS_LOST, _SLOW_US, _FULL_SPEED = (
    slice_of(Watch, f"rotors.{name}") for name in ("lost", "slow_us", "Omega_max")
)
_ROTORS_TOLD, _LOOK = slice_of(Watch, "rotors.told"), column_of(Watch, "due.look_us")
_CHARGE_DUE = column_of(Watch, "charge_us")
_C_T, _DUE = slice_of(Watch, "c_T"), slice_of(Watch, "due")
_APPROACH, _KNOWN, _ASKED_SINCE, _HEARD, _LOST, _ANYWHERE, _LAG = (
    column_of(Watch, name)
    for name in (
        "script.approach", "script.known", "script.since_us", "due.heard_us",
        "due.lost_us", "anywhere_us", "lag_s",
    )
)  # fmt: skip
_STATION, _STICKS = slice_of(Watch, "station"), slice_of(Watch, "sticks")
_STATION_US, _STICKS_US, _STICKS_LOST = (
    column_of(Watch, name) for name in ("station.heard_us", "sticks.heard_us", "sticks.lost_us")
)
_MODE = slice(column_of(Watch, "in_offboard"), column_of(Watch, "in_idle") + 1)

# Bits of COM_RCL_EXCEPT
_WITHOUT_STICKS = {Mode.MISSION: 1, Mode.HOLD: 2, Mode.OFFBOARD: 4}

# Modes that lead the vehicle along ways that were held against the fence, or straight up or down.
_LED = frozenset(
    {Mode.MISSION, Mode.RETURN, Mode.LAND, Mode.TAKEOFF, Mode.ORBIT, Mode.STEP, Mode.FIGURE_EIGHT}
)
_NOTHING = plans.at(plans.STILL, 0.0)
_IDLE = Mode.HOLD, Mode.LAND, *modes.BY_STICKS  # on the ground a vehicle waits in these


def _flag(name: str) -> property:
    """A yes or no of the Watch."""
    at = column_of(Watch, name)

    def get(self: StateMachine) -> bool:
        return bool(self.watch[at])

    def put(self: StateMachine, yes: bool) -> None:
        self.watch[at] = yes

    return property(get, put)


def _number(name: str) -> property:
    """A number of the Watch."""
    at = column_of(Watch, name)

    def get(self: StateMachine) -> float:
        return float(self.watch[at])

    def put(self: StateMachine, value: float) -> None:
        self.watch[at] = value

    return property(get, put)


# the action that a loss of rotors takes at least, and how it is told
_LOSS = {Fate.FLIES: Action.WARN, Fate.LANDS: Action.LAND, Fate.FALLS: Action.TERMINATE}
_LOSS_SAID = {
    Fate.FLIES: Code.LOSS_SHARED, Fate.LANDS: Code.LOSS_LANDS, Fate.FALLS: Code.LOSS_FALLS,
}  # fmt: skip


class Answer(NamedTuple):
    """What a request came to. Refused, it has changed nothing."""

    granted: bool
    told: Told | None = None  # what is done, or why it is not; None: nothing to say
    later: bool = False  # refused for what may change in a moment


class FlightTimes(NamedTuple):
    """The last flight since the start of the vehicle. Simulation times, us. 0: it has not happened."""

    number: int = 0  # how often the vehicle was armed
    armed_us: int = 0
    took_off_us: int = 0
    landed_us: int = 0


def _refused(code: Code, *values: float) -> Answer:
    return Answer(False, Told(code, values))


class StateMachine:
    """Arming, modes and setpoint of one vehicle.

    What looks decide by is in `watch`, which is shared with compiled code, and nowhere else.
    """

    armed = _flag("armed")
    _untold = _flag("script.untold")  # a script's setpoint leads into the ground: to be told
    _armed_us, _landed_us = _number("armed_us"), _number("landed_us")
    _acts_us, _aloft_us = _number("acts_us"), _number("aloft_us")

    def __init__(self, params: Parameters, sim_only: bool = False) -> None:
        """`sim_only`: a script's stream is lost by simulation time alone."""
        self._params = params
        self.watch = np.zeros(size(Watch))
        self._active: dict[Condition, Action] = {}  # the conditions that have not cleared
        self.mission = Mission()
        self.fence = Fence()
        self._outside: tuple[object, tuple[int, Told] | None] | None = None  # asked last, and found
        self.rally: tuple[Vec3, ...] = ()  # m, E: beside home, where a return may end
        self.mode = Mode.HOLD
        self.home = None
        self.circle: Circle | None = None  # of the last orbit
        self.target = Target()  # of Follow Me
        self.home_changed = 0  # how often
        self.terminated = False
        self.ended: Told | None = None  # how the plant's flight has ended, if it has
        self.battery: Battery | None = None
        self.state: Row | None = None  # the last measured VehicleState, as its buffer
        self.state_failed = False  # says its sender of the state of the last tick
        self.reference_model: Row | None = None  # float64[6]: its r_m and v_m, after the last tick
        self.reference_acceleration: Row | None = None  # float64[3]: its a_m, of a law with a guard
        self.beginning: Callable[[], Row] | None = (
            None  # of a law whose demand is known: see `reference`
        )
        self.leader = Leader(self.watch[_UNTIL])
        self.script = Script(sim_only, self._write_script)
        self.sticks = StickInput(sim_only)
        self._station: Clocks | None = None  # when a ground station was heard last
        self._station_is_lost = False
        self._acts_us = self._aloft_us = self.watch[_CHARGE_DUE] = math.inf
        self.watch[_STATION] = self.watch[_STICKS] = math.inf
        self._stick_flight: StickFlight | None = None  # while sticks are flown
        self.feasibility = FeasibilityCheck(params)
        self.is_by_baseline = False  # the law has failed
        self._lacks_charge = False  # for the way home, when it was looked at last
        self._fate: Fate | None = None  # of the loss of rotors that was told last
        self._again: Iterator[Shortfall | None] | None = None  # another look at the plan
        self._lack: Shortfall | None = None  # that it has found
        self._looked_by, self._settings_seen = self.feasibility.policy, params.settings
        self._cruise: float | None = None
        self._on_ground = True  # until a state has shown otherwise
        self.flight_times = FlightTimes()
        self._landed = LandedDetector(
            params.law.rotors.c_T, params.pace.T_hover, self.watch[_LANDED]
        )
        self._touchdown = TouchdownDetector(self.watch[_TOUCHDOWN])
        self._to_tell: list[Told] = []  # at the next tick: of a plan that has begun
        self._take_off_to: float | None = None  # m, E: once it is armed; None: MIS_TAKEOFF_ALT
        self._took_over = False  # a condition has entered a mode, and nobody another since
        self._acts: Mapping[int, Callable[[int, float, list[Told]], None]] = {
            Condition.FIRST_STATE: self._first_state,
            Condition.LANDED: self._has_landed,
            Condition.APPROACH: self._approaches,
            Condition.UNTOLD: self._tell_script,
            Condition.TOUCHDOWN: self._touched_down,
            Condition.IDLE_LANDED: self._disarm_landed,
            Condition.IDLE_ARMED: self._disarm_idle,
            Condition.OFFBOARD_LOST: self._script_lost,
            Condition.FENCE_NEAR: self._look_at_fence,
            Condition.ATTITUDE_LOST: self._attitude_lost,
            Condition.ROTOR_LOST: self._rotor_lost,
            Condition.FLIGHT_TIME_LOW: self._look_at_charge,
            Condition.STATION_LOST: self._station_lost,
            Condition.STICKS_GONE: self._sticks_gone,
            Condition.ACTION_DUE: self._action_due,
            Condition.PLAN_DUE: self._plan_due,
        }
        params.lose(())  # after a reset every rotor turns again
        self.watch[_SLOW_US] = math.nan
        self._write_script()
        self.parameters_changed()
        params.followers.add(self)

    def warm_up(self) -> None:
        """Compile what is asked at ticks and looks."""
        self.feasibility.warm_up()
        self.fence.warm_up()
        warm_up(self._limits())
        ahead = Step(Do.GO_TO, Vec3(9.0, 0.0, 9.0))
        for _ in along((ahead, ahead._replace(place=Vec3(9.0, 9.0, 9.0))), self._ground(Pose(STILL, STILL, 0.0)), self.feasibility.look_anyhow):  # fmt: skip
            pass

    # --- what looks decide by

    @property
    def mode(self) -> Mode:
        """The flight mode."""
        return self._mode

    @mode.setter
    def mode(self, mode: Mode) -> None:
        self._mode = mode
        self.mission.lands &= mode is Mode.MISSION
        self._write_mode()

    def _write_mode(self) -> None:
        """Tell looks of the mode, and whether it brings the vehicle down."""
        down = self._mode is Mode.LAND or self.mission.lands
        self.watch[_FENCE_PREDICTS] = self._mode not in _LED and self._params["GF_PREDICT"] > 0.0
        self.watch[_MODE] = self._mode is Mode.OFFBOARD, down, self._mode in _IDLE
        bit = _WITHOUT_STICKS.get(self._mode, 0)
        ends = bit and not int(self._params["COM_RCL_EXCEPT"]) & bit
        self.watch[_STICKS_LOST] = self.sticks_lost_us if ends else math.inf

    @property
    def home(self) -> Vec3 | None:
        """The place to which a return flies."""
        return self._home

    @home.setter
    def home(self, home: Vec3 | None) -> None:
        self._home = home
        self.watch[_HOME] = math.nan if home is None else to_buffer(home)
        self._look_at_fence_anew()

    @property
    def cruise(self) -> float | None:
        """Cruise speed that was asked for, m/s. None stands for MPC_XY_CRUISE."""
        return self._cruise

    @cruise.setter
    def cruise(self, speed: float | None) -> None:
        self._cruise = speed
        self.watch[_LIMITS] = to_buffer(self._limits())

    @property
    def _approach(self) -> Approach:
        """How the script's setpoint is flown."""
        return Approach(int(self.watch[_APPROACH]))

    @_approach.setter
    def _approach(self, approach: Approach) -> None:
        self.watch[_APPROACH] = approach

    def _write_script(self) -> None:
        """Take over what the script's setpoint has become."""
        asked, watch = self.script.setpoint, self.watch
        watch[_KNOWN] = asked is not None
        if asked is not None:
            watch[_ASKED] = to_buffer(asked)
        watch[_ASKED_SINCE], watch[_HEARD] = self.script.since_us, self.script.heard_us

    def parameters_changed(self) -> None:
        """Take over the parameters in force."""
        p, watch = self._params, self.watch
        watch[_LOST] = self.lost_us
        watch[_VALUES] = [p[name] for name in Values._fields]
        looks = p["COM_FLTT_LOW_ACT"] > 0.0
        watch[_CHARGE_DUE] = min(watch[_CHARGE_DUE], 0.0) if looks else math.inf
        if self.lost_rotors:
            self._share_anew()
        watch[_STATION_US + 1] = self.station_lost_us if p["NAV_DLL_ACT"] > 0.0 else math.inf
        watch[_LIMITS] = to_buffer(self._limits())
        watch[_C_T] = to_buffer(self._landed.c_T)
        watch[_FULL_SPEED] = to_buffer(p.law.rotors.Omega_max)
        watch[_ANYWHERE], watch[_LAG] = landing.anywhere_us(p.pace.f_m), 2.0 / p.pace.f_m
        across, up = p["GF_MAX_HOR_DIST"], p["GF_MAX_VER_DIST"]
        self.fence.limits = FenceLimits(across or math.inf, up or math.inf)
        self._write_mode()
        self._look_at_fence_anew()

    @property
    def failsafe(self) -> bool:
        """True while the vehicle flies a mode that a condition has entered."""
        return self._took_over

    def law_has_failed(self) -> None:
        """Forget the law: another flies, of which no guard and no reference model tells."""
        self.is_by_baseline = True
        self.reference_model = self.reference_acceleration = self.beginning = None
        self.feasibility.end()

    @property
    def takes_failures(self) -> bool:
        """True if failures may be injected by command."""
        return self._params["SYS_FAILURE_EN"] > 0.0

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
        """True on the ground, as of the last tick that was decided about: a burst may be ahead."""
        return self._on_ground

    @property
    def is_landing(self) -> bool:
        """Whether it comes down, for itself or for a script."""
        lands = self.mode is Mode.LAND or self.mission.lands
        return lands or self._approach is Approach.DOWN

    @property
    def leads_itself(self) -> bool:
        """True while the vehicle flies its own plan. The guard has checked at most how it begins."""
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
        """Act on the conditions of a tick, and return their codes. `state`: a VehicleState buffer.

        Called at every tick. Does nothing before `wake_us`.
        """
        self.state = state
        told, self._to_tell = self._to_tell, []
        found = int(self.watch[_FOUND])  # by compiled code, at this tick
        if not found and t_us < self.wake_us:
            return told
        found = found or self._look(t_us)
        while found:
            act = self._acts.get(found)
            if act is None:
                self._meet(Condition(found), (float(self.watch[_VALUE]),), t_us, told)
            else:
                act(t_us, wall_s, told)
            found = self._look(t_us)
        return told

    def _look(self, t_us: int) -> int:
        """The next condition that is new at this tick, or 0."""
        flown = _NOTHING if self.setpoint is None else self.setpoint
        age = (t_us - self.since_us) * 1e-6
        remaining = math.nan if self.battery is None else self.battery.remaining
        model = NO_MODEL if self.reference_model is None else self.reference_model
        return int(
            look(self.watch, self.state, model, to_buffer(flown), age, remaining, float(t_us))
        )

    @property
    def wake_us(self) -> float:
        """Nothing happens by itself before."""
        due = from_buffer(Due, self.watch[_DUE])
        scripted = self.armed and self.mode is Mode.OFFBOARD
        lost = due.heard_us + due.lost_us + 1.0 if scripted else math.inf
        return min(due.look_us, due.until_us, lost)

    # --- conditions

    def find(self, condition: Condition, values: tuple[Any, ...], t_us: int) -> list[Told]:
        """Act on a condition that is found beside the look. Returns what is told of it."""
        told: list[Told] = []
        if self.armed:
            self._meet(condition, values, t_us, told)
        return told

    def is_gone(self, condition: Condition) -> None:
        """Forget a condition that its detector, beside the look, no longer finds."""
        self._active.pop(condition, None)

    def _meet(
        self, condition: Condition, values: tuple[Any, ...], t_us: int, told: list[Told],
        action: Action | None = None, at_once: bool = False,
    ) -> None:  # fmt: skip
        """Tell of a condition. Unless it only warns take the most severe action of all active ones.

        `action`: in place of that of its row.  `at_once`: without waiting for COM_FAIL_ACT_T.
        """
        row = ROWS[condition]
        action = row.action(self._params) if action is None else action
        self._active[condition] = action
        if action > Action.NONE:
            told.append(Told(row.code, values))
        if action > Action.WARN:
            self._tell_action(self._take_worst(t_us, at_once), told)

    def _tell_action(self, mode: Mode | None, told: list[Told]) -> None:
        """Tell the mode that a failsafe has entered, what it waits for there, or that rotors stand."""
        if self._acts_us < math.inf:
            worst = MODES[max(self._active.values())]
            told.append(Told(Code.FAILSAFE_LATER, (self._params["COM_FAIL_ACT_T"], worst.value)))
        elif mode is not None:
            told.append(Told(Code.FAILSAFE_MODE, (mode.value,)))
        elif not self.armed:
            told.append(Told(Code.FAILSAFE_STOPPED))

    def _attitude_lost(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        """Terminate, or only warn. Just after arming, when it may stand on its side: disarm."""
        soon = t_us - self._armed_us < self._params["COM_LKDOWN_TKO"] * 1e6
        tilt = (float(self.watch[_VALUE]),)
        self._meet(Condition.ATTITUDE_LOST, tilt, t_us, told, Action.DISARM if soon else None)

    @property
    def lost_rotors(self) -> tuple[int, ...]:
        """Numbers of the rotors that are lost, from 1."""
        lost = self.watch[_ROTORS_LOST] + self.watch[_ROTORS_TOLD]
        return tuple(int(i) + 1 for i in np.flatnonzero(lost))

    @property
    def rotor_count(self) -> int:
        """How many rotors the airframe has."""
        return int(self._params["CA_ROTOR_COUNT"])

    def tell_rotor(self, rotor: int, lost: bool) -> list[Told]:
        """Note that a rotor was stopped by an order, or turns again. Returns what is to be said of it.

        rotor : from 1. A rotor that is stopped is told as lost at the next tick.
        """
        at, told = _ROTORS_LOST.start + rotor - 1, _ROTORS_TOLD.start + rotor - 1
        self.watch[told] = lost and not self.watch[at]
        if self.watch[told]:
            self.watch[_LOOK] = 0.0  # at once
        if lost or not self.watch[at]:
            return []
        self.watch[at] = 0.0
        was_void = self._params.is_void
        self._fate = self._share()
        if not self.lost_rotors:
            self.is_gone(Condition.ROTOR_LOST)
        elif Condition.ROTOR_LOST in self._active:
            self._active[Condition.ROTOR_LOST] = self._loss_action(self._fate)
        promises_again = was_void and self._params.is_promised
        return [
            Told(Code.ROTOR_BACK, (rotor,)),
            *([Told(Code.GUARD_BACK)] if promises_again else []),
        ]

    def _share(self) -> Fate | None:
        """Have the law give no work to what is lost. Returns what the vehicle can do. None: as before."""
        if self._params["CA_FAILURE_MODE"] == 0.0:
            self._params.lose(self.lost_rotors, shared=False)
            fate = None
        else:
            fate = self._params.lose(self.lost_rotors)
        self.watch[_LIMITS] = to_buffer(self._limits())
        return fate

    def _share_anew(self) -> None:
        """Share the work by the parameters in force. If that changes the Fate, the next look acts on it."""
        if self._share() is not self._fate:
            at = int(np.flatnonzero(self.watch[_ROTORS_LOST] + self.watch[_ROTORS_TOLD])[0])
            self.watch[_ROTORS_TOLD.start + at] = 1.0
            self.watch[_LOOK] = 0.0

    def _loss_action(self, fate: Fate | None) -> Action:
        """The action on a loss of rotors: the one that is asked for, or what the vehicle does at least."""
        wanted = ROWS[Condition.ROTOR_LOST].action(self._params)
        return wanted if fate is None else max(wanted, _LOSS[fate])

    def _look_at_charge(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        """Hold what is left of the battery against the way home: twice in a row it does not last."""
        self.watch[_CHARGE_DUE] = t_us + CHARGE_US
        flies = not self._landed.landed and not self.is_landing and self.mode is not Mode.RETURN
        lasts = self._charge_lasts(self.pose().r_E) if flies and self.home is not None else None
        was, self._lacks_charge = self._lacks_charge, lasts is False
        if was and self._lacks_charge and Condition.FLIGHT_TIME_LOW not in self._active:
            left_s = battery_left_s(self.battery, self._params["BAT1_CAPACITY"]) or 0.0
            self._meet(Condition.FLIGHT_TIME_LOW, (left_s,), t_us, told)

    def _rotor_lost(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        """Fly on without a rotor, if that is asked for and can be. Else land, or let the rotors stand."""
        rotor = int(self.watch[_VALUE])
        self.watch[_ROTORS_TOLD.start + rotor - 1] = 0.0
        self.watch[_ROTORS_LOST.start + rotor - 1] = 1.0
        was_promised = self._params.is_promised
        self._fate = fate = self._share()
        code = Code.LOSS_NOT_SHARED if fate is None else _LOSS_SAID[fate]
        self._meet(
            Condition.ROTOR_LOST, (rotor, Told(code)), t_us, told, self._loss_action(fate),
            at_once=fate is Fate.LANDS,
        )  # fmt: skip
        if was_promised and not self._params.is_promised:
            told.append(Told(Code.GUARD_VOID))

    @property
    def station_lost_us(self) -> int:
        """Age of a ground station's last heartbeat at which it is lost, us."""
        return round(self._params["COM_DL_LOSS_T"] * 1e6)

    def hear_station(self, t_us: int, wall_s: float) -> Told | None:
        """Note that a ground station was heard. Returns what is to be said of it."""
        self._station = Clocks(t_us, wall_s)
        self.watch[_STATION_US] = t_us
        was_lost, self._station_is_lost = self._station_is_lost, False
        return Told(Code.STATION_BACK) if was_lost else None

    def _station_lost(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        """The ground station is lost by simulation time, and is lost indeed if it is by the wall's too."""
        if not is_lost(
            self._station, t_us, wall_s, self.station_lost_us, self.script.sim_only
        ):  # fmt: skip
            return
        self.watch[_STATION_US], self._station_is_lost = math.inf, True
        self._meet(Condition.STATION_LOST, (self._params["COM_DL_LOSS_T"],), t_us, told)

    def _sticks_gone(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        """Sticks are lost in a mode that they do not fly."""
        if self.sticks.lost(t_us, wall_s, self.sticks_lost_us):
            self.watch[_STICKS_US] = math.inf
            self._sticks_lost(t_us, told)

    def _action_due(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        """Go on from the Hold before an action, unless what called for it is over."""
        mode = self._take_worst(t_us, at_once=True)
        if mode is not None:
            self._tell_action(mode, told)

    def _take_worst(self, t_us: int, at_once: bool = False) -> Mode | None:
        """Take the most severe action of the active conditions: the mode that it enters, if one.

        On the ground a vehicle holds in place of a return. A landing goes on in place of one. In the
        air it holds for COM_FAIL_ACT_T before it returns or lands, unless `at_once`.
        """
        if at_once:
            self._acts_us = math.inf
        worst = max(self._active.values(), default=Action.NONE)
        if worst >= Action.DISARM:
            self.terminated |= worst is Action.TERMINATE
            self._disarm(t_us)
            return None
        if worst is Action.RETURN and self._landed.landed:
            worst = Action.HOLD
        elif worst is Action.RETURN and (self._touchdown.done or self._approach is Approach.DOWN):
            worst = Action.LAND  # it has met the ground, or a script lands it
        flown = next((action for action, mode in MODES.items() if mode is self.mode), Action.NONE)
        goes_on = flown > worst or (flown is worst and worst is not Action.HOLD)
        if worst not in MODES or goes_on:  # in Hold it may be on its way to another place
            return None
        waits = self._params["COM_FAIL_ACT_T"] > 0.0 and not at_once and worst > Action.HOLD
        if waits and not self._landed.landed and not self._touchdown.done:
            if self._acts_us < math.inf:
                return None  # it waits already
            self._acts_us = t_us + self._params["COM_FAIL_ACT_T"] * 1e6
            worst = Action.HOLD
        if self._touchdown.done:
            self._rest_in(MODES[worst], t_us)
        else:
            self._enter(MODES[worst], t_us)
        self._took_over = True
        return MODES[worst]

    def _rest_in(self, mode: Mode, t_us: int) -> None:
        """Be in a mode on the ground that was met, where the vehicle goes on to rest.

        It may be unknown yet whether it has landed: one that held its position there would lean
        against the wind.
        """
        if self._stick_flight is not None:
            self._stick_flight = None
            self.leader.take(landing.resting(self.flown(t_us), self._landed.light), t_us)
        self.mode, self._approach, self.script.owner = mode, Approach.AS_ASKED, None

    def _clear(self, *ends: Clears) -> None:
        """Forget the conditions that clear in one of these ways."""
        for condition in [c for c in self._active if ROWS[c].clears in ends]:
            del self._active[condition]
        if Clears.CHOSEN in ends:
            self._took_over = False
            self._acts_us = math.inf
        if Clears.DISARMED in ends:
            for held in _HELD:
                self.watch[held] = Held(level=0.0, pending=0.0, since_us=math.nan)

    def _first_state(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        self._set_home(self.pose().r_E)

    def _look_at_fence_anew(self) -> None:
        """Let the next look hold the vehicle against a fence that has changed, if there is one."""
        if self.home is not None:
            self.fence.home = self.home
        radius = 0.0 if self.fence.is_set else math.inf
        self.watch[_FENCE] = 0.0, 0.0, 0.0, radius, self.watch[_FENCE_PREDICTS]
        if not self.fence.is_set:
            self.fence.is_breached = False
            self._active.pop(Condition.FENCE_BREACHED, None)

    def _look_at_fence(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        """Hold the vehicle against the fence. It is looked at again once it may have crossed it."""
        was, predicts = self.fence.is_breached, float(self.watch[_FENCE_PREDICTS])
        flown, age = self.setpoint or _NOTHING, (t_us - self.since_us) * 1e-6
        place: Vec3 = fence_place_at(
            self.state, to_buffer(flown), age, predicts, self.watch[_LIMITS]
        )
        margin = self.fence.see(place, t_us)
        self.watch[_FENCE] = *place, abs(margin.value), predicts
        if self.fence.is_breached and not was:
            self._meet(Condition.FENCE_BREACHED, (), t_us, told)
        elif was and not self.fence.is_breached:
            self._active.pop(Condition.FENCE_BREACHED, None)
            told.append(Told(Code.FENCE_INSIDE))

    def _has_landed(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        self._on_ground = self._landed.landed
        if self._on_ground:
            self._landed_us = t_us
            self._aloft_us = math.inf
            self.flight_times = self.flight_times._replace(landed_us=t_us)
            told.append(Told(Code.LANDED))
            if self.mode is Mode.MISSION and self.mission.lands:
                self._mission_landed(t_us)
        else:
            self._aloft_us = t_us
            self.flight_times = self.flight_times._replace(took_off_us=t_us, landed_us=0)

    def _approaches(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        self._untold |= self._steer(t_us)

    def _tell_script(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        self._untold = False
        told.append(Told(Code.SETPOINT_INTO_GROUND))

    def _disarm_landed(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        self._disarm(t_us)
        told.append(Told(Code.DISARMED_LANDED))

    def _disarm_idle(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        self._disarm(t_us)
        told.append(Told(Code.DISARMED_IDLE))

    @property
    def lost_us(self) -> int:
        """How old a script's last setpoint may be, us."""
        return round(self._params["COM_OF_LOSS_T"] * 1e6)

    def _script_lost(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        """The script is lost by simulation time, and is lost indeed if it is by the wall's too."""
        if not self.script.lost(t_us, wall_s, self.lost_us):
            return
        self.script.forget()
        row, silent = ROWS[Condition.OFFBOARD_LOST], self._params["COM_OF_LOSS_T"]
        self._active[Condition.OFFBOARD_LOST] = row.action(self._params)
        self._tell_lost(self._take_worst(t_us), row.code, Code.OFFBOARD_LOST_STOPPED, silent, told)

    def _tell_lost(
        self, mode: Mode | None, code: Code, stopped: Code, silent: float, told: list[Told]
    ) -> None:
        """Tell that a sender was silent for so long (s), and the mode that is flown without it."""
        if not self.armed:
            told.append(Told(stopped, (silent,)))
            return
        told.append(Told(code, (silent, self.mode.value)))
        if mode is Mode.HOLD and self._acts_us < math.inf:
            self._tell_action(mode, told)

    def _plan_due(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        """On to the next piece of a plan, or of what sticks ask for, unless they are lost."""
        if self._stick_flight is not None and self.sticks.lost(t_us, wall_s, self.sticks_lost_us):
            self._sticks_lost(t_us, told)
        else:
            self._advance(t_us, told)

    @property
    def sticks_lost_us(self) -> int:
        """Age at which the last sticks are lost, us."""
        return round(self._params["COM_RC_LOSS_T"] * 1e6)

    def _sticks_lost(self, t_us: int, told: list[Told]) -> None:
        """Fly on without sticks, as NAV_RCL_ACT says."""
        row, silent = ROWS[Condition.STICKS_LOST], self._params["COM_RC_LOSS_T"]
        self._active[Condition.STICKS_LOST] = row.action(self._params)
        self._tell_lost(self._take_worst(t_us), row.code, Code.STICKS_LOST_STOPPED, silent, told)

    def _advance(self, t_us: int, told: list[Told]) -> None:
        """On to the setpoint of this moment, and to the mode that follows at the end of a plan."""
        ended = self.leader.advance(t_us)
        if self.mode is Mode.MISSION:
            self._write_mode()
            told += self.mission.events
            self.mission.events.clear()
        if not ended:
            return
        event = Event.HANDS_OVER if self.mode is Mode.MISSION else Event.ARRIVED
        if self.mode is Mode.MISSION and not self.mission.hands_over:
            return
        following = modes.after(self.mode, event)
        told.append(Told(Code.PLAN_COMPLETE, (self.mode.value, following.value)))
        end = self.leader.setpoint
        assert end is not None
        self._enter(following, t_us, Pose(end.r_c, end.v_c, end.psi_c))

    # --- what it is asked for

    def arm(self, t_us: int, wall_s: float) -> Answer:
        """Start the rotors; the vehicle holds, takes off or flies the mode it is in."""
        if self.armed:
            return Answer(True)
        why = self.why_not_arm(t_us, wall_s)
        if why is not None:
            return Answer(False, why)
        self.armed, self._armed_us = True, t_us
        self.flight_times = FlightTimes(self.flight_times.number + 1, armed_us=t_us)
        self._clear(Clears.CHOSEN, Clears.DISARMED)
        self._landed.has_flown = not self._landed.landed
        self._aloft_us = math.inf if self._landed.landed else -math.inf
        if self._landed.landed:
            self._set_home(self.pose().r_E)
        self._enter(self.mode, t_us)
        return Answer(True, Told(Code.ARMED))

    def why_not_arm(self, t_us: int, wall_s: float) -> Told | None:
        """The first reason against arming; None if there is none."""
        if self.unfit is not None:
            return self.unfit
        if self._params["NAV_DLL_ACT"] > 0.0 and is_lost(
            self._station, t_us, wall_s, self.station_lost_us, self.script.sim_only
        ):
            return Told(Code.NO_STATION)
        if self.mode is Mode.TAKEOFF:
            return self._why_not_take_off(self._take_off_to, t_us, wall_s)
        if self.mode is Mode.MISSION:
            return self._why_not_fly_plan() if self.mission.steps else Told(Code.NO_MISSION)
        if self.mode in modes.ALOFT:
            return Told(Code.MODE_NOT_TO_ARM, (self.mode.value,))
        if self.mode in modes.BY_STICKS:
            return self._why_not_by_sticks(t_us, wall_s)
        if self.mode is not Mode.OFFBOARD or self.script.ready(t_us, wall_s, self.lost_us):
            return None
        return Told(Code.NO_STREAM)

    def _why_not_by_sticks(self, t_us: int, wall_s: float) -> Told | None:
        """The reason against arming in a mode that sticks fly: none, or a throttle that is not low."""
        if self.sticks.lost(t_us, wall_s, self.sticks_lost_us):
            return None if self.mode is Mode.POSITION else Told(Code.NO_STICKS)
        throttle = self.sticks.now.throttle
        if self.mode in modes.BY_THRUST:
            return None if throttle < LOW else Told(Code.THROTTLE_NOT_LOW)
        return None if throttle <= CENTER else Told(Code.THROTTLE_ABOVE_MIDDLE)

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
        if self.state_failed:
            return Told(Code.HAS_NO_VALID_STATE)
        if matrix(m.q_EB).e3.z < math.cos(TILT_TO_ARM):
            return Told(Code.TILTED, (math.degrees(TILT_TO_ARM),))
        if self.lost_rotors:
            return Told(Code.ROTOR_IS_LOST, (self.lost_rotors[0],))
        outside = self.fence.margin(m.r_E).value < 0.0
        if outside and self._params["GF_ACTION"] > 1.0:
            return Told(Code.OUTSIDE_FENCE)
        return self._charge_critical

    @property
    def _charge_critical(self) -> Told | None:
        """The reason against leaving the ground with a critical charge; None if it is not."""
        if self.battery is None or not self.battery.remaining < self._params["BAT_CRIT_THR"]:
            return None
        return Told(Code.CHARGE_CRITICAL, (100.0 * self.battery.remaining,))

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
        if wanted is Mode.TAKEOFF and self.armed and not self._landed.landed:
            return self.take_off(None, t_us, wall_s)
        need = modes.denied(wanted, self._met(t_us, wall_s))
        # disarmed, modes may be chosen that cannot be flown: arming asks for their needs then
        if need is not None and (self.armed or wanted is Mode.OFFBOARD):
            missing = need is Need.SETPOINTS
            refused = missing and self.feasibility.refused
            return Answer(False, Told(Code.GUARD_REFUSES if refused else need.value), missing)
        if wanted is Mode.ORBIT:
            return _refused(Code.ORBIT_BY_COMMAND)
        too_much = plans.asks_too_much(wanted, self._params)
        if wanted is Mode.TAKEOFF:
            too_much = too_much or self._charge_critical
        if too_much is not None:
            return Answer(False, too_much)
        if wanted is Mode.MISSION:
            too_much = self._why_not_fly_plan()
        if too_much is not None:
            return Answer(False, too_much)
        lack: Shortfall | None = None
        if wanted is Mode.STEP:
            away = Vec3(*(self._params[f"REF_STEP_{axis}"] for axis in "ENU"))
            lack = self.feasibility.of_step(self._from(t_us), away, self._limits(), self.reference)
        if lack is not None and self.feasibility.refuses:
            return Answer(False, lack.reason)
        self._clear(Clears.CHOSEN)
        if wanted is Mode.MISSION and self.mission.current >= len(self.mission.steps):
            self.mission.restart()
        self._enter(wanted, t_us)
        name = wanted.value
        short = lack is not None and Told(Code.MODE_SHORT, (name, lack.short))
        return Answer(True, short or Told(Code.MODE, (name,)))

    # --- its plan

    def take_plan(self, steps: tuple[Step, ...], t_us: int) -> None:
        """Take another plan in place of the one there is. None: clear it.

        In mode Mission the new plan is flown from its first step, and none is left for Hold.
        """
        self.mission.replace(steps)
        self._again, self._lack, self._looked_by = None, None, self.feasibility.policy
        self._fly_plan_anew(t_us)

    def plan_outside(self, steps: tuple[Step, ...]) -> tuple[int, Told] | None:
        """The first step whose place, or the way to it, is not inside the fence. Why. None: none."""
        if not self.fence.is_set:
            return None
        home = self.home or (Vec3(0.0, 0.0, 0.0) if self.state is None else self.pose().r_E)
        asked = steps, home, self.fence.areas, self.fence.limits
        if self._outside is None or self._outside[0] != asked:  # a client may ask again and again
            self._outside = asked, outside(steps, home, self.fence.first_outside)
        return self._outside[1]

    def look_again(self) -> Told | None:
        """Go on with another look at the plan, if MR_GUARD has changed since the last. Returns its finding, once.

        The step that is flown now is the first that is looked at.
        """
        if self._params.settings is not self._settings_seen:
            self._settings_seen = self._params.settings
            if self._is_look_due:
                self._looked_by, self._lack = self.feasibility.policy, None
                plan = self.mission
                first = plan.current if plan.current < len(plan.steps) else 0
                self._again = self.look_along(plan.steps, first)
        if self._again is None:
            return None
        for found in self._again:
            if found is None:
                return None
            self._lack = found
        self._again = None
        lack = self._lack
        if lack is None:
            return None
        if self.feasibility.refuses:
            return Told(
                Code.DENIED, (Mode.MISSION.value, Told(Code.ITEM, (lack.item, lack.reason)))
            )
        return Told(Code.PLAN_SHORT, (lack.item, lack.short))

    @property
    def _is_look_due(self) -> bool:
        """Tell whether the guard that there is now has not looked at the plan."""
        return bool(self.mission.steps) and self.feasibility.policy != self._looked_by

    def _why_not_fly_plan(self) -> Told | None:
        """The reason why the plan must not be flown on. None if it may."""
        found = self._plan_outside(self.mission.steps, self.mission.current)
        if found is not None or not self.feasibility.refuses:
            return found
        if self._is_look_due or self._again is not None:
            return Told(Code.PLAN_IN_LOOK)
        return None if self._lack is None else Told(Code.ITEM, (self._lack.item, self._lack.reason))

    def look_along(self, steps: tuple[Step, ...], first: int = 0) -> Iterator[Shortfall | None]:
        """Look at a plan before it is taken. Yields None to pause, and at last the item that lacks most, if one does.

        Where the guard refuses, the first item that lacks anything ends the look. Nobody looks where the guard governs, and before the plant was heard.
        """
        look = self.feasibility.look
        if look is None or self.state is None or not steps:
            return
        worst: Shortfall | None = None
        for found in along(steps, self._ground(self.pose()), look, first):
            if found is not None and (short := -found.tightest.margin) > 0.0:
                if worst is None or short > worst.short:
                    worst = Shortfall(short, Told(Code.ITEM_SHORT, (short,)), found.item)
                if self.feasibility.refuses:
                    break
            yield None
        if worst is not None:
            yield worst

    def _ground(self, here: Pose) -> Ground:
        """All that a look along a plan from here asks."""
        return Ground(
            pose=here._replace(v_E=STILL), landed=self._landed.landed, home=self.home or here.r_E,
            is_clear=self.fence.is_clear, parameter=self._params.__getitem__,
            limits=lambda cruise: plans.limits(self._params, cruise, self.feasibility.pace),
        )  # fmt: skip

    def _plan_outside(self, steps: tuple[Step, ...], current: int) -> Told | None:
        """The reason why a plan must not be flown from a step on. None if it may."""
        found = self.plan_outside(steps)
        if found is not None:
            return Told(Code.ITEM, found)
        if not self.fence.is_set or self.state is None:
            return None
        first = first_place(steps, current)
        if first is None:
            return None
        place = placed(steps[first], self.home or self.pose().r_E)
        assert place is not None
        here = self.pose().r_E
        z = place.z if math.isfinite(place.z) else here.z
        to = Vec3(place.x, place.y, z) if is_finite(Vec3(place.x, place.y, 0.0)) else here
        over = Vec3(here.x, here.y, max(here.z, z)) if self._landed.landed else here
        return (
            None
            if self.fence.is_clear(over, to)
            else Told(Code.ITEM, (first, Told(Code.WAY_OUTSIDE)))
        )

    def take_fence(self, areas: tuple[Area, ...]) -> None:
        """Take another fence in place of the one there is. Without areas: none."""
        self.fence.areas = areas
        self._look_at_fence_anew()

    def _ending(self, here: Vec3, was: Mode) -> Ending:
        """The end of a return from a place. `was`: the mode before it."""
        assert self.home is not None
        kind = ReturnType(int(self._params["RTL_TYPE"]))
        flown = was is Mode.MISSION and not self.mission.is_complete
        lasts = self._charge_lasts(here) if kind is ReturnType.CHARGE else None
        return ending(kind, here, self.home, self.rally, self.mission, flown, lasts)

    def _charge_lasts(self, here: Vec3) -> bool | None:
        """Tell whether the battery lasts for a return home from a place, with PX4's margin. None: not known."""
        assert self.home is not None
        left_s = battery_left_s(self.battery, self._params["BAT1_CAPACITY"])
        if left_s is None:
            return None
        led, height = self._limits(), here.z - self.home.z
        up = max(self._params["RTL_RETURN_ALT"] - height, 0.0)
        down, across = height + up, math.hypot(here.x - self.home.x, here.y - self.home.y)
        for_s = up / led.up + across / led.cruise + down / self._params["MPC_LAND_SPEED"]
        return RETURN_FACTOR * for_s + RETURN_MARGIN_S < left_s

    def _around(self, start: Vec3, end: Vec3) -> list[Vec3]:
        """The places of the way home: straight, or around what the fence forbids if there is such a way."""
        way = self.fence.way(start, end)
        if way is None:
            self._to_tell.append(Told(Code.RETURN_STRAIGHT))
        return way or [end]

    def set_current(self, step: int, t_us: int) -> Answer:
        """Go on with this step of the plan, at once in mode Mission."""
        if not 0 <= step < len(self.mission.steps):
            return _refused(Code.NO_ITEM, step, len(self.mission.steps))
        self.mission.set_current(step)
        if self.mode is Mode.MISSION and self.mission.steps:
            self._fly_plan_anew(t_us)
        return Answer(True, Told(Code.CURRENT_ITEM, (step,)))

    def start_plan(self, step: int, t_us: int, wall_s: float) -> Answer:
        """Enter mode Mission at a step (below 0: the current one), and arm."""
        if step >= 0:
            jumped = self.set_current(step, t_us)
            if not jumped.granted:
                return jumped
        if not self.armed and self.unfit is not None:
            return Answer(False, self.unfit)
        entered = self.select(Mode.MISSION, t_us, wall_s)
        return self.arm(t_us, wall_s) if entered.granted and not self.armed else entered

    def _fly_plan_anew(self, t_us: int) -> None:
        if self.mode is Mode.MISSION:
            self._enter(Mode.MISSION if self.mission.steps else Mode.HOLD, t_us)

    def _mission_landed(self, t_us: int) -> None:
        """The landing of a plan is done: the plan goes on, if it has more to do."""
        self.mission.lands = False
        self.mission.done()
        if self.mission.current < len(self.mission.steps):
            self._landed_us = math.inf  # it is not disarmed before the plan is complete
            self._enter(Mode.MISSION, t_us)
        else:
            self.mission.lands = True  # as long as it stands there: nothing leads it up
            self.mission.complete()
            self._to_tell.append(Told(Code.MISSION_COMPLETE))

    def _sees(self, t_us: int) -> Sees:
        """All that the flight of a plan asks."""

        def off(r: Vec3) -> float:
            there = plans.length(self.pose().r_E - r)
            if self.reference_model is None:
                return there
            return max(there, plans.length(Vec3(*self.reference_model[:3].tolist()) - r))

        def limits(cruise: float | None) -> PlanLimits:
            wanted = self.cruise if cruise is None else None if cruise < 0.0 else cruise
            return plans.limits(self._params, wanted, self.feasibility.pace)

        def takes_off() -> None:
            self._landed_us = math.inf  # what takes off does not wait on the ground

        return Sees(
            off=off, pose=self.pose, is_landed=lambda: self._landed.landed,
            home=lambda: self.home or self.pose().r_E, ground=lambda: self._landed.ground,
            limits=limits, is_clear=self.fence.is_clear,
            set_cruise=self.change_speed, set_home=self.set_home,
            light=lambda: self._landed.light, takes_off=takes_off,
            parameter=self._params.__getitem__, yaw_rate=lambda: self._params.pace.yaw_rate_max,
        )  # fmt: skip

    def take_off(self, to_z: float | None, t_us: int, wall_s: float) -> Answer:
        """Climb to the height `to_z` (m, E), or by MIS_TAKEOFF_ALT; then hold.

        A vehicle that is not armed does so once it is. One in the air goes up from where it is, to
        MIS_TAKEOFF_ALT above home if no height is told, or holds if it is higher already.
        """
        if self.armed and not self._landed.landed:
            return self._climb_on(to_z, t_us)
        why = self._why_not_take_off(to_z, t_us, wall_s)
        if why is not None:
            return Answer(False, why)
        height = self._climb(to_z, t_us)
        self._clear(Clears.CHOSEN)
        if self.armed:
            self._take_off(height, t_us)
            return Answer(True, Told(Code.TAKING_OFF, (height,)))
        self._become(Mode.TAKEOFF)
        self._take_off_to = to_z
        return Answer(True, Told(Code.TAKES_OFF_ONCE_ARMED, (height,)))

    def _climb_on(self, to_z: float | None, t_us: int) -> Answer:
        here, led = self._from(t_us), self._limits()
        if to_z is None:
            home = here.r_E if self.home is None else self.home
            to_z = home.z + self._params["MIS_TAKEOFF_ALT"]
        if not to_z - here.r_E.z <= HIGHEST:
            return _refused(Code.TAKEOFF_HEIGHT, to_z - here.r_E.z)
        self._clear(Clears.CHOSEN)
        self._become(Mode.TAKEOFF)
        stops = plans.brake(here.r_E, here.v_E, here.psi, led)[1]
        up = stops._replace(z=max(stops.z, to_z))
        settle = plans.settle_s(self._params)
        self._follow(
            plans.through(here.r_E, here.v_E, [up], here.psi, led, settle), t_us, ends=True
        )
        return Answer(True, Told(Code.TAKING_OFF, (up.z - here.r_E.z,)))

    def _why_not_take_off(self, to_z: float | None, t_us: int, wall_s: float) -> Told | None:
        need = modes.denied(Mode.TAKEOFF, self._met(t_us, wall_s))
        if need is not None:
            return Told(need.value)
        if self._charge_critical is not None:
            return self._charge_critical
        height = self._climb(to_z, t_us)
        return None if 0.0 < height <= HIGHEST else Told(Code.TAKEOFF_HEIGHT, (height,))

    def _climb(self, to_z: float | None, t_us: int) -> float:
        """How far it is up from here, m."""
        return self._params["MIS_TAKEOFF_ALT"] if to_z is None else to_z - self._from(t_us).r_E.z

    def _take_off(self, height: float, t_us: int) -> None:
        here, settle_s = self._from(t_us), plans.settle_s(self._params)
        self._landed_us = t_us  # what takes off does not wait on the ground
        self._become(Mode.TAKEOFF)
        led = self._limits()
        led = led._replace(up=min(led.up, self._params["MPC_TKO_SPEED"]))
        self._follow(plans.take_off(here, height, led, settle_s), t_us, ends=True)

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
        """Hold somewhere else: straight there, within the limits; `speed`: as `change_speed`.

        A place that is not inside the fence is refused, as by PX4.
        """
        if self.fence.is_set and not self.fence.is_clear(to, to):
            return Answer(False, Told(Code.PLACE_OUTSIDE))
        return self._go(to, psi, t_us, speed)

    def orbit(self, circle: Circle, t_us: int) -> Answer:
        """Fly to the nearest point of a circle, and round it until something else is asked for.

        Refuses what the limits, or the guard on the way there, do not allow.
        """
        if not self.armed or self.state is None:
            return _refused(Code.NOT_ARMED)
        if self._landed.landed:
            return _refused(Code.NOT_AIRBORNE)
        here, led = self._from(t_us), self._limits()
        if not plans.RADIUS_LEAST <= circle.radius <= plans.RADIUS_MOST:
            return _refused(Code.ORBIT_RADIUS, circle.radius)
        top = self._params["MPC_XY_VEL_MAX"]
        fastest = plans.limits(self._params, top, self.feasibility.pace).cruise
        if not 0.0 < circle.speed <= fastest:
            return _refused(Code.SPEED_RANGE, circle.speed, fastest)
        asks, most = plans.orbit_acceleration(circle), led.acceleration
        if asks > most:
            return _refused(Code.ASKS_TOO_MUCH, asks, most)
        entry = plans.entry_of(here.r_E, here.psi, circle)
        lack = self.feasibility.of_move(here, entry, led, self.reference)
        if lack is not None and self.feasibility.refuses:
            return Answer(False, lack.reason)
        self._clear(Clears.CHOSEN)
        self.circle = circle
        self._become(Mode.ORBIT)
        stopping, at_rest = plans.brake(here.r_E, here.v_E, here.psi, led)
        rate = min(self._params.pace.yaw_rate_max, YAW_OF_ORBIT)
        self._follow(chain(stopping, plans.orbit(at_rest, here.psi, circle, rate, led)), t_us)
        far = plans.length(entry - here.r_E)
        if lack is not None:
            return Answer(True, Told(Code.GOING_SHORT, (far, lack.short)))
        return Answer(True, Told(Code.MODE, (Mode.ORBIT.value,)))

    def _go(
        self, to: Vec3 | None, psi: float | None, t_us: int, speed: float | None = None
    ) -> Answer:
        """`to`: where to hold, m, E; None: where it comes to rest."""
        if not self.armed or self.state is None:
            return _refused(Code.NOT_ARMED)
        from_ground = self._landed.landed
        if from_ground and to is None:
            return _refused(Code.NOT_AIRBORNE)
        was = self.cruise
        limited = None
        if speed is not None:
            changed = self.change_speed(speed)
            if not changed.granted:
                return changed
            limited = changed.told
        here, led = self._from(t_us), self._limits()
        psi = here.psi if psi is None else psi
        way = [] if to is None else [to]
        if from_ground and to is not None:  # up first: what slides along the ground tips over
            up = to.z - here.r_E.z
            if up < LEAST_UP:
                self.cruise = was
                return _refused(Code.PLACE_LOW, up)
            led = led._replace(up=min(led.up, self._params["MPC_TKO_SPEED"]))
            here = here._replace(v_E=STILL)
            way = [Vec3(here.r_E.x, here.r_E.y, to.z), to]
        lack = None
        if to is not None:
            by = way[0] if from_ground else None
            lack = self.feasibility.of_move(here, to, led, self.reference, by)
        if lack is not None and self.feasibility.refuses:
            self.cruise = was
            return Answer(False, lack.reason)
        self._clear(Clears.CHOSEN)
        if from_ground:
            self._landed_us = self._armed_us = t_us  # what takes off does not wait on the ground
        self._become(Mode.HOLD)
        self._follow(plans.through(here.r_E, here.v_E, way, psi, led), t_us)
        if to is None:
            return Answer(True, Told(Code.MODE, (self.mode.value,)))
        far = plans.length(to - here.r_E)
        short = lack is not None and Told(Code.GOING_SHORT, (far, lack.short))
        return Answer(True, short or limited or Told(Code.GOING, (far,)))

    def change_speed(self, speed: float) -> Answer:
        """Cruise speed (m/s) of what is laid down from now on. -1: MPC_XY_CRUISE again.

        A speed above MPC_XY_VEL_MAX is limited to that.
        """
        greatest = self._params["MPC_XY_VEL_MAX"]
        if speed != -1.0 and not speed >= 0.1:
            return _refused(Code.SPEED_RANGE, speed, greatest)
        self.cruise = None if speed == -1.0 else min(speed, greatest)
        limited = speed > greatest
        return Answer(True, Told(Code.SPEED_LIMITED, (speed, greatest)) if limited else None)

    # --- sticks

    def fly_by(
        self, sticks: Sticks, source: StickSource, owner: Owner, t_us: int, wall_s: float
    ) -> Answer | None:  # fmt: skip
        """Sticks have been heard: they are flown in modes that sticks fly, from the next step on.

        Returns what a gesture of arming came to, None without one.
        """
        p, lost_us = self._params, self.sticks_lost_us
        accepts = Accepts(int(p["COM_RC_IN_MODE"]))
        if not self.sticks.counts(source, owner, accepts, t_us, wall_s, lost_us):
            return None
        self.sticks.take(sticks, source, owner, t_us, wall_s)
        self.watch[_STICKS_US] = t_us
        if self.armed and self.mode in modes.BY_STICKS and self._stick_flight is None:
            self._fly_sticks(t_us)
        gesture = self.sticks.gesture(round(p["COM_RC_ARM_HYST"] * 1e3))
        if gesture is None or p["MAN_ARM_GESTURE"] == 0.0:
            return None
        if gesture is Gesture.ARM:
            if self.mode not in modes.BY_STICKS:
                return _refused(Code.MODE_WITHOUT_STICKS)
            return None if self.armed else self.arm(t_us, wall_s)
        return self.disarm(t_us) if self.armed else None

    def _fly_sticks(self, t_us: int) -> None:
        """Lay down what the sticks ask for, step by step."""
        self._stick_flight = StickFlight(self.mode, self._params, self._seen(t_us))
        self._follow(self._stick_plan(self._stick_flight), t_us)

    def _stick_plan(self, flight: StickFlight) -> Iterator[Piece]:
        while True:
            t_us, sticks = self.leader.until_us, self.sticks.now
            seen, asked = self._seen(t_us), None
            if self._touchdown.done or seen.landed:
                asked = flight.rests(sticks, seen, self._landed.light)
                if asked is None or asked.T_c > 2.0 * self._landed.light:
                    self._landed_us = self._armed_us = t_us  # what takes off does not wait
            if asked is None:
                if self._touchdown.done:
                    self._touchdown.reset()
                asked = flight.setpoint(sticks, seen, STEP_US * 1e-6)
            yield Piece(asked, STEP_US * 1e-6)

    def _seen(self, t_us: int) -> Seen:
        p, measured, pose = self._params, self.measured, self.pose()
        assert measured is not None
        ground = self._landed.ground
        if math.isnan(ground):
            ground = pose.r_E.z if self.home is None else self.home.z
        return Seen(
            measured=measured,
            pose=pose,
            flown=self.flown(t_us, pose),
            height=pose.r_E.z - ground,
            landed=self._landed.landed,
            led=plans.limits(p, p["MPC_VEL_MANUAL"], self.feasibility.pace),
            throttle=self.throttle,
            weight=p.weight,
            c_T=self._landed.c_T,
            yaw_rate_max=p.pace.yaw_rate_max,
            phi_star=p.law.limits.phi_star,
        )

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
            Need.STICKS: not self.sticks.lost(t_us, wall_s, self.sticks_lost_us),
            Need.PLAN: bool(self.mission.steps),
        }
        return frozenset(need for need, yes in met.items() if yes)

    # --- a script's setpoints

    @property
    def throttle(self) -> Throttle:
        """The scale of a script's thrust: one straight line where hover takes more than its part."""
        hover, T_max = self._params["MPC_THR_HOVER"], self._params.law.limits.T_max
        return Throttle(hover=hover, T_hover=min(self._params.weight, hover * T_max), T_max=T_max)

    def resolve(
        self, asked: PositionRequest | AttitudeRequest, t_us: int
    ) -> tuple[Setpoint | None, Told | None]:
        """The setpoint that a request asks for, and what of it was limited; None, and why not."""
        here = self.pose()
        flown = anchored_by_axis(self.setpoint, (t_us - self.since_us) * 1e-6, here, NEAR)
        if isinstance(asked, AttitudeRequest):
            return of_attitude(asked, flown, self.throttle)
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
        self._stick_flight = None
        self._end_approach()
        if mode is not Mode.OFFBOARD:
            self.script.owner = None

    def _disarm(self, t_us: int) -> None:
        self.armed = False
        self._clear(Clears.CHOSEN, Clears.DISARMED)
        self.leader.take(None, t_us)
        self._landed.has_flown = False
        self._become(modes.after(self.mode, Event.DISARMED))

    def _enter(self, mode: Mode, t_us: int, begins: Pose | None = None) -> None:
        """Be in a mode, and lay down what it flies, from where a plan has ended or from `_from`."""
        if mode is Mode.TAKEOFF and self.armed:
            self._take_off(self._climb(self._take_off_to, t_us), t_us)
            return
        was = self.mode
        self._become(mode)
        if mode is not Mode.MISSION and math.isinf(self._landed_us):
            self._landed_us = t_us  # a plan that waits on the ground is not gone on with
        if not self.armed:
            return
        if mode is Mode.OFFBOARD:
            self._untold = self.fly_script(t_us) is not None
            return
        if mode is Mode.MISSION:
            flight = MissionFlight(self.mission, self._sees(t_us), begins or self._from(t_us))
            self._follow(flight.pieces(), t_us, ends=True)
            return
        if mode in modes.BY_STICKS and not self.sticks.lost(t_us, math.inf, self.sticks_lost_us):
            self._fly_sticks(t_us)
            return
        assert self.home is not None
        here = begins or self._from(t_us)
        to = self._ending(here.r_E, was) if mode is Mode.RETURN else Ending(self.home)
        plan: Iterable[Piece]
        below = self.setpoint is not None and self.setpoint.level > POSITION
        if below and self._is_too_fast():
            plan = self._slowed(mode, to)
        elif mode is Mode.FOLLOW:
            plan = self._following(self.home)
        else:
            plan = plans.plan_of(mode, here, to, self._params, self._limits(), self._around)
        self._follow(plan, t_us, (mode, Event.ARRIVED) in modes.TRANSITIONS)

    def _is_too_fast(self) -> bool:
        """Return true if attitudes or rates have made it faster than it is led."""
        led, v = self._limits(), self.pose().v_E
        return math.hypot(v.x, v.y) > led.cruise or not -led.down <= v.z <= led.up

    def _slowed(self, mode: Mode, to: Ending) -> Iterator[Piece]:
        """Brake beside the vehicle until it is as slow as it is led, then fly what the mode flies.

        The guard may slow it faster than the plan does: one that is laid down from a great speed
        would end far ahead, and be gone to at leisure.
        """
        psi = self._from(self.leader.until_us).psi
        while self._is_too_fast():
            here = self.pose()
            a = -self._limits().acceleration / max(plans.length(here.v_E), plans.SLOW)
            yield Piece(plans.at(here.r_E, psi, here.v_E, a * here.v_E), STEP_US * 1e-6)
        if mode is Mode.FOLLOW:
            yield from self._following(to.place)
        here = self._from(self.leader.until_us)
        yield from plans.plan_of(mode, here, to, self._params, self._limits(), self._around)

    def _following(self, home: Vec3) -> Iterator[Piece]:
        follower = Follower(self._params)
        while True:
            t_us, pose = self.leader.until_us, self.pose()
            now = self.flown(t_us, pose)
            led = plans.limits(self._params, None, self.feasibility.pace)
            asked = follower.setpoint(self.target, now, pose, home, led, t_us)
            yield Piece(asked, FOLLOW_US * 1e-6)

    def follow(self, report: Report, t_us: int) -> None:
        """A target has told where it is: mode Follow Me keeps beside it."""
        self.target.take(report, t_us)

    def _follow(self, plan: Iterable[Piece], t_us: int, ends: bool = False) -> None:
        self.leader.follow(plan, t_us, ends)
        self._advance(t_us, self._to_tell)

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
            int(was), self.watch[_ASKED], age, self.state, ground, self.watch[_LIMITS]
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

    def _touched_down(self, t_us: int, wall_s: float, told: list[Told]) -> None:
        """Rest on the ground that was met, or land from here if the vehicle has left it again."""
        assert self.setpoint is not None
        if self._stick_flight is not None:
            if self._touchdown.done:
                told.append(Told(Code.LED_INTO_GROUND))
            self._follow(self._stick_plan(self._stick_flight), t_us)
            return
        flown: Setpoint = carried(self.setpoint, (t_us - self.since_us) * 1e-6)
        if not self._touchdown.done:
            self._land_from(self.pose()._replace(psi=flown.psi_c), t_us)
            return
        self.leader.take(landing.resting(flown, self._landed.light), t_us)
        if not self.is_landing:
            told.append(Told(Code.LED_INTO_GROUND))

    def _land_from(self, here: Pose, t_us: int) -> None:
        r, v, psi = here
        slow_below = self._landed.ground + plans.SLOW_BELOW  # not a number: slow from here
        speed = self._params["MPC_LAND_SPEED"]
        self.leader.follow(plans.descent(r, v, psi, slow_below, speed, self._limits()), t_us)
        self.leader.advance(t_us)
