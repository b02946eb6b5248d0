"""What a client sends, packed by pymavlink or by our own tools, as the flight controller reads it."""

from __future__ import annotations

import math

import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.kernel.algebra import Vec3
from fcu.kernel.rotations import from_euler
from fcu.mavlink import replies, requests
from fcu.mavlink import telemetry as tm
from fcu.mavlink.definitions import CommandId, Severity
from fcu.mavlink.framing import Source
from fcu.mavlink.geodesy import Geodetic
from fcu.mavlink.ground_link import GroundCodec
from fcu.mavlink.plan_messages import MissionMessage, PlanItem

FCU = Source(3, 1)
SCRIPT = Source(245, 190)
NAN = math.nan


def sent(message, source=SCRIPT):
    """A pymavlink message as the bytes of a sender."""
    return message.pack(mavlink.MAVLink(None, source.system, source.component))


def heard(datagram):
    """The message that the flight controller reads."""
    fcu = GroundCodec(*FCU)
    (message,) = fcu.parse(datagram)
    assert not fcu.dropped
    return message


def asked(message):
    """One of our own tools' messages, as the flight controller reads it and as its bytes."""
    datagram = GroundCodec(*SCRIPT).framed(message)
    return heard(datagram), datagram


def told(message):
    """One of the flight controller's messages, as our own tools read it."""
    (back,) = GroundCodec(*SCRIPT).parse(GroundCodec(*FCU).framed(message))
    return back


def make(name, *fields):
    return getattr(mavlink, f"MAVLink_{name}_message")(*fields)


@pytest.mark.parametrize(
    ("message", "read"),
    [
        (make("param_request_list", *FCU), requests.ParamRequestList(SCRIPT, *FCU)),
        (
            make("param_request_read", *FCU, b"MMRAC_GAMMA_V", -1),
            requests.ParamRequestRead(SCRIPT, *FCU, "MMRAC_GAMMA_V", -1),
        ),
        (
            make("param_request_read", *FCU, b"", 7),
            requests.ParamRequestRead(SCRIPT, *FCU, "", 7),
        ),
        (
            make("param_set", *FCU, b"SIXTEEN_CHARS_ID", 0.25, 9),
            requests.ParamSet(SCRIPT, *FCU, "SIXTEEN_CHARS_ID", 0.25, 9),
        ),
        (make("set_mode", 3, 1, 6 << 16), requests.SetMode(SCRIPT, 3, 1, 6 << 16)),
        (
            make("request_data_stream", *FCU, 6, 4, 1),
            requests.StreamRequest(SCRIPT, *FCU, 6, 4, True),
        ),
        (
            make("request_data_stream", *FCU, 6, 4, 0),
            requests.StreamRequest(SCRIPT, *FCU, 6, 4, False),
        ),
        (make("ping", 2**60 + 1, 9, 0, 0), requests.Ping(SCRIPT, 0, 2**60 + 1, 9)),
        (make("timesync", 0, -(2**60)), requests.TimeSync(SCRIPT, 0, -(2**60))),
        (
            make("manual_control", 3, 500, -1000, 250, 1, 0),
            requests.ManualControl(SCRIPT, 3, 0.5, -1.0, 0.25, 0.001),
        ),
        (
            make("manual_control", 3, 2000, -2000, -1000, 0, 0),
            requests.ManualControl(SCRIPT, 3, 1.0, -1.0, 0.0, 0.0),
        ),
        (
            make("file_transfer_protocol", 0, *FCU, list(range(251))),
            requests.FileTransfer(SCRIPT, *FCU, bytes(range(251))),
        ),
        (make("log_request_list", *FCU, 0, 0xFFFF), requests.LogRequestList(SCRIPT, *FCU)),
        (
            make("mission_request_list", *FCU, 1),
            MissionMessage(SCRIPT, *FCU, "REQUEST_LIST", 0, 0, 1),
        ),
        (make("mission_count", *FCU, 65535, 2), MissionMessage(SCRIPT, *FCU, "COUNT", 0, 65535, 2)),
        (
            make("mission_clear_all", *FCU, 255),
            MissionMessage(SCRIPT, *FCU, "CLEAR_ALL", 0, 0, 255),
        ),
        (make("mission_request", *FCU, 4, 0), MissionMessage(SCRIPT, *FCU, "REQUEST", 4, 0, 0)),
        (
            make("mission_request_int", *FCU, 4, 1),
            MissionMessage(SCRIPT, *FCU, "REQUEST_INT", 4, 0, 1),
        ),
        (
            make("mission_item", *FCU, 5, 3, 16, 2, 1, 1.0, 2.0, 3.0, 4.0, 47.5, -8.5, 9.0, 1),
            MissionMessage(
                SCRIPT,
                *FCU,
                "ITEM",
                5,
                0,
                1,
                0,
                PlanItem(3, 16, (1.0, 2.0, 3.0, 4.0), 475_000_000, -85_000_000, 9.0, True),
            ),
        ),
        (
            make("mission_item_int", *FCU, 5, 6, 16, 2, 0, 1.0, 2.0, 3.0, 4.0, 7, -8, 9.0, 0),
            MissionMessage(
                SCRIPT,
                *FCU,
                "ITEM_INT",
                5,
                0,
                0,
                0,
                PlanItem(6, 16, (1.0, 2.0, 3.0, 4.0), 7, -8, 9.0, False),
            ),
        ),
        (
            make("mission_set_current", *FCU, 6),
            MissionMessage(SCRIPT, *FCU, "SET_CURRENT", 6, 0, 0),
        ),
        (make("mission_ack", *FCU, 3, 1), MissionMessage(SCRIPT, *FCU, "ACK", 0, 0, 1, 3)),
        (
            make("mission_write_partial_list", *FCU, 2, 5, 1),
            MissionMessage(SCRIPT, *FCU, "WRITE_PARTIAL", 2, 5, 1),
        ),
        (
            make("command_ack", 400, 2, 255, 0, *FCU),
            replies.CommandAck(SCRIPT, *FCU, 400, 2, 255),
        ),
        (
            make("heartbeat", 6, 8, 0, 0, 4, 3),
            tm.Heartbeat(SCRIPT, 6, 8, False, 0, 0, 4),
        ),
    ],
    ids=lambda x: getattr(x, "msgname", ""),
)
def test_requests_are_read(message, read):
    assert heard(sent(message)) == read


@pytest.mark.parametrize("stick", ["x", "y", "z", "r"])
def test_a_stick_that_is_not_there_is_no_number(stick):
    sticks = dict.fromkeys("xyzr", 0) | {stick: 32767}
    message = heard(sent(make("manual_control", 3, *sticks.values(), 0)))
    assert {s for s in "xyzr" if math.isnan(getattr(message, s))} == {stick}


@pytest.mark.parametrize("raw", [b"", b"GAMMA\xff", b"\xc3\xa9", b"\0GAMMA"])
def test_a_name_that_no_parameter_has_matches_none(raw):
    message = make("param_set", *FCU, raw, 1.0, 9)
    message._param_id_raw = raw  # what pymavlink packs
    read = heard(sent(message))
    assert read.name == "" or not read.name.isascii()


# --- commands


def test_a_long_command_is_pymavlinks_and_is_read():
    command, datagram = asked(requests.command_long(FCU, CommandId.ARM_DISARM, (1.0, NAN), 2))
    assert datagram == sent(make("command_long", *FCU, 400, 2, 1.0, NAN, *[0.0] * 5))
    assert (command.source, command.command, command.frame, command.confirmation) == (
        SCRIPT, 400, None, 2,
    )  # fmt: skip
    assert command.params == pytest.approx((1.0, NAN, 0.0, 0.0, 0.0, 0.0, 0.0), nan_ok=True)


def test_a_command_has_seven_parameters():
    with pytest.raises(ValueError, match="seven"):
        requests.command_long(FCU, 400, [0.0] * 8)


@pytest.mark.parametrize(
    ("frame", "x", "y", "place"),
    [
        (6, 473977420, -85455940, (47.397742, -8.545594)),  # global: 1e-7 degrees
        (11, 473977420, -85455940, (47.397742, -8.545594)),
        (1, 125000, -5000, (12.5, -0.5)),  # local: 1e-4 m
        (6, 2**31 - 1, 2**31 - 1, (NAN, NAN)),  # unset
    ],
)
def test_integer_commands_are_read_in_degrees_and_metres(frame, x, y, place):
    command = heard(
        sent(make("command_int", *FCU, frame, 192, 0, 0, 1.0, 2.0, 3.0, NAN, x, y, 9.0))
    )
    assert (command.command, command.frame, command.confirmation) == (192, frame, 0)
    assert command.params == pytest.approx((1.0, 2.0, 3.0, NAN, *place, 9.0), nan_ok=True)


@pytest.mark.parametrize(
    ("frame", "place", "x", "y"),
    [
        (6, (47.397742, -8.545594), 473977420, -85455940),
        (1, (12.5, -0.5), 125000, -5000),
        (6, (NAN, NAN), 2**31 - 1, 2**31 - 1),
    ],
)
def test_an_integer_command_is_pymavlinks(frame, place, x, y):
    command, datagram = asked(
        requests.command_int(FCU, 192, frame, (1.0, 2.0, 3.0, 4.0, *place, 9.0))
    )
    assert datagram == sent(
        make("command_int", *FCU, frame, 192, 0, 0, 1.0, 2.0, 3.0, 4.0, x, y, 9.0)
    )
    assert command.params == pytest.approx((1.0, 2.0, 3.0, 4.0, *place, 9.0), nan_ok=True)


# --- what our own tools ask


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (tm.ground_heartbeat(), make("heartbeat", 6, 8, 0, 0, 4, 3)),
        (requests.param_request_list(FCU), make("param_request_list", *FCU)),
        (requests.param_request_read(FCU, "MASS"), make("param_request_read", *FCU, b"MASS", -1)),
        (requests.param_set(FCU, "MASS", 8.25), make("param_set", *FCU, b"MASS", 8.25, 9)),
    ],
)
def test_what_our_tools_ask_is_pymavlinks(ask, message):
    read, datagram = asked(ask)
    assert datagram == sent(message)
    assert read.source == SCRIPT


# --- what our own tools read


def test_telemetry_comes_back():
    r_E, v_E, w_B = Vec3(1.0, 2.0, 3.0), Vec3(4.0, 5.0, 6.0), Vec3(0.25, 0.5, 0.75)
    q_EB = from_euler(0.5, -0.25, 2.0)
    assert told(tm.heartbeat(14, 12, True, 4, 6, 4)) == tm.Heartbeat(FCU, 14, 12, True, 4, 6, 4)
    assert told(tm.local_position(2.0, r_E, v_E)) == tm.LocalPosition(FCU, 2000, r_E, v_E)
    assert told(tm.extended_state(2)) == tm.ExtendedState(FCU, 2)
    attitude = told(tm.attitude_quaternion(1.5, q_EB, w_B))
    assert attitude.q_EB == pytest.approx(q_EB, abs=1e-7)
    assert (attitude.source, attitude.time_boot_ms, attitude.w_B) == (FCU, 1500, w_B)


def test_places_come_back():
    place = Geodetic(47.397742, -8.545594, 489.4)
    message = told(tm.global_position(2.0, place, 12.5, Vec3(4.0, -5.0, 6.0), 2.0))
    assert message[:2] == (FCU, 2000)
    assert message.place == pytest.approx(place, abs=1e-9)
    assert (message.above_home, message.v_E) == (12.5, (4.0, -5.0, 6.0))
    assert message.psi == pytest.approx(2.0, abs=math.radians(0.005))
    assert math.isnan(told(tm.global_position(2.0, place, 0.0, Vec3(0.0, 0.0, 0.0), NAN)).psi)
    home = told(tm.home_position(place, Vec3(1.0, 2.0, 3.0)))
    assert home.place == pytest.approx(place, abs=1e-9)
    assert home.r_E == (1.0, 2.0, 3.0)


def test_answers_come_back():
    assert told(replies.command_ack(400, 2, SCRIPT)) == replies.CommandAck(
        FCU, *SCRIPT, 400, 2, 255
    )
    assert told(replies.param_value("MASS", 8.25, 3, 40)) == replies.ParamValue(
        FCU, "MASS", 8.25, 9, 3, 40
    )
    text = replies.status_text(Severity.WARNING, "Arming denied")
    assert told(text) == replies.StatusText(FCU, 4, "Arming denied", 0, 0)


# --- a codec a link


def test_each_link_counts_its_own_messages():
    one, other = GroundCodec(*FCU), GroundCodec(*FCU)
    message = tm.extended_state(1)
    assert [one.framed(message)[4] for _ in range(258)] == [*range(256), 0, 1]
    assert other.framed(message)[4] == 0
