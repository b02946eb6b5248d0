"""What the ground link drops and counts, and whatever is thrown at it."""

from __future__ import annotations

import math
import struct

import pymavlink.dialects.v20.common as mavlink
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fcu.interface.ground_messages import (
    Command,
    Source,
)
from fcu.interface.ground_wire import GroundCodec

FCU = Source(3, 1)
SCRIPT = Source(245, 190)


@pytest.fixture
def fcu():
    return GroundCodec(*FCU)


def sent(message, source=SCRIPT, sequence=0):
    """A pymavlink message as the bytes of a sender."""
    link = mavlink.MAVLink(None, srcSystem=source.system, srcComponent=source.component)
    link.seq = sequence
    return message.pack(link)


def position_target(mask=0, frame=1, target=FCU, **fields):
    values = dict.fromkeys(
        ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"), 0.5
    )
    return mavlink.MAVLink_set_position_target_local_ned_message(
        5, *target, frame, mask, *(values | fields).values()
    )


TAKEOFF = mavlink.MAVLink_command_long_message(*FCU, 22, 0, *[math.nan] * 7)


def addressed(system, component):
    return mavlink.MAVLink_command_long_message(system, component, 22, 0, *[0.0] * 7)


@pytest.mark.parametrize(
    ("datagram", "reason"),
    [
        (sent(mavlink.MAVLink_ping_message(0, 0, 0, 0)), "unknown message"),
        (sent(TAKEOFF, Source(0, 1)), "source 0"),
        (sent(TAKEOFF)[:-1] + b"\x55", "wrong checksum"),
        (sent(TAKEOFF)[:-1], "truncated"),
        (TAKEOFF.pack(mavlink.MAVLink(None, 245, 190), force_mavlink1=True), "MAVLink 1"),
        (b"GET / HTTP/1.1", "not MAVLink"),
        (b"\xfd", "not MAVLink"),
        (sent(TAKEOFF)[:2] + b"\x02" + sent(TAKEOFF)[3:], "unknown flags"),
        (sent(addressed(4, 1)), "for another"),
        (sent(addressed(3, 100)), "for another"),
    ],
)
def test_what_is_not_for_us_is_dropped_and_counted(fcu, datagram, reason):
    assert fcu.parse(datagram) == []
    assert fcu.dropped == {reason: 1}


@pytest.mark.parametrize("target", [(0, 0), (0, 1), (3, 0), (3, 1)])
def test_what_is_for_everyone_is_for_us(fcu, target):
    (command,) = fcu.parse(sent(addressed(*target)))
    assert isinstance(command, Command)


def test_a_datagram_holds_messages_of_any_kind_and_reading_goes_on(fcu):
    old = TAKEOFF.pack(mavlink.MAVLink(None, 245, 190), force_mavlink1=True)
    damaged = bytearray(sent(TAKEOFF))
    damaged[20] ^= 1
    messages = fcu.parse(old + damaged + sent(position_target()) + sent(TAKEOFF))
    assert [type(m).__name__ for m in messages] == ["SetpointMessage", "Command"]
    assert fcu.dropped == {"MAVLink 1": 1, "wrong checksum": 1}


def test_half_a_message_does_not_spoil_the_next_datagram(fcu):
    assert fcu.parse(sent(TAKEOFF)[:20]) == []
    assert len(fcu.parse(sent(TAKEOFF, Source(7, 1)))) == 1


@given(st.binary(max_size=300))
def test_random_bytes_are_counted_and_never_raise(junk):
    fcu = GroundCodec(*FCU)
    assert fcu.parse(junk) == []
    assert bool(fcu.dropped) == bool(junk)


DATAGRAM = sent(position_target()) + sent(TAKEOFF) + GroundCodec(*SCRIPT).pack_ground_heartbeat()


@given(st.integers(0, 8 * len(DATAGRAM) - 1), st.integers(0, len(DATAGRAM)))
def test_damaged_datagrams_never_raise_and_never_add_messages(bit, length):
    fcu = GroundCodec(*FCU)
    damaged = bytearray(DATAGRAM)
    damaged[bit // 8] ^= 1 << bit % 8
    whole, damaged_messages = fcu.parse(DATAGRAM), fcu.parse(bytes(damaged[:length]))
    assert len(whole) == 3
    assert len(damaged_messages) < 3 or length == len(DATAGRAM)
    assert all(m in whole for m in damaged_messages if not isinstance(m, Command))
    assert fcu.dropped or length < len(DATAGRAM)


@given(st.binary(max_size=255), st.sampled_from([0, 31, 32, 75, 76, 77, 84, 85, 245, 253]))
def test_any_payload_with_a_right_checksum_is_read_without_raising(payload, number):
    header = struct.pack("<BBBBBBBHB", 0xFD, len(payload), 0, 0, 0, 245, 190, number, 0)
    extra = bytes([mavlink.mavlink_map[number].crc_extra])
    crc = mavlink.x25crc(header[1:] + payload + extra).crc
    fcu = GroundCodec(*FCU)
    messages = fcu.parse(header + payload + struct.pack("<H", crc))
    assert len(messages) + fcu.dropped["for another"] == 1
