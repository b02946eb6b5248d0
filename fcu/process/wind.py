"""The wind that the law's disturbance estimate stands for, for people to see. Not in the paper.

The law needs no wind: it cancels the acceleration s_v_hat, whatever causes it. Read as drag of
believed coefficients that acceleration is an airspeed, and with the measured velocity a wind.
Nothing is fed back. Upwards drag cannot be told from an error of mass, so the vertical wind is
not known, and taken for none.
"""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import matrix, rotate, rotate_back
from fcu.process.tick import Tick

ROUNDS, CLOSE = 20, 1e-3  # of two equations for the drag upwards, N
NOT_KNOWN = math.nan

_measured = unpacker(Tick, "measured")
_estimates = unpacker(Tick, "state.estimates")
_engaged = unpacker(Tick, "engaged")


@kernel
def airspeed(force, c):
    """Velocity against the air (m/s) along one axis at which drag is `force` (N): -c v |v|."""
    return -math.copysign(math.sqrt(abs(force) / c), force)


@kernel
def felt(v, c):
    """Drag (N) along one axis at a velocity v (m/s) against the air."""
    return -c * v * abs(v)


@kernel
def of(measured, s_v_hat, m_hat, drag):
    """Velocity of the air (m/s, E); its vertical component is NaN, not known.

    s_v_hat : drag over mass, m/s^2, E.  m_hat : kg.  drag : believed, N/(m/s)^2, body axes.
    At a constant velocity m_hat s_v_hat is the drag across whatever m_hat is; otherwise the
    error of mass times the acceleration enters. Thrust is taken to be as believed.
    """
    R_EB = matrix(measured.q_EB)
    f_E = m_hat * s_v_hat
    f_z = 0.0
    across = Vec3(0.0, 0.0, 0.0)
    for _ in range(ROUNDS):
        f_B = rotate_back(R_EB, Vec3(f_E.x, f_E.y, f_z))
        v_a_B = Vec3(airspeed(f_B.x, drag.x), airspeed(f_B.y, drag.y), airspeed(f_B.z, drag.z))
        across = rotate(R_EB, v_a_B)
        v_a = rotate_back(R_EB, Vec3(across.x, across.y, measured.v_E.z))
        f_a = Vec3(felt(v_a.x, drag.x), felt(v_a.y, drag.y), felt(v_a.z, drag.z))
        off = rotate(R_EB, f_a).z - f_z
        if abs(off) < CLOSE:
            break
        f_z += 0.5 * off  # whole steps would go back and forth where an axis meets no wind
    v_air = measured.v_E - across
    return Vec3(v_air.x, v_air.y, NOT_KNOWN)


@kernel
def read(tick, drag, out):
    """The wind at a Tick (its buffer) to `out`, float64[3]: m/s, E; NaN while the law does not fly.

    drag : believed, float64[3], N/(m/s)^2, body axes.
    """
    estimates, believed = _estimates(tick), Vec3(drag[0], drag[1], drag[2])
    v_air = of(_measured(tick), estimates.s_v_hat, estimates.m_hat, believed)
    flying = _engaged(tick) > 0.5
    out[0] = v_air.x if flying else NOT_KNOWN
    out[1] = v_air.y if flying else NOT_KNOWN
    out[2] = NOT_KNOWN
