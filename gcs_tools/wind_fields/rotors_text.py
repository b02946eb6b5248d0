"""The text of RotorS' wind plugin (gazebo_wind_plugin.cpp): levels that follow the terrain, x fastest."""

from __future__ import annotations

import numpy as np

from gcs_tools.wind_fields.grid import Grid, Part, wrong

_ONE = ("min_x", "min_y", "n_x", "n_y", "res_x", "res_y")
_MANY = ("vertical_spacing_factors", "bottom_z", "top_z", "u", "v", "w")
LEVELS = 3  # levels of the grid for each of the file, at least


def fits(text: str) -> bool:
    """Return true if a text begins as such a file does."""
    return text.lstrip().startswith("min_x:")


def read(text: str, source: str) -> Grid:
    """A field of RotorS, on level heights instead of the file's. Raises FieldError."""
    found: dict[str, list[float]] = {}
    name = ""
    for word in text.split():
        if word.endswith(":"):
            name = word[:-1]
            if name in found or name not in (*_ONE, *_MANY):
                raise wrong(source, f"{name}: twice, or no key of RotorS")
            found[name] = []
            continue
        try:
            found[name].append(float(word))
        except (KeyError, ValueError):
            raise wrong(source, f"{name}: expected numbers, got {word!r}") from None
    lacking = [key for key in (*_ONE, *_MANY) if not found.get(key)]
    if lacking:
        raise wrong(source, f"{', '.join(lacking)} missing: expected a file of RotorS' wind plugin")
    sizes = found["n_x"][0], found["n_y"][0]
    if any(n != int(n) or not 1 <= n <= 1e5 for n in sizes):
        raise wrong(source, f"n_x, n_y: expected whole numbers from 1, got {sizes}")
    nx, ny = map(int, sizes)
    factors = np.array(found["vertical_spacing_factors"])
    nz = len(factors)
    for key, n in (
        ("bottom_z", nx * ny),
        ("top_z", nx * ny),
        ("u", nx * ny * nz),
        ("v", nx * ny * nz),
        ("w", nx * ny * nz),
    ):
        if len(found[key]) != n:
            raise wrong(source, f"{key}: expected {n} numbers, got {len(found[key])}")
    if nz < 2 or (np.diff(factors) <= 0.0).any():
        raise wrong(source, "vertical_spacing_factors: expected two or more that rise")
    bottom, top = (np.array(found[key]).reshape(ny, nx) for key in ("bottom_z", "top_z"))
    if not (top > bottom).all():
        raise wrong(source, "top_z: expected heights above bottom_z")
    x = found["min_x"][0] + found["res_x"][0] * np.arange(nx)
    y = found["min_y"][0] + found["res_y"][0] * np.arange(ny)
    z = np.linspace(bottom.min(), top.min(), LEVELS * nz)
    parts = {}
    for name in "uvw":
        given = np.array(found[name]).reshape(nz, ny, nx)
        v = np.empty((1, len(z), ny, nx), dtype=np.float32)
        for j in range(ny):
            for i in range(nx):
                levels = bottom[j, i] + factors * (top[j, i] - bottom[j, i])
                v[0, :, j, i] = np.interp(z, levels, given[:, j, i])
                v[0, z < bottom[j, i], j, i] = np.nan
        parts[name] = Part(x, y, z, v)
    grid = Grid(source, "RotorS text", np.zeros(1), parts)
    grid.notes.append(f"levels that follow the terrain were interpolated to {len(z)} level heights")
    return grid
