"""A recording read back: the same rows that were recorded, to the bit.

What a file holds is told by its own schemas, not by the NamedTuples of this version: columns are
called what the file calls them, and stand in its order. What this version does not know is there
all the same; what it knows and the file does not have is not a number.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from google.protobuf.message import DecodeError
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Message, Metadata, Schema

from fcu.interface.airframe import AirframeFile
from fcu.interface.event_log import Event
from fcu.interface.files.input_file import opened
from gcs_tools.recording import events, notebook, old_names
from gcs_tools.recording.layout import LayoutError, decode
from gcs_tools.recording.records import MAGIC_BYTES, records, whole_records
from gcs_tools.recording.schema import FCU, PARAMS, PLANT, TOPICS, TRUTH, Topic
from gcs_tools.recording.table import Rows, Table

SCHEMA_VERSION = 5  # of what a recording holds; a reader refuses a newer one
READ = (*old_names.VERSIONS, str(SCHEMA_VERSION))
SOURCE, BUS = "recorded_from", "bus"  # of metadata: a bus, unlike a flight, may lose messages
METADATA = "flight"  # name of the metadata record
VERSION_KEY = "schema_version"
LAW, OUR_LAW = "law", "mmrac"  # of metadata: which law was flown; without it, ours
AIRFRAME, AIRFRAME_SHA256 = "airframe", "airframe_sha256"  # of metadata: name, hash of the file
AIRFRAME_FILE = "airframe_file"  # of metadata: its text, where no law's parameters tell of it
CONTROLLER = "controller"  # of metadata: the command of a controller that tells nothing of itself
VALUES = "values"  # of metadata, as JSON: those in force, as {key: {"value": ..., "origin": ...}}
LAW_SOURCES = "law_sha256"  # of metadata: the first 16 digits of the hash of its sources
# Topics whose fields are another law's own, or that of its guard, if it has one.
OF_A_LAW = ("/fcu/law", "/fcu/internals", "/fcu/guard", "/fcu/guard_state", PARAMS)

Sequence = np.ndarray[Any, np.dtype[np.uint64]]


def flies_with(airframe: AirframeFile) -> dict[str, Any]:
    """What a vehicle says of its airframe."""
    return {
        AIRFRAME: airframe.name,
        AIRFRAME_SHA256: airframe.sha256,
        "believed_drag": list(airframe.drag),
    }


def values_told(told: Mapping[str, Any]) -> dict[str, Any]:
    """The values in force by dotted key, of metadata or of what a vehicle says of itself."""
    values = told.get(VALUES, {})
    try:
        found = json.loads(values) if isinstance(values, str) else values
        return {name: each["value"] for name, each in found.items()}
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return {}  # of nobody of ours


class RecordingError(Exception):
    """A recording that cannot be written or read: names the file and the reason."""


@dataclass(frozen=True)
class Recording:
    """What one flight recorded. Tables have a row a control tick, and a column `t`."""

    path: Path
    metadata: dict[str, str]
    plant: Table  # the truth
    fcu: Table  # what the controller and its law told of each tick
    params: dict[str, float] | None  # the law's, or None if the flight ended before they were known
    events: list[Event]
    reports: dict[str, Table]  # by topic, those recorded: what was told beside, whatever it is
    topics: dict[str, Topic]  # as the file describes them
    lost: dict[str, int]  # by topic: messages missing between the first and the last
    complete: bool  # False: the recorder did not close it, what it had not written is missing

    def _repr_html_(self) -> str:
        """Its tables and what was flown, for a notebook."""
        tables = {"fcu": self.fcu, "plant": self.plant, **self.reports}
        rows = [
            (name, len(table), len(table.names), f"{table['t'][0]:g} to {table['t'][-1]:g} s")
            for name, table in tables.items()
            if len(table)
        ]
        title = f"{self.metadata.get('mission', '')} {self.path}"
        return notebook.table(title, ("table", "rows", "columns", "time"), rows)


class _Contents:
    """The records of a file, sorted."""

    def __init__(self) -> None:
        self.version = ""
        self.metadata: dict[str, str] = {}
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[str, Channel] = {}
        self.messages: dict[int, list[Message]] = {}

    def take(self, file: BinaryIO, end: int) -> None:
        """Sort the records of the first `end` bytes of a file. Raises what `records` raises."""
        try:
            for record in records(file, end):
                if isinstance(record, Message):
                    self.messages.setdefault(record.channel_id, []).append(record)
                elif isinstance(record, Schema):
                    self.schemas[record.id] = record
                elif isinstance(record, Channel):
                    self.channels[record.topic] = record
                elif isinstance(record, Metadata) and record.name == METADATA:
                    self.metadata = record.metadata
        except EndOfFile:  # the regular end of what a killed recorder leaves
            if file.tell() < MAGIC_BYTES:
                raise

    @property
    def is_old(self) -> bool:
        """Return true if an older version has written it."""
        return self.version in old_names.VERSIONS

    @property
    def is_of_a_bus(self) -> bool:
        """Whether it was recorded off a bus, which may lose messages."""
        return self.metadata.get(SOURCE) == BUS

    @property
    def is_of_our_law(self) -> bool:
        """Whether the law that was flown is the one whose names this version knows."""
        return CONTROLLER not in self.metadata and self.metadata.get(LAW, OUR_LAW) == OUR_LAW

    def lost(self) -> dict[str, int]:
        """By topic: messages missing between the first and the last."""
        lost = {}
        for topic, channel in self.channels.items():
            sequence = [message.sequence for message in self.messages.get(channel.id, [])]
            if sequence and (missing := sequence[-1] - sequence[0] + 1 - len(sequence)):
                lost[topic] = missing
        return lost

    def topics(self) -> dict[str, Topic]:
        """Every topic of numbers as the file describes it, by name."""
        found = {}
        for name, channel in self.channels.items():
            schema = self.schemas[channel.schema_id]
            of_row: Mapping[str, str] = channel.metadata
            if not of_row and name in TOPICS:  # a copy by a tool that does not keep it
                of_row = TOPICS[name].metadata
            topic = Topic.described(name, schema.name, schema.data, of_row)
            if topic.has_layout:  # others have words, or are somebody else's
                found[name] = topic
        return found

    def of(self, topic: str) -> list[Message]:
        """Its messages."""
        return self.messages.get(self.channels[topic].id, [])

    def known(self, row: str) -> list[str]:
        """The columns of a row that this version knows of the law that was flown."""
        if row == FCU and CONTROLLER in self.metadata:
            return []
        topics = (t for t in TOPICS.values() if t.row == row)
        ours = (t for t in topics if self.is_of_our_law or t.name not in OF_A_LAW)
        return list(dict.fromkeys(name for topic in ours for name in topic.columns))

    def known_of(self, topic: Topic) -> list[str]:
        """The same, of a topic that is of no row."""
        ours = topic.name in TOPICS and (self.is_of_our_law or topic.name not in OF_A_LAW)
        return TOPICS[topic.name].columns if ours else []


class _Part(NamedTuple):
    """The messages of one topic, or of all topics of one row."""

    sequence: Sequence  # (n,), ascending
    table: Table


def _part(contents: _Contents, topic: Topic) -> _Part:
    """What is recorded of `topic`."""
    messages = contents.of(topic.name)
    sequence = np.array([message.sequence for message in messages], np.uint64)
    backwards = np.flatnonzero(sequence[1:] <= sequence[:-1])
    if len(backwards):
        raise LayoutError(f"{topic.name}: tick {sequence[backwards[0]]} is followed by an earlier")
    if not contents.is_of_a_bus:  # its own flight's: nothing can be missing
        gaps = np.flatnonzero(sequence != np.arange(len(sequence)))
        if len(gaps):
            i = int(gaps[0])
            raise LayoutError(f"{topic.name}: tick {i} is missing, next is {sequence[i]}")
    try:
        rows = decode(topic.layout, [message.data for message in messages])
    except LayoutError as error:
        raise LayoutError(f"{topic.name}: {error}") from error
    return _Part(sequence, Table(rows, topic.columns))


def _filled(table: Table, known: list[str]) -> Table:
    """`table`, with what it lacks of the columns that are known: not numbers, behind its own."""
    lacks = [name for name in known if name not in table.names]
    if not lacks:
        return table
    more = np.full((len(table), len(lacks)), np.nan)
    return Table(np.concatenate([table.rows, more], axis=1), [*table.names, *lacks])


def _together(contents: _Contents, topics: list[Topic], row: str) -> _Part:
    """Whole rows, of the ticks that every topic of the row has."""
    parts = {topic.name: _part(contents, topic) for topic in topics if topic.row == row}
    if not parts:
        raise LayoutError(
            f"{TRUTH if row == PLANT else 'every topic of the controller'} is missing"
        )
    shared = reduce(np.intersect1d, [part.sequence for part in parts.values()])
    if not contents.is_of_a_bus and any(len(p.sequence) != len(shared) for p in parts.values()):
        by_length = sorted(parts, key=lambda name: len(parts[name].sequence))
        raise LayoutError(f"{by_length[0]} and {by_length[-1]} are not of the same ticks")
    values: dict[str, Rows] = {}
    for name, part in parts.items():
        rows = part.table.rows[np.isin(part.sequence, shared)]
        for column, value in zip(part.table.names, rows.T, strict=True):
            if column == "t" and (values.get("t", value) != value).any():
                raise LayoutError(f"{name} and {next(iter(parts))} are not of the same ticks")
            values.setdefault(column, value)
    table = Table(np.stack(list(values.values()), axis=1), list(values))
    return _Part(shared, _filled(table, contents.known(row)))


def _beside(contents: _Contents, topic: Topic) -> _Part:
    """What is recorded of a topic that is of no row."""
    part = _part(contents, topic)
    return part._replace(table=_filled(part.table, contents.known_of(topic)))


def _params(contents: _Contents, topics: Mapping[str, Topic]) -> dict[str, float] | None:
    if PARAMS not in topics or not contents.of(PARAMS):
        return None
    told = _beside(contents, topics[PARAMS]).table
    first = zip(told.names, told.rows[0].tolist(), strict=True)
    return {name: value for name, value in first if name != "t"}


def _events(contents: _Contents) -> list[Event]:
    channel = contents.channels.get(events.TOPIC)
    if channel is None:
        raise LayoutError(f"{events.TOPIC} is missing")
    schema = contents.schemas[channel.schema_id].data
    found = events.decode(schema, [message.data for message in contents.of(events.TOPIC)])
    return [*map(old_names.of_event, found)] if contents.is_old else found


class Messages(NamedTuple):
    """One topic as it is on file, in the order of time."""

    encoding: str  # of its samples on the bus
    sequence: Sequence  # (n,)
    time_ns: Sequence  # (n,), simulation time
    data: list[bytes]


def messages(path: Path) -> tuple[dict[str, str], dict[str, Topic], dict[str, Messages]]:
    """Metadata of the recording at `path`, its topics of numbers, and the messages of all topics.

    Of an older version's: as this version would have recorded them. Raises RecordingError.
    """
    contents, _ = _opened(path)
    with _named(path):
        topics, found = contents.topics(), {}
        for name, channel in contents.channels.items():
            schema = contents.schemas[channel.schema_id].name
            of = contents.messages.get(channel.id, [])
            sequence, time_ns = (
                np.array([getattr(message, which) for message in of], np.uint64)
                for which in ("sequence", "log_time")
            )
            encoding = topics[name].encoding if name in topics else events.encoding(schema)
            found[name] = Messages(encoding, sequence, time_ns, [message.data for message in of])
        if contents.is_old and events.TOPIC in found:
            told = [*map(events.encode, _events(contents))]
            found[events.TOPIC] = found[events.TOPIC]._replace(data=told)
    return contents.metadata, topics, found


def _opened(path: Path) -> tuple[_Contents, bool]:
    """What is in the file at `path`, and whether it is complete. Raises RecordingError."""
    contents = _Contents()
    with _named(path), opened(path) as file:
        end, complete = whole_records(file)
        contents.take(file, end)
        version = contents.metadata.pop(VERSION_KEY, None)
        if version is None:
            raise LayoutError("not a recording of a flight")
        if version not in READ:
            raise LayoutError(f"recording version {version}; this program reads {SCHEMA_VERSION}")
        contents.version = version
        if contents.is_old:
            contents.metadata = old_names.of_metadata(contents.metadata)
    return contents, complete


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Name the file in what its contents raise."""
    try:
        yield
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from error
    except (McapError, ValueError, RuntimeError, DecodeError, struct.error) as error:
        # LayoutError and bad checksums are ValueErrors, lz4 raises RuntimeError
        raise RecordingError(f"{path}: {str(error) or 'not a recording'}") from error
    except (KeyError, TypeError, AttributeError, IndexError, OverflowError) as error:
        # of records that are whole and contradict each other
        raise RecordingError(f"{path}: damaged ({error})") from error


def read(path: Path) -> Recording:
    """The recording at `path`; of one that was cut short, all up to its last whole chunk.

    Raises RecordingError if it cannot be read, is damaged, or was written by a later version.
    """
    contents, complete = _opened(path)
    with _named(path):
        topics = contents.topics()
        beside = [t for t in topics.values() if not t.row and t.name != PARAMS]
        return Recording(
            path=path,
            metadata=contents.metadata,
            plant=_together(contents, [*topics.values()], PLANT).table,
            fcu=_together(contents, [*topics.values()], FCU).table,
            params=_params(contents, topics),
            events=_events(contents),
            reports={t.name: _beside(contents, t).table for t in beside if contents.of(t.name)},
            topics=topics,
            lost=contents.lost(),
            complete=complete,
        )
