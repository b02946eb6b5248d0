"""What the vehicle is doing, in the numbers that ground stations know: modes, status, landed state.

Modes are PX4's (custom_mode, what its ground stations show) and MAV_STANDARD_MODE's.
"""

from __future__ import annotations

from typing import NamedTuple

from fcu.interface.status_texts import Code
from fcu.mavlink import px4_modes
from fcu.mavlink.definitions import LandedState, SystemStatus
from fcu.mavlink.px4_modes import AutoMode, MainMode, PositionMode
from fcu.vehicle.modes import Mode
from fcu.vehicle.state_machine import StateMachine


class Numbers(NamedTuple):
    """One mode as ground stations know it."""

    main: MainMode
    sub: int  # of MainMode.AUTO and POSITION, else 0
    standard: int  # MAV_STANDARD_MODE; 0: none
    guided: bool  # a script or ground station says where to go


# The sub modes 11 to 18 are PX4's for modes that come from outside it.
STEP_SUB, FIGURE_EIGHT_SUB = 11, 12

MODES: dict[Mode, Numbers] = {
    Mode.HOLD: Numbers(main=MainMode.AUTO, sub=AutoMode.LOITER, standard=0, guided=True),
    Mode.TAKEOFF: Numbers(main=MainMode.AUTO, sub=AutoMode.TAKEOFF, standard=8, guided=False),
    Mode.POSITION: Numbers(main=MainMode.POSITION, sub=0, standard=1, guided=False),
    Mode.ALTITUDE: Numbers(main=MainMode.ALTITUDE, sub=0, standard=4, guided=False),
    Mode.STABILIZED: Numbers(main=MainMode.STABILIZED, sub=0, standard=0, guided=False),
    Mode.MANUAL: Numbers(main=MainMode.MANUAL, sub=0, standard=0, guided=False),
    Mode.ACRO: Numbers(main=MainMode.ACRO, sub=0, standard=0, guided=False),
    Mode.OFFBOARD: Numbers(main=MainMode.OFFBOARD, sub=0, standard=0, guided=True),
    Mode.LAND: Numbers(main=MainMode.AUTO, sub=AutoMode.LAND, standard=7, guided=False),
    Mode.RETURN: Numbers(main=MainMode.AUTO, sub=AutoMode.RETURN, standard=5, guided=False),
    Mode.MISSION: Numbers(main=MainMode.AUTO, sub=AutoMode.MISSION, standard=6, guided=False),
    Mode.ORBIT: Numbers(main=MainMode.POSITION, sub=PositionMode.ORBIT, standard=2, guided=True),
    Mode.FOLLOW: Numbers(main=MainMode.AUTO, sub=AutoMode.FOLLOW, standard=0, guided=True),
    Mode.STEP: Numbers(main=MainMode.AUTO, sub=STEP_SUB, standard=0, guided=False),
    Mode.FIGURE_EIGHT: Numbers(main=MainMode.AUTO, sub=FIGURE_EIGHT_SUB, standard=0, guided=False),
}

# PX4's modes that this vehicle does not have, as ground stations show them: main, sub
OTHERS: dict[tuple[int, int], str] = {
    (MainMode.AUTO, AutoMode.READY): "Ready",
    (MainMode.AUTO, AutoMode.PRECISION_LAND): "Precision Land",
    (MainMode.AUTO, AutoMode.VTOL_TAKEOFF): "VTOL Takeoff",
}
OTHER_STANDARD = {3: "Cruise"}  # MAV_STANDARD_MODE

_BY_NUMBERS = {(int(row.main), int(row.sub)): mode for mode, row in MODES.items()}
_BY_NUMBERS[int(MainMode.AUTO), 0] = Mode.MISSION  # as PX4 reads AUTO without a sub mode
_BY_STANDARD = {row.standard: mode for mode, row in MODES.items() if row.standard}


def of_numbers(main: int, sub: int) -> Mode | None:
    """The mode of PX4's numbers; None for one that this vehicle does not have."""
    return _BY_NUMBERS.get((main, _sub(main, sub)))


def _sub(main: int, sub: int) -> int:
    """The sub mode, of a mode that has some. Else 0."""
    if main == MainMode.POSITION:
        return PositionMode.ORBIT if sub == PositionMode.ORBIT else PositionMode.NONE
    return sub if main == MainMode.AUTO else 0


def shown(main: int, sub: int) -> str:
    """How ground stations show PX4's numbers of a mode; the numbers if they know none."""
    mode = of_numbers(main, sub)
    if mode is not None:
        return mode.value
    return OTHERS.get((main, _sub(main, sub)), f"{main}, {sub}")


def of_standard(number: int) -> Mode | None:
    """The mode of a MAV_STANDARD_MODE; None for one that this vehicle does not have."""
    return _BY_STANDARD.get(number)


def custom_mode(mode: Mode) -> int:
    """HEARTBEAT.custom_mode in PX4's encoding."""
    row = MODES[mode]
    return px4_modes.custom_mode(int(row.main), int(row.sub))


def system_status(vehicle: StateMachine) -> SystemStatus:
    """BOOT until the plant was heard, then STANDBY, ACTIVE, or CRITICAL in a failsafe.

    EMERGENCY once it has crashed or is lost, FLIGHT_TERMINATION once it was terminated, as PX4.
    """
    if vehicle.ended is not None:
        return SystemStatus.EMERGENCY
    if vehicle.terminated:
        return SystemStatus.FLIGHT_TERMINATION
    if vehicle.state is None:
        return SystemStatus.BOOT
    if vehicle.armed:
        return SystemStatus.CRITICAL if vehicle.failsafe else SystemStatus.ACTIVE
    return SystemStatus.STANDBY


def landed_state(vehicle: StateMachine) -> LandedState:
    """From the detector, and the mode."""
    if vehicle.state is None:
        return LandedState.UNDEFINED
    if vehicle.ended is not None:
        crashed = vehicle.ended.code is Code.CRASHED
        return LandedState.ON_GROUND if crashed else LandedState.UNDEFINED
    if vehicle.on_ground:
        return LandedState.ON_GROUND
    if vehicle.mode is Mode.TAKEOFF:
        return LandedState.TAKING_OFF
    return LandedState.LANDING if vehicle.is_landing else LandedState.IN_AIR
