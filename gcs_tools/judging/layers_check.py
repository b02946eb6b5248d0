"""The wind that the layers of a mission bring along its way, to hold against what the guard believes.

Shear, gusts and a field are worked out at the places and times of the way. What a field's grid leaves out is added as
`gcs wind check --along` adds it. Turbulence has no greatest value: three standard deviations count, and of its rate those over
the time in which 1 m of it passes, below which eddies even out over a vehicle.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gcs_tools.missions.mission import Mission
from gcs_tools.wind_fields.along import SMALLEST_M
from gcs_tools.wind_fields.along import along as along_field
from sitl_plant.physics.wind import gusts, low_altitude, shear
from sitl_plant.physics.wind.layers import SHEARS, Layers
from sitl_plant.physics.wind.packed_field import opened

Rows = np.ndarray[Any, np.dtype[np.float64]]

SIGMAS = 3.0  # of turbulence
MOST_PLACES = 2000  # of a way
GUST_STEP = 16  # moments that a gust's rise and fall are looked at


class LayersWind(NamedTuple):
    """The greatest wind of all layers, and of the steady wind that they shear."""

    speed_m_s: float
    rate_m_s2: float
    parts: tuple[str, ...]  # what each layer brings, in words


def layers_wind(mission: Mission, layers: Layers, t: Rows, r: Rows, v: Rows) -> LayersWind:
    """The wind of the layers along a way.  t : s, (n,).  r, v : m and m/s, (n, 3), E."""
    every = max(1, len(t) // MOST_PLACES)
    t, r, v = t[::every], r[::every], v[::every]
    height = r[:, 2] - mission.flight.ground_z_m
    steady = float(np.linalg.norm(mission.wind.steady_m_s))
    found = [
        _sheared(layers, steady, height, t),
        _gusts(layers),
        _field(layers, t, r),
        _turbulence(layers, steady, height, v),
    ]
    kept = [each for each in found if each is not None]
    return LayersWind(
        sum(each.speed_m_s for each in kept), sum(each.rate_m_s2 for each in kept),
        tuple(part for each in kept for part in each.parts),
    )  # fmt: skip


def _sheared(layers: Layers, steady: float, height: Rows, t: Rows) -> LayersWind | None:
    """The part of the sheared steady wind that is more than the steady wind itself."""
    if layers.shear is None:
        return None
    kind = SHEARS[layers.shear]
    factors = np.array(
        [
            shear.factor(kind, h, layers.shear_height_m, layers.roughness_m, layers.shear_exponent)
            for h in height.tolist()
        ]
    )
    more = steady * max(float(factors.max()) - 1.0, 0.0)
    rate = steady * float(np.abs(np.diff(factors) / np.diff(t)).max(initial=0.0))
    return LayersWind(more, rate, (f"{more:.3g} m/s of shear",))


def _gusts(layers: Layers) -> LayersWind | None:
    if not layers.gusts:
        return None
    rows = np.array(layers.gusts, dtype=np.float64)
    begin, rise, hold, fall = rows[:, :4].T
    share = np.linspace(0.0, 1.0, GUST_STEP + 1)
    t = np.unique(
        np.concatenate(
            [(begin + at)[:, None] + long[:, None] * share for at, long in ((0.0, rise), (rise + hold, fall))]
        )
    )  # fmt: skip
    air = np.array([tuple(gusts.velocity(rows, at)) for at in t.tolist()])
    speed = float(np.linalg.norm(air, axis=1).max())
    rate = float((np.linalg.norm(np.diff(air, axis=0), axis=1) / np.diff(t)).max(initial=0.0))
    return LayersWind(speed, rate, (f"{speed:.3g} m/s of gusts",))


def _field(layers: Layers, t: Rows, r: Rows) -> LayersWind | None:
    of = layers.field
    if of is None:
        return None
    field = opened(Path(of.path)).field
    met = along_field(field, t + of.start_s, r + np.array(of.origin_m), of.scale, of.repeats)
    return LayersWind(
        met.guard_wind_m_s, met.guard_wind_rate_m_s2,
        (f"{met.wind_m_s:.3g} m/s of the field", f"{met.unresolved_m_s:.3g} m/s of eddies below {met.eddy_m:.3g} m"),
    )  # fmt: skip


def _turbulence(layers: Layers, steady: float, height: Rows, v: Rows) -> LayersWind | None:
    if layers.turbulence is None or layers.turbulence_w20_m_s == 0.0:
        return None
    speed, rate = 0.0, 0.0
    for h, fast in zip(height.tolist(), np.linalg.norm(v, axis=1).tolist(), strict=True):
        here = low_altitude.at_height(h, layers.turbulence_w20_m_s)
        passing = max(steady + fast, here.sigma.x)
        for sigma, length in zip(here.sigma, here.length, strict=True):
            over = math.sqrt(2.0 * (1.0 - math.exp(-SMALLEST_M / length)))  # of 1 m, over sigma
            rate = max(rate, SIGMAS * sigma * over * passing / SMALLEST_M)
        speed = max(speed, SIGMAS * here.sigma.x)
    return LayersWind(speed, rate, (f"{speed:.3g} m/s of turbulence (three sigma)",))
