"""Eight rotors: speed from the command by a lag, thrust and torque from speed. Paper (32), (33)."""

from __future__ import annotations

from fcu.kernel.algebra import Rotors, Vec3, select, total
from fcu.kernel.compile import kernel


@kernel
def lagged(Omega, Omega_c, decay):
    """Rotor speeds (rad/s) after an interval of lag; `decay`: remaining share of the error.

    Exact for a command that is constant over the interval. decay = 0 means no lag.
    """
    return Omega_c + decay * (Omega - Omega_c)


@kernel
def effectiveness(params, t):
    """Remaining fraction of thrust and torque of each rotor at time t (s)."""
    since, left = params.loss_time, params.effectiveness
    return Rotors(
        select(t >= since.r1, left.r1, 1.0), select(t >= since.r2, left.r2, 1.0),
        select(t >= since.r3, left.r3, 1.0), select(t >= since.r4, left.r4, 1.0),
        select(t >= since.r5, left.r5, 1.0), select(t >= since.r6, left.r6, 1.0),
        select(t >= since.r7, left.r7, 1.0), select(t >= since.r8, left.r8, 1.0),
    )  # fmt: skip


@kernel
def thrust_and_torque(params, Omega, left):
    """Total thrust (N) and torque (N m, B) at given rotor speeds (rad/s).

    The thrust of a rotor acts along +z at the end of its arm. Its drag torque turns the body
    opposite to its spin.
    """
    airframe = params.airframe
    f = (airframe.c_T * (left * params.wind.inflow)) * (Omega * Omega)
    tau = Vec3(
        total(airframe.y * f),
        -total(airframe.x * f),
        -airframe.k_Q * total(airframe.spin * f),
    )
    return total(f), tau


@kernel
def omega_m(params, Omega):
    """Sum of rotor speeds signed by spin (rad/s). Paper (33)."""
    return total(params.airframe.spin * Omega)
