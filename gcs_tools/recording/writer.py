"""The recording of a flight being written: every tick of the plant's truth and the controller's work.

MCAP with Protobuf messages (`schema`), in chunks of about 1 MiB and at most half a second of wall
time: a killed recorder loses little more than that. Rows are encoded a chunk at a time (`layout`);
a full chunk is compressed and written by a thread while the next one is filled.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from fcu.interface.event_log import LEVELS, Event
from fcu.kernel.buffers import columns, size
from gcs_tools.recording import events
from gcs_tools.recording.layout import Stack
from gcs_tools.recording.mcap_file import (
    CHUNK_BYTES,
    Block,
    Bytes,
    RecordingFile,
    Uint64,
    block_of,
    message_head,
    number,
)
from gcs_tools.recording.reader import RecordingError
from gcs_tools.recording.schema import (
    FCU,
    OURS,
    PARAMS,
    PLANT_TIMING,
    STATUS,
    TIMING,
    TRUTH,
    WIND,
    Kinds,
    Topic,
)
from gcs_tools.recording.table import Rows


def _nanoseconds(t: Rows) -> Uint64:
    """Simulation time in s as whole nanoseconds. Raises ValueError if it cannot be that."""
    usable = np.isfinite(t) & (t >= 0.0)
    if not usable.all():
        raise ValueError(f"not a simulation time: {t[~usable][0]}")
    return np.rint(t * 1e9).astype(np.uint64)


class _Stream:
    """Topics that are written together, from rows of one kind. Column 0 is the simulation time."""

    def __init__(
        self, channels: Sequence[int], counts: dict[int, int], topics: Sequence[Topic],
        names: Sequence[str],
    ) -> None:  # fmt: skip
        """`counts`: messages of each channel so far.

        `names`: of the columns of the rows, that hold all that the topics carry.
        """
        at = {name: i for i, name in enumerate(names)}
        self._channels = channels
        self._counts = counts
        self._stack = Stack([
            (
                message_head(channel, len(topic.layout.template)), topic.layout,
                [at[name] for name in topic.columns],
            )
            for channel, topic in zip(channels, topics, strict=True)
        ])  # fmt: skip
        self.row_bytes = self._stack.row_bytes
        self._room = max(1, CHUNK_BYTES // self.row_bytes)
        self._width = len(names)
        self._kept = 0  # rows
        self._rows: Rows | None = None  # (room, width): those kept
        self._out: Bytes | None = None  # what they are encoded into

    @property
    def pending_bytes(self) -> int:
        """Of what is kept."""
        return self._kept * self.row_bytes

    def add(self, rows: Rows) -> Rows:
        """Keep a copy of as many of `rows` as there is room for; the rest of them."""
        if self._rows is None or self._out is None:
            self._rows, self._out = (
                np.empty((self._room, self._width)),
                self._stack.blank(self._room),
            )
        n = min(len(rows), self._room - self._kept)
        self._rows[self._kept : self._kept + n] = rows[:n]
        self._kept += n
        return rows[n:]

    @property
    def is_full(self) -> bool:
        """Whether there is no room for another row."""
        return self._kept == self._room

    def block(self) -> Block | None:
        """The messages of all rows kept, which are then forgotten; valid until the next."""
        n, self._kept = self._kept, 0
        if not n or self._rows is None or self._out is None:
            return None
        times = _nanoseconds(self._rows[:n, 0])
        records = self._stack.encode(self._rows[:n], self._out[:n])
        row_starts = np.arange(n, dtype=np.uint64) * np.uint64(self.row_bytes)
        index = []
        for channel, start in zip(self._channels, self._stack.starts, strict=True):
            first = self._counts[channel]
            self._counts[channel] += n
            number(records, start, np.arange(first, first + n), times)
            index.append((channel, times, row_starts + np.uint64(start)))
        return Block(records.data.cast("B"), index)


class RecordingWriter:
    """Writes one recording; a context manager. For one thread.

    Every method raises RecordingError, naming file and reason, when the file cannot be written
    (a full disk); what was written before stays readable.
    """

    def __init__(self, path: Path, metadata: dict[str, str], kinds: Kinds = OURS) -> None:
        """Create the file at `path`, which must not exist, and write `metadata` to it."""
        self._kinds = kinds
        self._fcu_row, self._plant_row = kinds.fcu_row, kinds.plant_row
        self._closed = False
        self._events: list[Event] = []
        self._events_written = 0
        self._has_params = False
        self._streams: list[_Stream] = []
        self._file = RecordingFile(path, metadata)
        topics, fcu, plant = kinds.topics, columns(self._fcu_row), columns(self._plant_row)
        of_ticks = [topic for topic in topics.values() if topic.row == FCU]
        try:
            self._channels = {
                name: self._file.add_channel(*topic[:3], topic.metadata)
                for name, topic in topics.items()
            }
            self._event_channel = self._file.add_channel(
                events.TOPIC, events.MESSAGE, events.schema()
            )
        except RecordingError:
            self._file.close()
            raise
        self._counts = dict.fromkeys(self._channels.values(), 0)
        self._plant = self._stream([topics[TRUTH]], plant[: size(kinds.record)])
        self._whole_plant = self._stream([topics[TRUTH], topics[PLANT_TIMING]], plant)
        self._fcu = self._stream(of_ticks, fcu[: size(kinds.tick)])
        reports = [topics[name] for name in (WIND, STATUS, TIMING) if name in topics]
        self._whole_fcu = self._stream([*of_ticks, *reports], fcu)
        params = topics.get(PARAMS)
        self._params = None if params is None else self._stream([params], params.columns)

    def _stream(self, topics: Sequence[Topic], names: Sequence[str]) -> _Stream:
        channels = [self._channels[topic.name] for topic in topics]
        self._streams.append(_Stream(channels, self._counts, topics, names))
        return self._streams[-1]

    def _add(self, stream: _Stream, rows: Rows) -> None:
        if len(rows):
            _nanoseconds(rows[:, 0])
        while len(rows):
            rows = stream.add(rows)
            if stream.is_full or self._pending_bytes >= CHUNK_BYTES:
                self._write(wait=False)
        if self._file.is_late:
            self.flush()

    @property
    def _pending_bytes(self) -> int:
        return sum(stream.pending_bytes for stream in self._streams)

    def add_plant(self, rows: Rows) -> None:
        """Record control ticks of the truth.

        float64 (n, size(kinds.record)), or whole rows of the plant, with its PlantReport.
        """
        whole = _is_whole(rows, self._kinds.record, self._plant_row)
        self._add(self._whole_plant if whole else self._plant, rows)

    def add_fcu(self, rows: Rows) -> None:
        """Record control ticks of the flight controller.

        float64 (n, size(kinds.tick)), or whole rows of the flight controller, with its Report.
        """
        whole = _is_whole(rows, self._kinds.tick, self._fcu_row)
        self._add(self._whole_fcu if whole else self._fcu, rows)

    def set_params(self, row: Rows, t: float = 0.0) -> None:
        """Record what the law was told: float64 (size(kinds.params),). Once a flight."""
        if self._has_params or self._params is None:
            raise ValueError("the law's parameters are recorded already, or there are none")
        if row.shape != (size(self._kinds.params),):
            raise ValueError(f"expected ({size(self._kinds.params)},), got {row.shape}")
        self._has_params = True
        self._add(self._params, np.concatenate([[t], row])[None, :])

    def event(self, event: Event) -> None:
        """Record that something happened. Raises ValueError."""
        if event.level not in LEVELS:
            raise ValueError(f"level {event.level}: expected one of {', '.join(LEVELS)}")
        self._events.append(event)

    def _event_block(self) -> Block | None:
        if not self._events:
            return None
        told = sorted(self._events, key=lambda event: event.t)
        self._events.clear()
        times = _nanoseconds(np.array([event.t for event in told]))
        first, self._events_written = self._events_written, self._events_written + len(told)
        sequence = np.arange(first, self._events_written, dtype=np.uint64)
        return block_of(self._event_channel, sequence, times, [*map(events.encode, told)])

    def flush(self) -> None:
        """Write everything recorded so far; whoever records nothing for a while calls this."""
        self._write(wait=True)

    def _write(self, wait: bool) -> None:
        made = [*(stream.block() for stream in self._streams), self._event_block()]
        self._file.write([block for block in made if block is not None], wait)

    def close(self) -> None:
        """Write what is left and the index, and close the file. A second call does nothing."""
        if self._closed:
            return
        self._closed = True
        try:
            self.flush()
            self._file.finish()
        finally:
            self._file.close()

    @property
    def written(self) -> tuple[int, int]:
        """How many bytes the file has, once it is closed, and their CRC-32."""
        return self._file.written

    @property
    def has_failed(self) -> bool:
        """Whether the file could not be written."""
        return self._file.failed is not None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close; of a recording that failed already, only the file.

        Raises RecordingError, also if it failed after all was handed over and nobody was told.
        """
        if not self.has_failed:
            self.close()
            return
        self._file.close()
        if kind is None:
            raise RecordingError(self._file.failed or "the recording failed")


def _is_whole(rows: Rows, part: Any, whole: Any) -> bool:
    """Whether rows have their report behind them. Raises ValueError if they are no such rows."""
    if rows.ndim == 2 and rows.dtype == np.float64 and rows.shape[1] in (size(part), size(whole)):
        return bool(rows.shape[1] == size(whole))
    raise ValueError(f"expected float64 (n, {size(part)}), got {rows.dtype} {rows.shape}")
