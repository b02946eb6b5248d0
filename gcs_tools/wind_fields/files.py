"""Reads a field of wind from a file of any format that is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fcu.interface.files import input_file
from gcs_tools.wind_fields import netcdf, palm, qes, rotors_text, table, udales, vtk, vtk_file
from gcs_tools.wind_fields.grid import Grid, reason, wrong
from sitl_plant.physics.wind.packed_field import FieldError

KNOWN = "PALM (NetCDF), QES-Winds (NetCDF-4), uDALES (NetCDF), RotorS text, VTK (legacy, .vtu, .vti), CSV"
MOST_MIB = 2048  # of a text
NO_FIELD = "a folder, but no packed field (gcs wind pack makes one)"


@np.errstate(all="ignore")  # `packable` checks values, and tells of them in words
def read(path: Path) -> Grid:
    """A field as a file has it. Raises FieldError."""
    source = str(path)
    if path.is_dir():
        raise wrong(source, NO_FIELD)
    try:
        if netcdf.is_netcdf(path):
            contents = netcdf.read(path)
            if palm.fits(contents):
                return palm.read(contents, source)
            if qes.fits(contents):
                return qes.read(contents, source)
            if udales.fits(contents):
                return udales.read(contents, path)
            raise wrong(source, f"a NetCDF file of none of the kinds that are known: {KNOWN}")
        if vtk_file.is_vtk(path):
            return vtk.read(path)
        text = input_file.text(path, MOST_MIB * input_file.MIB)
    except FieldError:
        raise
    except OSError as error:  # also of a file beside it
        raise wrong(str(error.filename or source), error.strerror or str(error)) from error
    except UnicodeDecodeError as error:
        raise wrong(source, f"expected one of {KNOWN}") from error
    except (ValueError, LookupError, TypeError, OverflowError, MemoryError) as error:
        raise wrong(source, f"its values are no field: {reason(error)}") from error
    if rotors_text.fits(text):
        return rotors_text.read(text, source)
    if table.fits(text):
        return table.read(text, source)
    raise wrong(source, f"expected one of {KNOWN}")
