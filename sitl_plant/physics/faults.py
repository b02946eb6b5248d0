"""Faults at a tick: what they do to rotors, to the reported state and to the battery.

Every function is called only while a flight has faults: without one a tick does not come here. What
a fault does follows from simulation time, from the seed of the flight and from the ticks before.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.airframe import ROTORS
from fcu.interface.faults import DELAY_MOST_S, MOST, Fault, Kind
from fcu.interface.messages import Battery, VehicleState
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import packer, size, to_buffer, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.rows import column_of, slice_of
from sitl_plant.physics import tick
from sitl_plant.physics.battery import BatteryState
from sitl_plant.physics.types import PlantParams

Buffer = np.ndarray[Any, np.dtype[np.float64]]
Integers = np.ndarray[Any, np.dtype[np.int64]]

LATE = round(1000 * DELAY_MOST_S) + 1  # states that are kept: of the longest delay at 1000 Hz
_STREAM = 32  # names the noise of faults among what a seed makes

_OFF, _WEAK, _STUCK = (
    Kind.MOTOR_OFF.value, Kind.MOTOR_WEAK.value, Kind.MOTOR_STUCK.value,
)  # fmt: skip
_STATE_OFF, _STATE_STUCK, _NOISY, _DELAYED, _JUMPS = (
    Kind.STATE_OFF.value, Kind.STATE_STUCK.value, Kind.STATE_NOISY.value,
    Kind.STATE_DELAYED.value, Kind.STATE_JUMPS.value,
)  # fmt: skip
_DRAIN, _LEVEL = Kind.BATTERY_DRAIN.value, Kind.BATTERY_LEVEL.value

_LOSS, _LEFT = slice_of(PlantParams, "loss_time"), slice_of(PlantParams, "effectiveness")
_LOSS_AT, _LEFT_AT = _LOSS.start, _LEFT.start
_REMAINING, _CHARGE = column_of(Battery, "remaining"), column_of(BatteryState, "charge")
_UNTIL, _SINCE = column_of(Fault, "until_us"), column_of(Fault, "since_us")
_KIND, _ROTOR = column_of(Fault, "kind"), column_of(Fault, "rotor")
_unpack_fault = unpacker(Fault)
_unpack_r = unpacker(VehicleState, "r_E")
_pack_r = packer(VehicleState, "r_E")


class Struck(NamedTuple):
    """The faults of one flight, and what they remember from tick to tick."""

    table: Buffer  # float64[MOST, size(Fault)]
    used: Integers  # int64[1], how many there are
    loss: Buffer  # float64[8], PlantParams.loss_time of the mission
    left: Buffer  # float64[8], PlantParams.effectiveness of the mission
    noise: Buffer  # float64[n, tick.NOISE], of deviation 1, a row for each row of the noise
    scaled: Buffer  # float64[tick.NOISE], of this tick
    sent: Buffer  # float64[LATE, size(VehicleState)]: a ring of what was reported without faults
    first: Integers  # int64[1], the first tick that is in the ring; negative: none is
    kept: Buffer  # VehicleState, as it was reported before it stuck
    applied: Buffer  # RotorCommand of the last tick


def struck(params: Buffer, faults: Sequence[Fault], block: int) -> Struck:
    """The faults of a flight that begins.  params : PlantParams.  block : rows of noise drawn at once."""
    table = np.zeros((MOST, size(Fault)))
    for row, each in zip(table, faults, strict=False):
        row[:] = to_buffer(each)
    return Struck(
        table=table,
        used=np.array([len(faults)]),
        loss=params[_LOSS].copy(),
        left=params[_LEFT].copy(),
        noise=np.zeros((block, tick.NOISE)),
        scaled=np.zeros(tick.NOISE),
        sent=np.zeros((LATE, size(VehicleState))),
        first=np.array([-1]),
        kept=np.zeros(size(VehicleState)),
        applied=np.zeros(ROTORS),
    )


def is_noisy(faults: Struck) -> bool:
    """Return true if one of the faults adds noise."""
    return bool((faults.table[: faults.used[0], _KIND] == _NOISY).any())


def draw(faults: Struck, seed: int, block: int) -> None:
    """Draw the noise of the ticks of a block, of deviation 1.  block : number of the block of ticks."""
    random = np.random.default_rng([seed, _STREAM, block])
    faults.noise[:] = random.standard_normal(faults.noise.shape)


def add(faults: Struck, fault: Fault) -> bool:
    """Add a fault while the vehicle flies. Return false if there is no room.

    Those that are over make room. The new one is the last, so that it wins where two do not combine.
    """
    table = faults.table[: int(faults.used[0])]
    return _take(faults, [*table[table[:, _UNTIL] > fault.since_us], to_buffer(fault)])


def end(
    faults: Struck, kinds: Sequence[Kind], rotor: int, rotors: int, now_us: float
) -> bool:  # fmt: skip
    """End the faults of some kinds that hold, or are still to come. Return false if there is no room.

    rotor : 0: of all rotors. A fault of all rotors that ends for one goes on as one of each other rotor.
    rotors : of the vehicle.
    """
    table = faults.table[: int(faults.used[0])]
    rows: list[Buffer] = []
    for row in table[table[:, _UNTIL] > now_us]:
        if row[_KIND] not in kinds or (rotor not in (0, row[_ROTOR]) and row[_ROTOR] != 0.0):
            rows.append(row)
        elif rotor and row[_ROTOR] == 0.0:
            rows += [_of_rotor(row, i) for i in range(1, rotors + 1) if i != rotor]
    if rows:
        return _take(faults, rows)
    table[:, _UNTIL] = np.minimum(table[:, _UNTIL], now_us)  # the next tick undoes what they did
    return True


def _of_rotor(row: Buffer, rotor: int) -> Buffer:
    """A Fault as a buffer, of one rotor."""
    row = row.copy()
    row[_ROTOR] = rotor
    return row


def _take(faults: Struck, rows: Sequence[Buffer]) -> bool:
    """Let `rows`, Faults as buffers, be the faults. Return false if there is no room."""
    if len(rows) > MOST:
        return False
    faults.table[: len(rows)], faults.used[0] = rows, len(rows)
    return True


@kernel
def holds(fault, kind, now_us):
    """Return true if a fault is of a kind and holds at a tick."""
    return fault.kind == kind and fault.since_us <= now_us and now_us < fault.until_us


@kernel
def hits(fault, i):
    """Return true if a fault of rotors is of the rotor i, from 0."""
    return fault.rotor == 0.0 or fault.rotor == i + 1.0


@kernel
def weaken(faults, params, now_us):
    """Put into `params` (float64[size(PlantParams)]) what is left of each rotor at a tick.

    now_us : simulation time of the tick, us.
    """
    for i in range(ROTORS):
        params[_LOSS_AT + i], params[_LEFT_AT + i] = faults.loss[i], faults.left[i]
    for k in range(faults.used[0]):
        fault = _unpack_fault(faults.table[k])
        if not holds(fault, _WEAK, now_us):
            continue
        for i in range(ROTORS):
            if hits(fault, i):
                lost = now_us * 1e-6 >= params[_LOSS_AT + i]
                left = params[_LEFT_AT + i] if lost else 1.0
                params[_LOSS_AT + i], params[_LEFT_AT + i] = 0.0, left * fault.size.a


@kernel
def obey(faults, command, now_us):
    """Change `command` (float64[8], RotorCommand) to what the rotors follow at a tick."""
    for k in range(faults.used[0]):
        fault = _unpack_fault(faults.table[k])
        for i in range(ROTORS):
            if hits(fault, i) and holds(fault, _OFF, now_us):
                command[i] = 0.0
            elif hits(fault, i) and holds(fault, _STUCK, now_us):
                command[i] = faults.applied[i]
    for i in range(ROTORS):
        faults.applied[i] = command[i]


@kernel
def drain(faults, drawn, now_us, h):
    """Take charge out of `drawn` (BatteryState) that no load has drawn, over h seconds."""
    for k in range(faults.used[0]):
        fault = _unpack_fault(faults.table[k])
        if holds(fault, _DRAIN, now_us):
            drawn[_CHARGE] += fault.size.a * h


@kernel
def report_battery(faults, battery, now_us):
    """Change `battery` (Battery) to what is reported of it at a tick."""
    for k in range(faults.used[0]):
        fault = _unpack_fault(faults.table[k])
        if holds(fault, _LEVEL, now_us):
            battery[_REMAINING] = min(battery[_REMAINING], fault.size.a)


@kernel
def report_state(faults, reported, now, period_us, noise_at):
    """Change `reported` (VehicleState) as its faults do at a tick. Return true if it has failed.

    now : number of the tick.  noise_at : row of `noise` that is of this tick.
    """
    ring, now_us = faults.sent.shape[0], float(now * period_us)
    if faults.first[0] < 0:
        faults.first[0] = now
    for i in range(reported.size):
        faults.sent[now % ring, i] = reported[i]
        if now == 0:  # there is none before it: a state that fails at once is the first
            faults.kept[i] = reported[i]
    stuck, failed = False, False
    for k in range(faults.used[0]):
        fault = _unpack_fault(faults.table[k])
        if holds(fault, _DELAYED, now_us):
            ticks = np.int64(np.rint(fault.size.a * 1e6 / period_us))
            late = min(ticks, now - faults.first[0], ring - 1)
            for i in range(reported.size):
                reported[i] = faults.sent[(now - late) % ring, i]
        stuck |= holds(fault, _STATE_STUCK, now_us)
        failed |= holds(fault, _STATE_OFF, now_us)
    for k in range(faults.used[0]):
        fault = _unpack_fault(faults.table[k])
        if holds(fault, _NOISY, now_us):
            size = fault.size
            for i in range(3):
                faults.scaled[i] = size.a * faults.noise[noise_at, i]
                faults.scaled[3 + i] = size.b * faults.noise[noise_at, 3 + i]
                faults.scaled[6 + i] = size.c * faults.noise[noise_at, 6 + i]
                faults.scaled[9 + i] = size.d * faults.noise[noise_at, 9 + i]
            tick.sense(reported, faults.scaled, reported)
        if holds(fault, _JUMPS, now_us):
            off = Vec3(fault.size.a, fault.size.b, fault.size.c)
            _pack_r(reported, _unpack_r(reported) + off)
    for i in range(reported.size):
        if stuck or failed:
            reported[i] = faults.kept[i]
        else:
            faults.kept[i] = reported[i]
    return failed
