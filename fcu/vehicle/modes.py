"""Flight modes: what each is called, what it needs, and what follows it. A table, and pure.

Numbers are PX4's (custom_mode, what its ground stations know) and MAV_STANDARD_MODE's.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from fcu.mavlink.enums import AutoMode, MainMode


class Mode(Enum):
    """What the vehicle does while it is armed."""

    HOLD = "Hold"
    TAKEOFF = "Takeoff"
    POSITION = "Position"
    OFFBOARD = "Offboard"
    LAND = "Land"
    RETURN = "Return"
    STEP = "Step"
    FIGURE_EIGHT = "Figure eight"


class Need(Enum):
    """What must be true to enter a mode, in the words with which it is denied."""

    STATE = "no state from the plant yet"
    ARMED = "not armed"
    AIRBORNE = "not in the air"
    GROUNDED = "already in the air"
    SETPOINTS = "needs 2 setpoints within 0.5 s"


class Event(Enum):
    """What ends a mode by itself."""

    ARRIVED = "it is where it was going"
    LANDED = "it stands on the ground"
    DISARMED = "its rotors were stopped"


class Row(NamedTuple):
    """One mode as ground stations know it, and its conditions."""

    main: MainMode
    sub: int  # of MainMode.AUTO, else 0
    standard: int  # MAV_STANDARD_MODE; 0: none
    needs: tuple[Need, ...]
    guided: bool  # a script or ground station says where to go
    description: str


# The sub modes 11 to 18 are PX4's for modes that come from outside it.
STEP_SUB, FIGURE_EIGHT_SUB = 11, 12

MODES: dict[Mode, Row] = {
    Mode.HOLD: Row(MainMode.AUTO, AutoMode.LOITER, 0, (), True, "stops, and stays there"),
    Mode.TAKEOFF: Row(
        MainMode.AUTO, AutoMode.TAKEOFF, 8, (Need.STATE, Need.ARMED, Need.GROUNDED), False,
        "climbs to MIS_TAKEOFF_ALT, then holds",
    ),
    Mode.POSITION: Row(MainMode.POSITION, 0, 1, (), False, "holds; MANUAL_CONTROL moves it"),
    Mode.OFFBOARD: Row(MainMode.OFFBOARD, 0, 0, (Need.SETPOINTS,), True, "flies a script's setpoints"),
    Mode.LAND: Row(MainMode.AUTO, AutoMode.LAND, 7, (Need.STATE, Need.ARMED), False, "descends, and disarms"),
    Mode.RETURN: Row(
        MainMode.AUTO, AutoMode.RETURN, 5, (Need.STATE, Need.ARMED, Need.AIRBORNE), False,
        "climbs to RTL_RETURN_ALT, flies home and lands",
    ),
    Mode.STEP: Row(
        MainMode.AUTO, STEP_SUB, 0, (Need.STATE, Need.ARMED, Need.AIRBORNE), False,
        "steps the reference model by REF_STEP_E, _N, _U and back every REF_STEP_T",
    ),
    Mode.FIGURE_EIGHT: Row(
        MainMode.AUTO, FIGURE_EIGHT_SUB, 0, (Need.STATE, Need.ARMED, Need.AIRBORNE), False,
        "flies a figure of eight of REF_8_LEN by REF_8_WIDTH at REF_8_SPEED",
    ),
}  # fmt: skip

# What follows a mode that ends by itself; what is not here goes on.
TRANSITIONS: dict[tuple[Mode, Event], Mode] = {
    (Mode.TAKEOFF, Event.ARRIVED): Mode.HOLD,
    (Mode.RETURN, Event.ARRIVED): Mode.LAND,
    **{(mode, Event.DISARMED): Mode.HOLD for mode in Mode},
}

# COM_OBL_RC_ACT: what is done when a script's stream of setpoints ends. None: not a mode.
ON_LOSS: dict[int, Mode | None] = {
    0: Mode.POSITION,
    3: Mode.RETURN,
    4: Mode.LAND,
    5: Mode.HOLD,
    6: None,  # terminate
    7: None,  # disarm
}
TERMINATE = 6

# PX4's modes that this vehicle does not have, as ground stations show them: main, sub
OTHERS: dict[tuple[int, int], str] = {
    (MainMode.MANUAL, 0): "Manual",
    (MainMode.ALTITUDE, 0): "Altitude",
    (MainMode.ACRO, 0): "Acro",
    (MainMode.STABILIZED, 0): "Stabilized",
    (MainMode.AUTO, AutoMode.READY): "Ready",
    (MainMode.AUTO, AutoMode.MISSION): "Mission",
    (MainMode.AUTO, AutoMode.FOLLOW): "Follow Me",
    (MainMode.AUTO, AutoMode.PRECISION_LAND): "Precision Land",
    (MainMode.AUTO, AutoMode.VTOL_TAKEOFF): "VTOL Takeoff",
}
OTHER_STANDARD = {2: "Orbit", 3: "Cruise", 4: "Altitude Hold", 6: "Mission"}  # MAV_STANDARD_MODE

_BY_NUMBERS = {(int(row.main), int(row.sub)): mode for mode, row in MODES.items()}
_BY_STANDARD = {row.standard: mode for mode, row in MODES.items() if row.standard}


def denied(wanted: Mode, met: frozenset[Need]) -> Need | None:
    """The first need of a mode that is not met; None if it may be entered."""
    return next((need for need in MODES[wanted].needs if need not in met), None)


def after(mode: Mode, event: Event) -> Mode:
    """The mode that follows."""
    return TRANSITIONS.get((mode, event), mode)


def of_numbers(main: int, sub: int) -> Mode | None:
    """The mode of PX4's numbers; None for one that this vehicle does not have."""
    return _BY_NUMBERS.get((main, sub if main == MainMode.AUTO else 0))


def shown(main: int, sub: int) -> str:
    """How ground stations show PX4's numbers of a mode; the numbers if they know none."""
    mode = of_numbers(main, sub)
    if mode is not None:
        return mode.value
    return OTHERS.get((main, sub if main == MainMode.AUTO else 0), f"{main}, {sub}")


def of_standard(number: int) -> Mode | None:
    """The mode of a MAV_STANDARD_MODE; None for one that this vehicle does not have."""
    return _BY_STANDARD.get(number)


def custom_mode(mode: Mode) -> int:
    """HEARTBEAT.custom_mode in PX4's encoding."""
    row = MODES[mode]
    return int(row.main) << 16 | int(row.sub) << 24
