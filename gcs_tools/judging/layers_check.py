"""The wind that the layers of a mission bring along its way, to hold against what the guard believes.

Shear, gusts and a field are worked out at the places and times of the way. What a field's grid leaves out is added as
`gcs wind check --along` adds it.

Turbulence has no greatest value. Three times the root mean square of its norm counts, of the three axes together. At any one
moment the norm exceeds that with a probability of 6e-6 where the axes are alike, and of at most 7e-5 where they are not. Its rate
is that over the time in which 1 m of it passes, below which eddies even out over a vehicle. It passes at the greatest speed of
all that the simulator carries it with: the steady wind with its shear, the samples of a file, gusts and the field.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.special import gamma, kv

from gcs_tools.missions.mission import Mission
from gcs_tools.wind_fields.along import SMALLEST_M, FlightInField
from gcs_tools.wind_fields.along import along as along_field
from sitl_plant.physics.wind import gusts, low_altitude, shear
from sitl_plant.physics.wind.layers import SHEARS, Layers
from sitl_plant.physics.wind.packed_field import opened

Rows = np.ndarray[Any, np.dtype[np.float64]]
Correlations = Callable[[float], tuple[float, float]]

SIGMAS = 3.0  # root mean squares of turbulence
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
    wind = mission.wind
    steady = float(np.linalg.norm(wind.steady_m_s))
    sampled = 0.0 if wind.samples is None else np.linalg.norm(wind.samples[:, 1:], axis=1).max()
    met = _met(layers, t, r)
    carry = _present(_sheared(layers, steady, height, t), _gusts(layers), _field(met))
    carried = steady + float(sampled) + sum(each.speed_m_s for each in carry)
    kept = [*carry, *_present(_eddies(met), _turbulence(layers, carried, height, v))]
    return LayersWind(
        sum(each.speed_m_s for each in kept), sum(each.rate_m_s2 for each in kept),
        tuple(part for each in kept for part in each.parts),
    )  # fmt: skip


def _present(*found: LayersWind | None) -> list[LayersWind]:
    return [each for each in found if each is not None]


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


def _met(layers: Layers, t: Rows, r: Rows) -> FlightInField | None:
    of = layers.field
    if of is None:
        return None
    field = opened(Path(of.path)).field
    return along_field(field, t + of.start_s, r + np.array(of.origin_m), of.scale, of.repeats)


def _field(met: FlightInField | None) -> LayersWind | None:
    if met is None:
        return None
    return LayersWind(met.wind_m_s, met.rate_m_s2, (f"{met.wind_m_s:.3g} m/s of the field",))


def _eddies(met: FlightInField | None) -> LayersWind | None:
    if met is None:
        return None
    said = f"{met.unresolved_m_s:.3g} m/s of eddies below {met.eddy_m:.3g} m"
    return LayersWind(met.unresolved_m_s, met.unresolved_m_s2, (said,))


def _turbulence(layers: Layers, carried: float, height: Rows, v: Rows) -> LayersWind | None:
    """Three times the root mean square of the norm of turbulence, and of its rate.

    carried : greatest speed (m/s) of the air that carries the turbulence.  height : m, (n,).  v : m/s, (n, 3), E.
    """
    if layers.turbulence is None or layers.turbulence_w20_m_s == 0.0:
        return None
    correlations = CORRELATIONS[layers.turbulence]
    speed, rate = 0.0, 0.0
    for h, fast in zip(height.tolist(), np.linalg.norm(v, axis=1).tolist(), strict=True):
        here = low_altitude.at_height(h, layers.turbulence_w20_m_s)
        speed = max(speed, SIGMAS * math.hypot(*here.sigma))
        change = SIGMAS * _difference(correlations, here)  # over 1 m
        passing = max(carried + fast, here.sigma.x)
        rate = max(rate, change * passing / SMALLEST_M)
    return LayersWind(speed, rate, (f"{speed:.3g} m/s of turbulence (three sigma)",))


def _difference(correlations: Correlations, here: low_altitude.Turbulence) -> float:
    """Root mean square of the norm (m/s) of how turbulence differs between places 1 m apart along the wind."""
    along, _ = correlations(SMALLEST_M / here.length.x)
    _, left = correlations(SMALLEST_M / here.length.y)
    _, up = correlations(SMALLEST_M / here.length.z)
    each = [s * s * (1.0 - rho) for s, rho in zip(here.sigma, (along, left, up), strict=True)]
    return math.sqrt(2.0 * sum(each))


def _dryden(x: float) -> tuple[float, float]:
    """Correlation along the wind and across it, of places x lengths apart. MIL-F-8785C, 3.7.1.2."""
    e = math.exp(-x)
    return e, (1.0 - 0.5 * x) * e


def _von_karman(x: float) -> tuple[float, float]:
    """Correlation along the wind and across it, of places x lengths apart. MIL-F-8785C, 3.7.1.1.

    Of the standard's spectra. The simulator's sum of Dryden turbulences changes by up to 5 % less over 1 m.
    """
    z = x / 1.339
    scale = 2.0 ** (2.0 / 3.0) / gamma(1.0 / 3.0)
    along = scale * z ** (1.0 / 3.0) * kv(1.0 / 3.0, z)
    return float(along), float(along - 0.5 * scale * z ** (4.0 / 3.0) * kv(2.0 / 3.0, z))


CORRELATIONS: dict[str, Correlations] = {"dryden": _dryden, "von_karman": _von_karman}
