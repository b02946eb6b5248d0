"""The buildings of a field as boxes: told in the metadata of a flight, for who draws it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from sitl_plant.physics.wind.field import NO_TOP, Field

BUILDINGS = "buildings"  # of a flight's metadata: the boxes, as JSON
MOST = 2000  # boxes of a field; where it has more, the lowest are left out
FARTHEST_M = 1e6  # of a wall that is drawn

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


def told_boxes(told: Mapping[str, Any]) -> list[Box]:
    """The boxes that a recording's metadata, or a vehicle, tells of. Those that are none are left out."""
    found = told.get(BUILDINGS, [])
    try:
        listed = json.loads(found) if isinstance(found, str) else found
    except (ValueError, RecursionError):
        return []
    if not isinstance(listed, list):
        return []
    return [
        (float(box[0]), float(box[1]), float(box[2]), float(box[3]), float(box[4]), float(box[5]))
        for box in listed[:MOST]
        if isinstance(box, list | tuple) and len(box) == 6
        and all(isinstance(x, int | float) and abs(x) < FARTHEST_M for x in box)
    ]  # fmt: skip
