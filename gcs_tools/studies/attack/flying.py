"""A flight under attack: wind that answers to what is demanded, setpoints at the worst moment.

The ticks are those of `law_alone`; between slices of them the wind is set anew, and each setpoint is
offered to the law as a vehicle would: refused by the same look ahead, if that is the policy.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from fcu.guard import admission
from fcu.kernel.algebra import Vec3, norm
from fcu.kernel.buffers import size, to_buffer
from fcu.kernel.compile import kernel
from fcu.kernel.rows import column_of, slice_of
from fcu.interface.messages import Setpoint
from fcu.tick import Remembered, Tick
from gcs_tools.flight import law_alone
from gcs_tools.flight.joined import TICKS, together
from gcs_tools.flight.scenario import Scenario
from sitl_plant.burst import NOISE_AT, WIDTH
from sitl_plant.physics.types import PlantParams
from sitl_plant.simulator import Simulator
from fcu.mavlink.plant_link import LONGEST

Rows = np.ndarray[Any, np.dtype[np.float64]]

OWN, SQUARE, TURNING, FLIPPING, PUSHING = range(5)  # how the wind blows

_STEADY = slice_of(PlantParams, "wind.steady")
_WIND, _WIND_END = _STEADY.start, _STEADY.stop
_T0 = slice_of(Tick, "internals.demand.T_0").start
_REFERENCE = slice_of(Remembered, "law.reference").start
_A_M = slice_of(Remembered, "guard.a_m").start
_SINCE = column_of(law_alone.Course, "since_us")
_SETPOINT = size(Setpoint)


class Gust(NamedTuple):
    """Wind of an attack."""

    kind: float
    speed: float  # m/s
    rate: float  # m/s^2
    every: float  # s, of a square wind; rad/s, of one that turns
    x: float  # direction, E
    y: float
    z: float


@kernel
def wanted(gust, t, to_go, T_0, T_max, floor, sin, cos):
    """The velocity of the air (m/s, E) that the attack would have now."""
    n = Vec3(gust.x, gust.y, gust.z)
    if gust.kind == SQUARE:
        return (gust.speed if math.sin(math.pi * t / gust.every) >= 0.0 else -gust.speed) * n
    if gust.kind == TURNING:
        side = Vec3(-n.y, n.x, 0.0)
        side = (1.0 / (norm(side) + 1e-9)) * side
        up = Vec3(
            n.y * side.z - n.z * side.y, n.z * side.x - n.x * side.z, n.x * side.y - n.y * side.x
        )
        a = gust.every * t
        return gust.speed * (math.cos(a) * side + math.sin(a) * up)
    if gust.kind == FLIPPING:
        return (-gust.speed / (norm(to_go) + 1e-9)) * to_go
    aside = math.sqrt(T_0.x * T_0.x + T_0.y * T_0.y)
    whole = norm(T_0) + 1e-9
    cone, above, below = T_0.z * sin - aside * cos, T_max - whole, T_0.z - floor
    if above <= cone and above <= below:
        return (-gust.speed / whole) * T_0
    if below <= cone:
        return Vec3(0.0, 0.0, gust.speed)
    k = -gust.speed / (aside + 1e-9)
    return Vec3(cos * k * T_0.x, cos * k * T_0.y, gust.speed * sin)


@kernel
def attacked(
    flight,
    law,
    plant,
    datagram,
    plant_rows,
    fcu_rows,
    sent_at,
    sent,
    gust,
    slice_ticks,
    h,
    refuses,
    guard,
    law_params,
    way,
    reference,
    admitted,
    T_max,
    floor,
    sin,
    cos,
):
    """Fly all of `fcu_rows`; returns how many ticks were flown.

    sent_at : int64[m], ticks.  sent : float64[m, n], Setpoints.  admitted : float64[m], written.
    """
    k, i, n = 0, 0, len(fcu_rows)
    x, y, z = plant.params[_WIND], plant.params[_WIND + 1], plant.params[_WIND + 2]
    zero = Vec3(0.0, 0.0, 0.0)
    T_0, to_go = Vec3(0.0, 0.0, 78.0), zero
    law_h = law_params[0]
    while k < n:
        if i < len(sent_at) and sent_at[i] <= k:
            fits = True
            if refuses:
                law_params[0] = law_h
                for j in range(_SETPOINT):
                    way[0, 1 + j] = sent[i, j]
                for j in range(6):
                    reference[j] = flight.remembered[_REFERENCE + j]
                for j in range(3):
                    reference[6 + j] = flight.remembered[_A_M + j]
                fits = admission.ahead(guard, law_params, way, reference) >= 0.0
            admitted[i] = 1.0 if fits else 0.0
            if fits:
                for j in range(_SETPOINT):
                    flight.setpoint[j] = sent[i, j]
                flight.course[_SINCE] = k * h * 1e6
                at = Vec3(flight.measured[0], flight.measured[1], flight.measured[2])
                to_go = Vec3(sent[i, 0], sent[i, 1], sent[i, 2]) - at
            i += 1
            continue
        until = min(n, k + slice_ticks)
        if i < len(sent_at):
            until = min(until, sent_at[i])
        if gust.kind != OWN:
            w = wanted(gust, k * h, to_go, T_0, T_max, floor, sin, cos)
            most = gust.rate * h * (until - k)
            d = Vec3(w.x - x, w.y - y, w.z - z)
            part = min(1.0, most / (norm(d) + 1e-12))
            x, y, z = x + part * d.x, y + part * d.y, z + part * d.z
            plant.params[_WIND], plant.params[_WIND + 1], plant.params[_WIND + 2] = x, y, z
        flown, why, _ = together(
            flight, law, plant, datagram, plant_rows[k:until], fcu_rows[k:until], -1
        )
        k += flown
        if why != TICKS:
            return k
        row = fcu_rows[k - 1]
        T_0 = Vec3(row[_T0], row[_T0 + 1], row[_T0 + 2])
    return k


def fly(scene: Scenario, gust: Gust):
    """Plant rows, rows of the law's Tick, and which setpoints were admitted."""
    alone, law = law_alone.flight(scene)
    simulator = Simulator(scene.world, law_alone.SYSTEM)
    plant_rows = np.zeros((scene.ticks, WIDTH))
    fcu_rows = np.zeros((scene.ticks, size(Tick)))
    datagram = np.zeros(LONGEST, dtype=np.uint8)
    sent = scene.setpoints
    admitted = np.zeros(len(sent))
    way = np.zeros((1, 1 + _SETPOINT))
    way[0, 0] = math.inf
    lp = scene.law
    random = np.random.default_rng(int(scene.world.seed))
    scale = scene.world.noise_scale
    noise = random.standard_normal((scene.ticks + 1, len(scale))) * scale
    plant = simulator.plant._replace(noise=noise)
    plant.progress[NOISE_AT] = 0.0
    flown = attacked(
        alone, law.address, plant, datagram, plant_rows, fcu_rows, scene.sent_at, sent,
        Gust(*map(float, gust)), 5 if lp.h < 0.003 else 2, lp.h, scene.guard.policy == 2.0,
        to_buffer(scene.guard), to_buffer(lp), way, np.zeros(9), admitted, lp.limits.T_max, lp.T_dz_min,
        math.sin(lp.limits.phi_star), math.cos(lp.limits.phi_star),
    )  # fmt: skip
    return plant_rows[:flown], fcu_rows[:flown], admitted
