"""When the vehicle sends what it tells of itself, on every link.

Streams are paced by the wall clock, as clients time them: a flight at a hundred times real time does not
flood its listeners, and one that is slow or held still does not lose them. What is due at one moment is
built once, from one View. `messages.py` has the table of what is sent.
"""

from __future__ import annotations

from collections.abc import Sequence

from fcu.interface.status_texts import Told, brief
from fcu.mavlink import replies
from fcu.mavlink.definitions import Packed
from fcu.services.ground_port import GroundPort, Link
from fcu.services.messages import STREAMS, heartbeat
from fcu.services.status import system_status
from fcu.services.view import View
from fcu.vehicle.state_machine import StateMachine

HEARTBEAT_S = 1.0
GRID_S = 0.005  # streams are looked at so often; none is faster
FASTEST_HZ = 200.0


class Streams:
    """The streams of every link."""

    def __init__(
        self, ports: Sequence[GroundPort], station: GroundPort, vehicle: StateMachine, kind: int,
        autopilot: int,
    ) -> None:  # fmt: skip
        """`station`: the one of `ports` whose rates are those of ground stations.

        kind, autopilot : MAV_TYPE and MAV_AUTOPILOT of the HEARTBEAT.
        """
        self._ports = ports
        self._station = station
        self._vehicle = vehicle
        self._kind, self._autopilot = kind, autopilot
        self._heartbeat_due = 0.0
        self._last: tuple[object, ...] | None = None
        self._next = 0.0

    def heartbeat(self, now: float) -> None:
        """Send one if a second has passed, or if it would say something else. `now`: monotonic, s."""
        status = self._status()
        if now < self._heartbeat_due and status == self._last:
            return
        self._heartbeat_due = now + HEARTBEAT_S
        self._beat(status)

    def tell_change(self) -> None:
        """Send a heartbeat if it says something else than the last one."""
        status = self._status()
        if self._last is not None and status != self._last:
            self._beat(status)

    def _status(self) -> tuple[object, ...]:
        v = self._vehicle
        return v.armed, v.mode, system_status(v)

    def _beat(self, status: tuple[object, ...]) -> None:
        self._last, v = status, self._vehicle
        packed = heartbeat(v, self._kind, self._autopilot)
        for port in self._ports:
            port.broadcast(packed)

    def begin(self) -> None:
        """Let all be due at once, and then by the clock that is told from now on."""
        self._heartbeat_due = self._next = 0.0
        for port in self._ports:
            for link in port.links():
                for stream in link.streams.values():
                    stream[1] = 0.0

    @property
    def due_s(self) -> float:
        """Wall, monotonic, s: when it is time to look at the streams."""
        return self._next

    def is_due(self, now: float) -> bool:
        """Whether it is time to look at the streams."""
        return now >= self._next

    def send(self, view: View, now: float) -> None:
        """Send what is due."""
        self._next = now + GRID_S
        built: dict[int, Sequence[Packed]] = {}
        for port in self._ports:
            for link in port.links():
                due: list[Packed] = []
                self._known(port, link)
                for number, stream in link.streams.items():
                    interval, at = stream
                    if now >= at:
                        # on its own grid, so that looking late does not slow the stream down
                        stream[1] = at + interval if at + interval > now else now + interval
                        if number not in built:
                            built[number] = STREAMS[number].build(view)
                        due += built[number]
                if due:
                    port.send(link, *due)

    def default_hz(self, port: GroundPort, number: int) -> float:
        """The rate of a message on a link that has not asked for another."""
        stream = STREAMS[number]
        return stream.station_hz if port is self._station else stream.script_hz

    def set_rate(self, port: GroundPort, link: Link, number: int, hz: float) -> None:
        """From now on; 0: never."""
        self._known(port, link)
        if hz <= 0.0:
            link.streams.pop(number, None)
        else:
            link.streams[number] = [1.0 / min(hz, FASTEST_HZ), 0.0]

    def interval_us(self, port: GroundPort, link: Link, number: int) -> int:
        """MESSAGE_INTERVAL: us between two; -1 not sent."""
        self._known(port, link)
        stream = link.streams.get(number)
        return -1 if stream is None else round(stream[0] * 1e6)

    def _known(self, port: GroundPort, link: Link) -> None:
        """A link starts with the default rates."""
        if link.has_rates:
            return
        link.has_rates = True
        for number in STREAMS:
            hz = self.default_hz(port, number)
            if hz > 0.0:
                link.streams[number] = [1.0 / hz, 0.0]

    def text(self, severity: int, told: Told) -> None:
        """STATUSTEXT to everyone who hears telemetry."""
        self.broadcast(replies.status_text(severity, brief(told)))

    def broadcast(self, *messages: Packed) -> None:
        """Something of interest to everyone, at once."""
        for port in self._ports:
            port.broadcast(*messages)
