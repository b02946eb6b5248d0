"""Flight modes: what each is called, what it needs, and what follows it. A table, and pure."""

from __future__ import annotations

from enum import Enum

from fcu.interface.status_texts import Code


class Mode(Enum):
    """What the vehicle does while it is armed."""

    HOLD = "Hold"
    TAKEOFF = "Takeoff"
    POSITION = "Position"
    ALTITUDE = "Altitude"
    STABILIZED = "Stabilized"
    MANUAL = "Manual"
    ACRO = "Acro"
    OFFBOARD = "Offboard"
    LAND = "Land"
    RETURN = "Return"
    ORBIT = "Orbit"
    FOLLOW = "Follow Me"
    STEP = "Step"
    FIGURE_EIGHT = "Figure eight"
    MISSION = "Mission"


class Need(Enum):
    """What must be true to enter a mode; else it is denied with this code."""

    STATE = Code.NO_STATE
    ARMED = Code.NOT_ARMED
    AIRBORNE = Code.NOT_AIRBORNE
    GROUNDED = Code.NOT_GROUNDED
    SETPOINTS = Code.NO_STREAM
    STICKS = Code.NO_STICKS
    PLAN = Code.NO_MISSION


class Event(Enum):
    """What ends a mode by itself."""

    ARRIVED = "it is where it was going"
    HANDS_OVER = "its plan says return"
    LANDED = "it stands on the ground"
    DISARMED = "its rotors were stopped"


_ALOFT = (Need.STATE, Need.ARMED, Need.AIRBORNE)

# Modes that sticks fly. The last three give their thrust, and hold no height.
BY_STICKS = (Mode.POSITION, Mode.ALTITUDE, Mode.STABILIZED, Mode.MANUAL, Mode.ACRO)
BY_THRUST = (Mode.STABILIZED, Mode.MANUAL, Mode.ACRO)

# Modes in which a vehicle cannot be armed: it would have to be in the air.
ALOFT = (
    Mode.LAND, Mode.RETURN, Mode.ORBIT, Mode.FOLLOW, Mode.STEP, Mode.FIGURE_EIGHT,
)  # fmt: skip

NEEDS: dict[Mode, tuple[Need, ...]] = {
    Mode.HOLD: (),
    Mode.TAKEOFF: (Need.STATE, Need.GROUNDED),  # disarmed: it takes off once it is armed
    Mode.POSITION: (),  # holds without sticks
    Mode.ALTITUDE: (Need.STICKS,),
    Mode.STABILIZED: (Need.STICKS,),
    Mode.MANUAL: (Need.STICKS,),
    Mode.ACRO: (Need.STICKS,),
    Mode.OFFBOARD: (Need.SETPOINTS,),
    Mode.LAND: (Need.STATE, Need.ARMED),
    Mode.RETURN: _ALOFT,
    Mode.ORBIT: _ALOFT,
    Mode.FOLLOW: _ALOFT,
    Mode.STEP: _ALOFT,
    Mode.FIGURE_EIGHT: _ALOFT,
    Mode.MISSION: (Need.STATE, Need.PLAN),  # disarmed: it is flown once it is armed
}

# What follows a mode that ends by itself; what is not here goes on.
TRANSITIONS: dict[tuple[Mode, Event], Mode] = {
    (Mode.TAKEOFF, Event.ARRIVED): Mode.HOLD,
    (Mode.RETURN, Event.ARRIVED): Mode.LAND,
    (Mode.MISSION, Event.HANDS_OVER): Mode.RETURN,
    **{(mode, Event.DISARMED): Mode.HOLD for mode in Mode},
}


def denied(wanted: Mode, met: frozenset[Need]) -> Need | None:
    """The first need of a mode that is not met; None if it may be entered."""
    return next((need for need in NEEDS[wanted] if need not in met), None)


def after(mode: Mode, event: Event) -> Mode:
    """The mode that follows."""
    return TRANSITIONS.get((mode, event), mode)
