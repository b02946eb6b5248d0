"""MAVLink frames: layouts, numbers and bytes held against pymavlink; datagrams taken apart."""

from __future__ import annotations

import math
import struct
from collections import Counter

import pymavlink.dialects.v10.common as v1
import pymavlink.dialects.v20.all as everything
import pymavlink.dialects.v20.common as mavlink
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fcu.mavlink.definitions import DEFINITIONS, FLOAT32_MAX, Packed, declared, of, packed
from fcu.mavlink.framing import framed, framed_v1, frames

TIMESYNC, SERIAL_CONTROL = 111, 126  # the dialect has not their extensions
ADDRESSED = ["target_system", "target_component"]
EXTENDED = {
    TIMESYNC: ADDRESSED,
    SERIAL_CONTROL: ADDRESSED,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: ["mission_id", "fence_id", "rally_points_id"],
    mavlink.MAVLINK_MSG_ID_MISSION_COUNT: ["opaque_id"],
    mavlink.MAVLINK_MSG_ID_MISSION_ACK: ["opaque_id"],
}
NUMBERS = sorted(set(mavlink.mavlink_map) - set(EXTENDED))
HEARTBEAT, COMMAND_LONG, PARAM_SET, BATTERY, POSITION = (
    DEFINITIONS[n] for n in (0, 76, 23, 147, 33)
)
LATER = [168, 345, 435, 436, 437]  # left out of the common dialect, known to others


def taken_apart(datagram, **options):
    dropped = Counter()
    return list(frames(datagram, DEFINITIONS, dropped, **options)), dropped


def heartbeat(custom_mode=7):
    return packed(HEARTBEAT, type=14, autopilot=12, custom_mode=custom_mode, mavlink_version=3)


# --- layouts


@pytest.mark.parametrize("number", NUMBERS)
def test_a_layout_is_the_dialects(number):
    theirs, ours = mavlink.mavlink_map[number], DEFINITIONS[number]
    assert (ours.name, ours.id, ours.size) == (theirs.msgname, number, theirs.unpacker.size)
    assert ours.crc_extra == bytes([theirs.crc_extra])
    assert [f.name for f in ours.fields] == list(theirs.ordered_fieldnames)


@pytest.mark.parametrize("number", sorted(EXTENDED))
def test_a_message_with_newer_fields_is_the_dialects_up_to_them(number):
    theirs, ours = mavlink.mavlink_map[number], DEFINITIONS[number]
    assert ours.crc_extra == bytes([theirs.crc_extra])
    names = [f.name for f in ours.fields]
    assert names == [*theirs.ordered_fieldnames, *EXTENDED[number]]


@pytest.mark.parametrize("number", sorted(set(v1.mavlink_map) & set(DEFINITIONS)))
def test_without_its_extensions_a_message_is_that_of_mavlink_1(number):
    ours, theirs = DEFINITIONS[number], v1.mavlink_map[number]
    assert ours.core_size == theirs.unpacker.size
    payload = bytes(1 + i % 7 for i in range(ours.size))
    frame = framed_v1(ours, payload, 200, 3, 1)
    (message,) = v1.MAVLink(None).parse_buffer(bytearray(frame))
    assert (message.get_msgId(), message.get_seq(), message.get_srcSystem()) == (number, 200, 3)
    assert frame[6:-2] == payload[: ours.core_size]  # zeros at its end are not left out


def test_a_number_that_mavlink_1_has_not_is_not_framed():
    modes = DEFINITIONS[435]
    assert framed_v1(modes, bytes(modes.size), 0, 3, 1) is None


def declarations(message):
    """The fields in the order of the XML."""
    length = dict(zip(message.ordered_fieldnames, message.array_lengths, strict=True))
    for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True):
        count = f"[{length[name]}]" if length[name] else ""
        yield f"{kind.removesuffix('_mavlink_version')}{count} {name}"


@pytest.mark.parametrize("number", sorted(everything.mavlink_map))
def test_a_declaration_gives_wire_order_and_crc_extra(number):
    # Where the extensions begin the dialect does not say: there is a place at which all agrees.
    message = everything.mavlink_map[number]
    fields = list(declarations(message))
    possible = [
        declared(message.msgname, number, *fields[:n], extensions=tuple(fields[n:]))
        for n in range(len(fields), 0, -1)
    ]
    assert any(
        (k.fields, k.crc_extra) == (of(message).fields, of(message).crc_extra) for k in possible
    )


@pytest.mark.parametrize("number", LATER)
def test_messages_declared_here_are_as_other_dialects_have_them(number):
    theirs = of(everything.mavlink_map[number])
    assert DEFINITIONS[number][:3] == theirs[:3]
    assert DEFINITIONS[number].crc_extra == theirs.crc_extra
    assert DEFINITIONS[number].size == theirs.size


def test_timesync_is_the_dialects_and_two_bytes_more():
    theirs, ours = of(mavlink.mavlink_map[TIMESYNC]), DEFINITIONS[TIMESYNC]
    assert (ours.fields[:2], ours.crc_extra) == (theirs.fields, theirs.crc_extra)
    assert ours.size == theirs.size + 2


def test_messages_no_dialect_has_are_as_the_standard_has_them():
    assert {n: (DEFINITIONS[n].crc_extra[0], DEFINITIONS[n].size) for n in (290, 291, 300)} == {
        290: (251, 46),
        291: (10, 57),
        300: (217, 22),
    }


# --- packing


def test_a_frame_is_pymavlinks_to_the_byte():
    ours = packed(
        BATTERY, id=1, battery_function=1, type=1, temperature=2000, voltages=range(3700, 3710),
        current_battery=-5, current_consumed=100, energy_consumed=200, battery_remaining=55,
        time_remaining=600, charge_state=1, voltages_ext=[1, 2, 3, 0], mode=0, fault_bitmask=0,
    )  # fmt: skip
    theirs = mavlink.MAVLink_battery_status_message(
        1, 1, 1, 2000, list(range(3700, 3710)), -5, 100, 200, 55, 600, 1, [1, 2, 3, 0], 0, 0
    )
    link = mavlink.MAVLink(None, 3, 1)
    link.seq = 250
    assert framed(*ours, 250, 3, 1) == theirs.pack(link)


def test_a_message_id_of_three_bytes_is_framed():
    kind = declared("FAR", 0x123456, "uint8_t seq")
    assert framed(*packed(kind, seq=1), 0, 3, 1)[7:10] == bytes([0x56, 0x34, 0x12])


@pytest.mark.parametrize("name", ["HEARTBEAT", "STATUSTEXT"])
def test_an_empty_message_keeps_one_byte(name):
    message = packed(of(getattr(mavlink, f"MAVLink_{name.lower()}_message")))
    assert framed(*message, 0, 3, 1)[10:-2] == b"\0"


@pytest.mark.parametrize(
    ("value", "field"),
    [
        (1.4, 1), (1.6, 2), (-1.0, -1), (math.nan, 0), (math.inf, 2**31 - 1), (1e39, 2**31 - 1),
        (-math.inf, -(2**31)), (-3e9, -(2**31)), (2**31, 2**31 - 1),
    ],
)  # fmt: skip
def test_integers_are_rounded_and_saturated(value, field):
    assert DEFINITIONS[33].unpack(whole(packed(POSITION, lat=value)))["lat"] == field


@pytest.mark.parametrize(("value", "field"), [(1e39, FLOAT32_MAX), (-math.inf, -FLOAT32_MAX)])
def test_floats_are_saturated(value, field):
    message = packed(COMMAND_LONG, param1=value, param2=math.nan)
    fields = COMMAND_LONG.unpack(whole(message))
    assert fields["param1"] == field
    assert math.isnan(fields["param2"])


def whole(message):
    return message.payload


@given(st.sampled_from(sorted(DEFINITIONS)), st.data())
@pytest.mark.computes
def test_no_number_raises_and_each_field_comes_back_in_its_range(number, data):
    kind = DEFINITIONS[number]
    numbers = st.floats() | st.integers(-(2**70), 2**70)
    values = {
        f.name: data.draw(
            st.binary(max_size=70) if f.code == "s"
            else st.lists(numbers, max_size=2 * f.length) if f.length else numbers
        )
        for f in kind.fields
    }  # fmt: skip
    frame = framed(*packed(kind, **values), 5, 3, 1)
    ((back,), dropped) = taken_apart(frame)
    assert not dropped
    assert back[:1] + back[2:] == (kind, (3, 1), 5, 2)
    kind.unpack(back.payload)


def test_a_field_that_a_message_has_not_is_an_error():
    with pytest.raises(KeyError, match="HEARTBEAT has no colour"):
        packed(HEARTBEAT, colour=1)


def test_characters_end_at_the_first_nul_or_at_the_last_byte():
    assert PARAM_SET.unpack(whole(packed(PARAM_SET, param_id=b"A\0B")))["param_id"] == b"A"
    full = b"SIXTEEN_CHARS_ID"
    assert PARAM_SET.unpack(whole(packed(PARAM_SET, param_id=full)))["param_id"] == full


# --- datagrams


@pytest.mark.parametrize("length", [1, 20, 28, 33, 40, 255])
def test_payloads_may_be_trimmed_whole_or_longer(length):
    # trimmed, with zeros that need not be there, and of a newer dialect
    message = packed(COMMAND_LONG, command=400, target_system=3, param1=1.0)
    trimmed = message.payload.rstrip(b"\0")
    payload = (trimmed + bytes(300))[: max(length, len(trimmed))]
    ((frame,), dropped) = taken_apart(framed(*Packed(COMMAND_LONG, payload), 0, 245, 190))
    assert COMMAND_LONG.unpack(frame.payload)["command"] == 400
    assert not dropped


def test_a_payload_of_no_bytes_is_all_zeros():
    ((frame,), dropped) = taken_apart(framed(*Packed(HEARTBEAT, b""), 0, 245, 190))
    assert frame.payload == bytes(9)
    assert not dropped


def test_compatible_flags_do_not_matter_and_incompatible_ones_do():
    good = framed(*heartbeat(), 0, 245, 190)
    for at, value, kept in ((3, 0xFF, 1), (2, 2, 0), (2, 0x80, 0)):
        raw = bytearray(good[:-2])
        raw[at] = value
        crc = mavlink.x25crc(bytes(raw[1:]) + HEARTBEAT.crc_extra).crc
        found, dropped = taken_apart(bytes(raw) + struct.pack("<H", crc))
        assert len(found) == kept
        assert dropped == ({} if kept else {"unknown flags": 1})


def test_a_signed_frame_is_read_and_its_signature_passed_over():
    link = mavlink.MAVLink(None, 245, 190)
    link.signing.secret_key, link.signing.sign_outgoing = b"k" * 32, True
    signed = mavlink.MAVLink_heartbeat_message(14, 12, 0, 7, 0, 3).pack(link)
    assert len(signed) == 12 + 9 + 13
    found, dropped = taken_apart(signed + framed(*heartbeat(), 0, 245, 190))
    assert len(found) == 2
    assert taken_apart(signed[:-1]) == ([], {"truncated": 1})


def test_mavlink_1_is_read_unless_it_is_switched_off():
    message = mavlink.MAVLink_command_long_message(3, 1, 400, 0, 1.0, *[0.0] * 6)
    link = mavlink.MAVLink(None, 245, 190)
    link.seq = 9
    old = message.pack(link, force_mavlink1=True)
    ((frame,), dropped) = taken_apart(old)
    assert frame[2:] == ((245, 190), 9, 1)
    assert frame.definition.unpack(frame.payload)["param1"] == 1.0
    assert not dropped
    assert taken_apart(old, v1=False) == ([], {"MAVLink 1": 1})


def test_a_wrong_crc_extra_is_a_wrong_checksum():
    other = HEARTBEAT._replace(crc_extra=b"\x33")
    found, dropped = taken_apart(framed(*Packed(other, heartbeat().payload), 0, 245, 190))
    assert (found, dropped) == ([], {"wrong checksum": 1})


@pytest.mark.parametrize("good", [True, False])
def test_an_unknown_message_is_passed_over_whatever_its_checksum(good):
    unknown = framed(*packed(declared("FAR", 0x123456, "uint8_t seq"), seq=1), 0, 245, 190)
    damaged = unknown if good else unknown[:-1] + bytes([unknown[-1] ^ 1])
    found, dropped = taken_apart(damaged + framed(*heartbeat(), 0, 245, 190))
    assert [f.definition for f in found] == [HEARTBEAT]
    assert dropped == {"unknown message": 1}


def test_after_bytes_that_are_no_frame_the_rest_is_dropped():
    good = framed(*heartbeat(), 0, 245, 190)
    found, dropped = taken_apart(good + b"?" + good)
    assert len(found) == 1
    assert dropped == {"not MAVLink": 1}


def test_of_many_frames_the_first_are_read():
    good = framed(*heartbeat(), 0, 245, 190)
    found, dropped = taken_apart(17 * good)
    assert (len(found), dropped) == (16, {"over budget": 1})
    found, dropped = taken_apart(100 * good, at_once=100)
    assert (len(found), dropped) == (100, {})
    # bad ones count too: each has cost its time
    damaged = good[:-1] + bytes([good[-1] ^ 1])
    assert taken_apart(20 * damaged) == ([], {"wrong checksum": 16, "over budget": 1})


def test_half_a_frame_is_dropped_wherever_it_ends():
    good = framed(*heartbeat(), 0, 245, 190)
    for length in range(1, len(good)):
        assert taken_apart(good[:length]) == ([], {"truncated": 1})
        (_, dropped) = taken_apart(good[length:])
        assert sum(dropped.values()) == 1
