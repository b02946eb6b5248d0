"""Loops around one step of the law and one of the plant, compiled: what `bench` times."""

from __future__ import annotations

from fcu.guard import margin
from fcu.interface.messages import RotorCommand, Setpoint, VehicleState
from fcu.kernel.buffers import packer, unpacker
from fcu.kernel.compile import kernel
from fcu.laws.mmrac import cascade
from fcu.laws.mmrac.types import Internals, LawState
from sitl_plant.physics import dynamics, tick

_unpack_state = unpacker(LawState)
_unpack_setpoint = unpacker(Setpoint)
_unpack_measured = unpacker(VehicleState)
_unpack_command = unpacker(RotorCommand)
_pack_internals = packer(Internals)


@kernel
def law_steps(params_buffer, state_buffer, setpoint_buffer, measured_rows, internals_rows):
    """A tick of the law for each row of `measured_rows`; returns a sum over the commands.

    Measurements differ and internals are kept, or the compiler would take work out of the loop.
    """
    params, state = cascade.unpack_params(params_buffer), _unpack_state(state_buffer)
    setpoint = _unpack_setpoint(setpoint_buffer)
    seen = 0.0
    for i in range(len(measured_rows)):
        measured = _unpack_measured(measured_rows[i])
        state, command, internals = cascade.step(state, params, setpoint, measured)
        _pack_internals(internals_rows[i], internals)
        seen += command.u.r1
    return seen


@kernel
def plant_steps(n, params_buffer, state_buffer, command_buffer):
    """`n` integration steps of the plant under one command; returns where it ends (m, East)."""
    params, state = tick.unpack_params(params_buffer), tick.unpack_state(state_buffer)
    command = _unpack_command(command_buffer)
    for i in range(n):
        state = dynamics.integrate(params, state, command, i * params.h)
    return state.r_E.x


@kernel
def margin_steps(params_buffer, state_buffer, measured_rows):
    """What a tick adds to tell its margins, for each row of `measured_rows`; returns their sum."""
    params, state = cascade.unpack_params(params_buffer), _unpack_state(state_buffer)
    seen = 0.0
    for i in range(len(measured_rows)):
        v = _unpack_measured(measured_rows[i]).v_E
        T = params.guard.m_max * (v + state.f_c_prev)
        known = margin.known(params)
        seen += margin.distance(known, T) + margin.tilt_left(params.phi_star, T)
        seen += margin.condition(known, state.a_m, v, state.beta)
    return seen
