"""The buildings of a field as boxes, for pictures."""

from __future__ import annotations

from typing import Any

import numpy as np

from sitl_plant.physics.wind.field import NO_TOP, Field

MOST = 2000  # boxes of a field; where it has more, the lowest are left out

Box = tuple[
    float, float, float, float, float, float
]  # west, east, south and north wall, foot, roof, m


def boxes(field: Field, origin: tuple[float, float, float]) -> list[Box]:
    """Boxes of cells of one height, in the frame of a mission whose origin lies there in the field, highest first.

    Each is as long as it can be to East, then as wide as it can be to North.
    """
    top = np.asarray(field.top)
    left = top > max(float(top.min()), 0.5 * NO_TOP)
    foot = float(top.min())
    found: list[Box] = []
    for row in range(top.shape[0]):
        for column in np.flatnonzero(left[row]):
            if not left[row, column]:
                continue
            alike = left[row, column:] & (top[row, column:] == top[row, column])
            wide = int(np.argmin(alike)) if not alike.all() else len(alike)
            cells = slice(column, column + wide)
            deep = 1
            while (
                row + deep < top.shape[0]
                and left[row + deep, cells].all()
                and (top[row + deep, cells] == top[row, column]).all()
            ):
                deep += 1
            left[row : row + deep, cells] = False
            edges: tuple[Any, ...] = (
                field.top_x[column] - origin[0], field.top_x[column + wide] - origin[0], field.top_y[row] - origin[1],
                field.top_y[row + deep] - origin[1], foot - origin[2], top[row, column] - origin[2],
            )  # fmt: skip
            west, east, south, north, below, roof = map(float, edges)
            found.append((west, east, south, north, below, roof))
    return sorted(found, key=lambda box: -box[5])[:MOST]
