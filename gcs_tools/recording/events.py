"""What happened in a flight, in words: the messages of the topic /events, and what both logs say.

The schema is foxglove.Log, as published, which viewers show as a log.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from google.protobuf import timestamp_pb2
from google.protobuf.descriptor_pb2 import (
    EnumValueDescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass

TOPIC = "/events"
MESSAGE = "foxglove.Log"
LEVELS = ("unknown", "debug", "info", "warning", "error", "fatal")
_NS = 1_000_000_000


class Event(NamedTuple):
    """Something that happened at a simulation time (s, kept to the nanosecond)."""

    t: float
    level: str  # one of LEVELS
    text: str


def encoding(message: str = MESSAGE) -> str:
    """What samples say of themselves on Zenoh, where messages share them as ticks do (ticks.pack)."""
    return f"application/protobuf;{message}s"


@cache
def schema() -> bytes:
    """A serialized FileDescriptorSet that holds foxglove.Log."""
    timestamp = FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(timestamp)
    log = FileDescriptorProto(
        name="foxglove/Log.proto", package="foxglove", syntax="proto3", dependency=[timestamp.name]
    )
    message = log.message_type.add(name="Log")
    levels = [EnumValueDescriptorProto(name=n.upper(), number=i) for i, n in enumerate(LEVELS)]
    message.enum_type.add(name="Level", value=levels)
    string = FieldDescriptorProto.TYPE_STRING
    for number, (name, kind, type_name) in enumerate(
        (
            ("timestamp", FieldDescriptorProto.TYPE_MESSAGE, ".google.protobuf.Timestamp"),
            ("level", FieldDescriptorProto.TYPE_ENUM, ".foxglove.Log.Level"),
            ("message", string, None),
            ("name", string, None),
            ("file", string, None),
            ("line", FieldDescriptorProto.TYPE_FIXED32, None),
        ),
        start=1,
    ):
        message.field.add(
            name=name,
            number=number,
            label=FieldDescriptorProto.LABEL_OPTIONAL,
            type=kind,
            type_name=type_name,
        )
    data: bytes = FileDescriptorSet(file=[timestamp, log]).SerializeToString()
    return data


@cache
def _message_class(schema: bytes) -> Any:
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(schema).file:
        pool.AddSerializedFile(file.SerializeToString())
    return GetMessageClass(pool.FindMessageTypeByName(MESSAGE))


def encode(event: Event) -> bytes:
    """One message. Raises ValueError for a level that is not one of LEVELS."""
    message = _message_class(schema())()
    message.timestamp.seconds, message.timestamp.nanos = divmod(round(event.t * _NS), _NS)
    message.level = LEVELS.index(event.level)
    message.message = event.text
    encoded: bytes = message.SerializeToString()
    return encoded


def decode(schema: bytes, messages: list[bytes]) -> list[Event]:
    """The events that `messages` hold, read through the schema that came with them.

    Raises ValueError for what is no such message.
    """
    decoder = _message_class(schema)
    found = []
    try:
        decoded = [decoder.FromString(message) for message in messages]
    except DecodeError as error:
        raise ValueError(f"not a message of {MESSAGE}") from error
    for message in decoded:
        t = (message.timestamp.seconds * _NS + message.timestamp.nanos) / _NS
        level = LEVELS[message.level] if 0 <= message.level < len(LEVELS) else LEVELS[0]
        found.append(Event(t, level, message.message))
    return found


# a line of log: simulation time or "-", level, process, text: fcu.loop.say, sitl_plant.loop.say
_LINE = re.compile(r" *(?P<t>-|[0-9]+\.[0-9]{3}) (?P<level>\w+) +(?P<who>\w+) +(?P<text>.+)")


def logged(folder: Path) -> Iterator[Event]:
    """The lines of fcu.log and plant.log of a run; what came before the flight is at time 0."""
    for name in ("fcu.log", "plant.log"):
        try:
            lines = (folder / name).read_text(errors="replace").splitlines()
        except OSError:
            continue
        for line in lines:
            found = _LINE.fullmatch(line)
            if found and found["level"] in LEVELS:
                t = 0.0 if found["t"] == "-" else float(found["t"])
                yield Event(t, found["level"], f"{found['who']}: {found['text']}")
