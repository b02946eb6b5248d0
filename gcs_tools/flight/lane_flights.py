"""Flights of laws alone, several at a time on one core: a vehicle a lane (`fcu.kernel.lanes`).

`burst` is `closed_loop.closed` for lanes: the same kernels, in the same order, and so the same bits.
What belongs to one vehicle alone (when its setpoints take effect, how late it is told its state, its
noise, its end) is kept for each lane. A lane whose flight is over is computed on: nothing of it is kept,
but where a law branches it has a say.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.messages import RotorCommand, Setpoint, VehicleState
from fcu.kernel.algebra import select
from fcu.kernel.buffers import columns, size, to_buffer
from fcu.kernel.compile import kernel
from fcu.kernel.lanes import Zeros, any_lane, buffer_at, spread
from fcu.kernel.pointers import Pointer, address_of, call_law
from fcu.kernel.rows import slice_of
from fcu.laws.face import FLYING, TAKE_OVER
from gcs_tools.flight.closed_loop import answer, receive
from gcs_tools.flight.scenario import Scenario
from sitl_plant.burst import air_of
from sitl_plant.physics import dynamics, tick
from sitl_plant.physics.battery import BatteryState
from sitl_plant.physics.types import PlantRecord
from sitl_plant.physics.wind import air
from sitl_plant.physics.wind.air import Air

Buffer = np.ndarray[Any, np.dtype[np.float64]]
Integers = np.ndarray[Any, np.dtype[np.int64]]

NOISE_BLOCK = 512  # ticks, of which noise is drawn at once: what a core keeps near
_STATE = size(VehicleState)

NEVER = 2**62  # ticks
# how a lane has ended: its time is over, or the status of dynamics, or its controller would read no state
FLIES, OVER, REFUSED = -1, 0, 9


class Keep(NamedTuple):
    """What is kept of the rows of a flight: less takes less time, and less memory."""

    plant: Sequence[str] | None = None  # fields of PlantRecord, dotted, in this order; None: all
    law: Sequence[str] | None = None  # fields of the law's Tick
    every: int = 1  # the first of so many ticks

    @staticmethod
    def columns(kind: Any, names: Sequence[str] | None) -> Integers:
        """The columns of `names` in a row of `kind`. Raises AttributeError for a field it does not have."""
        every = np.arange(size(kind))
        return (
            every
            if names is None
            else np.r_[(every[:0], *[every[slice_of(kind, n)] for n in names])]
        )

    @classmethod
    def names(cls, kind: Any, names: Sequence[str] | None) -> tuple[str, ...]:
        """The dotted names of the same."""
        every = columns(kind)
        return tuple(every[i] for i in cls.columns(kind, names))


EVERYTHING = Keep()


class Lanes(NamedTuple):
    """So many vehicles: what each of them is, and how far it has come. The last axis is the lane."""

    settings: Buffer  # of the law: float64[n, width], or float64[n] of all
    setpoint: Buffer  # Setpoint in force
    remembered: Buffer
    measured: Buffer  # VehicleState
    row: Buffer  # of the law's Tick
    params: Buffer  # PlantParams
    start: Buffer  # VehicleState
    spin: Buffer  # Rotors
    state: Buffer  # VehicleState
    drawn: Buffer  # BatteryState
    past: Buffer  # float64[longest delay + 1, size(VehicleState), width]: a ring of the last states
    noise: Buffer  # float64[tick.NOISE, width], of this tick
    reported: Buffer  # VehicleState
    command: Buffer  # RotorCommand
    record: Buffer  # PlantRecord
    ends: Buffer  # float64[1, width]: dynamics.FLYING, or how the flight ends
    ages: Buffer  # float64[1, width], s since the setpoint took effect
    air: Air  # with the lane as first axis, but of the field, which all share


class Own(NamedTuple):
    """What each lane has of its own, by lane first; and what is kept of its rows."""

    blocks: Buffer  # float64[width, NOISE_BLOCK, tick.NOISE]
    sent_at: Integers  # int64[width, m], tick of each setpoint; after the last, never
    setpoints: Buffer  # float64[width, m, size(Setpoint)]
    ticks: Integers  # int64[width], how long the flight is
    delay: Integers  # int64[width], ticks
    sent: Integers  # int64[width], the setpoint that comes next
    since: Integers  # int64[width], us: when that in force took effect
    how: Integers  # int64[width]: FLIES, or how it ended
    flown: Integers  # int64[width], ticks of the law
    plant_columns: Integers
    law_columns: Integers
    plant_rows: Buffer  # float64[width, rows, columns]
    law_rows: Buffer


@kernel
def at(array, like):
    """The Buffer of an array whose last axis is the lane."""
    return buffer_at(address_of(array), like)


@kernel
def put(row, like, columns, how, rows, k):
    """Copy columns of a row of lanes to row k of `rows` of each lane that flies.

    row : float64[n, width].  columns : int64[m], most often one behind the other.  rows : float64[width, n, m].
    """
    n, width, i = len(columns), len(how), 0
    if n == 0:
        return
    if columns[n - 1] - columns[0] == n - 1:
        flies = 0
        for lane in range(width):
            flies |= (how[lane] == FLIES) << lane
        to, stride = address_of(rows[0, k]), 8 * rows.shape[1] * n
        while i + width <= n:
            spread(at(row, like), columns[0] + i, to + 8 * i, stride, flies)
            i += width
    for lane in range(width):
        if how[lane] == FLIES:
            for j in range(i, n):
                rows[lane, k, j] = row[columns[j], lane]


@kernel
def begin_tick(lanes, own, k, period_us):
    """Put into force the setpoints that are due at tick k, and end the lanes whose time is over.

    Returns how many lanes fly, and the tick at which something of this happens next.
    """
    flying, next_at = 0, NEVER
    for lane in range(len(own.how)):
        while own.sent_at[lane, own.sent[lane]] <= k:
            for i in range(len(lanes.setpoint)):
                lanes.setpoint[i, lane] = own.setpoints[lane, own.sent[lane], i]
            own.since[lane] = own.sent_at[lane, own.sent[lane]] * period_us
            own.sent[lane] += 1
        next_at = min(next_at, own.sent_at[lane, own.sent[lane]])
        if own.how[lane] == FLIES and k >= own.ticks[lane]:
            own.how[lane], own.flown[lane] = OVER, k
        if own.how[lane] == FLIES:
            flying += 1
            next_at = min(next_at, own.ticks[lane])
    return flying, next_at


@kernel
def end(lanes, own, k):
    """Take out the lanes that `ends` says have ended at tick k; how many fly on."""
    flying = 0
    for lane in range(len(own.how)):
        if own.how[lane] == FLIES and lanes.ends[0, lane] != dynamics.FLYING:
            own.how[lane], own.flown[lane] = np.int64(lanes.ends[0, lane]), k
        flying += own.how[lane] == FLIES
    return flying


@kernel
def seen_late(lanes, own, k):
    """Write to `measured` the state that each lane is told at tick k, which may be an old one."""
    ring = len(lanes.past)
    for i in range(_STATE):
        for lane in range(len(own.how)):
            lanes.past[k % ring, i, lane] = lanes.state[i, lane]
            lanes.measured[i, lane] = lanes.past[max(k - own.delay[lane], 0) % ring, i, lane]


@partial(kernel, inlined=False)
def blow(lanes, k, dt):
    """Put the air of tick k into the parameters of each lane."""
    of = lanes.air
    for lane in range(lanes.params.shape[1]):
        each = Air(
            of.samples[lane], of.gusts[lane], of.constants[lane], of.memory[lane],
            of.normals[lane], of.hubs[lane], of.at_hubs[lane], of.field,
        )  # fmt: skip
        air.compose(each, lanes.params[:, lane], lanes.state[:, lane], k, dt)


@kernel
def burst(lanes, own, like, law, k, until, every, period_us, steps, noisy, windy):
    """Fly from tick k to tick `until`, or until all lanes have ended.

    like : Lanes of the width.  law : address of `fcu.process.tick.compiled_for_lanes`.  every : of so many ticks
    the rows of one are kept.  noisy : whether `own.blocks` holds the noise of these ticks.
    windy : whether the air changes from tick to tick.
    Returns whether no branch was found that not all lanes take.
    """
    params, start = at(lanes.params, like), at(lanes.start, like)
    state, drawn = at(lanes.state, like), at(lanes.drawn, like)
    record, spin = at(lanes.record, like), at(lanes.spin, like)
    noise, reported = at(lanes.noise, like), at(lanes.reported, like)
    measured, command = at(lanes.measured, like), at(lanes.command, like)
    row, ends, ages = at(lanes.row, like), at(lanes.ends, like), at(lanes.ages, like)
    ring, first = len(lanes.past), k
    flying, next_at = begin_tick(lanes, own, k, period_us)
    while k < until:
        if k >= next_at:
            flying, next_at = begin_tick(lanes, own, k, period_us)
        if flying == 0:
            return True
        kept, t = k % every == 0, k * period_us * 1e-6
        if windy:
            blow(lanes, k, period_us * 1e-6)
        if kept and len(own.plant_columns) > 0:
            ended = tick.observe(params, state, drawn, t, start, record)
            put(lanes.record, like, own.plant_columns, own.how, own.plant_rows, k // every)
        else:
            ended = tick.ended(params, state, start)
        if any_lane(ended != dynamics.FLYING):
            ends[0] = ended
            flying = end(lanes, own, k)
        for lane in range(len(own.how)):
            lanes.ages[0, lane] = (k * period_us - own.since[lane]) * 1e-6
        if noisy:
            for lane in range(len(own.how)):
                for i in range(tick.NOISE):
                    lanes.noise[i, lane] = own.blocks[lane, k - first, i]
        if ring > 1:
            seen_late(lanes, own, k)
            tick.sense(measured, noise, reported)
        else:
            tick.sense(state, noise, reported)
        fault = receive(reported, spin, measured)
        if any_lane(fault != 0.0):
            ends[0] = select(fault != 0.0, float(REFUSED), dynamics.FLYING)
            flying = end(lanes, own, k)
        raised = call_law(
            law,
            (
                t, TAKE_OVER if k == 0 else FLYING, ages[0], address_of(lanes.remembered),
                address_of(lanes.settings), address_of(lanes.setpoint), address_of(lanes.measured),
                address_of(lanes.row),
            ),
        )  # fmt: skip
        if raised:
            return False
        if kept:
            put(lanes.row, like, own.law_columns, own.how, own.law_rows, k // every)
        answer(row, command)
        tick.advance(params, state, drawn, command, t, steps)
        k += 1
    begin_tick(lanes, own, k, period_us)
    return True


# --- from Python


def _aligned(*shape: int) -> Buffer:
    """Zeros that begin where a vector of lanes does."""
    n = math.prod(shape)
    room = np.zeros(n + 8)
    skip = -room.ctypes.data // 8 % 8
    return room[skip : skip + n].reshape(shape)


def beside(airs: Sequence[Air]) -> Air:
    """The air of several vehicles in one field, with the vehicle as first axis. Samples that end go on."""
    n = max(len(each.samples) for each in airs)
    samples = [np.pad(each.samples, ((0, n - len(each.samples)), (0, 0)), mode="edge") for each in airs]  # fmt: skip
    gusts = max(len(each.gusts) for each in airs)
    blown = [np.pad(each.gusts, ((0, gusts - len(each.gusts)), (0, 0))) for each in airs]
    return Air(
        samples=np.array(samples),
        gusts=np.array(blown),
        constants=np.array([each.constants for each in airs]),
        memory=np.array([each.memory for each in airs]),
        normals=np.array([each.normals for each in airs]),
        hubs=np.array([each.hubs for each in airs]),
        at_hubs=np.array([each.at_hubs for each in airs]),
        field=airs[0].field,
    )


class Group:
    """Flights that lanes can share: of one law, rate and number of plant steps.

    Fewer flights than lanes are padded with copies of the first, of which nothing is kept.
    """

    def __init__(
        self, scenes: Sequence[Scenario], width: int, keep: Keep, law: Pointer, alike: bool
    ) -> None:
        """law : `fcu.process.tick.compiled_for_lanes`, of settings that are `alike` or not."""
        self._scenes, self._keep = scenes, keep
        padded = [*scenes, *[scenes[0]] * (width - len(scenes))]
        ticks = scenes[0].flown.ticks
        self._like = Zeros(width)
        self._period_us, self._steps = scenes[0].period_us, scenes[0].world.steps
        each = [to_buffer(scene.settings) for scene in padded]
        self._law = law
        self._random = [np.random.default_rng(int(scene.world.seed)) for scene in padded]
        self._scales = [scene.world.noise_scale for scene in padded]
        worlds = [scene.world for scene in padded]
        delay = np.array([int(world.delay_ticks) for world in worlds])
        start = [to_buffer(world.start) for world in worlds]

        airs = [air_of(scene.world, scene.wind, scene.layers) for scene in padded]
        self._windy = any(scene.wind is not None or scene.layers is not None for scene in padded)

        def lanes_of(rows: Sequence[Any]) -> Buffer:
            made = _aligned(len(rows[0]), width)
            made.T[:] = rows
            return made

        def room(n: int) -> Buffer:
            return _aligned(n, width)

        state = size(VehicleState)
        self._lanes = Lanes(
            settings=each[0] if alike else lanes_of(each),
            setpoint=room(size(Setpoint)),
            remembered=room(size(ticks.Remembered)),
            measured=room(state),
            row=room(size(ticks.Tick)),
            params=lanes_of([to_buffer(world.params) for world in worlds]),
            start=lanes_of(start),
            spin=lanes_of([world.params.airframe.spin for world in worlds]),
            state=lanes_of(start),
            drawn=room(size(BatteryState)),
            past=_aligned(int(delay.max()) + 1, state, width),
            noise=room(tick.NOISE),
            reported=room(state),
            command=room(size(RotorCommand)),
            record=room(size(PlantRecord)),
            ends=room(1),
            ages=room(1),
            air=beside(airs),
        )
        begins = max(len(scene.sent_at) for scene in padded) + 1
        sent_at = np.full((width, begins), NEVER)
        setpoints = np.zeros((width, begins, size(Setpoint)))
        for lane, scene in enumerate(padded):
            n = len(scene.sent_at)
            sent_at[lane, :n], setpoints[lane, :n] = scene.sent_at, scene.setpoints
        longest = max(scene.ticks for scene in scenes)
        rows = -(-longest // keep.every)
        columns = keep.columns(PlantRecord, keep.plant), keep.columns(ticks.Tick, keep.law)
        how = np.full(width, FLIES)
        how[len(scenes) :] = OVER
        self._own = Own(
            blocks=np.zeros((width, NOISE_BLOCK, tick.NOISE)),
            sent_at=sent_at,
            setpoints=setpoints,
            ticks=np.array([scene.ticks for scene in padded]),
            delay=delay,
            sent=np.zeros(width, dtype=np.int64),
            since=np.zeros(width, dtype=np.int64),
            how=how,
            flown=np.zeros(width, dtype=np.int64),
            plant_columns=columns[0],
            law_columns=columns[1],
            plant_rows=np.zeros((width, rows, len(columns[0]))),
            law_rows=np.zeros((width, rows, len(columns[1]))),
        )

    def fly(self) -> bool:
        """Fly all of them; whether they all took the branches that one took."""
        own, noisy, k = self._own, any(scale.any() for scale in self._scales), 0
        while (own.how == FLIES).any():
            if noisy:
                self._draw()
            if not burst(
                self._lanes, own, self._like, self._law.address, k, k + NOISE_BLOCK,
                self._keep.every, self._period_us, self._steps, noisy, self._windy,
            ):  # fmt: skip
                return False
            k += NOISE_BLOCK
        return True

    def flown(self, lane: int) -> tuple[Buffer, Buffer, int, int]:
        """What is kept of the rows of one flight, how many ticks its law flew, and how it ended.

        As the status of `dynamics`, or REFUSED.
        """
        own, every = self._own, self._keep.every
        n, how = int(own.flown[lane]), int(own.how[lane])
        seen = n + (how != OVER)  # at its end a vehicle that is lost is seen once more
        plant, law = own.plant_rows[lane, : -(-seen // every)], own.law_rows[lane, : -(-n // every)]
        return plant, law, n, how

    def _draw(self) -> None:
        """Noise for the next ticks of each lane."""
        blocks = self._own.blocks
        for lane, (random, scale) in enumerate(zip(self._random, self._scales, strict=True)):
            if scale.any() and self._own.how[lane] == FLIES:
                blocks[lane] = random.standard_normal(blocks[lane].shape) * scale
