"""One control tick of the simulator: record the true state, report it, integrate to the next tick.

`report` works on values, for kernels. `observe`, `sense` and `advance` work on flat float64
buffers, for the edge of a process.
"""

from __future__ import annotations

from fcu.interface.messages import RotorCommand, VehicleState
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import packer, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import small_rotation
from sitl_plant.physics import battery, dynamics, rotors
from sitl_plant.physics.battery import BatteryState
from sitl_plant.physics.types import PlantParams, PlantRecord

NOISE = 12  # position, velocity, attitude (rotation vector), body rate: three each

unpack_params = unpacker(PlantParams)
unpack_state = unpacker(VehicleState)
_pack_state = packer(VehicleState)
pack_record = packer(PlantRecord)
_unpack_command = unpacker(RotorCommand)
_unpack_drawn = unpacker(BatteryState)
_pack_drawn = packer(BatteryState)


@kernel
def report(state, noise):
    """A VehicleState as it is reported: with noise float64[12] added.

    Units of the noise: m and m/s along Earth axes, rad and rad/s about body axes.
    """
    return VehicleState(
        r_E=state.r_E + Vec3(noise[0], noise[1], noise[2]),
        v_E=state.v_E + Vec3(noise[3], noise[4], noise[5]),
        q_EB=state.q_EB * small_rotation(Vec3(noise[6], noise[7], noise[8])),
        w_B=state.w_B + Vec3(noise[9], noise[10], noise[11]),
        Omega=state.Omega,
    )


@kernel
def observe(params_buffer, state_buffer, drawn_buffer, t, start_buffer, row):
    """Write the true state at time t (s) to `row`, a PlantRecord; returns the flight status.

    drawn_buffer : BatteryState.  start_buffer : the state at the start of the flight, the centre
    of the arena.
    """
    start = unpack_state(start_buffer)
    params, state = unpack_params(params_buffer), unpack_state(state_buffer)
    record = dynamics.record(params, state, _unpack_drawn(drawn_buffer), t, start.r_E)
    pack_record(row, record)
    return record.ended


@kernel
def ended(params_buffer, state_buffer, start_buffer):
    """What `observe` returns, without a row."""
    start = unpack_state(start_buffer)
    return dynamics.ended(unpack_params(params_buffer), unpack_state(state_buffer), start.r_E)


@kernel
def sense(state_buffer, noise, reported):
    """Write a state buffer with noise to `reported`, a VehicleState."""
    _pack_state(reported, report(unpack_state(state_buffer), noise))


@kernel
def advance(params_buffer, state_buffer, drawn_buffer, command_buffer, t, steps):
    """Integrate the state buffers in place over one control period from time t (s).

    drawn_buffer : BatteryState.  command_buffer : RotorCommand.
    steps : integration steps per period.
    """
    params, state = unpack_params(params_buffer), unpack_state(state_buffer)
    command = RotorCommand(_unpack_command(command_buffer).u)
    drawn, left = _unpack_drawn(drawn_buffer), rotors.effectiveness(params, t)
    now = battery.report(params.battery, params.airframe, state.Omega, left, drawn)
    _pack_drawn(drawn_buffer, battery.drained(drawn, now, steps * params.h))
    for j in range(steps):
        state = dynamics.integrate(params, state, command, t + j * params.h)
    _pack_state(state_buffer, state)
