"""A field of wind in numbers: extent, speeds, gradients and divergence."""

from __future__ import annotations

from typing import Any

import numpy as np

from sitl_plant.physics.wind.field import NO_TOP, Field

GROUND_SPEED_M_S = 10.0  # of a flight, for the rate at which it meets gradients


def _step(axis: Any) -> str:
    steps = np.diff(axis)
    if not len(steps):
        return "one place"
    low, high = steps.min(), steps.max()
    return f"{low:.4g} m" if high - low < 1e-6 * high else f"{low:.4g} to {high:.4g} m"


def divergence(field: Field) -> float:
    """RMS of the divergence (1/s) of the cells of a staggered field at its first time. NaN of another.

    Cells without their last face, as in PALM's files, are left out.
    """
    u, v, w = field.u.v[0], field.v.v[0], field.w.v[0]
    nz, ny, nx = w.shape[0] - 1, v.shape[1] - 1, u.shape[2] - 1
    nz, ny, nx = min(nz, len(field.u.z)), min(ny, len(field.u.y)), min(nx, len(field.v.x))
    of_cells = (field.v.x, field.w.x), (field.u.y, field.w.y), (field.u.z, field.v.z)
    faces = (field.u.x, nx), (field.v.y, ny), (field.w.z, nz)
    for (face, n), centres in zip(faces, of_cells, strict=True):
        for of in centres:
            if n < 1 or len(of) < n or not ((face[:n] < of[:n]) & (of[:n] < face[1 : n + 1])).all():
                return float("nan")
    d = (
        np.diff(u[:nz, :ny, : nx + 1], axis=2) / np.diff(field.u.x[: nx + 1])
        + np.diff(v[:nz, : ny + 1, :nx], axis=1) / np.diff(field.v.y[: ny + 1])[:, None]
        + np.diff(w[: nz + 1, :ny, :nx], axis=0) / np.diff(field.w.z[: nz + 1])[:, None, None]
    )
    return float(np.sqrt(np.mean(np.square(d))))


def summary(field: Field, about: dict[str, Any]) -> dict[str, Any]:
    """The rows that `gcs wind check` prints of a field."""
    parts = {name: getattr(field, name) for name in "uvw"}
    most = {name: float(np.abs(part.v).max()) for name, part in parts.items()}
    # no gradient of the field has a greater norm than the one of all its greatest entries
    entries = [
        float((np.abs(np.diff(part.v, axis=axis)) / _spacing(part, axis)).max())
        for part in parts.values()
        for axis in (1, 2, 3)
        if part.v.shape[axis] > 1
    ]
    gradient = float(np.linalg.norm(entries))
    in_time = float(np.linalg.norm([
        (np.abs(np.diff(part.v, axis=0)) / np.diff(field.t)[:, None, None, None]).max()
        for part in parts.values()
        if len(field.t) > 1
    ]))  # fmt: skip
    places = {axis: [getattr(part, axis) for part in parts.values()] for axis in "xyz"}
    ends = {axis: (min(p[0] for p in of), max(p[-1] for p in of)) for axis, of in places.items()}
    spreads = divergence(field)
    solid = field.top > NO_TOP
    return {
        "kind": about.get("kind", "packed"),
        "extent": [f"{axis} {ends[axis][0]:.6g} to {ends[axis][1]:.6g} m, step {_step(getattr(field.u, axis))}" for axis in "xyz"],
        "times": "one: steady" if len(field.t) == 1 else f"{len(field.t)} over {field.t[-1]:.6g} s",
        "greatest": ", ".join(f"{name} {value:.3g} m/s" for name, value in most.items()),
        "buildings": f"up to {float(field.top[solid].max()):.4g} m" if solid.any() else "none known",
        "divergence": "not known: all components stand at the same places" if np.isnan(spreads) else f"{spreads:.2g} 1/s rms",
        "beliefs": [
            f"guard_wind_m_s {np.sqrt(sum(v * v for v in most.values())):.3g} covers every place",
            f"guard_wind_rate_m_s2 {gradient * GROUND_SPEED_M_S + in_time:.3g} covers every place at {GROUND_SPEED_M_S:g} m/s over ground",
            "gusts smaller than two cells, or shorter than two times, are not in the field",
        ],
        "notes": list(about.get("notes", [])) or ["nothing was repaired"],
    }  # fmt: skip


def _spacing(part: Any, axis: int) -> Any:
    places = {1: part.z, 2: part.y, 3: part.x}[axis]
    shape = [1, 1, 1, 1]
    shape[axis] = -1
    return np.diff(places).reshape(shape)
