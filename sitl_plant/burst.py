"""Ticks of the simulator in compiled code, from the state sent to the answer received.

`begin` and `finish` are the two halves of a tick. They make no system calls, so that a simulator
and a controller can also be joined in memory; `observe` and `advance` are what they do beside writing
and reading datagrams. `serve` runs whole ticks over a socket, and returns
to Python as soon as something else than the expected answer happens.

Everything a tick reads and writes is in the arrays of `Plant`, shared with Python.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.diagnostics import PlantTiming, plant_row
from fcu.interface.faults import Fault
from fcu.interface.messages import Battery, RotorCommand, VehicleState
from fcu.kernel import system
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import packer, size, to_buffer, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.rows import column_of
from fcu.mavlink.plant_link import LONGEST, Desk, desk, pack_state, parse_controls
from sitl_plant.physics import dynamics, faults, tick
from sitl_plant.physics.battery import BatteryState
from sitl_plant.physics.faults import Struck, struck
from sitl_plant.physics.types import PlantRecord
from sitl_plant.physics.wind import air
from sitl_plant.physics.wind.air import Air
from sitl_plant.physics.wind.layers import Layers, layered
from sitl_plant.physics.world import World

Buffer = np.ndarray[Any, np.dtype[np.float64]]
Bytes = np.ndarray[Any, np.dtype[np.uint8]]
Integers = np.ndarray[Any, np.dtype[np.int64]]

PlantRow = plant_row(PlantRecord)
WIDTH = size(PlantRow)  # float64 in a row

BATTERY_HZ = 10.0  # of simulation time
NOISE_BLOCK = 4096  # rows drawn at once
QUICK_S = 0.0005  # wall-clock time: a controller slower than this is waited for in Python

# Of `begin`: dynamics.FLYING, DIVERGED or CRASHED, or
NO_NOISE = -1  # the noise has been used up: draw more, and call again

# Of `finish`: a fault of the plant link (positive), or
FLOWN, STALE = 0, -1

# Why `serve` returned, before a tick:
TICKS, FULL, GRANTED, NOISE, OTHERS, SLOW, ENDED = 0, 1, 2, 3, 4, 5, 6
# or with a state prepared that has not been answered:
BEGUN, NOT_SENT, SILENT, UNEXPECTED = WAITING = 7, 8, 9, 10


class Progress(NamedTuple):
    """The scalars of a flight, each a float64."""

    timing: PlantTiming  # of the tick that comes next
    noise_at: float  # the row of the noise that comes next
    granted: float  # ticks that may be flown in all


class Plant(NamedTuple):
    """One simulator: constants, and the arrays that its ticks work on."""

    params: Buffer  # PlantParams, into which `air` is put
    air: Air  # of which each tick's is put into `params`
    start: Buffer  # VehicleState
    spin: Buffer  # float64[8], of the rotors
    system: int  # MAVLink's
    period_us: int
    steps: int  # integration steps per tick
    battery_ticks: int  # ticks from one battery report to the next
    state: Buffer  # VehicleState
    drawn: Buffer  # BatteryState
    past: Buffer  # float64[delay + 1, n], VehicleState: a ring of the last states
    noise: Buffer  # float64[NOISE_BLOCK, tick.NOISE]
    progress: Buffer  # Progress
    reported: Buffer  # VehicleState
    battery: Buffer  # Battery, the last report
    command: Buffer  # RotorCommand, of the last answer that could be read
    told: Integers  # int64[3], what else that answer said
    desk: Desk
    struck: Struck  # by faults to order


class Wire(NamedTuple):
    """What `serve` sends to, listens to and keeps an eye on."""

    link: int  # descriptor: the flight controller
    feed: int  # descriptor: the publisher; -1 without one
    others: Integers  # descriptors that Python reads: see system.polled
    outbox: Bytes  # the last state sent
    inbox: Bytes  # the last answer received
    clock: Integers  # int64[2]


class Burst(NamedTuple):
    """What `serve` did."""

    why: int  # it returned
    rows: int  # written; the last may be of a tick that is not finished
    status: int  # of the flight, at the last of them
    length: int  # of the last state, in bytes
    received: int  # bytes of the answer that was not as expected
    asked: float  # wall-clock time at which the last state was sent, s
    unpublished: int  # rows that did not go out to the publisher
    unsent: bool  # the last row is one of them


SEQUENCE, PUBLISHED, NOISE_AT, GRANT = (
    column_of(Progress, name)
    for name in ("timing.sequence", "timing.published", "noise_at", "granted")
)

_progress = unpacker(Progress)
_pack_tick = packer(Progress, "timing.sequence")
_pack_published = packer(Progress, "timing.published")
_pack_unpublished = packer(Progress, "timing.unpublished")
_pack_noise_at = packer(Progress, "noise_at")
_pack_timing = packer(PlantRow, "timing")
_battery_of = unpacker(PlantRow, "battery")
_pack_battery = packer(Battery)


def air_by_tick(steady: Vec3, samples: Buffer | None, rate_hz: float) -> Buffer:
    """float64[n, 3], m/s, E: a steady wind and samples of one at each tick, until the samples end.

    samples : float64[m, 4], s and m/s, E, with straight lines between them. None: float64[0, 3].
    """
    if samples is None:
        return np.zeros((0, 3))
    t = np.arange(math.ceil(samples[-1, 0] * rate_hz - 1e-6) + 1) / rate_hz
    return np.stack(
        [s + np.interp(t, samples[:, 0], v) for s, v in zip(steady, samples.T[1:], strict=True)],
        axis=1,
    )


def air_of(world: World, wind: Buffer | None, layers: Layers | None) -> Air:
    """The air of a vehicle at the start of its flight.  wind, layers : as for `plant`.

    Raises FieldError.
    """
    if layers is None:
        samples = air_by_tick(world.params.wind.steady, wind, world.rate_hz)
        return air.still_air()._replace(samples=samples)
    samples = air_by_tick(Vec3(0.0, 0.0, 0.0), wind, world.rate_hz)
    return layered(layers, world.params)._replace(samples=samples)


def plant(
    world: World, system_id: int, shared: Desk | None = None, wind: Buffer | None = None,
    ordered: Sequence[Fault] = (), layers: Layers | None = None,
) -> Plant:  # fmt: skip
    """A simulator at the start of its flight, without noise: see `draw_noise`.

    `shared`: the desk of a codec whose sequence numbers it is to continue.
    `wind`: float64[m, 4], samples of wind as for `air_by_tick`, added to that of the world.
    `ordered`: faults, at most `MOST` of `fcu.interface.faults`.
    `layers`: of the wind, beside the sines of the world and the samples.
    Raises FieldError if the field of the layers cannot be opened.
    """
    start = to_buffer(world.start)
    progress = np.zeros(size(Progress))
    progress[NOISE_AT], progress[GRANT] = NOISE_BLOCK, np.inf
    params = to_buffer(world.params)
    return Plant(
        params=params,
        air=air_of(world, wind, layers),
        start=start,
        spin=np.array(world.params.airframe.spin, dtype=np.float64),
        system=system_id,
        period_us=round(1e6 / world.rate_hz),
        steps=world.steps,
        battery_ticks=max(1, round(world.rate_hz / BATTERY_HZ)),
        state=start.copy(),
        drawn=np.zeros(size(BatteryState)),
        past=np.zeros((int(world.delay_ticks) + 1, size(VehicleState))),
        noise=np.zeros((NOISE_BLOCK, tick.NOISE)),
        progress=progress,
        reported=np.zeros(size(VehicleState)),
        battery=np.zeros(size(Battery)),
        command=np.zeros(size(RotorCommand)),
        told=np.zeros(3, dtype=np.int64),
        desk=desk(world.params.airframe.n) if shared is None else shared,
        struck=struck(params, ordered, NOISE_BLOCK),
    )


def wire(link: int, feed: int, others: tuple[int, ...]) -> Wire:
    """The descriptors, and buffers of their own."""
    return Wire(
        link=link,
        feed=feed,
        others=system.polled(*others),
        outbox=np.zeros(LONGEST, dtype=np.uint8),
        inbox=np.zeros(LONGEST, dtype=np.uint8),
        clock=np.zeros(2, dtype=np.int64),
    )


def draw_noise(plant: Plant, random: np.random.Generator, scale: Buffer) -> None:
    """Draw the next block of noise.  scale : float64[tick.NOISE], standard deviations."""
    if scale.any():
        plant.noise[:] = random.standard_normal(plant.noise.shape) * scale
    plant.progress[NOISE_AT] = 0.0


@kernel
def begin(plant, row, datagram):
    """The first half of a tick: the row of the true state, and the state as it is sent.

    row : float64[WIDTH].  datagram : uint8[LONGEST].
    Returns (length of the datagram, status of the flight); without a datagram length 0.
    """
    now, with_battery, status = observe(plant, row)
    if status != dynamics.FLYING:
        return 0, status
    length = pack_state(
        plant.desk, plant.system, now * plant.period_us, plant.reported, plant.spin,
        plant.battery, with_battery, datagram,
    )  # fmt: skip
    return length, status


@kernel
def observe(plant, row):
    """The row of the true state, and what of it is `reported`.

    row : float64[WIDTH].
    Returns (number of the tick, whether it reports the battery, status of the flight); without
    the status FLYING nothing is reported.
    """
    progress = _progress(plant.progress)
    if progress.noise_at >= plant.noise.shape[0]:
        return 0, False, NO_NOISE
    now = np.int64(progress.timing.sequence)
    t = now * plant.period_us * 1e-6
    air.blow(plant.air, plant.params, plant.state, now, plant.period_us * 1e-6)
    is_struck, now_us = plant.struck.used[0] > 0, float(now * plant.period_us)
    if is_struck:
        faults.weaken(plant.struck, plant.params, now_us)
    ended = tick.observe(plant.params, plant.state, plant.drawn, t, plant.start, row)
    _pack_timing(row, progress.timing)
    with_battery = now % plant.battery_ticks == 0
    if with_battery:
        _pack_battery(plant.battery, _battery_of(row))
        if is_struck:
            faults.report_battery(plant.struck, plant.battery, now_us)
    if ended != dynamics.FLYING:
        return now, with_battery, np.int64(ended)
    past = plant.past
    newest, oldest = now % past.shape[0], max(now - past.shape[0] + 1, 0) % past.shape[0]
    for i in range(past.shape[1]):
        past[newest, i] = plant.state[i]
    at = np.int64(progress.noise_at)
    tick.sense(past[oldest], plant.noise[at], plant.reported)
    if is_struck:
        failed = faults.report_state(plant.struck, plant.reported, now, plant.period_us, at)
        plant.desk.quality[0] = -1 if failed else 0
    _pack_noise_at(plant.progress, at + 1.0)
    return now, with_battery, np.int64(dynamics.FLYING)


@kernel
def finish(plant, datagram, length):
    """The second half of a tick: the answer of `length` bytes, and the flight to the next tick.

    FLOWN; or, with nothing flown, STALE (an answer to another tick) or a fault of the plant link.
    """
    command, told = plant.command, plant.told
    fault = parse_controls(plant.desk, plant.system, datagram, length, command, told)
    if fault != 0:
        return fault
    now = np.int64(_progress(plant.progress).timing.sequence)
    if told[0] != now * plant.period_us:
        return STALE
    advance(plant, now)
    return FLOWN


@kernel
def advance(plant, now):
    """The flight under its `command`, from the tick numbered `now` to the next."""
    t = now * plant.period_us * 1e-6
    is_struck, now_us = plant.struck.used[0] > 0, float(now * plant.period_us)
    if is_struck:
        faults.obey(plant.struck, plant.command, now_us)
    tick.advance(plant.params, plant.state, plant.drawn, plant.command, t, plant.steps)
    if is_struck:
        faults.drain(plant.struck, plant.drawn, now_us, plant.period_us * 1e-6)
    _pack_tick(plant.progress, now + 1.0)


@kernel
def serve(plant, wire, rows, ticks):
    """Fly `ticks` ticks, or fewer.  rows : float64[n, WIDTH].  Returns a Burst.

    Waits for an answer as long as the time-out of the link's socket. Rows for which the publisher
    has no room are counted, as it is so often while one stalls: why they did not go out, Python asks.
    """
    why, used, status, length, received, asked = TICKS, 0, 0, 0, 0, 0.0
    unpublished, unsent = 0, False
    for _ in range(ticks):
        progress = _progress(plant.progress)
        if used == rows.shape[0]:
            why = FULL
            break
        if progress.timing.sequence >= progress.granted:
            why = GRANTED
            break
        if wire.others.size != 0 and system.ready(wire.others, 0) != 0:
            why = OTHERS
            break
        _pack_published(plant.progress, system.since_1970(wire.clock))
        row = rows[used]
        length, status = begin(plant, row, wire.outbox)
        if status == NO_NOISE:
            why = NOISE
            break
        used += 1
        unsent = wire.feed >= 0 and system.send_row(wire.feed, row) < 0
        if unsent:
            unpublished += 1
            _pack_unpublished(plant.progress, progress.timing.unpublished + 1.0)
        if status != dynamics.FLYING:
            why = ENDED
            break
        asked = system.monotonic(wire.clock)
        if system.send(wire.link, wire.outbox, length) < 0:
            why = NOT_SENT
            break
        received = system.receive(wire.link, wire.inbox, True)
        if received < 0:
            why = SILENT
            break
        took = system.monotonic(wire.clock) - asked
        if finish(plant, wire.inbox, received) != FLOWN:
            why = UNEXPECTED
            break
        if took > QUICK_S:
            why = SLOW
            break
    return Burst(why, used, status, length, received, asked, unpublished, unsent)
