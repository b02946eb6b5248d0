"""Ticks of a simulator and of a law in one process, without the datagrams between them.

The same ticks to the bit as `vehicle_loop.together`, for flights of which nobody reads the datagrams: what the
plant link rounds, and what it refuses, is worked out on the values (`plant_link.state_received`,
`controls_received`), and neither bytes nor checksums are made of them.
"""

from __future__ import annotations

from fcu.interface.messages import RotorCommand, VehicleState
from fcu.kernel.algebra import Rotors
from fcu.kernel.buffers import packer, unpacker
from fcu.kernel.compile import kernel
from fcu.laws.face import SharedTick
from fcu.mavlink.plant_link import controls_received, state_received
from fcu.process.burst import decide, unpack_course
from gcs_tools.flight.vehicle_loop import ENDED, LEFT, NOISE, RAISED, TICKS
from sitl_plant.burst import NO_NOISE, advance, observe
from sitl_plant.physics import dynamics

_unpack_state = unpacker(VehicleState)
_pack_state = packer(VehicleState)
_unpack_spin = unpacker(Rotors)
_unpack_command = unpacker(SharedTick, "command")
_pack_command = packer(RotorCommand)


@kernel
def receive(reported, spin, measured):
    """Write what a controller receives of a state to `measured`; the fault for which it would not, or 0.

    reported, measured : float64[size(VehicleState)].  spin : float64[8].
    """
    state, fault = state_received(_unpack_state(reported), _unpack_spin(spin))
    _pack_state(measured, state)
    return fault


@kernel
def answer(row, command):
    """Write what a simulator receives of the command of a tick to `command`, a RotorCommand.

    row : of the law's Tick.
    """
    _pack_command(command, controls_received(_unpack_command(row)))


@kernel
def closed(flight, law, plant, plant_rows, fcu_rows):
    """Fly ticks, one for each pair of rows at most: armed, with no position doubted.

    flight, law, plant, plant_rows, fcu_rows : as for `together`.
    Returns how many were flown, why no more (TICKS, NOISE, ENDED, LEFT or RAISED), and for ENDED the
    status of the flight, for LEFT the fault of the plant link.
    """
    n = min(len(plant_rows), len(fcu_rows))
    for k in range(n):
        now, _, status = observe(plant, plant_rows[k])
        if status == NO_NOISE:
            return k, NOISE, 0
        if status != dynamics.FLYING:
            return k, ENDED, status
        fault = receive(plant.reported, plant.spin, flight.measured)
        if fault != 0.0:
            return k, LEFT, int(fault)
        course = unpack_course(flight.course)
        if decide(flight, law, course, now * plant.period_us, fcu_rows[k]):
            return k, RAISED, 0
        answer(fcu_rows[k], plant.command)
        advance(plant, now)
    return n, TICKS, 0
