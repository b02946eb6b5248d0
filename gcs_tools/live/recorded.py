"""Recording a vehicle from the bus until it leaves, and what that came to."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gcs_tools.live import ticks
from gcs_tools.live.bus_record import SELDOM, BusRecorder
from gcs_tools.live.ticks import Sample
from gcs_tools.live.watch import LOOK_S, Watch
from gcs_tools.recording.layout import LayoutError, decode
from gcs_tools.recording.schema import TIMING

GONE_S = 2.0  # wall: a vehicle that is back within it has not left
GONE, OUT_OF_SIGHT = "the vehicle is gone", "the vehicle is out of sight"  # why it ended
_BIN_S, _BINS = 1e-4, 20_000  # of the histogram of latencies: 0.1 ms, to 2 s

Progress = Callable[[str], None]


class Latency:
    """How old ticks are when they are here: wall time, of one machine's clock."""

    def __init__(self) -> None:
        self._form = ticks.form(TIMING)
        self._published = self._form.names.index("published")
        self._counts = np.zeros(_BINS, np.int64)

    def see(self, sample: Sample) -> None:
        """A sample of /fcu/timing that has just come."""
        try:
            published = decode(self._form, sample.ticks)[:, self._published]
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
class Recorded:
    """What a recording came to."""

    why: str = ""  # it ended
    first_s: float | None = None  # simulation time
    last_s: float | None = None
    ticks: int = 0  # control ticks of the flight controller
    counted: dict[str, Any] = field(default_factory=dict)  # by topic: watch.Counted
    unusable: int = 0
    end_seen: bool = False  # it was told what there was to record
    _spans: dict[str, tuple[float, float]] = field(default_factory=dict)  # by topic
    replayed: bool = False  # its ticks were published long ago
    latency: Latency = field(default_factory=Latency)

    def see(self, topic: str, sample: Sample) -> None:
        """A sample that was recorded; what is rarely said may be of long before."""
        times = sample.time_ns
        if topic in SELDOM:
            return
        first, last = float(times[0]) * 1e-9, float(times[-1]) * 1e-9
        self.first_s = first if self.first_s is None else self.first_s
        self.last_s = max(self.last_s or 0.0, last)
        self._spans[topic] = (self._spans.get(topic, (first, last))[0], last)
        if topic == TIMING.name:
            self.ticks += len(times)
            if not self.replayed:
                self.latency.see(sample)

    @property
    def least_s(self) -> float:
        """Simulation time that is recorded of every topic."""
        return min((last - first for first, last in self._spans.values()), default=0.0)

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
    watch: Watch, out: Path, seconds: float | None, done: Recorded, progress: Progress
) -> None:
    """Record until the vehicle is gone, or for `seconds` of simulation time.

    `done` is kept current, also when this ends by an exception. Raises RecordingError.
    """
    done.counted, done.replayed = watch.counted, "replay_of" in watch.about
    with BusRecorder(out, watch.about) as recorder:
        for topic, sample in watch.latest():
            recorder.before(topic, sample)
        left: float | None = None
        while True:
            came = False
            for topic, sample in watch.take():
                came = True
                recorder.add(topic, sample)
                done.unusable = recorder.unusable + watch.unknown
                done.see(topic, sample)
            recorder.flush_if_due()
            progress(done.line())
            if seconds is not None and done.least_s >= seconds:
                done.why = f"{seconds:g} s are recorded"
                return
            now = time.monotonic()
            left = (left or now) if watch.gone and not came else None
            over = left is not None and now - left > GONE_S
            if over or (watch.has_ended and not came and not watch.missing()):
                watch.give_up()
                done.end_seen = watch.has_ended
                done.why = GONE if done.end_seen else OUT_OF_SIGHT
                return
            if not came:
                time.sleep(LOOK_S)
