"""Setpoints that cannot be flown, and streams that stop.

`tests/bad_input/README.md` says which line of the bad-input catalogue is where.
"""

from __future__ import annotations

import math

import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.status_texts import Code, Told, words
from tests.bad_input.hovering import MASK_POSITION, NAN, OFFBOARD, POSITION


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        ({"r": (NAN, NAN, NAN), "yaw": NAN}, Told(Code.COMMANDS_NOTHING)),  # S1
        ({"r": (0, math.inf, 0)}, Told(Code.NOT_FINITE, ("position",))),
        ({"mask": 0xDC7, "v": (-math.inf, 0, 0)}, Told(Code.NOT_FINITE, ("velocity",))),
        ({"mask": 0xFFF}, Told(Code.COMMANDS_NOTHING)),  # S3
        ({"mask": 0xC3F | 512}, Told(Code.FORCE)),
        ({"mask": 0xDFD, "r": (0, NAN, 0)}, Told(Code.COMMANDS_NOTHING)),
        ({"frame": 4}, Told(Code.FRAME_UNSUPPORTED, (4,))),  # S4
        ({"frame": 255}, Told(Code.FRAME_UNSUPPORTED, (255,))),
        ({"r": (1e9, 0, 0)}, Told(Code.ABOVE_LIMIT, ("position", 100000.0, "m"))),  # S6
        ({"mask": 0xDC7, "v": (1e4, 0, 0)}, Told(Code.ABOVE_LIMIT, ("velocity", 100.0, "m/s"))),
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
    flying.says(Told(Code.OFFBOARD_LOST_MODE, (1.0, "Position")))
    assert flying.mode() == POSITION


@pytest.mark.parametrize(
    ("mask", "r", "v", "masked"),
    [
        (0xDF8, (NAN, NAN, -20.0), (0, 0, 0), 0xDFB),
        (0xDC7, (0, 0, 0), (1.0, NAN, 0.0), 0xDD7),
        (0xDC0, (0.0, 0.0, NAN), (NAN, NAN, 0.5), 0xDDC),
    ],
)
def test_what_is_no_number_is_as_if_it_were_masked(flying, mask, r, v, masked):
    """S1, as PX4 takes it."""
    flying.send(flying.setpoint(mask=mask, r=r, v=v))
    echo = flying.heard("POSITION_TARGET_LOCAL_NED", lambda m: m.type_mask == masked)
    assert (echo.vx, echo.vy, echo.vz) == pytest.approx(v, nan_ok=True)


def test_what_is_ignored_may_be_anything(flying):
    """S2."""
    flying.send(flying.setpoint(v=(NAN, NAN, NAN), yaw=NAN))
    # an earlier test's setpoint may still be told
    flying.heard(
        "POSITION_TARGET_LOCAL_NED", lambda m: math.isnan(m.vx) and m.type_mask == MASK_POSITION
    )


@pytest.mark.parametrize(
    ("q", "thrust"), [((0, 0, 0, 0), 0.4), ((1, 0.1, 0, 0), 0.4), ((NAN, 0, 0, 0), 0.4),
                      ((1, 0, 0, 0), 1.5), ((1, 0, 0, 0), NAN)],
)  # fmt: skip
def test_a_bad_attitude_is_refused(flying, q, thrust):
    """S5."""
    message = mavlink.MAVLink_set_attitude_target_message(
        0, flying.at.system_id, 1, 7, q, 0, 0, 0, thrust
    )
    flying.refuses(message, Told(Code.NOT_UNIT if thrust == 0.4 else Code.THRUST_RANGE))
    assert flying.mode() == OFFBOARD


def test_a_second_script_is_told_who_flies(flying):
    """S8."""
    other = flying.setpoint(r=(50, 0, -20))
    flying.refuses(other, Told(Code.ANOTHER_SENDS, (245, 190)), source=(111, 1))


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


@pytest.mark.parametrize(
    ("setpoint", "speeds", "flown"),
    [
        (
            {"mask": 0xDC7, "v": (30.0, 40.0, 0.0)},
            (50.0, 12.0),
            (7.2, 9.6, 0.0),
        ),
        ({"mask": 0xDC7, "v": (0.0, 0.0, 12.0)}, (12.0, 1.5), (0, 0, 1.5)),
        ({"mask": 0xDC0, "v": (0.0, 0.0, -90.0)}, (90.0, 3.0), (0, 0, -3.0)),
    ],
)
def test_what_is_too_fast_is_flown_at_the_limit_and_told(flying, setpoint, speeds, flown):
    """S6: with a position too."""
    flying.complains(flying.setpoint(**setpoint), Told(Code.SETPOINT_FAST, speeds))
    flying.tick(3)
    assert flying.mode() == OFFBOARD
    flying.send(flying.long(176, 1, 4, 3))  # hold: from the velocity that was flown
    flying.sync()
    flying.drain()
    flying.send(flying.long(512, 85))
    target = flying.heard("POSITION_TARGET_LOCAL_NED")
    assert (target.vx, target.vy, target.vz) == pytest.approx(flown, abs=0.05)


def test_an_attitude_goes_with_a_yaw_rate_only(flying):
    """What would not be flown is refused, not left out."""
    message = mavlink.MAVLink_set_attitude_target_message(
        0, flying.at.system_id, 1, 0, (1, 0, 0, 0), 0.3, 0, 0, 0.4
    )
    flying.refuses(message, Told(Code.YAW_RATE_ONLY))


@pytest.mark.parametrize(
    ("message", "told"),
    [
        (
            lambda system: mavlink.MAVLink_set_actuator_control_target_message(
                0, 0, system, 1, [0.5] * 8
            ),
            Told(Code.NOT_TAKEN, ("SET_ACTUATOR_CONTROL_TARGET",)),
        ),
    ],
)
def test_what_is_not_taken_is_told_once_a_second_at_most(flying, message, told):
    """C11: whoever sends it waits for something that will not happen."""
    for _ in range(50):
        flying.send(message(flying.at.system_id))
    flying.sync()
    said = [m.text for m in flying.inbox if m.get_type() == "STATUSTEXT"]
    assert 1 <= said.count(words(told)) <= 3
    assert flying.mode() == OFFBOARD
