"""Codes with numbers for all that a vehicle tells, and the one table of their texts.

Whoever decides something tells it as `Told(code, values)`. Whoever sends or shows it asks for
its `words`. A code's value is its text, with a place for each of its values. A STATUSTEXT has room
for 50 characters: `brief` is the text in that room, and SHORT has the shorter texts of the codes
that may need more.
"""

from __future__ import annotations

import math
import re
import string
from collections.abc import Iterator
from enum import Enum, unique
from functools import cache
from itertools import product
from typing import Any, NamedTuple

GREAT = 1e6  # m, N: above it a number is only told to be so
ROOM = 50  # characters of a STATUSTEXT, whose text old clients take for the whole
CUT = "..."  # ends a text that was cut: of names and reasons that are not ours


@unique
class Code(Enum):
    """Everything that is said. Values are in SI. A value may be a Told itself."""

    # --- what happens by itself
    LANDED = "Landed"
    SETPOINT_INTO_GROUND = "Setpoint is below the ground: landing"
    LED_INTO_GROUND = "Ground contact: motors idle"
    DISARMED_LANDED = "Disarmed after landing"
    DISARMED_IDLE = "Disarmed: no takeoff"
    BATTERY_LOW = "Battery low: {:.0f} %"
    BATTERY_CRITICAL = "Battery critical: {:.0f} %"
    BATTERY_EMERGENCY = "Battery emergency: {:.0f} %"
    FAILSAFE_MODE = "Failsafe: mode {}"
    FAILSAFE_STOPPED = "Failsafe: rotors stopped"
    FENCE_BREACHED = "Fence breached"
    FENCE_INSIDE = "Fence breach is over"
    OFFBOARD_LOST_MODE = "Offboard lost: no setpoint for {:g} s, mode {}"
    OFFBOARD_LOST_STOPPED = "Offboard lost: no setpoint for {:g} s, rotors stopped"
    STICKS_LOST_MODE = "Sticks lost: none for {:g} s, mode {}"
    STICKS_LOST_STOPPED = "Sticks lost: none for {:g} s, rotors stopped"
    STATION_LOST = "Ground station lost: no heartbeat for {:g} s"
    STATION_BACK = "Ground station heard again"
    ATTITUDE_LOST = "Attitude lost: tilted by {:.0f} degrees"
    FLIGHT_TIME_LOW = "Charge lasts {:.0f} s: too little for the way home"
    ROTOR_LOST = "Rotor {:.0f} lost: {}"
    LOSS_NOT_SHARED = "CA_FAILURE_MODE is 0"
    LOSS_SHARED = "the others take its share"
    LOSS_LANDS = "the rest cannot fly on, landing"
    LOSS_FALLS = "the rest cannot hold it level"
    GUARD_VOID = "The guard promises nothing without a rotor"
    GUARD_BACK = "The guard promises again: no rotor is lost"
    ROTOR_BACK = "Rotor {:.0f} takes its share again"
    ROTOR_IS_LOST = "rotor {:.0f} is lost"
    BELIEFS_CONTRADICTED = "Assumptions of the guard contradicted"
    STATE_FAILED = "State failed: going on from the last one"
    STATE_BACK = "State valid again"
    STATE_LOST = "State lost: none for {:g} s"
    FAILSAFE_LATER = "Failsafe: Hold for {:g} s, then mode {}"
    PLAN_COMPLETE = "{} complete, mode {}"
    MISSION_COMPLETE = "Mission complete"
    POSITION_JUMPED = "Position jumped {:.0f} m: flying by velocity"
    POSITION_BACK = "Position valid again"
    NOT_AS_BELIEVED = "Contradicts assumptions: {}"
    LAW_NOT_FINITE = "The law computed numbers that are not finite: {}"
    LAW_FAILED = "The law failed ({}): {} flies on"
    CRASHED = "Crashed: hit the ground (gcs reset puts it back)"
    DIVERGED = "Lost: left the arena (gcs reset puts it back)"
    RESET = "Reset: at the start, time begins again"
    NOT_RESET = "Not reset: the plant does not answer"
    STATE_STUCK = "The plant's state has not changed for 1 s"
    PLANT_SILENT = "No state from the plant for {:.0f} s"
    PLANT_SILENT_STOPS = "No state from the plant for {:.0f} s, controller stops"

    # --- what the log alone says
    FLIGHT_ENDED = "the flight ended: the vehicle {}"
    PLANT_RESET = "reset: at the start again"
    FAILURE_DONE = "failure of unit {}, type {}, instance {} (0: all) is done"
    LINK_SILENT = "the plant has been silent for {:.0f} s"
    PLAN_ITEMS = "{}: items {:.0f} to {:.0f} of {:.0f}"  # and the items: `fcu.services.plan_record`
    PLAN_AT = "mission: {:.0f} of {:.0f} items are behind it"
    IN_MODE = "in mode {}"
    HOME_AT = "home at ({:.2f}, {:.2f}, {:.2f}) m"

    # --- what contradicts a belief
    LIGHTER = "mass below {:g} kg, or a persistent updraft"
    HEAVIER = "mass above {:g} kg, or a persistent downdraft"
    MORE_DRAG = "more drag than in a wind of {:.3g} m/s"
    THRUST_OFF = "rotors do not give the commanded thrust"
    TRIM_PINNED = "thrust trim at its limit of {:g} N"

    # --- what a request came to
    ARMED = "Armed"
    DISARMED = "Disarmed"
    TERMINATED = "Flight terminated"
    MODE = "Mode {}"
    MODE_SHORT = "Mode {} needs {:newtons} more than available: thrust may saturate"
    TAKING_OFF = "Taking off to {:.1f} m above here"
    TAKES_OFF_ONCE_ARMED = "Takes off to {:.1f} m above here once armed"
    GOING = "Flying {:.0f} m"
    GOING_SHORT = "Flying {:.0f} m needs {:newtons} more than available: thrust may saturate"
    HOME_SET = "Home set"
    CURRENT_ITEM = "Mission item {} is current"
    ITEMS_TAKEN = "{}: {} items taken"
    ITEMS_PASSED_OVER = "{}: {} items taken, {} of them passed over"
    PLAN_SHORT = (
        "Mission taken: item {:.0f} needs {:newtons} more than available, thrust may saturate"
    )
    ITEMS_CLEARED = "{} cleared"
    ORIGIN_SET = "Origin set"
    READY_TO_ARM = "Ready to arm"
    NOT_READY_TO_ARM = "Not ready to arm: {}"
    PARAMETERS_SAVED = "Parameters saved"
    PARAMETERS_RESET = "Parameters reset"

    FAILURE_INJECTED = "Injected: {}"
    FAILURE_CLEARED = "Cleared: {}"

    # --- a request refused: what, and why
    DENIED = "{} denied: {}"
    MODE_UNKNOWN = "Mode {} denied: not supported by this vehicle"
    UNSUPPORTED = "{} is not supported"
    BUSY = "{} rejected: the last one is still in progress"
    LATE_REPETITION = "{}: late repetition ignored"
    NOT_TAKEN = "{} is ignored"
    NOT_KNOWN_YET = "Message {}: no data yet"
    PARAMETER_REFUSED = "{}"  # the reason, in words, and in fewer
    PARAMETER_UNKNOWN = "Unknown parameter {}"
    PARAMETER_TYPE = "Parameter {}: expected type {}"
    PARAMETERS_TOO_MANY = "Too many parameters at once: ask again"
    PARAMETERS_NOT_RESET = "Parameters not reset: vehicle is armed"
    PARAMETERS_NOT_SAVED = "Parameters not saved: {}"
    PARAMETERS_NO_FILE = "Parameters not saved: start with --params FILE"
    PARAMETERS_BEING_SAVED = "Parameters are being saved"

    # --- why: the vehicle
    NO_STATE = "no state from the plant yet"
    HAS_NO_VALID_STATE = "the state has failed"
    NOT_ARMED = "not armed"
    NOT_AIRBORNE = "not in the air"
    NOT_GROUNDED = "already in the air"
    NO_STREAM = "needs 2 setpoints within 0.5 s"
    NO_STICKS = "no sticks (MANUAL_CONTROL)"
    NO_STATION = "no ground station (NAV_DLL_ACT)"
    THROTTLE_ABOVE_MIDDLE = "throttle above its middle"
    THROTTLE_NOT_LOW = "throttle is not low"
    MODE_WITHOUT_STICKS = "not a mode of sticks"
    GUARD_REFUSES = "the guard rejects its setpoints"
    WAS_TERMINATED = "flight was terminated (gcs reset)"
    HAS_ENDED = "the flight has ended (gcs reset)"
    TILTED = "tilted by more than {:.0f} degrees"
    CHARGE_CRITICAL = "battery at {:.0f} %"
    IN_FLIGHT = "in flight (land first)"
    ARMED_NOT_RESET = "armed (disarm, or force it: gcs reset --force)"
    ONE_FLIGHT = "its flight is recorded (gcs fly)"
    TAKEOFF_HEIGHT = "{:.1f} m up (expected above 0, at most 1000)"
    SPEED_RANGE = "{:g} m/s (expected 0.1 to {:g})"
    SPEED_LIMITED = "Speed limited: {:g} to {:g} m/s"
    ASKS_TOO_MUCH = "needs {:.1f} m/s^2 (MPC_ACC_HOR is {:g})"
    ORBIT_BY_COMMAND = "an orbit begins with DO_ORBIT"
    ORBIT_RADIUS = "radius {:g} m (expected 1 to 1000)"
    LACKS = "{} needs {:newtons} more than available; {} would do"

    # --- of a way that misses the guard's condition: what was asked for, what would do
    WAY = "{:.1f} m"
    WAY_LED = "{:.1f} m at {:g} m/s"
    SPEED = "{:.1f} m/s"
    SPEED_AND_WAY = "{:.1f} m/s and {:.1f} m"
    METRES_OF_IT = "{:metres} of it"
    PERCENT_OF_IT = "{:percent} of it"
    PERCENT_LED = "{:percent} of speed and acceleration"

    # --- why: the command
    FAILURES_OFF = "SYS_FAILURE_EN is 0"
    FAILURE_UNKNOWN = "no such unit or type"
    FAILURE_NOT_DONE = "the simulator cannot do it"
    FAILURE_RANGE = "rotor, size or time out of range"
    FAILURE_ENDLESS = "needs seconds (parameter 5)"
    FAILURE_FULL = "too many failures at once"
    FAILURE_UNANSWERED = "the simulator does not answer"
    TO_NO_SYSTEM = "expected this system as target"
    COMMAND_FRAME = "frame {}"
    PARAMETER_NAN = "parameter {} is not finite"
    PARAMETER_UNUSED = "{}: parameter {} has no effect"
    PLACE_LOW = "{:.1f} m up (least: 0.5)"
    MODE_NOT_TO_ARM = "not in mode {}"
    NEITHER_0_NOR_1 = "parameter 1: expected 0 or 1"
    CUSTOM_MODES_ONLY = "expected a custom mode (base mode 1)"
    PLACE_NOT_HERE = "the position is not the vehicle's"
    HEIGHT_IMPOSSIBLE = "height out of range"
    NO_PLACE_NEAR = "expected a position within 20 km"
    NO_HEIGHT_NEAR = "expected 100 m below home to 20 km above"
    LANDS_HERE = "lands at the current position (reposition first)"
    ORBIT_YAW = "yaw behaviour: 0, 1 or 3"
    NO_MISSION = "no mission uploaded"
    NO_LAND_START = "the mission has no DO_LAND_START"
    NO_ITEM = "no item {} (the mission has {})"

    # --- why: an item of a plan, a fence or rally points
    ITEM = "item {}: {}"
    ITEM_TERRAIN = "heights above terrain are not supported"
    ITEM_PARAMETER = "parameter {} is {:g}, expected {}"
    ITEM_PLACE = "its place is {:.0f} m away (at most {:.0f})"
    ITEM_HEIGHT = "its height is {:.0f} m (expected {:.0f} to {:.0f})"
    ITEMS_TOO_MANY = "{} items (at most {})"
    TRANSFER_BUSY = "another transfer is in progress"
    TRANSFER_LOST = "the transfer was broken off"
    NO_SUCH_PART = "items {} to {} of {} cannot be replaced"
    OUTSIDE_FENCE = "the fence forbids this place"
    PLACE_OUTSIDE = "the fence forbids its place"
    WAY_OUTSIDE = "the fence forbids the way to it"
    RETURN_STRAIGHT = "Return: straight, no way around the fence is known"
    ITEM_SHORT = (
        "its way needs {:newtons} more than available: slower would do (MPC_XY_CRUISE, MPC_ACC_HOR)"
    )
    CIRCLE_OUTSIDE = "the fence forbids its circle"
    PLAN_IN_LOOK = "its plan is being looked at, for MR_GUARD has changed"
    POLYGON_SHORT = "a polygon of {} corners (at least 3)"
    POLYGON_BROKEN = "polygon corner {} of {} is missing"
    GROUND_SPEED_ONLY = "expected speed type 1 (ground speed)"
    NO_PLACE = "expected a position"
    RESETS_ONLY = "parameter 1: expected 0 or 1 (reset)"
    SAVES_OR_RESETS = "expected 1 (save) or 2 (reset)"
    HEARTBEATS_KEEP = "the rate of HEARTBEAT is fixed"
    INTERVAL_NEGATIVE = "expected an interval of at least -1 us"

    # --- a setpoint: refused, warned of, flown at a limit
    SETPOINT_REFUSED = "Setpoint rejected: {}"
    SETPOINT_SHORT = "Setpoint at {} needs {:newtons} more than available: thrust may saturate"
    SETPOINT_TURNS = "Setpoint yaw rate {:.1f} rad/s limited to {:.1f} rad/s"
    SETPOINT_LOW = "Setpoint {:.0f} m below home limited to {:g} m"
    SETPOINT_FAR = "Setpoint {:.0f} m away limited to {:.0f} m"
    SETPOINT_FAST = "Setpoint speed {:.1f} m/s limited to {:.1f} m/s"
    SETPOINT_HARD = "Setpoint {:.0f} m/s^2 limited to {:.0f} m/s^2"

    # --- why: the setpoint
    ANOTHER_SENDS = "{}/{} is sending setpoints"
    FRAME_UNSUPPORTED = "frame {} is not supported"
    FRAME_NOT_LOCAL = "frame {} is not a local frame"
    FRAME_NOT_GLOBAL = "frame {} is not a global frame"
    COMMANDS_NOTHING = "its type mask ignores everything"
    FORCE = "force setpoints are not supported"
    MASK_BITS = "type mask {:#x} has unknown bits"
    PARTLY_IGNORED = "type mask ignores part of {}"
    NOT_FINITE = "{} is not finite"
    ABOVE_LIMIT = "{} is above {:g} {}"
    OFF_EARTH = "latitude or longitude out of range"
    HEIGHT_RANGE = "altitude is not within {:g} m"
    THRUST_VECTOR = "thrust vectors are not supported"
    NO_THRUST = "thrust is missing"
    THRUST_RANGE = "expected thrust between 0 and 1"
    NEEDS_BODY_RATES = "expected three body rates without attitude"
    BODY_RATES_RANGE = "body rates are not within {:g} rad/s"
    NOT_UNIT = "attitude is not a unit quaternion"
    YAW_RATE_ONLY = "expected only a yaw rate beside attitude"


# Shorter texts of codes whose own may be too long for a STATUSTEXT, the longest first. A value is taken
# by its place. A reason within a text is shortened first.
SHORT: dict[Code, tuple[str, ...]] = {
    Code.NO_LAND_START: ("no DO_LAND_START",),
    Code.NO_ITEM: ("no item {0}",),
    Code.ITEM: ("item {0}",),
    Code.ITEM_TERRAIN: ("height above terrain",),
    Code.ITEM_PARAMETER: ("parameter {0} is {1:g}", "parameter {0}"),
    Code.ITEM_PLACE: ("{0:.0f} m away",),
    Code.ITEM_HEIGHT: ("height {0:.0f} m",),
    Code.ITEMS_TOO_MANY: ("at most {1} items", "too many items"),
    Code.TRANSFER_BUSY: ("another is in progress",),
    Code.NO_SUCH_PART: ("no items {0} to {1}", "no such part"),
    Code.POLYGON_SHORT: ("{0} corners (at least 3)", "too few corners"),
    Code.POLYGON_BROKEN: ("no corner {0}",),
    Code.PLACE_OUTSIDE: ("fence forbids its place",),
    Code.WAY_OUTSIDE: ("fence forbids the way",),
    Code.PLAN_IN_LOOK: ("plan is being looked at",),
    Code.RETURN_STRAIGHT: ("Return: straight, no way around known", "no way around"),
    Code.ITEM_SHORT: ("way lacks {0:newtons}",),
    Code.CIRCLE_OUTSIDE: ("fence forbids its circle",),
    Code.FAILSAFE_LATER: ("Failsafe: Hold, then mode {1}", "Failsafe: Hold, then {1}"),
    Code.NO_STATION: ("no ground station",),
    Code.OFFBOARD_LOST_MODE: ("Offboard lost: mode {1}",),
    Code.OFFBOARD_LOST_STOPPED: ("Offboard lost for {0:g} s, rotors stopped",),
    Code.NOT_AS_BELIEVED: ("Unexpected: {0}",),
    Code.LIGHTER: ("mass < {0:.3g} kg or an updraft",),
    Code.HEAVIER: ("mass > {0:.3g} kg or a downdraft",),
    Code.MORE_DRAG: ("drag above a {0:.3g} m/s wind",),
    Code.THRUST_OFF: ("rotors do not give their thrust",),
    Code.TRIM_PINNED: ("thrust trim at {0:g} N",),
    Code.LAW_NOT_FINITE: ("Law is not finite: {0}", "Law computed numbers that are not finite"),
    Code.LAW_FAILED: ("Law failed: {1} flies on",),
    Code.CRASHED: ("Crashed: hit the ground (gcs reset)",),
    Code.DIVERGED: ("Lost: left the arena (gcs reset)",),
    Code.PLAN_SHORT: (
        "Mission: item {0:.0f} needs {1:newtons} more, may saturate",
        "Mission: item {0:.0f} lacks {1:newtons}, may saturate",
        "Mission: item {0:.0f} lacks {1:newtons}",
    ),
    Code.PLANT_SILENT_STOPS: ("No state for {0:.0f} s, controller stops",),
    Code.MODE_SHORT: ("Mode {0} needs {1:newtons} more", "Mode {0}: lacks {1:newtons}"),
    Code.TAKES_OFF_ONCE_ARMED: ("Takes off to {0:.1f} m once armed",),
    Code.GOING_SHORT: ("Flying {0:.0f} m needs {1:newtons} more",),
    Code.MODE_UNKNOWN: ("Mode {0} denied: not supported",),
    Code.BUSY: ("{0} is in progress",),
    Code.LATE_REPETITION: ("{0} came late",),
    Code.PARAMETER_REFUSED: ("{1}",),
    Code.PARAMETERS_NOT_SAVED: ("Parameters not saved (see the log)",),
    Code.PARAMETERS_NO_FILE: ("Not saved: start with --params FILE",),
    Code.NO_STREAM: ("needs a stream of setpoints",),
    Code.HAS_ENDED: ("flight has ended (gcs reset)",),
    Code.WAS_TERMINATED: ("terminated (gcs reset)",),
    Code.GUARD_REFUSES: ("the guard rejects setpoints",),
    Code.TILTED: ("tilted over {0:.0f} degrees",),
    Code.ONE_FLIGHT: ("its flight is recorded",),
    Code.ARMED_NOT_RESET: ("armed (gcs reset --force)",),
    Code.TAKEOFF_HEIGHT: ("{0:.4g} m up (0 to 1000)",),
    Code.SPEED_RANGE: ("{0:.4g} m/s (0.1 to {1:g})", "expected 0.1 to {1:.3g} m/s"),
    Code.SPEED_LIMITED: ("Speed limited to {1:g} m/s",),
    Code.ASKS_TOO_MUCH: (
        "needs {0:.3g} m/s^2 (MPC_ACC_HOR)",
        "MPC_ACC_HOR is too low",
    ),
    Code.LACKS: ("lacks {1:newtons}; {2}", "lacks {1:newtons}"),
    Code.METRES_OF_IT: ("{0:metres} would do",),
    Code.PERCENT_OF_IT: ("{0:percent} would do",),
    Code.PERCENT_LED: ("{0:percent} would do",),
    Code.TO_NO_SYSTEM: ("must name this system",),
    Code.NO_PLACE_NEAR: ("position not within 20 km",),
    Code.RESETS_ONLY: ("parameter 1 must be 0 or 1",),
    Code.SAVES_OR_RESETS: ("expected 1 or 2 (reset)",),
    Code.HEARTBEATS_KEEP: ("HEARTBEAT has a fixed rate",),
    Code.INTERVAL_NEGATIVE: ("interval is below -1 us",),
    Code.CUSTOM_MODES_ONLY: ("base mode must be 1 (custom)",),
    Code.PLACE_NOT_HERE: ("position is elsewhere",),
    Code.NO_HEIGHT_NEAR: ("height not -100 m to 20 km",),
    Code.LANDS_HERE: ("lands here (reposition first)",),
    Code.GROUND_SPEED_ONLY: ("speed type must be 1 (ground)",),
    Code.SETPOINT_REFUSED: ("Setpoint rejected: {0}", "Setpoint: {0}"),
    Code.SETPOINT_SHORT: (
        "Setpoint at {0} needs {1:newtons} more, may saturate",
        "Setpoint at {0}: lacks {1:newtons}, may saturate",
        "Setpoint needs {1:newtons} more, may saturate",
    ),
    Code.SETPOINT_TURNS: ("Setpoint yaw rate limited to {1:.1f} rad/s",),
    Code.SETPOINT_LOW: ("Setpoint below home limited to {1:g} m",),
    Code.SETPOINT_FAR: ("Setpoint distance limited to {1:.0f} m",),
    Code.SETPOINT_FAST: ("Setpoint speed limited to {1:.1f} m/s",),
    Code.SETPOINT_HARD: ("Setpoint limited to {1:.0f} m/s^2",),
    Code.PARTLY_IGNORED: ("mask ignores part of {0}", "part of {0} ignored"),
    Code.NOT_UNIT: ("not a unit quaternion",),
    Code.NEEDS_BODY_RATES: ("needs three body rates",),
    Code.YAW_RATE_ONLY: ("only a yaw rate with attitude",),
    Code.COMMANDS_NOTHING: ("type mask ignores all",),
    Code.FORCE: ("force is not supported",),
    Code.THRUST_RANGE: ("thrust must be 0 to 1",),
    Code.OFF_EARTH: ("not a latitude or longitude",),
    Code.FRAME_NOT_GLOBAL: ("frame {0} is not global",),
}


class Told(NamedTuple):
    """Something said: a code, and the values of its text, each a number, a name or a Told."""

    code: Code
    values: tuple[Any, ...] = ()

    @property
    def kind(self) -> tuple[Any, ...]:
        """The same for two of them that differ in their numbers at most."""
        parts = (v.kind if isinstance(v, Told) else v for v in self.values)
        return self.code, *(part for part in parts if isinstance(part, str | tuple))


def lacks(far: float, speed: float, short: float, part: float) -> Told:
    """A setpoint that misses the guard's condition by `short` (N).

    far, speed : how far (m) and how fast (m/s) it leads; `part`, from 0 to 1, of it would do.
    """
    what = setpoint_asked(far, speed)
    would_do = (Code.PERCENT_OF_IT, part) if speed else (Code.METRES_OF_IT, part * far)
    return Told(Code.LACKS, (what, short, Told(would_do[0], (would_do[1],))))


def setpoint_asked(far: float, speed: float) -> Told:
    """What a setpoint asks for: how far (m), how fast (m/s; 0: a place)."""
    if speed == 0.0:
        return Told(Code.WAY, (far,))
    near = far <= 1.0  # where a moving setpoint is, is not worth a word below
    return Told(Code.SPEED, (speed,)) if near else Told(Code.SPEED_AND_WAY, (speed, far))


# --- words


def _newtons(short: float) -> str:
    """What is missing: never nothing. Of what diverges it may be any number."""
    return f"{math.ceil(short)} N" if short < GREAT else f"{short:.2g} N"


def _metres(length: float) -> str:
    """A part of a step, rounded down."""
    return f"{math.floor(10.0 * length) / 10.0:.1f} m" if 0.1 <= length < GREAT else "no part"


def _percent(part: float) -> str:
    """A part of what is not a step, rounded down."""
    return f"{math.floor(100.0 * part)} %" if part >= 0.01 else "no part"


_ROUNDED = {"newtons": _newtons, "metres": _metres, "percent": _percent}


class _Formatter(string.Formatter):
    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, Told):
            return words(value)
        rounded = _ROUNDED.get(format_spec)
        return rounded(value) if rounded else format(value, format_spec)


_FORMATTER = _Formatter()


def words(told: Told) -> str:
    """The text of what is told."""
    return _FORMATTER.vformat(told.code.value, told.values, {})


def _texts(told: Told) -> Iterator[str]:
    """Every text of what is told: of its code, each with every text of the reasons in it."""
    inner = [list(_texts(v)) if isinstance(v, Told) else [v] for v in told.values]
    for text in (told.code.value, *SHORT.get(told.code, ())):
        for values in product(*inner):
            yield _FORMATTER.vformat(text, values, {})


def brief(told: Told) -> str:
    """The text of what is told, in the room of a STATUSTEXT: the longest that fits.

    A law's own error or a user's name may be too long for each of them. The text is then cut, and ends
    in dots.
    """
    whole = words(told)
    if len(whole) <= ROOM:
        return whole
    texts = list(_texts(told))
    fitting = [text for text in texts if len(text) <= ROOM]
    return max(fitting, key=len) if fitting else min(texts, key=len)[: ROOM - len(CUT)] + CUT


@cache
def _patterns(code: Code) -> tuple[re.Pattern[str], ...]:
    found = []
    for text in (code.value, *SHORT.get(code, ())):
        literals = [literal for literal, *_ in string.Formatter().parse(text)]
        has_last = not text.endswith("}")
        between = ".*".join(map(re.escape, literals))
        found.append(re.compile(between if has_last else between + ".*"))
    return tuple(found)


def says(text: str, code: Code) -> bool:
    """Return true if a STATUSTEXT is the text of `code`, or one of its shorter texts.

    For MAVLink clients alone: nothing but words comes over that link.
    """
    return any(pattern.match(text) for pattern in _patterns(code))
