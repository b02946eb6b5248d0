"""The recorder of a flight: every tick of the plant's truth and of the flight controller's work.

MCAP with Protobuf messages (`schema`), in chunks of about 256 KiB and at most half a second
of wall time: a killed recorder loses no more than that. Rows are encoded a chunk at a time
(`layout`), which costs a few microseconds a tick for all topics together.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.records import Message

from fcu.interface.diagnostics import Wind
from fcu.kernel.buffers import columns, size
from fcu.settings import Settings
from fcu.tick import Tick
from gcs_tools.recording import events
from gcs_tools.recording.container import Block
from gcs_tools.recording.events import Event
from gcs_tools.recording.file import CHUNK_BYTES, RecordingFile
from gcs_tools.recording.layout import Encoder, Rows, layout
from gcs_tools.recording.reader import RecordingError
from gcs_tools.recording.schema import (
    FCU,
    FCU_COLUMNS,
    PACKAGE,
    PARAMS,
    PLANT,
    PLANT_COLUMNS,
    PLANT_TIMING,
    STATUS,
    TIMING,
    WIND,
    Topic,
    schema,
)
from sitl_plant.physics.types import PlantRecord

_PLANT, _TICK = size(PlantRecord), size(Tick)
_WIND = _TICK + size(Wind)


def _nanoseconds(t: Rows) -> np.ndarray[Any, np.dtype[np.uint64]]:
    """Simulation time in s as whole nanoseconds. Raises ValueError if it cannot be that."""
    usable = np.isfinite(t) & (t >= 0.0)
    if not usable.all():
        raise ValueError(f"not a simulation time: {t[~usable][0]}")
    return np.rint(t * 1e9).astype(np.uint64)


def _with_time(rows: Rows, first: int, last: int | None) -> Rows:
    """Columns of `rows`, the time before them."""
    return np.column_stack([rows[:, :1], rows[:, first:last]])


class _Stream:
    """Rows of one kind, on their way into the recording. Column 0 is the simulation time."""

    def __init__(self, file: RecordingFile, topics: tuple[Topic, ...], names: list[str]) -> None:
        self.width = len(names)
        self._pending: list[Rows] = []
        self._written = 0
        forms = []
        for topic in topics:
            data, message = schema(topic).SerializeToString(), f"{PACKAGE}.{topic.message}"
            form = layout(data, message)
            channel = file.add_channel(topic.name, message, data)
            forms.append((channel, form, [names.index(topic.column(name)) for name in form.names]))
        self._encoder = Encoder(forms)
        self.pending_bytes = 0

    def batches(self, rows: Rows) -> Iterator[Rows]:
        """`rows` in parts of at most a chunk. Raises ValueError for rows of another width."""
        if rows.ndim != 2 or rows.shape[1] != self.width or rows.dtype != np.float64:
            raise ValueError(f"expected float64 (n, {self.width}), got {rows.dtype} {rows.shape}")
        step = max(1, CHUNK_BYTES // self._encoder.row_bytes)
        for i in range(0, len(rows), step):
            yield rows[i : i + step]

    def add(self, rows: Rows) -> None:
        """Keep a copy of `rows` for the next chunk."""
        _nanoseconds(rows[:, 0])
        self._pending.append(rows.copy())
        self.pending_bytes += len(rows) * self._encoder.row_bytes

    def block(self) -> Block | None:
        """The messages of all rows kept, which are then forgotten."""
        if not self._pending:
            return None
        rows = np.concatenate(self._pending)
        self._pending.clear()
        self.pending_bytes = 0
        times = _nanoseconds(rows[:, 0])
        records = self._encoder.encode(rows, times, self._written)
        self._written += len(rows)
        row_starts = np.arange(len(rows), dtype=np.uint64) * np.uint64(self._encoder.row_bytes)
        index = [
            (channel, times, row_starts + np.uint64(start))
            for channel, start in zip(self._encoder.channels, self._encoder.starts, strict=True)
        ]
        return Block(records.data.cast("B"), index)


class Recorder:
    """Writes one recording; a context manager. For one thread.

    Every method raises RecordingError, naming file and reason, when the file cannot be written
    (a full disk); what was written before stays readable.
    """

    def __init__(self, path: Path, metadata: dict[str, str]) -> None:
        """Create the file at `path`, which must not exist, and write `metadata` to it."""
        self._closed = False
        self._events: list[Event] = []
        self._events_written = 0
        self._has_params = False
        self._streams: list[_Stream] = []
        self._file = RecordingFile(path, metadata)
        try:
            self._plant = self._stream((PLANT,), PLANT_COLUMNS[:_PLANT])
            self._plant_report = self._stream((PLANT_TIMING,), ["t", *PLANT_COLUMNS[_PLANT:]])
            self._fcu = self._stream(FCU, FCU_COLUMNS[:_TICK])
            self._wind = self._stream((WIND,), ["t", *FCU_COLUMNS[_TICK:_WIND]])
            self._report = self._stream((STATUS, TIMING), ["t", *FCU_COLUMNS[_WIND:]])
            self._params = self._stream((PARAMS,), ["t", *columns(Settings)])
            self._event_channel = self._file.add_channel(
                events.TOPIC, events.MESSAGE, events.schema()
            )
        except RecordingError:
            self._file.close()
            raise

    def _stream(self, topics: tuple[Topic, ...], names: list[str]) -> _Stream:
        self._streams.append(_Stream(self._file, topics, names))
        return self._streams[-1]

    def _add(self, stream: _Stream, rows: Rows) -> None:
        for batch in stream.batches(rows):
            stream.add(batch)
            if self._file.is_due(sum(each.pending_bytes for each in self._streams)):
                self.flush()

    def add_plant(self, rows: Rows) -> None:
        """Record control ticks of the truth.

        float64 (n, size(PlantRecord)), or whole rows of the plant, with its PlantReport.
        """
        if rows.shape[1:] == (len(PLANT_COLUMNS),):
            self._add(self._plant_report, _with_time(rows, _PLANT, None))
            rows = rows[:, :_PLANT]
        self._add(self._plant, rows)

    def add_fcu(self, rows: Rows) -> None:
        """Record control ticks of the flight controller.

        float64 (n, size(Tick)), or whole rows of the flight controller, with its Report.
        """
        if rows.shape[1:] == (len(FCU_COLUMNS),):
            self._add(self._wind, _with_time(rows, _TICK, _WIND))
            self._add(self._report, _with_time(rows, _WIND, None))
            rows = rows[:, :_TICK]
        self._add(self._fcu, rows)

    def add_wind(self, t: Rows, wind: Rows) -> None:
        """Record what wind was read from the estimates: s float64 (n,), m/s float64 (n, 3)."""
        self._add(self._wind, np.column_stack([t, wind]))

    def set_params(self, row: Rows, t: float = 0.0) -> None:
        """Record what law and guard were told: float64 (size(Settings),). Once a flight."""
        if self._has_params:
            raise ValueError("the law's parameters are recorded already")
        if row.shape != (size(Settings),):
            raise ValueError(f"expected ({size(Settings)},), got {row.shape}")
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
        self._events.sort(key=lambda event: event.t)
        times = _nanoseconds(np.array([event.t for event in self._events]))
        builder, offsets = RecordBuilder(), []
        for event, time_ns in zip(self._events, times.tolist(), strict=True):
            offsets.append(builder.count)
            Message(
                channel_id=self._event_channel,
                sequence=self._events_written,
                log_time=time_ns,
                publish_time=time_ns,
                data=events.encode(event),
            ).write(builder)
            self._events_written += 1
        self._events.clear()
        index = [(self._event_channel, times, np.array(offsets, np.uint64))]
        return Block(builder.end(), index)

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

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close; of a recording that failed already, only the file."""
        if self._file.failed is None:
            self.close()
        else:
            self._file.close()
