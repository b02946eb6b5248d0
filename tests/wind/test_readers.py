"""Readers of fields: what they make of files of each layout, and of files that are broken."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import h5netcdf
import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from scipy.io import netcdf_file

from gcs_tools.cli.wind import wind
from gcs_tools.wind_fields.check import divergence
from gcs_tools.wind_fields.files import read
from gcs_tools.wind_fields.grid import packable
from sitl_plant.physics.wind.packed_field import FieldError, opened

N, D, FILL = 8, 2.0, -999999.0  # cells along each axis, their size (m), PALM's fill value
BLOCK = np.s_[:3, 3:5, 3:5]  # of cells: a building of 6 m


def faces(value: float, axis: int, times: int = 1):
    """float32[t, z, y, x] of cells with `value`, and fill where a face has a wall on a side."""
    solid = np.zeros((N, N, N), dtype=bool)
    solid[BLOCK] = True
    before = np.roll(solid, 1, axis=axis)
    v = np.full((times, N, N, N), value, dtype=np.float32)
    v[:, solid | before] = FILL
    return v


def palm(
    path: Path, times: int = 1, units: str = "m/s", fill: float = FILL, flip_z: bool = False
) -> Path:
    """A file in the layout of PALM's DATA_3D_NETCDF, classic with 64-bit offsets."""
    with netcdf_file(path, "w", version=2) as file:
        file.origin_lat, file.rotation_angle = 52.5, 0.0
        centre, edge = D * (np.arange(N) + 0.5), D * np.arange(N)
        zu = np.concatenate(([0.0], centre))
        axes = {
            "x": centre,
            "xu": edge,
            "y": centre,
            "yv": edge,
            "zu_3d": zu,
            "zw_3d": D * np.arange(N + 1),
        }
        file.createDimension("time", None)
        time = file.createVariable("time", "d", ("time",))
        for name, values in axes.items():
            file.createDimension(name, len(values))
            axis = file.createVariable(name, "d", (name,))
            axis[:], axis.units = values[::-1] if flip_z and name == "zu_3d" else values, b"meters"
        for name, dims, number, speed in (
            ("u", ("time", "zu_3d", "y", "xu"), 2, 3.0), ("v", ("time", "zu_3d", "yv", "x"), 1, 1.0),
            ("w", ("time", "zw_3d", "y", "x"), 0, 0.0),
        ):  # fmt: skip
            given = file.createVariable(name, "f", dims)
            v = faces(speed, number, times)
            first = np.full((times, 1, N, N), FILL, dtype=np.float32)  # the level on the ground
            v = (
                np.concatenate((first, v), axis=1)
                if name != "w"
                else np.concatenate((v, v[:, -1:]), axis=1)
            )
            v[v == FILL] = fill
            if flip_z and name != "w":
                v = v[:, ::-1]
            given[:], given.units = v, units.encode()
            given._FillValue = np.float32(fill)
        time[:] = 301.03 + 10.0 * np.arange(times)
    return path


def csv(
    path: Path, columns: str = "x_m,y_m,z_m,u_m_s,v_m_s,w_m_s", skip=lambda x, y, z: False
) -> Path:
    lines = [columns]
    for z in range(4):
        for y in range(5):
            lines += [
                f"{x},{y},{z},{1 + 0.5 * x},{2 - 0.5 * y},0" for x in range(6) if not skip(x, y, z)
            ]
    path.write_text("\n".join(lines) + "\n")
    return path


def qes(path: Path, workspace: bool) -> Path:
    """A file in the layout of QES-Winds, of cells or of faces, with faces named wrongly as QES does."""
    centre = D * (np.arange(N) + 0.5)
    solid = np.zeros((N, N, N), dtype=bool)
    solid[BLOCK] = True
    with h5netcdf.File(path, "w") as file:
        of = {"t": 1, "x": N, "y": N, "z": N}
        if workspace:
            of |= {"x_face": N + 1, "y_face": N + 1, "z_face": N + 1}
        file.dimensions = of
        for name in "xyz":
            file.create_variable(name, (name,), data=centre)
        if workspace:
            file.create_variable("x_face", ("x_face",), data=np.arange(N + 1) * 7.7)
        flags = np.where(solid, 0, 1).astype(np.int32)[None]
        file.create_variable(
            "icellflag" if workspace else "icell", ("t", "z", "y", "x"), data=flags
        )
        dims = ("t", "z_face", "y_face", "x_face") if workspace else ("t", "z", "y", "x")
        for name, speed in (("u", 3.0), ("v", 1.0), ("w", 0.0)):
            n = N + 1 if workspace else N
            v = np.full((1, n, n, n), speed, dtype=np.float32)
            v[0, BLOCK[0], BLOCK[1], BLOCK[2]] = 0.0
            file.create_variable(name, dims, data=v)
    return path


def test_a_file_that_palm_wrote_is_met_where_palm_has_its_faces():
    """One building of 3 x 4 x 4 cells. PALM's solver knows no walls: away from them nothing diverges."""
    grid = read(Path(__file__).parent / "palm_building.nc")
    field = packable(grid)
    assert (field.u.x[0], field.v.x[0], field.v.y[0], field.u.y[0]) == (0.0, 2.0, 0.0, 2.0)
    assert (field.w.z[0], field.u.z[0], len(field.t)) == (0.0, 2.0, 1)
    assert (np.argwhere(field.top == 16.0)[[0, -1]] == [[4, 6], [7, 8]]).all()
    assert (field.top > 0.0).sum() == 3 * 4
    above = [part._replace(v=part.v[:, 5:-2], z=part.z[5:-2]) for part in (field.u, field.v)]
    w = field.w._replace(v=field.w.v[:, 5:-2], z=field.w.z[5:-2])
    assert divergence(field._replace(u=above[0], v=above[1], w=w)) < 1e-6
    assert 1e-3 < divergence(field) < 1e-2


def test_a_file_that_qes_wrote_has_its_building_and_closed_walls():
    """One building of 3 x 4 x 4 cells, of values at centres."""
    field = packable(read(Path(__file__).parent / "qes_building.nc"))
    assert (np.argwhere(field.top == 16.0)[[0, -1]] == [[4, 5], [7, 7]]).all()
    assert (field.top > 0.0).sum() == 3 * 4
    assert not field.u.v[0, :4, 4:8, 5:9].any() and not field.w.v[0, 4, 4:8, 5:8].any()
    assert 3.0 < field.u.v.max() < 10.0 and field.w.v.max() > 0.5


@pytest.mark.parametrize("fill", [FILL, -9999.0])
def test_palms_faces_stand_where_palm_has_them_and_fill_is_a_building(tmp_path, fill):
    field = packable(read(palm(tmp_path / "p.nc", times=3, fill=fill)))
    assert field.t.tolist() == [0.0, 10.0, 20.0]
    assert (
        field.u.x[:2].tolist() == [0.0, D] and field.u.z[0] == 0.5 * D
    )  # the level of fill is left out
    assert field.top.max() == 6.0 and (field.top == 6.0).sum() == 4
    assert field.u.v[0, 0, 3, 3] == 0.0  # the wall at x = 6
    assert field.u.v[0, 0, 0, 0] == 3.0 and field.v.v[0, 0, 0, 0] == 1.0


def test_axes_that_fall_are_turned_and_it_is_said(tmp_path):
    straight = packable(read(palm(tmp_path / "a.nc")))
    grid = read(palm(tmp_path / "b.nc", flip_z=True))
    turned = packable(grid)
    assert turned.u.z.tolist() == straight.u.z.tolist() or "z" in " ".join(grid.notes)
    assert (np.diff(turned.u.z) > 0.0).all()


@pytest.mark.parametrize("workspace", [False, True])
def test_both_files_of_qes_give_the_same_building_and_closed_walls(tmp_path, workspace):
    field = packable(read(qes(tmp_path / "q.nc", workspace)))
    assert field.top.max() == 6.0 and (field.top == 6.0).sum() == 4
    np.testing.assert_allclose(field.u.x, D * np.arange(N + 1))  # not QES' own x_face
    assert field.u.v[0, 0, 3, 3] == 0.0
    assert field.u.v[0, 0, 0, 4] == 3.0


def test_a_table_without_buildings_is_linear_between_its_places(tmp_path):
    field = packable(read(csv(tmp_path / "c.csv")))
    assert field.u.x.tolist() == [0, 1, 2, 3, 4, 5]
    assert field.u.v[0, 1, 2, 3] == 2.5


def test_places_that_a_table_leaves_out_are_buildings_that_nothing_flows_through(tmp_path):
    grid = read(csv(tmp_path / "c.csv", skip=lambda x, y, z: 2 <= x <= 3 and y == 2 and z <= 1))
    field = packable(grid)
    assert field.top[2, 2] == field.top[2, 3] == 1.5
    assert field.u.v[0, 0, 2, 2] == field.u.v[0, 0, 2, 4] == 0.0
    assert np.isfinite(divergence(field))


def test_rotors_text_is_met_at_its_levels(tmp_path):
    text = "min_x:\n0\nmin_y:\n0\nn_x:\n3\nn_y:\n2\nres_x:\n10\nres_y:\n10\nvertical_spacing_factors:\n0 0.5 1\n"
    text += "bottom_z:\n0 0 0 0 0 0\ntop_z:\n40 40 40 40 40 40\n"
    u = np.repeat([0.0, 4.0, 8.0], 6)
    for name, values in (("u", u), ("v", 0 * u), ("w", 0 * u)):
        text += f"{name}:\n{' '.join(map(str, values))}\n"
    (tmp_path / "r.txt").write_text(text)
    field = packable(read(tmp_path / "r.txt"))
    np.testing.assert_allclose(field.u.v[0, :, 0, 0], field.u.z * 0.2, rtol=1e-6)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda p: palm(p / "x.nc", units="km/h"), "u is in 'km/h': expected"),
        (lambda p: csv(p / "x.csv", "x_m,y_m,z_m,u_m_s,v_m_s,up"), "not so: w_m_s"),
        (
            lambda p: csv(p / "x.csv", "x_m,y_m,z_m,u_m_s,v_m_s,w_m_s,p"),
            "line 2 has 6 values: expected 7",
        ),
    ],
)
def test_a_field_that_would_be_wrong_is_an_error(tmp_path, make, said):
    with pytest.raises(FieldError, match=said):
        packable(read(make(tmp_path)))


def test_values_that_are_no_wind_and_gaps_that_move_are_errors(tmp_path):
    lines = csv(tmp_path / "x.csv").read_text()
    (tmp_path / "x.csv").write_text(lines.replace("3.5,2.0,0", "9999.0,2.0,0"))
    with pytest.raises(FieldError, match="which number means none"):
        packable(read(tmp_path / "x.csv"))
    header, *rows = lines.split()
    moving = [f"{t},{row}" for t in (0, 1) for k, row in enumerate(rows) if k != 7 + t]
    (tmp_path / "x.csv").write_text("\n".join([f"t_s,{header}", *moving]))
    with pytest.raises(FieldError, match="gaps that come and go"):
        packable(read(tmp_path / "x.csv"))


@pytest.mark.parametrize("kind", ["palm", "qes", "csv", "rotors"])
def test_broken_files_are_errors_or_fields_that_are_finite(tmp_path, kind):
    """50 files of each kind, cut, or with bytes changed: each is refused, or its field is finite and slow."""
    made = {
        "palm": lambda: palm(tmp_path / "x.nc", times=2), "qes": lambda: qes(tmp_path / "x.nc", False),
        "csv": lambda: csv(tmp_path / "x.csv"), "rotors": lambda: rotors(tmp_path / "x.txt"),
    }[kind]()  # fmt: skip
    whole, random = made.read_bytes(), np.random.default_rng(33)
    refused = 0
    for _ in range(50):
        data = bytearray(whole)
        if random.uniform() < 0.4:
            data = data[: random.integers(0, len(data))]
        else:
            for at in random.integers(0, len(data), random.integers(1, 40)):
                data[at] = random.integers(0, 256)
        made.write_bytes(bytes(data))
        try:
            field = packable(read(made))
        except FieldError as error:
            refused += 1
            assert str(made) in str(error)  # noqa: PT017
            continue
        for part in (field.u, field.v, field.w):
            assert np.isfinite(part.v).all() and np.abs(part.v).max() <= 150.0
            assert all((np.diff(axis) > 0.0).all() for axis in (part.x, part.y, part.z))
    assert refused > 10


def rotors(path: Path) -> Path:
    text = (
        "min_x: 0\nmin_y: 0\nn_x: 2\nn_y: 2\nres_x: 10\nres_y: 10\nvertical_spacing_factors: 0 1\n"
    )
    text += "bottom_z: 0 0 0 0\ntop_z: 40 40 40 40\n" + "".join(
        f"{n}: 1 2 3 4 5 6 7 8\n" for n in "uvw"
    )
    path.write_text(text)
    return path


def gcs(*arguments: str):
    return CliRunner().invoke(wind, list(arguments))


def test_a_file_is_checked_and_packed_for_a_mission(tmp_path):
    path, out = palm(tmp_path / "p.nc"), tmp_path / "p.field"
    checked = gcs("check", str(path), "--json")
    assert checked.exit_code == 0, checked.output
    told = json.loads(checked.stdout)
    assert told["kind"] == "PALM" and "up to 6 m" in told["buildings"]
    assert gcs("pack", str(path), str(out)).exit_code == 0
    assert opened(out).about["kind"] == "PALM"
    assert json.loads(gcs("check", str(out), "--json").stdout)["kind"] == "PALM"
    assert gcs("pack", str(path), str(out)).exit_code == 2  # it is there
    (tmp_path / "no.nc").write_text("nothing")
    assert gcs("check", str(tmp_path / "no.nc")).exit_code == 2


@pytest.mark.parametrize(("scale", "said"), [
    (1e308, "x: expected places up to"), (5e-324, "x: expected places 1e-06 m apart"), (math.nan, "finite"),
])  # fmt: skip
def test_places_that_are_nowhere_are_errors_and_not_warnings(tmp_path, scale, said):
    rows = [f"{x * scale},{y},{z},1,0,0" for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    (tmp_path / "x.csv").write_text("\n".join(["x_m,y_m,z_m,u_m_s,v_m_s,w_m_s", *rows]))
    with pytest.raises(FieldError, match=said):
        packable(read(tmp_path / "x.csv"))


@pytest.mark.parametrize("name", ["x.nc", "x.vtu", "x.csv"])
@pytest.mark.parametrize("kind", [os.mkfifo, os.mkdir])
def test_what_is_no_file_is_refused_without_waiting(tmp_path, name, kind):
    kind(tmp_path / name)
    with pytest.raises(FieldError, match=name):
        read(tmp_path / name)


def _outside(file, folder):
    del file["u"]
    (folder / "secret").write_bytes(b"s" * 4 * N**3)
    file.create_dataset("u", (1, N, N, N), "f4", external=[(str(folder / "secret"), 0, 4 * N**3)])


def _linked(file, folder):
    del file["u"]
    file["u"] = h5py.ExternalLink(str(folder / "pipe"), "/u")


def _virtual(file, folder):
    del file["u"]
    layout = h5py.VirtualLayout((1, N, N, N), "f4")
    layout[:] = h5py.VirtualSource(str(folder / "secret"), "u", (1, N, N, N))
    file.create_virtual_dataset("u", layout)


def _of(value):
    def replaced(file, folder):
        del file["u"]
        file.create_dataset("u", data=np.full((1, N, N, N), value))

    return replaced


def _claims(file, folder):
    del file["u"]
    file.create_dataset(
        "u", (1 << 23, N, N, N), "f4", chunks=(1, N, N, N)
    )  # of which none is written


def _units(file, folder):
    file["u"].attrs["units"] = np.array([1, 2, 3])


@pytest.mark.parametrize(("change", "said"), [
    (_outside, "u leads to another file"), (_linked, "u leads to another file"), (_virtual, "u leads to another file"),
    (_of(b"x"), "u has no real numbers"), (_of(1j), "u has no real numbers"), (_units, r"u is in '\[1 2 3\]'"),
    (_claims, "GiB at most"),
])  # fmt: skip
def test_values_that_are_elsewhere_or_no_numbers_are_refused(tmp_path, change, said):
    path = qes(tmp_path / "q.nc", workspace=False)
    os.mkfifo(tmp_path / "pipe")
    with h5py.File(path, "r+") as file:
        change(file, tmp_path)
    with pytest.raises(FieldError, match=said):
        read(path)


def _repacked(path, scale=None, offset=None, fill=None):
    """Give the velocities of a file of PALM other attributes, and other numbers that mean the same."""
    with netcdf_file(path, "a") as file:
        for name in "uvw":
            of = file.variables[name]
            gaps = of.data == np.float32(FILL)
            of.data[:] = (of.data - (offset or 0.0)) / (scale or 1.0)
            of.data[gaps] = FILL if fill is None else fill
            if scale is not None:
                of.scale_factor = scale
            if offset is not None:
                of.add_offset = offset
            if fill is not None:
                del of._attributes["_FillValue"]
                of.missing_value = np.float32(fill)
    return path


@pytest.mark.parametrize("how", [{"scale": 0.5, "offset": 2.0}, {"fill": 99.0}, {"scale": 0.1}])
def test_packed_values_are_unpacked_and_a_missing_value_is_a_gap(tmp_path, how):
    plain = packable(read(palm(tmp_path / "a.nc")))
    field = packable(read(_repacked(palm(tmp_path / "b.nc"), **how)))
    np.testing.assert_allclose(field.u.v, plain.u.v, atol=1e-6)
    np.testing.assert_array_equal(field.top, plain.top)


@pytest.mark.parametrize("scale", [0.0, math.nan, b"a half"])
def test_a_packing_that_is_none_is_refused(tmp_path, scale):
    path = palm(tmp_path / "a.nc")
    with netcdf_file(path, "a") as file:
        file.variables["u"].scale_factor = scale
    with pytest.raises(FieldError, match=r"u: (expected one finite|scale_factor is no number)"):
        read(path)


def test_a_lack_of_memory_and_a_write_that_is_cut_short_are_told_in_words(tmp_path, monkeypatch):
    def lacking(*_):
        raise MemoryError

    def short(*_):
        raise OSError("2880 requested and 480 written")  # NumPy's, without a number

    path = palm(tmp_path / "a.nc")
    monkeypatch.setattr("gcs_tools.wind_fields.grid.save", short)
    assert "is the disk full?" in gcs("pack", str(path), str(tmp_path / "out.field")).output
    monkeypatch.setattr("gcs_tools.wind_fields.netcdf._classic", lacking)
    with pytest.raises(FieldError, match="not enough memory"):
        read(path)


@pytest.mark.parametrize("head", [b"# vtk DataFile Version 3.0\n", b"CDF\x01"])
def test_a_file_larger_than_is_read_is_refused_before(tmp_path, head):
    path = tmp_path / "sparse"
    path.write_bytes(head)
    os.truncate(path, 9 << 30)
    with pytest.raises(FieldError, match="9 GiB: expected 8 GiB at most"):
        read(path)
