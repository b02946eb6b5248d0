"""Scale lengths and intensities of turbulence near the ground. MIL-F-8785C, 3.7.3.4, and MIL-HDBK-1797, B.3.

Both standards give the same spectra here: MIL-HDBK-1797 halves the lateral and vertical lengths and doubles
them in its formulas. Lengths are those of MIL-F-8785C. The formulas hold from 10 to 1,000 ft
(3 to 305 m). Below and above, the values at these ends are used.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fcu.kernel.algebra import Vec3, clip
from fcu.kernel.compile import kernel

FOOT = 0.3048  # m
LOWEST_FT, HIGHEST_FT = 10.0, 1000.0


class Turbulence(NamedTuple):
    """Of one height: along the mean wind, to the left of it, and up."""

    sigma: Vec3  # m/s
    length: Vec3  # m


@kernel
def at_height(height, w20):
    """Turbulence at a height (m above ground).  w20 : mean wind at 20 ft, m/s."""
    h = clip(height / FOOT, LOWEST_FT, HIGHEST_FT)
    base = 0.177 + 0.000823 * h
    sigma_w = 0.1 * w20
    sigma_u = sigma_w / math.pow(base, 0.4)
    L_u = FOOT * h / math.pow(base, 1.2)
    return Turbulence(Vec3(sigma_u, sigma_u, sigma_w), Vec3(L_u, L_u, FOOT * h))


@kernel
def advection(v_air, v_vehicle, sigma):
    """Speed (m/s) at which a vehicle moves through the turbulence: that of the mean air about it.

    The standards take turbulence for frozen, so that at no airspeed it would stand still. Large eddies carry small
    ones past a hovering vehicle at about the speed of their own fluctuations (Tennekes 1975), so the speed
    is at least `sigma`.x.
    """
    v = v_air - v_vehicle
    return max(math.sqrt(v.x * v.x + v.y * v.y + v.z * v.z), sigma.x)
