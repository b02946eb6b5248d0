"""The plant link: vehicle states and rotor commands as MAVLink 2 datagrams, and back.

Plant to controller: ODOMETRY and ACTUATOR_OUTPUT_STATUS in one datagram, now and then followed
by BATTERY_STATUS, preceded by a HEARTBEAT while simulation time is held, which also tells how the
flight has ended. Controller to plant: HIL_ACTUATOR_CONTROLS. The numbers are packed by kernels,
straight from and to buffers. To reset the plant the controller sends PREFLIGHT_REBOOT_SHUTDOWN; the
plant acknowledges it, and all that it sends from then on is of the new flight. To break something it
sends INJECT_FAILURE, which the plant acknowledges once it has done it.

A battery arrives coarser than it was sent: charge as mA h, energy as hJ, voltage as mV, current
as cA, what is left as whole percent, rounded down, so that a level of 7 % is passed at 7 %. Its voltage is
that of the whole pack, which MAVLink has in the place of the first cell, and what is above 65.534 V in that
of the second. Out of a field's range a value is saturated; what is not a number is
sent as the field's "unknown", and refused at the other end.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.airframe import ROTORS
from fcu.interface.messages import Battery, RotorCommand, VehicleState
from fcu.kernel.algebra import Rotors, select, total
from fcu.kernel.buffers import from_buffer, packer, size, to_buffer, unpacker
from fcu.kernel.compile import kernel
from fcu.mavlink import failures, frame_kernels
from fcu.mavlink.definitions import (
    AUTOPILOT,
    LOCKSTEP,
    NO_AUTOPILOT,
    CommandId,
    Definition,
    Frame,
    ModeFlag,
    Result,
    SystemStatus,
    definition,
    message,
)
from fcu.mavlink.frame_kernels import HEADER, copy, get, get_signed, put
from fcu.mavlink.frames import (
    StateOnWire,
    command_through_the_wire,
    state_from_wire,
    state_in_flight,
    state_to_wire,
)
from fcu.mavlink.framing import WireError, expected, framed

__all__ = ["Ending", "OtherRotors", "PlantCodec", "Result", "WireError"]

Buffer = np.ndarray[Any, np.dtype[np.float64]]
Bytes = np.ndarray[Any, np.dtype[np.uint8]]

LONGEST = 4096  # bytes: several times the longest datagram here

_TIME = 8  # bytes, at the start of every message but HEARTBEAT and BATTERY_STATUS
_FLOATS = size(StateOnWire)
_FIRST_ROTOR = _FLOATS - ROTORS
_ODOMETRY_BYTES = 4 * _FIRST_ROTOR
_STATE_BYTES = 4 * _FLOATS

_ODOMETRY = definition("ODOMETRY")
_ROTOR_STATUS = definition("ACTUATOR_OUTPUT_STATUS")
_CONTROLS = definition("HIL_ACTUATOR_CONTROLS")
_HEARTBEAT = definition("HEARTBEAT")
_BATTERY = definition("BATTERY_STATUS")

# What compiled code knows of each: number, the byte behind the checksum, size.
_ODOMETRY_ID, _ODOMETRY_CRC, _ODOMETRY_SIZE = _ODOMETRY.id, _ODOMETRY.crc_extra[0], _ODOMETRY.size
_ROTORS_ID, _ROTORS_CRC, _ROTORS_SIZE = (
    _ROTOR_STATUS.id, _ROTOR_STATUS.crc_extra[0], _ROTOR_STATUS.size,
)  # fmt: skip
_CONTROLS_ID, _CONTROLS_CRC, _CONTROLS_SIZE = _CONTROLS.id, _CONTROLS.crc_extra[0], _CONTROLS.size
_HEARTBEAT_ID, _HEARTBEAT_CRC = _HEARTBEAT.id, _HEARTBEAT.crc_extra[0]
_BATTERY_ID, _BATTERY_CRC, _BATTERY_SIZE = _BATTERY.id, _BATTERY.crc_extra[0], _BATTERY.size

# What follows the numbers of ODOMETRY: two covariances, unknown (NaN first), the frames,
# then reset counter, estimator and quality, all zero and so trimmed.
_COVARIANCE = struct.pack("<21f", float("nan"), *[0.0] * 20)
_NED, _FRD = int(Frame.LOCAL_NED), int(Frame.BODY_FRD)
_TAIL = np.frombuffer(2 * _COVARIANCE + bytes([_NED, _FRD]), dtype=np.uint8)
_TAIL_AT = _TIME + _ODOMETRY_BYTES
_FRAMES_AT = _TAIL_AT + 2 * len(_COVARIANCE)
_QUALITY_AT = _ODOMETRY.offset("quality")
_MODE_AT = _CONTROLS.offset("mode")
_CUSTOM, _ARMED, _LOCKSTEP = int(ModeFlag.CUSTOM), int(ModeFlag.ARMED), int(LOCKSTEP)
_COMMAND, _ACK = definition("COMMAND_LONG"), definition("COMMAND_ACK")
_ENDING_AT = _HEARTBEAT.offset("custom_mode")
_RESET_DONE = message("COMMAND_ACK", command=CommandId.REBOOT, result=Result.ACCEPTED).payload

_unpack_state = unpacker(VehicleState)
_pack_state = packer(VehicleState)
_unpack_fields = unpacker(StateOnWire)
_pack_fields = packer(StateOnWire)
_unpack_command = unpacker(RotorCommand)
_pack_command = packer(RotorCommand)
_unpack_battery = unpacker(Battery)
_pack_battery = packer(Battery)

_NOT_A_FRAME, _NOT_FINITE, _NOT_UNIT, _OUT_OF_RANGE, _FRAMES, _TIMES, _OTHERS, _NO_BATTERY = (
    1, 2, 3, 4, 5, 6, 7, 8,
)  # fmt: skip
_FAULTS = {
    _NOT_FINITE: "a field is not a finite number",
    _NOT_UNIT: "the attitude is not a unit quaternion",
    _OUT_OF_RANGE: "a rotor command is not between 0 and 1",
    _FRAMES: "ODOMETRY is not in LOCAL_NED and BODY_FRD",
    _TIMES: "ODOMETRY and ACTUATOR_OUTPUT_STATUS are of different times",
    _OTHERS: "ACTUATOR_OUTPUT_STATUS is of other rotors than the airframe's (see --airframe)",
    _NO_BATTERY: "BATTERY_STATUS has a field unknown or out of range",
}


class OtherRotors(WireError):
    """A state is of another number of rotors than the airframe's: of another vehicle."""


class Ending(IntEnum):
    """How a flight has ended: HEARTBEAT.custom_mode of a plant that holds time."""

    NOT_ENDED = 0
    DIVERGED = 1  # it has left the arena, or its state is not finite
    CRASHED = 2


def _hold(ending: Ending) -> bytes:
    """The payload of the HEARTBEAT of a keep-alive."""
    status = SystemStatus.EMERGENCY if ending else SystemStatus.ACTIVE
    return message(
        "HEARTBEAT", autopilot=NO_AUTOPILOT, system_status=status, custom_mode=int(ending),
        mavlink_version=3,
    ).payload  # fmt: skip


def _reset(system: int) -> bytes:
    """The payload of the command that resets the plant of a system."""
    return message(
        "COMMAND_LONG", command=CommandId.REBOOT, param1=1.0, target_system=system,
        target_component=AUTOPILOT,
    ).payload  # fmt: skip


def fault_in_words(fault: int) -> str:
    """What is wrong with a datagram that was not read, for a person."""
    return _FAULTS.get(fault, "it is none that can be read")


class Desk(NamedTuple):
    """Where the kernels of one end lay out what they read and write."""

    odometry: Bytes  # a payload of full size; the next three too
    rotors: Bytes
    controls: Bytes
    battery: Bytes
    heartbeat: Bytes
    raw: Bytes  # the float32 fields of a state, or the first of them of a command
    fields: np.ndarray[Any, np.dtype[np.float32]]  # the same
    numbers: Buffer  # the same, as float64
    sequence: np.ndarray[Any, np.dtype[np.int64]]  # of the next frame
    active: np.ndarray[Any, np.dtype[np.int64]]  # ACTUATOR_OUTPUT_STATUS.active: a bit a rotor
    quality: np.ndarray[Any, np.dtype[np.int64]]  # ODOMETRY.quality: -1: the state has failed


def desk(n: int = ROTORS) -> Desk:
    """A new one. `n`: how many rotors there are; the first outputs are in use."""
    raw = np.zeros(_STATE_BYTES, dtype=np.uint8)
    odometry, rotors, controls, battery, heartbeat = (
        np.zeros(of.size, dtype=np.uint8)
        for of in (_ODOMETRY, _ROTOR_STATUS, _CONTROLS, _BATTERY, _HEARTBEAT)
    )
    return Desk(
        odometry=odometry, rotors=rotors, controls=controls, battery=battery,
        heartbeat=heartbeat, raw=raw, fields=raw.view("<f4"), numbers=np.zeros(_FLOATS),
        sequence=np.zeros(1, dtype=np.int64), active=np.array([2**n - 1]),
        quality=np.zeros(1, dtype=np.int64),
    )  # fmt: skip


@kernel
def _next(desk):
    """The sequence number of a frame."""
    number = desk.sequence[0]
    desk.sequence[0] = (number + 1) & 0xFF
    return number


# --- states


@kernel
def pack_state(desk, system, time_us, state, spin, battery, with_battery, datagram):
    """The datagram of one control tick, or of a keep-alive without its HEARTBEAT; its length.

    state : float64[21], VehicleState.  spin : float64[8].  battery : float64[5], Battery.
    datagram : uint8[LONGEST].  Numbers beyond float32 are saturated; NaN is sent as NaN.
    """
    fields, raw = desk.fields, desk.raw
    _pack_fields(fields, state_to_wire(_unpack_state(state)))
    for i in range(ROTORS):
        fields[_FIRST_ROTOR + i] *= spin[i]
    body = HEADER
    put(datagram, body, time_us, _TIME)
    copy(raw, 0, datagram, body + _TIME, _ODOMETRY_BYTES)
    copy(_TAIL, 0, datagram, body + _TAIL_AT, _TAIL.size)
    length = _TAIL_AT + _TAIL.size
    if desk.quality[0] < 0:
        for i in range(length, _QUALITY_AT):
            datagram[body + i] = 0
        put(datagram, body + _QUALITY_AT, desk.quality[0], 1)
        length = _QUALITY_AT + 1
    end = frame_kernels.frame(
        datagram, 0, length, _next(desk), system, AUTOPILOT, _ODOMETRY_ID, _ODOMETRY_CRC
    )
    body = end + HEADER
    put(datagram, body, time_us, _TIME)
    put(datagram, body + _TIME, desk.active[0], 4)
    copy(raw, _ODOMETRY_BYTES, datagram, body + _TIME + 4, _STATE_BYTES - _ODOMETRY_BYTES)
    end = frame_kernels.frame(
        datagram, end, _TIME + 4 + _STATE_BYTES - _ODOMETRY_BYTES, _next(desk), system, AUTOPILOT,
        _ROTORS_ID, _ROTORS_CRC,
    )  # fmt: skip
    if with_battery:
        _put_battery(datagram, end + HEADER, _unpack_battery(battery))
        end = frame_kernels.frame(
            datagram, end, _BATTERY_SIZE, _next(desk), system, AUTOPILOT, _BATTERY_ID, _BATTERY_CRC
        )
    return end


@kernel
def parse_state(desk, system, datagram, length, state, battery, told):
    """Read a state or a keep-alive; 0, or the fault for which nothing was written.

    datagram : uint8[n], of which `length` bytes were received.  state : float64[21],
    VehicleState.  battery : float64[5], Battery.  told : int64[3], its simulation time (us),
    whether it is a keep-alive, whether it told the battery.
    """
    at = 0
    is_hold = length >= HEADER and get(datagram, 7, 3) == _HEARTBEAT_ID
    if is_hold:
        at = frame_kernels.payload(
            datagram, 0, length, system, AUTOPILOT, _HEARTBEAT_ID, _HEARTBEAT_CRC, desk.heartbeat
        )
        if at == 0:
            return _NOT_A_FRAME
    odometry, rotors = desk.odometry, desk.rotors
    at = frame_kernels.payload(
        datagram, at, length, system, AUTOPILOT, _ODOMETRY_ID, _ODOMETRY_CRC, odometry
    )
    if at == 0:
        return _NOT_A_FRAME
    at = frame_kernels.payload(
        datagram, at, length, system, AUTOPILOT, _ROTORS_ID, _ROTORS_CRC, rotors
    )
    if at == 0:
        return _NOT_A_FRAME
    with_battery = at != length
    charge = Battery(0.0, 0.0, 0.0, 0.0, 0.0)
    if with_battery:
        at = frame_kernels.payload(
            datagram, at, length, system, AUTOPILOT, _BATTERY_ID, _BATTERY_CRC, desk.battery
        )
        if at == 0:
            return _NOT_A_FRAME
        charge = _battery(desk.battery)
        if charge.remaining < 0.0:
            return _NO_BATTERY
        if at != length:
            return _NOT_A_FRAME
    if odometry[_FRAMES_AT] != _NED or odometry[_FRAMES_AT + 1] != _FRD:
        return _FRAMES
    time_us = get(odometry, 0, _TIME)
    if get(rotors, 0, _TIME) != time_us:
        return _TIMES
    if get(rotors, _TIME, 4) != desk.active[0]:
        return _OTHERS
    raw = desk.raw
    copy(odometry, _TIME, raw, 0, _ODOMETRY_BYTES)
    copy(rotors, _TIME + 4, raw, _ODOMETRY_BYTES, _STATE_BYTES - _ODOMETRY_BYTES)
    numbers = desk.numbers
    for i in range(_FLOATS):
        numbers[i] = desk.fields[i]
        if not np.isfinite(numbers[i]):
            return _NOT_FINITE
    on_wire = _unpack_fields(numbers)
    q = on_wire.q_NF
    if abs(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z - 1.0) > 0.01:
        return _NOT_UNIT
    _pack_state(state, state_from_wire(on_wire))
    if with_battery:
        _pack_battery(battery, charge)
    desk.quality[0] = get_signed(odometry, _QUALITY_AT, 1)
    told[0], told[1], told[2] = time_us, is_hold, with_battery
    return 0


# --- commands


@kernel
def pack_controls(desk, system, time_us, command, armed, lockstep, nan_stands, datagram):
    """The answer to the state of `time_us`; its length.  command : float64[8], RotorCommand.

    nan_stands : whether a rotor whose command is not a number is told to stand; else that is sent.
    """
    _pack_command(desk.fields, command_through_the_wire(_unpack_command(command)))
    for i in range(ROTORS):
        if nan_stands and np.isnan(desk.fields[i]):
            desk.fields[i] = 0.0
    put(datagram, HEADER, time_us, _TIME)
    put(datagram, HEADER + 8, _LOCKSTEP if lockstep else 0, 8)
    copy(desk.raw, 0, datagram, HEADER + 16, 4 * ROTORS)
    for i in range(HEADER + 16 + 4 * ROTORS, HEADER + _MODE_AT):
        datagram[i] = 0
    datagram[HEADER + _MODE_AT] = _CUSTOM | _ARMED if armed else _CUSTOM
    return frame_kernels.frame(
        datagram, 0, _CONTROLS_SIZE, _next(desk), system, AUTOPILOT, _CONTROLS_ID, _CONTROLS_CRC
    )


@kernel
def parse_controls(desk, system, datagram, length, command, told):
    """Read an answer; 0, or the fault for which nothing was written.

    command : float64[8], RotorCommand.  told : int64[3], the simulation time (us) of its state,
    whether the vehicle is armed, whether it flies in lockstep.
    """
    controls = desk.controls
    at = frame_kernels.payload(
        datagram, 0, length, system, AUTOPILOT, _CONTROLS_ID, _CONTROLS_CRC, controls
    )
    if at == 0 or at != length:
        return _NOT_A_FRAME
    copy(controls, 16, desk.raw, 0, 4 * ROTORS)
    for i in range(ROTORS):
        if not np.isfinite(desk.fields[i]):
            return _NOT_FINITE
        if not 0.0 <= desk.fields[i] <= 1.0:
            return _OUT_OF_RANGE
    for i in range(ROTORS):
        command[i] = desk.fields[i]
    told[0] = get(controls, 0, _TIME)
    told[1] = controls[_MODE_AT] & _ARMED != 0
    told[2] = get(controls, 8, 8) & _LOCKSTEP != 0
    return 0


# --- both without a datagram


@kernel
def state_received(state, spin):
    """What `parse_state` reads of a state that `pack_state` has sent: (VehicleState, fault).

    state : VehicleState.  spin : Rotors.  The fault is a float; the state of a fault means nothing.
    """
    sent = state_in_flight(state, spin)
    r, q, v, w = sent.r_N, sent.q_NF, sent.v_F, sent.w_F
    # 0 times what is not finite is not a number
    nothing = 0.0 * (r.x + r.y + r.z) + 0.0 * (v.x + v.y + v.z) + 0.0 * (w.x + w.y + w.z)
    nothing += 0.0 * (q.w + q.x + q.y + q.z) + 0.0 * total(sent.Omega)
    unit = abs(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z - 1.0) > 0.01
    fault = select(nothing == 0.0, select(unit, float(_NOT_UNIT), 0.0), float(_NOT_FINITE))
    return state_from_wire(sent), fault


@kernel
def controls_received(command):
    """The rotor command as the plant receives it: rounded to float32, NaN as 0."""
    u = command_through_the_wire(command).u
    return RotorCommand(
        Rotors(
            select(u.r1 == u.r1, u.r1, 0.0), select(u.r2 == u.r2, u.r2, 0.0),
            select(u.r3 == u.r3, u.r3, 0.0), select(u.r4 == u.r4, u.r4, 0.0),
            select(u.r5 == u.r5, u.r5, 0.0), select(u.r6 == u.r6, u.r6, 0.0),
            select(u.r7 == u.r7, u.r7, 0.0), select(u.r8 == u.r8, u.r8, 0.0),
        )
    )  # fmt: skip


# --- the battery

_NO_CELL = 2**16 - 1
_FULL_CELL = _NO_CELL - 1  # mV: the most that the place of a cell holds
_ROUNDING = 1e-9  # percent: 0.57 times 100 is below 57
_NO_TEMPERATURE = 2**15 - 1
_ALL_FUNCTIONS, _LIPO = 1, 1  # MAV_BATTERY_FUNCTION_ALL, MAV_BATTERY_TYPE_LIPO
_BYTES = {name: _BATTERY.offset(name) for name in (field.name for field in _BATTERY.fields)}
_CHARGE_AT, _ENERGY_AT = _BYTES["current_consumed"], _BYTES["energy_consumed"]
_TEMPERATURE_AT, _VOLTAGES_AT = _BYTES["temperature"], _BYTES["voltages"]
_CURRENT_AT, _FUNCTION_AT = _BYTES["current_battery"], _BYTES["battery_function"]
_TYPE_AT, _REMAINING_AT = _BYTES["type"], _BYTES["battery_remaining"]


@kernel
def _whole(x, low, high, unknown):
    """The nearest integer from low to high; `unknown` of what is not a number."""
    if x != x:
        return np.int64(unknown)
    return np.int64(np.rint(min(max(x, low), high)))


@kernel
def _put_battery(datagram, body, battery):
    """Write the payload of BATTERY_STATUS from `body` on."""
    for i in range(_BATTERY_SIZE):
        datagram[body + i] = 0
    put(datagram, body + _CHARGE_AT, _whole(1e3 * battery.drawn_Ah, -(2**31), 2**31 - 1, -1), 4)
    put(datagram, body + _ENERGY_AT, _whole(1e-2 * battery.energy_J, -(2**31), 2**31 - 1, -1), 4)
    put(datagram, body + _TEMPERATURE_AT, _NO_TEMPERATURE, 2)
    pack_mV = _whole(1e3 * battery.voltage, 0, 2 * _FULL_CELL, -1)
    first, second = min(pack_mV, _FULL_CELL), pack_mV - _FULL_CELL
    put(datagram, body + _VOLTAGES_AT, first if pack_mV >= 0 else _NO_CELL, 2)
    put(datagram, body + _VOLTAGES_AT + 2, second if second > 0 else _NO_CELL, 2)
    for i in range(2, 10):
        put(datagram, body + _VOLTAGES_AT + 2 * i, _NO_CELL, 2)
    put(datagram, body + _CURRENT_AT, _whole(1e2 * battery.current, -(2**15), 2**15 - 1, -1), 2)
    datagram[body + _FUNCTION_AT], datagram[body + _TYPE_AT] = _ALL_FUNCTIONS, _LIPO
    percent = np.floor(1e2 * battery.remaining + _ROUNDING)
    put(datagram, body + _REMAINING_AT, _whole(percent, -(2**7), 2**7 - 1, -1), 1)


@kernel
def _battery(payload):
    """The Battery of a payload; with a negative remainder if a field is unknown or out of range."""
    charge, energy = get_signed(payload, _CHARGE_AT, 4), get_signed(payload, _ENERGY_AT, 4)
    current, percent = get_signed(payload, _CURRENT_AT, 2), get_signed(payload, _REMAINING_AT, 1)
    first_mV, second_mV = get(payload, _VOLTAGES_AT, 2), get(payload, _VOLTAGES_AT + 2, 2)
    goes_on = first_mV == _FULL_CELL and second_mV != _NO_CELL
    known = min(charge, energy, current) >= 0 and first_mV != _NO_CELL and 0 <= percent <= 100
    return Battery(
        voltage=1e-3 * (first_mV + second_mV if goes_on else first_mV),
        current=1e-2 * current,
        drawn_Ah=1e-3 * charge,
        remaining=1e-2 * percent if known else -1.0,
        energy_J=1e2 * energy,
    )


# --- from Python


def _signed(time_us: int) -> int:
    """The same eight bytes, as compiled code has them."""
    return time_us - 2**64 if time_us >= 2**63 else time_us


class PlantCodec:
    """Both directions of the plant link of one vehicle, for Python: the kernels above.

    Buffers are flat float64 in the order of VehicleState (21) and RotorCommand (8), in the
    frames and units of `messages`.
    """

    def __init__(self, system_id: int, spin: Rotors | None = None, rotors: int = ROTORS) -> None:
        """`spin` (+1 counter-clockwise, -1, 0 absent) signs rotor speeds; only the plant needs it.

        `rotors`: how many the controller expects of the plant.
        """
        self.system = system_id
        self.desk = desk(rotors if spin is None else sum(each != 0.0 for each in spin))
        self.spin = np.array([] if spin is None else spin, dtype=np.float64)
        self.battery_buffer = np.zeros(size(Battery))
        self.has_battery = np.zeros(1, dtype=np.int64)  # whether one was received, with a state
        self._datagram = np.zeros(LONGEST, dtype=np.uint8)
        self._told = np.zeros(3, dtype=np.int64)
        self._compile()

    @property
    def has_failed(self) -> bool:
        """True if the last state that was received says of itself that it has failed."""
        return bool(self.desk.quality[0] < 0)

    @property
    def battery(self) -> Battery | None:
        """As last received, with a state; None before."""
        return from_buffer(Battery, self.battery_buffer) if self.has_battery[0] else None

    @battery.setter
    def battery(self, battery: Battery | None) -> None:
        self.has_battery[0] = battery is not None
        if battery is not None:
            self.battery_buffer[:] = to_buffer(battery)

    def _compile(self) -> None:
        state, command = np.zeros(_FLOATS), np.zeros(ROTORS)
        if self.spin.size:
            self.pack_state(0, state)
            self._parse(parse_controls, b"", command)
        else:
            self.pack_controls(0, command, False, True)
            self._parse(parse_state, b"", state, self.battery_buffer)
        self.desk.sequence[0] = 0

    def pack_state(self, time_usec: int, buffer: Buffer, battery: Battery | None = None) -> bytes:
        """The datagram of one control tick. Raises ValueError if the codec has no spin."""
        if not self.spin.size:
            raise ValueError("a codec that packs states needs the rotors' spin")
        charge = self.battery_buffer if battery is None else to_buffer(battery)
        length = pack_state(
            self.desk, self.system, _signed(time_usec), buffer, self.spin, charge,
            battery is not None, self._datagram,
        )  # fmt: skip
        return self._datagram[:length].tobytes()

    def _framed(self, of: Definition, payload: bytes) -> bytes:
        sequence = int(self.desk.sequence[0])
        self.desk.sequence[0] = (sequence + 1) & 0xFF
        return framed(of, payload, sequence, self.system, AUTOPILOT)

    def pack_hold(
        self, time_usec: int, buffer: Buffer, battery: Battery | None = None,
        ending: Ending = Ending.NOT_ENDED,
    ) -> bytes:  # fmt: skip
        """A keep-alive while simulation time is held: the state, behind a HEARTBEAT."""
        heartbeat = self._framed(_HEARTBEAT, _hold(ending))
        return heartbeat + self.pack_state(time_usec, buffer, battery)

    @property
    def ending(self) -> Ending:
        """What the last keep-alive that was parsed told of the end of the flight."""
        told = int.from_bytes(self.desk.heartbeat[_ENDING_AT : _ENDING_AT + 4].tobytes(), "little")
        return Ending(min(told, Ending.CRASHED))

    def pack_reset(self) -> bytes:
        """From the controller: begin again, at the start."""
        return self._framed(_COMMAND, _reset(self.system))

    def is_reset(self, datagram: bytes) -> bool:
        """Whether it is what `pack_reset` packs."""
        return self._is(_COMMAND, datagram, _reset(self.system))

    def pack_reset_done(self) -> bytes:
        """From the plant: what comes from now on is of the new flight."""
        return self._framed(_ACK, _RESET_DONE)

    def is_reset_done(self, datagram: bytes) -> bool:
        """Whether it is what `pack_reset_done` packs."""
        return self._is(_ACK, datagram, _RESET_DONE)

    def pack_failure(self, order: failures.Order, number: int, again: bool) -> bytes:
        """From the controller: break something, or mend it.

        number : of the order, from 1: its acknowledgement repeats it.  again : it was sent before.
        """
        params = {f"param{i + 1}": float(value) for i, value in enumerate(order)}
        payload = message(
            "COMMAND_LONG", command=CommandId.INJECT_FAILURE, target_system=self.system,
            target_component=AUTOPILOT, confirmation=int(again), param7=float(number), **params,
        ).payload  # fmt: skip
        return self._framed(_COMMAND, payload)

    def failure(self, datagram: bytes) -> tuple[failures.Order | None, int] | None:
        """The order of `pack_failure`, and its number. None: it is another datagram.

        The order is None if it is none that has a meaning.
        """
        payload = self._payload(_COMMAND, datagram)
        if payload is None:
            return None
        fields = struct.unpack_from("<7fH", payload)
        if fields[7] != CommandId.INJECT_FAILURE:
            return None
        number = fields[6]
        return failures.order(fields), int(number) if 0.0 <= number < 2**24 else 0

    def pack_failure_answer(self, result: Result, number: int) -> bytes:
        """From the plant: what has become of an order."""
        payload = message(
            "COMMAND_ACK", command=CommandId.INJECT_FAILURE, result=result, result_param2=number
        ).payload
        return self._framed(_ACK, payload)

    def failure_answer(self, datagram: bytes) -> tuple[Result, int] | None:
        """Result and number of `pack_failure_answer`. None: it is another datagram."""
        payload = self._payload(_ACK, datagram)
        if payload is None:
            return None
        command, result, _, number = struct.unpack_from("<HBBi", payload)
        known = command == CommandId.INJECT_FAILURE and result in set(Result)
        return (Result(result), number) if known else None

    def _payload(self, of: Definition, datagram: bytes) -> bytes | None:
        """The payload of a datagram that is one message of a kind. None: it is another."""
        try:
            found, end = expected(of, datagram, 0, self.system, AUTOPILOT)
        except WireError:
            return None
        return found if end == len(datagram) else None

    def _is(self, of: Definition, datagram: bytes, payload: bytes) -> bool:
        """Whether a datagram is one message, with this payload."""
        return self._payload(of, datagram) == payload.ljust(of.size, b"\0")

    @staticmethod
    def is_hold(datagram: bytes) -> bool:
        """Whether a datagram that `parse_state` accepts is a keep-alive: no tick, no answer."""
        return datagram[7:10] == b"\0\0\0"

    def parse_state(self, datagram: bytes, buffer: Buffer) -> int:
        """Read a state or a keep-alive into `buffer`; returns its simulation time in us.

        Raises WireError, with `buffer` and `battery` untouched; OtherRotors is one.
        """
        fault = self._parse(parse_state, datagram, buffer, self.battery_buffer)
        if fault == _OTHERS:
            raise OtherRotors(self._which_rotors())
        if fault:
            raise WireError(_FAULTS.get(fault) or self._why_no_state(datagram))
        self.has_battery[0] |= self._told[2]
        return int(self._told[0]) & (2**64 - 1)

    def pack_controls(self, time_usec: int, buffer: Buffer, armed: bool, lockstep: bool) -> bytes:
        """The answer to the state of `time_usec`: a RotorCommand."""
        length = pack_controls(
            self.desk,
            self.system,
            _signed(time_usec),
            buffer,
            armed,
            lockstep,
            False,
            self._datagram,
        )
        return self._datagram[:length].tobytes()

    def parse_controls(self, datagram: bytes, buffer: Buffer) -> tuple[int, bool, bool]:
        """Read a RotorCommand into `buffer`; returns (time in us of its state, armed, lockstep).

        Raises WireError, with `buffer` untouched.
        """
        fault = self._parse(parse_controls, datagram, buffer)
        if fault:
            raise WireError(_FAULTS.get(fault) or self._why_no_controls(datagram))
        time_us, armed, lockstep = self._told.tolist()
        return time_us & (2**64 - 1), bool(armed), bool(lockstep)

    def _parse(self, parse: Any, datagram: bytes, *into: Buffer) -> int:
        length = min(len(datagram), LONGEST)
        self._datagram[:length] = np.frombuffer(datagram, dtype=np.uint8, count=length)
        fault: int = parse(self.desk, self.system, self._datagram, length, *into, self._told)
        return fault

    def _which_rotors(self) -> str:
        """The rotors of the state that was read last, and those that are expected."""
        told = int.from_bytes(self.desk.rotors[_TIME : _TIME + 4].tobytes(), "little")
        own = int(self.desk.active[0])
        return (
            f"the simulator flies {told.bit_count()} rotors, and the controller's airframe has"
            f" {own.bit_count()} (ACTUATOR_OUTPUT_STATUS.active is {told:#x}, expected {own:#x})"
        )

    def _why_no_state(self, datagram: bytes) -> str:
        """What is wrong with the frames of a datagram that was rejected."""
        at = 0
        try:
            wanted = [_ODOMETRY, _ROTOR_STATUS]
            for of in [_HEARTBEAT, *wanted] if self.is_hold(datagram) else wanted:
                _, at = expected(of, datagram, at, self.system, AUTOPILOT)
            _, at = expected(_BATTERY, datagram, at, self.system, AUTOPILOT)
        except WireError as error:
            return str(error)
        return f"{len(datagram) - at} bytes after the state"

    def _why_no_controls(self, datagram: bytes) -> str:
        try:
            _, at = expected(_CONTROLS, datagram, 0, self.system, AUTOPILOT)
        except WireError as error:
            return str(error)
        return f"{len(datagram) - at} bytes after the controls"
