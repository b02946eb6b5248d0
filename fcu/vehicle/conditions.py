"""Conditions of a vehicle in flight: one row each, and one compiled look that finds them all.

A row of `ROWS` names the code that is told, its severity, the action, for how long the detector
has to find the condition, and how the condition clears. A detector is a kernel. `look` runs the
detectors in the order of `Condition`, 50 times a second, and stops at the first that finds
something new. The state machine acts on it, and the look goes on behind it. Most looks find
nothing, and a flight stays in compiled code. Times: simulation time, us.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import Enum, IntEnum, auto
from typing import NamedTuple, get_type_hints

import numpy as np

from fcu.guard.contradictions import LASTS_S
from fcu.interface.messages import Setpoint, VehicleState
from fcu.interface.status_texts import Code
from fcu.kernel.algebra import Rotors, Vec3, clip, maximum, minimum, norm, select3
from fcu.kernel.buffers import packer, size, to_buffer, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import euler, matrix
from fcu.kernel.rows import column_of, slice_of
from fcu.laws.face import Reference
from fcu.laws.setpoint import carried
from fcu.parameters import Parameters
from fcu.vehicle import landing
from fcu.vehicle.landing import LandedState, TouchdownState
from fcu.vehicle.modes import Mode
from fcu.vehicle.plans import STILL, PlanLimits, at, pose_at, pose_of, stop

LOOK_US = 20_000  # between looks
NEAR = 2.0  # m: an old setpoint farther from the vehicle than this is not gone on from
RISES = 0.1  # m: a place so far above the vehicle is a take-off
ATTITUDE = 1.0  # Setpoint.level: above it body rates are flown, and any attitude is right
SETTLED_US = 2e6 * LASTS_S  # in the air, until what was smoothed on the ground is forgotten
SLOW = 0.5  # of the speed that is wanted of a rotor
# 1/s, of the least speed that counts: a rotor that lags by a second, which is slower than any, gains
# twice as much while it is slow
GAINS = 0.5 * (1.0 - SLOW)
BATTERY_HELD_US = 1_000_000  # ten reports: one that is wrong does not land a vehicle
CHARGE_US = 1_000_000  # between looks at the way home, each after a report or more of the battery


class Condition(IntEnum):
    """Everything that can be found, in the order of a look. After PLAN_DUE others find it."""

    NOTHING = 0
    FIRST_STATE = auto()
    LANDED = auto()
    APPROACH = auto()  # a script's setpoint near the ground is to be flown in another way
    UNTOLD = auto()  # a text of the script's setpoint has not been sent yet
    TOUCHDOWN = auto()
    IDLE_LANDED = auto()
    IDLE_ARMED = auto()
    BATTERY_LOW = auto()  # the three levels stay together, in this order
    BATTERY_CRITICAL = auto()
    BATTERY_EMERGENCY = auto()
    FLIGHT_TIME_LOW = auto()  # the charge is held against the way home
    FENCE_NEAR = auto()  # so far from where the fence was looked at that it may be crossed
    ATTITUDE_LOST = auto()
    ROTOR_LOST = auto()
    BELIEFS_CONTRADICTED = auto()
    STATION_LOST = auto()
    STICKS_GONE = auto()  # in a mode that sticks do not fly
    ACTION_DUE = auto()  # the time in Hold before a return or landing is over
    OFFBOARD_LOST = auto()
    PLAN_DUE = auto()  # the next piece of a plan
    STICKS_LOST = auto()
    FENCE_BREACHED = auto()
    POSITION_JUMPED = auto()
    STATE_STUCK = auto()
    STATE_LOST = auto()
    PLANT_SILENT = auto()
    PLANT_LOST = auto()
    CRASHED = auto()
    DIVERGED = auto()
    LAW_NOT_FINITE = auto()
    LAW_FAILED = auto()
    NOT_AS_BELIEVED = auto()


class Action(IntEnum):
    """Reactions to a condition, by severity: of several the greatest is taken, as PX4 does."""

    NONE = 0
    WARN = 1
    POSITION = 2
    HOLD = 3
    RETURN = 4
    LAND = 5
    DISARM = 6
    TERMINATE = 7
    STOP = 8  # the flight controller ends


MODES: dict[Action, Mode] = {
    Action.POSITION: Mode.POSITION,
    Action.HOLD: Mode.HOLD,
    Action.RETURN: Mode.RETURN,
    Action.LAND: Mode.LAND,
}


class Clears(Enum):
    """When a condition is forgotten. What its detector remembers is the detector's own (`Held`)."""

    AT_ONCE = "told, and over"
    GONE = "its detector no longer finds it"  # of detectors beside the look, which tell of both
    CHOSEN = "another mode, place or take-off is chosen, or the vehicle is disarmed"
    DISARMED = "the vehicle is disarmed"
    NEVER = "the vehicle is reset"


class Row(NamedTuple):
    """One condition."""

    code: Code
    severity: str  # of its STATUSTEXT: MAV_SEVERITY
    action: Always | By
    clears: Clears
    hold_us: int = 0  # for so long the detector finds it before it counts: what `held` is given


class Always(NamedTuple):
    """One action, whatever the parameters say."""

    action: Action

    def __call__(self, params: Parameters) -> Action:
        """The action."""
        return self.action


class By(NamedTuple):
    """The action that a parameter chooses."""

    parameter: str
    actions: Mapping[int, Action]

    def __call__(self, params: Parameters) -> Action:
        """The action of the parameter's value."""
        return self.actions[int(params[self.parameter])]


_WARN = Always(Action.WARN)
_OFFBOARD_LOST = {
    0: Action.POSITION, 3: Action.RETURN, 4: Action.LAND, 5: Action.HOLD, 6: Action.TERMINATE,
    7: Action.DISARM,
}  # fmt: skip
_STICKS_LOST = {
    1: Action.HOLD, 2: Action.RETURN, 3: Action.LAND, 5: Action.TERMINATE, 6: Action.DISARM,
}  # fmt: skip
_BREACHED = {
    0: Action.NONE, 1: Action.WARN, 2: Action.HOLD, 3: Action.RETURN, 4: Action.TERMINATE,
    5: Action.LAND,
}  # fmt: skip
_STATION_LOST = {
    0: Action.NONE, 1: Action.HOLD, 2: Action.RETURN, 3: Action.LAND, 5: Action.TERMINATE,
    6: Action.DISARM,
}  # fmt: skip
_TERMINATES = {0: Action.TERMINATE, 121212: Action.WARN}
_CONTRADICTED = {0: Action.NONE, 1: Action.HOLD, 2: Action.LAND}
_FLIGHT_TIME_LOW = {0: Action.NONE, 1: Action.WARN, 3: Action.RETURN}
_ROTOR_LOST = {
    0: Action.WARN, 1: Action.HOLD, 2: Action.LAND, 3: Action.RETURN, 4: Action.TERMINATE,
}  # fmt: skip
_LAW_FAILED = {0: Action.STOP, 1: Action.WARN}
_CRITICAL = {0: Action.WARN, 2: Action.LAND, 3: Action.RETURN}
_EMERGENCY = {0: Action.WARN, 2: Action.LAND, 3: Action.LAND}

# The other conditions are steps of a flight, on which StateMachine acts by methods of its own.
ROWS: dict[Condition, Row] = {
    Condition.BATTERY_LOW: Row(
        code=Code.BATTERY_LOW, severity="WARNING", action=_WARN, clears=Clears.DISARMED,
        hold_us=BATTERY_HELD_US,
    ),
    Condition.BATTERY_CRITICAL: Row(
        code=Code.BATTERY_CRITICAL, severity="CRITICAL", action=By("COM_LOW_BAT_ACT", _CRITICAL),
        clears=Clears.DISARMED, hold_us=BATTERY_HELD_US,
    ),
    Condition.BATTERY_EMERGENCY: Row(
        code=Code.BATTERY_EMERGENCY, severity="EMERGENCY",
        action=By("COM_LOW_BAT_ACT", _EMERGENCY), clears=Clears.DISARMED, hold_us=BATTERY_HELD_US,
    ),
    Condition.FLIGHT_TIME_LOW: Row(  # found by Python, CHARGE_US apart
        code=Code.FLIGHT_TIME_LOW, severity="CRITICAL",
        action=By("COM_FLTT_LOW_ACT", _FLIGHT_TIME_LOW), clears=Clears.DISARMED,
        hold_us=CHARGE_US,
    ),
    Condition.OFFBOARD_LOST: Row(  # its hold time is COM_OF_LOSS_T
        code=Code.OFFBOARD_LOST_MODE, severity="CRITICAL",
        action=By("COM_OBL_RC_ACT", _OFFBOARD_LOST), clears=Clears.CHOSEN,
    ),
    Condition.ATTITUDE_LOST: Row(  # its hold times are FD_FAIL_R_TTRI and FD_FAIL_P_TTRI
        code=Code.ATTITUDE_LOST, severity="EMERGENCY", action=By("CBRK_FLIGHTTERM", _TERMINATES),
        clears=Clears.DISARMED,
    ),
    Condition.ROTOR_LOST: Row(  # its hold time is FD_ACT_MOT_TOUT; with CA_FAILURE_MODE 1 it may do more
        code=Code.ROTOR_LOST, severity="EMERGENCY", action=By("COM_ACT_FAIL_ACT", _ROTOR_LOST),
        clears=Clears.GONE,
    ),
    Condition.BELIEFS_CONTRADICTED: Row(  # NOT_AS_BELIEVED tells which
        code=Code.BELIEFS_CONTRADICTED, severity="CRITICAL",
        action=By("MR_GUARD_ACT", _CONTRADICTED), clears=Clears.CHOSEN,
    ),
    Condition.STATION_LOST: Row(  # its hold time is COM_DL_LOSS_T
        code=Code.STATION_LOST, severity="CRITICAL", action=By("NAV_DLL_ACT", _STATION_LOST),
        clears=Clears.CHOSEN,
    ),
    Condition.STICKS_LOST: Row(  # the state machine, at steps of modes that sticks fly
        code=Code.STICKS_LOST_MODE, severity="CRITICAL",
        action=By("NAV_RCL_ACT", _STICKS_LOST), clears=Clears.CHOSEN,
    ),
    Condition.FENCE_BREACHED: Row(  # found by Python, at FENCE_NEAR
        code=Code.FENCE_BREACHED, severity="CRITICAL", action=By("GF_ACTION", _BREACHED),
        clears=Clears.GONE,
    ),
    Condition.POSITION_JUMPED: Row(  # position_filter
        code=Code.POSITION_JUMPED, severity="CRITICAL", action=_WARN, clears=Clears.GONE
    ),
    Condition.STATE_STUCK: Row(  # position_filter
        code=Code.STATE_STUCK, severity="WARNING", action=By("CBRK_FLIGHTTERM", _TERMINATES),
        clears=Clears.GONE, hold_us=1_000_000,
    ),
    Condition.STATE_LOST: Row(  # position_filter
        code=Code.STATE_LOST, severity="EMERGENCY", action=By("CBRK_FLIGHTTERM", _TERMINATES),
        clears=Clears.GONE, hold_us=500_000,
    ),
    Condition.PLANT_SILENT: Row(  # the loop: wall time
        code=Code.PLANT_SILENT, severity="CRITICAL", action=_WARN, clears=Clears.GONE,
        hold_us=1_000_000,
    ),
    Condition.PLANT_LOST: Row(  # the loop: wall time
        code=Code.PLANT_SILENT_STOPS, severity="CRITICAL", action=Always(Action.STOP),
        clears=Clears.NEVER, hold_us=5_000_000,
    ),
    Condition.CRASHED: Row(  # the plant tells it
        code=Code.CRASHED, severity="CRITICAL", action=Always(Action.DISARM), clears=Clears.NEVER
    ),
    Condition.DIVERGED: Row(  # the plant tells it
        code=Code.DIVERGED, severity="CRITICAL", action=Always(Action.DISARM), clears=Clears.NEVER
    ),
    Condition.LAW_NOT_FINITE: Row(  # the rows of a burst
        code=Code.LAW_NOT_FINITE, severity="CRITICAL", action=_WARN, clears=Clears.DISARMED
    ),
    Condition.LAW_FAILED: Row(  # the tick: the baseline flies it, and tells; else the flight ends
        code=Code.LAW_FAILED, severity="EMERGENCY", action=By("MR_LAW_ACT", _LAW_FAILED),
        clears=Clears.NEVER,
    ),
    Condition.NOT_AS_BELIEVED: Row(  # belief_watch
        code=Code.NOT_AS_BELIEVED, severity="WARNING", action=_WARN, clears=Clears.AT_ONCE
    ),
}  # fmt: skip


class Due(NamedTuple):
    """The times that a tick compares with its own, us."""

    look_us: float  # the next look
    until_us: float  # the end of the piece of a plan that is flown
    heard_us: float  # the script's last setpoint; -inf: there is none
    lost_us: float  # age of that at which the script may be lost


class Script(NamedTuple):
    """The script's setpoint, and the way in which it is flown."""

    asked: Setpoint
    since_us: float  # when it took effect
    known: float  # 0: there is none
    untold: float  # 1: a text of it has not been sent yet
    approach: float  # landing.Approach


class Values(NamedTuple):
    """Parameters that detectors go by, under MAVLink's names: written when one is set."""

    BAT_LOW_THR: float
    BAT_CRIT_THR: float
    BAT_EMERGEN_THR: float
    COM_DISARM_LAND: float
    COM_DISARM_PRFLT: float
    FD_FAIL_R: float
    FD_FAIL_P: float
    FD_FAIL_R_TTRI: float
    FD_FAIL_P_TTRI: float
    FD_ACT_MOT_THR: float
    FD_ACT_MOT_TOUT: float
    MR_GUARD_ACT: float


class Held(NamedTuple):
    """What a detector remembers: the greatest level found for its hold time, and one that may follow.

    The level only rises. Disarming makes it 0. A detector that finds a condition again, once it was
    gone, returns `Held(level=0.0, pending=0.0, since_us=nan)` when it is gone.
    """

    level: float  # 0: none
    pending: float  # the lowest of the levels above it that were found since `since_us`
    since_us: float  # since when a greater level is found; NaN: none is


class FenceLook(NamedTuple):
    """The place at which the fence was looked at last: nearer to it than `radius` nothing can have changed."""

    center: Vec3  # m, E
    radius: float  # m; inf: there is no fence
    predicts: float  # 1: of the place where the vehicle would stop


class Silence(NamedTuple):
    """A sender that is listened for."""

    heard_us: float  # inf: it was not heard yet, or its loss was told
    lost_us: float  # age of that at which it may be lost; inf: never


class RotorWatch(NamedTuple):
    """Inputs and memory of the detector of lost rotors."""

    wanted: Rotors  # thrust that the law wanted of each at the last tick, N
    Omega_max: Rotors  # full speed, rad/s, believed
    slow_us: Rotors  # since when a rotor is slower than wanted and gains nothing; NaN: it is not
    slow_Omega: Rotors  # its speed then, rad/s
    seen_Omega: Rotors  # speeds at the look before, rad/s
    lost: Rotors  # 1: it is lost, and was told
    told: Rotors  # 1: an order says that it is lost


class Watch(NamedTuple):
    """All that a look decides by. StateMachine writes what it changes where it changes it.

    0 and 1: no and yes.
    """

    due: Due
    found: float  # Condition at which the look of this tick stands; NOTHING: it is done
    value: float  # what the detector measured, as the code of the condition tells it
    landed: LandedState
    touchdown: TouchdownState
    battery: Held  # 1: low, 2: critical, 3: an emergency
    roll: Held  # 1: it is lost
    pitch: Held
    beliefs: Held  # 1: the guard's are contradicted
    contradicted: float  # 1: so they are, at the last tick
    aloft_us: float  # since when it flies; -inf: since it was armed, inf: it does not
    station: Silence
    sticks: Silence  # inf in modes that do without
    charge_us: float  # when the charge is held against the way home again; inf: never
    acts_us: float  # when a failsafe goes on from Hold; inf: none waits
    script: Script
    fence: FenceLook
    home: Vec3  # m, E; NaN: not known
    armed: float
    in_offboard: float  # mode
    in_land: float  # mode
    in_idle: float  # mode: one in which a vehicle on the ground waits
    armed_us: float
    landed_us: float
    values: Values
    limits: PlanLimits
    c_T: Rotors  # thrust coefficients, N s^2, believed
    rotors: RotorWatch
    anywhere_us: float  # as in `landing.touches`
    lag_s: float  # as in `landing.touches`


# what a law without a reference model has in its place
NO_MODEL = np.full(size(Reference), math.nan)
_MODEL_Z = column_of(Reference, "v_m.z")

HELD = tuple(name for name, kind in get_type_hints(Watch).items() if kind is Held)

_unpack_measured, _unpack_setpoint = unpacker(VehicleState), unpacker(Setpoint)
_unpack, _unpack_due = unpacker(Watch), unpacker(Watch, "due")
_unpack_found = unpacker(Watch, "found")
_unpack_armed, _unpack_in_offboard = unpacker(Watch, "armed"), unpacker(Watch, "in_offboard")
_pack_found, _pack_look = packer(Watch, "found"), packer(Watch, "due.look_us")
_pack_landed, _pack_touchdown = packer(Watch, "landed"), packer(Watch, "touchdown")
_pack_battery = packer(Watch, "battery")
_pack_roll, _pack_pitch = packer(Watch, "roll"), packer(Watch, "pitch")
_pack_beliefs = packer(Watch, "beliefs")
_pack_value = packer(Watch, "value")
_unpack_limits = unpacker(PlanLimits)
ROTORS = len(Rotors._fields)
_WANTED, _FULL_SPEED, _SLOW, _SLOW_SPEED, _SEEN, _LOST, _TOLD, _C_T = (
    slice_of(Watch, name).start
    for name in (
        "rotors.wanted",
        "rotors.Omega_max",
        "rotors.slow_us",
        "rotors.slow_Omega",
        "rotors.seen_Omega",
        "rotors.lost",
        "rotors.told",
        "c_T",
    )
)
_OMEGA = slice_of(VehicleState, "Omega").start


@kernel
def changes_approach(script, pose, ground, limits, t_us):
    """True if the script's setpoint is to be flown otherwise than now, or is raised anew."""
    was = int(script.approach)
    asked = carried(script.asked, (t_us - script.since_us) * 1e-6)
    now = landing.approach(was, asked, pose, ground, limits)
    return now != was or now == landing.Approach.RAISED


@kernel
def goes_down(watch, flown, height):
    """True if the setpoint `flown` is not above the vehicle: a script may be about to take off."""
    lands = watch.in_land != 0.0 or int(watch.script.approach) == landing.Approach.DOWN
    return lands or flown.level > 0.0 or (flown.r_c.z <= height + RISES and flown.v_c.z <= 0.0)


@kernel
def battery_level(values, remaining):
    """0: enough, 1: low, 2: critical, 3: an emergency. `remaining` : 0 to 1, NaN without a battery."""
    level = 0.0
    for below in (values.BAT_LOW_THR, values.BAT_CRIT_THR, values.BAT_EMERGEN_THR):
        if remaining < below:
            level += 1.0
    return level


@kernel
def held(was, level, hold_us, t_us):
    """The Held after `was`, at a look at which a detector finds a level; 0: nothing.

    A greater level counts once it was found at every look for `hold_us`.
    """
    if not level > was.level:
        return Held(level=was.level, pending=0.0, since_us=math.nan)
    first = math.isnan(was.since_us)
    lowest = level if first else minimum(was.pending, level)
    since_us = t_us if first else was.since_us
    if t_us - since_us >= hold_us:
        return Held(level=lowest, pending=0.0, since_us=math.nan)
    return Held(level=was.level, pending=lowest, since_us=since_us)


@kernel
def lost_angles(values, measured):
    """1 if the roll is beyond FD_FAIL_R, 1 if the pitch is beyond FD_FAIL_P, and the tilt (degrees)."""
    R_EB = matrix(measured.q_EB)
    angles = euler(R_EB)
    roll, pitch = math.degrees(abs(angles.x)), math.degrees(abs(angles.y))
    tilt = math.degrees(math.acos(clip(R_EB.e3.z, -1.0, 1.0)))
    rolled = values.FD_FAIL_R > 0.0 and roll > values.FD_FAIL_R
    pitched = values.FD_FAIL_P > 0.0 and pitch > values.FD_FAIL_P
    return 1.0 if rolled else 0.0, 1.0 if pitched else 0.0, tilt


@kernel
def lost_rotor(watch, buffer, state, t_us):
    """Number of a rotor that is lost and was not told yet, from 1. 0: none is. Keeps `slow_us` in the buffer.

    watch : Watch, of `buffer`.  state : float64[size(VehicleState)].
    A rotor is lost if it has less than SLOW of the speed that is wanted of it for FD_ACT_MOT_TOUT, and
    gains none. A healthy one gains (wanted - Omega) / lag. Speeds that are all as at the look before are
    of a state that stands still, which says nothing of rotors.
    """
    found, values, stands = 0, watch.values, True
    for i in range(ROTORS):
        stands = stands and state[_OMEGA + i] == buffer[_SEEN + i]
        buffer[_SEEN + i] = state[_OMEGA + i]
    for i in range(ROTORS):
        if found == 0 and buffer[_TOLD + i] != 0.0 and watch.armed != 0.0:
            found = i + 1
        wanted = math.sqrt(maximum(buffer[_WANTED + i], 0.0) / maximum(buffer[_C_T + i], 1e-12))
        least, speed = values.FD_ACT_MOT_THR * buffer[_FULL_SPEED + i], state[_OMEGA + i]
        counts = wanted > least and buffer[_LOST + i] == 0.0 and watch.armed != 0.0
        for_us = t_us - buffer[_SLOW + i]
        if stands or not (counts and speed < SLOW * wanted):
            buffer[_SLOW + i] = math.nan
        elif math.isnan(for_us) or (
            for_us >= 1e3 * values.FD_ACT_MOT_TOUT
            and speed - buffer[_SLOW_SPEED + i] > GAINS * 1e-6 * for_us * least
        ):
            buffer[_SLOW + i], buffer[_SLOW_SPEED + i] = t_us, speed
        elif found == 0 and for_us >= 1e3 * values.FD_ACT_MOT_TOUT:
            found = i + 1
    return found


@kernel
def is_silent(sender, t_us):
    """Return true if a sender may be lost."""
    return t_us - sender.heard_us > sender.lost_us


@kernel
def fence_place(pose, flown, predicts, limits):
    """The place that the fence is held against: where the vehicle is, or where it would stop.

    flown : Setpoint, carried to this moment: from it the vehicle is led to rest, if it is near.
    """
    near = norm(flown.r_c - pose.r_E) < NEAR
    led = near & (flown.level == 0.0)
    r, v = select3(led, flown.r_c, pose.r_E), select3(led, flown.v_c, pose.v_E)
    return select3(predicts != 0.0, stop(r, v, limits).r_E, pose.r_E)


@kernel
def fence_place_at(state, setpoint, age, predicts, limits):
    """`fence_place`, for Python: from buffers, of a setpoint `age` seconds after it took effect."""
    flown = carried(_unpack_setpoint(setpoint), age)
    pose = pose_of(_unpack_measured(state))
    return fence_place(pose, flown, predicts, _unpack_limits(limits))


@kernel
def _find(buffer, state, model, setpoint, age, remaining, behind, t_us):
    """The first Condition after `behind` that is new at a look. Other arguments as of `look`."""
    watch, measured = _unpack(buffer), _unpack_measured(state)
    pose, was = pose_of(measured), watch.landed
    armed, scripted = watch.armed != 0.0, watch.armed * watch.in_offboard != 0.0
    if behind < Condition.FIRST_STATE and math.isnan(watch.home.x):
        return Condition.FIRST_STATE.value
    landed = was
    if behind < Condition.LANDED:
        down = watch.touchdown.done if armed else 0.0
        landed = landing.stands(was, down, watch.c_T, measured, t_us)
        _pack_landed(buffer, landed)
        if landed.landed != was.landed:  # either way: what is reported of a tick is of that tick
            return Condition.LANDED.value
    if (
        behind < Condition.APPROACH
        and scripted
        and watch.script.known != 0.0
        and changes_approach(watch.script, pose, landed.ground, watch.limits, t_us)
    ):
        return Condition.APPROACH.value
    if behind < Condition.UNTOLD and watch.script.untold != 0.0:
        return Condition.UNTOLD.value
    lands = watch.in_land != 0.0 or int(watch.script.approach) == landing.Approach.DOWN
    if behind < Condition.TOUCHDOWN and armed and (lands or not scripted):
        flown = carried(_unpack_setpoint(setpoint), age)
        touchdown = landing.touches(
            watch.touchdown, flown, model[_MODEL_Z], pose, landed.ground, t_us, lands,
            watch.anywhere_us, watch.lag_s,
        )  # fmt: skip
        _pack_touchdown(buffer, touchdown)
        if touchdown.done != watch.touchdown.done:
            return Condition.TOUCHDOWN.value
    values, waits = watch.values, armed and landed.landed != 0.0
    wait, has_flown = values.COM_DISARM_LAND, landed.has_flown != 0.0
    late = waits and has_flown and wait >= 0.0 and t_us - watch.landed_us >= wait * 1e6
    if (
        behind < Condition.IDLE_LANDED
        and late
        and goes_down(watch, _unpack_setpoint(setpoint), pose.r_E.z)
    ):
        return Condition.IDLE_LANDED.value
    wait = values.COM_DISARM_PRFLT
    late = waits and not has_flown and wait >= 0.0 and t_us - watch.armed_us >= wait * 1e6
    if behind < Condition.IDLE_ARMED and late and watch.in_idle != 0.0:
        return Condition.IDLE_ARMED.value
    if behind < Condition.BATTERY_LOW:
        flies = armed and landed.landed == 0.0
        level = battery_level(values, remaining) if flies else 0.0
        battery = held(watch.battery, level, BATTERY_HELD_US, t_us)
        _pack_battery(buffer, battery)
        if battery.level != watch.battery.level:
            _pack_value(buffer, 100.0 * remaining)
            return Condition.BATTERY_LOW.value + int(battery.level) - 1
    if behind < Condition.FLIGHT_TIME_LOW and armed and t_us >= watch.charge_us:
        return Condition.FLIGHT_TIME_LOW.value
    if behind < Condition.FENCE_NEAR and armed and watch.fence.radius < math.inf:
        flown = carried(_unpack_setpoint(setpoint), age)
        place = fence_place(pose, flown, watch.fence.predicts, watch.limits)
        if not norm(place - watch.fence.center) < watch.fence.radius:
            return Condition.FENCE_NEAR.value
    if behind < Condition.ATTITUDE_LOST:
        roll, pitch, tilt = 0.0, 0.0, 0.0
        if armed and not _unpack_setpoint(setpoint).level > ATTITUDE:
            roll, pitch, tilt = lost_angles(values, measured)
        rolled = held(watch.roll, roll, 1e6 * values.FD_FAIL_R_TTRI, t_us)
        pitched = held(watch.pitch, pitch, 1e6 * values.FD_FAIL_P_TTRI, t_us)
        _pack_roll(buffer, rolled)
        _pack_pitch(buffer, pitched)
        if rolled.level != watch.roll.level or pitched.level != watch.pitch.level:
            _pack_value(buffer, tilt)
            return Condition.ATTITUDE_LOST.value
    if behind < Condition.ROTOR_LOST:
        rotor = lost_rotor(watch, buffer, state, t_us)
        if rotor > 0:
            _pack_value(buffer, float(rotor))
            return Condition.ROTOR_LOST.value
    if behind < Condition.BELIEFS_CONTRADICTED and values.MR_GUARD_ACT > 0.0:
        counts = armed and t_us - watch.aloft_us > SETTLED_US
        beliefs = held(watch.beliefs, watch.contradicted if counts else 0.0, 0.0, t_us)
        _pack_beliefs(buffer, beliefs)
        if beliefs.level != watch.beliefs.level:
            return Condition.BELIEFS_CONTRADICTED.value
    if behind < Condition.STATION_LOST and armed and is_silent(watch.station, t_us):
        return Condition.STATION_LOST.value
    if behind < Condition.STICKS_GONE and armed and is_silent(watch.sticks, t_us):
        return Condition.STICKS_GONE.value
    if behind < Condition.ACTION_DUE and t_us >= watch.acts_us:
        return Condition.ACTION_DUE.value
    return Condition.NOTHING.value


@kernel
def look(buffer, state, model, setpoint, age, remaining, t_us):
    """The next Condition that is new at this tick, as an int. NOTHING ends the look of this tick.

    To be called again once a condition is acted on: the look goes on behind it.

    buffer : float64[size(Watch)].  state : float64[size(VehicleState)], measured.
    model : float64[6], place and velocity of the reference model after the last tick, NaN without one.
    setpoint : float64[size(Setpoint)], the setpoint that is flown, `age` seconds after it took
    effect, or any while the vehicle is disarmed.  remaining : charge of the battery, 0 to 1, NaN
    without one.  t_us : a float.
    """
    due, behind = _unpack_due(buffer), int(_unpack_found(buffer))
    scripted = _unpack_armed(buffer) * _unpack_in_offboard(buffer) != 0.0
    late = scripted and t_us > due.heard_us + due.lost_us
    found = Condition.NOTHING.value
    if t_us >= due.look_us:
        found = _find(buffer, state, model, setpoint, age, remaining, behind, t_us)
        if found == Condition.NOTHING:
            _pack_look(buffer, t_us + LOOK_US)
    if found == Condition.NOTHING and late and behind < Condition.OFFBOARD_LOST:
        found = Condition.OFFBOARD_LOST.value
    if found == Condition.NOTHING and t_us >= due.until_us:
        found = Condition.PLAN_DUE.value
    if found != behind:
        _pack_found(buffer, found)
    return found


def warm_up(limits: PlanLimits) -> None:
    """Compile what Python calls at looks. A burst compiles `look` in itself."""
    measured, asked = np.zeros(size(VehicleState)), at(STILL, 0.0)
    pose = pose_at(measured)
    landing.approach_at(0, to_buffer(asked), 0.0, measured, 0.0, to_buffer(limits))
    landing.raised(asked, pose, 0.0)
    landing.landing_from(asked, pose, 0.0)
    stop(STILL, STILL, limits)
    carried(asked, 0.0)
    fence_place_at(measured, to_buffer(asked), 0.0, 0.0, to_buffer(limits))
    look(np.zeros(size(Watch)), measured, NO_MODEL, to_buffer(asked), 0.0, math.nan, 0.0)
