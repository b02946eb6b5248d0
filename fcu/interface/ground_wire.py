"""The ground link: telemetry, commands and position setpoints as MAVLink 2, and back.

This file and `wire` are the only importers of pymavlink's dialect. Both ends use it: the
flight controller packs telemetry and parses commands, a ground script the other way round.
Every field is saturated to its wire range, and NaN never raises where telemetry is packed:
a diverging flight must not crash its own telemetry.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Sequence
from typing import Any

import pymavlink.dialects.v20.common as mavlink

from fcu.interface.frames import limited, single, single8
from fcu.interface.ground_fields import (
    READERS,
    attitude_fields,
    body_fields,
    earth_fields,
    milliseconds,
    setpoint_numbers,
    setpoint_of,
    whole,
)
from fcu.interface.ground_messages import (
    LOCAL_NED,
    Command,
    CommandAck,
    GroundMessage,
    SetpointMessage,
    Source,
)
from fcu.interface.messages import Setpoint
from fcu.interface.wire import COMPONENT
from fcu.kernel.algebra import Quat, Rotors, Vec3

_NUMBERS = struct.Struct("<11f")  # of a setpoint
_OVERHEAD = 12  # header and checksum of a message
_SIGNATURE = 13
_CHUNK = 50  # bytes of STATUSTEXT
_READERS = {
    number: READERS[message.msgname]
    for number, message in mavlink.mavlink_map.items()
    if message.msgname in READERS
}


class GroundCodec:
    """One end of a ground link. Construction compiles the kernels it uses.

    `dropped` counts, by reason, the messages that `parse` did not return.
    """

    def __init__(self, system_id: int, component_id: int = COMPONENT) -> None:
        self.dropped: Counter[str] = Counter()
        self._me = Source(system_id, component_id)
        self._mavlink = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._text_id = 0
        level, nowhere = Quat(1.0, 0.0, 0.0, 0.0), Vec3(0.0, 0.0, 0.0)
        self.parse(self.pack_attitude(0.0, level, nowhere))
        self.parse(self.pack_local_position(0.0, nowhere, nowhere))
        self.pack_attitude_target(0.0, level, nowhere, 0.0)
        self.pack_rotors(0.0, Rotors(*[0.0] * 8), Rotors(*[1.0] * 8))
        setpoint_of(setpoint_numbers(Setpoint(nowhere, nowhere, nowhere, 0.0, 0.0)), 0)
        self._mavlink.seq = 0

    # --- telemetry, packed by the flight controller. Times are simulation time in seconds.

    def pack_heartbeat(self, armed: bool, main_mode: int, sub_mode: int, status: int) -> bytes:
        """HEARTBEAT of an octocopter in PX4's conventions."""
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        return self._packed(
            mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_OCTOROTOR,
                mavlink.MAV_AUTOPILOT_PX4,
                base | mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else base,
                main_mode << 16 | sub_mode << 24,
                status,
                3,
            )
        )

    def pack_attitude(self, time_s: float, q_EB: Quat, w_B: Vec3) -> bytes:
        """ATTITUDE_QUATERNION."""
        q, w = attitude_fields(q_EB), body_fields(w_B)
        return self._packed(
            mavlink.MAVLink_attitude_quaternion_message(milliseconds(time_s), *q, *w)
        )

    def pack_local_position(self, time_s: float, r_E: Vec3, v_E: Vec3) -> bytes:
        """LOCAL_POSITION_NED."""
        r, v = earth_fields(r_E), earth_fields(v_E)
        return self._packed(
            mavlink.MAVLink_local_position_ned_message(milliseconds(time_s), *r, *v)
        )

    def pack_attitude_target(self, time_s: float, q_EB: Quat, w_B: Vec3, thrust: float) -> bytes:
        """ATTITUDE_TARGET; `thrust` is the commanded total over full thrust, 0 to 1."""
        q, w = attitude_fields(q_EB), body_fields(w_B)
        level = single(limited(float(thrust), 0.0, 1.0))
        return self._packed(
            mavlink.MAVLink_attitude_target_message(milliseconds(time_s), 0, q, *w, level)
        )

    def pack_position_target(
        self, time_s: float, numbers: bytes, type_mask: int, frame: int = LOCAL_NED
    ) -> bytes:
        """POSITION_TARGET_LOCAL_NED: the echo of an accepted setpoint, equal to the bit.

        `numbers` are those of its SetpointMessage, or `setpoint_numbers` of one made here.
        """
        return self._packed(
            mavlink.MAVLink_position_target_local_ned_message(
                milliseconds(time_s), frame, type_mask, *_NUMBERS.unpack(numbers)
            )
        )

    def pack_rotors(self, time_s: float, Omega: Rotors, spin: Rotors) -> bytes:
        """ACTUATOR_OUTPUT_STATUS: rotor speeds (rad/s), signed by the rotors' spin."""
        speeds = single8(Rotors(*[float(o) * float(s) for o, s in zip(Omega, spin, strict=True)]))
        time = whole(1e6 * time_s, 2**64 - 1)
        return self._packed(
            mavlink.MAVLink_actuator_output_status_message(time, 0xFF, [*speeds, *[0.0] * 24])
        )

    def pack_extended_state(self, landed_state: int) -> bytes:
        """EXTENDED_SYS_STATE."""
        return self._packed(mavlink.MAVLink_extended_sys_state_message(0, landed_state))

    def pack_system_time(self, unix_s: float, time_s: float) -> bytes:
        """SYSTEM_TIME: the time of day (s since 1970) and simulation time."""
        return self._packed(
            mavlink.MAVLink_system_time_message(
                whole(1e6 * unix_s, 2**64 - 1), milliseconds(time_s)
            )
        )

    def pack_text(self, severity: int, text: str) -> bytes:
        """STATUSTEXT in as many chunks of 50 characters as it needs, at most 256.

        A character that is not ASCII becomes `?`.
        """
        raw = text.encode("ascii", errors="replace").replace(b"\0", b"?")
        if len(raw) <= _CHUNK:
            return self._packed(mavlink.MAVLink_statustext_message(severity, raw))
        self._text_id = self._text_id % 0xFFFF + 1
        # A chunk that is not full ends the text: one that fills its last is followed by none.
        chunks = [raw[at : at + _CHUNK] for at in range(0, len(raw) + 1, _CHUNK)][:256]
        return b"".join(
            self._packed(mavlink.MAVLink_statustext_message(severity, chunk, self._text_id, i))
            for i, chunk in enumerate(chunks)
        )

    def pack_command_ack(self, command: Command, result: int, progress: int = 255) -> bytes:
        """COMMAND_ACK to whoever sent `command`; `progress` in percent, 255 unknown."""
        return self._packed(
            mavlink.MAVLink_command_ack_message(
                command.command, result, progress, 0, *command.source
            )
        )

    # --- what a ground station or script packs

    def pack_ground_heartbeat(self) -> bytes:
        """HEARTBEAT of a ground station."""
        return self._packed(
            mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0,
                mavlink.MAV_STATE_ACTIVE, 3,
            )
        )  # fmt: skip

    def pack_command(
        self, target: Source, command: int, params: Sequence[float] = (), confirmation: int = 0
    ) -> bytes:
        """COMMAND_LONG; parameters not given are 0. Raises ValueError for more than seven."""
        if len(params) > 7:
            raise ValueError(f"a command has seven parameters, not {len(params)}")
        seven = [single(float(p)) for p in params] + [0.0] * (7 - len(params))
        return self._packed(
            mavlink.MAVLink_command_long_message(*target, command, confirmation, *seven)
        )

    def pack_setpoint(
        self, target: Source, time_s: float, setpoint: Setpoint, type_mask: int = 0
    ) -> bytes:
        """SET_POSITION_TARGET_LOCAL_NED; `type_mask` as in `ground_messages`, 0 uses all."""
        numbers = _NUMBERS.unpack(setpoint_numbers(setpoint))
        return self._packed(
            mavlink.MAVLink_set_position_target_local_ned_message(
                milliseconds(time_s), *target, LOCAL_NED, type_mask, *numbers
            )
        )

    # --- what either end receives

    def parse(self, datagram: bytes) -> list[GroundMessage]:
        """The messages of one datagram that are known here and not addressed to another.

        Never raises: what cannot be read is counted in `dropped`. Nothing is carried over
        from one datagram to the next. Telemetry may hold NaN: a flight may have diverged.
        """
        messages = []
        at = 0
        while at < len(datagram):
            marker, length = datagram[at], datagram[at + 1 : at + 2]
            if not length or marker not in (
                mavlink.PROTOCOL_MARKER_V1, mavlink.PROTOCOL_MARKER_V2
            ):  # fmt: skip
                self.dropped["not MAVLink"] += 1
                break
            if marker == mavlink.PROTOCOL_MARKER_V1:
                self.dropped["MAVLink 1"] += 1
                at += 8 + length[0]
                continue
            end = at + _OVERHEAD + length[0]
            if end <= len(datagram) and datagram[at + 2] & mavlink.MAVLINK_IFLAG_SIGNED:
                end += _SIGNATURE
            if end > len(datagram):
                self.dropped["truncated"] += 1
                break
            message = self._message(datagram[at:end])
            if message is not None:
                messages.append(message)
            at = end
        return messages

    def _message(self, frame: bytes) -> GroundMessage | None:
        read = _READERS.get(int.from_bytes(frame[7:10], "little"))
        source = Source(frame[5], frame[6])
        if read is None:
            self.dropped["unknown message"] += 1
        elif source.system == 0:
            self.dropped["source 0"] += 1
        elif frame[2] & ~mavlink.MAVLINK_IFLAG_SIGNED:
            self.dropped["unknown flags"] += 1
        else:
            try:
                message = read(self._mavlink.decode(bytearray(frame)), source)
            except mavlink.MAVError:
                self.dropped["wrong checksum"] += 1
                return None
            if self._is_addressed(message):
                return message
            self.dropped["for another"] += 1
        return None

    def _is_addressed(self, message: GroundMessage) -> bool:
        return not isinstance(message, Command | CommandAck | SetpointMessage) or (
            message.target_system in (0, self._me.system)
            and message.target_component in (0, self._me.component)
        )

    def _packed(self, message: Any) -> bytes:
        packed: bytes = message.pack(self._mavlink)
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return packed
