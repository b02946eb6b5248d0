"""What is on the bus, on file: the same topics and messages as a flight's own recording.

Samples are written as they came, tick by tick; what got lost on the way is missing in the file,
and its sequence numbers say so.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.records import Message

from gcs_tools.live import ticks
from gcs_tools.live.ticks import Sample
from gcs_tools.recording import events
from gcs_tools.recording.container import Block
from gcs_tools.recording.file import RecordingFile
from gcs_tools.recording.layout import Layout, number, records
from gcs_tools.recording.reader import BUS, SOURCE
from gcs_tools.recording.schema import PACKAGE, PARAMS, TOPICS, schema

SELDOM = (PARAMS.name, events.TOPIC)  # topics of which what was before is wanted too


class BusRecorder:
    """Writes what a Watch takes; a context manager. Raises RecordingError as RecordingFile does."""

    def __init__(self, path: Path, about: dict[str, Any]) -> None:
        """`about`: what the vehicle says of itself."""
        self._file = RecordingFile(path, {SOURCE: BUS, **dict(_flat(about))})
        self._forms: dict[str, tuple[int, Layout]] = {}
        for topic in TOPICS:
            data, message = schema(topic).SerializeToString(), f"{PACKAGE}.{topic.message}"
            channel = self._file.add_channel(topic.name, message, data)
            self._forms[topic.name] = channel, ticks.form(topic)
        self._events = self._file.add_channel(events.TOPIC, events.MESSAGE, events.schema())
        self._held: dict[str, Sample] = {}  # by topic: from before, yet to be written
        self._written: dict[str, int] = {}  # by topic: the sequence number after what was held
        self._blocks: list[Block] = []
        self._pending = 0
        self.unusable = 0  # samples that no channel takes
        self.ticks = 0

    def before(self, topic: str, sample: Sample) -> None:
        """The last tick before the recording: kept of what is rarely said.

        It may be on its way too, with others before it: until the first chunk it is held back.
        """
        if topic in SELDOM:
            self._held[topic] = sample

    def add(self, topic: str, sample: Sample) -> None:
        """One sample; of one that overlaps what was written from before, the rest."""
        held = self._held.pop(topic, None)
        if held is not None and held.sequence[-1] < sample.sequence[0]:
            self._write(topic, held)
        new = int(np.searchsorted(sample.sequence, self._written.get(topic, 0)))
        if new:
            sample = Sample(sample.sequence[new:], sample.time_ns[new:], sample.ticks[new:])
        if sample.ticks:
            self._write(topic, sample)
        self.flush_if_due()

    def _write(self, topic: str, sample: Sample) -> None:
        block = self._block(topic, sample)
        if block is None:
            self.unusable += 1
            return
        self.ticks += len(sample.ticks)
        self._blocks.append(block)
        self._pending += len(block.records)

    def _block(self, topic: str, sample: Sample) -> Block | None:
        if topic == events.TOPIC:
            return self._event_block(sample)
        if topic not in self._forms:
            return None
        channel, form = self._forms[topic]
        length = len(form.template)
        if any(len(tick) != length for tick in sample.ticks):
            return None
        messages = np.frombuffer(b"".join(sample.ticks), np.uint8).reshape(-1, length)
        made = records(channel, form, messages)
        number(made, 0, sample.sequence, sample.time_ns)
        starts = np.arange(len(made), dtype=np.uint64) * np.uint64(made.shape[1])
        return Block(made.data.cast("B"), [(channel, sample.time_ns, starts)])

    def _event_block(self, sample: Sample) -> Block:
        builder, offsets = RecordBuilder(), []
        numbered = zip(sample.sequence.tolist(), sample.time_ns.tolist(), sample.ticks, strict=True)
        for sequence, time_ns, data in numbered:
            offsets.append(builder.count)
            Message(self._events, time_ns, data, time_ns, sequence & 0xFFFFFFFF).write(builder)
        return Block(builder.end(), [(self._events, sample.time_ns, np.array(offsets, np.uint64))])

    def flush_if_due(self) -> None:
        """Write a chunk when it is time to; whoever hears nothing calls this."""
        if self._file.is_due(self._pending):
            self._flush()

    def _flush(self) -> None:
        for topic, held in self._held.items():
            self._write(topic, held)
            self._written[topic] = int(held.sequence[-1]) + 1
        self._held.clear()
        blocks, self._blocks, self._pending = self._blocks, [], 0
        self._file.write(blocks)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Write what is left and the index; of a file that failed already, nothing."""
        try:
            if self._file.failed is None:
                self._flush()
                self._file.finish()
        finally:
            self._file.close()


def _flat(about: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Names and values as text: nested ones by dotted names."""
    for name, value in about.items():
        if name == "schema_version":
            continue  # the file has its own
        if isinstance(value, dict):
            yield from ((f"{name}.{inner}", text) for inner, text in _flat(value))
        else:
            yield name, value if isinstance(value, str) else json.dumps(value)
