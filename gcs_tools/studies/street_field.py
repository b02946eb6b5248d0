"""The field of wind of the missions `street_canyon` and `rooftop_inspection`: a street, made without fluid dynamics.

Wind that would blow without buildings is changed as little as makes it free of divergence and lets none of it through
a wall (Sherman, A mass-consistent model for wind fields over complex terrain, J. Appl. Meteor. 17, 1978: the least
sum of squares). Between the buildings it begins as the exponential profile of a canopy (Macdonald, Modelling the mean
velocity profile in the urban canopy layer, Boundary-Layer Meteorology 97, 2000), above it as the logarithm of open
ground. The air that houses keep out goes around and over them, so a street's mouth has less wind than open ground. It bends round corners and
speeds up over roofs. It has neither wakes nor the vortex of a street: no momentum is conserved.

    python -m gcs_tools.studies.street_field missions/street.field
    python -m gcs_tools.studies.street_field missions/street --directions 4      # from_000.field, from_090.field, ...

With directions, each field has 1 m/s at 10 m above open ground, so that the `scale` of a mission is that speed.
Fields of opposite directions are the same but for their sign: this flow has no wakes, and turns round with the wind.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from gcs_tools.wind_fields.grid import Grid, Part, pack

Array = np.ndarray[Any, Any]

CELL_M = 4.0
CELLS = 60, 30, 15  # to East, to North, up
WIND_M_S = 4.5, 2.6  # to East and North, 10 m above open ground: from west-southwest
STEP_M_S = (
    2.0**-14
)  # of the values for directions: files of few digits are small when they are packed
ROUGHNESS_M = 0.5  # of a suburb's ground
# west, east, south and north wall, and the roof's height, m
BUILDINGS = (
    (24, 72, 12, 52, 16), (80, 116, 12, 52, 24), (124, 160, 12, 52, 20), (180, 216, 12, 52, 12),
    (24, 56, 68, 108, 20), (64, 100, 68, 108, 28), (108, 160, 68, 108, 16), (180, 216, 68, 108, 24),
)  # fmt: skip
CANOPY_M = sum(roof for *_, roof in BUILDINGS) / len(BUILDINGS)
# 9.6 times the frontal area for a lot's area (Macdonald, 2000), of the walls to the west. Seen along the wind their area
# is greater by a third. Houses stand denser here than in his wind tunnel.
ATTENUATION = 9.6 * sum((b[3] - b[2]) * b[4] for b in BUILDINGS) / ((216 - 24) * (108 - 12))


def solid_cells() -> Array:
    """Cells that are building: bool[z, y, x]."""
    solid = np.zeros(CELLS[::-1], dtype=bool)
    for west, east, south, north, roof in BUILDINGS:
        x, y, z = (
            slice(int(a / CELL_M), int(b / CELL_M))
            for a, b in ((west, east), (south, north), (0, roof))
        )
        solid[z, y, x] = True
    return solid


def speed_factor(z: Array, in_canopy: bool) -> Array:
    """Speed at heights z (m) over the one at 10 m above open ground."""
    over: Array = np.log(np.maximum(z, 2.0 * ROUGHNESS_M) / ROUGHNESS_M) / np.log(
        10.0 / ROUGHNESS_M
    )
    if not in_canopy:
        return over
    at_roof = np.log(CANOPY_M / ROUGHNESS_M) / np.log(10.0 / ROUGHNESS_M)
    below = at_roof * np.exp(ATTENUATION * (z / CANOPY_M - 1.0))
    found: Array = over + (z < CANOPY_M) * (below - over)
    return found


def undisturbed(solid: Array, wind: tuple[float, float]) -> list[Array]:
    """The wind (u, v, w on the faces of cells) that begins, as if walls let it through.

    wind : to East and North at 10 m above open ground, m/s.
    """
    nz, ny, nx = solid.shape
    z = (np.arange(nz) + 0.5) * CELL_M
    west, east, south, north = (
        f(b[i] for b in BUILDINGS) for i, f in enumerate((min, max, min, max))
    )
    made = []
    for speed, shape, faces_x, faces_y in (
        (wind[0], (nz, ny, nx + 1), True, False), (wind[1], (nz, ny + 1, nx), False, True),
    ):  # fmt: skip
        x = (np.arange(shape[2]) + (0.0 if faces_x else 0.5)) * CELL_M
        y = (np.arange(shape[1]) + (0.0 if faces_y else 0.5)) * CELL_M
        among = ((y >= south) & (y <= north))[:, None] & ((x >= west) & (x <= east))[None, :]
        made.append(
            speed * np.where(among, speed_factor(z, True)[:, None, None], speed_factor(z, False)[:, None, None])
        )  # fmt: skip
    return [*made, np.zeros((nz + 1, ny, nx))]


def open_faces(solid: Array) -> list[Array]:
    """Faces that air passes, of u, v and w: none of a building, nor the ground."""
    found = []
    for axis in (2, 1, 0):
        cells = np.moveaxis(~solid, axis, -1)
        inner = cells[..., 1:] & cells[..., :-1]
        faces = np.concatenate((cells[..., :1], inner, cells[..., -1:]), axis=-1)
        if axis == 0:
            faces[..., 0] = False
        found.append(np.moveaxis(faces, -1, axis))
    return found


def without_divergence(velocity: list[Array], faces: list[Array], solid: Array) -> list[Array]:
    """The nearest wind that is free of divergence: v + grad p, with p = 0 beyond the open sides."""
    shape = solid.shape
    number = np.where(solid, -1, np.cumsum(~solid).reshape(shape) - 1)
    count = int((~solid).sum())
    v = [np.where(is_open, part, 0.0) for part, is_open in zip(velocity, faces, strict=True)]
    divergence = np.zeros(shape)
    for part, axis in zip(v, (2, 1, 0), strict=True):
        divergence += np.diff(part, axis=axis)
    rows, columns, values = [], [], []
    diagonal = np.zeros(count)
    for is_open, axis in zip(faces, (2, 1, 0), strict=True):
        cells, passes = np.moveaxis(number, axis, -1), np.moveaxis(is_open, axis, -1)
        a, b = cells[..., :-1][passes[..., 1:-1]], cells[..., 1:][passes[..., 1:-1]]
        rows += [a, b]
        columns += [b, a]
        values += [np.ones(len(a))] * 2
        for here in (a, b, cells[..., 0][passes[..., 0]], cells[..., -1][passes[..., -1]]):
            np.add.at(diagonal, here, -1.0)
    rows, columns, values = (
        [*rows, np.arange(count)],
        [*columns, np.arange(count)],
        [*values, diagonal],
    )
    poisson = coo_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))))
    p = np.zeros(shape)
    p[~solid] = spsolve(poisson.tocsc(), -divergence[~solid])
    found = []
    for part, is_open, axis in zip(v, faces, (2, 1, 0), strict=True):
        around = np.concatenate(
            (np.zeros_like(np.take(p, [0], axis)), p, np.zeros_like(np.take(p, [0], axis))), axis
        )
        found.append(np.where(is_open, part + np.diff(around, axis=axis), 0.0))
    return found


def street(wind: tuple[float, float] = WIND_M_S, step: float = 0.0) -> Grid:
    """The field, as a file would have it.

    wind : to East and North at 10 m above open ground, m/s.  step : to whose multiples values are rounded, m/s. 0 rounds none.
    """
    solid = solid_cells()
    found = without_divergence(undisturbed(solid, wind), open_faces(solid), solid)
    u, v, w = [np.rint(part / step) * step for part in found] if step else found
    nz, ny, nx = solid.shape
    at = {n: (np.arange(n) + 0.5) * CELL_M for n in (nx, ny, nz)}
    faces = {n: np.arange(n + 1) * CELL_M for n in (nx, ny, nz)}
    parts = {
        name: Part(*places, part[None].astype(np.float32))
        for name, places, part in (
            ("u", (faces[nx], at[ny], at[nz]), u), ("v", (at[nx], faces[ny], at[nz]), v), ("w", (at[nx], at[ny], faces[nz]), w),
        )
    }  # fmt: skip
    notes = ["made by gcs_tools.studies.street_field: mass-consistent, without wakes"]
    return Grid(
        "gcs_tools.studies.street_field", "a street, mass-consistent", np.zeros(1), parts, solid,
        (at[nx], at[ny], at[nz]), staggered=True, notes=notes,
    )  # fmt: skip


@click.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--directions", "n", type=click.IntRange(1, 360), help="a field for each of so many, of 1 m/s, in the folder OUT")  # fmt: skip
def main(out: Path, n: int | None) -> None:
    """Make the field of the missions, or fields for several directions of the wind.

    Fields of opposite directions are the same but for their sign: this flow has no wakes.
    """
    if n is None:
        pack(street(), out)
        return
    for from_deg in (360.0 * k / n for k in range(n)):
        a = math.radians(from_deg)  # of the compass: from North by East
        wind = -math.sin(a), -math.cos(a)
        pack(street(wind, STEP_M_S), out / f"from_{from_deg:03.0f}.field")


if __name__ == "__main__":
    main()
