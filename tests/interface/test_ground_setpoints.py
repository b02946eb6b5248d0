"""Position setpoints: sent, judged, echoed."""

from __future__ import annotations

import math
import struct

import numpy as np
import pymavlink.dialects.v20.common as mavlink
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fcu.interface import frames
from fcu.interface.ground_fields import setpoint_numbers
from fcu.interface.ground_messages import (
    IGNORE_ACCELERATION,
    IGNORE_POSITION,
    IGNORE_VELOCITY,
    IGNORE_YAW,
    IGNORE_YAW_RATE,
    Source,
)
from fcu.interface.ground_wire import GroundCodec
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import to_buffer

FCU = Source(3, 1)
SCRIPT = Source(245, 190)

anything = st.floats(allow_nan=False)
vectors = st.builds(Vec3, anything, anything, anything)
setpoints = st.builds(Setpoint, vectors, vectors, vectors, st.floats(-20.0, 20.0), anything)


@pytest.fixture
def fcu():
    return GroundCodec(*FCU)


@pytest.fixture
def script():
    return GroundCodec(*SCRIPT)


def read(datagram):
    """The messages of a datagram, by pymavlink."""
    return mavlink.MAVLink(None).parse_buffer(bytearray(datagram))


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


@given(setpoints)
def test_setpoint_over_the_wire_is_the_kernels_to_the_bit(setpoint):
    (message,) = GroundCodec(*FCU).parse(GroundCodec(*SCRIPT).pack_setpoint(FCU, 1.0, setpoint))
    expected = to_buffer(frames.setpoint_through_the_wire(setpoint))
    assert to_buffer(message.setpoint).tobytes() == expected.tobytes()
    assert (message.source, message.time_boot_ms, message.frame) == (SCRIPT, 1000, 1)
    assert message.refusal == ""


@given(setpoints, st.sampled_from([0, 2552, 3072, 3576]))
def test_the_echo_repeats_the_setpoint_to_the_bit(setpoint, mask):
    fcu, script = GroundCodec(*FCU), GroundCodec(*SCRIPT)
    datagram = script.pack_setpoint(FCU, 1.0, setpoint, mask)
    (message,) = fcu.parse(datagram)
    echo_datagram = fcu.pack_position_target(7.0, message.numbers, message.type_mask)
    (echo,) = script.parse(echo_datagram)
    assert (echo.source, echo.time_boot_ms, echo.type_mask, echo.frame) == (FCU, 7000, mask, 1)
    assert echo.numbers == message.numbers == setpoint_numbers(setpoint)
    assert to_buffer(echo.setpoint).tobytes() == to_buffer(message.setpoint).tobytes()
    (raw,), (raw_echo,) = read(datagram), read(echo_datagram)
    for field in raw_echo.get_fieldnames():
        if field != "time_boot_ms":
            assert getattr(raw_echo, field) == getattr(raw, field)


def test_setpoint_bytes_are_pymavlinks(script):
    setpoint = Setpoint(
        Vec3(1.0, 2.0, 3.0), Vec3(4.0, 5.0, 6.0), Vec3(7.0, 8.0, 9.0), math.pi / 2, 0.5
    )
    datagram = script.pack_setpoint(FCU, 0.005, setpoint, 0)
    ned = (2.0, 1.0, -3.0, 5.0, 4.0, -6.0, 8.0, 7.0, -9.0, 0.0, -0.5)
    assert struct.unpack_from("<I11f", datagram, 10) == (5, *ned)
    message = mavlink.MAVLink_set_position_target_local_ned_message(5, *FCU, 1, 0, *ned)
    assert datagram == sent(message)


def test_a_yaw_east_of_north_by_a_right_angle_faces_east(fcu):
    (message,) = fcu.parse(sent(position_target(yaw=math.pi / 2)))
    assert message.setpoint.psi_c == pytest.approx(0.0, abs=1e-7)


def test_what_a_setpoint_ignores_is_still_or_left_to_the_receiver(fcu):
    position_only = IGNORE_VELOCITY | IGNORE_ACCELERATION | IGNORE_YAW | IGNORE_YAW_RATE
    assert position_only == 3576
    (message,) = fcu.parse(sent(position_target(position_only, vx=math.nan, yaw=math.nan)))
    still = (0.0, 0.0, 0.0)
    assert message.setpoint[:3] == ((0.5, 0.5, -0.5), still, still)
    assert math.isnan(message.setpoint.psi_c)
    assert message.setpoint.psi_dot_c == 0.0
    assert message.refusal == ""
    assert message.ignores(IGNORE_YAW)
    assert not message.ignores(IGNORE_POSITION)
    (velocity,) = fcu.parse(sent(position_target(IGNORE_POSITION)))
    assert np.isnan(velocity.setpoint.r_c).all()


@pytest.mark.parametrize(
    ("mask", "frame", "fields", "reason"),
    [
        (512, 1, {}, "force"),
        (0, 8, {}, "frame 8"),
        (0x1000, 1, {}, "unknown bits"),
        (1, 1, {}, "part of its position"),
        (16, 1, {}, "part of its velocity"),
        (64 | 128, 1, {}, "part of its acceleration"),
        (0, 1, {"y": math.nan}, "position is not finite"),
        (IGNORE_POSITION, 1, {"vz": math.inf}, "velocity is not finite"),
        (IGNORE_VELOCITY, 1, {"afx": -math.inf}, "acceleration is not finite"),
        (0, 1, {"yaw": math.nan}, "yaw is not finite"),
        (IGNORE_YAW, 1, {"yaw_rate": math.nan}, "yaw rate is not finite"),
    ],
)
def test_a_setpoint_that_must_not_be_flown_says_why(fcu, mask, frame, fields, reason):
    (message,) = fcu.parse(sent(position_target(mask, frame, **fields)))
    assert reason in message.refusal
