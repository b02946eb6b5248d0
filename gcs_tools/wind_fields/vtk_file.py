"""VTK files, legacy (ASCII, binary) and XML (.vtu, .vti): places, cells and values, with one face.

OpenFOAM's `foamToVTK` writes legacy files and .vtu, ParaView writes all. What no field of wind needs is skipped.
"""

from __future__ import annotations

import base64
import re
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from fcu.interface.files import input_file
from gcs_tools.wind_fields.grid import check_file, check_size, reason, wrong
from sitl_plant.physics.wind.packed_field import FieldError

Array = np.ndarray[Any, Any]

_LEGACY = b"# vtk DataFile"
_XML = b"<VTKFile"
_HEAD = 4096  # bytes, in which a file says what it is
# XML's names, and those of legacy files
TYPES = {
    "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4", "Int64": "i8",
    "UInt64": "u8", "Float32": "f4", "Float64": "f8", "char": "i1", "unsigned_char": "u1", "short": "i2",
    "unsigned_short": "u2", "int": "i4", "unsigned_int": "u4", "long": "i8", "vtktypeint64": "i8", "float": "f4",
    "double": "f8",
}  # fmt: skip


class Cells(NamedTuple):
    """Cells of an unstructured grid."""

    types: Array  # int[n], VTK's
    corners: Array  # int[], of all cells
    first: Array  # int[n + 1], where in `corners` those of a cell begin
    faces: dict[int, list[Array]]  # of polyhedra: corners of each face


class Contents(NamedTuple):
    """A file, read."""

    points: Array | None  # (n, 3), m, of an unstructured grid
    cells: Cells | None
    axes: tuple[Array, Array, Array] | None  # places x, y, z of a regular grid
    of_points: dict[str, Array]
    of_cells: dict[str, Array]


POLYHEDRON = 42
LEAST = 3  # corners of a face
MOST_AXIS = 10_000_000  # places along an axis of a regular grid


def is_vtk(path: Path) -> bool:
    """Return true if a file begins as VTK's do. Raises OSError."""
    with input_file.opened(path) as file:
        head = file.read(_HEAD)
    return head.startswith(_LEGACY) or _XML in head


def read(path: Path) -> Contents:
    """A whole file. Raises FieldError, OSError."""
    source = str(path)
    with input_file.opened(path) as file:
        check_file(source, file)
        data = file.read()
    try:
        return _legacy(data, source) if data.startswith(_LEGACY) else _xml(data, source)
    except FieldError:
        raise
    except MemoryError as error:
        raise wrong(source, reason(error)) from error
    except (
        ValueError, LookupError, TypeError, OverflowError, ElementTree.ParseError, zlib.error,
    ) as error:  # fmt: skip
        raise wrong(
            source, f"damaged, or no VTK file: {type(error).__name__}: {str(error)[:120]}"
        ) from error


def polyhedron(stream: Array) -> list[Array]:
    """The faces of a polyhedron: how many there are, then corners of each after their number.

    Raises ValueError.
    """
    found, at = [], 1
    for _ in range(int(stream[0]) if len(stream) else 0):
        n = int(stream[at]) if at < len(stream) else 0
        if n < LEAST or at + 1 + n > len(stream):
            raise ValueError(f"a polyhedron has a face of {n} corners")
        found.append(np.asarray(stream[at + 1 : at + 1 + n]))
        at += 1 + n
    if not found:
        raise ValueError("a polyhedron has no faces")
    return found


def _as(kind: str, values: Array) -> Array:
    """Numbers of a text as those of a kind. Raises ValueError for what it cannot hold."""
    dtype = np.dtype(kind)
    if dtype.kind in "iu":
        info = np.iinfo(dtype)
        inside = (values >= info.min) & (values <= info.max) & (values == np.floor(values))
        if not inside.all():
            raise ValueError(f"{values[~inside][0]:g} is no whole number of {dtype.name}")
    return values.astype(dtype)


def _check_cells(cells: Cells) -> None:
    """Raise ValueError for cells that contradict one another, or have parts of corners."""
    for what, of in (("types", cells.types), ("corners", cells.corners), ("offsets", cells.first)):
        if of.dtype.kind not in "iu":
            raise ValueError(f"{what} of cells are {of.dtype.name}: expected whole numbers")
    n, ends = len(cells.types), cells.first[1:]
    if len(ends) != n:
        raise ValueError(f"{len(ends)} offsets of {n} cells")
    if (np.diff(cells.first) < 0).any():
        raise ValueError("offsets of cells fall")
    if n and ends[-1] != len(cells.corners):
        raise ValueError(f"the last cell ends at corner {ends[-1]} of {len(cells.corners)}")
    without = set(np.flatnonzero(cells.types == POLYHEDRON).tolist()) - cells.faces.keys()
    if without:
        raise ValueError(f"cell {min(without)} is a polyhedron without faces")


# --- legacy


class _Text:
    """The text of a legacy file, word by word. Arrays may be binary."""

    def __init__(self, data: bytes, is_binary: bool, at: int) -> None:
        self.data, self.is_binary, self.at = data, is_binary, at

    def line(self) -> str:
        """The next line that is not empty. At the end of the file: empty."""
        while self.at < len(self.data):
            end = self.data.find(b"\n", self.at)
            end = len(self.data) if end < 0 else end
            text = self.data[self.at : end].decode("ascii", "replace").strip()
            self.at = end + 1
            if text:
                return text
        return ""

    def array(self, n: int, kind: str) -> Array:
        """So many numbers."""
        if n < 0:
            raise ValueError(f"{n} numbers")
        dtype = np.dtype(TYPES[kind])
        if self.is_binary:
            size = n * dtype.itemsize
            if self.at + size > len(self.data):
                raise ValueError(f"it ends before {n} numbers of {kind}")
            found = np.frombuffer(self.data, dtype.newbyteorder(">"), n, self.at)
            self.at += size
            return found.astype(dtype)
        words: list[bytes] = []
        end = self.at
        pattern = re.compile(rb"\S+")
        while len(words) < n:
            stop = self.data.find(b"\n", end)
            stop = len(self.data) if stop < 0 else stop
            words += pattern.findall(self.data, end, stop)
            end = stop + 1
            if stop >= len(self.data) and len(words) < n:
                raise ValueError(f"it ends before {n} numbers of {kind}")
        if len(words) > n:
            raise ValueError(f"more than {n} numbers of {kind} in its lines")
        self.at = end
        return _as(dtype.str, np.array(words, dtype=np.float64))


def _legacy(data: bytes, source: str) -> Contents:
    lines = data[:_HEAD].split(b"\n")
    is_binary = lines[2].strip().upper() == b"BINARY"
    text = _Text(data, is_binary, sum(len(line) + 1 for line in lines[:3]))
    points: Array | None = None
    types: Array | None = None
    stream: Array | None = None
    n_cells, axes, dims, origin, spacing = 0, {}, None, None, None
    values: dict[str, dict[str, Array]] = {"POINT_DATA": {}, "CELL_DATA": {}, "": {}}
    into, n = "", 0
    while line := text.line():
        word, *rest = line.split()
        word = word.upper()
        if word == "DATASET":
            kind = rest[0].upper()
            if kind not in ("UNSTRUCTURED_GRID", "STRUCTURED_POINTS", "RECTILINEAR_GRID"):
                raise wrong(
                    source,
                    f"a {kind}: expected UNSTRUCTURED_GRID, STRUCTURED_POINTS or RECTILINEAR_GRID",
                )
        elif word == "POINTS":
            points = text.array(3 * int(rest[0]), rest[1]).reshape(-1, 3)
        elif word == "CELLS":
            n_cells = int(rest[0])
            stream = text.array(int(rest[1]), "int")
        elif word == "CELL_TYPES":
            types = text.array(int(rest[0]), "int")
        elif word == "DIMENSIONS":
            dims = tuple(map(int, rest))
        elif word == "ORIGIN":
            origin = tuple(map(float, rest))
        elif word in ("SPACING", "ASPECT_RATIO"):
            spacing = tuple(map(float, rest))
        elif word.endswith("_COORDINATES"):
            axes[word[0].lower()] = text.array(int(rest[0]), rest[1])
        elif word in ("POINT_DATA", "CELL_DATA"):
            into, n = word, int(rest[0])
        elif word == "FIELD":
            for _ in range(int(rest[1])):
                name, wide, count, of = text.line().split()
                found = text.array(int(wide) * int(count), of)
                values[into][name] = found.reshape(int(count), int(wide))
        elif word in ("VECTORS", "NORMALS"):
            values[into][rest[0]] = text.array(3 * n, rest[1]).reshape(n, 3)
        elif word == "SCALARS":
            width = int(rest[2]) if len(rest) > 2 else 1
            text.line()  # LOOKUP_TABLE
            values[into][rest[0]] = text.array(width * n, rest[1]).reshape(n, width)
        elif word == "TENSORS":
            text.array(9 * n, rest[1])
        elif word == "METADATA":
            while text.at < len(data) and data[text.at : text.at + 1] not in (b"\n", b"\r"):
                text.at = (data.find(b"\n", text.at) + 1) or len(data)
        else:
            raise ValueError(f"{line[:40]!r} is not expected there")
    regular = None
    if dims is not None and origin is not None and spacing is not None:
        regular = _places(origin, spacing, [0] * len(dims), dims)
    elif axes:
        regular = axes["x"], axes["y"], axes["z"]
    cells = None
    if stream is not None and types is not None:
        cells = _cells_of(stream, types, n_cells)
    return Contents(points, cells, regular, values["POINT_DATA"], values["CELL_DATA"])


def _places(
    origin: Sequence[float], spacing: Sequence[float], first: Sequence[int], end: Sequence[int]
) -> tuple[Array, Array, Array]:
    """Places of a regular grid. Raises ValueError unless there are three axes of one place or more."""
    if [len(origin), len(spacing), len(first), len(end)] != [3, 3, 3, 3]:
        raise ValueError("expected three numbers of its origin, its spacing and its places")
    for a, b in zip(first, end, strict=True):
        if not 1 <= b - a <= MOST_AXIS:
            raise ValueError(f"{b - a} places along an axis: expected 1 to {MOST_AXIS}")
    x, y, z = (
        o + s * np.arange(a, b) for o, s, a, b in zip(origin, spacing, first, end, strict=True)
    )
    return x, y, z


def _cells_of(stream: Array, types: Array, n: int) -> Cells:
    """Cells of a legacy file: after its number, what a cell has."""
    if len(types) != n:
        raise ValueError(f"{len(types)} types of {n} cells")
    first = np.zeros(n + 1, dtype=np.int64)
    starts = np.empty(n, dtype=np.int64)
    at, given = 0, stream.tolist()
    faces = {}
    for i, kind in enumerate(types.tolist()):
        size = given[at] if at < len(given) else 0
        if size < 1 or at + 1 + size > len(given):
            raise ValueError(f"cell {i} has {size} numbers")
        starts[i] = at + 1
        first[i + 1] = first[i] + size
        if kind == POLYHEDRON:
            faces[i] = polyhedron(stream[at + 1 : at + 1 + size])
        at += 1 + size
    keep = np.ones(len(stream), dtype=bool)
    keep[starts - 1] = False
    if at != len(given):
        raise ValueError(f"cells of {at} numbers in all, and not of {len(given)}")
    cells = Cells(types, stream[keep], first, faces)
    _check_cells(cells)
    return cells


# --- XML


def _xml(data: bytes, source: str) -> Contents:
    appended = b""
    start = data.find(b"<AppendedData")
    encoding = ""
    if start >= 0:
        tag_end = data.index(b">", start)
        encoding = "raw" if b'"raw"' in data[start:tag_end] else "base64"
        appended = data[data.index(b"_", tag_end) + 1 : data.rindex(b"</AppendedData>")]
        data = data[:start] + b"</VTKFile>"
    root = ElementTree.fromstring(data)
    order = "<" if root.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
    reader = _Arrays(
        source, order, TYPES[root.get("header_type", "UInt32")], root.get("compressor") or "", encoding,
        appended.strip() if encoding == "base64" else appended,
    )  # fmt: skip
    kind = root.get("type")
    if kind not in ("UnstructuredGrid", "ImageData", "RectilinearGrid"):
        raise wrong(source, f"a {kind}: expected UnstructuredGrid, ImageData or RectilinearGrid")
    grid = root.find(kind)
    pieces = [] if grid is None else grid.findall("Piece")
    if grid is None or len(pieces) != 1:
        raise wrong(source, f"{len(pieces)} pieces: expected one (in ParaView: Merge Blocks)")
    (piece,) = pieces
    values = [
        {str(of.get("Name")): reader.read(of) for of in piece.findall(f"{name}/DataArray")}
        for name in ("PointData", "CellData")
    ]
    if kind == "UnstructuredGrid":
        of = {str(each.get("Name")): reader.read(each) for each in piece.findall("Cells/DataArray")}
        (points,) = (reader.read(each) for each in piece.findall("Points/DataArray"))
        lacking = [name for name in ("types", "offsets", "connectivity") if name not in of]
        if lacking:
            raise ValueError(f"its cells lack {', '.join(lacking)}")
        types, offsets = of["types"].ravel(), of["offsets"].ravel()
        for name, found in (("NumberOfPoints", points), ("NumberOfCells", types)):
            if (said := piece.get(name)) is not None and int(said) != len(found):
                raise ValueError(f"{name} is {said}, and there are {len(found)}")
        faces, ends = of.get("faces"), of.get("faceoffsets")
        polyhedra = {}
        if faces is not None and ends is not None and faces.size:
            ends, stream = ends.ravel(), faces.ravel()
            before = 0
            if stream.dtype.kind not in "iu":
                raise ValueError(f"faces are {stream.dtype.name}: expected whole numbers")
            for i in np.flatnonzero(ends >= 0).tolist():
                polyhedra[i] = polyhedron(stream[before : int(ends[i])])
                before = int(ends[i])
        first = np.concatenate((np.zeros(1, dtype=offsets.dtype), offsets))
        if first.dtype.kind in "iu":
            first = first.astype(np.int64)
        cells = Cells(types, of["connectivity"].ravel(), first, polyhedra)
        _check_cells(cells)
        return Contents(points, cells, None, *values)
    extent = [int(x) for x in str(piece.get("Extent") or grid.get("WholeExtent")).split()]
    axes: Any
    if kind == "RectilinearGrid":
        axes = tuple(reader.read(each).ravel() for each in piece.findall("Coordinates/DataArray"))
        if len(axes) != 3:
            raise ValueError(f"coordinates of {len(axes)} axes: expected three")
    else:
        origin, spacing = ([float(x) for x in str(grid.get(name)).split()] for name in ("Origin", "Spacing"))  # fmt: skip
        axes = _places(origin, spacing, extent[::2], [last + 1 for last in extent[1::2]])
    return Contents(None, None, axes, *values)


class _Arrays:
    """How an XML file writes its arrays."""

    def __init__(
        self,
        source: str,
        order: str,
        header: str,
        compressor: str,
        encoding: str,
        appended: bytes,
    ) -> None:
        self.source = source
        self.order, self.header, self.compressor = order, np.dtype(order + header), compressor
        self.encoding, self.appended = encoding, appended
        if compressor not in ("", "vtkZLibDataCompressor"):
            raise ValueError(f"{compressor}: expected zlib, or none")

    def read(self, of: ElementTree.Element) -> Array:
        """A DataArray, (n, components)."""
        dtype = np.dtype(self.order + TYPES[str(of.get("type"))])
        way, width = of.get("format"), int(of.get("NumberOfComponents") or 1)
        if way == "ascii":
            found = _as(dtype.str, np.array((of.text or "").split(), dtype=np.float64))
        elif way == "appended":
            start = int(of.get("offset") or 0)
            if not 0 <= start < len(self.appended):
                raise ValueError(f"an array begins at {start} of {len(self.appended)} bytes")
            found = np.frombuffer(self._bytes(self.appended[start:], self.encoding), dtype)
        else:
            found = np.frombuffer(self._bytes("".join((of.text or "").split()).encode(), "base64"), dtype)  # fmt: skip
        return found.reshape(-1, width)

    def _bytes(self, data: bytes, encoding: str) -> bytes:
        size = self.header.itemsize

        def decoded(n: int, at: int) -> tuple[bytes, int]:
            """So many bytes from a place of `data`, and where what follows begins."""
            end = at + n if encoding == "raw" else at + 4 * -(-n // 3)
            if n < 0 or end > len(data):
                raise ValueError(f"an array ends before its {n} bytes")
            if encoding == "raw":
                return data[at:end], end
            try:
                return base64.b64decode(data[at:end], validate=True)[:n], end
            except ValueError as error:
                raise ValueError(f"an array is no base64 ({error})") from error

        if not self.compressor:
            head, at = decoded(size, 0)
            n = int(np.frombuffer(head, self.header)[0])
            if encoding == "raw":
                return decoded(n, at)[0]
            return decoded(size + n, 0)[0][size:]  # header and values are one text
        head, _ = decoded(3 * size, 0)
        blocks, size_of_block, _ = np.frombuffer(head, self.header).tolist()
        check_size(self.source, blocks * size_of_block)
        head, at = decoded((3 + blocks) * size, 0)
        sizes = np.frombuffer(head, self.header)[3:].astype(np.int64)
        packed, _ = decoded(int(sizes.sum()), at)
        ends = np.concatenate(([0], np.cumsum(sizes)))
        return b"".join(
            _unpacked(packed[a:b], size_of_block)
            for a, b in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)
        )


def _unpacked(block: bytes, size: int) -> bytes:
    """A block of zlib's of at most so many bytes. Raises ValueError, zlib.error."""
    reader = zlib.decompressobj()
    found = reader.decompress(block, max(size, 1))
    if not reader.eof:
        raise ValueError(f"a block ends early, or has more than its {size} bytes")
    return found
