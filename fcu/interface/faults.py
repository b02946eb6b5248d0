"""Faults to order: what a simulator can be told to break, when, and by how much.

A fault is a value of simulation time alone. A mission lists faults in `[[plant.faults]]`. A vehicle that is up
takes them by MAV_CMD_INJECT_FAILURE. Both become a `Fault`, which the simulator flies.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple

from fcu.interface.files import input_file
from fcu.kernel.buffers import columns, from_buffer, to_buffer

NEVER_US = 1e18  # simulation time that no flight reaches (finite, so that JSON can hold it)
MOST = 64  # faults of one flight
LATEST_S = 1e9  # simulation time of a fault
DELAY_MOST_S = 0.5  # age of a delayed state


class Kind(IntEnum):
    """The parts that break, and how."""

    MOTOR_OFF = 0
    MOTOR_WEAK = 1
    MOTOR_STUCK = 2
    STATE_OFF = 3
    STATE_STUCK = 4
    STATE_NOISY = 5
    STATE_DELAYED = 6
    STATE_JUMPS = 7
    BATTERY_DRAIN = 8
    BATTERY_LEVEL = 9
    LINK_LOST = 10
    LINK_DOUBLED = 11
    LINK_REORDERED = 12
    LINK_LATE = 13
    GROUND_LOST = 14


class Size(NamedTuple):
    """The size of a fault, in the numbers of `Spec.keys`. The rest is 0."""

    a: float
    b: float
    c: float
    d: float


class Fault(NamedTuple):
    """One fault. It holds at ticks from `since_us` on, before `until_us`."""

    kind: float  # Kind
    rotor: float  # 1 to 8; 0: all rotors, or no fault of a rotor
    since_us: float  # simulation time
    until_us: float
    size: Size


class Spec(NamedTuple):
    """The keys of a kind of fault in a mission, and its effect."""

    kind: Kind
    keys: tuple[str, ...]  # of the table, beside kind, at_s and for_s
    says: str


NOISE = ("position_m", "velocity_m_s", "attitude_deg", "rate_rad_s")  # keys of `noise`, in `Size`

SPECS: dict[str, Spec] = {
    "motor_off": Spec(Kind.MOTOR_OFF, ("rotor",), "the rotor is commanded to stand, and slows down"),
    "motor_weak": Spec(
        Kind.MOTOR_WEAK, ("rotor", "effectiveness"), "a fraction of thrust and torque is left"
    ),
    "motor_stuck": Spec(
        Kind.MOTOR_STUCK, ("rotor",), "the rotor keeps the command of the tick before"
    ),
    "state_off": Spec(
        Kind.STATE_OFF, (), "the state is reported as failed: ODOMETRY.quality is -1"
    ),
    "state_stuck": Spec(Kind.STATE_STUCK, (), "the state of the tick before is reported"),
    "state_noisy": Spec(Kind.STATE_NOISY, ("noise",), "white noise is added to the reported state"),
    "state_delayed": Spec(
        Kind.STATE_DELAYED, ("delay_s",), "an older state is reported, in whole ticks"
    ),
    "state_jumps": Spec(
        Kind.STATE_JUMPS, ("jump_m",), "the reported position is off by East, North, Up"
    ),
    "battery_drain": Spec(
        Kind.BATTERY_DRAIN, ("drain_a",), "the battery loses this current beside its loads"
    ),
    "battery_level": Spec(
        Kind.BATTERY_LEVEL, ("remaining",), "the battery reports at most this charge"
    ),
    "link_lost": Spec(Kind.LINK_LOST, ("share",), "this share of the states is lost on the plant link"),
    "link_doubled": Spec(Kind.LINK_DOUBLED, ("share",), "this share of the states comes twice"),
    "link_reordered": Spec(
        Kind.LINK_REORDERED, ("share",), "the state of the tick before comes again behind this share"
    ),
    "link_late": Spec(
        Kind.LINK_LATE, ("share", "late_s"), "this share of the states comes later, in wall time"
    ),
    "ground_lost": Spec(Kind.GROUND_LOST, (), "the vehicle hears no setpoint of the mission"),
}  # fmt: skip
LINK = frozenset({Kind.LINK_LOST, Kind.LINK_DOUBLED, Kind.LINK_REORDERED, Kind.LINK_LATE})
NAMES = {spec.kind: name for name, spec in SPECS.items()}

# Faults that an autopilot answers for: what a law alone, without one, cannot fly.
OF_AUTOPILOT = frozenset({Kind.STATE_OFF, Kind.BATTERY_DRAIN, Kind.BATTERY_LEVEL, Kind.GROUND_LOST})


class FaultsError(ValueError):
    """A file that does not hold faults: what is wrong with it."""


def fault(table: Mapping[str, Any]) -> Fault:
    """The Fault of a table of a mission that has been checked."""
    for_s = table.get("for_s")
    since_us = float(round(1e6 * table["at_s"]))
    return Fault(
        kind=float(SPECS[table["kind"]].kind),
        rotor=float(table.get("rotor") or 0),
        since_us=since_us,
        until_us=NEVER_US if for_s is None else since_us + float(round(1e6 * for_s)),
        size=_size(table),
    )


def hears(faults: Iterable[Fault], time_us: float) -> bool:
    """Return true if none of the faults keeps the vehicle from hearing its mission's setpoints at a time."""
    lost = (each for each in faults if each.kind == Kind.GROUND_LOST)
    return not any(each.since_us <= time_us < each.until_us for each in lost)


def _size(table: Mapping[str, Any]) -> Size:
    noise = table.get("noise") or {}
    if "noise" in SPECS[table["kind"]].keys:
        numbers = [float(noise.get(key) or 0.0) for key in NOISE]
        numbers[2] = math.radians(numbers[2])
    else:
        numbers = [
            float(number)
            for key in SPECS[table["kind"]].keys
            if key != "rotor"
            for number in (table[key] if key == "jump_m" else [table[key]])
        ]
    return Size(*numbers, *[0.0] * (4 - len(numbers)))


def save(path: Path, faults: Sequence[Fault]) -> None:
    """Write faults, exact to the bit. Raises OSError."""
    rows = [dict(zip(columns(Fault), to_buffer(each).tolist(), strict=True)) for each in faults]
    path.write_text(json.dumps(rows, allow_nan=False, indent=1))


def load(path: Path) -> tuple[Fault, ...]:
    """Read what `save` wrote. Raises FaultsError."""
    names = columns(Fault)
    try:
        rows = json.loads(input_file.text(path, input_file.MIB))
        if not isinstance(rows, list) or len(rows) > MOST:
            raise ValueError(f"expected a list of at most {MOST} faults")
        for i, row in enumerate(rows):
            if not isinstance(row, dict) or list(row) != names:
                raise ValueError(f"fault {i}: expected {', '.join(names)}")
            if not all(isinstance(v, int | float) and math.isfinite(v) for v in row.values()):
                raise ValueError(f"fault {i}: expected finite numbers")
            if row["kind"] not in set(Kind) or row["rotor"] not in range(9):
                raise ValueError(
                    f"fault {i}: expected a kind from 0 to {max(Kind)} and a rotor from 0 to 8"
                )
        return tuple(from_buffer(Fault, list(row.values())) for row in rows)
    except OSError as error:
        raise FaultsError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise FaultsError(f"{path}: {error}") from error
