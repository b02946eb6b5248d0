"""A recording whose writer was killed, made whole: what can be read, with its index and its end.

Any MCAP file will do, ours or not. What was written up to the last whole chunk is kept; readers
that look for the index at the end of a file (Foxglove, PlotJuggler) then open it.
"""

from __future__ import annotations

import fcntl
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Header, McapRecord, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from fcu.interface.files import whole_file
from fcu.interface.files.input_file import opened
from gcs_tools.recording.reader import RecordingError
from gcs_tools.recording.records import records, whole_records


@dataclass(frozen=True)
class Recovered:
    """What became of a file."""

    messages: int
    first_s: float  # log time of the first and the last message; simulation time in ours
    last_s: float
    complete: bool  # it had its end: nothing was done
    damage: str  # what the reading ended at, if not at the end of the file


class _Copy:
    """Records from one file to another, their schemas and channels numbered anew."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas = {0: 0}
        self._channels: dict[int, int] = {}
        self.messages = 0
        self.times: list[int] = []  # of the first message and the last, ns

    def take(self, record: object) -> None:
        """One record; what only helps to find others is written anew at the end."""
        if isinstance(record, Header):
            self._writer.start(record.profile, record.library)
        elif isinstance(record, Schema) and record.id not in self._schemas:
            self._schemas[record.id] = self._writer.register_schema(
                record.name, record.encoding, record.data
            )
        elif isinstance(record, Channel) and record.id not in self._channels:
            self._channels[record.id] = self._writer.register_channel(
                record.topic, record.message_encoding, self._schemas[record.schema_id],
                record.metadata,
            )  # fmt: skip
        elif isinstance(record, Metadata):
            self._writer.add_metadata(record.name, record.metadata)
        elif isinstance(record, Message):
            self._writer.add_message(
                self._channels[record.channel_id], record.log_time, record.data,
                record.publish_time, record.sequence,
            )  # fmt: skip
            self.messages += 1
            first, last = self.times or (record.log_time, 0)
            self.times = [min(first, record.log_time), max(last, record.log_time)]


def recover(path: Path, out: Path | None = None) -> Recovered:
    """Make the recording at `path` whole, in its place or as `out`.

    In its place only if it was merely cut short: what lies behind a damage is lost, and stays in
    the file as it was. Raises RecordingError, with both files as they were, if nothing can be
    read, if it is still written, if it is damaged and there is no `out`, or if the new file cannot be written.
    """
    target = path if out is None else out
    try:
        with _unwritten(path) as file:
            return _mended(file, path, target)
    except OSError as error:
        raise RecordingError(f"{error.filename or path}: {error.strerror}") from error


def _mended(file: BinaryIO, path: Path, target: Path) -> Recovered:
    end, whole = whole_records(file)
    with whole_file.part(target) as part:
        writer = Writer(part.file, chunk_size=256 * 1024, compression=CompressionType.LZ4)
        copy = _Copy(writer)
        damage = _copied(records(file, end), copy, path)
        writer.finish()
        first, last = (1e-9 * t for t in (copy.times[0], copy.times[-1]))
        done = Recovered(copy.messages, first, last, whole and not damage, damage)
        if damage and target is path:
            raise RecordingError(
                f"{path}: damaged after {last:.3f} s ({damage}); "
                "what lies before can be had with --out FILE"
            )
        if not (done.complete and target is path):
            part.put_in_place(path.stat().st_mode & 0o777)
    return done


@contextmanager
def _unwritten(path: Path) -> Iterator[BinaryIO]:
    """A file that nobody writes to. Raises RecordingError, OSError."""
    with opened(path) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            raise RecordingError(f"{path}: it is being recorded (end the flight first)") from None
        yield file


def _copied(whole: Iterator[McapRecord], copy: _Copy, path: Path) -> str:
    """Copy whole records; the damage that the reading ended at, if it did."""
    try:
        for record in whole:
            copy.take(record)
    except EndOfFile:  # the regular end of what a killed recorder leaves
        pass
    except (McapError, ValueError, RuntimeError, KeyError, struct.error) as error:
        if copy.messages == 0:
            raise RecordingError(f"{path}: {str(error) or 'not a recording'}") from error
        if isinstance(error, RuntimeError):  # of lz4, in its own words
            return "a chunk that cannot be decompressed"
        return str(error) or type(error).__name__
    if copy.messages == 0:
        raise RecordingError(f"{path}: no message of it was written")
    return ""
