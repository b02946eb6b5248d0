"""The cascade in place of a law that has failed: it begins with the command that was given last.

Not in PX4. The integrals of velocity and of the body rates take what the last command had and the
proportional parts do not give, so that the thrust vector and the torque go on as they were. They
unwind as the errors do.
"""

from __future__ import annotations

from math import isfinite

from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Rotors, Vec3, clip, inverse8, total
from fcu.kernel.buffers import packer, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import euler, from_euler, matrix
from fcu.laws.allocation import achieved
from fcu.laws.demand import G
from fcu.laws.px4.law import (
    Params,
    State,
    acceleration,
    body_torque,
    commanded_rates,
    commanded_velocity,
)
from fcu.laws.setpoint import carried

LEAST = 0.1  # of the weight: with less thrust upwards the last command says nothing of a hover

_unpack_params, _unpack_setpoint = unpacker(Params), unpacker(Setpoint)
_unpack_measured, _unpack_thrusts = unpacker(VehicleState), unpacker(Rotors)
_pack_state = packer(State)


@kernel
def resumed(params, setpoint, measured, T, tau):
    """The State with which the next tick commands thrust T (N, along body z) and torque tau (N m, B).

    The integrals are kept within their limits. What these leave out is a step of the command.
    """
    zero = Vec3(0.0, 0.0, 0.0)
    R_EB, v, w = matrix(measured.q_EB), measured.v_E, measured.w_B
    T_E, T_hover = T * R_EB.e3, params.m * G
    wanted = Vec3(G * T_E.x / T_E.z, G * T_E.y / T_E.z, T_E.z * (G / T_hover) - G)  # (4) solved
    e_v = commanded_velocity(params, setpoint, measured.r_E) - v
    v_int = wanted - acceleration(params, zero, e_v, zero, setpoint.a_c)
    v_int = Vec3(v_int.x, v_int.y, clip(v_int.z, -G, G))

    angles = euler(R_EB)
    q_d = from_euler(angles.x, angles.y, setpoint.psi_c)
    w_c = commanded_rates(params, measured.q_EB, q_d, setpoint.psi_dot_c)
    unit = Vec3(
        tau.x / params.torque_unit.x, tau.y / params.torque_unit.y, tau.z / params.torque_unit.z
    )
    blank = State(
        v_E=v, v_dot=zero, v_int=v_int, w_B=w, w_dot=zero, w_int=zero, tau_yaw=unit.z, refused=zero
    )
    rest, _ = body_torque(params, blank, w_c, w, zero)
    most, most_yaw = params.rate_i_max, params.yaw_rate_i_max
    w_int = Vec3(
        clip(unit.x - rest.x, -most, most), clip(unit.y - rest.y, -most, most),
        clip(unit.z - rest.z, -most_yaw, most_yaw),
    )  # fmt: skip
    return State(
        v_E=v, v_dot=zero, v_int=v_int, w_B=w, w_dot=zero, w_int=w_int, tau_yaw=unit.z,
        refused=zero,
    )  # fmt: skip


@kernel
def resume(settings, setpoint, age, measured, thrusts, remembered):
    """Write the State of `resumed` to `remembered`, and return True if that was possible.

    settings : float64[n], Params first.  setpoint : Setpoint, `age` s after it was received.
    measured : VehicleState.  thrusts : float64[8], of the last command, N (NaN if there is none).
    Without a last command, and where that does not lift, nothing is written: the law takes over afresh.
    """
    params, seen = _unpack_params(settings), _unpack_measured(measured)
    f = _unpack_thrusts(thrusts)
    T, tau = achieved(params.rotors, inverse8(params.rotors.c_T) * f)
    lifts = T * matrix(seen.q_EB).e3.z > LEAST * params.m * G
    if not (isfinite(total(f)) and lifts):
        return False
    asked = carried(_unpack_setpoint(setpoint), age)
    if asked.level > 0.5:
        return False
    _pack_state(remembered, resumed(params, asked, seen, T, tau))
    return True
