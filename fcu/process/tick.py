"""Once a law, `fcu.laws.seam` compiles this module: one control tick of law and guard."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from fcu.guard import present
from fcu.interface.messages import RotorCommand, Setpoint, VehicleState
from fcu.kernel.algebra import Rotors
from fcu.kernel.buffers import packer, size, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.lanes import buffer_at
from fcu.kernel.pointers import LAW_CALL, Pointer, array_at, lanes_call
from fcu.laws.face import FLYING as FLYING
from fcu.laws.face import IDLE as IDLE
from fcu.laws.face import TAKE_OVER as TAKE_OVER
from fcu.laws.face import Outputs
from fcu.laws.outputs import at_rest, no_reference
from fcu.laws.setpoint import carried

from .flown import guard, law
from .settings import Settings

State = law.State
Internals = law.Internals
GuardState = guard.GuardState
GuardInternals = guard.GuardInternals


class Remembered(NamedTuple):
    """What law and guard remember from tick to tick."""

    law: State
    guard: GuardState


class Tick(NamedTuple):
    """One control tick, as the flight controller records it."""

    t: float  # simulation time, s
    measured: VehicleState
    setpoint: Setpoint  # as asked for: extrapolated to this tick
    command: RotorCommand
    engaged: float  # 0 idle, 1 take-over at this tick, 2 flying the law
    outputs: Outputs
    state: State  # after the tick
    internals: Internals
    guard_state: GuardState  # after the tick
    guard: GuardInternals


@kernel
def engaged_tick(t, engaged, remembered, settings, setpoint, measured):
    """The Tick at which the law takes over, or goes on from what is `remembered`.

    t : simulation time, s.  engaged : TAKE_OVER or FLYING.
    """
    told = settings.law
    if engaged == TAKE_OVER:
        governed = guard.take_over(settings.guard, told, setpoint, measured)
        state, command, outputs, internals = law.take_over(told, governed.setpoint, measured)
    else:
        before = remembered.law
        governed = guard.before(remembered.guard, settings.guard, told, before, setpoint, measured)
        state, command, outputs, internals = law.step(before, told, governed.setpoint, measured)
    guard_state, guarded = guard.after(
        governed, settings.guard, told, state, outputs, internals, measured
    )
    return Tick(
        t=t,
        measured=measured,
        setpoint=setpoint,
        command=command,
        engaged=engaged,
        outputs=outputs,
        state=state,
        internals=internals,
        guard_state=guard_state,
        guard=guarded,
    )


_state, _internals = unpacker(State), unpacker(Internals)
_NO_STATE, _NO_INTERNALS = (0.0,) * size(State), (0.0,) * size(Internals)


@kernel
def rest(measured):
    """(state, outputs, internals) of a law that does not fly, and has no `idle` of its own: zeros."""
    reference = no_reference()
    outputs = at_rest(measured, reference, reference.r_m)
    return _state(_NO_STATE), outputs, _internals(_NO_INTERNALS)


_idle = getattr(law, "idle", rest)


@kernel
def idle_tick(t, setpoint, measured):
    """The Tick of a law that does not fly: it follows the measurement, and the rotors stand."""
    state, outputs, internals = _idle(measured)
    guard_state, guarded = guard.idle(measured)
    return Tick(
        t=t,
        measured=measured,
        setpoint=setpoint,
        command=RotorCommand(u=Rotors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
        engaged=IDLE,
        outputs=outputs,
        state=state,
        internals=internals,
        guard_state=guard_state,
        guard=guarded,
    )


unpack_settings = unpacker(Settings)
unpack_remembered = unpacker(Remembered)
_unpack_setpoint = unpacker(Setpoint)
_unpack_measured = unpacker(VehicleState)
_pack_tick = packer(Tick)
_pack_remembered = packer(Remembered)
_pack_beginning = packer(present.Beginning)


@kernel
def tick(t, engaged, remembered, settings, setpoint, age, measured, row):
    """One control tick on flat float64 buffers; writes `row`, a Tick, and `remembered`.

    t : simulation time, s.  engaged : IDLE, TAKE_OVER or FLYING.  age : s since the setpoint
    was received.  remembered : float64[size(Remembered)], of the last tick, then of this one.
    """
    seen = _unpack_measured(measured)
    asked = carried(_unpack_setpoint(setpoint), age)
    if engaged == IDLE:
        flown = idle_tick(t, asked, seen)
    else:
        before = unpack_remembered(remembered)
        flown = engaged_tick(t, engaged, before, unpack_settings(settings), asked, seen)
    _pack_tick(row, flown)
    _pack_remembered(remembered, Remembered(law=flown.state, guard=flown.guard_state))


@kernel
def beginning(settings, remembered, measured, row):
    """Write `row`, a Beginning, where a look ahead begins after a tick; all float64 buffers.

    settings : Settings.  remembered : Remembered after it.  measured : VehicleState that it saw.
    """
    past, law = unpack_remembered(remembered), unpack_settings(settings).law
    _pack_beginning(row, present.beginning(law, past.law, past.guard, _unpack_measured(measured)))


_REMEMBERED, _SETTINGS, _SETPOINT, _MEASURED, _TICK = (
    size(kind) for kind in (Remembered, Settings, Setpoint, VehicleState, Tick)
)


@kernel
def tick_at(t, engaged, age, remembered, settings, setpoint, measured, row):
    """`tick`, of the addresses of its buffers: what a burst calls (`kernel.pointers`)."""
    tick(
        t, engaged, array_at(remembered, _REMEMBERED), array_at(settings, _SETTINGS),
        array_at(setpoint, _SETPOINT), age, array_at(measured, _MEASURED), array_at(row, _TICK),
    )  # fmt: skip


@cache
def compiled() -> Pointer:
    """`tick_at`, compiled or loaded, for whoever flies bursts of this law."""
    return Pointer(tick_at, LAW_CALL)


@kernel
def lanes_at(t, engaged, age, remembered, settings, setpoint, measured, row):
    """`tick` of several vehicles under the same settings, a lane each (`kernel.lanes`).

    As `tick_at`, but all of a vehicle are buffers of lanes, and age is lanes.
    """
    tick(
        t, engaged, buffer_at(remembered, age), array_at(settings, _SETTINGS), buffer_at(setpoint, age),
        age, buffer_at(measured, age), buffer_at(row, age),
    )  # fmt: skip


@kernel
def lanes_each_at(t, engaged, age, remembered, settings, setpoint, measured, row):
    """The same, each under settings of its own: a buffer of lanes too."""
    tick(
        t, engaged, buffer_at(remembered, age), buffer_at(settings, age), buffer_at(setpoint, age),
        age, buffer_at(measured, age), buffer_at(row, age),
    )  # fmt: skip


@cache
def compiled_for_lanes(width: int, alike: bool) -> Pointer:
    """`lanes_at` or, of settings that are not alike, `lanes_each_at`, compiled or loaded.

    Raises NumbaError for a law that cannot be compiled for lanes.
    """
    return Pointer(lanes_at if alike else lanes_each_at, lanes_call(width))
