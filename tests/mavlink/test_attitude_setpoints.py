"""Setpoints of attitude or body rates: sent, turned to the frames inside, judged, echoed."""

from __future__ import annotations

import math

import pymavlink.dialects.v20.common as mavlink
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Quat, Vec3
from fcu.kernel.rotations import from_euler
from fcu.mavlink.definitions import IGNORE_ATTITUDE
from fcu.mavlink.ground_link import GroundCodec
from fcu.mavlink.setpoints import attitude_setpoint, echo
from tests.mavlink.script import FCU, SCRIPT, heard, read, sent

NO_RATES = (math.nan,) * 3
NO_ATTITUDE = (math.nan,) * 4


LEVEL_EAST = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))  # FRD in NED


def attitude(mask=0, q=LEVEL_EAST, rates=(0.25, 0.5, 0.75), thrust=0.5):
    return mavlink.MAVLink_set_attitude_target_message(5, *FCU, mask, q, *rates, thrust)


def test_an_attitude_setpoint_is_turned_to_the_frames_inside():
    message = heard(attitude())
    assert (message.source, message.time_boot_ms, message.type_mask) == (SCRIPT, 5, 0)
    assert (message.target_system, message.target_component) == FCU
    assert message.q_EB == pytest.approx((1.0, 0.0, 0.0, 0.0), abs=1e-7)  # level, to the East
    assert message.w_B == (0.25, -0.5, -0.75)
    assert (message.thrust, message.refusal) == (0.5, None)


def test_an_attitude_setpoints_bytes_are_pymavlinks_and_its_echo_says_the_same():
    q_EB, w_B = from_euler(0.5, -0.25, 2.0), Vec3(0.25, 0.5, 0.75)
    ask = attitude_setpoint(FCU, 0.005, q_EB, w_B, 0.5, 7)
    (raw,) = read(GroundCodec(*SCRIPT).framed(ask))
    assert sent(attitude(7, raw.q, (0.25, -0.5, -0.75))) == GroundCodec(*SCRIPT).framed(ask)
    message = heard(ask)
    assert message.q_EB == pytest.approx(q_EB, abs=1e-7)
    (back,) = read(GroundCodec(*FCU).framed(echo(7.0, message)))
    assert back.get_type() == "ATTITUDE_TARGET"
    assert (back.time_boot_ms, back.type_mask, back.thrust) == (7000, 7, 0.5)
    assert back.q == pytest.approx(raw.q, abs=1e-7)
    assert (back.body_roll_rate, back.body_pitch_rate, back.body_yaw_rate) == (0.25, -0.5, -0.75)


@pytest.mark.parametrize(
    ("mask", "fields"),
    [
        (7, {"rates": NO_RATES}),  # attitude and thrust
        (IGNORE_ATTITUDE, {"q": NO_ATTITUDE}),  # body rates and thrust
        (IGNORE_ATTITUDE, {"q": (0.0, 0.0, 0.0, 0.0)}),
        (0, {"thrust": 0.0}),
        (0, {"thrust": 1.0}),
        (0, {"q": tuple(-1.0009 * x for x in LEVEL_EAST)}),  # nearly of unit length; the other sign
        (3, {"rates": (math.nan, math.nan, 0.5)}),  # attitude and a rate of yaw
    ],
)
def test_what_an_attitude_setpoint_ignores_may_be_anything(mask, fields):
    message = heard(attitude(mask, **fields))
    assert message.refusal is None
    assert math.hypot(*message.q_EB) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("mask", "fields", "reason"),
    [
        (32, {}, (Code.THRUST_VECTOR,)),
        (64, {}, (Code.NO_THRUST,)),
        (64 | 128, {}, (Code.NO_THRUST,)),
        (8, {}, (Code.MASK_BITS, (8,))),
        (128 | 7, {}, (Code.NEEDS_BODY_RATES,)),
        (128 | 4, {}, (Code.NEEDS_BODY_RATES,)),
        (0, {"thrust": math.nan}, (Code.THRUST_RANGE,)),
        (0, {"thrust": 1.01}, (Code.THRUST_RANGE,)),
        (0, {"thrust": -0.01}, (Code.THRUST_RANGE,)),
        (0, {"q": (0.0, 0.0, 0.0, 0.0)}, (Code.NOT_UNIT,)),
        (0, {"q": (1.0011, 0.0, 0.0, 0.0)}, (Code.NOT_UNIT,)),
        (0, {"q": NO_ATTITUDE}, (Code.NOT_UNIT,)),
        (0, {"q": (math.inf, 0.0, 0.0, 0.0)}, (Code.NOT_UNIT,)),
        (0, {"rates": (0.0, math.nan, 0.0)}, (Code.BODY_RATES_RANGE, (10.0,))),
        (128, {"rates": (0.0, 0.0, math.inf)}, (Code.BODY_RATES_RANGE, (10.0,))),
        (128, {"rates": (-10.01, 0.0, 0.0)}, (Code.BODY_RATES_RANGE, (10.0,))),
    ],
)
def test_an_attitude_setpoint_that_must_not_be_flown_says_why(mask, fields, reason):
    message = heard(attitude(mask, **fields))
    assert message.refusal == Told(*reason)
    assert message.q_EB == pytest.approx(heard(attitude(q=(1.0, 0.0, 0.0, 0.0))).q_EB)


@given(
    st.floats(),
    st.builds(Vec3, *[st.floats()] * 3),
    st.builds(Quat, *[st.floats()] * 4),
    st.integers(0, 255),
)
def test_no_attitude_setpoint_raises_and_an_accepted_one_is_finite(thrust, w_B, q_EB, mask):
    message = heard(attitude_setpoint(FCU, 1.0, q_EB, w_B, thrust, mask))
    if not message.refusal:
        assert 0.0 <= message.thrust <= 1.0
        assert math.hypot(*message.q_EB) == pytest.approx(1.0, abs=1e-9)
        assert not message.type_mask & IGNORE_ATTITUDE or all(abs(w) <= 10.0 for w in message.w_B)
