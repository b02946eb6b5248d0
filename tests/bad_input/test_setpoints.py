"""Setpoints that cannot be flown, and streams that stop.

`tests/ground/README.md` says which line of the bad-input catalogue is where.
"""

from __future__ import annotations

import math

import pymavlink.dialects.v20.common as mavlink
import pytest

from tests.bad_input.hovering import MASK_POSITION, NAN, OFFBOARD, POSITION


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        ({"r": (NAN, 0, 0)}, "its position is not finite"),  # S1
        ({"r": (0, math.inf, 0)}, "its position is not finite"),
        ({"mask": 0xDC7, "v": (NAN, 0, 0)}, "its velocity is not finite"),
        ({"mask": 0xFFF}, "it commands nothing"),  # S3
        ({"mask": 0xDF8 | 512}, "force setpoints are not supported"),
        ({"mask": 0xDF9}, "a part of its position is ignored"),
        ({"frame": 4}, "frame 4 is not supported"),  # S4
        ({"frame": 255}, "frame 255 is not supported"),
        ({"r": (1e9, 0, 0)}, "its position is above 100000 m"),  # S6
        ({"mask": 0xDC7, "v": (1e4, 0, 0)}, "its velocity is above 100 m/s"),
    ],
)
def test_a_bad_setpoint_is_refused_in_words_and_does_not_keep_the_stream_alive(flying, bad, why):
    """S1, S3, S4, S6: the last good one is flown until it is too old, to the tick."""
    flying.stream(1)  # takes effect at the next tick
    last = flying.ticks
    flying.tick(1)
    flying.refuses(flying.setpoint(**bad), why)
    for _ in range(5):
        flying.tick(100)
        flying.send(flying.setpoint(**bad))
        flying.sync()
    flying.tick(last + 500 - flying.ticks + 1)  # 1 s after it: not lost
    assert flying.mode() == OFFBOARD
    flying.tick(1)
    assert "Offboard lost: no setpoint for 1 s" in flying.says("Offboard lost")
    assert flying.mode() == POSITION


def test_what_is_ignored_may_be_anything(flying):
    """S2."""
    flying.send(flying.setpoint(v=(NAN, NAN, NAN), yaw=NAN))
    echo = flying.heard("POSITION_TARGET_LOCAL_NED", lambda m: math.isnan(m.vx))
    assert echo.type_mask == MASK_POSITION


@pytest.mark.parametrize(
    ("q", "thrust"), [((0, 0, 0, 0), 0.4), ((1, 0.1, 0, 0), 0.4), ((NAN, 0, 0, 0), 0.4),
                      ((1, 0, 0, 0), 1.5), ((1, 0, 0, 0), NAN)],
)  # fmt: skip
def test_a_bad_attitude_is_refused(flying, q, thrust):
    """S5."""
    message = mavlink.MAVLink_set_attitude_target_message(
        0, flying.at.system_id, 1, 7, q, 0, 0, 0, thrust
    )
    flying.refuses(
        message,
        "its attitude is not a unit quaternion"
        if thrust == 0.4
        else "its thrust is not between 0 and 1",
    )
    assert flying.mode() == OFFBOARD


def test_a_second_script_is_told_who_flies(flying):
    """S8."""
    other = flying.setpoint(r=(50, 0, -20))
    flying.refuses(other, "system 245 component 190 is sending them", source=(111, 1))


def test_a_sender_s_clock_is_not_trusted(flying):
    """S9: arrival counts, whatever the message says of its time."""
    for time_boot_ms in (0, 2**32 - 1, 12345):
        message = flying.setpoint()
        message.time_boot_ms = time_boot_ms
        flying.send(message)
        flying.heard("POSITION_TARGET_LOCAL_NED")
    flying.tick(100)
    assert flying.mode() == OFFBOARD


@pytest.mark.parametrize("every_ticks", [1, 250, 500])
def test_streams_of_500_2_and_1_hz_are_alive(flying, every_ticks):
    """S7: a gap of exactly COM_OF_LOSS_T is none."""
    for _ in range(max(3, 100 // every_ticks)):
        flying.stream(1)
        flying.tick(every_ticks)
    assert flying.mode() == OFFBOARD


def test_half_a_hertz_is_no_stream(flying):
    """S7."""
    flying.tick(1000)
    assert flying.mode() == POSITION
