"""The events of a flight: the messages of the topic /events, and what both processes have told.

The schema is foxglove.Log, which viewers show as a log, with code and values of an event beside the
text for people.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from google.protobuf import struct_pb2, timestamp_pb2
from google.protobuf.descriptor_pb2 import (
    EnumValueDescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass

from fcu.interface import event_log
from fcu.interface.event_log import LEVELS, Event

TOPIC = "/events"
MESSAGE = "foxglove.Log"
_NS = 1_000_000_000
_OURS = 101  # number of the first field that foxglove.Log does not have


def encoding(message: str = MESSAGE) -> str:
    """The encoding of samples on Zenoh, which hold several messages."""
    return f"application/protobuf;{message}s"


@cache
def schema() -> bytes:
    """A serialized FileDescriptorSet that holds foxglove.Log."""
    needed = [FileDescriptorProto(), FileDescriptorProto()]
    for file, known in zip(needed, (timestamp_pb2, struct_pb2), strict=True):
        known.DESCRIPTOR.CopyToProto(file)
    log = FileDescriptorProto(
        name="foxglove/Log.proto", package="foxglove", syntax="proto3",
        dependency=[file.name for file in needed],
    )  # fmt: skip
    message = log.message_type.add(name="Log")
    levels = [EnumValueDescriptorProto(name=n.upper(), number=i) for i, n in enumerate(LEVELS)]
    message.enum_type.add(name="Level", value=levels)
    string = FieldDescriptorProto.TYPE_STRING
    for number, name, kind, type_name in (
        (1, "timestamp", FieldDescriptorProto.TYPE_MESSAGE, ".google.protobuf.Timestamp"),
        (2, "level", FieldDescriptorProto.TYPE_ENUM, ".foxglove.Log.Level"),
        (3, "message", string, None),
        (4, "name", string, None),
        (5, "file", string, None),
        (6, "line", FieldDescriptorProto.TYPE_FIXED32, None),
        (_OURS, "code", string, None),
        (_OURS + 1, "values", FieldDescriptorProto.TYPE_MESSAGE, ".google.protobuf.ListValue"),
    ):
        message.field.add(
            name=name,
            number=number,
            label=FieldDescriptorProto.LABEL_OPTIONAL,
            type=kind,
            type_name=type_name,
        )
    data: bytes = FileDescriptorSet(file=[*needed, log]).SerializeToString()
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
    message.message, message.name, message.code = event.shown, event.who, event.code
    if event.values:
        message.values.extend(event.values)
    encoded: bytes = message.SerializeToString()
    return encoded


def decode(schema: bytes, messages: list[bytes]) -> list[Event]:
    """The events that `messages` hold, read through the schema that came with them.

    Of an older version they have their text alone. Raises ValueError for what is no such message.
    """
    decoder = _message_class(schema)
    tells = "code" in decoder.DESCRIPTOR.fields_by_name
    found = []
    try:
        decoded = [decoder.FromString(message) for message in messages]
    except DecodeError as error:
        raise ValueError(f"not a message of {MESSAGE}") from error
    for message in decoded:
        t = (message.timestamp.seconds * _NS + message.timestamp.nanos) / _NS
        level = LEVELS[message.level] if 0 <= message.level < len(LEVELS) else LEVELS[0]
        told = Event(t, level, message.message)
        if tells:
            text = message.message.removeprefix(f"{message.name}: ")
            values = tuple(_value(each) for each in message.values.values)
            told = told._replace(text=text, who=message.name, code=message.code, values=values)
        found.append(told)
    return found


def _value(message: Any) -> Any:
    """A number, a name or a reason, of a google.protobuf.Value. Raises ValueError."""
    match message.WhichOneof("kind"):
        case "number_value" | "string_value" as kind:
            return getattr(message, kind)
        case "list_value":
            return [_value(each) for each in message.list_value.values]
        case "struct_value":
            return {name: _value(each) for name, each in message.struct_value.fields.items()}
    raise ValueError(f"not a value of an event of {MESSAGE}")


def logged(folder: Path) -> Iterator[Event]:
    """The events of both processes of a run. Those before the flight are at time 0."""
    for name in ("fcu.log", "plant.log"):
        for each in event_log.read(event_log.beside(folder / name)):
            yield each._replace(t=max(each.t, 0.0))
