"""A parameter in the field of a float: as PX4 and as ArduPilot send an INT32."""

from __future__ import annotations

import math
import struct
from types import SimpleNamespace

import pymavlink.dialects.v20.common as mavlink
import pytest
from pymavlink.mavparm import MAVParmDict

from fcu.mavlink import parameter_values, replies
from fcu.mavlink.framing import Source, framed
from fcu.mavlink.ground_link import GroundCodec

INT32, REAL32 = mavlink.MAV_PARAM_TYPE_INT32, mavlink.MAV_PARAM_TYPE_REAL32
WHOLE = [0, 1, 7, 4001, 2**23, 9999999, 2**29 - 1, -1, -7, -4001]


def of_bytes(number):
    return struct.unpack("<f", struct.pack("<i", number))[0]


@pytest.mark.parametrize("number", WHOLE)
def test_an_integer_is_read_in_either_encoding(number):
    assert parameter_values.read(of_bytes(number), INT32) == number
    assert parameter_values.read(float(number), INT32) == number


@pytest.mark.parametrize("value", [0.0, 0.25, -3.5, 1e-40, math.inf])
def test_a_real_number_is_what_it_is(value):
    assert parameter_values.read(value, REAL32) == value


@pytest.mark.parametrize("number", [*range(8), 4001, 9999999, -7])
def test_an_integer_is_sent_by_its_bytes(number):
    packed = replies.param_value("SYS_AUTOSTART", float(number), 0, 1, integer=True)
    (theirs,) = mavlink.MAVLink(None).parse_buffer(framed(*packed, 0, 1, 1))
    payload = bytes(theirs.get_msgbuf())[10:]
    sent = payload[:4].ljust(4, b"\0")
    assert struct.unpack("<i", sent)[0] == number


class Connection:
    """Of a mavutil connection what `MAVParmDict.mavset` needs: it keeps the bytes."""

    def __init__(self):
        self.sent = b""

    def param_set_send(self, name, value, parm_type):
        message = mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, parm_type)
        self.sent = message.pack(mavlink.MAVLink(None, 255, 230))

    def recv_match(self, **_):
        return SimpleNamespace(param_id="COM_OBL_RC_ACT")


@pytest.mark.parametrize("number", [0, 3, 4, 7])
def test_an_integer_that_pymavlink_sets_is_read(number):
    connection = Connection()
    assert MAVParmDict().mavset(connection, "COM_OBL_RC_ACT", number, parm_type=INT32)
    (read,) = GroundCodec(1).parse(connection.sent)
    assert (read.value, read.type) == (number, INT32)


def test_our_own_tools_read_an_integer_as_a_number():
    packed = replies.param_value("COM_OBL_RC_ACT", 7.0, 0, 1, integer=True)
    (back,) = GroundCodec(255, 190).parse(GroundCodec(*Source(1, 1)).framed(packed))
    assert (back.value, back.type) == (7.0, INT32)
