"""A field of eddies for the attack: air that turns and changes from place to place, within what is believed.

Random waves of 24 to 192 m, in the spectrum of a law of 5/3, as the rotation of a potential on the edges of the cells, which
is free of divergence to rounding. The greatest speed at any place is 1 m/s, so that a flight's scale is its greatest wind.

    python -m gcs_tools.studies.attack.eddies eddies.field
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from gcs_tools.wind_fields.grid import Grid, Part, pack

Array = np.ndarray[Any, Any]

CELL_M = 6.0
CELLS = 150, 150, 150  # to East, to North, up
SHORTEST_M, LONGEST_M = 24.0, 192.0
SLOPE = (
    -17.0 / 6.0
)  # of the potential over the wave number: a law of 5/3 for the energy of the wind
SEED = 1


def potential(random: np.random.Generator) -> Array:
    """One component of the potential at the corners of the cells, float64[z, y, x]."""
    shape = tuple(n + 1 for n in reversed(CELLS))
    k = np.sqrt(
        sum(
            np.square(axis)
            for axis in np.meshgrid(*(np.fft.fftfreq(n, CELL_M) for n in shape), indexing="ij")
        )
    )
    kept = (k >= 1.0 / LONGEST_M) & (k <= 1.0 / SHORTEST_M)
    size = np.where(kept, np.where(kept, k, 1.0) ** SLOPE, 0.0)
    found: Array = np.fft.ifftn(size * np.fft.fftn(random.normal(size=shape))).real
    return found


def eddies() -> Grid:
    """The field, as a file would have it."""
    random = np.random.default_rng(SEED)
    a_x, a_y, a_z = (potential(random) for _ in range(3))

    def along(a: Array, axis: int) -> Array:
        """The mean over the edges along an axis."""
        low, high = (np.take(a, range(i, a.shape[axis] - 1 + i), axis) for i in (0, 1))
        middle: Array = 0.5 * (low + high)
        return middle

    a_x, a_y, a_z = along(a_x, 2), along(a_y, 1), along(a_z, 0)
    u = np.diff(a_z, axis=1) - np.diff(a_y, axis=0)
    v = np.diff(a_x, axis=0) - np.diff(a_z, axis=2)
    w = np.diff(a_y, axis=2) - np.diff(a_x, axis=1)
    centred = [0.5 * (part[:-1] + part[1:]) for part in (np.moveaxis(of, axis, 0) for of, axis in ((u, 2), (v, 1), (w, 0)))]  # fmt: skip
    speeds = [np.moveaxis(part, 0, axis) for part, axis in zip(centred, (2, 1, 0), strict=True)]
    fastest = max(
        float(np.sqrt(sum(np.square(part) for part in speeds)).max()),
        float(np.sqrt(sum(np.abs(part).max() ** 2 for part in (u, v, w)))) / np.sqrt(3.0),
    )
    faces, at = ([CELL_M * (np.arange(n + k) + h) for n in CELLS] for k, h in ((1, 0.0), (0, 0.5)))
    parts = {
        "u": Part(faces[0], at[1], at[2], (u / fastest)[None].astype(np.float32)),
        "v": Part(at[0], faces[1], at[2], (v / fastest)[None].astype(np.float32)),
        "w": Part(at[0], at[1], faces[2], (w / fastest)[None].astype(np.float32)),
    }
    return Grid(
        "gcs_tools.studies.attack.eddies", "eddies, random", np.zeros(1), parts, staggered=True
    )


if __name__ == "__main__":
    pack(eddies(), Path(sys.argv[1]))
