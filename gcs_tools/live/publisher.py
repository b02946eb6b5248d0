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
from fcu.settings import Settings
from gcs_tools.live import bus
from gcs_tools.live.feeding import WIDTHS, FeedError, Feeds, Source, Taken
from gcs_tools.live.outlet import Outlet
from gcs_tools.recording.events import LEVELS, Event
from gcs_tools.recording.reader import SCHEMA_VERSION

PERIOD_S = 0.01  # wall: between two looks at what has come
LEAVE_S = 0.3  # wall: for what is still on its way when a flight has ended
IDLE_S = 0.05  # the same, while nobody flies
LAST = 4  # looks at what has still come when it ends: more than a feed can hold


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
        self.published = dict.fromkeys(WIDTHS, 0)
        self.lost = dict.fromkeys(WIDTHS, 0)  # rows that did not reach us
        self._before = dict.fromkeys(WIDTHS, 0)  # added to numbers, which begin anew with a process
        self._next = dict.fromkeys(WIDTHS, 0)  # number that the next row has
        self._refused: set[str] = set()  # why somebody was: said once

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
        for _ in range(LAST):  # the last words of a flight that has ended
            self.pass_on()
        for who, lost in self.lost.items():
            if lost:
                flown = self.published[who] + lost
                say(
                    "warning", f"{lost} of {flown} ticks of the {who} came too fast to be published"
                )

    def pass_on(self) -> None:
        """Publish what has come."""
        self._feeds.accept()
        for source in list(self._feeds.sources):
            try:
                self._pass_on(source)
            except FeedError as error:
                self._refuse(source, str(error))

    def _pass_on(self, source: Source) -> None:
        before, was = source.lost, source.who
        taken = source.take()
        if source.who != was:
            self._meet(source)
        for said in taken.said:
            self._say(source, said)
        if taken.params is not None:
            self._told(taken.params)
        if source.who:
            self._publish(source, taken, source.lost - before)
        if source.ended:
            self._end(source)

    def _publish(self, source: Source, taken: Taken, lost: int) -> None:
        who = source.who
        if len(taken.rows) and int(taken.sequence[0]) + self._before[who] < self._next[who]:
            self._before[who] = self._next[who]
        self._outlet.rows(
            who, taken.rows, taken.sequence + np.uint64(self._before[who]), taken.time_ns
        )
        self.published[who] += len(taken.rows)
        self.lost[who] += lost
        if source.next > 0:
            self._next[who] = self._before[who] + source.next
            self._outlet.flown(who, self._next[who] - 1)

    def _meet(self, source: Source) -> None:
        if any(other.who == source.who for other in self._feeds.sources if other is not source):
            raise FeedError(f"what another {source.who} feeds already")
        self._outlet.alive(source.who, True)
        self._outlet.about["processes"][source.who] = {"pid": source.pid}

    def _end(self, source: Source) -> None:
        self._feeds.hang_up(source)
        if source.who and not any(other.who == source.who for other in self._feeds.sources):
            self._outlet.alive(source.who, False)
            if not any(other.who for other in self._feeds.sources):
                self._outlet.ended()

    def _refuse(self, source: Source, why: str) -> None:
        self._end(source)
        if why not in self._refused:
            self._refused.add(why)
            say("warning", f"process {source.pid} feeds {why}: not published")

    def _say(self, source: Source, said: dict[str, Any]) -> None:
        if "event" in said:
            level = said.get("level")
            known = level if level in LEVELS else "unknown"
            self._outlet.event(Event(float(said["t"]), known, f"{source.who}: {said['event']}"))

    def _told(self, row: np.ndarray[Any, np.dtype[np.float64]]) -> None:
        named = dict(zip(columns(Settings), row[1:].tolist(), strict=True))
        self._outlet.about["params"] = named
        self._outlet.about["rate_hz"] = 1.0 / named["law.h"]
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
        "mission": None,
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
            announce(
                {"ended": "publisher", "published": publisher.published, "lost": publisher.lost}
            )
    finally:
        feeds.close()


def say(level: str, text: str) -> None:
    """One line of log."""
    log(f"{'-':>10} {level:<7} pub  {text}")
