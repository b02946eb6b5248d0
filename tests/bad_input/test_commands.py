"""Commands that cannot be carried out: an answer, a reason, the vehicle as it was.

`tests/bad_input/README.md` says which line of the bad-input catalogue is where.
"""

from __future__ import annotations

import math
import os

import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.status_texts import Code, Told, words
from tests.bad_input.hovering import HOLD, NAN, OFFBOARD


@pytest.mark.parametrize(
    ("command", "params", "result"),
    [
        (400, (NAN,), 2), (400, (math.inf,), 2), (400, (2.0,), 2),
        (400, (0.0,), 2),  # C10: in flight
        (22, (0, 0, 0, NAN, NAN, NAN, 1e38), 2),
        (176, (1, 1, 0), 2), (176, (0, 4, 3), 2), (176, (1, NAN, 0), 2), (176, (1, 4, 4), 2),
        (178, (1, 0.0, -1), 2), (178, (1, NAN, -1), 2), (178, (3, 5, -1), 2),
        (179, (0, 0, 0, 0, 95.0, 0, 0), 2), (192, (-1, 1, 0, NAN, 47.0, 8.0, 500.0), 2),
        (34, (0.5, 1, 0, 0, NAN, NAN, NAN), 2), (34, (10, 1, 7, 0, NAN, NAN, NAN), 2),
        (34, (10, 1, 0, 0, 95.0, 0, 0), 2), (34, (1, 9, 0, 0, NAN, NAN, NAN), 2),
        (193, (1,), 2), (245, (1,), 2), (245, (7,), 2), (420, (1, 1, 1), 2), (300, (), 2),
        (246, (1,), 2), (31999, (), 3), (65535, (), 3), (511, (30, NAN), 2), (511, (65000, 1e4), 3),
        (511, (0, 1e4), 2), (512, (65000,), 3), (512, (NAN,), 2), (510, (9999,), 3),
    ],
)  # fmt: skip
def test_a_bad_command_is_answered_and_changes_nothing(flying, command, params, result):
    """C3 to C6, C9 to C12."""
    assert flying.ask(command, *params) == result
    flying.tick(2)
    assert flying.armed
    assert flying.mode() == OFFBOARD


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda f: f.long(176, 1, 4, 4), Told(Code.DENIED, ("Mission", Told(Code.NO_MISSION)))),
        (lambda f: f.long(176, 1, 7), Told(Code.DENIED, ("Stabilized", Told(Code.NO_STICKS)))),
        (lambda f: f.long(176, 1, 4, 99), "Mode 4, 99 denied"),
        (lambda f: f.long(262, 4), Told(Code.DENIED, ("Altitude", Told(Code.NO_STICKS)))),
        (lambda f: f.long(262, 2), "Orbit denied: an orbit begins with DO_ORBIT"),
        (
            lambda f: mavlink.MAVLink_set_mode_message(f.at.system_id, 1, 1 << 16),
            Told(Code.DENIED, ("Manual", Told(Code.NO_STICKS))),
        ),
    ],
)
def test_a_mode_that_cannot_be_entered_is_told_by_its_name(flying, ask, said):
    """C4."""
    flying.send(ask(flying))
    flying.says(said)
    assert flying.mode() == OFFBOARD


@pytest.mark.parametrize(("frame", "result"), [(1, 9), (2, 9), (10, 2), (200, 9), (6, 2)])
def test_a_place_in_a_frame_that_is_none_of_earth_is_refused(flying, frame, result):
    """C6; and C4: a latitude of 95 degrees."""
    system = flying.at.system_id
    message = mavlink.MAVLink_command_int_message(
        system, 1, frame, 192, 0, 0, -1, 1, 0, NAN, 950_000_000, 0, 10.0
    )
    flying.send(message)
    assert flying.heard("COMMAND_ACK").result == result
    assert flying.mode() == OFFBOARD


def test_commands_for_others_are_not_answered_and_those_for_all_must_be_harmless(flying):
    """C1, C2."""
    flying.send(flying.long(400, 0, 21196, target=77))
    assert flying.ask(400, 0, 21196, target=0) == mavlink.MAV_RESULT_DENIED
    flying.says(words(Told(Code.TO_NO_SYSTEM)))
    assert flying.ask(512, 148, target=0) == mavlink.MAV_RESULT_ACCEPTED
    flying.tick()
    assert flying.armed


def test_a_repeated_command_is_acknowledged_again_and_done_once(flight):
    """C7: its answer was lost. NaN is the same as NaN."""
    hold = (1, 4, 3, NAN, NAN, NAN, NAN)
    for confirmation in (0, 1, 2):
        assert flight.ask(176, *hold, confirmation=confirmation) == mavlink.MAV_RESULT_ACCEPTED
    flight.sync()
    told = [m.text for m in flight.inbox if m.get_type() == "STATUSTEXT"]
    assert told.count("Mode Hold") == 1


def test_a_repetition_that_comes_too_late_does_not_undo_what_came_between(flight):
    """C7."""
    assert flight.ask(400, 1) == mavlink.MAV_RESULT_ACCEPTED
    assert flight.ask(400, 0, 21196) == mavlink.MAV_RESULT_ACCEPTED
    assert flight.ask(400, 1, confirmation=1) == mavlink.MAV_RESULT_DENIED
    flight.says(words(Told(Code.LATE_REPETITION, ("",))))
    flight.tick()
    assert not flight.armed


def test_a_command_that_waits_is_answered_once_however_often_it_is_asked_for(flight):
    """C8: offboard after one setpoint, until the second comes. A script may ask at each turn."""
    flight.stream(1)
    for confirmation in (0, 0, 1):
        flight.send(flight.long(176, 1, 6, confirmation=confirmation))
    flight.sync()
    assert [m for m in flight.inbox if m.get_type() in ("COMMAND_ACK", "STATUSTEXT")] == []
    flight.stream(1)
    done = flight.heard("COMMAND_ACK", lambda m: m.command == 176)
    assert done.result == mavlink.MAV_RESULT_ACCEPTED
    assert flight.mode() == OFFBOARD
    assert [m for m in flight.inbox if m.get_type() == "COMMAND_ACK" and m.command == 176] == []


def test_a_stream_that_does_not_come_is_rejected_with_its_reason_at_the_first_answer(flight):
    """C8: clients take the first acknowledgement for the last."""
    flight.stream(1)
    assert flight.ask(176, 1, 6) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    flight.says(words(Told(Code.NO_STREAM)))
    assert flight.mode() == HOLD


def test_a_message_at_no_interval_at_all_is_kept_to_what_a_link_can_take(flight):
    """C12."""
    assert flight.ask(511, 30, 1) == mavlink.MAV_RESULT_ACCEPTED
    assert flight.ask(510, 30) == mavlink.MAV_RESULT_ACCEPTED
    assert flight.heard("MESSAGE_INTERVAL").interval_us == 5000
    assert flight.ask(511, 30, -1) == mavlink.MAV_RESULT_ACCEPTED
    assert flight.ask(510, 30) == mavlink.MAV_RESULT_ACCEPTED
    assert flight.heard("MESSAGE_INTERVAL").interval_us == -1


def test_what_only_asks_is_answered_as_often_as_it_is_asked(flight):
    """C7: the message was lost, not only the acknowledgement; others were asked for in between."""
    for confirmation, message_id in enumerate((148, 242, 148, 242, 148)):
        result = flight.ask(512, message_id, confirmation=confirmation)
        assert result == mavlink.MAV_RESULT_ACCEPTED
        flight.heard("AUTOPILOT_VERSION" if message_id == 148 else "HOME_POSITION")


def test_a_flood_of_good_commands_is_answered_one_by_one_and_told_a_few_times(flight):
    """C3: each is carried out; what is said of it, to everybody, leaves room for telemetry."""
    for k in range(300):
        mode = (1, 4, 3) if k % 2 else (1, 3, 0)
        assert flight.ask(176, *mode) == mavlink.MAV_RESULT_ACCEPTED
    flight.sync()
    told = [m.text for m in flight.inbox if m.get_type() == "STATUSTEXT"]
    assert 1 <= len(told) <= 60
    assert set(told) == {"Mode Hold", "Mode Position"}
    logged = flight.program.text()
    assert logged.count("Mode Hold") + logged.count("Mode Position") == len(told)


def test_a_flood_of_bad_commands_is_answered_one_by_one_and_explained_a_few_times(flight):
    """C3: every one has its acknowledgement, everybody else's console is spared."""
    for _ in range(300):
        flight.send(flight.long(31999))
        flight.heard("COMMAND_ACK", lambda m: m.command == 31999)
    flight.sync()
    told = [m.text for m in flight.inbox if m.get_type() == "STATUSTEXT"]
    assert 1 <= len(told) <= 60
    assert set(told) == {"Command 31999 is not supported"}


@pytest.mark.parametrize(
    ("x", "y", "z"),
    [
        (0, 0, 10.0),  # left out
        (-473_977_420, -1_714_544_060, 10.0),  # on the other side of Earth
        (473_977_420, -2_147_483_648, 10.0),  # half a place
        (473_977_420, 85_455_940, -500.0),  # under the ground
        (473_977_420, 85_455_940, NAN),
    ],
)
def test_reposition_flies_only_to_a_plausible_place(flying, x, y, z):
    """C4. Without a height: the one it has."""
    message = mavlink.MAVLink_command_int_message(
        flying.at.system_id, 1, 6, 192, 0, 0, 3.0, 1, 0, NAN, x, y, z
    )
    flying.send(message)
    result = flying.heard("COMMAND_ACK").result
    if math.isnan(z):
        assert result == mavlink.MAV_RESULT_ACCEPTED
    else:
        assert result == mavlink.MAV_RESULT_DENIED
        why = Code.NO_HEIGHT_NEAR if z < 0.0 else Code.NO_PLACE_NEAR
        flying.says(Told(Code.DENIED, ("Reposition", Told(why))))
        assert flying.mode() == OFFBOARD


def test_another_command_of_the_kind_of_one_that_waits_is_rejected(flight):
    """C8: other parameters, or another sender."""
    flight.stream(1)
    flight.send(flight.long(176, 1, 6))
    assert flight.ask(176, 1, 4, 3) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    flight.says(Told(Code.BUSY, ("DO_SET_MODE",)))
    flight.send(flight.long(176, 1, 6), source=(111, 1))
    rejected = flight.heard("COMMAND_ACK", lambda m: m.target_system == 111)
    assert rejected.result == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    flight.stream(1)
    done = flight.heard("COMMAND_ACK", lambda m: m.command == 176)
    assert done.result == mavlink.MAV_RESULT_ACCEPTED


def test_a_log_that_nobody_reads_stops_nothing(hover):
    """Each refusal is a line of log, and a pipe holds 64 KiB of them."""
    out, into = os.pipe()
    flight = hover(stderr=into)
    os.close(into)
    for _ in range(3000):
        flight.insist(flight.long(31999), "COMMAND_ACK")
        flight.inbox.clear()
        flight.tick()
    os.close(out)
