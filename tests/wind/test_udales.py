"""uDALES' field dumps, in the layout of its source: tiles, faces, buildings with and without a mask."""

from __future__ import annotations

import os

import numpy as np
import pytest
from scipy.io import netcdf_file

from gcs_tools.wind_fields.files import read
from gcs_tools.wind_fields.grid import packable
from sitl_plant.physics.wind.packed_field import FieldError

N, D = 8, 2.0
HOUSE = np.s_[:3, 3:5, 2:6]  # of cells z, y, x: 6 m high, on both tiles


def dump(folder, with_mask=True):
    """Two tiles in x, of 3 m/s to East that grows with height, around a house."""
    solid = np.zeros((N, N, N), dtype=bool)
    solid[HOUSE] = True
    u = np.tile(3.0 + np.arange(N)[:, None, None], (1, N, N)).astype(np.float32)
    u[solid | np.roll(solid, 1, axis=2)] = 0.0
    v = np.full((N, N, N), 0.5, dtype=np.float32)
    v[solid | np.roll(solid, 1, axis=1)] = 0.0
    w = np.zeros((N, N, N), dtype=np.float32)
    for tile in (0, 1):
        here = slice(4 * tile, 4 * tile + 4)
        with netcdf_file(folder / f"fielddump.{tile:03d}.000.007.nc", "w", version=2) as file:
            file.createDimension("time", None)
            axes = {"zt": D * (np.arange(N) + 0.5), "zm": D * np.arange(N), "yt": D * (np.arange(N) + 0.5),
                    "ym": D * np.arange(N), "xt": D * (np.arange(N) + 0.5)[here], "xm": D * np.arange(N)[here]}  # fmt: skip
            time = file.createVariable("time", "f", ("time",))
            time.units = b"s"
            for name, values in axes.items():
                file.createDimension(name, len(values))
                file.createVariable(name, "f", (name,))[:] = values
            given = [
                ("u", ("zt", "yt", "xm"), u),
                ("v", ("zt", "ym", "xt"), v),
                ("w", ("zm", "yt", "xt"), w),
            ]
            if with_mask:
                given.append(("mask_c", ("zt", "yt", "xt"), (~solid).astype(np.float32)))
            for name, dims, values in given:
                of = file.createVariable(name, "f", ("time", *dims))
                of[:] = np.stack([values, 2.0 * values if name in "uvw" else values])[..., here]
                of.units = b"m/s" if name in "uvw" else b"M"
            time[:] = [10.0, 20.0]
    return folder / "fielddump.000.000.007.nc"


def test_buildings_with_wind_in_them_are_those_of_the_list_beside_the_dump(tmp_path):
    """As uDALES writes them: the wind in buildings is small, but not 0."""
    path = dump(tmp_path, with_mask=False)
    for tile in (0, 1):
        with netcdf_file(tmp_path / f"fielddump.{tile:03d}.000.007.nc", "a") as file:
            file.variables["u"].data[:] += np.float32(0.02)
    grid = read(path)
    assert not grid.solid.any()
    assert any("solid_c.txt" in note for note in grid.notes)
    cells = np.argwhere(np.ones((3, 2, 4))) + [0, 3, 2] + 1
    lines = "\n".join(f"{x:4d} {y:4d} {z:4d}" for z, y, x in cells)
    (tmp_path / "solid_c.txt").write_text("# position (i,j,k)\n" + lines + "\n")
    grid = read(path)
    field = packable(grid)
    assert field.top.max() == pytest.approx(6.0) and (field.top > 0.0).sum() == 8
    assert not field.u.v[:, :3, 3:5, 2:7].any() and field.u.v[0, 0, 3, 1] == np.float32(3.02)
    (tmp_path / "solid_c.txt").write_text("9 1 1\n")
    with pytest.raises(FieldError, match="outside"):
        read(path)


@pytest.mark.parametrize("with_mask", [True, False])
def test_tiles_are_joined_and_the_house_stands(tmp_path, with_mask):
    field = packable(read(dump(tmp_path, with_mask)))
    assert field.t.tolist() == [0.0, 10.0]
    np.testing.assert_allclose(field.u.x, D * np.arange(N))
    assert field.u.v[0, 5, 0, 7] == 8.0 and field.u.v[1, 5, 0, 7] == 16.0
    assert field.top.max() == pytest.approx(6.0)
    np.testing.assert_array_equal(np.argwhere(field.top > 1.0), np.argwhere(np.pad(np.ones((2, 4)), ((3, 3), (2, 2)))))  # fmt: skip


def test_a_tile_that_is_missing_is_told(tmp_path):
    path = dump(tmp_path)
    for tile in (0, 1):
        source = tmp_path / f"fielddump.{tile:03d}.000.007.nc"
        (tmp_path / f"fielddump.{tile:03d}.001.007.nc").write_bytes(source.read_bytes())
    (tmp_path / "fielddump.001.001.007.nc").unlink()
    with pytest.raises(FieldError, match="3 tiles of 2 x 2"):
        read(path)


@pytest.mark.parametrize("kind", [os.mkfifo, os.mkdir, lambda path: path.write_text("x_m\n")])
def test_a_tile_that_is_no_file_of_wind_is_refused_without_waiting(tmp_path, kind):
    path = dump(tmp_path)
    other = tmp_path / "fielddump.001.000.007.nc"
    other.unlink()
    kind(other)
    with pytest.raises(FieldError, match=other.name):
        read(path)


def test_tiles_of_other_sizes_are_refused(tmp_path):
    path = dump(tmp_path)
    with netcdf_file(path, "r", mmap=False) as file:
        sizes = {name: 3 if name[0] == "y" else n for name, n in file.dimensions.items()}
        made = [(name, of.dimensions, np.array(of[:])) for name, of in file.variables.items()]
    with netcdf_file(tmp_path / "fielddump.001.000.007.nc", "w", version=2) as file:
        for name, n in sizes.items():
            file.createDimension(name, n)
        for name, dims, values in made:
            places = tuple(slice(3 if d[0] == "y" else None) for d in dims)
            file.createVariable(name, "f", dims)[:] = values[places]
    with pytest.raises(FieldError, match=r"001\.000\.007\.nc: yt is 3 values"):
        read(path)


def _shifted(name, by):
    def change(file):
        file.variables[name].data[:] += np.float32(by)

    return change


def _in_km_h(file):
    file.variables["u"].units = b"km/h"


def _without_numbers(file):
    file.variables["mask_c"].data[:] = np.nan


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_shifted("time", 990.0), "time is 2 values from 1000 to 1010"),
        (_shifted("zt", 0.5), "zt is 8 values"),
        (_shifted("ym", 500.0), "ym is 8 values"),
        (_shifted("xt", 100.0), "xt and xm do not fit"),
        (_in_km_h, "u is in 'km/h'"),
        (_without_numbers, "mask_c has values that are not finite"),
    ],
)
def test_a_tile_that_contradicts_the_others_is_refused_by_its_name(tmp_path, change, said):
    path = dump(tmp_path)
    other = tmp_path / "fielddump.001.000.007.nc"
    with netcdf_file(other, "a") as file:
        change(file)
    with pytest.raises(FieldError, match=f"{other.name}: {said}"):
        read(path)


def test_a_tile_elsewhere_is_refused(tmp_path):
    path = dump(tmp_path)
    with netcdf_file(tmp_path / "fielddump.001.000.007.nc", "a") as file:
        _shifted("xt", 50.0)(file)
        _shifted("xm", 50.0)(file)
    with pytest.raises(FieldError, match=r"begins at x = 58 m: .* ends at 8 m"):
        read(path)


@pytest.mark.parametrize("numbers", [(0, 2), (1, 2)])
def test_numbers_of_tiles_begin_at_0_and_have_no_gap(tmp_path, numbers):
    dump(tmp_path)
    for old, new in ((1, numbers[1]), (0, numbers[0])):
        at = tmp_path / f"fielddump.{new:03d}.000.007.nc"
        (tmp_path / f"fielddump.{old:03d}.000.007.nc").rename(at)
    missing = ({0, 1, 2} - set(numbers)).pop()
    with pytest.raises(FieldError, match=f"number {missing:03d} along x are missing"):
        read(at)


def test_a_mask_in_one_tile_alone_is_refused(tmp_path):
    (tmp_path / "masked").mkdir()
    path = dump(tmp_path, with_mask=False)
    masked = dump(tmp_path / "masked")
    path.write_bytes(masked.read_bytes())
    with pytest.raises(FieldError, match=r"001\.000\.007\.nc: mask_c is missing"):
        read(path)
