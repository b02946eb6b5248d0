"""VTK files: two that OpenFOAM's own foamToVTK wrote, and each way to write an array.

openfoam_house.vtk and .vtu are one flow (simpleFoam of OpenFOAM 1912, snappyHexMesh): 5 m/s to East about a house of
16 m on 16 to 32 m East and 12 to 28 m North, in cells of 4 and 8 m, of which 64 are polyhedra.
"""

from __future__ import annotations

import base64
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from gcs_tools.cli.wind import wind
from gcs_tools.wind_fields import mesh, vtk, vtk_file
from gcs_tools.wind_fields.files import read
from gcs_tools.wind_fields.grid import packable
from sitl_plant.physics.wind.packed_field import FieldError

HERE = Path(__file__).parent
LEGACY, XML = HERE / "openfoam_house.vtk", HERE / "openfoam_house.vtu"
SLOPE = np.array([[0.1, -0.2, 0.05], [0.0, 0.1, 0.3], [-0.1, 0.02, -0.1]])  # 1/s


@pytest.mark.parametrize("path", [LEGACY, XML])
def test_a_file_of_openfoam_has_its_house_and_no_wind_through_its_walls(path):
    grid = read(path)
    u = grid.parts["u"]
    z, y, x = np.meshgrid(u.z, u.y, u.x, indexing="ij")
    house = (x > 16) & (x < 32) & (y > 12) & (y < 28) & (z < 16)
    np.testing.assert_array_equal(np.isnan(u.v[0]), house)
    assert u.v[0, :, :, 0] == pytest.approx(
        5.0, abs=1.5
    )  # the inlet, 2 m upwind of the first centres
    assert np.nanmax(u.v) > 6.0  # around the house
    field = packable(grid)
    assert field.top.max() == pytest.approx(16.0, abs=1e-4)
    wall = (abs(field.u.x - 16.0) < 1.0).nonzero()[0][0]
    beside = (field.u.y > 12) & (field.u.y < 28)
    assert (field.u.v[0][:4][:, beside, wall] == 0.0).all()


def test_both_files_are_the_same_flow():
    one, other = vtk_file.read(LEGACY), vtk_file.read(XML)
    np.testing.assert_array_equal(one.points, other.points)
    np.testing.assert_array_equal(one.of_cells["U"], other.of_cells["U"])
    assert one.cells.types.tolist() == other.cells.types.tolist()
    assert [len(f) for f in one.cells.faces.values()] == [
        len(f) for f in other.cells.faces.values()
    ]


def test_linear_wind_is_met_to_rounding_in_cells_of_any_shape():
    contents = vtk_file.read(LEGACY)
    made = mesh.mesh(contents.points, contents.cells)
    wind = {"U": contents.points @ SLOPE.T}
    grid = vtk._resampled(
        contents._replace(of_points=wind, of_cells={"U": made.centre @ SLOPE.T}), ""
    )
    u = grid.parts["u"]
    z, y, x = np.meshgrid(u.z, u.y, u.x, indexing="ij")
    for row, name in zip(SLOPE, "uvw", strict=True):
        wanted = row[0] * x + row[1] * y + row[2] * z
        error = grid.parts[name].v[0] - wanted
        assert np.nanmax(np.abs(error)) < 1e-5


def test_each_kind_of_cell_holds_the_places_in_it():
    """A cube as two wedges, as a hexahedron, a voxel, six pyramids and five tetrahedra."""
    cube = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    points = np.concatenate((cube, [[0.5, 0.5, 0.5]]))
    of = {
        12: [[0, 1, 3, 2, 4, 5, 7, 6]],
        11: [[0, 1, 2, 3, 4, 5, 6, 7]],
        13: [[0, 1, 2, 4, 5, 6], [1, 3, 2, 5, 7, 6]],
        14: [[0, 1, 3, 2, 8], [4, 5, 7, 6, 8], [0, 1, 5, 4, 8], [2, 3, 7, 6, 8], [0, 2, 6, 4, 8], [1, 3, 7, 5, 8]],
        10: [[0, 1, 2, 4], [1, 2, 3, 7], [1, 4, 5, 7], [2, 4, 6, 7], [1, 2, 4, 7]],
    }  # fmt: skip
    axes = tuple(np.sort(np.random.default_rng(1).uniform(-0.5, 1.5, (3, 9))))
    places = np.stack(np.meshgrid(*axes[::-1], indexing="ij")[::-1], axis=-1)
    inside = ((places > 0.0) & (places < 1.0)).all(axis=-1)
    far = (np.abs(places - 0.5) > 0.6).any(axis=-1)
    for kind, corners in of.items():
        flat = np.array(corners)
        cells = vtk_file.Cells(np.full(len(flat), kind), flat.ravel(), np.arange(len(flat) + 1) * flat.shape[1], {})  # fmt: skip
        found = mesh.cells_at(mesh.mesh(points, cells), points, axes)
        assert (found[inside] >= 0).all() and (found[far] < 0).all(), kind


def array(values, way: str, offsets: list[bytes], packed: bool) -> str:
    """A DataArray as VTK writes it."""
    values = np.asarray(values, dtype="<f4")
    head, data = np.uint32(values.nbytes).tobytes(), values.tobytes()
    if packed:
        middle = len(data) // 2
        blocks = [zlib.compress(data[:middle]), zlib.compress(data[middle:])]
        head = np.array([2, middle, len(data) - middle, *map(len, blocks)], dtype="<u4").tobytes()
        data = b"".join(blocks)
    tag = '<DataArray type="Float32" Name="U" NumberOfComponents="3" format="'
    if way == "ascii":
        return f'{tag}ascii">{" ".join(map(str, values.ravel()))}</DataArray>'
    coded = base64.b64encode(head) + base64.b64encode(data) if packed else base64.b64encode(head + data)  # fmt: skip
    if way == "binary":
        return f'{tag}binary">{coded.decode()}</DataArray>'
    offset = sum(map(len, offsets))
    offsets.append(head + data if way == "raw" else coded)
    return f'{tag}appended" offset="{offset}"/>'


@pytest.mark.parametrize("way", ["ascii", "binary", "raw", "base64"])
@pytest.mark.parametrize("packed", [False, True])
def test_a_picture_is_read_however_its_arrays_are_written(tmp_path, way, packed):
    v = np.arange(2 * 3 * 4 * 3, dtype=np.float32).reshape(-1, 3) / 10.0
    offsets: list[bytes] = []
    written = array(v, way, offsets, packed)
    compressor = ' compressor="vtkZLibDataCompressor"' if packed else ""
    text = (
        f'<VTKFile type="ImageData" byte_order="LittleEndian"{compressor}><ImageData WholeExtent="0 3 0 2 0 1" '
        f'Origin="10 20 0" Spacing="1 2 3"><Piece Extent="0 3 0 2 0 1"><PointData>{written}</PointData></Piece></ImageData>'
    ).encode()  # fmt: skip
    if offsets:
        encoding = "raw" if way == "raw" else "base64"
        text += f'<AppendedData encoding="{encoding}">_'.encode() + b"".join(offsets) + b"</AppendedData>"  # fmt: skip
    (tmp_path / "f.vti").write_bytes(text + b"</VTKFile>")
    part = read(tmp_path / "f.vti").parts["v"]
    assert part.x.tolist() == [10, 11, 12, 13] and part.y.tolist() == [20, 22, 24]
    np.testing.assert_array_equal(part.v.ravel(), v[:, 1])


@pytest.mark.parametrize(("blocks", "size", "said"), [
    (1, 1000, "more than its 1000 bytes"), (1 << 20, 1 << 20, "GiB at most"),
])  # fmt: skip
def test_a_picture_that_unpacks_to_more_than_it_says_or_than_is_read_is_refused(
    tmp_path, blocks, size, said
):
    bomb = zlib.compress(bytes(1 << 20))
    head = np.array([blocks, size, 0, len(bomb)], dtype="<u4").tobytes()
    coded = (base64.b64encode(head) + base64.b64encode(bomb)).decode()
    (tmp_path / "f.vti").write_text(
        '<VTKFile type="ImageData" byte_order="LittleEndian" compressor="vtkZLibDataCompressor"><ImageData WholeExtent="0 3 0 2 0 1" '
        'Origin="0 0 0" Spacing="1 1 1"><Piece Extent="0 3 0 2 0 1"><PointData><DataArray type="Float32" Name="U" '
        f'NumberOfComponents="3" format="binary">{coded}</DataArray></PointData></Piece></ImageData></VTKFile>'
    )  # fmt: skip
    with pytest.raises(FieldError, match=said):
        read(tmp_path / "f.vti")


def test_a_regular_legacy_file_is_read(tmp_path):
    (tmp_path / "f.vtk").write_text(
        "# vtk DataFile Version 3.0\nwind\nASCII\nDATASET RECTILINEAR_GRID\nDIMENSIONS 2 2 2\n"
        "X_COORDINATES 2 float\n0 1\nY_COORDINATES 2 float\n0 2\nZ_COORDINATES 2 float\n0 4\n"
        "POINT_DATA 8\nSCALARS p float\nLOOKUP_TABLE default\n0 0 0 0 0 0 0 0\nVECTORS wind float\n"
        + "1 2 3\n" * 7 + "4 5 6\n"
    )  # fmt: skip
    grid = read(tmp_path / "f.vtk")
    assert grid.parts["w"].v[0, 1, 1, 1] == 6.0 and grid.parts["u"].z.tolist() == [0.0, 4.0]


def test_a_file_that_is_cut_or_damaged_is_refused_with_a_reason(tmp_path):
    for source in (LEGACY, XML):
        data, random = source.read_bytes(), np.random.default_rng(1)
        for k in range(40):
            cut = bytearray(data[: int(random.integers(200, len(data)))])
            if k % 2:
                cut = bytearray(data)
                for at in random.integers(0, len(data), 30).tolist():
                    cut[at] = int(random.integers(256))
            path = tmp_path / f"broken{k}{source.suffix}"
            path.write_bytes(bytes(cut))
            with suppress(FieldError):  # nothing else
                packable(read(path))


def test_a_file_without_a_velocity_or_a_volume_is_refused(tmp_path):
    data = LEGACY.read_bytes()
    (tmp_path / "f.vtk").write_bytes(data.replace(b"U 3 ", b"B 2 "))
    with pytest.raises(FieldError):
        read(tmp_path / "f.vtk")
    (tmp_path / "g.vtk").write_text("# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\n")
    with pytest.raises(FieldError, match="POLYDATA: expected UNSTRUCTURED_GRID"):
        read(tmp_path / "g.vtk")


POINTS = "0 0 0 1 0 0 1 1 0 0 1 0 0 0 1 1 0 1 1 1 1 0 1 1"
CUBE = {"points": POINTS, "cells": "8 0 1 2 3 4 5 6 7", "type": "12", "wind": "1 0 0 " * 8}


def legacy_cube(folder, **changed):
    """A file of one cell."""
    of = {**CUBE, **changed}
    (folder / "cube.vtk").write_text(
        "# vtk DataFile Version 2.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 double\n"
        f"{of['points']}\nCELLS 1 {len(of['cells'].split())}\n{of['cells']}\nCELL_TYPES 1\n{of['type']}\n"
        f"POINT_DATA 8\nVECTORS U float\n{of['wind']}\n"
    )
    return folder / "cube.vtk"


def ascii_array(name, kind, values, width=1):
    return f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{width}" format="ascii">{values}</DataArray>'


def xml_cube(folder, corners="0 1 2 3 4 5 6 7", offsets="8", types="12", kind="Int32", n=1, head="", wind=None, faces=None):  # fmt: skip
    """A file of one cell, with the faces that are given."""
    more = "" if faces is None else ascii_array("faces", "Int64", faces[0]) + ascii_array("faceoffsets", "Int64", faces[1])  # fmt: skip
    wind = ascii_array("U", "Float32", "1 0 0 " * 8, 3) if wind is None else wind
    (folder / "cube.vtu").write_text(
        f'{head}<VTKFile type="UnstructuredGrid" byte_order="LittleEndian"><UnstructuredGrid>'
        f'<Piece NumberOfPoints="8" NumberOfCells="{n}"><PointData>{wind}</PointData>'
        f"<Points>{ascii_array('Points', 'Float32', POINTS, 3)}</Points>"
        f"<Cells>{ascii_array('connectivity', kind, corners)}{ascii_array('offsets', 'Int32', offsets)}"
        f"{ascii_array('types', 'UInt8', types)}{more}</Cells></Piece></UnstructuredGrid></VTKFile>"
    )
    return folder / "cube.vtu"


def test_the_cube_is_a_field_in_both_formats(tmp_path):
    for path in (legacy_cube(tmp_path), xml_cube(tmp_path)):
        assert packable(read(path)).u.v.ravel().tolist() == [1.0]


@pytest.mark.parametrize(("changed", "said"), [
    ({"cells": "3 2147483647 -1 0", "type": "42"}, "a face of -1 corners"),  # went round for ever
    ({"cells": "1 0", "type": "42"}, "no faces"), ({"cells": "8 3 0 3 0 1 2 1 3", "type": "42"}, "a face of 0 corners"),
    ({"cells": "4 0 1 2 3"}, "cell 0 of VTK's type 12 has 4 corners: expected 8"),
    ({"cells": "8 0 1 2 3 4 5 nan 7"}, "nan is no whole number"), ({"cells": "8 0 1 2 3 4 5 6 7 9"}, "cells of 9 numbers"),
    ({"points": POINTS.replace("1 1 1", "1e308 1e308 1")}, "expected places up to"),
    ({"points": POINTS.replace("1 1 1", "nan 1 1")}, "expected finite places"),
    ({"wind": "inf 0 0 " * 8}, "values that are not finite"),
])  # fmt: skip
def test_cells_that_cannot_be_are_refused_with_a_reason(tmp_path, changed, said):
    with pytest.raises(FieldError, match=said):
        packable(read(legacy_cube(tmp_path, **changed)))


def binary(text: str) -> str:
    return f'<DataArray type="Float32" Name="U" NumberOfComponents="3" format="binary">{text}</DataArray>'


@pytest.mark.parametrize(("changed", "said"), [
    ({"types": "42", "faces": ("9000000000000 -1", "2")}, "a face of -1 corners"),
    ({"types": "42"}, "polyhedron without faces"), ({"types": "42", "faces": ("1 3 0 1 2", "-1")}, "polyhedron without faces"),
    ({"corners": "0 1 2 3"}, "ends at corner 8 of 4"), ({"offsets": "9999"}, "ends at corner 9999 of 8"),
    ({"offsets": "8 -5 3", "types": "12 12 12", "n": 3}, "offsets of cells fall"),
    ({"types": "12 12 12", "n": 3}, "1 offsets of 3 cells"), ({"n": 2}, "NumberOfCells is 2, and there are 1"),
    ({"kind": "Float64"}, "corners of cells are float64"), ({"corners": "0 1 2 3 4 5 6 99"}, "corners that are no points"),
    ({"head": '<?xml version="1.0" encoding="bogus"?>'}, "unknown encoding"),
    ({"head": '<?xml version="1.0" encoding="hex"?>'}, "not a text encoding"),
    ({"wind": binary("!!!!$$$$%%%%====garbage")}, "no base64"), ({"wind": binary("")}, "ends before its 4 bytes"),
])  # fmt: skip
def test_arrays_that_contradict_one_another_are_refused_with_a_reason(tmp_path, changed, said):
    with pytest.raises(FieldError, match=said):
        packable(read(xml_cube(tmp_path, **changed)))


@pytest.mark.parametrize("width", [1, 3])
def test_the_name_of_an_array_reaches_no_terminal_as_it_is(tmp_path, width):
    name = "&#x9b;31m&#x202e;X&#10;Error: forged"
    path = xml_cube(
        tmp_path, wind=ascii_array(name, "Float32", "1 0 0 " * 8 if width == 3 else "1 " * 8, width)
    )
    done = CliRunner().invoke(wind, ["check", str(path)])
    assert done.exit_code == (0 if width == 3 else 2)
    assert all(line.isprintable() for line in done.output.split("\n"))
    assert "\nError: forged" not in done.output


@pytest.mark.parametrize("far_m", [1e3, 1e6])
def test_a_point_far_from_the_others_is_refused_by_its_number(far_m):
    contents = vtk_file.read(XML)
    points = contents.points.copy()
    points[283, 2] = far_m
    contents = contents._replace(points=points)
    with pytest.raises(FieldError, match="expected 5 % or more: point 283 at "):
        vtk._resampled(contents, "a file")


def test_the_places_of_a_grid_are_bounded_by_the_cells_of_its_file(monkeypatch):
    monkeypatch.setattr(vtk, "PLACES", 1)
    grid = vtk._resampled(vtk_file.read(XML), "a file")
    assert grid.parts["u"].v.size <= 2 * 322


def test_cells_that_lie_over_one_another_are_refused(monkeypatch):
    monkeypatch.setattr(mesh, "OVERLAP", 0.5)
    with pytest.raises(FieldError, match="its cells overlap: a place is in the boxes about 1 "):
        read(XML)


def test_the_volume_of_a_mesh_is_that_of_its_box_less_the_house():
    contents = vtk_file.read(XML)
    made = mesh.mesh(contents.points, contents.cells)
    assert made.volume.sum() == pytest.approx(48.0 * 40.0 * 32.0 - 4096.0)
