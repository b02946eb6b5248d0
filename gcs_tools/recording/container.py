"""An MCAP file written chunk by chunk, each chunk handed over as one block of message records.

mcap's own Writer takes one message at a time, which costs three times what encoding, compressing
and writing cost together. This writer uses the library's record classes for everything that is
written once a chunk or once a file, and takes the messages as bytes.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from io import FileIO
from typing import Any, NamedTuple

import lz4.frame
import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

Uint64 = np.ndarray[Any, np.dtype[np.uint64]]

_INDEX_HEAD = struct.Struct("<BQHI")  # opcode, length of record, channel, length of entries
_FOOTER_HEAD = struct.Struct("<BQQQ")  # opcode, length, summary start, summary offset start


class Block(NamedTuple):
    """Message records, and for each channel where in them its messages begin, and when."""

    records: bytes | memoryview
    entries: list[tuple[int, Uint64, Uint64]]  # channel, times in ns ascending, offsets


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data


class Container:
    """The file being written. Every method may raise OSError from the (unbuffered) stream."""

    def __init__(self, stream: FileIO, profile: str, library: str) -> None:
        self._stream = stream
        self._offset = 0
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
            rest = rest[self._stream.write(rest) :]
        self._offset += len(data)

    def add_channel(self, topic: str, message: str, schema: bytes) -> int:
        """Announce a topic with Protobuf messages; returns its channel number."""
        number = len(self._channels) + 1
        self._schemas.append(Schema(id=number, data=schema, encoding="protobuf", name=message))
        self._channels.append(
            Channel(
                id=number, topic=topic, message_encoding="protobuf", metadata={}, schema_id=number
            )
        )
        self._write(_bytes(self._schemas[-1]) + _bytes(self._channels[-1]))
        return number

    def add_metadata(self, name: str, metadata: dict[str, str]) -> None:
        """Write names and values that hold for the whole file."""
        data = _bytes(Metadata(name=name, metadata=metadata))
        self._metadata.append(MetadataIndex(offset=self._offset, length=len(data), name=name))
        self._write(data)

    def add_chunk(self, blocks: list[Block]) -> None:
        """Write `blocks` as one chunk, compressed and with a checksum, and its index."""
        data = b"".join(block.records for block in blocks)
        indexes, offsets, start = self._message_indexes(blocks)
        times = [times for block in blocks for _, times, _ in block.entries]
        chunk = Chunk(
            compression="lz4",
            data=lz4.frame.compress(data),
            message_start_time=min(int(t[0]) for t in times),
            message_end_time=max(int(t[-1]) for t in times),
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        written = _bytes(chunk)
        after = self._offset + len(written)
        self._chunks.append(
            ChunkIndex(
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                chunk_start_offset=self._offset,
                chunk_length=len(written),
                message_index_offsets={c: after + offset for c, offset in offsets.items()},
                message_index_length=start,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                uncompressed_size=chunk.uncompressed_size,
            )
        )
        self._write(written + indexes)

    def _message_indexes(self, blocks: list[Block]) -> tuple[bytes, dict[int, int], int]:
        """The MessageIndex records, the offset of each among them, and their length."""
        pairs: dict[int, bytes] = {}
        start = 0
        for block in blocks:
            for channel, times, offsets in block.entries:
                both = np.stack([times, offsets + np.uint64(start)], axis=1).astype("<u8")
                pairs[channel] = pairs.get(channel, b"") + both.tobytes()
                self._counts[channel] += len(times)
            start += len(block.records)
        out, at = b"", {}
        for channel, data in pairs.items():
            at[channel] = len(out)
            length = _INDEX_HEAD.size - 9 + len(data)
            out += _INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, length, channel, len(data)) + data
        return out, at, len(out)

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
