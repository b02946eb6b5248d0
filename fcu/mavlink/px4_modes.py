"""PX4's flight modes: what ground stations read from HEARTBEAT.custom_mode. No MAVLink standard."""

from __future__ import annotations

from enum import IntEnum


class MainMode(IntEnum):
    """PX4's main flight modes."""

    MANUAL = 1
    ALTITUDE = 2
    POSITION = 3
    AUTO = 4
    ACRO = 5
    OFFBOARD = 6
    STABILIZED = 7


class AutoMode(IntEnum):
    """PX4's sub modes of MainMode.AUTO; 0 with any other."""

    NONE = 0
    READY = 1
    TAKEOFF = 2
    LOITER = 3
    MISSION = 4
    RETURN = 5
    LAND = 6
    FOLLOW = 8
    PRECISION_LAND = 9
    VTOL_TAKEOFF = 10


class PositionMode(IntEnum):
    """PX4's sub modes of MainMode.POSITION."""

    NONE = 0
    ORBIT = 1


def custom_mode(main: int, sub: int) -> int:
    """HEARTBEAT.custom_mode of a mode's numbers."""
    return main << 16 | sub << 24


def main_and_sub(custom: int) -> tuple[int, int]:
    """The numbers of a custom_mode."""
    return custom >> 16 & 0xFF, custom >> 24 & 0xFF
