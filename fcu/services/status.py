"""What the vehicle is doing, in the numbers that ground stations know: modes, status, landed state.

Modes are PX4's (custom_mode, what its ground stations show) and MAV_STANDARD_MODE's.
"""

from __future__ import annotations

from typing import NamedTuple

from fcu.mavlink import px4_modes
from fcu.mavlink.definitions import LandedState, SystemStatus
from fcu.mavlink.px4_modes import AutoMode, MainMode
from fcu.vehicle.modes import Mode
from fcu.vehicle.state_machine import StateMachine


class Numbers(NamedTuple):
    """One mode as ground stations know it."""

    main: MainMode
    sub: int  # of MainMode.AUTO, else 0
    standard: int  # MAV_STANDARD_MODE; 0: none
    guided: bool  # a script or ground station says where to go
    description: str


# The sub modes 11 to 18 are PX4's for modes that come from outside it.
STEP_SUB, FIGURE_EIGHT_SUB = 11, 12

MODES: dict[Mode, Numbers] = {
    Mode.HOLD: Numbers(MainMode.AUTO, AutoMode.LOITER, 0, True, "stops, and stays there"),
    Mode.TAKEOFF: Numbers(
        MainMode.AUTO, AutoMode.TAKEOFF, 8, False,
        "climbs to MIS_TAKEOFF_ALT, then holds",
    ),
    Mode.POSITION: Numbers(MainMode.POSITION, 0, 1, False, "holds; MANUAL_CONTROL moves it"),
    Mode.OFFBOARD: Numbers(MainMode.OFFBOARD, 0, 0, True, "flies a script's setpoints"),
    Mode.LAND: Numbers(MainMode.AUTO, AutoMode.LAND, 7, False, "descends, and disarms"),
    Mode.RETURN: Numbers(
        MainMode.AUTO, AutoMode.RETURN, 5, False,
        "climbs to RTL_RETURN_ALT, flies home and lands",
    ),
    Mode.STEP: Numbers(
        MainMode.AUTO, STEP_SUB, 0, False,
        "steps the reference model by REF_STEP_E, _N, _U and back every REF_STEP_T",
    ),
    Mode.FIGURE_EIGHT: Numbers(
        MainMode.AUTO, FIGURE_EIGHT_SUB, 0, False,
        "flies a figure of eight of REF_8_LEN by REF_8_WIDTH at REF_8_SPEED",
    ),
}  # fmt: skip

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
    return px4_modes.custom_mode(int(row.main), int(row.sub))


def system_status(vehicle: StateMachine) -> SystemStatus:
    """BOOT until the plant was heard, then STANDBY, ACTIVE, or CRITICAL in a failsafe."""
    if vehicle.terminated:
        return SystemStatus.EMERGENCY
    if vehicle.state is None:
        return SystemStatus.BOOT
    if vehicle.armed:
        return SystemStatus.CRITICAL if vehicle.failsafe else SystemStatus.ACTIVE
    return SystemStatus.STANDBY


def landed_state(vehicle: StateMachine) -> LandedState:
    """From the detector, and the mode."""
    if vehicle.state is None:
        return LandedState.UNDEFINED
    if vehicle.on_ground:
        return LandedState.ON_GROUND
    if vehicle.mode is Mode.TAKEOFF:
        return LandedState.TAKING_OFF
    return LandedState.LANDING if vehicle.is_landing else LandedState.IN_AIR
