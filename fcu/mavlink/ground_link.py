"""The ground link: telemetry, commands, parameters and setpoints as MAVLink 2, and back.

Both ends use it: the flight controller packs telemetry and parses commands, a ground script the
other way round. What is said is built by `ground_telemetry`, `ground_answers` and `ground_asks`,
and is the same for every link; a GroundCodec frames it for one.
"""

from __future__ import annotations

from collections import Counter

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Quat, Vec3
from fcu.kernel.rotations import normalised
from fcu.mavlink.asks import setpoint as setpoint_message
from fcu.mavlink.fields import attitude, setpoint_of
from fcu.mavlink.framing import FRAMES_AT_ONCE, Packed, framed, frames
from fcu.mavlink.ground_messages import ADDRESSED, GroundMessage, Source
from fcu.mavlink.kinds import KINDS
from fcu.mavlink.readers import READERS
from fcu.mavlink.telemetry import attitude_euler

AUTOPILOT = 1  # MAV_COMP_ID_AUTOPILOT1
_KNOWN = {number: kind for number, kind in KINDS.items() if kind.name in READERS}


class GroundCodec:
    """One end of a ground link. `dropped` counts, by reason, what `parse` did not return."""

    def __init__(
        self, system_id: int, component_id: int = AUTOPILOT, at_once: int = FRAMES_AT_ONCE
    ) -> None:
        """`at_once`: how many messages of one datagram are read."""
        self.dropped: Counter[str] = Counter()
        self._me = Source(system_id, component_id)
        self._at_once = at_once
        self._sequence = 0

    def framed(self, message: Packed) -> bytes:
        """The bytes of a message on this link."""
        frame = framed(message, self._sequence, *self._me)
        self._sequence = (self._sequence + 1) & 0xFF
        return frame

    def parse(self, datagram: bytes) -> list[GroundMessage]:
        """The messages of one datagram that are known here and not addressed to another.

        Never raises: what cannot be read is counted in `dropped`. Nothing is carried over
        from one datagram to the next. Telemetry may hold NaN: a flight may have diverged.
        """
        messages = []
        for frame in frames(datagram, _KNOWN, self.dropped, at_once=self._at_once):
            source = Source(frame.system, frame.component)
            if source == self._me:
                self.dropped["from ourselves"] += 1
                continue
            message = READERS[frame.kind.name](frame.kind.unpack(frame.payload), source)
            if self._is_addressed(message):
                messages.append(message)
            else:
                self.dropped["for another"] += 1
        return messages

    def _is_addressed(self, message: GroundMessage) -> bool:
        if not isinstance(message, ADDRESSED):
            return True
        component = getattr(message, "target_component", 0)
        return message.target_system in (0, self._me.system) and component in (
            0,
            self._me.component,
        )


def warm_up() -> None:
    """Compile the kernels that messages are converted with."""
    level, nowhere = Quat(1.0, 0.0, 0.0, 0.0), Vec3(0.0, 0.0, 0.0)
    normalised(attitude(level))
    attitude_euler(0.0, level, nowhere)
    setpoint_message(Source(1, 1), 0.0, Setpoint(nowhere, nowhere, nowhere, 0.0, 0.0))
    setpoint_of(bytes(44), 0)
