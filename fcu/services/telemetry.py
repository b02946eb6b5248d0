"""When each link is sent what. Paced by the wall clock, as clients time it.

A flight at a hundred times real time does not flood its listeners, and one that is slow or held
still does not lose them. What is due at one moment is built once and shares a datagram.
"""

from __future__ import annotations

from collections.abc import Sequence

from fcu.mavlink import answers
from fcu.mavlink.framing import Packed
from fcu.services.port import GroundPort, Link
from fcu.services.streams import STREAMS, heartbeat
from fcu.services.view import View
from fcu.vehicle.supervisor import Supervisor

HEARTBEAT_S = 1.0
GRID_S = 0.005  # streams are looked at so often; none is faster
FASTEST_HZ = 200.0


class Telemetry:
    """The streams of every link."""

    def __init__(
        self, station: GroundPort, script: GroundPort, vehicle: Supervisor, autopilot: int
    ) -> None:
        self._ports = (station, script)
        self._station = station
        self._vehicle = vehicle
        self._autopilot = autopilot
        self._heartbeat_due = 0.0
        self._last: tuple[object, ...] | None = None
        self._next = 0.0

    def heartbeat(self, now: float) -> None:
        """Send one if a second has passed, or if it would say something else. `now`: monotonic, s."""
        v = self._vehicle
        status = (v.armed, v.mode, v.status)
        if now < self._heartbeat_due and status == self._last:
            return
        self._heartbeat_due, self._last = now + HEARTBEAT_S, status
        packed = heartbeat(v.mode, v.armed, self._autopilot, v.status)
        for port in self._ports:
            port.broadcast(packed)

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

    def text(self, severity: int, text: str) -> None:
        """STATUSTEXT to everyone who hears telemetry."""
        for port in self._ports:
            port.broadcast(*answers.text(severity, text))

    def broadcast(self, *messages: Packed) -> None:
        """Something of interest to everyone, at once."""
        for port in self._ports:
            port.broadcast(*messages)
