"""The file of a recording that is being written: MCAP in chunks, locked, its failures in words.

mcap's own Writer takes one message at a time, and writes a fifth of the rows a second that this
one does (pyproject.toml says how that was measured). This one uses the library's record classes
for everything that is written once a chunk or once a file, and takes the messages as bytes.
"""

from __future__ import annotations

import fcntl
import queue
import struct
import threading
import time
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

from gcs_tools.recording.reader import METADATA, SCHEMA_VERSION, VERSION_KEY, RecordingError
from gcs_tools.recording.schema import PACKAGE

Uint64 = np.ndarray[Any, np.dtype[np.uint64]]
Bytes = np.ndarray[Any, np.dtype[np.uint8]]

CHUNK_BYTES = 1 << 20
WAITING = 2  # chunks that are yet to be compressed and written, at most
CHUNK_SECONDS = 0.5  # of wall time: with what is on its way, a killed recorder loses less than 1 s

_INDEX_HEAD = struct.Struct("<BQHI")  # opcode, length of record, channel, length of entries
_CHUNK_HEAD = struct.Struct(
    "<BQQQQII3sQ"
)  # up to its records: those of a Chunk, lz4 in three letters
_FOOTER_HEAD = struct.Struct("<BQQQ")  # opcode, length, summary start, summary offset start
_MESSAGE_HEAD = np.dtype(  # of a message record, up to its data
    [
        ("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"),
        ("log_time", "<u8"), ("publish_time", "<u8"),
    ]
)  # fmt: skip


def message_head(channel: int, length: int) -> bytes:
    """Of the record of a message of so many bytes, yet to be numbered."""
    head = np.zeros((), _MESSAGE_HEAD)
    head["opcode"], head["channel"] = Opcode.MESSAGE, channel
    head["length"] = _MESSAGE_HEAD.itemsize - 9 + length  # after opcode and length
    return head.tobytes()


def number(records: Bytes, start: int, sequence: np.ndarray[Any, Any], time_ns: Uint64) -> None:
    """Write sequence numbers and simulation times into the heads of message records.

    records : uint8 (n, row_bytes), heads at byte `start` of each row.
    """
    n, row_bytes = records.shape
    head: Any = np.ndarray((n,), _MESSAGE_HEAD, records, start, (row_bytes,))
    head["sequence"] = sequence.astype(np.uint32)
    head["log_time"] = head["publish_time"] = time_ns


class Block(NamedTuple):
    """Message records, and for each channel where in them its messages begin, and when."""

    records: bytes | memoryview
    entries: list[tuple[int, Uint64, Uint64]]  # channel, times in ns ascending, offsets


def block_of(channel: int, sequence: Uint64, time_ns: Uint64, messages: Sequence[bytes]) -> Block:
    """Messages of any length, of one channel."""
    builder, offsets = RecordBuilder(), []
    numbered = zip(sequence.tolist(), time_ns.tolist(), messages, strict=True)
    for of, t, data in numbered:
        offsets.append(builder.count)
        Message(channel, t, data, t, of & 0xFFFFFFFF).write(builder)
    return Block(builder.end(), [(channel, time_ns, np.array(offsets, np.uint64))])


class _Made(NamedTuple):
    """A chunk, yet to be compressed, and the MessageIndex records behind it."""

    data: bytes
    first_ns: int
    last_ns: int
    indexes: bytes
    index_at: dict[int, int]  # channel -> where its index begins among them
    counts: dict[int, int]  # channel -> messages


def _made(blocks: Sequence[Block]) -> _Made:
    """The chunk of some blocks."""
    parts: dict[int, list[bytes]] = {}
    counts: Counter[int] = Counter()
    first, last, start = [], [], 0
    for block in blocks:
        for channel, times, offsets in block.entries:
            both = np.empty((len(times), 2), "<u8")
            both[:, 0] = times
            np.add(offsets, np.uint64(start), out=both[:, 1])
            parts.setdefault(channel, []).append(both.tobytes())
            counts[channel] += len(times)
            first.append(int(times[0]))
            last.append(int(times[-1]))
        start += len(block.records)
    records, at, length = [], {}, 0
    for channel, pairs in parts.items():
        at[channel] = length
        size = sum(map(len, pairs))
        head = _INDEX_HEAD.pack(
            Opcode.MESSAGE_INDEX, _INDEX_HEAD.size - 9 + size, channel, size
        )  # fmt: skip
        records += [head, *pairs]
        length += len(head) + size
    data = b"".join(block.records for block in blocks)
    return _Made(data, min(first), max(last), b"".join(records), at, dict(counts))


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data


class _Chunks:
    """The MCAP records of a file. Every method may raise OSError from the (unbuffered) stream."""

    def __init__(self, stream: FileIO, profile: str, library: str) -> None:
        self._stream = stream
        self._offset = 0
        self.written = 0, 0  # bytes, and their CRC-32
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: Counter[int] = Counter()
        self._write(MCAP0_MAGIC + _bytes(Header(profile, library)))

    def _write(self, data: bytes) -> None:
        """Hand all of `data` to the operating system (an unbuffered write may take a part)."""
        rest = memoryview(data)
        while rest:
            taken = self._stream.write(rest)
            count, crc = self.written
            self.written = count + taken, zlib.crc32(rest[:taken], crc)
            rest = rest[taken:]
        self._offset += len(data)

    def add_channel(self, topic: str, message: str, schema: bytes, metadata: dict[str, str]) -> int:
        """Announce a topic with Protobuf messages; returns its channel number."""
        number = len(self._channels) + 1
        self._schemas.append(Schema(id=number, data=schema, encoding="protobuf", name=message))
        self._channels.append(
            Channel(
                id=number, topic=topic, message_encoding="protobuf", metadata=metadata,
                schema_id=number,
            )
        )  # fmt: skip
        self._write(_bytes(self._schemas[-1]) + _bytes(self._channels[-1]))
        return number

    def add_metadata(self, name: str, metadata: dict[str, str]) -> None:
        """Write names and values that hold for the whole file."""
        data = _bytes(Metadata(name=name, metadata=metadata))
        self._metadata.append(MetadataIndex(offset=self._offset, length=len(data), name=name))
        self._write(data)

    def add_chunk(self, made: _Made) -> None:
        """Write a chunk, compressed and with a checksum, and its index.

        Nearly all of its time is spent in zlib, lz4 and the system, which hold no lock.
        """
        compressed = lz4.frame.compress(made.data)
        length = _CHUNK_HEAD.size - 9 + len(compressed)
        head = _CHUNK_HEAD.pack(
            Opcode.CHUNK, length, made.first_ns, made.last_ns, len(made.data),
            zlib.crc32(made.data), 3, b"lz4", len(compressed),
        )  # fmt: skip
        written = len(head) + len(compressed)
        after = self._offset + written
        self._chunks.append(
            ChunkIndex(
                message_start_time=made.first_ns,
                message_end_time=made.last_ns,
                chunk_start_offset=self._offset,
                chunk_length=written,
                message_index_offsets={c: after + offset for c, offset in made.index_at.items()},
                message_index_length=len(made.indexes),
                compression="lz4",
                compressed_size=len(compressed),
                uncompressed_size=len(made.data),
            )
        )
        self._counts.update(made.counts)
        for part in (head, compressed, made.indexes):
            self._write(part)

    def finish(self) -> None:
        """Write the summary; nothing may follow."""
        self._write(_bytes(DataEnd(data_section_crc=0)))  # 0: not computed, chunks have their own
        start = self._offset
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=self._counts.total(),
            message_start_time=min((c.message_start_time for c in self._chunks), default=0),
            message_end_time=max((c.message_end_time for c in self._chunks), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups: list[tuple[Opcode, list[Any]]] = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.METADATA_INDEX, self._metadata),
        ]
        summary, offsets = b"", b""
        for opcode, records in groups:
            data = b"".join(map(_bytes, records))
            if data:
                offsets += _bytes(
                    SummaryOffset(
                        group_opcode=opcode,
                        group_start=start + len(summary),
                        group_length=len(data),
                    )
                )
                summary += data
        offsets_start = start + len(summary)
        head = _FOOTER_HEAD.pack(Opcode.FOOTER, 20, start, offsets_start)
        footer = Footer(
            summary_start=start,
            summary_offset_start=offsets_start,
            summary_crc=zlib.crc32(summary + offsets + head),
        )
        self._write(summary + offsets + _bytes(footer) + MCAP0_MAGIC)


class RecordingFile:
    """Every method raises RecordingError, naming file and reason, when it cannot be written.

    What was written before (a full disk) stays readable.
    """

    def __init__(self, path: Path, metadata: dict[str, str]) -> None:
        """Create the file at `path`, which must not exist, and write `metadata` to it."""
        self._path = path
        self.failed: str | None = None
        self._last_chunk = time.monotonic()
        self._queue: queue.Queue[_Made | None] = queue.Queue(WAITING)
        self._thread: threading.Thread | None = None
        with self._reporting():
            self._file = FileIO(path, "xb")
            with suppress(OSError):  # whoever would mend it sees that it is written
                fcntl.flock(self._file, fcntl.LOCK_EX)
        try:
            with self._reporting():
                self._chunks = _Chunks(self._file, PACKAGE, f"m-mrac {SCHEMA_VERSION}")
                self._chunks.add_metadata(METADATA, {VERSION_KEY: str(SCHEMA_VERSION), **metadata})
        except RecordingError:
            self._file.close()
            raise

    @contextmanager
    def _reporting(self) -> Iterator[None]:
        """Name the file and the reason when writing fails, now and at every later call."""
        if self.failed is not None:
            raise RecordingError(self.failed)
        try:
            yield
        except OSError as error:
            self.failed = f"{self._path}: {error.strerror}"
            raise RecordingError(self.failed) from error

    def add_channel(
        self, topic: str, message: str, schema: bytes, metadata: dict[str, str] | None = None
    ) -> int:
        """Announce a topic; returns its channel number."""
        with self._reporting():
            return self._chunks.add_channel(topic, message, schema, metadata or {})

    def is_due(self, pending_bytes: int) -> bool:
        """Whether it is time for a chunk of what is pending."""
        return pending_bytes >= CHUNK_BYTES or self.is_late

    @property
    def is_late(self) -> bool:
        """Whether the last chunk was written so long ago that what there is should be on file."""
        return time.monotonic() - self._last_chunk >= CHUNK_SECONDS

    def write(self, blocks: list[Block], wait: bool = True) -> None:
        """One chunk, of what there is.

        `wait`: until it is on file; else it is compressed and written while the next is filled.
        """
        self._last_chunk = time.monotonic()
        made = _made(blocks) if blocks else None
        if made is not None and not wait:
            with self._reporting():
                self._hand_over(made)
            return
        self._wait()
        with self._reporting():
            if made is not None:
                self._chunks.add_chunk(made)

    def _hand_over(self, made: _Made) -> None:
        if self._thread is None:  # not before: who makes a file may fork yet
            self._thread = threading.Thread(target=self._take, daemon=True, name="recording")
            self._thread.start()
        self._queue.put(made)

    def _take(self) -> None:
        """In a thread: write the chunks that are handed over, or forget them after a failure."""
        while (made := self._queue.get()) is not None:
            with suppress(RecordingError), self._reporting():
                self._chunks.add_chunk(made)
            del made

    def _wait(self) -> None:
        """Until all that was handed over is on file, or has failed."""
        if self._thread is not None:
            self._queue.put(None)
            self._thread.join()
            self._thread = None

    @property
    def written(self) -> tuple[int, int]:
        """How many bytes the file has, once it is closed, and their CRC-32."""
        return self._chunks.written

    def finish(self) -> None:
        """Write the index."""
        self._wait()
        with self._reporting():
            self._chunks.finish()

    def close(self) -> None:
        """Close the file, as it is."""
        self._wait()
        self._file.close()
