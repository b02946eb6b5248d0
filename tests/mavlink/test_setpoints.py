"""Setpoints: sent, turned to the frames inside, judged, echoed."""

from __future__ import annotations

import math
import struct

import numpy as np
import pymavlink.dialects.v20.common as mavlink
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fcu.interface.messages import PositionRequest, Setpoint
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import to_buffer
from fcu.mavlink import setpoints as wire
from fcu.mavlink.definitions import (
    IGNORE_ACCELERATION,
    IGNORE_POSITION,
    IGNORE_VELOCITY,
    IGNORE_YAW,
    IGNORE_YAW_RATE,
    Frame,
)
from fcu.mavlink.geodesy import Geodetic
from fcu.mavlink.ground_link import GroundCodec
from fcu.mavlink.setpoints import (
    FARTHEST,
    FASTEST,
    HARDEST,
    SPINNIEST,
    echo,
    setpoint_of,
    setpoint_through_the_wire,
    target_of,
)
from tests.mavlink.script import FCU, SCRIPT, heard, read, sent

EAST = math.pi / 2  # clockwise from North
NAMES = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
NOWHERE = (math.nan,) * 3
STILL = (0.0, 0.0, 0.0)

anything = st.floats(allow_nan=False)
vectors = st.builds(Vec3, anything, anything, anything)
setpoints = st.builds(Setpoint, vectors, vectors, vectors, st.floats(-20.0, 20.0), anything)


def local(mask=0, frame=1, **fields):
    values = dict.fromkeys(NAMES, 0.5) | fields
    return mavlink.MAVLink_set_position_target_local_ned_message(
        5, *FCU, frame, mask, *values.values()
    )


def globally(mask=0, frame=6, lat=473977420, lon=-85455940, alt=12.5, **fields):
    values = dict.fromkeys(NAMES[3:], 0.5) | fields
    return mavlink.MAVLink_set_position_target_global_int_message(
        5, *FCU, frame, mask, lat, lon, alt, *values.values()
    )


# --- to the bit


@given(setpoints)
def test_a_setpoint_over_the_wire_is_what_is_foretold_to_the_bit(setpoint):
    message = heard(wire.setpoint(FCU, 1.0, setpoint))
    expected = to_buffer(setpoint_through_the_wire(setpoint))
    assert to_buffer(setpoint_of(message.target)).tobytes() == expected.tobytes()
    r, v, a, psi, psi_dot = setpoint_of(message.target)[:5]
    assert message.request == PositionRequest(r, v, a, psi, psi_dot)
    assert (message.source, message.time_boot_ms, message.frame) == (SCRIPT, 1000, 1)


@given(setpoints, st.sampled_from([0, 2552, 3072, 3576]))
def test_the_echo_repeats_the_setpoint_to_the_bit(setpoint, mask):
    ask = wire.setpoint(FCU, 1.0, setpoint, mask)
    message = heard(ask)
    answer = GroundCodec(*FCU).framed(echo(7.0, message))
    (back,) = GroundCodec(*SCRIPT).parse(answer)
    assert (back.source, back.time_boot_ms, back.type_mask, back.frame) == (FCU, 7000, mask, 1)
    assert back.echoes(ask)
    assert back.target == message.target
    other = setpoint._replace(psi_dot_c=1.0 if setpoint.psi_dot_c != 1.0 else 2.0)
    assert not back.echoes(wire.setpoint(FCU, 1.0, other, mask)) or setpoint.psi_dot_c > 1e38
    (raw,), (raw_back,) = read(GroundCodec(*SCRIPT).framed(ask)), read(answer)
    for field in raw_back.get_fieldnames():
        if field != "time_boot_ms":
            assert getattr(raw_back, field) == getattr(raw, field)


@pytest.mark.parametrize("frame", [0, 3, 5, 6])
@pytest.mark.parametrize("lat", [473977420, 473977421, -899999999, 1])
def test_the_echo_of_a_place_repeats_it_to_the_bit(frame, lat):
    (raw,) = read(sent(globally(2048, frame, lat)))
    (back,) = read(GroundCodec(*FCU).framed(echo(7.0, heard(globally(2048, frame, lat)))))
    assert back.get_type() == "POSITION_TARGET_GLOBAL_INT"
    for field in back.get_fieldnames():
        if field != "time_boot_ms":
            assert getattr(back, field) == getattr(raw, field)


def test_a_setpoints_bytes_are_pymavlinks():
    setpoint = Setpoint(
        Vec3(1.0, 2.0, 3.0), Vec3(4.0, 5.0, 6.0), Vec3(7.0, 8.0, 9.0), math.pi / 2, 0.5
    )
    datagram = GroundCodec(*SCRIPT).framed(wire.setpoint(FCU, 0.005, setpoint))
    ned = (2.0, 1.0, -3.0, 5.0, 4.0, -6.0, 8.0, 7.0, -9.0, 0.0, -0.5)
    assert struct.unpack_from("<I11f", datagram, 10) == (5, *ned)
    message = mavlink.MAVLink_set_position_target_local_ned_message(5, *FCU, 1, 0, *ned)
    assert datagram == sent(message)
    place = Geodetic(47.397742, -8.545594, 12.5)
    datagram = GroundCodec(*SCRIPT).framed(wire.setpoint_global(FCU, 0.005, 6, place, setpoint))
    message = mavlink.MAVLink_set_position_target_global_int_message(
        5, *FCU, 6, 0, 473977420, -85455940, 12.5, *ned[3:]
    )
    assert datagram == sent(message)


def test_a_moving_setpoint_keeps_its_directions():
    asked = Setpoint(
        Vec3(1.0, 2.0, 3.0), Vec3(4.0, 5.0, 6.0), Vec3(7.0, 8.0, 9.0), math.radians(30.0), 0.5
    )
    target = target_of(asked)
    assert target[:9] == (2.0, 1.0, -3.0, 5.0, 4.0, -6.0, 8.0, 7.0, -9.0)
    assert target.yaw == pytest.approx(math.radians(60.0))
    assert target.yaw_rate == -0.5
    received = setpoint_through_the_wire(asked)
    assert received[:3] == asked[:3]
    assert received[3:5] == pytest.approx(asked[3:5])
    assert received[5:] == asked[5:]  # and enters the cascade at its position


# --- frames

GIVEN = dict(zip(NAMES, (1.0, 2.0, -3.0, 4.0, 5.0, -6.0, 7.0, 8.0, -9.0, EAST, 0.5), strict=True))
ENU = ((2.0, 1.0, 3.0), (5.0, 4.0, 6.0), (8.0, 7.0, 9.0))  # of north, east, down
FLU = ((1.0, -2.0, 3.0), (4.0, -5.0, 6.0), (7.0, -8.0, 9.0))  # of forward, right, down


@pytest.mark.parametrize(
    ("frame", "r", "v", "a", "yaw"),
    [
        (Frame.LOCAL_NED, *ENU, 0.0),
        (Frame.LOCAL_OFFSET_NED, *ENU, 0.0),
        (Frame.BODY_NED, ENU[0], *FLU[1:], 0.0),  # a place in NED, flown along the heading
        (Frame.BODY_OFFSET_NED, *FLU, -EAST),  # to the right of the nose
        (Frame.BODY_FRD, *FLU, -EAST),
    ],
)
def test_a_setpoint_has_the_axes_of_its_frame(frame, r, v, a, yaw):
    message = heard(local(0, frame, **GIVEN))
    assert message.refusal is None
    assert message.geodetic is None
    asked = message.request
    assert (asked.r, asked.v, asked.a) == (r, v, a)
    assert asked.psi == pytest.approx(yaw, abs=1e-7)  # counter-clockwise from East
    assert asked.psi_dot == -0.5
    assert (asked.along_heading, asked.from_here) == (frame >= 8, frame in (7, 9, 12))


@pytest.mark.parametrize("frame", [0, 3, 5, 6])
def test_a_global_setpoint_has_a_place_and_moves_in_east_north_up(frame):
    message = heard(globally(0, frame, **{n: GIVEN[n] for n in NAMES[3:]}))
    assert message.refusal is None
    assert message.geodetic == pytest.approx((47.397742, -8.545594, 12.5), abs=1e-12)
    asked = message.request
    assert (asked.r, asked.v, asked.a) == (None, *ENU[1:])
    assert asked.psi == pytest.approx(0.0, abs=1e-7)
    assert asked.psi_dot == -0.5


# --- masks


def test_what_a_setpoint_ignores_is_still_or_left_to_the_receiver():
    position_only = IGNORE_VELOCITY | IGNORE_ACCELERATION | IGNORE_YAW | IGNORE_YAW_RATE
    assert position_only == 3576
    message = heard(local(position_only, vx=math.nan, yaw=math.nan))
    assert message.request == PositionRequest((0.5, 0.5, -0.5), None, None, None, 0.0)
    assert message.refusal is None


@pytest.mark.parametrize("frame", [1, 7, 8, 9, 12])
@pytest.mark.parametrize(
    ("mask", "fields"),
    [
        (3576, ("x", "y", "z")),
        (2552, ("x", "y", "z", "yaw")),
        (3527, ("vx", "vy", "vz")),
        (1479, ("vx", "vy", "vz", "yaw_rate")),
        (3135, ("afx", "afy", "afz")),
        (3520, NAMES[:6]),
        (3072, NAMES[:9]),
        (2559, ("yaw",)),
        (1535, ("yaw_rate",)),
    ],
)
def test_of_the_masks_in_use_each_takes_what_it_says_and_no_more(frame, mask, fields):
    ignored = {name: math.nan for name in NAMES if name not in fields}
    message = heard(local(mask, frame, **ignored))
    assert message.refusal is None
    asked = message.request
    assert (asked.r is not None) == ("x" in fields)
    assert (asked.v is not None) == ("vx" in fields)
    assert (asked.a is not None) == ("afx" in fields)
    assert (asked.psi is not None) == ("yaw" in fields)
    assert bool(asked.psi_dot) == ("yaw_rate" in fields)
    bits = {name: 1 << n for name, n in zip(NAMES, (*range(9), 10, 11), strict=True)}
    for name in fields:  # no number is as good as masked
        message = heard(local(mask, frame, **{name: math.nan}))
        assert message.type_mask == mask | bits[name]
        assert message.refusal in (None, Told(Code.COMMANDS_NOTHING))


@pytest.mark.parametrize("mask", [0xFC7, 0xFF8])
def test_the_masks_of_dronekit_and_mavproxy_are_flown(mask):
    """They set the force bit with the acceleration that they ignore."""
    message = heard(local(mask, 1, x=1.0, vx=2.0))
    assert not message.refusal


@pytest.mark.parametrize(
    ("mask", "frame", "fields", "reason"),
    [
        (512, 1, {}, (Code.FORCE,)),
        (0xC3F | 512, 1, {}, (Code.FORCE,)),
        (0, 2, {}, (Code.FRAME_UNSUPPORTED, (2,))),
        (0, 200, {}, (Code.FRAME_UNSUPPORTED, (200,))),
        (0, 6, {}, (Code.FRAME_NOT_LOCAL, (6,))),
        (0x1000, 1, {}, (Code.MASK_BITS, (0x1000,))),
        (3583, 1, {}, (Code.COMMANDS_NOTHING,)),
        (1, 1, {"z": math.inf}, (Code.NOT_FINITE, ("position",))),
        (16, 1, {"vx": math.inf}, (Code.NOT_FINITE, ("velocity",))),
        (64 | 128, 1, {"afz": math.inf}, (Code.NOT_FINITE, ("acceleration",))),
        (16, 1, {"vz": 1.01 * FASTEST}, (Code.ABOVE_LIMIT, ("velocity", 100, "m/s"))),
        (0, 1, {"y": math.inf}, (Code.NOT_FINITE, ("position",))),
        (IGNORE_POSITION, 1, {"vz": math.inf}, (Code.NOT_FINITE, ("velocity",))),
        (IGNORE_VELOCITY, 1, {"afx": -math.inf}, (Code.NOT_FINITE, ("acceleration",))),
        (0, 1, {"yaw": math.inf}, (Code.NOT_FINITE, ("yaw",))),
        (IGNORE_YAW, 1, {"yaw_rate": math.inf}, (Code.NOT_FINITE, ("yaw rate",))),
        (0, 1, {"x": 1e9}, (Code.ABOVE_LIMIT, ("position", 100000, "m"))),
        (0, 7, {"z": -1.01 * FARTHEST}, (Code.ABOVE_LIMIT, ("position", 100000, "m"))),
        (0, 1, {"vy": -1.01 * FASTEST}, (Code.ABOVE_LIMIT, ("velocity", 100, "m/s"))),
        (0, 12, {"afz": 1.01 * HARDEST}, (Code.ABOVE_LIMIT, ("acceleration", 100, "m/s^2"))),
        (0, 1, {"yaw_rate": -1.01 * SPINNIEST}, (Code.ABOVE_LIMIT, ("yaw rate", 10, "rad/s"))),
    ],
)
def test_a_setpoint_that_must_not_be_flown_says_why(mask, frame, fields, reason):
    assert heard(local(mask, frame, **fields)).refusal == Told(*reason)


@pytest.mark.parametrize(
    ("mask", "frame", "fields", "reason"),
    [
        (0, 1, {}, (Code.FRAME_NOT_GLOBAL, (1,))),
        (0, 13, {}, (Code.FRAME_UNSUPPORTED, (13,))),
        (0, 6, {"lat": 900000001}, (Code.OFF_EARTH,)),
        (0, 6, {"lat": -(2**31)}, (Code.OFF_EARTH,)),
        (0, 6, {"lon": 1800000001}, (Code.OFF_EARTH,)),
        (0, 6, {"alt": math.inf}, (Code.HEIGHT_RANGE, (FARTHEST,))),
        (0, 6, {"alt": -1.01 * FARTHEST}, (Code.HEIGHT_RANGE, (FARTHEST,))),
        (0, 6, {"vx": math.inf}, (Code.NOT_FINITE, ("velocity",))),
        (1, 6, {}, (Code.PARTLY_IGNORED, ("latitude and longitude",))),
        (3, 6, {"alt": math.inf}, (Code.HEIGHT_RANGE, (FARTHEST,))),
        (4, 6, {"lat": 900000001}, (Code.OFF_EARTH,)),
    ],
)
def test_a_global_setpoint_that_must_not_be_flown_says_why(mask, frame, fields, reason):
    assert heard(globally(mask, frame, **fields)).refusal == Told(*reason)


@pytest.mark.parametrize("bit", range(9))
def test_each_axis_may_be_left_out_by_itself(bit):
    """Bits and fields in the order x, y, z: north, east, down."""
    fields = dict(
        zip(("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz"), range(1, 10), strict=True)
    )
    name = list(fields)[bit]
    message = heard(local(1 << bit, 1, **{**fields, name: math.nan}))
    assert message.refusal is None
    north, east, down = (np.array([fields[f"{p}{c}"] for p in ("", "v", "af")]) for c in "xyz")
    told = np.array([message.request.r, message.request.v, message.request.a])
    expected = np.stack([east, north, -down], axis=1).astype(float)
    expected[bit // 3, (1, 0, 2)[bit % 3]] = math.nan
    np.testing.assert_array_equal(told, expected)


@pytest.mark.parametrize("frame", [0, 6])
def test_a_global_setpoint_without_its_place_needs_none(frame):
    message = heard(globally(IGNORE_POSITION, frame, lat=2**31 - 1, alt=math.nan))
    assert message.refusal is None
    assert message.request.v == (0.5, 0.5, -0.5)


@given(setpoints, st.integers(0, 2**16 - 1), st.integers(0, 255))
def test_no_setpoint_raises_and_an_accepted_one_is_finite_where_it_is_used(setpoint, mask, frame):
    message = heard(wire.setpoint(FCU, 1.0, setpoint, mask))
    assert message.type_mask == mask
    place = Geodetic(setpoint.r_c.x, setpoint.r_c.y, setpoint.r_c.z)
    other = heard(wire.setpoint_global(FCU, 1.0, frame, place, setpoint, mask))
    for accepted in (m.request for m in (message, other) if not m.refusal):
        used = (each for each in (accepted.r, accepted.v, accepted.a) if each is not None)
        numbers = np.array([x for each in used for x in each])
        assert np.isfinite(numbers[~np.isnan(numbers)]).all()  # NaN: an axis that is left out
        assert accepted.psi is None or math.isfinite(accepted.psi)


def test_each_field_of_a_target_is_of_one_group():
    """Groups follow each other, and none reaches beyond the fields that there are."""
    taken = [n for _, where, *_ in wire._GROUPS.values() for n in range(where.start, where.stop)]
    assert taken == list(range(len(wire.Target._fields)))
