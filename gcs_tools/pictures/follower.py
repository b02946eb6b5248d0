"""A live flight: what a Subscriber takes, decoded, into a FlightHistory that can be shown."""

from __future__ import annotations

from collections import deque

from fcu.interface.event_log import Event
from fcu.interface.options import LATEST_S
from gcs_tools.live.samples import Sample
from gcs_tools.live.subscriber import Subscriber, printable
from gcs_tools.pictures.history import WINDOW_S, FlightHistory, ground_z
from gcs_tools.pictures.quantities import SHOWN, ShownLimits
from gcs_tools.recording import events
from gcs_tools.recording.layout import LayoutError, decode
from gcs_tools.recording.reader import values_told
from gcs_tools.recording.schema import PARAMS
from gcs_tools.recording.table import Table
from gcs_tools.wind_fields.buildings import told_boxes

KEPT_EVENTS = 100


class Follower:
    """One vehicle on the bus, followed."""

    def __init__(self, vehicle: Subscriber, keep_s: float = WINDOW_S) -> None:
        """`vehicle`: found already: it says what it tells.  `keep_s`: as for FlightHistory."""
        self.vehicle = vehicle
        about = vehicle.about
        mission = about.get("title") or about.get("mission")
        told = {name: topic.columns for name, topic in vehicle.topics.items() if name != PARAMS}
        title = str(mission or f"vehicle {about.get('vehicle')}")
        self.flight = FlightHistory(title, told, keep_s)
        self.flight.ground_z = ground_z(values_told(about))
        self.flight.buildings = told_boxes(about)
        self.events: deque[Event] = deque(maxlen=KEPT_EVENTS)
        self.params: dict[str, float] | None = None  # the law's in force
        self.unusable = 0  # samples that are not what their topic says
        self._shown = {PARAMS, *(name for name in told if SHOWN.intersection(told[name]))}
        for topic_name, sample in vehicle.latest():
            self._see(topic_name, sample)

    def take(self) -> bool:
        """Whatever has come since the last call; whether anything has."""
        came = False
        for topic, sample in self.vehicle.take():
            came = True
            self._see(topic, sample)
        return came

    def _see(self, name: str, sample: Sample) -> None:
        try:
            if name == events.TOPIC:
                found = events.decode(events.schema(), sample.ticks)
                self.events.extend(
                    e._replace(text=printable(e.text), who=printable(e.who))
                    for e in found
                    if e.level != "debug"
                )
                for event in found:
                    self.flight.plans.take(event)
            elif name in self._shown and (topic := self.vehicle.topics.get(name)) is not None:
                self._append(name, Table(decode(topic.layout, sample.ticks), topic.columns))
        except (ValueError, KeyError):
            self.unusable += 1

    def _append(self, topic: str, rows: Table) -> None:
        if not ((rows["t"] >= 0.0) & (rows["t"] <= LATEST_S)).all():
            raise LayoutError(f"{topic}: not a simulation time")
        if topic == PARAMS:
            self.params = dict(zip(rows.names, rows.rows[-1].tolist(), strict=True))
            self.flight.limits = ShownLimits.of(self.params)
        else:
            self.flight.append(topic, rows)
