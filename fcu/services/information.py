"""What ground stations ask for by message or command, beside telemetry: who are you, what is due.

The legacy requests that MAVProxy and MAVROS still send are answered here too, and the protocols
of things this vehicle does not have (files, logs) say so at once: a client waits for
an answer, not for a feature.
"""

from __future__ import annotations

from collections.abc import Sequence

from fcu.interface.status_texts import Code, Told
from fcu.mavlink import replies
from fcu.mavlink.definitions import (
    SERIAL_REPLY,
    SERIAL_RESPOND,
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
from fcu.services.messages import ANSWERS, GROUPS, STREAMS
from fcu.services.streams import FASTEST_HZ, Streams
from fcu.services.view import View

HEARTBEAT, AUTOPILOT_VERSION, HOME_POSITION, MESSAGE_INTERVAL, PROTOCOL_VERSION = (
    definition(name).id
    for name in (
        "HEARTBEAT", "AUTOPILOT_VERSION", "HOME_POSITION", "MESSAGE_INTERVAL", "PROTOCOL_VERSION",
    )
)  # fmt: skip
FTP_NAK, FTP_UNKNOWN_COMMAND = 129, 7
NO_CONSOLE = "This vehicle has no console.\n"


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
        if number == MESSAGE_INTERVAL:
            return [self._interval_of(which)] if which in STREAMS else None
        if number in ANSWERS:
            return ANSWERS[number].build(self._view, which)
        if number not in STREAMS:
            return None
        return [] if self._view is None else STREAMS[number].build(self._view)

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
        for number in GROUPS.get(message.stream, ()):
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
