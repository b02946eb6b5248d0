"""Ticks from the datagram that arrives to the one that leaves, in compiled code: a burst.

A tick at which nothing happens but flying is done here, whole; at any other one a burst ends
before anything of it is done, and Python does it with the same kernels. What a burst changes
(what law and guard remember, filter, detectors, rows) are arrays that Python shares, so they are
current when it ends. `tick` knows no socket: a flight in one process calls it as it is.
"""

from __future__ import annotations

import math
from pathlib import Path
from traceback import extract_tb
from typing import Any, NamedTuple

import numpy as np

from fcu.guard.types import Contradicted
from fcu.interface.messages import Battery, Setpoint, VehicleState
from fcu.kernel import system
from fcu.kernel.buffers import packer, size, to_buffer, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.pointers import Pointer, address_of, call_law
from fcu.kernel.rows import column_of, slice_of
from fcu.laws.face import FLYING, IDLE, TAKE_OVER, SharedTick
from fcu.mavlink.plant_link import LONGEST, Desk, PlantCodec, pack_controls, parse_state
from fcu.process.finite import is_finite, note_computed, pushes
from fcu.vehicle.conditions import NO_MODEL, Watch, look
from fcu.vehicle.position_filter import Filtered, quiet, take

Buffer = np.ndarray[Any, np.dtype[np.float64]]
Integers = np.ndarray[Any, np.dtype[np.int64]]
Bytes = np.ndarray[Any, np.dtype[np.uint8]]

# what `tick` says in place of a length
NOT_QUIET, NOT_QUIET_FILTERED, LAW_RAISED = 0, -1, -2
SLOW_S = 0.5e-3  # wall: who waits longer for a state waits in Python, for ground stations too
LOAD_SMOOTHED = 1.0 / 256.0
SAID = 300  # characters at most of what a law has raised

_command = slice_of(SharedTick, "command")
_REMAINING = column_of(Battery, "remaining")
_WANTED = slice_of(Watch, "rotors.wanted").start
_CONTRADICTED, _SIGNS = column_of(Watch, "contradicted"), size(Contradicted)
_FIRST_COMMAND, _END_COMMAND = _command.start, _command.stop
_thrusts = slice_of(SharedTick, "outputs.thrusts")
_FIRST_THRUST = _thrusts.start
_SHARED = size(SharedTick)
RAISED_AN_ERROR, NOT_FINITE = 1.0, 2.0  # how a law fails; NOT_FINITE: or a rotor is to pull


class Course(NamedTuple):
    """What is flown, as Python has decided it; and how far a burst has come."""

    system: float  # MAVLink's system id
    period_us: float
    h: float  # the same, s
    time_us: float  # simulation time of the last tick; negative before the first
    armed: float  # 1 while the rotors may turn
    airborne: float  # 1 while positions are checked: armed, and not on the ground
    engaged: float  # IDLE, TAKE_OVER or FLYING
    since_us: float  # when the setpoint took effect
    load: float  # smoothed: cycle over the control period
    answer_bytes: float  # length of the last answer
    failure: float  # of the law, at the last tick: RAISED or NOT_FINITE; 0: none
    checked: float  # 1 while a baseline waits: a tick that is not finite fails as one that raises
    contradicted_at: float  # column of guard.contradicted in a row; negative: the law has no guard


class Flight(NamedTuple):
    """The arrays that bursts and Python share; what each is, `Autopilot` says."""

    course: Buffer  # Course
    desk: Desk
    received: Buffer  # VehicleState, as it was parsed
    measured: Buffer  # VehicleState, as it is flown on
    filtered: Buffer  # vehicle.position_filter.Filtered, of which `measured` is a part
    watch: Buffer  # vehicle.conditions.Watch
    settings: Buffer
    setpoint: Buffer
    remembered: Buffer
    model: Buffer  # Reference, a part of `remembered`; NaN for a law without a reference model
    battery: Buffer  # Battery
    has_battery: Integers  # [1]
    told: Integers  # [3], of a datagram
    answer: Bytes  # the last one
    computed: (
        Integers  # [n], of the law's Tick: 1 for what has to be finite (`finite`), if it is checked
    )
    thrusts: Buffer  # [8], of the last tick that was checked, N; NaN before
    baseline: Buffer  # [n], Tick of the law that has taken over from one that failed; [0]: none has
    failed: Integers  # [1]: 1 while the last state has failed: Python passes on the next


def flight(
    codec: PlantCodec, settings: Buffer, h: float, remembered: int, filtered: Buffer, watch: Buffer,
    model: slice | None = None, columns: int = 0,
) -> Flight:  # fmt: skip
    """What flies by `settings`, on the ground and disarmed, before its first tick.

    h : control period, s.  remembered : size of the law's Remembered.  filtered : float64[n] of a
    PositionFilter.  watch : float64[size(Watch)], see `look`.  model : where the law remembers
    its Reference, if it has one.  columns : of the law's Tick.
    """
    memory = np.zeros(remembered)
    course = Course(
        system=codec.system, period_us=round(h * 1e6), h=h,
        time_us=-1.5,  # no whole number follows it: a first time is never quiet
        armed=0.0, airborne=0.0,
        engaged=IDLE, since_us=0.0, load=0.0, answer_bytes=0.0, failure=0.0, checked=0.0,
        contradicted_at=-1.0,
    )  # fmt: skip
    return Flight(
        course=to_buffer(course),
        desk=codec.desk,
        received=np.zeros(size(VehicleState)),
        measured=filtered[slice_of(Filtered, "flown")],
        filtered=filtered,
        watch=watch,
        settings=settings,
        setpoint=np.zeros(size(Setpoint)),
        remembered=memory,
        model=NO_MODEL.copy() if model is None else memory[model],
        battery=codec.battery_buffer,
        has_battery=codec.has_battery,
        told=np.zeros(3, dtype=np.int64),
        answer=np.zeros(LONGEST, dtype=np.uint8),
        computed=np.zeros(columns, dtype=np.int64),
        thrusts=np.full(8, np.nan),
        baseline=np.zeros(0),
        failed=np.zeros(1, dtype=np.int64),
    )


unpack_course = unpacker(Course)
_put_time = packer(Course, "time_us")
_put_engaged = packer(Course, "engaged")
_put_load = packer(Course, "load")
_put_failure = packer(Course, "failure")
_put_answer_bytes = packer(Course, "answer_bytes")


@kernel
def tick(flight, law, datagram, length, row, decided_us):
    """One whole tick, if it is a quiet one: the length of its answer, which is in `flight`.

    law : address of `fcu.process.tick.compiled()` of the law that is flown.  datagram : uint8[n], of which `length` bytes
    were received.  row : float64[size(Tick) or more].
    NOT_QUIET: nothing was done.  NOT_QUIET_FILTERED: the state was read and let through, and a
    look has found a condition, on which Python acts.  LAW_RAISED: there is no answer. `what_was_raised` says what.
    decided_us : the time of a tick for which Python has done all that,
    and for which `measured` is flown on as it is. Negative: there is none.
    """
    course, told = unpack_course(flight.course), flight.told
    time_us = np.int64(decided_us)
    if decided_us < 0:
        number = np.int64(course.system)
        fault = parse_state(
            flight.desk, number, datagram, length, flight.received, flight.battery, told
        )
        if fault != 0 or told[1] != 0:
            return NOT_QUIET
        time_us = told[0]
        if time_us != course.time_us + course.period_us:
            return NOT_QUIET
        if flight.desk.quality[0] < 0 or flight.failed[0] != 0:
            return NOT_QUIET
        if course.airborne == 0.0:
            take(flight.filtered, flight.received)
        elif not quiet(flight.filtered, flight.received, course.h, np.float64(time_us)):
            return NOT_QUIET
        if told[2] != 0:
            flight.has_battery[0] = 1
        age = (time_us - course.since_us) * 1e-6
        remaining = flight.battery[_REMAINING] if flight.has_battery[0] != 0 else np.nan
        if look(
            flight.watch, flight.measured, flight.model, flight.setpoint, age, remaining,
            np.float64(time_us),
        ):  # fmt: skip
            return NOT_QUIET_FILTERED
    if decide(flight, law, course, time_us, row):
        return LAW_RAISED
    contradicted_at = np.int64(course.contradicted_at)
    if contradicted_at >= 0:
        contradicted = 0.0
        for i in range(contradicted_at, contradicted_at + _SIGNS):
            contradicted = max(contradicted, row[i])
        flight.watch[_CONTRADICTED] = 1.0 if contradicted > 0.5 else 0.0
    for i in range(len(flight.thrusts)):
        stands = math.isnan(row[_FIRST_COMMAND + i])  # it is sent 0: a law that fails, not a rotor
        flight.watch[_WANTED + i] = 0.0 if stands else row[_FIRST_THRUST + i]
    length = pack_controls(
        flight.desk, np.int64(course.system), time_us, row[_FIRST_COMMAND:_END_COMMAND],
        course.armed != 0.0, True, True, flight.answer,
    )  # fmt: skip
    _put_answer_bytes(flight.course, np.float64(length))
    return length


@kernel
def decide(flight, law, course, time_us, row):
    """The law's part of a tick, on what is `measured`; True if it has failed, and Course.failure says how.

    course : Course, of `flight`.  Other arguments as of `tick`.
    """
    replaced = len(flight.baseline) > 0
    told = flight.baseline if replaced else row
    raised = call_law(
        law,
        (
            time_us * 1e-6, course.engaged, (time_us - course.since_us) * 1e-6,
            address_of(flight.remembered), address_of(flight.settings),
            address_of(flight.setpoint), address_of(flight.measured), address_of(told),
        ),
    )  # fmt: skip
    _put_time(flight.course, np.float64(time_us))
    if raised:
        _put_failure(flight.course, RAISED_AN_ERROR)
        return True
    if replaced:
        as_own(row, told, len(flight.computed))
    elif course.checked != 0.0 and course.engaged != IDLE:
        if course.engaged == TAKE_OVER:
            note_computed(row, flight.computed)
        if not (is_finite(row, flight.computed) and pushes(row)):
            _put_failure(flight.course, NOT_FINITE)
            return True
        for i in range(len(flight.thrusts)):
            flight.thrusts[i] = row[_FIRST_THRUST + i]
    _put_engaged(flight.course, IDLE if course.engaged == IDLE else FLYING)
    return False


@kernel
def as_own(row, told, columns):
    """Write what every law tells of a tick to a row of another law, with NaN for what that alone tells.

    told : float64[n], a Tick of the law that is flown.  columns : of the other law's Tick.
    """
    for i in range(columns):
        row[i] = told[i] if i < _SHARED else np.nan


def what_was_raised(law: Pointer, flight: Flight, row: Buffer) -> str:
    """What a law has raised at the last tick, in words: it is called again, for the same row."""
    course = unpack_course(flight.course)
    arrays = flight.remembered, flight.settings, flight.setpoint, flight.measured, row
    try:
        law.function(
            course.time_us * 1e-6, course.engaged, (course.time_us - course.since_us) * 1e-6,
            *[array.ctypes.data for array in arrays],
        )  # fmt: skip
    except Exception as error:
        frames = extract_tb(error.__traceback__)[1:]
        at = "".join(f", {Path(frame.filename).name}:{frame.lineno}" for frame in frames[-1:])
        said = "".join(c if c.isprintable() else " " for c in f": {error}")[:SAID]
        return f"the law raised {type(error).__name__}{said if str(error) else ''}{at}"
    return "the law raised an error once, and not again"


# --- over the wire

# why a burst ended
READY, SILENT, UNREAD, FILTERED, BUSY, SLOW, DUE, FULL, DECIDED, RAISED = range(10)
_LEFT = UNREAD, FILTERED, RAISED


class Wire(NamedTuple):
    """What a burst over UDP has of its own."""

    link: Integers  # [1], the descriptor of the plant link
    others: Integers  # `system.polled`: what Python serves
    datagram: Bytes  # as received last
    due: Buffer  # [1], wall: when telemetry is due, s, monotonic
    scratch: Integers  # [2]


@kernel
def serve(flight, law, wire, rows, times, decided_us):
    """Fly quiet ticks until something else is due, at most one a row.

    rows : float64[n, width].  times : float64[n, 3], of each tick: when its answer was sent (wall,
    monotonic, s), how long that took since its state was read (s), and the load, smoothed.
    Returns how many were flown, why no more, and the length of a datagram that was received and
    has had no answer: UNREAD, FILTERED or RAISED, as `tick` said of it.
    decided_us : as for `tick`; then one tick is flown, and its answer is not sent.
    """
    fd, course = wire.link[0], unpack_course(flight.course)
    load = course.load
    done = system.monotonic(wire.scratch)
    for k in range(len(rows)):
        length = 0
        if decided_us < 0:
            if k > 0 and system.ready(wire.others, 0) != 0:  # one tick there is, whoever else calls
                return k, READY, 0
            length = system.receive(fd, wire.datagram, True)
            if length < 0:
                return k, SILENT, 0
        began = system.monotonic(wire.scratch)
        slow = began - done > SLOW_S
        said = tick(flight, law, wire.datagram, length, rows[k], decided_us)
        if said <= 0:
            return k, _LEFT[-said], length
        if decided_us >= 0:
            return 1, DECIDED, 0
        sent = system.send(fd, flight.answer, said)
        done = system.monotonic(wire.scratch)
        load += LOAD_SMOOTHED * ((done - began) / course.h - load)
        times[k, 0], times[k, 1], times[k, 2] = done, done - began, load
        _put_load(flight.course, load)
        if sent < 0:
            return k + 1, BUSY, 0
        if slow:
            return k + 1, SLOW, 0
        if done >= wire.due[0]:
            return k + 1, DUE, 0
    return len(rows), FULL, 0
