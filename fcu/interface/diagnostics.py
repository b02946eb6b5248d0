"""What both processes say of each tick beside the law's and the plant's own values.

A row of the flight controller is a Tick (fcu.process.tick) and then a Report: `fcu_row(Tick)`.
A row of the plant is a PlantRecord and then a PlantReport: `plant_row(PlantRecord)`. Whoever
records or publishes a flight gets whole rows.
Wall times are of this machine: they differ from flight to flight, and nothing flown reads them.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from fcu.kernel.algebra import Vec3
from fcu.kernel.rows import joined


class Wind(NamedTuple):
    """The wind that the disturbance estimate stands for.

    If drag and thrust are as believed, and but for the error of mass times the acceleration.
    """

    v_air_E: Vec3  # velocity of the air, m/s, E; z is NaN: an error of mass looks the same


class Status(NamedTuple):
    """What the vehicle is doing; numbers are MAVLink's and PX4's."""

    armed: float  # 1 while the rotors may turn
    main_mode: float  # PX4 main mode: 3 position, 4 auto, 6 offboard
    sub_mode: float  # PX4 sub mode of auto: 2 takeoff, 3 hold, 5 return, 6 land
    state: float  # MAV_STATE: 1 boot, 3 standby, 4 active, 5 critical, 6 emergency
    landed: float  # MAV_LANDED_STATE: 1 on ground, 2 in air, 3 taking off, 4 landing
    failsafe: float  # 1 while a failsafe flies
    position_off: float  # how far the reported position is off what is flown, m; 0: believed


class Timing(NamedTuple):
    """How the flight controller keeps time, as of this tick."""

    sequence: float  # number of this tick, from 0
    published: float  # wall: when this row was handed on, s since 1970
    cycle: float  # wall: from reading the state to sending the answer, s
    cycle_max: float  # wall: the longest so far, s
    load: float  # smoothed: cycle over the control period, which at speed 1 is the wall's
    resent: float  # states that came twice because an answer was lost, so far
    refused: float  # datagrams of the plant link that were no usable states, so far
    unrecorded: float  # rows that the recorder had no room for, so far
    unpublished: float  # rows that the publisher had no room for, so far


class Report(NamedTuple):
    """What the flight controller says of a tick."""

    wind: Wind
    status: Status
    timing: Timing


class PlantTiming(NamedTuple):
    """How the plant keeps time, as of this tick."""

    sequence: float  # number of this tick, from 0
    published: float  # wall: when this row was handed on, s since 1970
    late: float  # wall: how late this tick began, s; NaN at full speed, which has no deadlines
    slips: float  # whole periods that ticks began late by, so far
    resent: float  # states sent again because no answer came, so far
    unrecorded: float  # rows that the recorder had no room for, so far
    unpublished: float  # rows that the publisher had no room for, so far


class PlantReport(NamedTuple):
    """What the plant says of a tick."""

    timing: PlantTiming


@cache
def fcu_row(tick: Any) -> Any:
    """The class of a whole row of the flight controller. `tick`: the class of what its law tells."""
    return joined("FcuRow", tick, Report)


class _Told(NamedTuple):
    t: float  # simulation time, s, from which they are in force


@cache
def params_row(params: Any) -> Any:
    """The class of what is handed on of a law's parameters. `params`: their class."""
    return joined("ParamsRow", _Told, params)


@cache
def plant_row(record: Any) -> Any:
    """The class of a whole row of the plant. `record`: the class of its truth."""
    return joined("PlantRow", record, PlantReport)
