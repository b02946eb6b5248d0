"""Places on Earth and the local frame: there and back, signs, and the haversine."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fcu.kernel.algebra import Vec3
from fcu.mavlink.geodesy import RADIUS, Origin, to_geodetic, to_local

ZURICH = Origin(47.397742, 8.545594, 489.4)
metres = st.floats(-50_000.0, 50_000.0)


@given(metres, metres, st.floats(-500.0, 5000.0), st.floats(-85.0, 85.0), st.floats(-180.0, 180.0))
def test_a_round_trip_is_off_a_micrometre_within_50_km(x, y, z, lat, lon):
    origin = Origin(lat, lon, 100.0)
    back = to_local(origin, *to_geodetic(origin, Vec3(x, y, z)))
    assert math.dist(back, (x, y, z)) < 1e-6


@given(metres, metres)
def test_distances_are_those_of_the_haversine(x, y):
    lat, lon, _ = to_geodetic(ZURICH, Vec3(x, y, 0.0))
    p, q = math.radians(ZURICH.lat_deg), math.radians(lat)
    a = math.sin(0.5 * (q - p)) ** 2
    a += math.cos(p) * math.cos(q) * math.sin(0.5 * math.radians(lon - ZURICH.lon_deg)) ** 2
    assert 2.0 * RADIUS * math.asin(math.sqrt(a)) == pytest.approx(math.hypot(x, y), abs=1e-5)


def test_north_is_more_latitude_and_east_more_longitude():
    north, east = (
        to_geodetic(ZURICH, Vec3(0.0, 100.0, 0.0)),
        to_geodetic(ZURICH, Vec3(100.0, 0.0, 5.0)),
    )
    degree = math.pi * RADIUS / 180.0
    assert (north.lat_deg - ZURICH.lat_deg) * degree == pytest.approx(100.0, abs=1e-3)
    assert north.lon_deg == pytest.approx(ZURICH.lon_deg)
    across = degree * math.cos(math.radians(ZURICH.lat_deg))
    assert (east.lon_deg - ZURICH.lon_deg) * across == pytest.approx(100.0, abs=1e-3)
    assert east.alt_m == 494.4


@given(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0), st.floats(-1e5, 1e5))
def test_every_place_has_a_finite_position(lat, lon, alt):
    assert all(map(math.isfinite, to_local(ZURICH, lat, lon, alt)))


@given(st.floats(), st.floats(), st.floats())
def test_every_position_has_a_place_or_none_and_never_raises(x, y, z):
    lat, lon, _ = to_geodetic(ZURICH, Vec3(x, y, z))
    assert abs(lat) <= 90.0
    assert abs(lon) <= 180.0
