"""The publisher: what the two flying processes feed it goes out on Zenoh, every tick of it.

A process of its own, so that Zenoh's threads, its waits and its end touch no flight. It wakes a
hundred times a second, takes what has come and publishes it: ticks share a sample. It sleeps
rather than waits for a row, since waking it would cost the control thread more than the row.
"""

from __future__ import annotations

import select
import signal
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface.airframe import believed_drag
from fcu.interface.ports import ports
from fcu.interface.starter import announce, log
from fcu.kernel.buffers import columns
from fcu.law.types import LawParams
from gcs_tools import bus
from gcs_tools.events import LEVELS, Event
from gcs_tools.feeding import Feeds, Source, Taken
from gcs_tools.outlet import Outlet
from gcs_tools.recording import SCHEMA_VERSION
from gcs_tools.schema import FCU_COLUMNS, PLANT_COLUMNS

PERIOD_S = 0.01  # wall: between two looks at what has come
LEAVE_S = 0.3  # wall: for what is still on its way when a flight has ended
IDLE_S = 0.05  # the same, while nobody flies

_SEQUENCE = {
    "fcu": FCU_COLUMNS.index("timing.sequence"), "plant": PLANT_COLUMNS.index("timing.sequence")
}  # fmt: skip


class Publisher:
    """Between the feed of one instance and its vehicle on the bus."""

    def __init__(self, feeds: Feeds, outlet: Outlet, lifeline: int | None) -> None:
        """`lifeline`: a file descriptor at whose end of file it ends."""
        self._feeds = feeds
        self._outlet = outlet
        self._lifeline = select.poll()
        if lifeline is not None:
            self._lifeline.register(lifeline, 0)  # a hang-up is told without being asked for
        self.stopping = False
        self.published = dict.fromkeys(_SEQUENCE, 0)
        self.lost = dict.fromkeys(_SEQUENCE, 0)  # rows that did not reach us
        self._next = dict.fromkeys(_SEQUENCE, -1)

    def run(self) -> None:
        """Until told to stop, or whoever started us is gone."""
        due = time.monotonic()
        while not (self.stopping or self._lifeline.poll(0)):
            self.pass_on()
            self._outlet.serve()
            due += PERIOD_S if self._feeds.sources else IDLE_S
            now = time.monotonic()
            if due > now:
                time.sleep(due - now)
            else:
                due = now  # behind: what came meanwhile waits in the feed, or is dropped there
        self.pass_on()  # the last words of a flight that has ended

    def pass_on(self) -> None:
        """Publish what has come."""
        self._feeds.accept()
        for source in list(self._feeds.sources):
            self._pass_on(source)

    def _pass_on(self, source: Source) -> None:
        taken = source.take()
        for said in taken.said:
            self._say(source, said)
        if taken.params is not None:
            self._told(taken.params)
        if len(taken.rows):
            self._publish(source.who, taken)
        if source.ended:
            self._feeds.sources.remove(source)
            source.close()
            if source.who and not any(s.who == source.who for s in self._feeds.sources):
                self._outlet.alive(source.who, False)

    def _publish(self, who: str, taken: Taken) -> None:
        rows = taken.rows
        sequence = rows[:, _SEQUENCE[who]].astype(np.uint64)
        first, after = int(sequence[0]), int(sequence[-1]) + 1
        expected = first if self._next[who] < 0 else self._next[who]
        self.lost[who] += max(after - expected - len(rows), 0)
        self._next[who] = after
        self.published[who] += len(rows)
        time_ns = np.rint(rows[:, 0] * 1e9).astype(np.uint64)
        self._outlet.rows(who, rows, sequence, time_ns)

    def _say(self, source: Source, said: dict[str, Any]) -> None:
        if "hello" in said:
            self._next[source.who] = -1
            self._outlet.alive(source.who, True)
            self._outlet.about["processes"][source.who] = {"pid": said.get("pid")}
        elif "event" in said:
            level = said.get("level")
            known = level if level in LEVELS else "unknown"
            self._outlet.event(Event(float(said["t"]), known, f"{source.who}: {said['event']}"))

    def _told(self, row: np.ndarray[Any, np.dtype[np.float64]]) -> None:
        named = dict(zip(columns(LawParams), row[1:].tolist(), strict=True))
        self._outlet.about["params"] = named
        self._outlet.about["rate_hz"] = 1.0 / named["h"]
        self._outlet.params(row)


def about(run: str, instance: int, flies: dict[str, Any]) -> dict[str, Any]:
    """What a vehicle says of itself. `flies`: mission, seed and what else its starter knows."""
    return {
        "run": run,
        "vehicle": str(ports(instance).system_id),
        "instance": instance,
        "schema_version": SCHEMA_VERSION,
        "version": version("m-mrac"),
        "started": time.time(),
        "believed_drag": list(believed_drag()),
        "processes": {},
        **flies,
    }


def publish(
    instance: int, run: str, flies: dict[str, Any], zenoh: Path | None, lifeline: int | None
) -> None:
    """Publish an instance until told to stop by a signal, or by the end of `lifeline`.

    Raises BusError, and PortBusy when another publisher has the instance.
    """
    feeds = Feeds(instance)
    try:
        with bus.session(bus.for_publisher(instance, run, zenoh)) as session:
            outlet = Outlet(session, str(ports(instance).system_id))
            outlet.about = about(run, instance, flies)
            outlet.alive("publisher", True)
            publisher = Publisher(feeds, outlet, lifeline)

            def stop(_signal: int, _frame: object) -> None:
                publisher.stopping = True

            signal.signal(signal.SIGTERM, stop)
            signal.signal(signal.SIGINT, stop)
            announce({"ready": "publisher", "instance": instance, "run": run})
            publisher.run()
            outlet.leave(LEAVE_S)
        announce({"ended": "publisher", "published": publisher.published, "lost": publisher.lost})
    finally:
        feeds.close()


def say(level: str, text: str) -> None:
    """One line of log."""
    log(f"{'-':>10} {level:<7} pub  {text}")
