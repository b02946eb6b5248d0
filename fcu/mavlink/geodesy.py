"""Between places on Earth and the local frame: azimuthal equidistant about an origin, on a sphere.

The projection and the radius are those of PX4's MapProjection, so that distances agree with the
haversine that ground stations show. Angles in degrees, heights in m above the sea, ENU in m.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fcu.kernel.algebra import Vec3

RADIUS = 6_371_000.0  # m


class Geodetic(NamedTuple):
    """A place on Earth."""

    lat_deg: float
    lon_deg: float
    alt_m: float  # above the sea, or above home where a frame says so


class Origin(NamedTuple):
    """The place of local (0, 0, 0)."""

    lat_deg: float
    lon_deg: float
    alt_m: float


def to_local(origin: Origin, lat_deg: float, lon_deg: float, alt_m: float) -> Vec3:
    """East, north, up (m) of a place."""
    lat_0, lat = math.radians(origin.lat_deg), math.radians(lat_deg)
    dlon = math.radians(lon_deg - origin.lon_deg)
    # the angle from the origin, exact for small ones too
    a = math.sin(0.5 * (lat - lat_0)) ** 2
    a += math.cos(lat_0) * math.cos(lat) * math.sin(0.5 * dlon) ** 2
    c = 2.0 * math.asin(math.sqrt(min(a, 1.0)))
    if c > math.pi - 1e-6:  # every way there is as long
        return Vec3(0.0, math.pi * RADIUS, alt_m - origin.alt_m)
    k = c / math.sin(c) if c > 1e-12 else 1.0
    east = k * math.cos(lat) * math.sin(dlon)
    north = k * (
        math.sin(lat - lat_0) + 2.0 * math.sin(lat_0) * math.cos(lat) * math.sin(0.5 * dlon) ** 2
    )
    return Vec3(RADIUS * east, RADIUS * north, alt_m - origin.alt_m)


def to_geodetic(origin: Origin, r_E: Vec3) -> Geodetic:
    """The place of a local position (m, ENU). One that is no number is 0, 0."""
    x, y = r_E.x / RADIUS, r_E.y / RADIUS
    c = math.hypot(x, y)
    if not math.isfinite(c):
        return Geodetic(0.0, 0.0, r_E.z)
    lat_0, lon_0 = math.radians(origin.lat_deg), math.radians(origin.lon_deg)
    if c < 1e-15:
        return Geodetic(origin.lat_deg, origin.lon_deg, origin.alt_m + r_E.z)
    sin_c, cos_c = math.sin(c), math.cos(c)
    sin_lat = cos_c * math.sin(lat_0) + y * sin_c * math.cos(lat_0) / c
    lat = math.asin(max(-1.0, min(1.0, sin_lat)))
    lon = lon_0 + math.atan2(x * sin_c, c * math.cos(lat_0) * cos_c - y * math.sin(lat_0) * sin_c)
    lon_deg = (math.degrees(lon) + 180.0) % 360.0 - 180.0
    return Geodetic(math.degrees(lat), lon_deg, origin.alt_m + r_E.z)
