"""The ground link: telemetry, commands, parameters and setpoints as MAVLink 2, and back.

Both ends use it: the flight controller sends telemetry and reads requests, a ground script the
other way round. A message is the same for every link; a GroundCodec frames it for one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from fcu.mavlink import plan_messages, replies, requests, setpoints, telemetry
from fcu.mavlink.definitions import AUTOPILOT, DEFINITIONS, Packed
from fcu.mavlink.framing import FRAMES_AT_ONCE, Source, framed, framed_v1, frames

GroundMessage = (
    requests.Message
    | plan_messages.Message
    | setpoints.Message
    | telemetry.Message
    | replies.Message
)
READERS: dict[str, Callable[[dict[str, Any], Source], GroundMessage]] = {
    **requests.READERS,
    **plan_messages.READERS,
    **setpoints.READERS,
    **telemetry.READERS,
    **replies.READERS,
}
_KNOWN = {number: each for number, each in DEFINITIONS.items() if each.name in READERS}


class GroundCodec:
    """One end of a ground link. `dropped` counts, by reason, what `parse` did not return.

    `heard` is the newest version of MAVLink in the last datagram parsed, 0 without a message.
    `speaks_v1`: messages are framed as MAVLink 1, for a peer that has sent nothing newer.
    """

    def __init__(
        self, system_id: int, component_id: int = AUTOPILOT, at_once: int = FRAMES_AT_ONCE
    ) -> None:
        """`at_once`: how many messages of one datagram are read."""
        self.dropped: Counter[str] = Counter()
        self._me = Source(system_id, component_id)
        self._at_once = at_once
        self._sequence = 0
        self.heard = 0
        self.speaks_v1 = False

    def framed(self, message: Packed) -> bytes:
        """The bytes of a message on this link. None for a message that MAVLink 1 cannot carry."""
        build = framed_v1 if self.speaks_v1 else framed
        frame = build(*message, self._sequence, *self._me)
        if frame is None:
            return b""
        self._sequence = (self._sequence + 1) & 0xFF
        return frame

    def parse(self, datagram: bytes) -> list[GroundMessage]:
        """The messages of one datagram that are known here and not addressed to another.

        Never raises: what cannot be read is counted in `dropped`. Nothing is carried over
        from one datagram to the next. Telemetry may hold NaN: a flight may have diverged.
        """
        messages = []
        self.heard = 0
        for frame in frames(datagram, _KNOWN, self.dropped, at_once=self._at_once):
            if frame.source == self._me:
                self.dropped["from ourselves"] += 1
                continue
            fields = frame.definition.unpack(frame.payload)
            message = READERS[frame.definition.name](fields, frame.source)
            if self._is_addressed(message):
                messages.append(message)
                self.heard = max(self.heard, frame.version)
            else:
                self.dropped["for another"] += 1
        return messages

    def _is_addressed(self, message: GroundMessage) -> bool:
        system = getattr(message, "target_system", 0)  # 0, as what names nobody: for all
        component = getattr(message, "target_component", 0)
        return system in (0, self._me.system) and component in (0, self._me.component)
