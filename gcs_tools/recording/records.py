"""The records of an MCAP file, read one after the other: bounded in size, and in what they unpack to.

A file is never in memory as a whole. Nothing that it says of itself is believed before it is
checked: a chunk of a few kilobytes can be made to unpack to gigabytes.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import replace
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.opcode import Opcode
from mcap.records import Chunk, McapRecord
from mcap.stream_reader import StreamReader, breakup_chunk

from fcu.interface.files.input_file import MIB

TIMES = 50  # a file unpacks to so many times its size at most; flights to less than 3 times
LONGEST = 256 * MIB  # of a record
MAGIC_BYTES = 8
_RECORD_HEAD = struct.Struct("<BQ")  # opcode, length


def whole_records(file: BinaryIO) -> tuple[int, bool]:
    """Where the last whole record of a file ends, and whether the file is complete."""
    size = os.fstat(file.fileno()).st_size
    end = MAGIC_BYTES
    while end + _RECORD_HEAD.size <= size:
        file.seek(end)
        opcode, length = _RECORD_HEAD.unpack(file.read(_RECORD_HEAD.size))
        if not opcode or end + _RECORD_HEAD.size + length > size:
            break  # there is no opcode 0: it is what a file holds that nobody has written to
        end += _RECORD_HEAD.size + length
        if opcode == Opcode.FOOTER:
            whole = end + MAGIC_BYTES <= size
            return end + MAGIC_BYTES if whole else end, whole
    return end, False


class _Until:
    """A stream of the first bytes of a file."""

    def __init__(self, file: BinaryIO, end: int) -> None:
        self._file, self._left = file, end
        file.seek(0)

    def read(self, length: int) -> bytes:
        data = self._file.read(min(length, self._left))
        self._left -= len(data)
        return data


def records(file: BinaryIO, end: int) -> Iterator[McapRecord]:
    """The records of the first `end` bytes of a file, those of its chunks among them.

    Raises what mcap raises for damage (EndOfFile where they end without a footer), RuntimeError of
    lz4, ValueError for a chunk that is damaged or would unpack to more than TIMES the file's size.
    """
    left = TIMES * os.fstat(file.fileno()).st_size
    stream: BinaryIO = _Until(file, end)  # type: ignore[assignment]
    reader = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=LONGEST)
    for record in reader.records:
        if isinstance(record, Chunk):
            left -= record.uncompressed_size
            if left < 0:
                raise ValueError(f"it unpacks to more than {TIMES} times its size")
            yield from breakup_chunk(_unpacked(record), validate_crc=True)
        else:
            yield record


def _unpacked(chunk: Chunk) -> Chunk:
    """A chunk that is not compressed. Raises ValueError if it is not of the size that it says."""
    size, data = chunk.uncompressed_size, chunk.data
    if chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    elif chunk.compression == "zstd":
        try:
            told = zstandard.get_frame_parameters(data).content_size
            known = told in (size, zstandard.CONTENTSIZE_UNKNOWN)
            unpack = zstandard.ZstdDecompressor().decompress
            data = unpack(data, max_output_size=max(size, 1)) if known else b""
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from error
    if len(data) != size:
        raise ValueError("a chunk does not unpack to the size that it says")
    return replace(chunk, compression="", data=data)
