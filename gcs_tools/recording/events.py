"""What happened in a flight, in words: the messages of the topic /events.

The schema is foxglove.Log, as published, which viewers show as a log.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from google.protobuf import timestamp_pb2
from google.protobuf.descriptor_pb2 import (
    EnumValueDescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass

TOPIC = "/events"
MESSAGE = "foxglove.Log"
ENCODING = f"application/protobuf;{MESSAGE}s"  # on Zenoh: as ticks share a sample (ticks.pack)
LEVELS = ("unknown", "debug", "info", "warning", "error", "fatal")
_NS = 1_000_000_000


class Event(NamedTuple):
    """Something that happened at a simulation time (s, kept to the nanosecond)."""

    t: float
    level: str  # one of LEVELS
    text: str


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

    Raises ValueError or google.protobuf's DecodeError for what is no such message.
    """
    decoder = _message_class(schema)
    found = []
    for message in map(decoder.FromString, messages):
        t = (message.timestamp.seconds * _NS + message.timestamp.nanos) / _NS
        level = LEVELS[message.level] if 0 <= message.level < len(LEVELS) else LEVELS[0]
        found.append(Event(t, level, message.message))
    return found
