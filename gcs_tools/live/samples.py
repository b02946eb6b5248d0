"""Ticks that share a Zenoh sample: the message <Topic>Ticks of docs/schemas, to bytes and back.

    repeated fixed64 sequence = 1;  repeated fixed64 time_ns = 2;  repeated <Topic> tick = 3;

Whole batches are encoded at once, by the fixed layout of a tick; what arrives is parsed by
google.protobuf, since anybody can have sent it.
"""

from __future__ import annotations

import json
from base64 import b64decode, b64encode
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass

from gcs_tools.recording.layout import Bytes, Stack, varint
from gcs_tools.recording.schema import PACKAGE, Topic
from gcs_tools.recording.table import Rows

Numbers = np.ndarray[Any, np.dtype[np.uint64]]

_SEQUENCE, _TIME, _TICK = (bytes([number << 3 | 2]) for number in (1, 2, 3))  # length-delimited
GREATEST_TICKS = 4096  # in one sample that is accepted


class Sample(NamedTuple):
    """A sample taken apart."""

    sequence: Numbers  # (n,)
    time_ns: Numbers  # (n,)
    ticks: list[bytes]  # (n,), each a message of the topic


class SampleError(ValueError):
    """Bytes that are no sample of their topic: what is wrong."""


def pack(sequence: Numbers, time_ns: Numbers, ticks: bytes) -> bytes:
    """A sample. `ticks`: tick messages one after the other, each behind tag and length."""
    length = varint(8 * len(sequence))
    return b"".join((
        _SEQUENCE, length, sequence.astype("<u8").tobytes(),
        _TIME, length, time_ns.astype("<u8").tobytes(),
        ticks,
    ))  # fmt: skip


def pack_messages(sequence: Numbers, time_ns: Numbers, messages: Sequence[bytes]) -> bytes:
    """A sample of messages of any length."""
    ticks = b"".join(_TICK + varint(len(message)) + message for message in messages)
    return pack(sequence, time_ns, ticks)


class Packer:
    """Rows into samples, one a topic."""

    def __init__(self, topics: Sequence[Topic], names: Sequence[str]) -> None:
        """`names`: of the columns of a row, that hold all that the topics carry."""
        at = {name: i for i, name in enumerate(names)}
        self.topics = tuple(topics)
        self._stack = Stack([
            (
                _TICK + varint(len(topic.layout.template)), topic.layout,
                [at[name] for name in topic.columns],
            )
            for topic in topics
        ])  # fmt: skip

    def pack(self, rows: Rows, sequence: Numbers, time_ns: Numbers) -> list[bytes]:
        """A sample for each topic, of all rows."""
        stacked: Bytes = self._stack.encode(rows)
        ends = [*self._stack.starts[1:], self._stack.row_bytes]
        return [
            pack(sequence, time_ns, stacked[:, start:end].tobytes())
            for start, end in zip(self._stack.starts, ends, strict=True)
        ]


def describe(topics: Mapping[str, Topic]) -> bytes:
    """What their messages are, as JSON, for who has nothing but what a vehicle says."""
    return json.dumps({
        topic.name: {
            "message": topic.message, "schema": b64encode(topic.schema).decode(),
            **topic.metadata,
        }
        for topic in topics.values()
    }).encode()  # fmt: skip


def described(data: bytes) -> dict[str, Topic]:
    """The topics that `describe` told of, those of numbers. Raises SampleError."""
    try:
        found = {
            name: Topic.described(name, told["message"], b64decode(told["schema"]), told)
            for name, told in json.loads(data).items()
        }
        return {name: topic for name, topic in found.items() if topic.has_layout}
    except (ValueError, AttributeError, KeyError, TypeError, RecursionError, DecodeError) as error:
        raise SampleError("no schemas of a vehicle") from error


def unpack(data: bytes) -> Sample:
    """A sample of any topic. Raises SampleError."""
    try:
        found = _any_ticks().FromString(data)
    except DecodeError as error:
        raise SampleError("not a message of ticks") from error
    n = len(found.tick)
    if not 0 < n <= GREATEST_TICKS or len(found.sequence) != n or len(found.time_ns) != n:
        raise SampleError(f"{n} ticks, {len(found.sequence)} numbers, {len(found.time_ns)} times")
    sequence, time_ns = (np.array(each, np.uint64) for each in (found.sequence, found.time_ns))
    if (np.diff(sequence.astype(np.float64)) <= 0.0).any():
        raise SampleError("its ticks are not in order")
    return Sample(sequence, time_ns, list(found.tick))


@cache
def _any_ticks() -> Any:
    """The message of every topic's samples, its ticks left as bytes."""
    file = FileDescriptorProto(name="any_ticks.proto", package=PACKAGE, syntax="proto3")
    message = file.message_type.add(name="AnyTicks")
    fixed, data = FieldDescriptorProto.TYPE_FIXED64, FieldDescriptorProto.TYPE_BYTES
    for i, (name, kind) in enumerate((("sequence", fixed), ("time_ns", fixed), ("tick", data))):
        message.field.add(
            name=name, number=i + 1, type=kind, label=FieldDescriptorProto.LABEL_REPEATED
        )
    pool = DescriptorPool()
    pool.AddSerializedFile(file.SerializeToString())
    return GetMessageClass(pool.FindMessageTypeByName(f"{PACKAGE}.AnyTicks"))
