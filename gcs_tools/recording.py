"""A recording read back: the same rows that were recorded, to the bit."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from google.protobuf.message import DecodeError
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

from fcu.kernel.buffers import columns
from fcu.law.types import LawParams, Tick
from gcs_tools import events
from gcs_tools.events import Event
from gcs_tools.layout import LayoutError, Rows, decode, layout
from gcs_tools.schema import FCU, PARAMS, PLANT, Topic
from sitl_plant.physics.types import PlantRecord

SCHEMA_VERSION = 1  # of what a recording holds; a reader refuses a newer one
METADATA = "flight"  # name of the metadata record
VERSION_KEY = "schema_version"

_MAGIC_BYTES = 8
_RECORD_HEAD = struct.Struct("<BQ")  # opcode, length


class RecordingError(Exception):
    """A recording that cannot be written or read: names the file and the reason."""


@dataclass(frozen=True)
class Recording:
    """What one flight recorded. Rows are float64, one a control tick."""

    path: Path
    metadata: dict[str, str]
    plant: Rows  # (n, size(PlantRecord))
    fcu: Rows  # (m, size(Tick))
    params: Rows | None  # (size(LawParams),), or None if the flight ended before they were known
    events: list[Event]
    complete: bool  # False: the recorder did not close it, what it had not written is missing


def whole_records(data: bytes) -> tuple[int, bool]:
    """Where the last whole record ends, and whether the file is complete."""
    end = _MAGIC_BYTES
    while end + _RECORD_HEAD.size <= len(data):
        opcode, length = _RECORD_HEAD.unpack_from(data, end)
        if end + _RECORD_HEAD.size + length > len(data):
            break
        end += _RECORD_HEAD.size + length
        if opcode == Opcode.FOOTER:
            whole = end + _MAGIC_BYTES <= len(data)
            return end + _MAGIC_BYTES if whole else end, whole
    return end, False


class _Contents:
    """The records of a file, sorted."""

    def __init__(self) -> None:
        self.metadata: dict[str, str] = {}
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[str, Channel] = {}
        self.messages: dict[int, list[Message]] = {}

    def take(self, data: bytes) -> None:
        """Sort the records of `data`. Raises what mcap raises for damage."""
        try:
            for record in StreamReader(BytesIO(data), validate_crcs=True).records:
                if isinstance(record, Message):
                    self.messages.setdefault(record.channel_id, []).append(record)
                elif isinstance(record, Schema):
                    self.schemas[record.id] = record
                elif isinstance(record, Channel):
                    self.channels[record.topic] = record
                elif isinstance(record, Metadata) and record.name == METADATA:
                    self.metadata = record.metadata
        except EndOfFile:  # the regular end of what a killed recorder leaves
            if len(data) < _MAGIC_BYTES:
                raise

    def of(self, topic: str) -> tuple[Schema, list[Message]] | None:
        """Schema and messages of `topic`, or None if the file does not have it."""
        channel = self.channels.get(topic)
        if channel is None:
            return None
        return self.schemas[channel.schema_id], self.messages.get(channel.id, [])


def _rows(contents: _Contents, topic: Topic, names: list[str]) -> tuple[Rows, list[int]]:
    """Messages of `topic` as float64 (n, columns), and the column of the row that each one is."""
    found = contents.of(topic.name)
    if found is None:
        raise LayoutError(f"{topic.name} is missing")
    schema, messages = found
    form = layout(schema.data, schema.name)
    recorded = [topic.column(name) for name in form.names]
    expected = {*topic.own, *(topic.prefix + name for name in columns(topic.carries))}
    for problem, which in (
        ("lacks", sorted(expected - set(recorded))),
        ("has the unknown", sorted(set(recorded) - expected)),
    ):
        if which:
            raise LayoutError(f"{topic.name} {problem} {', '.join(which)}: another version's")
    for i, message in enumerate(messages):
        if message.sequence != i:
            raise LayoutError(f"{topic.name}: tick {i} is missing, next is {message.sequence}")
    try:
        values = decode(form, [message.data for message in messages])
    except LayoutError as error:
        raise LayoutError(f"{topic.name}: {error}") from error
    return values, [names.index(name) for name in recorded]


def _plant_rows(contents: _Contents) -> Rows:
    names = columns(PlantRecord)
    values, at = _rows(contents, PLANT, names)
    rows = np.empty((len(values), len(names)))
    rows[:, at] = values
    return rows


def _fcu_rows(contents: _Contents) -> Rows:
    names = columns(Tick)
    rows: Rows | None = None
    for topic in FCU:
        values, at = _rows(contents, topic, names)
        if rows is None:
            rows = np.empty((len(values), len(names)))
            rows[:, at] = values
        elif len(values) != len(rows) or (values[:, at.index(0)] != rows[:, 0]).any():
            raise LayoutError(f"{topic.name} and {FCU[0].name} are not of the same ticks")
        rows[:, at] = values
    assert rows is not None
    return rows


def _params(contents: _Contents) -> Rows | None:
    names = ["t", *columns(LawParams)]
    values, at = _rows(contents, PARAMS, names)
    if not len(values):
        return None
    row = np.empty(len(names))
    row[at] = values[0]
    return row[1:]


def _events(contents: _Contents) -> list[Event]:
    found = contents.of(events.TOPIC)
    if found is None:
        raise LayoutError(f"{events.TOPIC} is missing")
    schema, messages = found
    return events.decode(schema.data, [message.data for message in messages])


def read(path: Path) -> Recording:
    """The recording at `path`; of one that was cut short, all up to its last whole chunk.

    Raises RecordingError if it cannot be read, is damaged, or was written by another version.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    end, complete = whole_records(data)
    contents = _Contents()
    try:
        contents.take(data[:end])
        version = contents.metadata.pop(VERSION_KEY, None)
        if version is None:
            raise LayoutError("not a recording of a flight")
        if version != str(SCHEMA_VERSION):
            raise LayoutError(f"recording version {version}; this program reads {SCHEMA_VERSION}")
        return Recording(
            path=path,
            metadata=contents.metadata,
            plant=_plant_rows(contents),
            fcu=_fcu_rows(contents),
            params=_params(contents),
            events=_events(contents),
            complete=complete,
        )
    except (McapError, ValueError, RuntimeError, DecodeError, struct.error) as error:
        # LayoutError and bad checksums are ValueErrors, lz4 raises RuntimeError
        raise RecordingError(f"{path}: {str(error) or 'not a recording'}") from error
