"""Setpoints that the actuators do not suffice for, over MAVLink, with each policy of the guard."""

from __future__ import annotations

import math

import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.status_texts import Code, Told, says
from tests.bad_input.hovering import HOLD, OFFBOARD

WARNING = mavlink.MAV_SEVERITY_WARNING


@pytest.fixture
def guarded(hover, tmp_path):
    """`guarded(policy)`: armed, in offboard mode, with MR_GUARD at that."""

    def one(policy):
        file = tmp_path / "guard.params"
        file.write_text(f"MR_GUARD = {policy}.0\n")
        flight = hover("--params", file)
        flight.stream()
        assert flight.ask(176, 1, 6) == mavlink.MAV_RESULT_ACCEPTED
        assert flight.ask(400, 1) == mavlink.MAV_RESULT_ACCEPTED
        flight.tick(3)
        flight.drain()
        return flight

    return one


def said(flight):
    """What is told of setpoints, chunks put together: severity, text."""
    texts = []
    for m in flight.inbox:
        if m.get_type() != "STATUSTEXT":
            continue
        if m.chunk_seq:
            texts[-1] = (m.severity, texts[-1][1] + m.text)
        else:
            texts.append((m.severity, m.text))
    return [each for each in texts if each[1].startswith("Setpoint")]


def flown_z(flight):
    """Up (m) of the setpoint in force."""
    return -flight.asked(85, "POSITION_TARGET_LOCAL_NED").z


HIGH = {"r": (0.0, 0.0, -60.0)}  # 40 m up from where it hovers


def told_of_a_stream(flight):
    """The one warning that a script hears which asks for HIGH again and again."""
    for _ in range(6):
        flight.tick(100)
        flight.send(flight.setpoint(**HIGH))
        flight.sync()
    ((severity, text),) = said(flight)
    assert severity == WARNING
    return text


def test_a_setpoint_is_refused_in_words_once_and_what_was_flown_goes_on(guarded):
    flight = guarded(2)
    text = told_of_a_stream(flight)
    assert says(text, Code.SETPOINT_REFUSED)
    assert " lacks " in text and text.endswith(" m would do")
    assert flight.mode() == OFFBOARD  # 1.2 s of simulation time after the last that was flown
    assert flown_z(flight) == 20.0
    fits = float(text.split("; ")[1].split()[0])
    flight.drain()
    flight.send(flight.setpoint(r=(0.0, 0.0, -20.0 - fits)))
    there = pytest.approx(-20.0 - fits)  # not what telemetry told just before
    flight.heard("POSITION_TARGET_LOCAL_NED", lambda m: m.z == there)
    flight.tick(1)
    assert flown_z(flight) == pytest.approx(20.0 + fits)
    assert not said(flight)


def test_another_setpoint_is_told_of_again(guarded):
    flight = guarded(2)
    flight.complains(flight.setpoint(**HIGH), "Setpoint rejected: lacks ")
    flight.drain()
    flight.complains(flight.setpoint(r=(0.0, 0.0, -70.0)), "Setpoint rejected: lacks ")


def test_a_velocity_is_judged_where_it_leads(guarded):
    flight = guarded(2)
    flight.complains(flight.setpoint(mask=0xDC7, v=(10.0, 0.0, 0.0)), "Setpoint rejected: lacks ")
    flight.drain()
    flight.send(flight.setpoint(mask=0xDC7, v=(0.25, 0.0, 0.0)))
    assert flight.heard("POSITION_TARGET_LOCAL_NED").vx == 0.25


def test_no_stream_begins_with_what_is_refused(hover, tmp_path):
    file = tmp_path / "guard.params"
    file.write_text("MR_GUARD = 2.0\n")
    flight = hover("--params", file)
    for _ in range(3):
        flight.send(flight.setpoint(**HIGH))
        flight.sync()
    assert flight.ask(176, 1, 6) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    flight.says(Told(Code.DENIED, ("Offboard", Told(Code.GUARD_REFUSES))))
    assert flight.ask(400, 1) == mavlink.MAV_RESULT_ACCEPTED  # it holds
    assert flight.mode() == HOLD


def test_an_attitude_is_never_refused(guarded):
    flight = guarded(2)
    flight.send(
        mavlink.MAVLink_set_attitude_target_message(
            0, flight.at.system_id, 1, 7, (1, 0, 0, 0), 0, 0, 0, 0.9
        )
    )
    flight.heard("ATTITUDE_TARGET")
    assert not said(flight)


def test_a_warning_comes_once_and_the_setpoint_is_flown(guarded):
    flight = guarded(0)
    text = told_of_a_stream(flight)
    assert says(text, Code.SETPOINT_SHORT) and " 40.0 m" in text
    assert flown_z(flight) == 60.0


def test_governed_nothing_is_said_and_it_is_seen_in_telemetry(guarded):
    flight = guarded(1)
    flight.send(flight.setpoint(**HIGH))
    flight.sync()
    flight.tick(500)
    assert not said(flight)
    assert flown_z(flight) == 60.0
    flight.send(flight.long(512, 251))
    named = {}
    while len(named) < 11:
        m = flight.heard("NAMED_VALUE_FLOAT")
        named[m.name] = m.value
    assert named["governed"] == 1.0
    assert named["margin_n"] > 0.0
    assert named["margin_deg"] == pytest.approx(45.0, abs=0.1)  # straight up
    assert math.isfinite(named["margin_c"])


def test_a_command_that_goes_too_fast_is_denied_and_changes_nothing(guarded):
    flight = guarded(2)
    before = flight.mode()
    flight.send(
        mavlink.MAVLink_command_int_message(
            flight.at.system_id, 1, 5, 192, 0, 0, 12.0, 0, 0, math.nan,
            473985000, 85455940, 489.4 + 20.0,
        )
    )  # fmt: skip
    ack = flight.heard("COMMAND_ACK", lambda m: m.command == 192)
    assert ack.result == mavlink.MAV_RESULT_DENIED
    text = flight.says("would do")
    assert text.startswith("Reposition denied: lacks ") and text.endswith(" % would do")
    assert flight.mode() == before == OFFBOARD
