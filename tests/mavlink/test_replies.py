"""Answers of the flight controller, read by pymavlink: each field as the standard has it."""

from __future__ import annotations

import inspect
import struct

import pymavlink.dialects.v20.all as mavlink
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fcu.mavlink import plan_messages, replies
from fcu.mavlink.definitions import Packed, Result, Severity
from fcu.mavlink.framing import Source, framed
from fcu.mavlink.plan_messages import PlanItem

SCRIPT = Source(245, 190)


def read(*messages):
    """The messages, by pymavlink."""
    raw = b"".join(framed(*message, 0, 3, 1) for message in messages)
    return mavlink.MAVLink(None).parse_buffer(bytearray(raw))


def fields(m, *names):
    return tuple(getattr(m, name) for name in names)


ADDRESSED = ("target_system", "target_component")
CASES = [  # a message, and its fields
    (
        replies.command_ack(400, Result.IN_PROGRESS, SCRIPT, 40),
        {"command": 400, "result": 5, "progress": 40, "result_param2": 0},
    ),
    (replies.command_ack(400, Result.DENIED, SCRIPT), {"result": 2, "progress": 255}),
    (
        replies.param_value("SIXTEEN_CHARS_ID", 0.25, 3, 40),
        {"param_id": "SIXTEEN_CHARS_ID", "param_value": 0.25, "param_type": 9, "param_index": 3,
         "param_count": 40},
    ),
    (
        replies.param_value("COM_OBL_RC_ACT", 4.0, 3, 40, integer=True),
        {"param_value": struct.unpack("<f", struct.pack("<i", 4))[0], "param_type": 6},
    ),
    (
        replies.param_error(SCRIPT, "NO\N{BULLET}NE", -1, 1),
        {"param_id": "NO?NE", "param_index": -1, "error": 1},
    ),
    (
        replies.current_mode(1, 3 << 16, 4 << 16),
        {"standard_mode": 1, "custom_mode": 3 << 16, "intended_custom_mode": 4 << 16},
    ),
    (
        replies.available_modes(9, 2, 8, 4 << 16 | 2 << 24, 4, "Takeoff"),
        {"number_modes": 9, "mode_index": 2, "standard_mode": 8,
         "custom_mode": 4 << 16 | 2 << 24, "properties": 4, "mode_name": "Takeoff"},
    ),
    (replies.available_modes_monitor(7), {"seq": 7}),
    (replies.message_interval(30, -1), {"message_id": 30, "interval_us": -1}),
    (
        replies.timesync(2**60 + 1, 2**61 + 1, SCRIPT),
        {"tc1": 2**60 + 1, "ts1": 2**61 + 1},
    ),
    (replies.ping(2**60 + 1, 77, SCRIPT), {"time_usec": 2**60 + 1, "seq": 77}),
    (plan_messages.count(0, 2, SCRIPT), {"count": 0, "mission_type": 2}),
    (plan_messages.ack(3, 1, SCRIPT), {"type": 3, "mission_type": 1}),
    (
        plan_messages.item(
            PlanItem(6, 16, (1.0, 2.0, 3.0, 4.0), 5, -6, 7.0), 9, 0, SCRIPT, True, False
        ),
        {"seq": 9, "frame": 6, "command": 16, "current": 0, "autocontinue": 1, "param1": 1.0,
         "param2": 2.0, "param3": 3.0, "param4": 4.0, "x": 5, "y": -6, "z": 7.0},
    ),
    (
        plan_messages.item(
            PlanItem(3, 16, (0.0, 0.0, 0.0, 0.0), 455_000_000, -65_000_000, 7.0), 9, 0, SCRIPT,
            False, True,
        ),
        {"seq": 9, "frame": 3, "current": 1, "x": 45.5, "y": -6.5, "z": 7.0},
    ),
    (plan_messages.current(2, 5, 3, True, (0, 0, 0)), {"seq": 2, "total": 5, "mission_state": 3, "mission_mode": 1}),
    (plan_messages.reached(3), {"seq": 3}),
    (replies.log_entry(), {"id": 0, "num_logs": 0, "last_log_num": 0, "size": 0}),
    (replies.log_data(3, 900), {"id": 3, "ofs": 900, "count": 0}),
    (
        replies.serial_control(10, "no\n", SCRIPT),
        {"device": 10, "flags": 1, "count": 3, "data": [*b"no\n", *[0] * 67]},
    ),
    (
        replies.no_extended_value("CAM_MODE"),
        {"param_id": "CAM_MODE", "param_value": "", "param_count": 0, "param_index": 65535},
    ),
    (
        replies.extended_refused("CAM_MODE", b"\2", 1),
        {"param_id": "CAM_MODE", "param_value": "\2", "param_type": 1, "param_result": 1},
    ),
    (
        replies.file_transfer(bytes(range(251)), SCRIPT),
        {"payload": list(range(251)), "target_network": 0},
    ),
    (
        replies.autopilot_version(8 | 8192, 0x01020304, 0xFF, b"\1\2\3\4\5\6\7\10", 2**63 + 1),
        {"capabilities": 8 | 8192, "flight_sw_version": 0x01020304, "middleware_sw_version": 0xFF,
         "flight_custom_version": [1, 2, 3, 4, 5, 6, 7, 8], "uid": 2**63 + 1},
    ),
]  # fmt: skip


@pytest.mark.parametrize(
    ("message", "expected"), CASES, ids=lambda c: getattr(c, "definition", [""])[0]
)
def test_an_answer_is_as_the_standard_has_it(message, expected):
    (m,) = read(message)
    assert fields(m, *expected) == tuple(expected.values())
    for name, number in zip(ADDRESSED, SCRIPT, strict=True):
        assert getattr(m, name, number) == number


def test_protocol_version_is_mavlink_2_and_1():
    message = replies.protocol_version()  # of no dialect here: three uint16, the hashes unknown
    assert (message.definition.id, message.payload[:6]) == (300, bytes([200, 0, 100, 0, 200, 0]))


# --- texts


def test_text_is_one_message():
    (m,) = read(replies.status_text(Severity.WARNING, 50 * "x"))
    assert (m.text, m.severity, m.id, m.chunk_seq) == (50 * "x", 4, 0, 0)


def test_text_that_is_not_ascii_stays_readable():
    (m,) = read(replies.status_text(Severity.INFO, "wind 3 m/s²\0"))
    assert m.text == "wind 3 m/s??"


# --- whatever is asked


VALUES = {
    "bool": st.booleans(),
    "float": st.floats(),
    "int": st.integers(-(2**70), 2**70),
    "str": st.text(max_size=60),
    "bytes": st.binary(max_size=300),
    "Source": st.builds(Source, st.integers(0, 255), st.integers(0, 255)),
}
BUILDERS = [
    function
    for name, function in vars(replies).items()
    if inspect.isfunction(function)
    and function.__module__ == replies.__name__
    and not name.startswith("_")
    and name != "printable"
]


@pytest.mark.parametrize("build", BUILDERS, ids=lambda b: b.__name__)
@given(st.data())
@pytest.mark.computes
def test_no_answer_raises(build, data):
    parameters = inspect.signature(build).parameters.values()
    made = build(*[data.draw(VALUES[p.annotation]) for p in parameters])
    for message in [made] if isinstance(made, Packed) else made:
        assert len(framed(*message, 0, 3, 1)) <= 280
