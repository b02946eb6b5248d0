"""Once a law, `fcu.laws.seam` compiles this module: a loop around one step, which benchmarks time."""

from __future__ import annotations

from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.buffers import packer, unpacker
from fcu.kernel.compile import kernel

from .tick import FLYING, Remembered, Tick, engaged_tick, unpack_remembered, unpack_settings

_unpack_setpoint = unpacker(Setpoint)
_unpack_measured = unpacker(VehicleState)
_pack_outputs = packer(Tick, "outputs")
_pack_internals = packer(Tick, "internals")
_pack_guard = packer(Tick, "guard")


@kernel
def law_steps(settings_buffer, remembered_buffer, setpoint_buffer, measured_rows, rows):
    """A tick of law and guard for each row of `measured_rows`; returns a sum over the commands.

    Measurements differ and what is computed is kept in `rows`, of Tick, or the compiler would take
    work out of the loop.
    """
    settings, remembered = unpack_settings(settings_buffer), unpack_remembered(remembered_buffer)
    setpoint = _unpack_setpoint(setpoint_buffer)
    seen = 0.0
    for i in range(len(measured_rows)):
        measured = _unpack_measured(measured_rows[i])
        flown = engaged_tick(0.0, FLYING, remembered, settings, setpoint, measured)
        remembered = Remembered(law=flown.state, guard=flown.guard_state)
        _pack_outputs(rows[i], flown.outputs)
        _pack_internals(rows[i], flown.internals)
        _pack_guard(rows[i], flown.guard)
        seen += flown.command.u.r1
    return seen
