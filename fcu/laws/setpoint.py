"""A setpoint between two of its messages: it moves on along its own derivatives. Not in the paper."""

from __future__ import annotations

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import select
from fcu.kernel.compile import kernel


@kernel
def carried(setpoint, age):
    """The setpoint `age` seconds after it was sent, carried along its own derivatives.

    Below the position level only its yaw is.
    """
    r_c, v_c, a_c = setpoint.r_c, setpoint.v_c, setpoint.a_c
    for_s = select(setpoint.level > 0.5, 0.0, age)
    return Setpoint(
        r_c=r_c + for_s * v_c + (0.5 * for_s * for_s) * a_c,
        v_c=v_c + for_s * a_c,
        a_c=a_c,
        psi_c=setpoint.psi_c + age * setpoint.psi_dot_c,
        psi_dot_c=setpoint.psi_dot_c,
        level=setpoint.level,
        tilt_c=setpoint.tilt_c,
        w_c=setpoint.w_c,
        T_c=setpoint.T_c,
    )
