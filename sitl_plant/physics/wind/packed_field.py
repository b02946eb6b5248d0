"""A field as the simulator maps it from disk: a folder of NumPy arrays.

u.npy, v.npy and w.npy hold float32[t, z, y, x] in m/s, axes.npz their places (u_x, u_y, u_z, v_x, ...), the times t,
the bounds and the heights of ground and buildings (top, top_x, top_y), all float64 but the heights. about.json tells
people where the field comes from and what was repaired. `gcs wind pack` writes it. The arrays are mapped, so that all processes and vehicles
of a machine share one copy, of which they read what they pass.
"""

from __future__ import annotations

import json
import mmap
import zipfile
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.files import input_file
from sitl_plant.physics.wind.field import Component, Field, component_on, frozen

AXES = ("x", "y", "z")
FORMAT = 1
FASTEST_M_S = 150.0  # a value beyond it is no wind in m/s
# values of a component: of so many all are checked on opening, of more when packed
LOOKED_AT = 8 << 20


class FieldError(input_file.PlainError):
    """A field that cannot be opened or packed: which file, what is wrong, what to do."""


class Packed(NamedTuple):
    """A field, mapped, and what is known of it."""

    field: Field
    about: dict[str, Any]


def is_packed(path: Path) -> bool:
    """Return true if a path is a packed field."""
    return (path / "about.json").is_file()


def opened(path: Path) -> Packed:
    """A packed field, mapped into memory. Raises FieldError."""
    try:
        written = (path / "about.json").stat().st_mtime_ns
    except OSError as error:
        raise FieldError(
            f"{path}: expected a packed field (gcs wind pack): {error.strerror}"
        ) from error
    return _mapped(path.resolve(), written)


@lru_cache(maxsize=8)
def _mapped(path: Path, _written: int) -> Packed:
    try:
        with input_file.opened(path / "about.json") as file:
            about = json.load(file)
        if not isinstance(about, dict) or about.get("format") != FORMAT:
            raise FieldError(f"{path}: expected a packed field of format {FORMAT}: pack it again")
        notes = about.get("notes", [])
        if not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
            raise ValueError("the notes of about.json are no texts")
        with (
            input_file.opened(path / "axes.npz") as file,
            np.load(file, allow_pickle=False) as axes,
        ):
            found = {name: axes[name] for name in axes.files}
        _check_axes(found)
        parts = {name: _component(path, name, found) for name in "uvw"}
        field = Field(
            t=frozen(found["t"]),
            **parts,
            bounds=frozen(found["bounds"]),
            top_x=frozen(found["top_x"]),
            top_y=frozen(found["top_y"]),
            top=frozen(found["top"]),
        )
    except OSError as error:
        raise FieldError(f"{path}: {error.strerror or error}") from error
    except KeyError as error:
        raise FieldError(f"{path}: damaged (axes.npz lacks {error}): pack it again") from error
    except (ValueError, EOFError, RecursionError, MemoryError, zipfile.BadZipFile) as error:
        raise FieldError(f"{path}: damaged ({error}): pack it again") from error
    return Packed(field, about)


def _check_axes(axes: dict[str, Any]) -> None:
    """Raise ValueError unless places and times are finite and rise."""
    for name in ("t", "top_x", "top_y", *(f"{part}_{axis}" for part in "uvw" for axis in AXES)):
        places = axes[name]
        if places.ndim != 1 or not len(places) or not np.isfinite(places).all():
            raise ValueError(f"{name} of axes.npz is no row of finite numbers")
        if (np.diff(places) <= 0.0).any():
            raise ValueError(f"{name} of axes.npz does not rise")
    bounds, top = axes["bounds"], axes["top"]
    if bounds.shape != (6,) or not np.isfinite(bounds).all() or (bounds[::2] > bounds[1::2]).any():
        raise ValueError("the bounds of axes.npz are none")
    if top.dtype != np.float32 or top.ndim != 2 or np.isnan(top).any():
        raise ValueError("the heights of axes.npz are none")


def _component(path: Path, name: str, axes: dict[str, Any]) -> Component:
    places = [axes[f"{name}_{axis}"] for axis in AXES]
    input_file.opened(path / f"{name}.npy").close()  # a pipe is never mapped
    values = np.load(path / f"{name}.npy", mmap_mode="r", allow_pickle=False)
    shape = (len(axes["t"]), *(len(of) for of in reversed(places)))
    if values.shape != shape or values.dtype != np.float32 or not values.flags.c_contiguous:
        raise ValueError(f"{name}.npy is no float32 {shape}")
    if values.size <= LOOKED_AT and not (np.abs(values) <= FASTEST_M_S).all():
        raise ValueError(
            f"{name}.npy has values that are not finite, or beyond {FASTEST_M_S:g} m/s"
        )
    if values.size > LOOKED_AT and hasattr(mmap, "MADV_RANDOM"):
        # a vehicle passes few of the pages: those about them would be read, and kept, for nothing
        values._mmap.madvise(mmap.MADV_RANDOM)
    x, y, z = places
    return component_on(x, y, z, values)


def save(path: Path, field: Field, about: dict[str, Any]) -> None:
    """Write a field to a folder, which is made. Raises OSError."""
    path.mkdir(parents=True, exist_ok=True)
    axes = {
        "t": field.t,
        "bounds": field.bounds,
        "top_x": field.top_x,
        "top_y": field.top_y,
        "top": field.top,
    }
    for name in "uvw":
        part = getattr(field, name)
        np.save(path / f"{name}.npy", np.ascontiguousarray(part.v, dtype=np.float32))
        axes |= {f"{name}_{axis}": getattr(part, axis) for axis in AXES}
    np.savez(path / "axes.npz", **axes)  # type: ignore[arg-type]  # arrays by name
    about = {"format": FORMAT, **about}
    (path / "about.json").write_text(
        json.dumps(about, indent=1) + "\n"
    )  # last: it says that all is there
