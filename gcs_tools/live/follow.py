"""A live flight: what a Watch takes, decoded, into a FlightHistory that can be shown."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from google.protobuf.message import DecodeError

from fcu.interface.options import LATEST_S
from gcs_tools.live import ticks
from gcs_tools.live.ticks import Sample
from gcs_tools.live.watch import Watch, printable
from gcs_tools.pictures.history import DRAWN, WINDOW_S, FlightHistory, Limits, ground_z
from gcs_tools.recording import events
from gcs_tools.recording.events import Event
from gcs_tools.recording.layout import LayoutError, Rows, decode
from gcs_tools.recording.schema import PARAMS, TOPICS

KEPT_EVENTS = 100


class Follower:
    """One vehicle on the bus, followed."""

    def __init__(
        self, watch: Watch, keep_s: float = WINDOW_S, kept: Mapping[str, list[str]] = DRAWN
    ) -> None:
        """`watch`: one that has found its vehicle.  `keep_s`, `kept`: as for FlightHistory."""
        self.watch = watch
        mission = watch.about.get("title") or watch.about.get("mission")
        self.flight = FlightHistory(
            str(mission or f"vehicle {watch.about.get('vehicle')}"), keep_s, kept
        )
        self.flight.ground_z = ground_z(watch.about.get("values"))
        self.events: deque[Event] = deque(maxlen=KEPT_EVENTS)
        self.params: Rows | None = None  # the law's in force
        self.unusable = 0  # samples that are not what their topic says
        self._forms = {
            topic.name: ticks.form(topic)
            for topic in TOPICS
            if topic.name in kept or topic == PARAMS
        }
        for topic_name, sample in watch.latest():
            self._see(topic_name, sample)

    def take(self) -> bool:
        """Whatever has come since the last call; whether anything has."""
        came = False
        for topic, sample in self.watch.take():
            came = True
            self._see(topic, sample)
        return came

    def _see(self, topic: str, sample: Sample) -> None:
        try:
            if topic == events.TOPIC:
                found = events.decode(events.schema(), sample.ticks)
                self.events.extend(e._replace(text=printable(e.text)) for e in found)
            elif topic in self._forms:
                self._append(topic, decode(self._forms[topic], sample.ticks))
        except (ValueError, DecodeError):
            self.unusable += 1

    def _append(self, topic: str, rows: Rows) -> None:
        if not ((rows[:, 0] >= 0.0) & (rows[:, 0] <= LATEST_S)).all():
            raise LayoutError(f"{topic}: not a simulation time")
        if topic == PARAMS.name:
            self.params = rows[-1, 1:]
            self.flight.limits = Limits.of(self.params)
        else:
            self.flight.append(topic, rows)
