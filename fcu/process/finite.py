"""Is all finite that a law computes in a tick? Kernels that find it, and the names of what is not."""

from __future__ import annotations

import numpy as np

from fcu.kernel.buffers import columns
from fcu.kernel.compile import kernel
from fcu.kernel.rows import column_of, slice_of
from fcu.laws.face import SharedTick

_COMMAND = slice_of(SharedTick, "command")
_FIRST_COMMAND, _END_COMMAND = _COMMAND.start, _COMMAND.stop
# what every law has to compute: all but its reference model, which it may not have
_FIRST_TOLD, _END_TOLD = (
    column_of(SharedTick, "outputs.T_c"),
    column_of(SharedTick, "outputs.saturation.yaw") + 1,
)
_THRUSTS = slice_of(SharedTick, "outputs.thrusts")
_FIRST_THRUST, _END_THRUST = _THRUSTS.start, _THRUSTS.stop
SLIGHT = 1e-6  # N, of thrusts below 0: rounding
_EXPONENT = 0x7FF0000000000000  # the bits that an infinity, or what is not a number, has all set


@kernel
def note_computed(row, computed):
    """Note in `computed` what a law computes as it takes over: the columns that are numbers then.

    row : float64[n], a Tick.  computed : int64[n], 1 for a column that has to stay finite.
    Command and outputs have to be numbers from the first tick on, but for the reference model.
    """
    bits = row.view(np.int64)
    for i in range(_FIRST_COMMAND, len(computed)):
        must = i < _END_COMMAND or _FIRST_TOLD <= i < _END_TOLD
        computed[i] = 1 if must or (bits[i] & _EXPONENT) != _EXPONENT else 0


@kernel
def is_finite(row, computed):
    """True if all is finite that a law computes in a Tick. Arguments as for `note_computed`."""
    bits, strange = row.view(np.int64), 0
    for i in range(_FIRST_COMMAND, len(computed)):
        strange |= computed[i] & ((bits[i] & _EXPONENT) == _EXPONENT)
    return strange == 0


@kernel
def pushes(row):
    """True if no thrust that a law tells of a rotor in a Tick is below 0: `speed_command` would hide one.

    row : float64[n], a Tick.
    """
    lowest = 0.0
    for i in range(_FIRST_THRUST, _END_THRUST):
        lowest = min(lowest, row[i])
    return lowest >= -SLIGHT


def not_finite(tick, row, computed):
    """Names of what a law computes that is not finite in a row, as recordings name it.

    tick : the class of the law's Tick.  Others as for `note_computed`.
    """
    bad = ~np.isfinite(row[: len(computed)]) & (computed != 0)
    names = columns(tick)
    return tuple(names[i] for i in np.flatnonzero(bad))
