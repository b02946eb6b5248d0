"""Ticks of a simulator and of a flight controller in one process, one call for many of them.

Both halves of `sitl_plant.burst`, and between them `fcu.process.burst.tick`: the datagrams that two
processes would send each other are written and read, with their checksums, and go nowhere.
"""

from __future__ import annotations

import numpy as np

from fcu.kernel.compile import kernel
from fcu.process.burst import tick
from sitl_plant.burst import FLOWN, NO_NOISE, begin, finish
from sitl_plant.physics import dynamics

# why no more ticks were flown; the last five with a row of the plant that has no answer
TICKS, NOISE, DECIDED, ENDED, LEFT, FILTERED, RAISED, REFUSED = range(8)
BEGUN = (ENDED, LEFT, FILTERED, RAISED, REFUSED)
_LEFT = LEFT, FILTERED, RAISED


@kernel
def together(flight, law, plant, datagram, plant_rows, fcu_rows, decided_us):
    """Fly quiet ticks, one for each pair of rows at most.

    flight, law : as for `fcu.process.burst.tick`.  plant : `sitl_plant.burst.Plant`.
    datagram : uint8[LONGEST], for the state.  plant_rows : float64[n, WIDTH].
    fcu_rows : float64[n, size(Tick) or more].
    Returns how many were flown, why no more, and what that leaves: for ENDED the status of the
    flight. For LEFT, FILTERED and RAISED, as `tick` said of it, the bytes of the state. For REFUSED what
    `finish` said of the answer.
    decided_us : as for `tick`. Then one tick of the controller is flown, and none of the plant.
    """
    n = min(len(plant_rows), len(fcu_rows))
    for k in range(n):
        length, status = 0, np.int64(dynamics.FLYING)
        if decided_us < 0:
            length, status = begin(plant, plant_rows[k], datagram)
        if status == NO_NOISE:
            return k, NOISE, 0
        if status != dynamics.FLYING:
            return k, ENDED, status
        said = tick(flight, law, datagram, length, fcu_rows[k], decided_us)
        if said <= 0:
            return k, _LEFT[-said], length
        if decided_us >= 0:
            return 1, DECIDED, 0
        fault = finish(plant, flight.answer, said)
        if fault != FLOWN:
            return k, REFUSED, fault
    return n, TICKS, 0
