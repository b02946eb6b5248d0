"""The air that one vehicle meets: layers, composed once a control tick.

`blow` puts the air of a tick into the plant's parameters. It is constant in the tick: the paper's sines alone, which
the parameters hold (`sines`), go on within it. A layer that a mission does not ask for costs a comparison.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.messages import VehicleState
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import size, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.groups import ROTORS
from fcu.kernel.rotations import matrix
from fcu.kernel.rows import column_of, slice_of
from sitl_plant.physics.types import PlantParams
from sitl_plant.physics.wind import (
    disk,
    draws,
    dryden,
    field,
    gusts,
    low_altitude,
    near,
    shear,
    von_karman,
)
from sitl_plant.physics.wind.field import Field

Buffer = np.ndarray[Any, np.dtype[np.float64]]

CALM, DRYDEN, VON_KARMAN = 0.0, 1.0, 2.0  # turbulence
NORMALS = 2 * math.ceil(von_karman.STATES / 2)  # numbers drawn a tick at most
_OF_DRYDEN = 2 * math.ceil(dryden.STATES / 2)
WALL_CLEAR, WALL_HIT, WALL_LEFT = 0.0, 1.0, 2.0  # `ground.wall`: nothing, a building, the field


class Shear(NamedTuple):
    """How the steady wind grows with hgroups."""

    kind: float  # as of `shear`
    reference: float  # m
    roughness: float  # m
    exponent: float


class Turbulence(NamedTuple):
    """Low-altitude turbulence."""

    kind: float
    w20: float  # m/s: mean wind at 20 ft
    seed: float
    along_cos: float  # of the direction of the mean wind, by which the turbulence is laid
    along_sin: float


class Body(NamedTuple):
    """A vehicle in a field."""

    is_on: float
    origin: Vec3  # of the mission, in the field, m
    scale: float  # of the velocities of the field
    start: float  # s: time of the field when the flight begins
    repeats: float  # 1: the times of the field begin anew after their end
    inflow: float  # 1: the air changes thrust
    radius: float  # of the rotors, m
    induced: Rotors  # induced velocity in hover over rotor speed, m
    clear: float  # height in the field from which no rotor meets a building, m


class Constants(NamedTuple):
    """All that the layers are told, packed into a buffer."""

    is_on: float  # 0: the vehicle meets `sines` and `samples` alone
    steady: Vec3  # m/s, E
    ground: float  # height of the mission's ground, m
    shear: Shear
    turbulence: Turbulence
    body: Body


class Air(NamedTuple):
    """The air of one vehicle."""

    samples: Buffer  # float64[n, 3], m/s, E, of each tick, after the last the last; n 0: none
    gusts: Buffer  # float64[n, gusts.WIDTH]
    constants: Buffer  # Constants
    memory: (
        Buffer  # float64[von_karman.STATES + 1]: states of turbulence, and 1 once they are drawn
    )
    normals: Buffer  # float64[NORMALS], of the tick
    hubs: Buffer  # float64[near.ROWS, 8]: places of the hubs, and what is kept of the field about them
    at_hubs: Buffer  # float64[3, 8]: velocity of the air at each hub, m/s, E
    field: Field


STEADY, ROTATION, INFLOW, GROUND, WALL = (
    slice_of(PlantParams, "wind.steady").start, slice_of(PlantParams, "wind.rotation").start,
    slice_of(PlantParams, "wind.inflow").start, column_of(PlantParams, "ground.z"), column_of(PlantParams, "ground.wall"),
)  # fmt: skip
_COS, _SIN = column_of(PlantParams, "wind.azimuth_cos"), column_of(PlantParams, "wind.azimuth_sin")
constants_of = unpacker(Constants)
_airframe_of = unpacker(PlantParams, "airframe")
_state_of = unpacker(VehicleState)
NO_TOP = 0.5 * field.NO_TOP  # below: no height is known
_DRAWN = von_karman.STATES  # of `memory`


def still_air() -> Air:
    """The air of a vehicle that no layer is asked for."""
    return Air(
        samples=np.zeros((0, 3)),
        gusts=np.zeros((0, gusts.WIDTH)),
        constants=np.zeros(size(Constants)),
        memory=np.zeros(von_karman.STATES + 1),
        normals=np.zeros(NORMALS),
        hubs=np.zeros((near.ROWS, ROTORS)),
        at_hubs=np.zeros((3, ROTORS)),
        field=field.no_field(),
    )


@kernel
def draw(normals, n, seed, tick):
    """Write the first n standard normal numbers of a tick to `normals`."""
    for pair in range(n // 2):
        a, b = draws.normals(seed, tick, pair)
        normals[2 * pair], normals[2 * pair + 1] = a, b


@kernel
def turbulent(memory, normals, of, height, v_mean, v_vehicle, dt, tick):
    """Velocity of turbulence (m/s, E) at a tick.  memory, normals : as in Air.

    v_mean : of the air, v_vehicle : m/s, E.  dt : s since the tick before.
    """
    here = low_altitude.at_height(height, of.w20)
    V = low_altitude.advection(v_mean, v_vehicle, here.sigma)
    h = (V * dt) * Vec3(1.0 / here.length.x, 1.0 / here.length.y, 1.0 / here.length.z)
    draw(normals, _OF_DRYDEN if of.kind == DRYDEN else NORMALS, of.seed, tick)
    first = memory[_DRAWN] == 0.0
    if of.kind == DRYDEN:
        if first:
            dryden.begin(memory, normals, 0)
        else:
            dryden.step(memory, h, normals, 0)
        unit = dryden.output(memory, 0)
    else:
        if first:
            von_karman.begin(memory, normals)
        else:
            von_karman.step(memory, h, normals)
        unit = von_karman.output(memory)
    memory[_DRAWN] = 1.0
    g = here.sigma * unit
    c, s = of.along_cos, of.along_sin
    return Vec3(c * g.x - s * g.y, s * g.x + c * g.y, g.z)


@kernel
def compose(air, params, state, tick, dt):
    """Put the air of a tick into `params`, inlined: the arguments of a call cost as much as a layer.

    params : float64[size(PlantParams)], of which steady wind, rotation, inflow, ground and wall are written.
    state : float64[size(VehicleState)].  dt : s, from tick to tick.
    """
    samples = air.samples
    if air.constants[0] == 0.0:
        if samples.shape[0] > 0:
            at = min(tick, samples.shape[0] - 1)
            for i in range(3):
                params[STEADY + i] = samples[at, i]
        return
    of, now, t = constants_of(air.constants), _state_of(state), tick * dt
    height = now.r_E.z - of.ground
    shear_of, body = of.shear, of.body
    R_EB, airframe, v_field = matrix(now.q_EB), _airframe_of(params), Vec3(0.0, 0.0, 0.0)
    v = of.steady * shear.factor(
        shear_of.kind, height, shear_of.reference, shear_of.roughness, shear_of.exponent
    )
    if samples.shape[0] > 0:
        at = min(tick, samples.shape[0] - 1)
        v = v + Vec3(samples[at, 0], samples[at, 1], samples[at, 2])
    if air.gusts.shape[0] > 0:
        v = v + gusts.velocity(air.gusts, t)
    if body.is_on == 1.0:
        k, f = field.time_in(air.field.t, body.start + t, body.repeats == 1.0)
        v_field, rotation = disk.meet(
            air.field, airframe, body.origin, body.scale, now.r_E, R_EB, k, f, air.hubs, air.at_hubs
        )
        v = v + v_field
        params[ROTATION], params[ROTATION + 1] = rotation.x, rotation.y
        params[ROTATION + 2] = rotation.z
        _stand(air.field, of, params, now.r_E, R_EB, airframe)
    if of.turbulence.kind != CALM:
        c, s = params[_COS], params[_SIN]
        mean = Vec3(c * v.x - s * v.y, s * v.x + c * v.y, v.z)
        v = v + turbulent(air.memory, air.normals, of.turbulence, height, mean, now.v_E, dt, tick)
    if body.is_on == 1.0 and body.inflow == 1.0:
        others = v - v_field  # without the field, the same at all hubs
        disk.change_thrust(
            airframe, body.induced, now.Omega, air.at_hubs, others, now.v_E, now.w_B, R_EB,
            air.hubs, near.SCRATCH * ROTORS,
        )  # fmt: skip
        for i in range(ROTORS):
            params[INFLOW + i] = air.hubs[near.SCRATCH, i]
    params[STEADY], params[STEADY + 1], params[STEADY + 2] = v.x, v.y, v.z


@kernel
def _stand(of, constants, params, r_E, R_EB, airframe):
    """Put the ground below the vehicle into `params`, and what of the field it has met."""
    body = constants.body
    at = body.origin + r_E
    top = field.height(of, at.x, at.y) - body.origin.z
    params[GROUND] = top if top > NO_TOP else constants.ground
    wall = WALL_CLEAR
    if not field.is_inside(of, at):
        wall = WALL_LEFT
    elif at.z < body.clear and (
        r_E.z < top or disk.touches(of, airframe, body.origin, r_E, R_EB, body.radius)
    ):
        wall = WALL_HIT
    params[WALL] = wall


@partial(kernel, inlined=False)
def _called(air, params, state, tick, dt):
    """`compose` as a call, which is compiled once."""
    compose(air, params, state, tick, dt)


@kernel
def blow(air, params, state, tick, dt):
    """Put the air of a tick into `params`.  Arguments as for `compose`.

    A vehicle that no layer is asked for does not pay for the call.
    """
    if air.constants[0] != 0.0 or air.samples.shape[0] > 0:
        _called(air, params, state, tick, dt)
