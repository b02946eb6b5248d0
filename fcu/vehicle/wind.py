"""The wind that the law's disturbance estimate stands for, for ground stations to see.

The law needs no wind: it cancels the acceleration s_v_hat, whatever causes it. Read as drag of
believed coefficients that acceleration is an airspeed, and with the measured velocity a wind.
Nothing is fed back. Upwards drag cannot be told from an error of mass, so the vertical wind is
not known, and taken for none.
"""

from __future__ import annotations

import math

from fcu.interface.messages import VehicleState
from fcu.kernel.algebra import Vec3
from fcu.kernel.rotations import matrix, rotate, rotate_back

SMOOTHED_S = 1.0  # WIND_COV: "a 1 Hz low-passed estimate" and how it varies


ROUNDS, CLOSE = 20, 1e-3  # of two equations for the drag upwards, N


def airspeed(force: float, c: float) -> float:
    """Velocity against the air (m/s) along one axis at which drag is `force` (N): -c v |v|."""
    return -math.copysign(math.sqrt(abs(force) / c), force)


def of(measured: VehicleState, s_v_hat: Vec3, m_hat: float, drag: Vec3) -> Vec3:
    """Velocity of the air (m/s, E); its vertical component is NaN, not known.

    s_v_hat : drag over mass, m/s^2, E.  m_hat : kg.  drag : believed, N/(m/s)^2, body axes.
    At a constant velocity m_hat s_v_hat is the drag across whatever m_hat is.
    """
    R_EB = matrix(measured.q_EB)
    f_E = m_hat * s_v_hat
    f_z = 0.0
    for _ in range(ROUNDS):
        f_B = rotate_back(R_EB, Vec3(f_E.x, f_E.y, f_z))
        v_a_B = Vec3(airspeed(f_B.x, drag.x), airspeed(f_B.y, drag.y), airspeed(f_B.z, drag.z))
        across = rotate(R_EB, v_a_B)
        v_a = rotate_back(R_EB, Vec3(across.x, across.y, measured.v_E.z))
        felt = Vec3(*[-c * v * abs(v) for c, v in zip(drag, v_a, strict=True)])
        off = rotate(R_EB, felt).z - f_z
        if abs(off) < CLOSE:
            break
        f_z += 0.5 * off  # whole steps would go back and forth where an axis meets no wind
    v_air = measured.v_E - across
    return Vec3(v_air.x, v_air.y, math.nan)


class Wind:
    """The estimate, low-passed, and its variance. Time: simulation time, s."""

    def __init__(self, drag: Vec3) -> None:
        self._drag = drag
        self._at = math.nan
        self.v_air_E = Vec3(math.nan, math.nan, math.nan)  # not known before the first look
        self.variance = -1.0  # across, (m/s)^2; negative: not known

    def see(self, t: float, measured: VehicleState, s_v_hat: Vec3, m_hat: float) -> None:
        """One more look, at any interval."""
        now = of(measured, s_v_hat, m_hat, self._drag)
        if not math.isfinite(now.x + now.y):
            return
        if not t > self._at:  # the first look, or time began anew
            self._at, self.v_air_E, self.variance = t, now, 0.0
            return
        k = 1.0 - math.exp(-(t - self._at) / SMOOTHED_S)
        self._at = t
        off = now - self.v_air_E
        self.v_air_E = self.v_air_E + k * off
        self.variance += k * (0.5 * (off.x * off.x + off.y * off.y) - self.variance)
