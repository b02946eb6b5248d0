"""The wind as ground stations are told it: what the law's estimate stands for, low-passed."""

from __future__ import annotations

import math

from fcu.interface.messages import VehicleState
from fcu.kernel.algebra import Vec3
from fcu.process.wind import of

SMOOTHED_S = 1.0  # WIND_COV: "a 1 Hz low-passed estimate" and how it varies


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
