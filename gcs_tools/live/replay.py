"""A recording back on the bus, tick by tick as it was, at any speed."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface import topics as keys
from gcs_tools.live import bus
from gcs_tools.live.publisher import LOOK_S, PublishedVehicle
from gcs_tools.recording import events
from gcs_tools.recording.reader import SCHEMA_VERSION, VALUES, Messages, RecordingError, messages
from gcs_tools.recording.schema import PARAMS

LEAVE_S = 4.0  # wall: how long who listens may take to have it all
SLICE_NS = 10_000_000  # of simulation time that goes out together at speed 1


def about(path: Path, metadata: dict[str, str], run: str, vehicle: str) -> dict[str, Any]:
    """What a replayed vehicle says of itself: what the recording says of it, as text."""
    return {
        **metadata,
        **({VALUES: json.loads(metadata[VALUES])} if VALUES in metadata else {}),
        "run": run,
        "vehicle": vehicle,
        "schema_version": SCHEMA_VERSION,
        "replay_of": str(path),
        "processes": {"publisher": {}},
    }


class Replay:
    """One recording on its way out."""

    def __init__(self, path: Path, t_from: float, t_to: float) -> None:
        """t_from, t_to : simulation time, s, of what is replayed. Raises RecordingError."""
        self.metadata, self.topics, found = messages(path)
        wrong = [topic for topic in self.topics if not keys.is_topic(topic)]
        if wrong:
            raise RecordingError(
                f"{path}: topic {wrong[0][:80]!r}: expected names of letters, digits, _, . and -, with / between"
            )
        known = {*self.topics, events.TOPIC}
        self._messages = {t: m for t, m in found.items() if t in known and len(m.data)}
        moving = [m.time_ns for t, m in self._messages.items() if len(m.data) > 1]
        if not moving:
            raise RecordingError(f"{path}: nothing was recorded of this flight")
        self._first = max(int(min(t[0] for t in moving)), round(t_from * 1e9))
        self._last = min(int(max(t[-1] for t in moving)), round(t_to * 1e9))
        if self._first > self._last:
            raise RecordingError(f"{path}: nothing from {t_from:g} to {t_to:g} s")

    @property
    def span_s(self) -> tuple[float, float]:
        """Simulation time of the first and the last tick that is replayed."""
        return self._first * 1e-9, self._last * 1e-9

    def run(
        self, vehicle: PublishedVehicle, speed: float | None, progress: Callable[[float], None]
    ) -> None:
        """Send it all. `speed`: simulated seconds a second; None: as fast as it goes.

        `progress` is told the simulation time, s, and may raise to stop it.
        """
        self._before(vehicle)
        began = time.monotonic()
        step = round(SLICE_NS * max(speed or 1.0, 1.0))
        now = self._first
        while now <= self._last:
            self._send(vehicle, now, min(now + step, self._last + 1))
            now += step
            vehicle.serve()
            progress(min(now, self._last) * 1e-9)
            if speed is not None:
                left = began + (now - self._first) * 1e-9 / speed - time.monotonic()
                if left > 0.0:
                    time.sleep(left)

    def _before(self, vehicle: PublishedVehicle) -> None:
        """The parameters in force when it begins."""
        found = self._messages.get(PARAMS)
        if found is not None:
            end = int(np.searchsorted(found.time_ns, self._first))
            self._part(vehicle, PARAMS, found, slice(max(end - 1, 0), end))

    def _send(self, vehicle: PublishedVehicle, start: int, end: int) -> None:
        for topic, found in self._messages.items():
            first, after = np.searchsorted(found.time_ns, [start, end])
            self._part(vehicle, topic, found, slice(int(first), int(after)))

    def _part(self, vehicle: PublishedVehicle, topic: str, found: Messages, part: slice) -> None:
        if part.stop > part.start:
            vehicle.messages(
                topic, found.encoding, found.sequence[part], found.time_ns[part],
                found.data[part],
            )  # fmt: skip


def replay(
    path: Path, instance: int, vehicle: str, run: str, zenoh: Path | None,
    speed: float | None, t_from: float, t_to: float, wait: bool,
    ready: Callable[[Replay], None], progress: Callable[[float], None],
) -> None:  # fmt: skip
    """Replay the recording at `path` as a vehicle on the bus.

    `wait`: for somebody who listens. `ready` is called once it is there; `progress` as in
    Replay.run. Raises RecordingError, BusError.
    """
    made = Replay(path, t_from, t_to)
    with bus.session(bus.for_publisher(instance, run, zenoh)) as session:
        published = PublishedVehicle(session, vehicle, made.topics)
        published.about = about(path, made.metadata, run, vehicle)
        for process in ("publisher", "fcu", "plant"):
            published.alive(process, True)
        ready(made)
        while wait and not published.is_heard():
            published.serve()
            progress(made.span_s[0])
            time.sleep(LOOK_S)
        made.run(published, speed, progress)
        published.leave(LEAVE_S)
