"""Modes, failsafes and the fence, as a vehicle told them, and faults that came too late."""

from __future__ import annotations

import pytest

from fcu.interface.event_log import Event, event
from fcu.interface.status_texts import Code, Told
from gcs_tools.judging.failsafes import Failsafe, judge_vehicle, vehicle_told
from gcs_tools.judging.fault_check import judge_faults
from gcs_tools.missions.tables import PlantFault


def told(t: float, code: Code, *values: object) -> Event:
    return event(t, "info", "fcu", Told(code, values))


LOW = (
    told(0.0, Code.IN_MODE, "Offboard"),
    told(5.0, Code.BATTERY_LOW, 14.0),
    told(6.0, Code.BATTERY_CRITICAL, 6.0),
    told(6.0, Code.FAILSAFE_LATER, 5.0, "Return"),
    told(6.0, Code.IN_MODE, "Hold"),
    told(11.0, Code.FAILSAFE_MODE, "Return"),
    told(11.0, Code.IN_MODE, "Return"),
    told(12.0, Code.FENCE_BREACHED),
    told(12.0, Code.FAILSAFE_MODE, "Land"),
    told(12.0, Code.IN_MODE, "Land"),
)


def test_each_failsafe_is_named_by_its_condition_once() -> None:
    found = vehicle_told(LOW, 20.0)
    assert found.failsafes == (
        Failsafe("battery_critical", 6.0, "Return"), Failsafe("fence_breached", 12.0, "Land"),
    )  # fmt: skip
    assert (found.mode, found.breached_s) == ("Land", 12.0)
    before = vehicle_told(LOW, 11.5)
    assert (before.mode, before.breached_s, len(before.failsafes)) == ("Return", None, 1)


@pytest.mark.parametrize(
    ("events", "acted"),
    [
        ((told(3.0, Code.OFFBOARD_LOST_MODE, 1.0, "Land"),), Failsafe("offboard_lost", 3.0, "Land")),
        ((told(3.0, Code.STICKS_LOST_STOPPED, 1.0),), Failsafe("sticks_lost", 3.0, "rotors stopped")),
        ((told(3.0, Code.CRASHED),), Failsafe("crashed", 3.0, "rotors stopped")),
        (
            (told(3.0, Code.ATTITUDE_LOST, 61.0), told(3.0, Code.FAILSAFE_STOPPED)),
            Failsafe("attitude_lost", 3.0, "rotors stopped"),
        ),
        ((told(3.0, Code.ATTITUDE_LOST, 61.0),), None),
        ((told(3.0, Code.BATTERY_LOW, 14.0),), None),
    ],
)  # fmt: skip
def test_a_warning_is_no_action(events, acted) -> None:
    assert vehicle_told(events, 20.0).failsafes == (() if acted is None else (acted,))


@pytest.mark.parametrize(
    ("expect", "met"),
    [
        ({"mode": "Land"}, True),
        ({"mode": "Return"}, False),
        ({"failsafe": {"name": "battery_critical"}}, True),
        ({"failsafe": {"name": "battery_critical", "from": 6.0, "to": 6.0}}, True),
        ({"failsafe": {"name": "battery_critical", "from": 6.1}}, False),
        ({"failsafe": {"name": "battery_critical", "to": 5.9}}, False),
        ({"failsafe": {"name": "fence_breached"}}, False),
        ({"failsafe": {"name": "none"}}, False),
        ({"fence_breached": True}, True),
        ({"fence_breached": False}, False),
    ],
)
def test_what_was_told_is_held_against_what_is_expected(expect, met) -> None:
    (line,) = judge_vehicle(expect, vehicle_told(LOW, 20.0))
    assert line.passed is met


def test_a_vehicle_that_told_nothing_meets_no_mode() -> None:
    nothing = vehicle_told([], 20.0)
    (mode,) = judge_vehicle({"mode": "Land"}, nothing)
    assert (mode.passed, mode.value) == (False, None)
    (none,) = judge_vehicle({"failsafe": {"name": "none"}}, nothing)
    assert none.passed is True
    assert judge_vehicle({}, vehicle_told(LOW, 20.0)) == []


def test_a_fault_that_begins_after_the_end_is_named_and_missed() -> None:
    faults = [
        PlantFault(kind="motor_off", at_s=5.0, rotor=3), PlantFault(kind="state_off", at_s=20.0, for_s=0.5),
    ]  # fmt: skip
    (late,) = judge_faults(faults, 12.0)
    assert (late.passed, late.value) == (False, "1 of 2 began")
    assert late.why is not None
    assert "state_off at 20 s for 0.5 s" in late.why
    assert "motor_off of rotor 3 at 5 s" in late.text
    (met,) = judge_faults(faults, 20.0)
    assert (met.passed, met.why) == (True, None)
    assert judge_faults([], 1.0) == []
