"""NetCDF files, classic (SciPy) or NetCDF-4 (h5py, the extra `city`), with one face."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.files import input_file
from gcs_tools.wind_fields.grid import check_file, check_size, reason, wrong
from sitl_plant.physics.wind.packed_field import FieldError

_HDF5 = b"\x89HDF"
_CLASSIC = b"CDF"
PACKED = "scale_factor", "add_offset"
FILLED = "_FillValue", "missing_value"
ELSEWHERE = "leads to another file: expected values in the file itself (h5repack IN OUT)"


class Variable(NamedTuple):
    """A variable, read."""

    name: str
    dimensions: tuple[str, ...]
    data: np.ndarray[Any, Any]
    attributes: dict[str, Any]

    @property
    def values(self) -> np.ndarray[Any, Any]:
        """Its numbers. Raises ValueError where it has something else."""
        if self.data.dtype.kind not in "biuf":
            raise ValueError(f"{self.name} has no real numbers ({self.data.dtype})")
        return self.data


class Contents(NamedTuple):
    """A file, read."""

    variables: dict[str, Variable]
    attributes: dict[str, Any]


def is_netcdf(path: Path) -> bool:
    """Return true if a file begins as NetCDF does. Raises OSError."""
    with input_file.opened(path) as file:
        return file.read(4).startswith((_HDF5, _CLASSIC))


def read(path: Path) -> Contents:
    """A whole file. Raises FieldError, OSError."""
    with input_file.opened(path) as file:
        check_file(str(path), file)
        begins = file.read(4)
    try:
        return _netcdf4(path) if begins == _HDF5 else _classic(path)
    except FieldError:
        raise
    except MemoryError as error:
        raise wrong(str(path), reason(error)) from error
    except Exception as error:  # of a damaged file SciPy and h5py raise whatever they meet
        raise FieldError(
            f"{path}: damaged, or no NetCDF file: {type(error).__name__}: {error}"
        ) from error


def _classic(path: Path) -> Contents:
    from scipy.io import netcdf_file

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of values that are still looked at
        with netcdf_file(path, "r", mmap=False) as file:
            found = {
                name: _variable(path, name, of.dimensions, np.array(of[:]), dict(of._attributes))
                for name, of in file.variables.items()
            }
            return Contents(found, dict(file._attributes))


def _netcdf4(path: Path) -> Contents:
    try:
        import h5py
    except ImportError as error:
        raise FieldError(
            f"{path}: NetCDF-4 needs h5py: pip install 'm-mrac[city]', or nccopy -k classic IN OUT"
        ) from error
    with h5py.File(path, "r") as file:
        found, values = {}, 0
        for name in file:
            link = file.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                raise FieldError(f"{path}: {input_file.plain(name)} {ELSEWHERE}")
            if not isinstance(link, h5py.HardLink):  # of NetCDF-4 none is
                continue
            of = file[name]
            if not isinstance(of, h5py.Dataset):
                continue
            if of.external or of.is_virtual:
                raise FieldError(f"{path}: {input_file.plain(name)} {ELSEWHERE}")
            values += of.size * of.dtype.itemsize
            check_size(str(path), values)
            dimensions = tuple(_dimension(of, i) for i in range(of.ndim))
            found[name] = _variable(path, name, dimensions, np.array(of[...]), dict(of.attrs))
        return Contents(found, dict(file.attrs))


def _variable(
    path: Path,
    name: str,
    dimensions: tuple[str, ...],
    data: np.ndarray[Any, Any],
    attributes: dict[str, Any],
) -> Variable:
    """A variable as the conventions of climate and forecast (CF) say: unpacked, NaN where it has no value.

    Raises FieldError for a packing that is none.
    """
    if data.dtype.kind not in "biuf":
        return Variable(name, dimensions, data, attributes)
    fills = np.concatenate([_numbers(path, name, attributes, key) for key in FILLED])
    scales, offsets = (_numbers(path, name, attributes, key) for key in PACKED)
    absent = np.isin(data, fills[np.isfinite(fills)].astype(data.dtype)) if len(fills) else None
    if len(scales) or len(offsets):
        packing = *scales, *offsets
        if len(scales) > 1 or len(offsets) > 1 or not np.isfinite(packing).all() or 0.0 in scales:
            raise wrong(
                str(path),
                f"{input_file.plain(name)}: expected one finite number of {' and '.join(PACKED)} each",
            )
        if "_Unsigned" in attributes:
            raise wrong(
                str(path), f"{input_file.plain(name)} is packed as _Unsigned: unpack it first"
            )
        data = data * (scales[0] if len(scales) else 1.0) + (offsets[0] if len(offsets) else 0.0)
    if absent is not None and absent.any():
        data = np.where(absent, np.nan, data).astype(
            data.dtype if data.dtype.kind == "f" else np.float64
        )
    return Variable(name, dimensions, data, attributes)


def _numbers(
    path: Path, name: str, attributes: dict[str, Any], key: str
) -> np.ndarray[Any, np.dtype[np.float64]]:
    """The numbers of an attribute, none where a variable does not have it. Raises FieldError."""
    try:
        return np.ravel(attributes.get(key, ())).astype(np.float64)
    except (ValueError, TypeError) as error:
        raise wrong(str(path), f"{input_file.plain(name)}: {key} is no number") from error


def _dimension(of: Any, i: int) -> str:
    """The name of a dimension of a variable: that of the scale that is attached to it, or its own."""
    scales = of.dims[i]
    name = scales[0].name if len(scales) else of.name
    return str(name).rpartition("/")[2]
