"""Positions that cannot be: one that jumps is not flown on, and a state that is stuck is told.

Between two ticks a vehicle goes where its velocity takes it. A position farther than JUMP from
there is somebody's error (a spoofed receiver, a plant moved by hand): the law flies on the
velocity alone, from the last position that could be, until the two agree again. A drift as slow
as a wind is not told from one. A state that its sender calls failed is not read: the law flies on
the last one, carried on by its own velocity and body rate, until one is valid again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.messages import VehicleState
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import norm, select
from fcu.kernel.buffers import packer, size, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import normalised, small_rotation
from fcu.kernel.rows import column_of, slice_of
from fcu.vehicle.conditions import LOOK_US, ROWS, Condition

Row = np.ndarray[Any, np.dtype[np.float64]]

LOST_US = ROWS[Condition.STATE_LOST].hold_us  # simulation time
JUMP = 1.0  # m in one tick, beside v h; no impact moves a vehicle so far
STUCK_US = ROWS[Condition.STATE_STUCK].hold_us  # simulation time


class Faults(NamedTuple):
    """What is wrong with the states of a plant, and since when. Times: simulation time, us."""

    off: float  # m: how far the position is off; 0: it is believed
    moved_us: float  # when a look last found another state than the look before
    look_us: float  # when the next look is due
    stuck: float  # 1: that was too long ago


class Filtered(NamedTuple):
    """What is remembered from tick to tick."""

    flown: VehicleState  # the last state let through
    seen: VehicleState  # the state at the last look
    faults: Faults


_unpack = unpacker(VehicleState)
_put_r_E = packer(Filtered, "flown.r_E")
_put_off = packer(Filtered, "faults.off")
_unpack_faults = unpacker(Filtered, "faults")
_pack_faults = packer(Filtered, "faults")
_FLOWN, _SEEN = slice_of(Filtered, "flown"), slice_of(Filtered, "seen")
_FLOWN_AT, _SEEN_AT = _FLOWN.start, _SEEN.start
_OFF, _STUCK = column_of(Filtered, "faults.off"), column_of(Filtered, "faults.stuck")
_unpack_flown, _put_flown = unpacker(Filtered, "flown"), packer(Filtered, "flown")


@kernel
def _expected(buffer, h):
    """Where the vehicle is h seconds after the last state let through, m."""
    before = _unpack_flown(buffer)
    return before.r_E + h * before.v_E


@kernel
def _differs(buffer, received):
    """Whether a state is not, to the bit, that of the last look."""
    new, old = received.view(np.int64), buffer.view(np.int64)
    differs = False
    for i in range(new.size):
        differs |= new[i] != old[_SEEN_AT + i]
    return differs


@kernel
def _faults(buffer, received, off, t_us):
    """The Faults after a state whose position is so far (m) off what was expected."""
    was = _unpack_faults(buffer)
    looks = t_us >= was.look_us
    moved = looks and _differs(buffer, received)
    late = looks and not moved and t_us - was.moved_us >= STUCK_US
    return Faults(
        off=select(off > JUMP, off, 0.0),
        moved_us=select(moved, t_us, was.moved_us),
        look_us=select(looks, t_us + LOOK_US, was.look_us),
        stuck=select(moved, 0.0, select(late, 1.0, was.stuck)),
    )


@kernel
def _remember(buffer, received, faults, t_us):
    """`buffer` at the next tick."""
    looks = t_us >= _unpack_faults(buffer).look_us
    for i in range(received.size):
        buffer[_FLOWN_AT + i] = received[i]
    if looks:
        for i in range(received.size):
            buffer[_SEEN_AT + i] = received[i]
    _pack_faults(buffer, faults)


@kernel
def admit(buffer, received, h, t_us):
    """Bring `buffer` (float64[size(Filtered)]) to the state `received`, h seconds later.

    t_us : simulation time, us, a float.
    """
    expected = _expected(buffer, h)
    off = norm(_unpack(received).r_E - expected)
    _remember(buffer, received, _faults(buffer, received, off, t_us), t_us)
    if off > JUMP:
        _put_r_E(buffer, expected)


@kernel
def quiet(buffer, received, h, t_us):
    """`admit`, if there is nothing to be told of it; else False, and `buffer` is as it was."""
    was = _unpack_faults(buffer)
    off = norm(_unpack(received).r_E - _expected(buffer, h))
    faults = _faults(buffer, received, off, t_us)
    if was.off != 0.0 or faults.off != 0.0 or faults.stuck > was.stuck:
        return False
    _remember(buffer, received, faults, t_us)
    return True


@kernel
def carry_on(buffer, h):
    """Bring `buffer` to the next tick without a state: h seconds on, at its velocity and body rate."""
    was = _unpack_flown(buffer)
    _put_flown(
        buffer,
        VehicleState(
            r_E=was.r_E + h * was.v_E,
            v_E=was.v_E,
            q_EB=normalised(was.q_EB * small_rotation(h * was.w_B)),
            w_B=was.w_B,
            Omega=was.Omega,
        ),
    )


@kernel
def take(buffer, received):
    """Bring `buffer` to a state that nothing is checked against, and believe it."""
    for i in range(received.size):
        buffer[_FLOWN_AT + i] = received[i]
    _put_off(buffer, 0.0)


class PositionFilter:
    """What the law is given of what the plant says. `flown`: the last state let through.

    `buffer`: float64[size(Filtered)], of which `flown` is a view.
    """

    def __init__(self) -> None:
        self.buffer = np.zeros(size(Filtered))
        self.buffer[_SEEN] = np.nan
        self.flown = self.buffer[_FLOWN]
        self._failed_us = -1  # since when the state has failed; negative: it has not
        self._is_lost = False  # that was told

    def warm_up(self) -> None:
        """Load what checks a state."""
        admit(self.buffer.copy(), self.flown.copy(), 1.0, 0.0)
        carry_on(self.buffer.copy(), 1.0)

    @property
    def off(self) -> float:
        """How far (m) the position is off; 0: it is believed."""
        return float(self.buffer[_OFF])

    def take(self, received: Row) -> None:
        """A state that nothing is checked against: the first, or one of a vehicle that rests."""
        self.flown[:] = received
        self.buffer[_OFF] = 0.0

    @property
    def has_failed(self) -> bool:
        """True while the state has failed: the next one is to be passed on by Python."""
        return self._failed_us >= 0

    def fail(self, h: float, t_us: int, armed: bool) -> Sequence[Told]:
        """Go on without the state of a tick, which has failed. Returns what is told of it.

        Of a vehicle that is not armed it is not told that its state is lost: it is once it is armed.
        """
        carry_on(self.buffer, h)
        if self._failed_us < 0:
            self._failed_us = t_us
            return (Told(Code.STATE_FAILED),)
        if self._is_lost or not armed or t_us - self._failed_us < LOST_US:
            return ()
        self._is_lost = True
        return (Told(Code.STATE_LOST, (LOST_US * 1e-6,)),)

    def mend(self, received: Row) -> Sequence[Told]:
        """Believe the first state after some that have failed. Returns what is told of it."""
        self.take(received)
        self._failed_us, self._is_lost = -1, False
        return (Told(Code.STATE_BACK),)

    def pass_on(self, received: Row, h: float, t_us: int) -> Sequence[Told]:
        """The state of the next tick of a vehicle in flight: what is wrong with it."""
        was_off, was_stuck = self.buffer[_OFF], self.buffer[_STUCK]
        admit(self.buffer, received, h, float(t_us))
        off, stuck = self.buffer[_OFF], self.buffer[_STUCK]
        if off == was_off and stuck == was_stuck:
            return ()
        told: list[Told] = []
        if off and not was_off:
            told.append(Told(Code.POSITION_JUMPED, (float(off),)))
        elif was_off and not off:
            told.append(Told(Code.POSITION_BACK))
        if stuck > was_stuck:
            told.append(Told(Code.STATE_STUCK))
        return told
