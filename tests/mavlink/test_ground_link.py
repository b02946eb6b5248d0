"""Bad input on the ground link: what is dropped and counted, and that nothing else happens."""

from __future__ import annotations

import math
import struct

import pymavlink.dialects.v20.common as mavlink
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.mavlink.definitions import DEFINITIONS, Packed
from fcu.mavlink.framing import Source, framed
from fcu.mavlink.ground_link import READERS, GroundCodec
from fcu.mavlink.requests import Command
from fcu.mavlink.setpoints import SetpointMessage, setpoint
from fcu.mavlink.telemetry import Heartbeat, ground_heartbeat

FCU = Source(3, 1)
SCRIPT = Source(245, 190)
READ_HERE = sorted(number for number, kind in DEFINITIONS.items() if kind.name in READERS)
NOWHERE = Vec3(0.5, 0.5, 0.5)


@pytest.fixture
def fcu():
    return GroundCodec(*FCU)


def sent(message, source=SCRIPT, sequence=0):
    """A pymavlink message as the bytes of a sender."""
    link = mavlink.MAVLink(None, srcSystem=source.system, srcComponent=source.component)
    link.seq = sequence
    return message.pack(link)


def addressed(system, component):
    return mavlink.MAVLink_command_long_message(system, component, 22, 0, *[0.0] * 7)


TAKEOFF = mavlink.MAVLink_command_long_message(*FCU, 22, 0, *[math.nan] * 7)
GOOD = sent(TAKEOFF)
SETPOINT = framed(*setpoint(FCU, 1.0, Setpoint(NOWHERE, NOWHERE, NOWHERE, 0.5, 0.5)), 0, *SCRIPT)
HEARTBEAT = framed(*ground_heartbeat(), 0, *SCRIPT)


# --- who from, who to


@pytest.mark.parametrize(
    ("datagram", "reason"),
    [
        (sent(mavlink.MAVLink_raw_imu_message(0, *[0] * 9)), "unknown message"),
        (sent(TAKEOFF, Source(0, 1)), "source 0"),
        (sent(TAKEOFF, FCU), "from ourselves"),
        (GOOD[:-1] + bytes([GOOD[-1] ^ 1]), "wrong checksum"),
        (GOOD[:-1], "truncated"),
        (b"\xfd", "truncated"),
        (b"\xfd\xff\x00", "truncated"),
        (b"\xfe", "truncated"),
        (b"GET / HTTP/1.1", "not MAVLink"),
        (bytes(1), "not MAVLink"),
        (GOOD[:2] + b"\x02" + GOOD[3:], "unknown flags"),
        (sent(addressed(4, 1)), "for another"),
        (sent(addressed(3, 100)), "for another"),
        (sent(mavlink.MAVLink_set_mode_message(4, 1, 0)), "for another"),
        (sent(mavlink.MAVLink_manual_control_message(4, 0, 0, 0, 0, 0)), "for another"),
        (sent(mavlink.MAVLink_ping_message(0, 0, 4, 1)), "for another"),
        (sent(mavlink.MAVLink_param_request_list_message(3, 2)), "for another"),
    ],
)
def test_what_is_not_for_us_is_dropped_and_counted(fcu, datagram, reason):
    assert fcu.parse(datagram) == []
    assert fcu.dropped == {reason: 1}


def test_another_component_of_our_system_is_heard(fcu):
    (command,) = fcu.parse(sent(TAKEOFF, Source(3, 191)))
    assert command.source == (3, 191)


def test_a_script_that_has_not_chosen_its_component_is_heard(fcu):
    (command,) = fcu.parse(sent(TAKEOFF, Source(255, 0)))  # pymavlink's default
    assert command.source == (255, 0)


@pytest.mark.parametrize("target", [(0, 0), (0, 1), (3, 0), (3, 1)])
def test_what_is_for_everyone_is_for_us(fcu, target):
    (command,) = fcu.parse(sent(addressed(*target)))
    assert isinstance(command, Command)
    assert (command.target_system, command.target_component) == target


def test_an_empty_datagram_is_nothing(fcu):
    assert fcu.parse(b"") == []
    assert not fcu.dropped


# --- one datagram and the next


def test_a_datagram_holds_messages_of_any_kind_and_reading_goes_on(fcu):
    old = TAKEOFF.pack(mavlink.MAVLink(None, 245, 190), force_mavlink1=True)
    damaged = bytearray(GOOD)
    damaged[20] ^= 1
    messages = fcu.parse(old + bytes(damaged) + SETPOINT + GOOD)
    assert [type(m) for m in messages] == [Command, SetpointMessage, Command]
    assert fcu.dropped == {"wrong checksum": 1}


@pytest.mark.parametrize("half", [GOOD[:20], b"\xfd\xff\x00", b"\xfe\xff", b"\xfd"])
def test_half_a_message_does_not_spoil_another_senders(fcu, half):
    for n in range(100):
        assert fcu.parse(half) == []
        assert len(fcu.parse(sent(TAKEOFF, Source(7, 1), n))) == 1
    assert fcu.dropped == {"truncated": 100}


@pytest.mark.parametrize("at", [1, 10, 30, len(GOOD) - 1])
def test_a_message_split_over_two_datagrams_is_not_joined(fcu, at):
    assert fcu.parse(GOOD[:at]) == []
    assert fcu.parse(GOOD[at:]) == []
    assert len(fcu.parse(GOOD)) == 1


def test_sequence_numbers_may_jump_wrap_and_repeat(fcu):
    for sequence in (254, 255, 0, 0, 100, 7):
        assert len(fcu.parse(sent(TAKEOFF, sequence=sequence))) == 1
    assert not fcu.dropped


@pytest.mark.parametrize("filler", [b"\x00", b"\xfd", b"\xfe", b"A", GOOD])
def test_the_longest_datagram_costs_sixteen_messages_at_most(fcu, filler):
    datagram = (filler * 65507)[:65507]
    assert len(fcu.parse(datagram)) == (16 if filler == GOOD else 0)
    assert 1 <= fcu.dropped.total() <= 17
    assert len(fcu.parse(GOOD)) == 1


def test_tools_may_read_more_of_a_datagram():
    tool = GroundCodec(*SCRIPT, at_once=256)
    assert len(tool.parse(100 * framed(*ground_heartbeat(), 0, *FCU))) == 100
    assert not tool.dropped


# --- damage


@given(st.binary(max_size=300))
def test_random_bytes_are_counted_and_never_raise(junk):
    fcu = GroundCodec(*FCU)
    assert fcu.parse(junk) == []
    assert bool(fcu.dropped) == bool(junk)
    assert len(fcu.parse(GOOD)) == 1


@pytest.mark.parametrize("frame", [GOOD, SETPOINT, HEARTBEAT], ids=["command", "setpoint", "alive"])
def test_one_wrong_bit_anywhere_is_noticed(frame):
    # Flags that do not matter to a reader are under the checksum too.
    for bit in range(8 * len(frame)):
        damaged = bytearray(frame)
        damaged[bit // 8] ^= 1 << bit % 8
        fcu = GroundCodec(*FCU)
        assert fcu.parse(bytes(damaged)) == [], bit
        assert fcu.dropped.total() >= 1


DATAGRAM = SETPOINT + GOOD + HEARTBEAT


@given(st.integers(0, 8 * len(DATAGRAM) - 1), st.integers(0, len(DATAGRAM)))
def test_damaged_datagrams_never_add_messages(bit, length):
    fcu = GroundCodec(*FCU)
    damaged = bytearray(DATAGRAM)
    damaged[bit // 8] ^= 1 << bit % 8
    kinds = [type(m) for m in fcu.parse(bytes(damaged[:length]))]
    whole = [SetpointMessage, Command, Heartbeat]
    assert len(kinds) < 3
    assert all(kind in whole for kind in kinds)
    assert fcu.dropped or length < len(DATAGRAM)


@pytest.mark.parametrize("number", READ_HERE)
@given(st.binary(max_size=255))
@pytest.mark.computes
def test_any_payload_with_a_right_checksum_is_read_without_raising(number, payload):
    fcu = GroundCodec(*FCU)
    messages = fcu.parse(framed(*Packed(DEFINITIONS[number], payload), 0, *SCRIPT))
    assert len(messages) + fcu.dropped["for another"] == 1


@pytest.mark.parametrize("number", READ_HERE)
@pytest.mark.parametrize("number_in_it", [math.nan, math.inf, -math.inf, 3.4e38])
def test_any_message_full_of_wild_floats_is_read_without_raising(number, number_in_it):
    kind = DEFINITIONS[number]
    payload = struct.pack("<f", number_in_it) * (kind.size // 4 + 1)
    fcu = GroundCodec(*FCU)
    messages = fcu.parse(framed(*Packed(kind, payload[: kind.size]), 0, *SCRIPT))
    assert len(messages) + fcu.dropped["for another"] == 1
