"""A vehicle recorded off the bus until it leaves: the same topics and messages as a flight's own.

Samples are written as they came, tick by tick, with the schemas that the vehicle gives; what got
lost on the way is missing in the file, and its sequence numbers say so.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from gcs_tools.live.samples import Sample
from gcs_tools.live.standstill import Standstill, end_in, why
from gcs_tools.live.subscriber import LOOK_S, Subscriber
from gcs_tools.recording import events
from gcs_tools.recording.layout import LayoutError, decode
from gcs_tools.recording.mcap_file import Block, RecordingFile, block_of, message_head, number
from gcs_tools.recording.reader import BUS, SOURCE, VALUES
from gcs_tools.recording.schema import PARAMS, TIMING, TOPICS, Topic

GONE_S = 2.0  # wall: a vehicle that is back within it has not left
GONE, OUT_OF_SIGHT = "the vehicle is gone", "the vehicle is out of sight"  # why it ended
_BIN_S, _BINS = 1e-4, 20_000  # of the histogram of latencies: 0.1 ms, to 2 s

SELDOM = (PARAMS, events.TOPIC)  # topics of which what was before is wanted too

Progress = Callable[[str], None]


class BusRecorder:
    """Writes what a Subscriber takes; a context manager. Raises RecordingError as RecordingFile does."""

    def __init__(self, path: Path, about: dict[str, Any], topics: Mapping[str, Topic]) -> None:
        """`about`, `topics`: what the vehicle says of itself, and of its topics of numbers."""
        self._file = RecordingFile(path, {SOURCE: BUS, **dict(_flat(about))})
        self._channels = {
            topic.name: (self._file.add_channel(*topic[:3], topic.metadata), topic.layout)
            for topic in topics.values()
        }
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
            return block_of(self._events, *sample)
        if topic not in self._channels:
            return None
        channel, form = self._channels[topic]
        if any(len(tick) != len(form.template) for tick in sample.ticks):
            return None
        head = message_head(channel, len(form.template))
        data = b"".join(head + tick for tick in sample.ticks)
        records = np.frombuffer(bytearray(data), np.uint8).reshape(len(sample.ticks), -1)
        number(records, 0, sample.sequence, sample.time_ns)
        starts = np.arange(len(records), dtype=np.uint64) * np.uint64(records.shape[1])
        return Block(records.data.cast("B"), [(channel, sample.time_ns, starts)])

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
        if isinstance(value, dict) and name != VALUES:
            yield from ((f"{name}.{inner}", text) for inner, text in _flat(value))
        else:
            yield name, value if isinstance(value, str) else json.dumps(value)


class Latency:
    """How old ticks are when they are here: wall time, of one machine's clock."""

    def __init__(self, timing: Topic) -> None:
        """`timing`: the topic /fcu/timing."""
        self._layout = timing.layout
        self._published = timing.columns.index("timing.published")
        self._counts = np.zeros(_BINS, np.int64)

    def see(self, sample: Sample) -> None:
        """A sample of /fcu/timing that has just come."""
        try:
            published = decode(self._layout, sample.ticks)[:, self._published]
        except LayoutError:
            return
        published = published[np.isfinite(published)]
        age = np.clip((time.time() - published) / _BIN_S, 0, _BINS - 1)
        self._counts += np.bincount(age.astype(np.int64), minlength=_BINS)

    def percentile(self, percent: float) -> float | None:
        """s; None if nothing was seen."""
        total = self._counts.sum()
        if not total:
            return None
        at = int(np.searchsorted(np.cumsum(self._counts), percent / 100.0 * total))
        return (at + 0.5) * _BIN_S


@dataclass
class RecordingSummary:
    """What a recording came to."""

    why: str = ""  # it ended
    first_s: float | None = None  # simulation time
    last_s: float | None = None
    ticks: int = 0  # control ticks of the flight controller
    counted: dict[str, Any] = field(default_factory=dict)  # by topic: subscriber.Counted
    unusable: int = 0
    end_seen: bool = False  # it was told what there was to record
    stands: bool = False  # it ended because simulation time stands
    end: str = ""  # of the flight, as the vehicle told it
    _spans: dict[str, tuple[float, float]] = field(default_factory=dict)  # by topic
    _before: dict[str, float] = field(default_factory=dict)  # s, of flights before a reset
    replayed: bool = False  # its ticks were published long ago
    latency: Latency = field(default_factory=lambda: Latency(TOPICS[TIMING]))

    def see(self, topic: str, sample: Sample) -> None:
        """A sample that was recorded; what is rarely said may be of long before."""
        times = sample.time_ns
        if topic == events.TOPIC:
            self.end = end_in(sample, self.end)
        if topic in SELDOM:
            return
        first, last = float(times[0]) * 1e-9, float(times[-1]) * 1e-9
        self.first_s = first if self.first_s is None else self.first_s
        self.last_s = max(self.last_s or 0.0, last)
        began, until = self._spans.get(topic, (first, first))
        if first < until:  # time begins again: the vehicle was reset
            self._before[topic] = self._before.get(topic, 0.0) + until - began
            began = first
        self._spans[topic] = began, last
        if topic == TIMING:
            self.ticks += len(times)
            if not self.replayed:
                self.latency.see(sample)

    @property
    def least_s(self) -> float:
        """Simulation time that is recorded of every topic."""
        lasted = (
            last - first + self._before.get(topic, 0.0)
            for topic, (first, last) in self._spans.items()
        )
        return min(lasted, default=0.0)

    @property
    def lost(self) -> dict[str, int]:
        """Ticks that are missing, by topic."""
        return {topic: c.lost for topic, c in self.counted.items() if c.lost}

    @property
    def strange(self) -> int:
        """Samples that were not the vehicle's."""
        return self.unusable + int(sum(c.unreadable for c in self.counted.values()))

    def line(self) -> str:
        """How it stands, while it goes on."""
        lost = sum(self.lost.values())
        return f"{self.last_s or 0.0:10.3f} s   {self.ticks} ticks   {lost} lost"

    def summary(self, out: Path) -> str:
        """What it came to, for people."""
        if self.first_s is None or self.last_s is None:
            return f"{out}: nothing came ({self.why})"
        lines = [
            f"{out}: {self.first_s:.3f} to {self.last_s:.3f} s, {self.ticks} ticks"
            f" ({self.why})"
        ]  # fmt: skip
        by_topic = ", ".join(f"{topic} {n}" for topic, n in self.lost.items())
        whole = f"  lost on the bus: {by_topic}" if by_topic else "  every tick is in it"
        if self.why == OUT_OF_SIGHT:
            whole += " up to there: the publisher was killed, or the connection to it broke"
        lines.append(whole)
        p50, p99 = self.latency.percentile(50.0), self.latency.percentile(99.0)
        if p50 is not None and p99 is not None:
            lines.append(f"  from tick to here: {p50 * 1e3:.1f} ms, 99 % within {p99 * 1e3:.1f} ms")
        if self.strange:
            lines.append(f"  {self.strange} samples were not the vehicle's, and are not in it")
        return "\n".join(lines)

    def as_dict(self, out: Path) -> dict[str, Any]:
        """What it came to, for programs."""
        return {
            "schema": 1,
            "path": str(out),
            "ended": self.why,
            "end_seen": self.end_seen,
            "first_s": self.first_s,
            "last_s": self.last_s,
            "ticks": self.ticks,
            "lost": self.lost,
            "topics": {topic: c.ticks for topic, c in self.counted.items()},
            "not_the_vehicles": self.strange,
            "latency_p50_s": self.latency.percentile(50.0),
            "latency_p99_s": self.latency.percentile(99.0),
        }


def record_until(
    vehicle: Subscriber,
    out: Path,
    seconds: float | None,
    done: RecordingSummary,
    progress: Progress,
    stands_s: float | None = None,
) -> None:
    """Record until the vehicle is gone, or for `seconds` of simulation time.

    `stands_s`: with `seconds`, how long (wall) simulation time may stand, as for Standstill. `done` is kept current, also when this ends by an exception. Raises RecordingError.
    """
    done.counted, done.replayed = vehicle.counted, "replay_of" in vehicle.about
    with BusRecorder(out, vehicle.about, vehicle.topics) as recorder:
        for topic, sample in vehicle.latest():
            recorder.before(topic, sample)
            if topic == events.TOPIC:
                done.see(topic, sample)
        still = None if seconds is None else Standstill(stands_s)
        left: float | None = None
        while True:
            came = False
            for topic, sample in vehicle.take():
                came = True
                recorder.add(topic, sample)
                done.unusable = recorder.unusable + vehicle.unknown
                done.see(topic, sample)
            recorder.flush_if_due()
            progress(done.line())
            if seconds is not None and done.least_s >= seconds:
                done.why = f"{seconds:g} s are recorded"
                return
            t = math.nan if done.last_s is None else done.least_s
            if still is not None and still.see(t, done.end):
                done.why, done.stands = why(done.end), True
                return
            now = time.monotonic()
            left = (left or now) if vehicle.gone and not came else None
            over = left is not None and now - left > GONE_S
            if over or (vehicle.has_ended and not came and not vehicle.missing()):
                vehicle.give_up()
                done.end_seen = vehicle.has_ended
                done.why = GONE if done.end_seen else OUT_OF_SIGHT
                return
            if not came:
                time.sleep(LOOK_S)
