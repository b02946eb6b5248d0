"""The plant link's datagrams, against pymavlink and against fields computed by hand."""

from __future__ import annotations

import math
import struct

import numpy as np
import pymavlink.dialects.v20.common as mavlink
import pytest
from fastcrc.crc16 import mcrf4xx
from hypothesis import given
from hypothesis import strategies as st

from fcu.interface.link import UdpLink
from fcu.interface.messages import Battery, VehicleState
from fcu.kernel.algebra import Quat, Rotors, Vec3
from fcu.kernel.buffers import to_buffer
from fcu.mavlink import frames
from fcu.mavlink import plant_link as wire
from fcu.mavlink.plant_link import PlantCodec
from tests.mavlink.plant_datagrams import (
    SPIN,
    SYSTEM,
    TIME,
    controls_by_pymavlink,
    odometry_by_pymavlink,
    pymavlink_at,
    rotors_by_pymavlink,
    state_by_pymavlink,
    untouched,
)
from tests.mavlink.strategies import anything, commands, states

CODEC = PlantCodec(SYSTEM, SPIN)

# nose north, level, 20 m north of the origin, 10 m east, 30 m up; moving east at 2 m/s
HALF = math.sqrt(0.5)
FLYING = VehicleState(
    Vec3(10.0, 20.0, 30.0),
    Vec3(2.0, 0.0, 0.0),
    Quat(HALF, 0.0, 0.0, HALF),
    Vec3(0.25, 0.5, 0.75),
    Rotors(301.0, 302.0, 303.0, 304.0, 305.0, 306.0, 307.0, 308.0),
)

FLOWN_FOR = Battery(22.987, 51.23, 4.567, 0.7, 370_500.0)

times = st.integers(0, 2**64 - 1)


@given(states, times)
def test_state_datagram_is_pymavlinks_to_the_byte(state, time):
    codec = PlantCodec(SYSTEM, SPIN)
    on_wire = frames.state_to_wire(state)
    link = pymavlink_at(0)
    for sequence in (0, 2):
        link.seq = sequence
        expected = state_by_pymavlink(
            link, odometry_by_pymavlink(on_wire, time), rotors_by_pymavlink(on_wire, time)
        )
        assert codec.pack_state(time, to_buffer(state)) == expected


@given(commands, times, st.booleans(), st.booleans())
def test_controls_datagram_is_pymavlinks_to_the_byte(command, time, armed, lockstep):
    u = list(frames.command_through_the_wire(command).u)
    expected = controls_by_pymavlink(u, 0, 129 if armed else 1, int(lockstep), time)
    datagram = PlantCodec(SYSTEM).pack_controls(time, to_buffer(command), armed, lockstep)
    assert datagram == expected


def test_sequence_numbers_count_messages_and_wrap():
    codec = PlantCodec(SYSTEM)
    sequences = [codec.pack_controls(0, np.zeros(8), True, True)[4] for _ in range(258)]
    assert sequences == [*range(256), 0, 1]


def test_fields_of_a_state_computed_by_hand():
    datagram = PlantCodec(SYSTEM, SPIN).pack_state(TIME, to_buffer(FLYING))
    assert datagram[:10] == bytes([0xFD, 230, 0, 0, 0, SYSTEM, 1]) + (331).to_bytes(3, "little")
    assert struct.unpack_from("<Q", datagram, 10) == (TIME,)
    numbers = struct.unpack_from("<13f", datagram, 18)
    assert numbers[0:3] == (20.0, 10.0, -30.0)  # north, east, down
    assert numbers[3:7] == pytest.approx((1.0, 0.0, 0.0, 0.0))
    assert numbers[7:10] == pytest.approx((0.0, 2.0, 0.0), abs=1e-6)  # to the right of the nose
    assert numbers[10:13] == (0.25, -0.5, -0.75)
    assert datagram[238:240] == bytes([1, 12])  # LOCAL_NED, BODY_FRD
    rotors = datagram[242:]
    assert rotors[:10] == bytes([0xFD, 44, 0, 0, 1, SYSTEM, 1]) + (375).to_bytes(3, "little")
    assert struct.unpack_from("<QI8f", rotors, 10) == (
        TIME, 0xFF, 301.0, -302.0, 303.0, -304.0, 305.0, -306.0, 307.0, -308.0,
    )  # fmt: skip


def test_fields_of_controls_computed_by_hand():
    u = np.array([0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 1.0])
    datagram = PlantCodec(SYSTEM).pack_controls(TIME, u, armed=True, lockstep=True)
    assert datagram[:10] == bytes([0xFD, 81, 0, 0, 0, SYSTEM, 1]) + (93).to_bytes(3, "little")
    assert struct.unpack_from("<QQ16fB", datagram, 10) == (TIME, 1, *u, *[0.0] * 8, 129)
    disarmed = PlantCodec(SYSTEM).pack_controls(TIME, u, armed=False, lockstep=False)
    assert (struct.unpack_from("<Q", disarmed, 18)[0], disarmed[90]) == (0, 1)


def test_stopped_rotors_are_trimmed_and_restored():
    stopped = FLYING._replace(Omega=Rotors(*[0.0] * 8))
    datagram = PlantCodec(SYSTEM, Rotors(*[1.0] * 8)).pack_state(TIME, to_buffer(stopped))
    assert len(datagram) == 242 + 12 + 9  # the rotors' payload ends with `active`
    received = untouched(21)
    assert CODEC.parse_state(datagram, received) == TIME
    assert (received[13:] == 0.0).all()


@given(states, times)
def test_state_over_the_wire_is_the_kernels_to_the_bit(state, time):
    received = untouched(21)
    assert CODEC.parse_state(CODEC.pack_state(time, to_buffer(state)), received) == time
    assert received.tobytes() == to_buffer(frames.through_the_wire(state)).tobytes()


@given(commands, times, st.booleans(), st.booleans())
def test_command_over_the_wire_is_the_kernels_to_the_bit(command, time, armed, lockstep):
    received = untouched(8)
    datagram = CODEC.pack_controls(time, to_buffer(command), armed, lockstep)
    assert CODEC.parse_controls(datagram, received) == (time, armed, lockstep)
    assert received.tobytes() == to_buffer(frames.command_through_the_wire(command)).tobytes()


def test_state_over_udp_is_the_kernels_to_the_bit():
    receiver = UdpLink(0)
    sender = UdpLink(0, receiver.port)
    try:
        sender.send(CODEC.pack_state(TIME, to_buffer(FLYING)))
        assert receiver.wait(5.0)
        received = untouched(21)
        assert CODEC.parse_state(receiver.receive(), received) == TIME
        assert received.tobytes() == to_buffer(frames.through_the_wire(FLYING)).tobytes()
    finally:
        sender.close()
        receiver.close()


def test_a_keep_alive_is_told_from_a_tick_and_carries_the_state():
    tick = CODEC.pack_state(TIME, to_buffer(FLYING))
    hold = CODEC.pack_hold(TIME, to_buffer(FLYING))
    assert (CODEC.is_hold(tick), CODEC.is_hold(hold), CODEC.is_hold(b"")) == (False, True, False)
    received = untouched(21)
    assert CODEC.parse_state(hold, received) == TIME
    assert received.tobytes() == to_buffer(frames.through_the_wire(FLYING)).tobytes()
    heartbeat, *rest = mavlink.MAVLink(None).parse_buffer(bytearray(hold))
    assert (heartbeat.get_type(), heartbeat.type, heartbeat.autopilot) == ("HEARTBEAT", 0, 8)
    assert [m.get_type() for m in rest] == ["ODOMETRY", "ACTUATOR_OUTPUT_STATUS"]


@pytest.mark.parametrize(
    ("ending", "status"),
    [
        (wire.Ending.NOT_ENDED, mavlink.MAV_STATE_ACTIVE),
        (wire.Ending.DIVERGED, mavlink.MAV_STATE_EMERGENCY),
        (wire.Ending.CRASHED, mavlink.MAV_STATE_EMERGENCY),
    ],
)
def test_a_keep_alive_tells_how_the_flight_has_ended(ending, status):
    hold = CODEC.pack_hold(TIME, to_buffer(FLYING), ending=ending)
    heartbeat, *_ = mavlink.MAVLink(None).parse_buffer(bytearray(hold))
    assert (heartbeat.custom_mode, heartbeat.system_status) == (ending, status)
    controller = PlantCodec(SYSTEM)
    controller.parse_state(hold, untouched(21))
    assert controller.ending is ending


def test_a_reset_and_its_acknowledgement_are_pymavlinks():
    command, done = CODEC.pack_reset(), CODEC.pack_reset_done()
    (asked,) = mavlink.MAVLink(None).parse_buffer(bytearray(command))
    assert (asked.command, asked.param1, asked.target_system) == (246, 1.0, SYSTEM)
    (ack,) = mavlink.MAVLink(None).parse_buffer(bytearray(done))
    assert (ack.command, ack.result) == (246, mavlink.MAV_RESULT_ACCEPTED)
    others = [b"", CODEC.pack_state(TIME, to_buffer(FLYING)), command + done]
    others += [PlantCodec(SYSTEM + 1, SPIN).pack_reset(), PlantCodec(SYSTEM + 1).pack_reset_done()]
    for datagram in (command, done, *others):
        assert CODEC.is_reset(datagram) is (datagram is command)
        assert CODEC.is_reset_done(datagram) is (datagram is done)


def test_fields_of_a_battery_computed_by_hand():
    datagram = PlantCodec(SYSTEM, SPIN).pack_state(TIME, to_buffer(FLYING), FLOWN_FOR)
    state = PlantCodec(SYSTEM, SPIN).pack_state(TIME, to_buffer(FLYING))
    frame = datagram[len(state) :]
    assert datagram[: len(state)] == state
    assert frame[:10] == bytes([0xFD, 36, 0, 0, 2, SYSTEM, 1]) + (147).to_bytes(3, "little")
    assert struct.unpack_from("<iih10HhBBBb", frame, 10) == (
        4567, 3705, 32767, 22987, *[65535] * 9, 5123, 0, 1, 1, 70,
    )  # fmt: skip


def test_a_battery_is_pymavlinks_and_arrives_to_its_fields_resolution():
    codec = PlantCodec(SYSTEM, SPIN)
    for pack in (codec.pack_state, codec.pack_hold):
        datagram = pack(TIME, to_buffer(FLYING), FLOWN_FOR)
        *_, battery = mavlink.MAVLink(None).parse_buffer(bytearray(datagram))
        assert (battery.get_type(), battery.voltages[0]) == ("BATTERY_STATUS", 22987)
        received = PlantCodec(SYSTEM)
        assert received.battery is None
        assert received.parse_state(datagram, untouched(21)) == TIME
        assert received.battery == pytest.approx((22.987, 51.23, 4.567, 0.70, 370500.0), rel=1e-12)
        # one without leaves the last
        assert (
            received.parse_state(codec.pack_state(TIME, to_buffer(FLYING)), untouched(21)) == TIME
        )
        assert received.battery is not None


@given(st.builds(Battery, *[st.floats(0.0, allow_nan=False)] * 3, st.floats(0.0, 1.0), anything))
def test_no_battery_is_too_much_for_its_datagram(battery):
    battery = battery._replace(energy_J=abs(battery.energy_J))
    received = PlantCodec(SYSTEM)
    received.parse_state(CODEC.pack_state(TIME, to_buffer(FLYING), battery), untouched(21))
    assert received.battery is not None
    assert received.battery.voltage == pytest.approx(min(battery.voltage, 131.068), abs=5.1e-4)
    assert received.battery.current == pytest.approx(min(battery.current, 327.67), abs=5.1e-3)
    assert -1e-10 <= battery.remaining - received.battery.remaining < 0.01


@pytest.mark.parametrize(
    ("volts", "cells"), [(65.534, [65534, 65535]), (65.535, [65534, 1]), (99.9, [65534, 34366])]
)
def test_a_pack_above_65_volts_arrives_whole(volts, cells):
    """As MAVLink's BATTERY_STATUS has it: what is above goes to the next place."""
    datagram = CODEC.pack_state(TIME, to_buffer(FLYING), FLOWN_FOR._replace(voltage=volts))
    *_, battery = mavlink.MAVLink(None).parse_buffer(bytearray(datagram))
    assert battery.voltages[:2] == cells
    received = PlantCodec(SYSTEM)
    received.parse_state(datagram, untouched(21))
    assert received.battery.voltage == pytest.approx(volts, abs=1e-9)


@pytest.mark.parametrize(
    ("left", "percent"), [(0.07, 7), (0.0699, 6), (0.065, 6), (0.57, 57), (1.0, 100)]
)
def test_the_charge_is_rounded_down_so_that_a_level_is_passed_at_its_percent(left, percent):
    received = PlantCodec(SYSTEM)
    state = CODEC.pack_state(TIME, to_buffer(FLYING), FLOWN_FOR._replace(remaining=left))
    received.parse_state(state, untouched(21))
    assert received.battery.remaining == 1e-2 * percent


@pytest.mark.parametrize("field", Battery._fields)
def test_a_battery_of_which_anything_is_unknown_is_not_believed(field):
    """A single field without a value takes the state along, and the last battery stays."""
    unknown = FLOWN_FOR._replace(**{field: math.nan})
    received = PlantCodec(SYSTEM)
    received.battery = FLOWN_FOR
    with pytest.raises(wire.WireError):
        received.parse_state(CODEC.pack_state(TIME, to_buffer(FLYING), unknown), untouched(21))
    assert received.battery == FLOWN_FOR


@pytest.mark.parametrize(
    ("field", "unknown"),
    [("charge", -1), ("energy", -1), ("current", -1), ("voltage", 65535), ("percent", -1), ("percent", 101)],
)  # fmt: skip
def test_a_number_that_stands_for_unknown_leaves_no_battery(field, unknown):
    """The standard's numbers for unknown: -1, and 65535 mV. More than 100 % is none either."""
    told = {"charge": 4567, "energy": 3705, "voltage": 22987, "current": 5123, "percent": 70}

    def read(charge, energy, voltage, current, percent):
        cells = (voltage, *[65535] * 9)
        payload = struct.pack(
            "<iih10HhBBBb", charge, energy, 32767, *cells, current, 0, 1, 1, percent
        )
        return wire._battery(np.frombuffer(payload, dtype=np.uint8).copy())

    assert read(**told) == pytest.approx((22.987, 51.23, 4.567, 0.70, 370500.0), rel=1e-12)
    assert read(**told | {field: unknown}).remaining < 0.0


def test_a_longer_payload_of_a_newer_dialect_is_read():
    message = controls_by_pymavlink([0.5] * 8)
    header, payload = bytearray(message[:10]), message[10:-2] + b"\x07\x07"
    header[1] += 2
    frame = bytes(header) + payload
    crc = mcrf4xx(frame[1:] + bytes([mavlink.MAVLink_hil_actuator_controls_message.crc_extra]))
    received = untouched(8)
    assert CODEC.parse_controls(frame + struct.pack("<H", crc), received) == (TIME, True, True)
    assert (received == 0.5).all()


def test_only_the_end_that_knows_the_spin_packs_states():
    with pytest.raises(ValueError, match="spin"):
        PlantCodec(SYSTEM).pack_state(TIME, to_buffer(FLYING))


def test_python_and_compiled_codecs_give_the_same_bits():
    sent, received = np.zeros((2, wire.LONGEST), np.uint8), np.zeros((2, 21))
    charge, told = np.zeros(5), np.zeros(3, np.int64)
    for i, (pack, parse) in enumerate(
        ((wire.pack_state.py_func, wire.parse_state.py_func), (wire.pack_state, wire.parse_state))
    ):
        desk = wire.desk()
        length = pack(
            desk, SYSTEM, TIME, to_buffer(FLYING), np.array(SPIN, float), charge, True, sent[i]
        )
        assert parse(desk, SYSTEM, sent[i], length, received[i], charge, told) == 0
        assert told.tolist() == [TIME, False, True]
    assert sent[0].tobytes() == sent[1].tobytes()
    assert (
        received[0].tobytes()
        == received[1].tobytes()
        == to_buffer(frames.through_the_wire(FLYING)).tobytes()
    )
