"""The vehicle's parameters: its own table, and a store of all: read, set, refused, saved.

Names, meanings and units of the vehicle's own are PX4's where PX4 has the parameter, so that a
ground station's own description fits; defaults are this vehicle's. REF_ and MR_ are its own. The
law's come from the law's table.

A value is a float32, kept as the shortest decimal that is that float32 (0.3, not
0.30000001192...): what is saved and read again is the same to the bit. A parameter at its value
of the start leaves Settings as they were handed over, to the bit.
"""

from __future__ import annotations

import math
import stat
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol
from weakref import WeakSet

import numpy as np

from fcu.guard import stability
from fcu.guard.gains import RULE, has_rule
from fcu.guard.parameters import GOVERN, WARN
from fcu.guard.types import GuardParams
from fcu.interface.airframe import AirframeFile
from fcu.interface.files import toml_file, whole_file
from fcu.interface.files.spelling import closest
from fcu.interface.files.toml_file import FileError
from fcu.interface.parameter import Parameter, ParameterError, Part, default, group
from fcu.interface.status_texts import ROOM
from fcu.laws import loader, rotor_loss
from fcu.laws.face import Pace
from fcu.laws.loader import Law
from fcu.laws.mmrac.types import Params
from fcu.laws.rotor_loss import Fate
from fcu.laws.scales import G, hover_thrust
from fcu.process.configuration import read_airframe
from fcu.process.settings import Settings

__all__ = [
    "VEHICLE",
    "Entry",
    "Fate",
    "GivenError",
    "Parameters",
    "ParamsFileError",
    "Refused",
    "chosen",
    "entries",
    "parsed",
]

DOES_NOT_EXIST, OUT_OF_RANGE = "DOES_NOT_EXIST", "VALUE_OUT_OF_RANGE"
READ_ONLY, PERMISSION_DENIED = "READ_ONLY", "PERMISSION_DENIED"
P = Parameter


def _fixed(name: str, value: float, why: str, unit: str = "") -> Parameter:
    """A parameter of PX4's that has one value here. `why`: the reason of it, which a refusal says."""
    return P("", name, value, value, value, unit, why, read_only=True, integer=True)


def _rotors(airframe: Mapping[str, Any]) -> float:
    return float(len(airframe["rotors"]["spin"]))


VEHICLE: tuple[Parameter, ...] = (
    *group(
        "Modes that lead the vehicle",
        P("", "MIS_TAKEOFF_ALT", 2.5, 0.5, 80.0, "m", "height of a take-off that names none"),
        P("", "NAV_ACC_RAD", 2.0, 0.05, 200.0, "m", "radius in which a place of a plan counts as reached, and its corner is rounded"),
        P("", "RTL_TYPE", 0.0, 0.0, 6.0, "", "where a return ends: 0 home or rally point, 1 to 6: docs/plans.md", values=(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0), integer=True),
        P("", "RTL_RETURN_ALT", 10.0, 0.0, 150.0, "m", "height above home of the way back"),
        P("", "RTL_DESCEND_ALT", 10.0, 0.0, 100.0, "m", "height above home at which it waits RTL_LAND_DELAY"),
        P("", "RTL_LAND_DELAY", 0.0, -1.0, 300.0, "s", "time above home before it lands; below 0 for ever, 0 lands at once"),
        P("", "MPC_XY_CRUISE", 5.0, 0.5, 20.0, "m/s", "speed across of modes that lead the vehicle"),
        P("", "MPC_XY_VEL_MAX", 12.0, 0.5, 20.0, "m/s", "greatest speed across that is asked for"),
        P("", "MPC_Z_VEL_MAX_UP", 3.0, 0.5, 8.0, "m/s", "greatest speed of a climb"),
        P("", "MPC_TKO_SPEED", 3.0, 1.0, 5.0, "m/s", "speed of a take-off, if MPC_Z_VEL_MAX_UP is not less"),
        P("", "MPC_Z_VEL_MAX_DN", 1.5, 0.5, 4.0, "m/s", "greatest speed of a descent"),
        P("", "MPC_ACC_HOR", 3.0, 0.1, 8.0, "m/s^2", "acceleration across of modes that lead, as far as the guard leaves it"),
        P("", "MPC_TILTMAX_AIR", 45.0, 20.0, 89.0, "deg", "tilt that modes that lead, and setpoints, accelerate across with"),
        P("", "MPC_ACC_UP_MAX", 3.0, 0.1, 6.0, "m/s^2", "vertical acceleration of those modes, up and down, likewise"),
        P("", "MPC_LAND_SPEED", 0.7, 0.3, 1.5, "m/s", "speed of a landing near the ground"),
        P("", "MPC_THR_HOVER", 0.6, 0.1, 0.8, "", "thrust of an attitude setpoint at which the believed vehicle hovers"),
        P("", "MPC_MAN_Y_MAX", 60.0, 1.0, 180.0, "deg/s", "yaw rate at full stick, if the law follows it"),
        P("", "REF_STEP_E", 5.0, -50.0, 50.0, "m", "step of the reference generator to the east"),
        P("", "REF_STEP_N", 0.0, -50.0, 50.0, "m", "step of the reference generator to the north"),
        P("", "REF_STEP_U", 0.0, -20.0, 20.0, "m", "step of the reference generator upwards"),
        P("", "REF_STEP_T", 10.0, 1.0, 120.0, "s", "time at each end of that step"),
        P("", "REF_8_LEN", 10.0, 1.0, 100.0, "m", "length of the generator's figure-eight, to the east"),
        P("", "REF_8_WIDTH", 5.0, 1.0, 100.0, "m", "width of that figure-eight, to the north"),
        P("", "REF_8_SPEED", 3.0, 0.1, 10.0, "m/s", "speed at which that figure-eight crosses itself"),
    ),
    *group(
        "Follow Me",
        P("", "FLW_TGT_HT", 8.0, 8.0, 1000.0, "m", "height above home, or above the target"),
        P("", "FLW_TGT_DST", 8.0, 1.0, 1000.0, "m", "distance across from the target"),
        P("", "FLW_TGT_FA", 180.0, -180.0, 180.0, "deg", "angle to its course, clockwise: 0 ahead, 90 right, 180 behind"),
        P("", "FLW_TGT_ALT_M", 0.0, 0.0, 2.0, "", "height is above 0 home, 1 the ground, flat at home, 2 the target", values=(0.0, 1.0, 2.0), integer=True),
        P("", "FLW_TGT_MAX_VEL", 5.0, 0.0, 20.0, "m/s", "greatest speed across of the vehicle, if MPC_XY_CRUISE is not less"),
        P("", "FLW_TGT_RS", 0.1, 0.0, 1.0, "", "no effect: reports of a target are not filtered"),
    ),
    *group(
        "Setpoints of a script, and their loss",
        P("", "MR_SP_DIST", 100.0, 1.0, 10000.0, "m", "setpoints farther away are flown at this distance"),
        P("", "MR_SP_BELOW", 1.0, 0.0, 10000.0, "m", "setpoints farther below home are flown there"),
        P("", "COM_OF_LOSS_T", 1.0, 0.1, 60.0, "s", "age of the last setpoint at which offboard is lost"),
        P("", "COM_OBL_RC_ACT", 0.0, 0.0, 7.0, "", "then: 0 position, 3 return, 4 land, 5 hold, 6 terminate, 7 disarm", values=(0.0, 3.0, 4.0, 5.0, 6.0, 7.0), integer=True),
        P("", "COM_RCL_EXCEPT", 7.0, 0.0, 7.0, "", "modes that lost sticks do not end: 1 Mission, 2 Hold, 4 Offboard, added", integer=True),
    ),
    *group(
        "Sticks, and their loss",
        P("", "COM_RC_IN_MODE", 3.0, 0.0, 4.0, "", "sticks by: 0 RC_CHANNELS_OVERRIDE, 1 MANUAL_CONTROL, 2 either, 3 first, 4 none", values=(0.0, 1.0, 2.0, 3.0, 4.0), integer=True),
        P("", "COM_RC_LOSS_T", 0.5, 0.1, 35.0, "s", "age of the last sticks at which they are lost"),
        P("", "NAV_RCL_ACT", 2.0, 1.0, 6.0, "", "then, in modes flown by sticks: 1 hold, 2 return, 3 land, 5 terminate, 6 disarm", values=(1.0, 2.0, 3.0, 5.0, 6.0), integer=True),
        P("", "COM_RC_ARM_HYST", 1000.0, 100.0, 1500.0, "ms", "time for which a gesture of arming is held", integer=True),
        P("", "MAN_ARM_GESTURE", 1.0, 0.0, 1.0, "", "1: throttle low and yaw aside arms (right) or disarms (left)", values=(0.0, 1.0), integer=True),
        P("", "MAN_DEADZONE", 0.1, 0.0, 0.99, "", "dead zone of sticks in Position and Altitude"),
        P("", "MPC_VEL_MANUAL", 10.0, 3.0, 20.0, "m/s", "speed across at full stick in Position, if MPC_XY_VEL_MAX is not less"),
        P("", "MPC_XY_MAN_EXPO", 0.6, 0.0, 1.0, "", "curve of the sticks across in Position: 0 straight, 1 cubic"),
        P("", "MPC_Z_MAN_EXPO", 0.6, 0.0, 1.0, "", "curve of the throttle in Position and Altitude"),
        P("", "MPC_YAW_EXPO", 0.6, 0.0, 1.0, "", "curve of the yaw stick in Position and Altitude"),
        P("", "MPC_MAN_Y_TAU", 0.08, 0.0, 5.0, "s", "time constant of the yaw rate that a stick asks for"),
        P("", "MPC_MAN_TILT_MAX", 35.0, 1.0, 70.0, "deg", "tilt at full stick, if the law's limit is not less"),
        P("", "MC_MAN_TILT_TAU", 0.0, 0.0, 2.0, "s", "time constant of the tilt that sticks ask for"),
        P("", "MPC_LAND_ALT1", 10.0, 0.0, 122.0, "m", "height above ground below which the throttle's speeds fade"),
        P("", "MPC_LAND_ALT2", 5.0, 0.0, 122.0, "m", "height above ground below which they are MPC_LAND_SPEED and MPC_TKO_SPEED"),
        P("", "MPC_THR_CURVE", 0.0, 0.0, 1.0, "", "throttle in Stabilized: 0 its middle hovers, 1 straight", values=(0.0, 1.0), integer=True),
        P("", "MPC_MANTHR_MIN", 0.08, 0.0, 1.0, "", "thrust of a low throttle in flight in Stabilized"),
        P("", "MPC_THR_MAX", 1.0, 0.0, 1.0, "", "thrust of a full throttle in Stabilized"),
        P("", "MC_ACRO_R_MAX", 720.0, 0.0, 1800.0, "deg/s", "roll rate at full stick in Acro"),
        P("", "MC_ACRO_P_MAX", 720.0, 0.0, 1800.0, "deg/s", "pitch rate at full stick in Acro"),
        P("", "MC_ACRO_Y_MAX", 540.0, 0.0, 1800.0, "deg/s", "yaw rate at full stick in Acro"),
        P("", "MC_ACRO_EXPO", 0.69, 0.0, 1.0, "", "curve of roll and pitch in Acro: 0 straight, 1 cubic"),
        P("", "MC_ACRO_SUPEXPO", 0.7, 0.0, 0.95, "", "how far it bends still more towards the ends"),
        P("", "MC_ACRO_EXPO_Y", 0.69, 0.0, 1.0, "", "curve of yaw in Acro: 0 straight, 1 cubic"),
        P("", "MC_ACRO_SUPEXPOY", 0.7, 0.0, 0.95, "", "how far it bends still more towards the ends"),
    ),
    *group(
        "Fence",
        P("", "GF_ACTION", 2.0, 0.0, 5.0, "", "outside the fence: 0 nothing, 1 warn, 2 hold, 3 return, 4 terminate, 5 land", values=(0.0, 1.0, 2.0, 3.0, 4.0, 5.0), integer=True),
        P("", "GF_MAX_HOR_DIST", 0.0, 0.0, 10000.0, "m", "greatest distance across from home; 0: no limit"),
        P("", "GF_MAX_VER_DIST", 0.0, 0.0, 10000.0, "m", "greatest height above home; 0: no limit"),
        P("", "GF_PREDICT", 0.0, 0.0, 1.0, "", "1: the fence is held against the place where the vehicle would stop", values=(0.0, 1.0), integer=True),
    ),
    *group(
        "Failsafes",
        P("", "COM_FAIL_ACT_T", 0.0, 0.0, 25.0, "s", "time in Hold before a failsafe returns or lands"),
        P("", "NAV_DLL_ACT", 0.0, 0.0, 6.0, "", "ground station lost: 0 nothing, 1 hold, 2 return, 3 land, 5 terminate, 6 disarm", values=(0.0, 1.0, 2.0, 3.0, 5.0, 6.0), integer=True),
        P("", "COM_DL_LOSS_T", 10.0, 5.0, 300.0, "s", "age of a ground station's last heartbeat at which it is lost", integer=True),
        P("", "FD_FAIL_R", 60.0, 0.0, 180.0, "deg", "roll at which the attitude is lost, but for flight by rates; 0: none", integer=True),
        P("", "FD_FAIL_P", 60.0, 0.0, 180.0, "deg", "pitch at which the attitude is lost, but for flight by rates; 0: none", integer=True),
        P("", "FD_FAIL_R_TTRI", 0.3, 0.02, 5.0, "s", "for so long the roll is beyond FD_FAIL_R"),
        P("", "FD_FAIL_P_TTRI", 0.3, 0.02, 5.0, "s", "for so long the pitch is beyond FD_FAIL_P"),
        P("", "COM_LKDOWN_TKO", 3.0, -1.0, 5.0, "s", "time since arming in which a lost attitude disarms"),
        P("", "CBRK_FLIGHTTERM", 121212.0, 0.0, 121212.0, "", "0: a lost attitude or state terminates the flight; 121212: warns", values=(0.0, 121212.0), integer=True),
        P("", "CA_FAILURE_MODE", 1.0, 0.0, 1.0, "", "a rotor that is lost: 0 gets its share of the work as before, 1 gets none", values=(0.0, 1.0), integer=True),
        P("", "COM_ACT_FAIL_ACT", 0.0, 0.0, 4.0, "", "a rotor is lost: 0 warn, 1 hold, 2 land, 3 return, 4 terminate", values=(0.0, 1.0, 2.0, 3.0, 4.0), integer=True),
        P("", "FD_ACT_MOT_THR", 0.2, 0.0, 1.0, "", "wanted speed over full speed above which a rotor may be found lost"),
        P("", "FD_ACT_MOT_TOUT", 100.0, 10.0, 10000.0, "ms", "for so long it has less than half of the speed", integer=True),
        P("", "MR_LAW_ACT", 1.0, 0.0, 1.0, "", "the law fails: 0 the flight ends, 1 px4 flies on (chosen at the start)", values=(0.0, 1.0), integer=True, at_start=True),
        P("", "MR_GUARD_ACT", 0.0, 0.0, 2.0, "", "beliefs of the guard contradicted in flight: 0 warn, 1 hold, 2 land", values=(0.0, 1.0, 2.0), integer=True),
    ),
    *group(
        "Arming",
        P("", "COM_DISARM_LAND", 2.0, -1.0, 60.0, "s", "time on the ground until it disarms; below 0 never"),
        P("", "COM_DISARM_PRFLT", 10.0, -1.0, 60.0, "s", "time until it disarms if it does not take off; below 0 never"),
    ),
    *group(
        "Battery",
        P("", "COM_LOW_BAT_ACT", 0.0, 0.0, 3.0, "", "low in flight: 0 warn, 2 land if critical, 3 return, land in an emergency", values=(0.0, 2.0, 3.0), integer=True),
        P("", "COM_FLTT_LOW_ACT", 0.0, 0.0, 3.0, "", "the charge does not last for the way home: 0 nothing, 1 warn, 3 return", values=(0.0, 1.0, 3.0), integer=True),
        P("", "BAT_EMERGEN_THR", 0.05, 0.0, 1.0, "", "charge at which it is an emergency", below="BAT_CRIT_THR"),
        P("", "BAT_CRIT_THR", 0.07, 0.0, 1.0, "", "charge at which it is critical", below="BAT_LOW_THR"),
        P("", "BAT_LOW_THR", 0.15, 0.0, 1.0, "", "charge at which the battery is low"),
        P("", "BAT1_CAPACITY", None, 100.0, 100000.0, "mAh", "of a full battery, for the time left", airframe="battery.capacity_mah"),
        P("", "BAT1_V_EMPTY", 3.27, 0.0, 5.0, "V", "of an empty cell, as the plant has it", read_only=True),
        P("", "BAT1_N_CELLS", None, 1.0, 16.0, "", "cells in series, as the plant has them", read_only=True, airframe="battery.cells", integer=True),
    ),
    *group(
        "What ground stations ask for",
        P("", "SYS_FAILURE_EN", 0.0, 0.0, 1.0, "", "1: failures may be injected by command (MAV_CMD_INJECT_FAILURE)", values=(0.0, 1.0), integer=True),
        P("", "SYS_AUTOSTART", None, 0.0, 9999999.0, "", "PX4's number of the airframe", read_only=True, airframe="mavlink.autostart", integer=True),
        P("", "CA_ROTOR_COUNT", None, 1.0, 32.0, "", "rotors of the airframe", read_only=True, rule=_rotors, integer=True),
        P("", "MAV_SYS_ID", 1.0, 1.0, 250.0, "", "MAVLink system, set at the start", read_only=True, integer=True),
        P("", "MAV_TYPE", None, 0.0, 45.0, "", "MAVLink type of the vehicle", read_only=True, airframe="mavlink.type", integer=True),
    ),
    *group(
        "With a fixed value: stations and scripts ask for them",
        _fixed("CAL_ACC0_ID", 1310988.0, "nothing to calibrate: the state comes from the simulator"),
        _fixed("CAL_GYRO0_ID", 1310988.0, "nothing to calibrate: the state comes from the simulator"),
        _fixed("CAL_MAG0_ID", 197388.0, "nothing to calibrate: the state comes from the simulator"),
        _fixed("CBRK_IO_SAFETY", 22027.0, "no safety switch"),
        _fixed("CBRK_SUPPLY_CHK", 894281.0, "no check of the power supply"),
        _fixed("COM_ARM_WO_GPS", 1.0, "arming needs a state from the simulator, no GPS"),
        _fixed("COM_FLTMODE1", -1.0, "no receiver whose switch selects a mode"),
        _fixed("RC_MAP_ROLL", 0.0, "no receiver whose channels are mapped"),
        _fixed("SENS_BOARD_ROT", 0.0, "no board that can be turned"),
        _fixed("SYS_AUTOCONFIG", 0.0, "the airframe is chosen at the start (--airframe)"),
        _fixed("SYS_HAS_MAG", 1.0, "the heading comes from the simulator"),
    ),
)  # fmt: skip


# --- a parameter as MAVLink has it


class Entry(NamedTuple):
    """One parameter of MAVLink: a part of a row, in MAVLink's unit."""

    part: Part
    row: Parameter
    unit: str  # empty: a number without unit
    low: float
    high: float
    default: float
    values: tuple[float, ...] | None  # if only these are allowed
    airframe: Mapping[str, Any]  # the tables that defaults follow from

    @property
    def name(self) -> str:
        """At most 16 characters."""
        return self.part.name

    @property
    def sentence(self) -> str:
        """What it is."""
        words = sorted((number, word) for word, number in (self.row.words or {}).items())
        meanings = ", ".join(f"{number:g} {word}" for number, word in words)
        return f"{self.part.sentence}: {meanings}" if meanings else self.part.sentence

    def get(self, settings: Any) -> float:
        """Its value in Settings."""
        at = self.row.fields.index(self.part.fields[0])
        number = self.row.get(settings)[at]
        return math.degrees(number) if self.row.degrees else number

    def put(self, settings: Any, value: float) -> Any:
        """Settings with another value."""
        number = math.radians(value) if self.row.degrees else value
        old = zip(self.row.fields, self.row.get(settings), strict=True)
        numbers = tuple(number if f in self.part.fields else v for f, v in old)
        return self.row.put(settings, numbers, self.airframe)

    def expected(self) -> str:
        """What it may be, in words."""
        if self.values is not None:
            return "one of " + ", ".join(_number(v) for v in self.values)
        return f"{_number(self.low)} to {_number(self.high)} {self.unit}".rstrip()


def entries(rows: Iterable[Parameter], airframe: Mapping[str, Any]) -> dict[str, Entry]:
    """Name -> MAVLink's parameter, in the order of the rows. `airframe`: tables of its file."""
    found = {}
    for row in rows:
        scale = math.degrees if row.degrees else float
        numbers = row.numbers(default(row, airframe)) if row.parts else ()
        for part in row.parts:
            found[part.name] = Entry(
                part=part,
                row=row,
                unit=row.unit.replace("rad", "deg") if row.degrees else row.unit,
                low=scale(row.low),
                high=scale(row.high),
                default=scale(numbers[row.fields.index(part.fields[0])]),
                values=tuple(sorted(row.words.values())) if row.words else row.values,
                airframe=airframe,
            )
    return found


def _pairs(table: Mapping[str, Entry]) -> Iterator[tuple[str, str, bool]]:
    """Names of which the first must not be above the second, and whether it must be below."""
    names = {p.row.name: name for name, p in table.items()}
    for name, p in table.items():
        if p.row.below:
            yield name, names[p.row.below], True
        if p.row.interval and p.part is p.row.parts[0]:
            yield name, p.row.parts[1].name, False


# --- chosen for a flight


class GivenError(ParameterError):
    """A parameter that cannot be chosen for a flight: `name`, and the reason."""

    def __init__(self, name: str, why: str) -> None:
        super().__init__(f"{name}: {why}")
        self.name = name


def chosen(
    given: Mapping[str, float], flown: Law, airframe: Mapping[str, Any]
) -> dict[str, float]:  # fmt: skip
    """Values of the vehicle's own parameters, by their MAVLink names, as a vehicle keeps them.

    flown : the law, whose parameters a mission sets in [law].  airframe : the tables of its file.
    Raises GivenError for a name, a value or a pair of values that no vehicle takes.
    """
    table, found = entries(VEHICLE, airframe), {}
    for name, value in given.items():
        p = table.get(name)
        if p is None:
            raise GivenError(name, _unknown(name, table, flown))
        if p.row.read_only:
            raise GivenError(name, f"read only: {p.sentence}")
        found[name] = shortest(value)
        if p.row.integer and not float(value).is_integer():
            raise GivenError(name, f"expected a whole number, got {_number(value)} ({p.sentence})")
        allowed = found[name] in p.values if p.values is not None else p.low <= value <= p.high
        if not allowed:
            raise GivenError(name, f"expected {p.expected()}, got {_number(value)} ({p.sentence})")
    for low, high, strict in _pairs(table):
        a, b = (found.get(name, table[name].default) for name in (low, high))
        if not (a < b or (a == b and not strict)):
            must = "below" if strict else "at most"
            name, other, limit = (low, high, b) if low in found else (high, low, a)
            said = f"{must} {other}" if name == low else f"no less than {other}"
            raise GivenError(name, f"expected {said}, {_number(limit)}, got {_number(found[name])}")
    return found


def _unknown(name: str, table: Mapping[str, Entry], flown: Law) -> str:
    """Why there is no such parameter of the vehicle, and which was meant."""
    of_law = {
        part.name: f"[law] {row.key} (--set law.{row.key}=)" if row.key else "the airframe's file"
        for row in flown.settings.PARAMETERS
        for part in row.parts
    }
    if name in of_law:
        return f"a parameter of the law: set {of_law[name]}"
    meant = closest(name.upper(), [*table, *of_law])
    if meant in of_law:
        return f"no such parameter (did you mean {meant}? It is of the law: set {of_law[meant]})"
    return f"no such parameter{'' if meant is None else f' (did you mean {meant}?)'}"


def parsed(written: Iterable[str]) -> dict[str, float]:
    """Values by name, of NAME=VALUE each. Raises GivenError."""
    found = {}
    for text in written:
        name, _, value = (part.strip() for part in text.partition("="))
        try:
            number = float(value)
        except ValueError:
            raise GivenError(name, f"expected NAME=VALUE with a number, got {text}") from None
        if name in found:
            raise GivenError(name, "given twice: expected it once")
        found[name] = number
    return found


# --- the store


class Refused(ValueError):
    """A parameter that was not set: `kind`, one of the four above, and the reason in words."""

    def __init__(self, kind: str, message: str, brief: str = "") -> None:
        """`brief`: the reason in the room of a STATUSTEXT."""
        super().__init__(message)
        self.kind = kind
        self.brief = brief or message


def _briefly(name: str, value: float, *whys: str) -> str:
    """Why a parameter was not set, in the room of a STATUSTEXT: the first of the texts that fits.

    `whys`: the reason, the fullest first. The value is left out where it finds no room.
    """
    names = f"{name} {_number(value)}", name
    texts = [f"{named} refused: {why}" for why in whys for named in names]
    return next((text for text in texts if len(text) <= ROOM), texts[-1])


class Unstable(Refused):
    """A value that was not set, since the loop would not be stable with it."""


class ParamsFileError(ValueError):
    """A file of parameters that cannot be flown: file, line, name and what was expected."""


def shortest(value: float) -> float:
    """The shortest decimal that rounds to the same float32; beyond float32, infinity."""
    with np.errstate(over="ignore"):
        return float(str(np.float32(value)))


def _number(value: float) -> str:
    return f"{value:.9g}"


def _guard_of(settings: Any) -> GuardParams | None:
    """The parameters of the guard. None: the law has none."""
    guard = getattr(settings, "guard", None)
    return guard if isinstance(guard, GuardParams) else None


def _without_promise(left: Any, whole: Any) -> Any:
    """Settings without some rotors, of a guard that promises nothing and keeps to the speeds of the whole vehicle."""
    guard, before = _guard_of(left), _guard_of(whole)
    if guard is None or before is None:
        return left
    return left._replace(
        guard=guard._replace(
            policy=min(guard.policy, GOVERN), promises=0.0,
            top=before.top, brake=before.brake, down=before.down,
        )
    )  # fmt: skip


@lru_cache(maxsize=64)
def _left(
    module: Any, settings: Any, lost: frozenset[int], weight: float, heaviest: float
) -> tuple[Fate, Any]:
    """The Fate of a vehicle without the lost rotors, and settings of a law for it: as `of_what_is_left`.

    weight, heaviest : of the middle and of the greatest believed mass, N.
    """
    law = settings.law
    fate, rotors, limits = rotor_loss.without(law.rotors, law.limits, lost, weight, heaviest)
    if fate is Fate.FALLS:
        return fate, settings
    left = module.derived(settings._replace(law=law._replace(rotors=rotors, limits=limits)))
    return fate, _without_promise(left, settings)


class Follower(Protocol):
    """An object that works with values of parameters."""

    def parameters_changed(self) -> None:
        """Take the values in force."""


class Parameters:
    """Every parameter of one vehicle, and the Settings in force."""

    def __init__(
        self,
        settings: Settings,
        system_id: int,
        file: Path | None = None,
        flown: Law | None = None,
        airframe: AirframeFile | None = None,
        given: Mapping[str, float] | None = None,
    ) -> None:
        """`given`: of `chosen`, in force from the start.  `file`: read now, if it is there; its folder must be. Raises ParamsFileError.

        `flown`: the law that they are of; None: that of the paper.  `airframe`: with what it pins for
        that law; None: an S1000. Raises ParameterError if one of the law's names is the vehicle's.
        """
        self.flown = flown = flown or loader.load()
        self._module = flown.settings
        # which values go together is known of the law of the paper alone
        self._rule = stability if has_rule(flown) else None
        airframe = airframe or read_airframe(flown)
        tables = self._tables = airframe.tables
        self._of_law = entries(self._module.PARAMETERS, tables)  # in the order of `put`
        of_vehicle = entries(VEHICLE, tables)
        if both := of_vehicle.keys() & self._of_law.keys():
            raise ParameterError(
                f"{flown.source}: PARAMETERS: {', '.join(sorted(both))}: a name of the vehicle's"
            )
        self._table = {**of_vehicle, **self._of_law}
        self._pairs = tuple(_pairs(self._table))
        self.names: tuple[str, ...] = tuple(sorted(self._table))
        self._indices = {name: i for i, name in enumerate(self.names)}
        self.airframe = airframe
        self._start = settings
        self._fixed = {"MAV_SYS_ID": float(system_id)}
        self._changed: dict[str, float] = {}  # what differs from the law and the defaults
        self._chosen = settings  # as they were chosen
        self._lost: frozenset[int] = frozenset()  # rotors
        self._shared = True  # the law gives these no work
        self.settings = settings  # in force: of what is left of the vehicle
        self.followers: WeakSet[Follower] = WeakSet()  # told of every change
        # what starts unstable, or unable to hover, may fly on, for a study
        self._stable, self._able = not self._unstable(settings), not self._grounded(settings)
        self._values = self._bases(self._changed)
        self.changed: tuple[str, ...] = ()  # by the last value that was set
        if file is not None:
            self._read(file)
        if given:
            self._adopt({**self._changed, **given})
        self._at_start = dict(self._changed)

    @property
    def law(self) -> Params:
        """The law's parameters in force."""
        return self.settings.law

    @property
    def pace(self) -> Pace:
        """What modes that lead the vehicle have to know of the law."""
        pace: Pace = self._module.pace(self.settings, self._tables)
        return pace

    @property
    def weight(self) -> float:
        """The weight of the middle of the masses that the airframe file believes, N."""
        return hover_thrust(self._tables)

    @property
    def guard(self) -> GuardParams:
        """The guard's parameters in force; without a guard, nothing."""
        return self.settings.guard

    def is_of_guard(self, name: str) -> bool:
        """True for a parameter of the guard."""
        return name in self._of_law and self._of_law[name].row.fields[0].startswith("guard.")

    def is_of_law(self, name: str) -> bool:
        """True for a parameter of the law or of the guard."""
        return name in self._of_law

    def __len__(self) -> int:
        return len(self.names)

    def index(self, name: str) -> int:
        """Place of a parameter in `names`. Raises KeyError."""
        return self._indices[name]

    def __getitem__(self, name: str) -> float:
        """The value in force. Raises KeyError."""
        return self._values[name]

    def info(self, name: str) -> Entry:
        """What a parameter is. Raises KeyError."""
        return self._table[name]

    def set(self, name: str, value: float, armed: bool) -> bool:
        """Set a parameter; False if it had this value. Raises Refused, with nothing changed.

        `changed` then names all that changed: the prediction takes its bounds along.
        """
        p = self._table.get(name)
        if p is None:
            raise Refused(DOES_NOT_EXIST, f"{name}: no such parameter")
        value = shortest(value)
        if value == self._values[name]:
            return False
        if p.row.read_only:
            raise Refused(READ_ONLY, f"{name} is read only: {p.sentence}", f"{name} is read only")
        self._in_range(p, value)
        if p.row.at_start:
            said = f"{name} is chosen at the start"
            raise Refused(READ_ONLY, f"{said} (fcu --param {name}={_number(value)})", said)
        if p.row.disarmed_only and armed:
            raise Refused(PERMISSION_DENIED, f"{name} can be set while disarmed only")
        before = self._values
        self._adopt({**self._changed, name: value}, name)
        self.changed = tuple(n for n in self.names if self._values[n] != before[n])
        return True

    def reset(self) -> None:
        """Every parameter as it was at the start, after the file was read."""
        self._adopt(self._at_start)

    # --- rotors that are lost

    @property
    def is_promised(self) -> bool:
        """True while a guard keeps what is flown inside what it believes, rather than warn."""
        guard = _guard_of(self.settings)
        return guard is not None and guard.policy != WARN and guard.promises > 0.0

    @property
    def is_void(self) -> bool:
        """True while a guard that would keep to what it believes promises nothing, since a rotor is lost."""
        guard = _guard_of(self.settings)
        return guard is not None and guard.policy != WARN and guard.promises == 0.0

    def foresee(self, module: Any = None, settings: Any = None) -> None:
        """Work out what is left without each of the rotors, so that a flight need not wait for it.

        module, settings : as for `of_what_is_left`. By default those of the law.
        """
        module, settings = module or self._module, settings or self._chosen
        for rotor in range(1, settings.law.rotors.n + 1):
            _left(module, settings, frozenset((rotor,)), self.weight, self._heaviest)

    def lose(self, rotors: Iterable[int], shared: bool = True) -> Fate:
        """Have the law share its work among the rotors that are not lost. Returns what they can do.

        rotors : numbers of all that are lost, from 1. Where the others do not hold roll and pitch, or with
        `shared` false, the law goes on as it was.
        """
        self._lost, self._shared = frozenset(rotors), shared
        fate, self.settings = self.of_what_is_left(self._module, self._chosen)
        return fate

    def of_what_is_left(self, module: Any, settings: Any) -> tuple[Fate, Any]:
        """The Fate of the vehicle without the lost rotors, and settings of a law for it.

        module : the law's `fcu.process.settings`, of which `settings` are. Without a rotor the vehicle is not
        the one that a guard believes in. It promises nothing, and holds the reference to the speeds of the whole
        vehicle and to a jerk alone: one that refuses, too.
        """
        if not self._lost:
            return Fate.FLIES, settings
        if not self._shared:
            return Fate.FLIES, _without_promise(settings, settings)
        return _left(module, settings, self._lost, self.weight, self._heaviest)

    @property
    def _heaviest(self) -> float:
        """The weight of the greatest mass that the airframe file believes, N."""
        return G * float(self._tables["vehicle"]["mass_kg"][1])

    # --- what is in force

    def _bases(self, changed: Mapping[str, float]) -> dict[str, float]:
        """The value that each parameter has while nobody sets it: some go with others' values."""
        leading = {k: v for k, v in changed.items() if self._table[k].row.leads}
        settings = self._with(leading) if leading else self._start
        found = {}
        for name in self.names:
            p = self._of_law.get(name)
            if p is None:
                found[name] = self._fixed.get(name, self._table[name].default)
            else:
                found[name] = shortest(p.get(self._start if p.row.leads else settings))
        return found

    def _with(self, values: Mapping[str, float]) -> Settings:
        """Settings with the law's and the guard's among `values`; the start's if there are none."""
        settings = self._start
        for name, p in self._of_law.items():
            if name in values:
                settings = p.put(settings, values[name])
        return settings

    def _law_alone(self, values: Mapping[str, float]) -> dict[str, float]:
        return {name: value for name, value in values.items() if name in self._of_law}

    def _unstable(self, settings: Settings) -> str:
        return self._rule.unstable(settings.law, settings.guard) if self._rule else ""

    def _grounded(self, settings: Settings) -> str:
        return self._rule.grounded(settings.law, settings.guard) if self._rule else ""

    @staticmethod
    def _in_range(p: Entry, value: float) -> None:
        allowed = value in p.values if p.values is not None else p.low <= value <= p.high
        if not allowed:  # nor is what is not a number
            raise Refused(
                OUT_OF_RANGE,
                f"{p.name} {_number(value)} refused: {p.expected()}",
                _briefly(p.name, value, p.expected()),
            )

    def _adopt(self, wanted: dict[str, float], name: str = "") -> None:
        """Put values in force that are in range each. Raises Refused if not so together.

        `name`: the parameter that is set, if it is one alone.
        """
        refused = f"{name} {_number(wanted[name])} refused: " if name else ""

        def brief(*whys: str) -> str:
            return _briefly(name, wanted.get(name, math.nan), *whys)

        bases = self._bases(wanted)
        changed = {k: v for k, v in wanted.items() if v != bases[k]}
        values = {**self._bases(changed), **changed}
        for low, high, strict in self._pairs:
            if values[low] < values[high] or (values[low] == values[high] and not strict):
                continue
            must = "must be below" if strict else "must not be above"
            at = f"{low} {_number(values[low])} {must} {high} {_number(values[high])}"
            first = high if name == low else low
            at += f" (set {first} first)" if name else ""
            raise Refused(OUT_OF_RANGE, refused + at, brief(f"set {first} first"))
        if self._law_alone(changed) != self._law_alone(self._changed):
            settings = self._with(changed)
            try:
                self._module.check(settings)
            except ParameterError as error:
                raise Refused(
                    OUT_OF_RANGE, f"{refused}{error}", brief(str(error), "see the log")
                ) from error
            why = self._grounded(settings)
            if why and self._able:
                raise Refused(
                    OUT_OF_RANGE,
                    refused + why,
                    brief(why, why.partition(" (")[0], "it would not hover"),
                )
            channel = self._unstable(settings)
            if channel and self._stable:
                why = self._why(channel, changed, values)
                short = f"{channel} unstable; {why.rpartition('; ')[2]}", f"{channel} unstable"
                raise Unstable(OUT_OF_RANGE, refused + why, brief(*short))
            if settings is not self._start:  # which was worked out as it was handed over
                settings = self._module.derived(settings)
            self._chosen, self._stable, self._able = settings, not channel, not why
            self.settings = self.of_what_is_left(self._module, settings)[1]
        self._changed, self._values = changed, values
        for follower in self.followers:
            follower.parameters_changed()

    def _why(self, channel: str, changed: dict[str, float], values: dict[str, float]) -> str:
        """Why a combination that is not stable is refused: the channel, with what, what would do."""
        assert self._rule is not None
        decides = self._rule.DECIDES[channel]
        new = [n for n in decides if values[n] != self._values[n]]
        beside = [n for n in decides if n not in new][:2]
        why = f"{channel} unstable with " + ", ".join(f"{n} {_number(values[n])}" for n in beside)
        if len(new) != 1:
            return why
        name = new[0]
        good, bad = self._values[name], values[name]
        for _ in range(5):  # halve the way, in ratio
            middle = float(f"{(good * bad) ** 0.5 if good > 0.0 else 0.5 * bad:.3g}")
            settings = self._with({**changed, name: middle})
            fine = self._rule.stable(settings.law, settings.guard, channel) and not self._unstable(
                settings
            )
            good, bad = (middle, bad) if fine else (good, middle)
        return f"{why}; {_number(good)} would do"

    # --- the file

    def text(self) -> str:
        """The file's text: TOML, a parameter a line, without those that are read only."""
        rows = []
        for p in (self._table[name] for name in self.names):
            if not p.row.read_only:
                of = f"{p.unit}: " if p.unit else ""
                rows.append(f"{p.name} = {self._values[p.name]!r}  # {of}{p.sentence}\n")
        return "".join(rows)

    def write(self, path: Path, text: str | None = None) -> None:
        """Write `text` (the text as of now) whole or not at all. Raises OSError.

        What a link points to is replaced, not the link; the file's mode is kept.
        """
        text = self.text() if text is None else text
        whole_file.write(path, text.encode())

    def _read(self, path: Path) -> None:
        try:
            if not path.parent.is_dir():
                raise ParamsFileError(f"{path}: there is no folder {path.parent}")
            if not stat.S_ISREG(path.stat().st_mode):
                raise ParamsFileError(f"{path}: not a file")
        except FileNotFoundError:
            return
        except OSError as error:
            raise ParamsFileError(f"{path}: {error.strerror}") from error
        try:
            file = toml_file.read(path)
        except FileError as error:
            raise ParamsFileError(str(error)) from error
        values: dict[str, float] = {}
        for name, value in file.tables.items():
            where = f"{file.where(name)}: {name}"
            p = self._table.get(name)
            if p is None:
                raise ParamsFileError(f"{where}: {_unknown(name, self._table, self.flown)}")
            if p.row.read_only:
                raise ParamsFileError(f"{where}: read only: {p.sentence}")
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ParamsFileError(f"{where}: expected a number, {p.expected()}, got {value!r}")
            try:
                values[name] = shortest(value)
            except OverflowError:
                values[name] = math.inf
            try:
                self._in_range(p, values[name])
            except Refused as error:
                got = _number(values[name])
                raise ParamsFileError(f"{where}: expected {p.expected()}, got {got}") from error
        try:
            self._adopt(values)
        except Refused:
            name, why = self._one_too_many(values)
            where = f"{file.where(name)}: {name} {_number(values[name])}"
            rule = RULE if isinstance(why, Unstable) else ""
            raise ParamsFileError(f"{where} refused: {why}{rule}") from why

    def _one_too_many(self, values: dict[str, float]) -> tuple[str, Refused]:
        """Of values that are refused together the one, in their order, after which they are; why."""
        name, so_far = "", dict[str, float]()
        why = Refused(OUT_OF_RANGE, "")
        for each, value in values.items():
            so_far[each] = value
            try:
                self._adopt(so_far)
                name = ""
            except Refused as refused:
                name, why = name or each, refused
        return name, why
