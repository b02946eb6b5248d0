"""The recording of a flight being written: every tick of the plant's truth and the controller's work.

MCAP with Protobuf messages (`schema`), in chunks of about 256 KiB and at most half a second
of wall time: a killed recorder loses no more than that. Rows are encoded a chunk at a time
(`layout`), which costs a few microseconds a tick for all topics together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from fcu.kernel.buffers import columns, size
from fcu.kernel.rows import column
from gcs_tools.recording import events
from gcs_tools.recording.events import Event
from gcs_tools.recording.layout import Stack
from gcs_tools.recording.mcap_file import (
    CHUNK_BYTES,
    Block,
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

    def __init__(self, file: RecordingFile, topics: Sequence[Topic], names: Sequence[str]) -> None:
        """`names`: of the columns of the rows, that hold all that the topics carry."""
        at = {name: i for i, name in enumerate(names)}
        self._channels = [file.add_channel(*topic[:3], topic.metadata) for topic in topics]
        self._stack = Stack([
            (
                message_head(channel, len(topic.layout.template)), topic.layout,
                [at[name] for name in topic.columns],
            )
            for channel, topic in zip(self._channels, topics, strict=True)
        ])  # fmt: skip
        self._pending: list[Rows] = []
        self._written = 0
        self.pending_bytes = 0

    def batches(self, rows: Rows) -> Iterator[Rows]:
        """`rows` in parts of at most a chunk."""
        step = max(1, CHUNK_BYTES // self._stack.row_bytes)
        for i in range(0, len(rows), step):
            yield rows[i : i + step]

    def add(self, rows: Rows) -> None:
        """Keep a copy of `rows` for the next chunk."""
        _nanoseconds(rows[:, 0])
        self._pending.append(rows.copy())
        self.pending_bytes += len(rows) * self._stack.row_bytes

    def block(self) -> Block | None:
        """The messages of all rows kept, which are then forgotten."""
        if not self._pending:
            return None
        rows = np.concatenate(self._pending)
        self._pending.clear()
        self.pending_bytes = 0
        times = _nanoseconds(rows[:, 0])
        sequence = np.arange(self._written, self._written + len(rows))
        self._written += len(rows)
        records = self._stack.encode(rows)
        row_starts = np.arange(len(rows), dtype=np.uint64) * np.uint64(self._stack.row_bytes)
        index = []
        for channel, start in zip(self._channels, self._stack.starts, strict=True):
            number(records, start, sequence, times)
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
            self._plant = self._stream([topics[TRUTH]], plant)
            self._plant_report = self._stream([topics[PLANT_TIMING]], plant)
            self._fcu = self._stream(of_ticks, fcu)
            self._wind = self._stream([topics[WIND]], topics[WIND].columns)
            self._report = self._stream([topics[STATUS], topics[TIMING]], fcu)
            self._params = self._stream([topics[PARAMS]], topics[PARAMS].columns)
            self._event_channel = self._file.add_channel(
                events.TOPIC, events.MESSAGE, events.schema()
            )
        except RecordingError:
            self._file.close()
            raise

    def _stream(self, topics: Sequence[Topic], names: Sequence[str]) -> _Stream:
        self._streams.append(_Stream(self._file, topics, names))
        return self._streams[-1]

    def _add(self, stream: _Stream, rows: Rows) -> None:
        for batch in stream.batches(rows):
            stream.add(batch)
            if self._file.is_due(sum(each.pending_bytes for each in self._streams)):
                self.flush()

    def add_plant(self, rows: Rows) -> None:
        """Record control ticks of the truth.

        float64 (n, size(kinds.record)), or whole rows of the plant, with its PlantReport.
        """
        if _is_whole(rows, self._kinds.record, self._plant_row):
            self._add(self._plant_report, rows)
        self._add(self._plant, rows)

    def add_fcu(self, rows: Rows) -> None:
        """Record control ticks of the flight controller.

        float64 (n, size(kinds.tick)), or whole rows of the flight controller, with its Report.
        """
        if _is_whole(rows, self._kinds.tick, self._fcu_row):
            self._add(
                self._wind, np.column_stack([rows[:, :1], column(self._fcu_row, rows, "wind")])
            )
            self._add(self._report, rows)
        self._add(self._fcu, rows)

    def add_wind(self, t: Rows, wind: Rows) -> None:
        """Record what wind was read from the estimates: s float64 (n,), m/s float64 (n, 3)."""
        self._add(self._wind, np.column_stack([t, wind]))

    def set_params(self, row: Rows, t: float = 0.0) -> None:
        """Record what the law was told: float64 (size(kinds.params),). Once a flight."""
        if self._has_params:
            raise ValueError("the law's parameters are recorded already")
        if row.shape != (size(self._kinds.params),):
            raise ValueError(f"expected ({size(self._kinds.params)},), got {row.shape}")
        self._has_params = True
        self._add(self._params, np.concatenate([[t], row])[None, :])

    def event(self, t: float, text: str, level: str = "info") -> None:
        """Record that something happened at simulation time t (s); level: one of events.LEVELS."""
        if level not in events.LEVELS:
            raise ValueError(f"level {level}: expected one of {', '.join(events.LEVELS)}")
        self._events.append(Event(t, level, text))

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
        made = [*(stream.block() for stream in self._streams), self._event_block()]
        self._file.write([block for block in made if block is not None])

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
        """Close; of a recording that failed already, only the file."""
        if self.has_failed:
            self._file.close()
        else:
            self.close()


def _is_whole(rows: Rows, part: Any, whole: Any) -> bool:
    """Whether rows have their report behind them. Raises ValueError if they are no such rows."""
    if rows.ndim == 2 and rows.dtype == np.float64 and rows.shape[1] in (size(part), size(whole)):
        return bool(rows.shape[1] == size(whole))
    raise ValueError(f"expected float64 (n, {size(part)}), got {rows.dtype} {rows.shape}")
