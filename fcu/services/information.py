"""What ground stations ask for by message or command, beside telemetry: who are you, what is due.

The legacy requests that MAVProxy and MAVROS still send are answered here too, and the protocols
of things this vehicle does not have (files, logs) say so at once: a client waits for
an answer, not for a feature.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from importlib.metadata import version

from fcu.interface.status_texts import Code, Told
from fcu.mavlink import replies
from fcu.mavlink.definitions import (
    SERIAL_REPLY,
    SERIAL_RESPOND,
    Autopilot,
    Capability,
    CommandId,
    Packed,
    ParameterError,
    Result,
    definition,
)
from fcu.mavlink.ground_link import GroundMessage
from fcu.mavlink.requests import (
    ExtendedParameter,
    FileTransfer,
    LogRequestData,
    LogRequestList,
    Ping,
    SerialControl,
    StreamRequest,
    TimeSync,
)
from fcu.services.command_protocol import Request, Spec, Verdict, denied
from fcu.services.ground_port import GroundPort, Link
from fcu.services.streams import (
    AVAILABLE_MODES,
    FASTEST_HZ,
    HOME_POSITION,
    STREAMS,
    Streams,
    View,
    available_modes,
    heartbeat,
)

HEARTBEAT, AUTOPILOT_VERSION, MESSAGE_INTERVAL, PROTOCOL_VERSION = (
    definition(name).id
    for name in ("HEARTBEAT", "AUTOPILOT_VERSION", "MESSAGE_INTERVAL", "PROTOCOL_VERSION")
)
CAPABILITIES = (
    Capability.MISSION_INT | Capability.COMMAND_INT | Capability.PARAM_ENCODE_BYTEWISE
    | Capability.SET_ATTITUDE_TARGET | Capability.SET_POSITION_TARGET_LOCAL_NED
    | Capability.SET_POSITION_TARGET_GLOBAL_INT | Capability.FLIGHT_TERMINATION
    | Capability.MAVLINK2 | Capability.MISSION_FENCE | Capability.MISSION_RALLY
)  # fmt: skip
VERSION = version(
    "m-mrac"
)  # once: it searches files, and leaves cycles that nobody collects in flight
FTP_NAK, FTP_UNKNOWN_COMMAND = 129, 7
NO_CONSOLE = "This vehicle has no console.\n"

# REQUEST_DATA_STREAM's groups; 0 is all. What a script's setpoints are judged by stays.
_GROUPS = {
    1: (), 2: (24, 245, 1), 3: (), 6: (32, 33), 10: (30, 31), 11: (74,), 12: (),
}  # fmt: skip


# The PX4 whose modes, commands and parameters these are: stations and scripts choose by it how they
# talk, and warn of an old one.
PX4_VERSION = "1.16.0"


def software_version(version: str) -> int:
    """A version as AUTOPILOT_VERSION has it: major, minor, patch, and 255 for a release."""
    major, minor, patch = (int(part) for part in version.split(".")[:3])
    return major << 24 | minor << 16 | patch << 8 | 255


class Information:
    """The answers that are not telemetry. One for all links."""

    def __init__(self, streams: Streams, table: dict[int, Spec]) -> None:
        """Adds its commands to `table`."""
        self._streams = streams
        self._port: GroundPort
        self._link: Link
        self._view: View | None = None
        mine: dict[int, Spec] = {
            CommandId.REQUEST_MESSAGE: Spec(
                self._request, (1, 2, 3, 4, 5, 6, 7), (1,), what="Request"
            ),
            CommandId.SET_MESSAGE_INTERVAL: Spec(
                self._set_interval, (1, 2, 7), (1, 2), what="Interval"
            ),
            CommandId.GET_MESSAGE_INTERVAL: Spec(self._interval, (1,), (1,), what="Interval"),
            CommandId.REQUEST_CAPABILITIES: Spec(
                lambda r: self._send(AUTOPILOT_VERSION, 0), (1,), what="Request"
            ),
            CommandId.REQUEST_PROTOCOL_VERSION: Spec(
                lambda r: self._send(PROTOCOL_VERSION, 0), (1,), what="Request"
            ),
            CommandId.GET_HOME_POSITION: Spec(
                lambda r: self._send(HOME_POSITION, 0), what="Request"
            ),
        }
        table.update(mine)
        self.questions = frozenset(mine)  # they ask, and change nothing

    def about(self, port: GroundPort, link: Link, view: View | None) -> None:
        """Whose command is about to be run. `view`: None before the first state."""
        self._port, self._link, self._view = port, link, view

    # --- commands

    def _request(self, request: Request) -> Verdict:
        return self._send(int(request.parameter(1)), int(request.given(2, 0.0)))

    def _send(self, number: int, which: int) -> Verdict:
        messages = self.message(number, which)
        if messages is None:
            return Verdict(Result.UNSUPPORTED)
        if not messages:
            return Verdict(Result.TEMPORARILY_REJECTED, Told(Code.NOT_KNOWN_YET, (number,)))
        self._port.send(self._link, *messages)
        return Verdict(Result.ACCEPTED)

    def message(self, number: int, which: int) -> Sequence[Packed] | None:
        """One message of the vehicle as it is now; empty if not yet, None if it has none such."""
        view = self._view
        if number == AVAILABLE_MODES:
            return available_modes(which) or None
        if number == PROTOCOL_VERSION:
            return [replies.protocol_version()]
        if number == MESSAGE_INTERVAL:
            return [self._interval_of(which)] if which in STREAMS else None
        if number not in STREAMS and number not in (HEARTBEAT, AUTOPILOT_VERSION):
            return None
        if view is None:
            return []
        if number == HEARTBEAT:
            v = view.vehicle
            return [heartbeat(v, int(view.params["MAV_TYPE"]), view.identity.autopilot)]
        if number == AUTOPILOT_VERSION:
            git = hashlib.sha256(VERSION.encode()).digest()[:8]
            as_px4 = view.identity.autopilot == Autopilot.PX4
            presented, own = (
                software_version(PX4_VERSION if as_px4 else VERSION),
                software_version(VERSION),
            )
            return [
                replies.autopilot_version(
                    CAPABILITIES, presented, own, git, view.identity.system_id
                )
            ]
        return STREAMS[number].build(view)

    def _set_interval(self, request: Request) -> Verdict:
        number, us = int(request.parameter(1)), request.parameter(2)
        if number == HEARTBEAT:
            return denied("Interval", Code.HEARTBEATS_KEEP)
        if number not in STREAMS:
            return Verdict(Result.UNSUPPORTED)
        if us == 0.0:
            hz = self._streams.default_hz(self._port, number)
        elif us == -1.0:
            hz = 0.0
        elif us < 0.0:
            return denied("Interval", Code.INTERVAL_NEGATIVE)
        else:
            hz = min(1e6 / us, FASTEST_HZ)
        self._streams.set_rate(self._port, self._link, number, hz)
        return Verdict(Result.ACCEPTED)

    def _interval(self, request: Request) -> Verdict:
        number = int(request.parameter(1))
        if number not in STREAMS:
            return Verdict(Result.UNSUPPORTED)
        self._port.send(self._link, self._interval_of(number))
        return Verdict(Result.ACCEPTED)

    def _interval_of(self, number: int) -> Packed:
        us = self._streams.interval_us(self._port, self._link, number)
        return replies.message_interval(number, us)

    # --- messages

    def take(self, message: GroundMessage, t_us: int) -> Sequence[Packed] | None:
        """The answer to a message that is a request; None if it is not one."""
        if isinstance(message, TimeSync):
            if message.tc1 != 0:
                return []  # an answer to nothing we asked
            # since boot, as time_boot_ms; never 0, which would be a request
            now_ns = 1 if self._view is None else max(round(self._view.t * 1e9), 1)
            return [replies.timesync(now_ns, message.ts1, message.source)]
        if isinstance(message, Ping):
            if message.target_system != 0:
                return []
            return [replies.ping(message.time_usec, message.sequence, message.source)]
        if isinstance(message, StreamRequest):
            self._stream(message)
            return []
        if isinstance(message, FileTransfer):
            return [replies.file_transfer(_refused(message.payload), message.source)]
        if isinstance(message, LogRequestList):
            return [replies.log_entry()]
        if isinstance(message, LogRequestData):
            return [replies.log_data(message.number, message.offset)]
        if isinstance(message, SerialControl):
            asks = message.flags & SERIAL_RESPOND and not message.flags & SERIAL_REPLY
            return [replies.serial_control(message.device, NO_CONSOLE, message.source)] * bool(asks)
        if isinstance(message, ExtendedParameter):
            return _extended(message)
        return None

    def _stream(self, message: StreamRequest) -> None:
        """REQUEST_DATA_STREAM: a rate for a group. All (0) sets none: defaults are enough."""
        hz = float(message.rate_hz) if message.start else 0.0
        for number in _GROUPS.get(message.stream, ()):
            self._streams.set_rate(self._port, self._link, number, hz)


def _extended(message: ExtendedParameter) -> Sequence[Packed]:
    """The answer of a vehicle that has no extended parameters: a list of none, and refusals."""
    if message.kind == "SET":
        return [replies.extended_refused(message.name, message.data, message.type)]
    empty = replies.no_extended_value(message.name)
    if message.kind == "LIST":
        return [empty]
    missing = ParameterError.DOES_NOT_EXIST
    return [empty, replies.param_error(message.source, message.name, -1, missing)]


def _refused(payload: bytes) -> bytes:
    """The answer of a vehicle without files: sequence + 1, NAK, the request's opcode, why."""
    sequence = int.from_bytes(payload[:2], "little") + 1 & 0xFFFF
    opcode = payload[3]
    head = sequence.to_bytes(2, "little") + bytes([payload[2], FTP_NAK, 1, opcode, 0, 0])
    return (head + bytes(4) + bytes([FTP_UNKNOWN_COMMAND])).ljust(251, b"\0")
