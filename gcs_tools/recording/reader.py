"""A recording read back: the same rows that were recorded, to the bit."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import reduce
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.message import DecodeError
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

from fcu.kernel.buffers import columns
from fcu.settings import Settings
from fcu.tick import Tick
from gcs_tools.recording import events, old_names
from gcs_tools.recording.events import Event
from gcs_tools.recording.layout import LayoutError, Rows, decode, layout
from gcs_tools.recording.schema import FCU, PARAMS, PLANT, PLANT_TIMING, STATUS, TIMING, WIND, Topic
from sitl_plant.physics.types import PlantRecord

SCHEMA_VERSION = 4  # of what a recording holds; a reader refuses a newer one
OLD = ("1", "2", "3")  # read under the names of now; what they do not have as not a number
SINCE_4 = {"/fcu/outputs", "/fcu/guard_state", "/fcu/guard"}  # before in the topics of the law
SOURCE, BUS = "recorded_from", "bus"  # of metadata: a bus, unlike a flight, may lose messages
METADATA = "flight"  # name of the metadata record
VERSION_KEY = "schema_version"

SEEN = (PLANT_TIMING, WIND, STATUS, TIMING)  # beside truth and ticks
Sequence = np.ndarray[Any, np.dtype[np.int64]]

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
    params: Rows | None  # (size(Settings),), or None if the flight ended before they were known
    events: list[Event]
    reports: dict[str, Rows]  # by topic, of SEEN those recorded: t, then the columns it carries
    lost: dict[str, int]  # by topic: messages missing between the first and the last
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
        self.version = ""
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

    def lost(self) -> dict[str, int]:
        """By topic: messages missing between the first and the last."""
        lost = {}
        for topic, channel in self.channels.items():
            sequence = [message.sequence for message in self.messages.get(channel.id, [])]
            if sequence and (missing := sequence[-1] - sequence[0] + 1 - len(sequence)):
                lost[topic] = missing
        return lost

    def of(self, topic: str) -> tuple[Schema, list[Message]] | None:
        """Schema and messages of `topic`, or None if the file does not have it."""
        channel = self.channels.get(topic)
        if channel is None:
            return None
        return self.schemas[channel.schema_id], self.messages.get(channel.id, [])


class _Column(NamedTuple):
    """The messages of one topic."""

    sequence: Sequence  # (n,), ascending
    rows: Rows  # (n, columns)
    at: list[int]  # for each column of `rows`, the column of the whole row that it is


def _column(contents: _Contents, topic: Topic, names: list[str]) -> _Column:
    """What is recorded of `topic`, whose whole row has columns called `names`."""
    found = contents.of(topic.name)
    if found is None:
        raise LayoutError(f"{topic.name} is missing")
    schema, messages = found
    form = layout(schema.data, schema.name)
    recorded = [topic.column(name) for name in form.names]
    expected = {*topic.own, *(topic.prefix + name for name in columns(topic.carries))}
    if contents.version in OLD and (topic in FCU or topic is PARAMS):
        now = old_names.now_of_params if topic is PARAMS else old_names.now_of_tick
        recorded = [now(name) for name in recorded]
        expected = set(names) & set(recorded)
    lacks = expected - set(recorded)
    for problem, which in (
        ("lacks", sorted(lacks)),
        ("has the unknown", sorted(set(recorded) - expected)),
    ):
        if which:
            raise LayoutError(f"{topic.name} {problem} {', '.join(which)}: another version's")
    sequence = np.array([message.sequence for message in messages], np.int64)
    backwards = np.flatnonzero(np.diff(sequence) <= 0)
    if len(backwards):
        raise LayoutError(f"{topic.name}: tick {sequence[backwards[0]]} is followed by an earlier")
    if contents.metadata.get(SOURCE) != BUS:  # its own flight's: nothing can be missing
        gaps = np.flatnonzero(sequence != np.arange(len(sequence)))
        if len(gaps):
            i = int(gaps[0])
            raise LayoutError(f"{topic.name}: tick {i} is missing, next is {sequence[i]}")
    try:
        values = decode(form, [message.data for message in messages])
    except LayoutError as error:
        raise LayoutError(f"{topic.name}: {error}") from error
    return _Column(sequence, values, [names.index(name) for name in recorded])


def _together(found: dict[Topic, _Column], names: list[str]) -> Rows:
    """Whole rows, of the ticks that every topic has."""
    sequences = [column.sequence for column in found.values()]
    shared = reduce(np.intersect1d, sequences)
    rows = np.full((len(shared), len(names)), np.nan)
    first: Topic | None = None
    for topic, column in found.items():
        values = column.rows[np.isin(column.sequence, shared)]
        if first is not None and (values[:, column.at.index(0)] != rows[:, 0]).any():
            raise LayoutError(f"{topic.name} and {first.name} are not of the same ticks")
        rows[:, column.at] = values
        first = first or topic
    return rows


def _ticks(contents: _Contents, topics: tuple[Topic, ...], names: list[str]) -> Rows:
    if contents.version in OLD:
        topics = tuple(topic for topic in topics if topic.name not in SINCE_4)
    found = {topic: _column(contents, topic, names) for topic in topics}
    rows = _together(found, names)
    if contents.metadata.get(SOURCE) != BUS and any(
        len(c.rows) != len(rows) for c in found.values()
    ):
        by_length = sorted(found, key=lambda topic: len(found[topic].rows))
        both = f"{by_length[0].name} and {by_length[-1].name}"
        raise LayoutError(f"{both} are not of the same ticks")
    return rows


def _reports(contents: _Contents) -> dict[str, Rows]:
    """What was recorded beside ticks, by topic."""
    reports = {}
    for topic in SEEN:
        if contents.of(topic.name) is not None:
            names = [*topic.own, *(topic.prefix + name for name in columns(topic.carries))]
            column = _column(contents, topic, names)
            if len(column.rows):
                reports[topic.name] = np.empty((len(column.rows), len(names)))
                reports[topic.name][:, column.at] = column.rows
    return reports


def _params(contents: _Contents) -> Rows | None:
    names = ["t", *columns(Settings)]
    column = _column(contents, PARAMS, names)
    if not len(column.rows):
        return None
    row = np.full(len(names), np.nan)
    row[column.at] = column.rows[0]
    return row[1:]


def _events(contents: _Contents) -> list[Event]:
    found = contents.of(events.TOPIC)
    if found is None:
        raise LayoutError(f"{events.TOPIC} is missing")
    schema, messages = found
    return events.decode(schema.data, [message.data for message in messages])


class Messages(NamedTuple):
    """One topic as it is on file, in the order of time."""

    sequence: np.ndarray[Any, np.dtype[np.uint64]]  # (n,)
    time_ns: np.ndarray[Any, np.dtype[np.uint64]]  # (n,), simulation time
    data: list[bytes]


def messages(path: Path) -> tuple[dict[str, str], dict[str, Messages]]:
    """The metadata of the recording at `path`, and its messages by topic.

    Raises RecordingError, also for an older version's: its messages have other fields.
    """
    contents, _ = _opened(path)
    if contents.version != str(SCHEMA_VERSION):
        why = f"recording version {contents.version}: only {SCHEMA_VERSION} can be replayed"
        raise RecordingError(f"{path}: {why}")
    found = {}
    for topic, channel in contents.channels.items():
        of = contents.messages.get(channel.id, [])
        sequence, time_ns = (
            np.array([getattr(message, name) for message in of], np.uint64)
            for name in ("sequence", "log_time")
        )
        found[topic] = Messages(sequence, time_ns, [message.data for message in of])
    return contents.metadata, found


def _opened(path: Path) -> tuple[_Contents, bool]:
    """What is in the file at `path`, and whether it is complete. Raises RecordingError."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    end, complete = whole_records(data)
    contents = _Contents()
    with _named(path):
        contents.take(data[:end])
        version = contents.metadata.pop(VERSION_KEY, None)
        if version is None:
            raise LayoutError("not a recording of a flight")
        if version not in (*OLD, str(SCHEMA_VERSION)):
            raise LayoutError(f"recording version {version}; this program reads {SCHEMA_VERSION}")
        contents.version = version
    return contents, complete


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Name the file in what its contents raise."""
    try:
        yield
    except (McapError, ValueError, RuntimeError, DecodeError, struct.error) as error:
        # LayoutError and bad checksums are ValueErrors, lz4 raises RuntimeError
        raise RecordingError(f"{path}: {str(error) or 'not a recording'}") from error
    except (KeyError, TypeError, AttributeError, IndexError, OverflowError) as error:
        # of records that are whole and contradict each other
        raise RecordingError(f"{path}: damaged ({error})") from error


def read(path: Path) -> Recording:
    """The recording at `path`; of one that was cut short, all up to its last whole chunk.

    Raises RecordingError if it cannot be read, is damaged, or was written by another version.
    """
    contents, complete = _opened(path)
    with _named(path):
        return Recording(
            path=path,
            metadata=contents.metadata,
            plant=_ticks(contents, (PLANT,), columns(PlantRecord)),
            fcu=_ticks(contents, FCU, columns(Tick)),
            params=_params(contents),
            events=_events(contents),
            reports=_reports(contents),
            lost=contents.lost(),
            complete=complete,
        )
