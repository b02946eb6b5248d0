"""Loops around the margins of a tick and a step of the plant, compiled: what `bench` times."""

from __future__ import annotations

from fcu.guard import margin
from fcu.interface.messages import RotorCommand, VehicleState
from fcu.kernel.buffers import unpacker
from fcu.kernel.compile import kernel
from fcu.process.tick import unpack_remembered, unpack_settings
from sitl_plant.physics import dynamics, tick

_unpack_measured = unpacker(VehicleState)
_unpack_command = unpacker(RotorCommand)


@kernel
def plant_steps(n, params_buffer, state_buffer, command_buffer):
    """`n` integration steps of the plant under one command; returns where it ends (m, East)."""
    params, state = tick.unpack_params(params_buffer), tick.unpack_state(state_buffer)
    command = _unpack_command(command_buffer)
    for i in range(n):
        state = dynamics.integrate(params, state, command, i * params.h)
    return state.r_E.x


@kernel
def margin_steps(settings_buffer, remembered_buffer, measured_rows):
    """What a tick adds to tell its margins, for each row of `measured_rows`; returns their sum."""
    settings, remembered = unpack_settings(settings_buffer), unpack_remembered(remembered_buffer)
    guard, a_m = settings.guard, remembered.guard.a_m
    beta = margin.left(remembered.guard)
    phi_star, seen = settings.law.limits.phi_star, 0.0
    for i in range(len(measured_rows)):
        v = _unpack_measured(measured_rows[i]).v_E
        T = guard.m_max * (v + remembered.law.memory.f_c)
        known = margin.known(guard, settings.law)
        seen += margin.distance(known, T) + margin.tilt_left(phi_star, T)
        seen += margin.condition(known, a_m, v, beta)
    return seen
