"""Where the doubles of a Protobuf message stand, so that whole batches of messages move at once.

A message of nothing but doubles, all written, has one length and one layout: tags and lengths
are the same bytes in every message, and each double is eight bytes at a fixed place. So a batch
is encoded by copying one template and laying columns into it, and decoded by looking at the
places, once the bytes between them are known to be the template's.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto, FileDescriptorSet

from gcs_tools.recording.table import Rows

Bytes = np.ndarray[Any, np.dtype[np.uint8]]

_FIXED64, _LENGTH_DELIMITED = 1, 2  # Protobuf wire types


DEEPEST, LONGEST = 16, 1 << 16  # of a message in another, and bytes: a schema may be anybody's


class LayoutError(ValueError):
    """A message that is not one of doubles alone, or bytes that are not such a message."""


class Layout(NamedTuple):
    """One Protobuf message with every double written."""

    template: bytes  # with zeros where the doubles go
    names: tuple[str, ...]  # of the doubles, dotted
    places: tuple[int, ...]  # of their first bytes


def varint(value: int) -> bytes:
    """An unsigned number as Protobuf writes it."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def _messages(
    scope: str, found: Iterable[DescriptorProto]
) -> Iterator[tuple[str, DescriptorProto]]:
    """Every message, nested ones too, with its full name."""
    for message in found:
        name = f"{scope}.{message.name}"
        yield name, message
        yield from _messages(name, message.nested_type)


@cache
def layout(schema: bytes, name: str) -> Layout:
    """The layout of the message `name` of a serialized FileDescriptorSet.

    Raises LayoutError if there is no such message, or if it has anything but doubles and
    messages of doubles.
    """
    known: dict[str, DescriptorProto] = {}
    for file in FileDescriptorSet.FromString(schema).file:
        known |= _messages(f".{file.package}", file.message_type)
    return _layout(known, f".{name}")


def _layout(known: dict[str, DescriptorProto], name: str, depth: int = 0) -> Layout:
    if name not in known or depth > DEEPEST:
        raise LayoutError(f"the schema has no message {name.lstrip('.')}")
    template, names, places = b"", [], []
    for field in sorted(known[name].field, key=lambda field: int(field.number)):
        single = field.label == FieldDescriptorProto.LABEL_OPTIONAL
        if single and field.type == FieldDescriptorProto.TYPE_DOUBLE:
            template += varint(field.number << 3 | _FIXED64)
            names.append(field.name)
            places.append(len(template))
            template += bytes(8)
        elif single and field.type == FieldDescriptorProto.TYPE_MESSAGE:
            inner = _layout(known, field.type_name, depth + 1)
            template += varint(field.number << 3 | _LENGTH_DELIMITED)
            template += varint(len(inner.template))
            names += [f"{field.name}.{inner_name}" for inner_name in inner.names]
            places += [len(template) + place for place in inner.places]
            template += inner.template
        else:
            raise LayoutError(f"{name.lstrip('.')}.{field.name}: expected a double or a message")
        if len(template) > LONGEST:
            raise LayoutError(f"{name.lstrip('.')} is longer than {LONGEST} bytes")
    return Layout(template, tuple(names), tuple(places))


def decode(form: Layout, messages: list[bytes]) -> Rows:
    """The doubles of `messages`, float64 (n, len(form.names)), to the bit.

    Raises LayoutError for a message that does not have this layout.
    """
    length = len(form.template)
    for i, message in enumerate(messages):
        if len(message) != length:
            raise LayoutError(f"message {i} has {len(message)} bytes, expected {length}")
    data = np.frombuffer(b"".join(messages), np.uint8).reshape(len(messages), length)
    at = np.array(form.places)[:, None] + np.arange(8)
    fixed = np.ones(length, bool)
    fixed[at] = False
    wrong = (data[:, fixed] != np.frombuffer(form.template, np.uint8)[fixed]).any(axis=1)
    if wrong.any():
        raise LayoutError(f"message {int(wrong.argmax())} has other fields than its schema")
    return np.ascontiguousarray(data[:, at]).view("<f8")[..., 0].astype(np.float64, copy=False)


def encode(form: Layout, rows: Rows) -> list[bytes]:
    """A message of each row, float64 (n, len(form.names))."""
    stack = Stack([(b"", form, list(range(len(form.names))))])
    return [row.tobytes() for row in stack.encode(rows)]


class _Run(NamedTuple):
    """Columns that stand side by side in the row and evenly spaced in the message."""

    place: int
    spacing: int
    column: int
    width: int


def _runs(places: list[int], columns: list[int]) -> list[_Run]:
    runs: list[_Run] = []
    for place, column in zip(places, columns, strict=True):
        if runs and column == runs[-1].column + runs[-1].width:
            last = runs[-1]
            spacing = place - (last.place + (last.width - 1) * last.spacing)
            if last.width == 1 or spacing == last.spacing:
                runs[-1] = last._replace(spacing=spacing, width=last.width + 1)
                continue
        runs.append(_Run(place, 8, column, 1))
    return runs


class Stack:
    """Rows of float64 into bytes: for each row one message of each form, each behind its head."""

    def __init__(self, forms: list[tuple[bytes, Layout, list[int]]]) -> None:
        """`forms`: head, layout, and for each double of it the column of the row."""
        self.starts: list[int] = []  # of each form's head in the bytes of a row
        template = bytearray()
        places: list[int] = []
        columns: list[int] = []
        for head, form, of_form in forms:
            self.starts.append(len(template))
            template += head
            places += [len(template) + place for place in form.places]
            columns += of_form
            template += form.template
        self._template = np.frombuffer(bytes(template), np.uint8)
        self._runs = _runs(places, columns)

    @property
    def row_bytes(self) -> int:
        """Bytes that one row becomes."""
        return len(self._template)

    def blank(self, n: int) -> Bytes:
        """Messages of `n` rows that are yet to be encoded, uint8 (n, row_bytes)."""
        out = np.empty((n, self.row_bytes), np.uint8)
        out[:] = self._template
        return out

    def encode(self, rows: Rows, out: Bytes | None = None) -> Bytes:
        """uint8 (n, row_bytes).  `out`: the `blank` that is filled; None: a new one."""
        n = len(rows)
        if out is None:
            out = self.blank(n)
        if not n:  # numpy has no views into nothing
            return out
        for run in self._runs:
            to: Rows = np.ndarray(
                (n, run.width), "<f8", out, run.place, (self.row_bytes, run.spacing)
            )
            to[:] = rows[:, run.column : run.column + run.width]
        return out
