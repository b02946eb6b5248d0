"""MAV_CMD_INJECT_FAILURE: units and types of failures, and the faults that they order.

PX4's numbers and meanings, as far as this vehicle has the unit. The state of this vehicle comes as ODOMETRY, as from
visual-inertial odometry: unit VIO is the reported state. Parameters 4 and 5, which MAVLink leaves
free, say how much and for how long.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from fcu.interface.faults import NEVER_US, Fault, Kind, Size


class Unit(IntEnum):
    """FAILURE_UNIT, of those that can fail here."""

    VIO = 6
    BATTERY = 100
    MOTOR = 101


class Signal(IntEnum):
    """FAILURE_UNIT of what the flight controller itself stops hearing."""

    RC_SIGNAL = 104
    MAVLINK_SIGNAL = 105


DEAF_MOST_S = 600.0  # simulation time for which stations and scripts are not heard


class Type(IntEnum):
    """FAILURE_TYPE."""

    OK = 0
    OFF = 1
    STUCK = 2
    GARBAGE = 3
    WRONG = 4
    SLOW = 5
    DELAYED = 6
    INTERMITTENT = 7


class Row(NamedTuple):
    """The fault of a unit and a type."""

    kind: Kind
    much: float  # where parameter 4 is 0 or NaN
    least: float  # of parameter 4
    most: float
    unit: str  # of parameter 4, for people; empty: it is not used


ROWS: dict[tuple[int, int], Row] = {
    (Unit.MOTOR, Type.OFF): Row(Kind.MOTOR_OFF, 0.0, 0.0, 0.0, ""),
    (Unit.MOTOR, Type.WRONG): Row(Kind.MOTOR_WEAK, 0.5, 0.0, 1.0, "of thrust and torque left"),
    (Unit.MOTOR, Type.STUCK): Row(Kind.MOTOR_STUCK, 0.0, 0.0, 0.0, ""),
    (Unit.VIO, Type.OFF): Row(Kind.STATE_OFF, 0.0, 0.0, 0.0, ""),
    (Unit.VIO, Type.STUCK): Row(Kind.STATE_STUCK, 0.0, 0.0, 0.0, ""),
    (Unit.VIO, Type.GARBAGE): Row(Kind.STATE_NOISY, 0.1, 0.0, 100.0, "m, m/s, rad/s; a tenth in rad"),
    (Unit.VIO, Type.WRONG): Row(Kind.STATE_JUMPS, 5.0, -1e4, 1e4, "m to the east"),
    (Unit.VIO, Type.DELAYED): Row(Kind.STATE_DELAYED, 0.05, 0.0, 0.5, "s"),
    (Unit.BATTERY, Type.OFF): Row(Kind.BATTERY_LEVEL, 0.0, 0.0, 0.0, ""),
    (Unit.BATTERY, Type.WRONG): Row(Kind.BATTERY_LEVEL, 0.06, 0.0, 1.0, "of the charge at most"),
    (Unit.BATTERY, Type.SLOW): Row(Kind.BATTERY_DRAIN, 100.0, 0.0, 1e4, "A"),
}  # fmt: skip


class Order(NamedTuple):
    """A failure that is asked for: the first five parameters of the command."""

    unit: int  # FAILURE_UNIT
    type: int  # FAILURE_TYPE
    instance: int  # from 1; 0: all
    much: float  # 0: as in ROWS
    for_s: float  # simulation time; 0: until it is set to OK


def order(params: Sequence[float]) -> Order | None:
    """The Order of a command's parameters. None: they are no unit, type or instance."""
    given = [0.0 if math.isnan(value) else _shortest(value) for value in params[:5]]
    if not all(map(math.isfinite, given)):
        return None
    if any(value != round(value) or not 0 <= value <= 255 for value in given[:3]) or given[4] < 0.0:
        return None
    return Order(int(given[0]), int(given[1]), int(given[2]), given[3], given[4])


def _shortest(value: float) -> float:
    """The shortest decimal that rounds to the same float32: 0.06, where 0.0599999987 was received.

    A battery at 6 % is reported as 6 %, and a fault by command is that of a mission to the bit.
    """
    with np.errstate(over="ignore"):
        return float(str(np.float32(value)))


def kinds(of: Order) -> tuple[Kind, ...]:
    """The kinds of fault that an order begins, or with type OK ends. Empty: it cannot be done."""
    if of.type == Type.OK:
        return tuple(sorted({row.kind for (unit, _), row in ROWS.items() if unit == of.unit}))
    row = ROWS.get((of.unit, of.type))
    return () if row is None else (row.kind,)


def words(of: Order) -> str:
    """A possible order, in the words of PX4's `failure` command."""
    what = "" if of.type == Type.OK else f" {Type(of.type).name.lower()}"
    which = f" {of.instance}" if of.instance else ""
    every = ", all" if of.unit == Unit.MOTOR and not of.instance else ""
    unit = Signal(of.unit) if of.unit in set(Signal) else Unit(of.unit)
    return f"{unit.name.lower()}{which}{what}{every}"


def is_in_range(of: Order, rotors: int) -> bool:
    """Return true if the vehicle has the instance of an order, and its size is possible.

    rotors : of the vehicle.  An order of type OK has no size.
    """
    if of.instance > (rotors if of.unit == Unit.MOTOR else 1):
        return False
    row = ROWS.get((of.unit, of.type))
    if row is not None and row.kind is Kind.MOTOR_WEAK and of.much == 1.0:
        return False  # it would change nothing
    return row is None or not of.much or row.least <= of.much <= row.most


def fault(of: Order, now_us: int) -> Fault:
    """The Fault that a possible order begins at a tick."""
    row = ROWS[of.unit, of.type]
    much = of.much or row.much
    size = Size(much, 0.0, 0.0, 0.0)
    if row.kind is Kind.STATE_NOISY:
        size = Size(much, much, 0.1 * much, much)
    return Fault(
        kind=float(row.kind),
        rotor=float(of.instance) if of.unit == Unit.MOTOR else 0.0,
        since_us=float(now_us),
        until_us=now_us + 1e6 * of.for_s if of.for_s else NEVER_US,
        size=size,
    )
