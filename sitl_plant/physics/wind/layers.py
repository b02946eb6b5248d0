"""Layers of the wind that a mission asks for, handed to the simulator, and the air made of them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import to_buffer
from sitl_plant.physics.types import PlantParams
from sitl_plant.physics.wind import air, disk, gusts, shear
from sitl_plant.physics.wind.air import Air, Body, Constants, Shear, Turbulence
from sitl_plant.physics.wind.packed_field import opened

SHEARS = {"log": shear.LOG, "power": shear.POWER}
TURBULENCES = {"dryden": air.DRYDEN, "von_karman": air.VON_KARMAN}


class LayersError(ValueError):
    """A file that does not hold layers."""


class FieldLayer(NamedTuple):
    """A packed field, and how a flight lies in it."""

    path: str  # of the packed field
    origin_m: tuple[float, float, float]  # of the mission, in the field
    scale: float = 1.0  # of the velocities
    start_s: float = 0.0  # time of the field when the flight begins
    repeats: bool = False  # after its end it begins anew; else its last time holds
    inflow: bool = True  # the air at each rotor changes its thrust


class Layers(NamedTuple):
    """Layers beside steady wind, sines, step and samples. What is None is not asked for."""

    shear: str | None = None  # of SHEARS
    shear_height_m: float = 10.0  # at which the steady wind is that of the mission
    roughness_m: float = 0.1
    shear_exponent: float = 1.0 / 7.0
    turbulence: str | None = None  # of TURBULENCES
    turbulence_w20_m_s: float = 0.0
    seed: int = 1
    gusts: tuple[tuple[float, ...], ...] = ()  # rows of `gusts`
    field: FieldLayer | None = None


def layered(layers: Layers, params: PlantParams) -> Air:
    """The air of a vehicle that meets these layers.  params : of its plant.

    Turbulence is laid along the steady wind, or along East without one. Raises FieldError.
    """
    steady = params.wind.steady
    along = math.hypot(steady.x, steady.y)
    field = layers.field
    # of no mean wind there is no turbulence, and in still air nothing would carry it past
    turbulence = layers.turbulence if layers.turbulence_w20_m_s > 0.0 else None
    made = air.still_air()
    values = None if field is None else opened(Path(field.path)).field
    radius = disk.rotor_radius(params.airframe) if field is not None else 1.0
    constants = Constants(
        is_on=1.0,
        steady=steady,
        ground=params.ground.z,
        shear=Shear(
            kind=SHEARS.get(layers.shear or "", shear.NONE),
            reference=layers.shear_height_m,
            roughness=layers.roughness_m,
            exponent=layers.shear_exponent,
        ),
        turbulence=Turbulence(
            kind=TURBULENCES.get(turbulence or "", air.CALM),
            w20=layers.turbulence_w20_m_s,
            seed=float(layers.seed),
            along_cos=steady.x / along if along else 1.0,
            along_sin=steady.y / along if along else 0.0,
        ),
        body=Body(
            is_on=0.0 if field is None else 1.0,
            origin=Vec3(*([0.0] * 3 if field is None else map(float, field.origin_m))),
            scale=1.0 if field is None else float(field.scale),
            start=0.0 if field is None else float(field.start_s),
            repeats=1.0 if field is not None and field.repeats else 0.0,
            inflow=1.0 if field is not None and field.inflow else 0.0,
            radius=radius,
            induced=Rotors(*disk.induced_velocity(params.airframe, radius)),
            clear=0.0 if values is None else float(values.top.max()) + disk.reach(params.airframe),
        ),
    )
    made = made._replace(
        constants=to_buffer(constants),
        gusts=np.array(layers.gusts, dtype=np.float64).reshape(-1, gusts.WIDTH),
    )
    return made if values is None else made._replace(field=values)


def save(path: Path, layers: Layers) -> None:
    """Write layers for a simulator. Raises OSError."""
    tables: dict[str, Any] = layers._asdict()
    if layers.field is not None:
        tables["field"] = layers.field._asdict()
    path.write_text(json.dumps(tables))


def load(path: Path) -> Layers:
    """Read what `save` wrote. Raises LayersError."""
    try:
        tables = json.loads(path.read_text())
        if tables.get("field") is not None:
            of = FieldLayer(**tables["field"])
            tables["field"] = of._replace(origin_m=(of.origin_m[0], of.origin_m[1], of.origin_m[2]))
        tables["gusts"] = tuple(map(tuple, tables.get("gusts", ())))
        return Layers(**tables)
    except OSError as error:
        raise LayersError(f"{path}: {error.strerror}") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise LayersError(
            f"{path}: expected layers of wind as gcs fly writes them: {error}"
        ) from error
