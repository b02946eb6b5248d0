"""The plant link: vehicle states and rotor commands as MAVLink 2 datagrams, and back.

Plant to controller: ODOMETRY and ACTUATOR_OUTPUT_STATUS in one datagram, now and then followed
by BATTERY_STATUS, preceded by a HEARTBEAT while simulation time is held. Controller to plant:
HIL_ACTUATOR_CONTROLS. The numbers are packed by kernels, straight from and to buffers.

A battery arrives coarser than it was sent: charge as mA h, energy as hJ, voltage as mV, current
as cA, what is left as percent. Its voltage is that of the whole pack, which MAVLink has in the
place of the first cell. Out of a field's range a value is saturated; what is not a number is
sent as the field's "unknown", and refused at the other end.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from fcu.interface.airframe import ROTORS
from fcu.interface.messages import Battery, RotorCommand, VehicleState
from fcu.kernel.algebra import Rotors
from fcu.kernel.buffers import packer, size, unpacker
from fcu.kernel.compile import kernel
from fcu.mavlink.definitions import (
    AUTOPILOT,
    LOCKSTEP,
    NO_AUTOPILOT,
    Definition,
    Frame,
    ModeFlag,
    SystemStatus,
    definition,
    message,
)
from fcu.mavlink.frames import StateOnWire, command_through_the_wire, state_from_wire, state_to_wire
from fcu.mavlink.framing import WireError, expected, framed

__all__ = ["PlantCodec", "WireError"]

Buffer = np.ndarray[Any, np.dtype[np.float64]]

_TIME = struct.Struct("<Q")
_FLOATS = size(StateOnWire)
_FIRST_ROTOR = _FLOATS - ROTORS
_ODOMETRY_BYTES = 4 * _FIRST_ROTOR
_FIRST_EIGHT = 0xFF  # ACTUATOR_OUTPUT_STATUS.active: outputs 1 to 8 are in use

_ODOMETRY = definition("ODOMETRY")
_ROTOR_STATUS = definition("ACTUATOR_OUTPUT_STATUS")
_CONTROLS = definition("HIL_ACTUATOR_CONTROLS")
_HEARTBEAT = definition("HEARTBEAT")
_BATTERY = definition("BATTERY_STATUS")

# What follows the numbers of ODOMETRY: two covariances, unknown (NaN first), the frames,
# then reset counter, estimator and quality, all zero and so trimmed.
_COVARIANCE = struct.pack("<21f", float("nan"), *[0.0] * 20)
_FRAMES = bytes([Frame.LOCAL_NED, Frame.BODY_FRD])
_ODOMETRY_TAIL = 2 * _COVARIANCE + _FRAMES
_FRAMES_AT = _TIME.size + _ODOMETRY_BYTES + 2 * len(_COVARIANCE)
_ACTIVE = struct.pack("<I", _FIRST_EIGHT)
_FLAGS = (struct.pack("<Q", 0), struct.pack("<Q", LOCKSTEP))
_UNUSED_CONTROLS = bytes(4 * 8)
_ARMED = int(ModeFlag.ARMED)
_MODES = (bytes([ModeFlag.CUSTOM]), bytes([ModeFlag.CUSTOM | ModeFlag.ARMED]))
_HOLD = message(
    "HEARTBEAT", autopilot=NO_AUTOPILOT, system_status=SystemStatus.ACTIVE, mavlink_version=3
).payload

_unpack_state = unpacker(VehicleState)
_pack_state = packer(VehicleState)
_unpack_fields = unpacker(StateOnWire)
_pack_fields = packer(StateOnWire)
_unpack_command = unpacker(RotorCommand)
_pack_command = packer(RotorCommand)

_NOT_FINITE = 1
_NOT_UNIT = 2
_OUT_OF_RANGE = 3
_FAULTS = {
    _NOT_FINITE: "a field is not a finite number",
    _NOT_UNIT: "the attitude is not a unit quaternion",
    _OUT_OF_RANGE: "a rotor command is not between 0 and 1",
}


@kernel
def encode_state(buffer, spin, fields):
    """float64[21] VehicleState and float64[8] spin to the float32[21] fields of the wire."""
    on_wire = state_to_wire(_unpack_state(buffer))
    _pack_fields(fields, on_wire)
    for i in range(ROTORS):
        fields[_FIRST_ROTOR + i] *= spin[i]


@kernel
def decode_state(fields, numbers, buffer):
    """float32[21] fields to a float64[21] VehicleState; `numbers` float64[21] is scratch.

    Returns 0, or the fault for which `buffer` was left as it was.
    """
    for i in range(_FLOATS):
        numbers[i] = fields[i]
        if not np.isfinite(numbers[i]):
            return _NOT_FINITE
    on_wire = _unpack_fields(numbers)
    q = on_wire.q_NF
    if abs(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z - 1.0) > 0.01:
        return _NOT_UNIT
    _pack_state(buffer, state_from_wire(on_wire))
    return 0


@kernel
def encode_command(buffer, fields):
    """float64[8] RotorCommand to the float32[8] controls of the wire."""
    _pack_command(fields, command_through_the_wire(_unpack_command(buffer)))


@kernel
def decode_command(fields, buffer):
    """float32[8] controls to a float64[8] RotorCommand; returns 0 or a fault, as above."""
    for i in range(ROTORS):
        if not np.isfinite(fields[i]):
            return _NOT_FINITE
        if not 0.0 <= fields[i] <= 1.0:
            return _OUT_OF_RANGE
    for i in range(ROTORS):
        buffer[i] = fields[i]
    return 0


class PlantCodec:
    """Both directions of the plant link of one vehicle. Construction compiles the kernels.

    Buffers are flat float64 in the order of VehicleState (21) and RotorCommand (8), in the
    frames and units of `messages`. Out of float32's range a value is saturated; NaN is
    sent as NaN, and refused at the other end.
    """

    def __init__(self, system_id: int, spin: Rotors | None = None) -> None:
        """`spin` (+1 counter-clockwise, -1) signs rotor speeds; only the plant needs it."""
        self._system = system_id
        self._sequence = 0
        self._spin = None if spin is None else np.array(spin, dtype=np.float64)
        self._sent = np.zeros(_FLOATS, dtype="<f4")
        self._raw = bytearray(4 * _FLOATS)
        self._received = np.frombuffer(self._raw, dtype="<f4")
        self._raw_controls = bytearray(4 * ROTORS)
        self._received_controls = np.frombuffer(self._raw_controls, dtype="<f4")
        self._sent_controls = np.zeros(ROTORS, dtype="<f4")
        self._scratch = np.zeros(_FLOATS)
        self.battery: Battery | None = None  # as last received, with a state
        self._compile()

    def _compile(self) -> None:
        state, command = np.zeros(_FLOATS), np.zeros(ROTORS)
        encode_state(state, np.ones(ROTORS), self._sent)
        decode_state(self._received, self._scratch, state)
        encode_command(command, self._sent_controls)
        decode_command(self._received_controls, command)

    def pack_state(self, time_usec: int, buffer: Buffer, battery: Battery | None = None) -> bytes:
        """The datagram of one control tick. Raises ValueError if the codec has no spin."""
        if self._spin is None:
            raise ValueError("a codec that packs states needs the rotors' spin")
        encode_state(buffer, self._spin, self._sent)
        time, numbers = _TIME.pack(time_usec), self._sent.tobytes()
        odometry = time + numbers[:_ODOMETRY_BYTES] + _ODOMETRY_TAIL
        rotors = time + _ACTIVE + numbers[_ODOMETRY_BYTES:]
        state = self._framed(_ODOMETRY, odometry) + self._framed(_ROTOR_STATUS, rotors)
        if battery is None:
            return state
        return state + self._framed(_BATTERY, _battery_payload(battery))

    def pack_hold(self, time_usec: int, buffer: Buffer, battery: Battery | None = None) -> bytes:
        """A keep-alive while simulation time is held: the state, behind a HEARTBEAT."""
        return self._framed(_HEARTBEAT, _HOLD) + self.pack_state(time_usec, buffer, battery)

    @staticmethod
    def is_hold(datagram: bytes) -> bool:
        """Whether a datagram that `parse_state` accepts is a keep-alive: no tick, no answer."""
        return datagram[7:10] == b"\0\0\0"

    def parse_state(self, datagram: bytes, buffer: Buffer) -> int:
        """Read a state or a keep-alive into `buffer`; returns its simulation time in us.

        Raises WireError, with `buffer` and `battery` untouched.
        """
        at = 0
        if self.is_hold(datagram):
            _, at = self._payload(_HEARTBEAT, datagram, 0)
        odometry, at = self._payload(_ODOMETRY, datagram, at)
        rotors, at = self._payload(_ROTOR_STATUS, datagram, at)
        battery = None
        if at != len(datagram):
            battery, at = self._battery(datagram, at)
        if odometry[_FRAMES_AT : _FRAMES_AT + 2] != _FRAMES:
            raise WireError("ODOMETRY is not in LOCAL_NED and BODY_FRD")
        if rotors[:8] != odometry[:8]:
            raise WireError("ODOMETRY and ACTUATOR_OUTPUT_STATUS are of different times")
        if rotors[8:12] != _ACTIVE:
            raise WireError("ACTUATOR_OUTPUT_STATUS is not of eight rotors")
        self._raw[:_ODOMETRY_BYTES] = odometry[8 : 8 + _ODOMETRY_BYTES]
        self._raw[_ODOMETRY_BYTES:] = rotors[12 : 12 + 4 * ROTORS]
        fault = decode_state(self._received, self._scratch, buffer)
        if fault:
            raise WireError(_FAULTS[fault])
        if battery is not None:
            self.battery = battery
        time: int = _TIME.unpack_from(odometry)[0]
        return time

    def _battery(self, datagram: bytes, start: int) -> tuple[Battery, int]:
        payload, at = self._payload(_BATTERY, datagram, start)
        battery = _battery_of(payload)
        if battery is None:
            raise WireError("BATTERY_STATUS has a field unknown or out of range")
        if at != len(datagram):
            raise WireError(f"{len(datagram) - at} bytes after the state")
        return battery, at

    def pack_controls(self, time_usec: int, buffer: Buffer, armed: bool, lockstep: bool) -> bytes:
        """The answer to the state of `time_usec`: a RotorCommand."""
        encode_command(buffer, self._sent_controls)
        return self._framed(
            _CONTROLS,
            _TIME.pack(time_usec) + _FLAGS[lockstep] + self._sent_controls.tobytes()
            + _UNUSED_CONTROLS + _MODES[armed],
        )  # fmt: skip

    def parse_controls(self, datagram: bytes, buffer: Buffer) -> tuple[int, bool, bool]:
        """Read a RotorCommand into `buffer`; returns (time in us of its state, armed, lockstep).

        Raises WireError, with `buffer` untouched.
        """
        payload, at = self._payload(_CONTROLS, datagram, 0)
        if at != len(datagram):
            raise WireError(f"{len(datagram) - at} bytes after the controls")
        self._raw_controls[:] = payload[16:48]
        fault = decode_command(self._received_controls, buffer)
        if fault:
            raise WireError(_FAULTS[fault])
        time: int = _TIME.unpack_from(payload)[0]
        return time, payload[80] & _ARMED != 0, payload[8] & LOCKSTEP != 0

    def _framed(self, of: Definition, payload: bytes) -> bytes:
        sequence = self._sequence
        self._sequence = sequence + 1 & 0xFF
        return framed(of, payload, sequence, self._system, AUTOPILOT)

    def _payload(self, of: Definition, datagram: bytes, start: int) -> tuple[bytes, int]:
        return expected(of, datagram, start, self._system, AUTOPILOT)


# --- the battery

_NO_CELL = 2**16 - 1
_NO_TEMPERATURE = 2**15 - 1
_ALL_FUNCTIONS, _LIPO = 1, 1  # MAV_BATTERY_FUNCTION_ALL, MAV_BATTERY_TYPE_LIPO


def _known(x: float, unknown: int) -> float:
    return unknown if x != x else x


def _battery_payload(battery: Battery) -> bytes:
    pack_mV = _known(min(1e3 * battery.voltage, _NO_CELL - 1), _NO_CELL)
    return message(
        "BATTERY_STATUS", battery_function=_ALL_FUNCTIONS, type=_LIPO, temperature=_NO_TEMPERATURE,
        voltages=[pack_mV, *[_NO_CELL] * 9], current_battery=_known(1e2 * battery.current, -1),
        current_consumed=_known(1e3 * battery.drawn_Ah, -1),
        energy_consumed=_known(1e-2 * battery.energy_J, -1),
        battery_remaining=_known(1e2 * battery.remaining, -1),
    ).payload  # fmt: skip


def _battery_of(payload: bytes) -> Battery | None:
    """The battery of a payload; None if a field is unknown or out of range."""
    f = _BATTERY.unpack(payload)
    charge, energy, current = f["current_consumed"], f["energy_consumed"], f["current_battery"]
    pack_mV, percent = f["voltages"][0], f["battery_remaining"]
    if min(charge, energy, current) < 0 or pack_mV == _NO_CELL or not 0 <= percent <= 100:
        return None
    return Battery(
        voltage=1e-3 * pack_mV,
        current=1e-2 * current,
        drawn_Ah=1e-3 * charge,
        remaining=1e-2 * percent,
        energy_J=1e2 * energy,
    )
