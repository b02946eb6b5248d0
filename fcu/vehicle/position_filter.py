"""Positions that cannot be: one that jumps is not flown on, and a state that is stuck is told.

Between two ticks a vehicle goes where its velocity takes it. A position farther than JUMP from
there is somebody's error (a spoofed receiver, a plant moved by hand): the law flies on the
velocity alone, from the last position that could be, until the two agree again. A drift as slow
as a wind is not told from one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fcu.interface.messages import VehicleState
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import norm
from fcu.kernel.buffers import packer, size, unpacker
from fcu.kernel.compile import kernel

Row = np.ndarray[Any, np.dtype[np.float64]]

JUMP = 1.0  # m in one tick, beside v h; no impact moves a vehicle so far
STUCK_US, LOOK_US = 1_000_000, 20_000  # simulation time

_unpack = unpacker(VehicleState)
_put_r_E = packer(VehicleState, "r_E")


@kernel
def admit(received, flown, h):
    """Bring `flown` (float64[21] VehicleState) to `received`, h seconds later.

    Returns by how much (m) the position is off v h; above JUMP, v h is what `flown` moves by.
    """
    before, now = _unpack(flown), _unpack(received)
    expected = before.r_E + h * before.v_E
    off = norm(now.r_E - expected)
    for i in range(received.size):
        flown[i] = received[i]
    if off > JUMP:
        _put_r_E(flown, expected)
    return off


class PositionFilter:
    """What the law is given of what the plant says. `flown`: the last state let through."""

    def __init__(self) -> None:
        self.flown = np.zeros(size(VehicleState))
        self.off = 0.0  # m: how far the position is off; 0: it is believed
        self._seen = b""
        self._moved_us = self._look_us = 0
        self._stuck = False

    def take(self, received: Row) -> None:
        """A state that nothing is checked against: the first, or one of a vehicle that rests."""
        self.flown[:] = received
        self.off = 0.0

    def pass_on(self, received: Row, h: float, t_us: int) -> Sequence[Told]:
        """The state of the next tick of a vehicle in flight: what is wrong with it."""
        off = admit(received, self.flown, h)
        if off <= JUMP and not self.off and t_us < self._look_us:
            return ()
        told: list[Told] = []
        if off > JUMP:
            if not self.off:
                told.append(Told(Code.POSITION_JUMPED, (off,)))
            self.off = off
        elif self.off:
            self.off = 0.0
            told.append(Told(Code.POSITION_BACK))
        if t_us >= self._look_us:
            self._look_us = t_us + LOOK_US
            self._look(received.tobytes(), t_us, told)
        return told

    def _look(self, seen: bytes, t_us: int, told: list[Told]) -> None:
        if seen != self._seen:
            self._seen, self._moved_us, self._stuck = seen, t_us, False
        elif t_us - self._moved_us >= STUCK_US and not self._stuck:
            self._stuck = True
            told.append(Told(Code.STATE_STUCK))
