"""A mesh of polyhedra, looked up at places: which cell holds one, and which wind is there."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gcs_tools.wind_fields.vtk_file import POLYHEDRON, Cells

Array = np.ndarray[Any, Any]

# corners of the faces of VTK's cells
FACES = {
    10: ((0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)),
    11: ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)),
    12: ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)),
    13: ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    14: ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}  # fmt: skip
OUTSIDE = 0.02  # of a cell's size: so far outside its faces, which need not be flat, a place still belongs to it
CHUNK = 200_000  # places at a time
OVERLAP = 20  # times that every place may lie in the boxes of cells, on the average
MOST_FACES = 40_000_000


class Mesh(NamedTuple):
    """Cells as centres and faces."""

    centre: Array  # (n, 3), m
    size: Array  # (n,), m: twice the least distance from the centre to a face
    volume: Array  # (n,), m^3
    faces: Array  # int32 (n, m): faces of each cell, the first again where there are fewer
    normal: Array  # (k, 3), outwards
    middle: Array  # (k, 3), m
    corner_cell: Array  # int (c,): which cell a corner belongs to
    corner: Array  # int (c,): which point it is


def mesh(points: Array, cells: Cells) -> Mesh:
    """The mesh of an unstructured grid. Cells without a volume are left out. Raises ValueError for one of a kind that is unknown."""
    n = len(cells.types)
    parts: list[tuple[Array, Array]] = []  # corners (m, k) of faces, and cell (m,)
    corner, corner_cell = [], []
    for kind in np.unique(cells.types).tolist():
        which = np.flatnonzero(cells.types == kind)
        if kind == POLYHEDRON:
            by_size: dict[int, tuple[list[Array], list[int]]] = {}
            for i in which.tolist():
                own = cells.faces[i]
                for face in own:
                    ids, of = by_size.setdefault(len(face), ([], []))
                    ids.append(face)
                    of.append(i)
                every = np.unique(np.concatenate(own))
                corner.append(every)
                corner_cell.append(np.full(len(every), i))
            parts += [(np.array(ids), np.array(of)) for ids, of in by_size.values()]
            continue
        if kind not in FACES:
            if kind < 10:
                continue  # points, lines and surfaces
            raise ValueError(f"cells of VTK's type {kind}")
        k = 1 + max(max(face) for face in FACES[kind])
        n_corners = cells.first[which + 1] - cells.first[which]
        if (n_corners != k).any():
            i = int(np.argmax(n_corners != k))
            raise ValueError(
                f"cell {which[i]} of VTK's type {kind} has {n_corners[i]} corners: expected {k}"
            )
        of_cell = cells.corners[cells.first[which][:, None] + np.arange(k)]
        corner.append(of_cell.ravel())
        corner_cell.append(np.repeat(which, k))
        parts += [(of_cell[:, list(face)], which) for face in FACES[kind]]
    if not parts:
        raise ValueError("it has no cells with a volume")
    all_corners, all_cells = np.concatenate(corner), np.concatenate(corner_cell)
    if all_corners.min() < 0 or all_corners.max() >= len(points):
        raise ValueError("cells have corners that are no points")
    p = points.astype(np.float64)
    count = np.bincount(all_cells, minlength=n)
    centre: Array = np.stack(
        [np.bincount(all_cells, p[all_corners, a], n) for a in range(3)], axis=-1
    )
    centre = centre / np.maximum(count, 1)[:, None]
    normal, middle, owner, wide = [], [], [], []
    for corners, cell in parts:
        at = p[corners]
        turned = np.roll(at, -1, axis=1)
        area = np.cross(at, turned).sum(axis=1)
        length = np.linalg.norm(area, axis=1)
        flat = length > 0.0
        area[flat] /= length[flat, None]
        wide.append(0.5 * length[flat])
        normal.append(area[flat])
        middle.append(at[flat].mean(axis=1))
        owner.append(cell[flat])
    normals, middles, owners = map(np.concatenate, (normal, middle, owner))
    inward = np.einsum("ij,ij->i", normals, middles - centre[owners])
    normals[inward < 0.0] *= -1.0
    volume = np.bincount(owners, np.abs(inward) * np.concatenate(wide) / 3.0, n)
    order = np.argsort(owners, kind="stable")
    owners, normals, middles, inward = owners[order], normals[order], middles[order], np.abs(inward[order])  # fmt: skip
    kept, first, faces_of = np.unique(owners, return_index=True, return_counts=True)
    most = int(faces_of.max())
    if len(kept) * most > MOST_FACES:
        raise ValueError(f"{len(kept)} cells of up to {most} faces are too many")
    padded = first[:, None] + np.where(np.arange(most) < faces_of[:, None], np.arange(most), 0)
    number = np.full(n, -1)
    number[kept] = np.arange(len(kept))
    some = number[all_cells] >= 0
    return Mesh(
        centre[kept], 2.0 * np.minimum.reduceat(inward, first), volume[kept], padded.astype(np.int32), normals, middles,
        number[all_cells[some]], all_corners[some],
    )  # fmt: skip


def cells_at(of: Mesh, points: Array, axes: tuple[Array, Array, Array]) -> Array:
    """The cell that holds each place of a regular grid: int (z, y, x), -1 where none does.

    points : of the mesh.  axes : x, y and z, rising.  Raises ValueError for cells that overlap without end.
    """
    n, shape = len(of.centre), tuple(len(axis) for axis in reversed(axes))
    slack, at = OUTSIDE * of.size, points[of.corner].astype(np.float64)
    first, wide = np.empty((n, 3), dtype=np.int64), np.empty((n, 3), dtype=np.int64)
    for a, axis in enumerate(axes):  # the places in the box about each cell
        low, high = np.full(n, np.inf), np.full(n, -np.inf)
        np.minimum.at(low, of.corner_cell, at[:, a])
        np.maximum.at(high, of.corner_cell, at[:, a])
        first[:, a] = np.searchsorted(axis, low - slack)
        wide[:, a] = np.searchsorted(axis, high + slack, side="right") - first[:, a]
    ends = np.cumsum(wide.prod(axis=1))
    n_places = int(np.prod(shape))
    best, chosen = np.full(n_places, -np.inf), np.full(n_places, -1)
    if ends[-1] > OVERLAP * (n_places + n):
        raise ValueError(
            f"its cells overlap: a place is in the boxes about {ends[-1] / (n_places + n):.0f} of them, expected {OVERLAP} or fewer"
        )
    for start in range(0, int(ends[-1]), CHUNK):
        k = np.arange(start, min(start + CHUNK, int(ends[-1])))
        cell = np.searchsorted(ends, k, side="right")
        k -= np.where(cell > 0, ends[cell - 1], 0)
        along_x, along_y = wide[cell, 0], wide[cell, 1]
        x, y = first[cell, 0] + k % along_x, first[cell, 1] + k // along_x % along_y
        z = first[cell, 2] + k // (along_x * along_y)
        inside = _depth(of, cell, np.stack([axes[0][x], axes[1][y], axes[2][z]], axis=-1))
        held = inside >= -OUTSIDE
        place, inside, cell = ((z * shape[1] + y) * shape[2] + x)[held], inside[held], cell[held]
        np.maximum.at(best, place, inside)
        deepest = inside == best[place]
        chosen[place[deepest]] = cell[deepest]
    return chosen.reshape(shape)


def _depth(of: Mesh, cell: Array, places: Array) -> Array:
    """How deep each place lies in a cell, over the cell's size. Below 0 it lies outside."""
    depth = np.full(len(cell), np.inf)
    for face in of.faces[cell].T:
        out = np.einsum("ij,ij->i", of.normal[face], of.middle[face] - places)
        np.minimum(depth, out, out=depth)
    return depth / of.size[cell]


def slopes(of: Mesh, points: Array, at_centre: Array, at_points: Array | None) -> Array:
    """How values change in each cell, (n, 3 values, 3 axes), 1/m: the least squares of its corners. Without their values 0."""
    n = len(of.centre)
    if at_points is None:
        return np.zeros((n, 3, 3))
    arm = points[of.corner].astype(np.float64) - of.centre[of.corner_cell]
    change = at_points[of.corner].astype(np.float64) - at_centre[of.corner_cell]

    def summed(values: Array) -> Array:
        return np.bincount(of.corner_cell, values, n)

    square, product = np.empty((n, 3, 3)), np.empty((n, 3, 3))
    for a in range(3):
        for b in range(3):
            square[:, a, b] = summed(arm[:, a] * arm[:, b])
            product[:, a, b] = summed(change[:, a] * arm[:, b])
    square += 1e-9 * np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    return np.asarray(np.swapaxes(np.linalg.solve(square, np.swapaxes(product, 1, 2)), 1, 2))
